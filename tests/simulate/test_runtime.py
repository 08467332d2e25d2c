"""Estimator, adaptation and observer inside a scene: what they leave alone, never create, and cure."""

import numpy as np
import pytest

from avc_casadi.design.methods import solve
from avc_casadi.files.problem_file import load_problem, parse_problem
from avc_casadi.model.gains import Gains, GainTable
from avc_casadi.model.hands import Hand
from avc_casadi.simulation.compile import compile_scene
from avc_casadi.simulation.effects.computation import Adaptation
from avc_casadi.simulation.effects.registry import build_effects
from avc_casadi.simulation.execute import execute
from avc_casadi.simulation.judge import energy_ledger
from avc_casadi.simulation.scene import simulate_batch

SOFT = """
[device]
mass_kg = 0.1
damping_ns_per_m = 2.0
[environment]
damping_ns_per_m = 0.0
stiffness_n_per_m = 2000.0
[coupling]
stiffness_n_per_m = [0.0, 1e7]
[frequency]
start_hz = 1.0
stop_hz = 50.0
points = 40
[scene]
duration_s = 3.5
coupling = "static"
[scene.motion]
kind = "stroke"
frequency_hz = 4.0
amplitude_m = 0.004
"""


def scene(effects, text=SOFT):
    tables = "\n".join(f"[[scene.effects]]\n{effect}" for effect in ('kind = "hand"', 'kind = "wall"', *effects))
    return parse_problem(text + tables)


ADAPTIVE = ('kind = "estimator"', 'kind = "adaptation"\nhold_s = 0.1\nslew_per_s = 50.0')


def with_table(problem, table):
    """Run a scene with a table of one's own; returns traces and ledger."""
    effects = build_effects(problem)
    bound = tuple(
        effect if not isinstance(effect, Adaptation) else type(effect)(effect.hold, effect.settings, table)
        for effect in effects
    )
    compiled = compile_scene(problem, bound)
    gains = type("NoGains", (), {"damping_ns_per_m": 0.0, "stiffness_n_per_m": 0.0, "contact_damping_ns_per_m": 0.0})
    traces = execute(compiled, compiled.parameter_values(gains), compiled.input_values())
    found = {name: values[0] for name, values in traces.items()}
    ledger = energy_ledger(
        found["position_m"],
        found["force_n"],
        found["tool_m"],
        found["stiffness_n_per_m"],
        compiled.environment,
        found["anchor_m"],
    )
    return found, ledger


JUMPING = GainTable(np.array([[1.0, 5, 1e3, 0], [3.9, 5, 1e3, 0], [3.901, 5, 1e7, 0], [50.0, 5, 1e7, 0]]))


@pytest.mark.parametrize("contact", ["gated", "clip-last"])
def test_gain_switch_at_full_deflection_creates_energy_only_without_the_anchor(contact):
    # The device goes in with a soft coupling, which stiffens at full deflection and softens on the way out.
    least = {}
    for passive in ("true", "false"):
        problem = scene(('kind = "estimator"', f'kind = "adaptation"\npassive = {passive}'))
        found, ledger = with_table(problem.changed(coupling={"contact": contact}), JUMPING)
        rises = np.diff(found["stiffness_n_per_m"]) > 1e6
        assert (rises & (found["force_n"][:-1] > 1)).sum() >= 3
        # What sampling itself creates: the steps of a spring that is held for T, at most the wall's.
        sampled = np.concatenate([[0.0], np.cumsum(0.5 * 2000.0 * np.diff(found["position_m"]) ** 2)])
        least[passive] = (ledger.dissipated_j + sampled).min()
    assert least["true"] > -1e-9
    assert least["false"] < -0.01


@pytest.mark.parametrize("contact", ["gated", "clip-last"])
def test_anchor_is_forgotten_outside_the_wall_and_the_wall_does_not_melt(contact):
    far = scene(ADAPTIVE, SOFT.replace("amplitude_m = 0.004", "amplitude_m = 0.015"))
    found, _ = with_table(far.changed(coupling={"contact": contact}), JUMPING)
    outside = found["position_m"] <= 0
    assert np.abs(found["anchor_m"]).max() > 1e-6
    assert np.all(found["anchor_m"][outside] == 0)
    if contact == "gated":
        # Nothing acts there, so that the coupling is slack: the tool stands where the device is.
        np.testing.assert_array_equal(found["tool_m"][outside], found["position_m"][outside])
    stiff = (found["force_n"] > 1) & (found["stiffness_n_per_m"] > 1e6)
    # The wall of 2000 N/m behind a coupling of 1e7 N/m, to the last stroke.
    strokes = found["force_n"][stiff] / found["position_m"][stiff]
    assert len(strokes) > 300
    assert np.median(strokes[-200:]) > 0.95 * 2000


@pytest.mark.thorough
def test_twenty_micrometre_encoder_without_friction_needs_the_observer():
    problem = load_problem("scenes/adaptive-press")
    gains = solve(problem, "schedule")
    rng = np.random.default_rng(4)
    hands = Hand(rng.uniform(0.05, 0.3, 24), rng.uniform(3, 20, 24), rng.uniform(200, 800, 24))
    found = simulate_batch(problem, hands, gains)
    assert found.stable.all()
    assert not found.buzzing.any()
    assert np.median(found.apparent_stiffness_n_per_m) > 0.9e5
    effects = tuple(effect for effect in problem.scene.effects if effect.kind != "observer")
    assert simulate_batch(problem.changed(scene={"effects": effects}), hands, gains).stable.sum() < 6


@pytest.mark.parametrize("adaptive", [True, False])
def test_a_guard_reckons_with_all_that_the_springs_hold(adaptive):
    """Its reserve is what passed less what is stored, both drawn up again from position, force and tool."""
    guard = 'kind = "guard"\nmethod = "energy-tank"'
    if adaptive:
        found, ledger = with_table(scene((*ADAPTIVE, guard)), JUMPING)
    else:
        compiled, gains = compile_scene(scene((guard,))), Gains(5.0, 3e3)
        traces = execute(compiled, compiled.parameter_values(gains), compiled.input_values())
        found = {name: values[0] for name, values in traces.items()}
        drawn = (found[name] for name in ("position_m", "force_n", "tool_m"))
        ledger = energy_ledger(*drawn, gains.stiffness_n_per_m, compiled.environment)
    change = np.diff(ledger.dissipated_j)
    reserve = [0.0]
    for step in change:
        reserve.append(max(min(reserve[-1] + step, 0.0), -0.01))
    assert min(reserve) < -5e-7
    np.testing.assert_allclose(found["guard_reserve_j"], reserve, rtol=0, atol=1e-12)
