"""The effect `simulation` of a scene: against a plain simulation of device, hand and engine."""

from fractions import Fraction

import numpy as np
import pytest
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
clock = "{clock}"
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


@pytest.mark.slow
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
    clock=st.sampled_from(["own", "device"]),
)
def test_scene_moves_as_a_plain_simulation(
    ratio, integrator, substeps, exchange, late, stiffness, damping, local, clock
):
    """Steps that the device's loop starts begin at its first sample; a clock of the engine's own has some phase."""
    step = ratio * 1e-3
    clock = "own" if ratio % 1 else clock
    problem = avc.parse_problem(
        SCENE.format(
            step=step,
            clock=clock,
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
    # Every phase between two instants at which a step falls on a sample gives the same motion.
    period = Fraction(ratio).limit_denominator(3).denominator
    phases = [(number + 0.5) / period for number in range(period)] if clock == "own" else [0.0]
    ends = (0.12, 0.8, 1e-3, 1), (0.1, 5.0, 400.0), (0.3, 0.5), step
    engines = [
        EngineSimulator(*ends, integrator, exchange, late, contact="wall", phase=phase, substeps=substeps)
        for phase in phases
    ]
    how = {"local": local, "target": run.target_m, "start": run.position_m[0], "force": 5.0}
    motions = [engine.run(stiffness, damping, run.samples, **how) for engine in engines]
    assert any(moves_alike(run, *motion) for motion in motions)


def moves_alike(run, device, tool):
    """Whether device and tool of a run move as those of a plain simulation, until the device leaves its room."""
    away = np.flatnonzero(np.abs(device) > 0.2)
    until = away[0] if len(away) else len(device)
    pairs = ((run.position_m, device), (run.tool_m, tool))
    return all(np.allclose(moved[:until], plain[:until], rtol=0, atol=1e-9) for moved, plain in pairs)
