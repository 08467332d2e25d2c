"""Estimator, adaptation and observer inside a scene: what they leave alone, never create, and cure."""

import numpy as np
import pytest
from run_step import run_step

from avc_casadi.files.problem_file import parse_problem
from avc_casadi.model.gains import Gains, GainTable
from avc_casadi.simulation.compile import build_effects, compile_scene
from avc_casadi.simulation.effects.computation import Adaptation
from avc_casadi.simulation.execute import execute
from avc_casadi.simulation.judge import energy_ledger
from avc_casadi.simulation.runtime.observer import ObserverSettings, observer_step

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
        effect if not isinstance(effect, Adaptation) else type(effect)(effect.hold_s, effect.settings, table)
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


@pytest.mark.parametrize("adaptive", [True, False])
def test_a_guard_reckons_with_all_that_the_springs_hold(adaptive):
    """Its reserve is what passed less what is stored, both drawn up again from position, force and tool."""
    guard = 'kind = "guard"\nmethod = "energy-tank"'
    if adaptive:
        found, ledger = with_table(scene((*ADAPTIVE, guard)), JUMPING)
    else:
        gains = Gains(5.0, 3e3)
        compiled = compile_scene(scene((guard,)), gains=gains)
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


# The observer against a mass integrated exactly: never off the count, between its steps, ahead of a delay.

T, MASS = 1e-3, 0.2


@pytest.mark.parametrize("ahead", [0.25, 0.5, 1.75, 2.5])
def test_parts_of_a_sample_are_looked_ahead_too(ahead):
    """The mass on a grid of quarters of a sample, on which each force acts when its delay is over."""
    parts, asked = 4, np.random.default_rng(3).normal(0, 1.0, 300)
    late = int(parts * ahead)
    acceleration = -np.concatenate([np.zeros(late), np.repeat(asked, parts)])[: parts * len(asked)] / MASS
    h = T / parts
    velocity = np.concatenate([[0.0], np.cumsum(acceleration * h)])[:-1]
    position = np.concatenate([[0.0], np.cumsum(velocity * h + 0.5 * acceleration * h * h)])[:-1]
    step = observer_step(T, ObserverSettings(0.0, MASS, ahead))
    found = run_step(step, np.array([position[::parts], np.concatenate([[0.0], asked[:-1]])]))["position_m"]
    coming = position[late::parts]
    np.testing.assert_allclose(found[: len(coming)], coming, rtol=0, atol=1e-12)
