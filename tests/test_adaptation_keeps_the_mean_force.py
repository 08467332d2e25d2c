"""Adapted gains under a mean force: no sag while they follow a frequency, and the row's own stiffness at rest."""

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.design.methods import solve
from avc_casadi.design.scene_coupling import simulate
from avc_casadi.files.problem_file import load_problem
from avc_casadi.model.gains import Gains, GainTable
from avc_casadi.simulation.run import Run
from avc_casadi.simulation.runtime.adaptation import AdaptationSettings, adaptation_step

T = 1e-3
ADAPTIVE = [{"kind": "estimator"}, {"kind": "adaptation"}]


def rocked(problem: avc.Problem, gains: Gains | GainTable) -> Run:
    """A hand presses into the wall and then moves to and fro at 8 Hz, without losing contact."""
    listed = [{"kind": kind} for kind in ("hand", "wall", "encoder", "coulomb-friction")]
    listed += [{"kind": "delay"}] if problem.device.delay_samples else []
    listed += ADAPTIVE if isinstance(gains, GainTable) else []
    motion = {"kind": "stroke", "frequency_hz": 8.0, "amplitude_m": 0.004, "end_m": 0.012}
    return simulate(problem.changed(scene={"effects": listed, "duration_s": 7.0, "motion": motion}), gains)


# A device with the delay of a real loop, and of a slow one.
CASES = {
    "ve3 late by a sample": ("ve3", {"delay_samples": 1}, "direct"),
    "ve3 late by two": ("ve3", {"delay_samples": 2}, "direct"),
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", CASES)
def test_a_preload_does_not_sag_while_the_hand_moves(name: str) -> None:
    """Mean depth and mean force are those of the row of rest; the row of 8 Hz alone gives way."""
    file, device, method = CASES[name]
    problem = load_problem(file).changed(device=device)
    table = GainTable.of(solve(problem, method))
    runs = [rocked(problem, gains) for gains in (table, table.at_rest, Gains(*table(8.0).tolist()))]
    assert runs[0].interaction_hz is not None
    late = slice(3500, 5500)
    assert np.nanmedian(runs[0].interaction_hz[late]) == pytest.approx(8.0, rel=0.02)
    assert np.median(runs[0].stiffness_n_per_m[late]) < 0.6 * table.rest_stiffness_n_per_m
    assert all(run.force_n[late].min() > 0 for run in runs)
    depth, rest, soft = (run.position_m[late].mean() for run in runs)
    assert soft > 1.03 * rest
    assert depth == pytest.approx(rest, rel=0.005)


@pytest.mark.thorough
@pytest.mark.parametrize("runtime", [{}, {"hold_s": 0.2, "slew_per_s": 20.0}], ids=["at once", "held and slewed"])
def test_a_held_press_ends_at_the_stiffness_of_its_row(runtime: dict[str, float]) -> None:
    problem = load_problem("figure5")
    assert (problem.device.coulomb_friction_n, problem.device.encoder_resolution_m) == (0.2, 2e-6)
    table = GainTable.of(solve(problem, "schedule"))
    static = GainTable.of(solve(problem, "static")).at_rest.stiffness_n_per_m
    listed = [{"kind": kind} for kind in ("hand", "wall", "encoder", "coulomb-friction", "estimator")]
    scene = {"effects": [*listed, {"kind": "adaptation"} | runtime], "duration_s": 4.0}
    run = simulate(problem.changed(scene=scene), table)
    k, k_e = table.rest_stiffness_n_per_m, problem.environment.stiffness_n_per_m
    # Of friction 0.2 N a part may carry the hand.
    assert run.apparent_stiffness_n_per_m == pytest.approx(k * k_e / (k + k_e), rel=0.06)
    assert run.apparent_stiffness_n_per_m > 2 * static * k_e / (static + k_e)
    assert run.stable


def given_too_much(sample_time_s: float, damping: float) -> np.ndarray:
    """Move springs to ground while their gains jump at random; return what each gave beyond what it took, J.

    Its energies are drawn up beside the step: the held force, as it acts on the hand, and what the spring stores.
    """
    lanes, seconds = 100, 0.6
    rng = np.random.default_rng(7)
    step = adaptation_step(sample_time_s, AdaptationSettings(return_s=0.02, mean_s=0.05, tank_j=0.02))
    function = step.function.map(lanes)
    rest = 10.0 ** rng.uniform(3, 5, lanes)
    # Levels that last from 7 to 60 ms, and a motion of three sines either way of the anchor.
    lasting, levels = rng.integers(7, 60, lanes), 10.0 ** rng.uniform(2, 5, (100, lanes))
    hertz, phase = rng.uniform(0.5, 20, (3, lanes)), rng.uniform(0, 2 * np.pi, (3, lanes))
    state = np.zeros((len(step.states), lanes))
    x = force = taken = np.zeros(lanes)
    least, anchored = np.zeros(lanes), np.zeros(lanes)
    for tick in range(round(seconds / sample_time_s)):
        time = tick * sample_time_s
        moved = 3e-4 * (np.sin(2 * np.pi * hertz * time + phase) - np.sin(phase)).sum(axis=0)
        taken = taken + force * (moved - x)
        inputs = dict.fromkeys(step.inputs, np.zeros(lanes)) | {
            "wanted_stiffness_n_per_m": levels[np.floor(time / (1e-3 * lasting) + 1e-9).astype(int), np.arange(lanes)],
            "wanted_damping_ns_per_m": np.full(lanes, damping),
            "deflection_m": x,
            "held_force_n": force,
            "position_m": moved,
            "touching": np.ones(lanes),
            "rest_stiffness_n_per_m": rest,
        }
        following, outputs = function(state, np.array(list(inputs.values())), np.zeros((0, lanes)))
        state, found = following.full(), dict(zip(step.outputs, outputs.full(), strict=True))
        stretch = moved - found["anchor_m"]
        force = found["stiffness_n_per_m"] * stretch + damping * (moved - x) / sample_time_s
        x = moved
        least = np.minimum(least, taken - 0.5 * found["stiffness_n_per_m"] * stretch**2)
        anchored = np.maximum(anchored, np.abs(found["anchor_m"]))
    assert np.all(anchored > 1e-5)
    return -least


@pytest.mark.thorough
@pytest.mark.parametrize("damping", [0.0, 5.0])
def test_jumping_gains_create_no_more_than_the_hold_of_a_force(damping: float) -> None:
    """What is missing goes to nothing with the sample time, as it does for constant gains."""
    slow, fast = (given_too_much(sample_time_s, damping) for sample_time_s in (1e-3, 2e-4))
    assert slow.max() > 1e-4
    assert fast.max() < 0.25 * slow.max()
    assert np.median(fast) < 0.25 * np.median(slow)


def test_constant_gains_never_lower_the_tank() -> None:
    """In series with a wall, whatever the device does: what a held force creates is not charged to the adaptation."""
    rng = np.random.default_rng(3)
    k, k_e, ticks = 3e4, 1e5, 2000
    x = np.cumsum(rng.normal(0, 3e-5, ticks))
    e = x * k_e / (k + k_e)
    given = {
        "wanted_stiffness_n_per_m": np.full(ticks, k),
        "rest_stiffness_n_per_m": np.full(ticks, k),
        "deflection_m": np.append(0, e[:-1]),
        "environment_energy_j": np.append(0, 0.5 * k_e * (x - e)[:-1] ** 2),
        "held_force_n": np.append(0, k * e[:-1]),
        "position_m": x,
        "touching": np.ones(ticks),
    }
    step = adaptation_step(T, AdaptationSettings())
    tank = step.run(np.array([given.get(name, np.zeros(ticks)) for name in step.inputs]))["tank_j"]
    assert np.abs(tank).max() < 1e-9


def test_falling_gains_hold_the_mean_force_only_with_a_full_tank() -> None:
    """From 1e5 to 2e4 N/m at 50 um the spring must store 0.5 mJ more: a tenth of it in the tank, and it sags."""
    step = adaptation_step(T, AdaptationSettings())
    force = {}
    for tank in (2e-3, 5e-5, 0.0):
        past = {
            "started": 1.0,
            "stiffness_n_per_m": 1e5,
            "tank_j": tank,
            "stored_j": 1.25e-4,
            "mean_deflection_m": 5e-5,
        }
        now = {"wanted_stiffness_n_per_m": 2e4, "deflection_m": 5e-5, "touching": 1.0, "rest_stiffness_n_per_m": 1e5}
        state, inputs = (
            [values.get(name, 0.0) for name in names] for values, names in ((past, step.states), (now, step.inputs))
        )
        found = dict(zip(step.outputs, step.function(state, inputs, [])[1].full()[:, 0], strict=True))
        force[tank] = found["stiffness_n_per_m"] * (5e-5 - found["anchor_m"])
    assert force[2e-3] == pytest.approx(5.0, rel=1e-4)
    assert force[0.0] == pytest.approx(1.0, rel=1e-9)
    assert 1.0 < force[5e-5] < 5.0
