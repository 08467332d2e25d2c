"""The effect `simulation` of a scene: against a plain simulation of device, hand and engine."""

import numpy as np
from engine_simulator import EngineSimulator
from hypothesis import given, settings
from hypothesis import strategies as st

import avc_casadi as avc
from avc_casadi.model.gains import NO_COUPLING

SCENE = """
[device]
mass_kg = 0.12
damping_ns_per_m = 0.8
delay_samples = 1
[simulation]
tool_mass_kg = 0.3
tool_damping_ns_per_m = 0.5
step_s = {step!r}
integrator = "{integrator}"
substeps = {substeps}
exchange = "{exchange}"
steps_late = {late}
[scene]
duration_s = 0.5
coupling = "none"
[scene.motion]
kind = "stroke"
frequency_hz = 4.0
amplitude_m = 0.01
rest_s = 0.1
[[scene.effects]]
kind = "hand"
mass_kg = 0.1
damping_ns_per_m = 5.0
stiffness_n_per_m = 400.0
[[scene.effects]]
kind = "simulation"
stiffness_n_per_m = {stiffness}
damping_ns_per_m = {damping}
local_damping_ns_per_m = {local}
contact_stiffness_n_per_m = 1e12
[[scene.effects]]
kind = "delay"
[[scene.effects]]
kind = "saturation"
force_n = 5.0
"""


@settings(max_examples=25, deadline=None)
@given(
    ratio=st.sampled_from([1, 2, 5, 16, 2.5, 4 / 3]),
    integrator=st.sampled_from(["semi-implicit", "explicit", "exact", "implicit-damping", "implicit"]),
    substeps=st.sampled_from([1, 2, 5]),
    exchange=st.sampled_from(["on-time", "late", "ahead", "held-force"]),
    late=st.integers(0, 1),
    stiffness=st.sampled_from([100.0, 500.0, 3000.0]),
    damping=st.sampled_from([0.0, 2.0, 10.0]),
    local=st.sampled_from([0.0, 3.0]),
)
def test_scene_moves_as_a_plain_simulation(ratio, integrator, substeps, exchange, late, stiffness, damping, local):
    step = ratio * 1e-3
    problem = avc.parse_problem(
        SCENE.format(
            step=step,
            integrator=integrator,
            substeps=substeps,
            exchange=exchange,
            late=late,
            stiffness=stiffness,
            damping=damping,
            local=local,
        )
    )
    run = avc.simulate(problem, NO_COUPLING)
    plain = EngineSimulator(
        (0.12, 0.8, 1e-3, 1),
        (0.1, 5.0, 400.0),
        (0.3, 0.5),
        step,
        integrator,
        exchange,
        late,
        contact="wall",
        substeps=substeps,
    )
    start = run.position_m[0]
    device, tool = plain.run(stiffness, damping, run.samples, local=local, target=run.target_m, start=start, force=5.0)
    until = np.flatnonzero(np.abs(device) > 0.2)
    until = until[0] if len(until) else len(device)
    np.testing.assert_allclose(run.position_m[:until], device[:until], atol=1e-9)
    np.testing.assert_allclose(run.tool_m[:until], tool[:until], atol=1e-9)
