"""The schedule against the same problem in plain casadi.Opti, and against every path of a tiny lattice."""

import itertools

import numpy as np
import pytest
from plain_schedule import PlainSchedule
from schedule_problems import figure5

from avc_casadi.design.schedule import initial_guess as _initial_guess
from avc_casadi.design.schedule.solver import ScheduleSolver
from avc_casadi.design.schedule.states import States
from avc_casadi.paper.loop import loop_at


@pytest.mark.thorough
@pytest.mark.parametrize(("band_factor", "penalty"), [(2.0, 1e-3), (2.0, 1e-1), (4.0, 1e-2)])
def test_same_optimum_as_plain_opti(band_factor, penalty):
    problem = figure5(
        points=30,
        stability={"model": "sampled-data", "scope": "band", "band_factor": band_factor},
        schedule={"slope_penalty": penalty},
    )
    gains = ScheduleSolver().solve(problem)
    cost = float(gains.notes[0].split()[1].rstrip(":"))
    states = States.of(problem, loop_at(problem, gains.frequency_hz))
    ours = states.states((gains.damping_ns_per_m, gains.stiffness_n_per_m, gains.contact_damping_ns_per_m))
    # A small barrier keeps Opti in the valley where it starts: there it finds the same optimum.
    small = {"mu_init": 1e-9, "bound_push": 1e-9, "bound_frac": 1e-9}
    near = PlainSchedule(problem, states.floors, tol=1e-10, **small)
    nearby, nearby_cost = near.solve(ours, problem.environment.stiffness_n_per_m)
    assert cost == pytest.approx(nearby_cost, rel=1e-4)
    np.testing.assert_allclose(ours, nearby, atol=2e-2)
    # From the middle of the box it finds nothing better.
    middle = np.repeat((states.low + states.high)[:, None] / 2, 30, axis=1)
    _, far_cost = PlainSchedule(problem, states.floors).solve(middle, problem.environment.stiffness_n_per_m)
    assert cost <= far_cost * (1 + 1e-4)


def staged(cost):
    """(states, stage) -> cost as states -> stage -> cost."""
    return lambda nodes: lambda stage: cost(nodes, stage)


@pytest.mark.thorough
@pytest.mark.one_of(3)
@pytest.mark.parametrize("penalty", [0.05, 0.005])
@pytest.mark.parametrize("limit", [np.inf, 3.0])
@pytest.mark.parametrize("seed", range(4))
def test_lattice_programme_equals_all_paths(monkeypatch, seed, limit, penalty):
    monkeypatch.setattr(_initial_guess, "_POINTS", {2: (3, 4)})
    rng = np.random.default_rng(seed)
    low, high, x = np.zeros(2), np.array([3.0, 6.0]), np.array([0.0, 0.7, 1.0, 2.0])
    nodes = np.array(list(itertools.product([0.0, 1.5, 3.0], [0.0, 2.0, 4.0, 6.0]))).T
    costs = rng.random((4, 12))

    def cost(states, stage):
        at = [int(np.flatnonzero((nodes == state[:, None]).all(axis=0))[0]) for state in states.T]
        return costs[stage, at]

    found = _initial_guess.lattice_path(staged(cost), (low, high), x, penalty, limit).path
    share = np.array([0.35, 0.5, 0.65, 0.5]) / 2.0

    def total(path):
        slope = (np.diff(path, axis=1) ** 2 / np.diff(x)).sum() / 2.0
        return float(share @ [cost(path[:, [i]], i)[0] for i in range(4)] + penalty * slope)

    reach = np.maximum(limit * np.diff(x), np.array([[1.5], [2.0]]) * 1.001)
    best = min(
        total(nodes[:, list(path)])
        for path in itertools.product(range(12), repeat=4)
        if (np.abs(np.diff(nodes[:, list(path)], axis=1)) <= reach).all()
    )
    assert (np.abs(np.diff(found, axis=1)) <= reach).all()
    assert total(found) == pytest.approx(best, rel=1e-12)


def test_best_constant_of_the_lattice(monkeypatch):
    monkeypatch.setattr(_initial_guess, "_POINTS", {2: (3, 4)})
    x = np.array([0.0, 1.0, 3.0])

    def cost(states, stage):
        return (states[0] - [0.0, 1.5, 3.0][stage]) ** 2 + 0 * states[1]

    constant = _initial_guess.lattice_path(staged(cost), (np.zeros(2), np.array([3.0, 6.0])), x, 0.0, np.inf).constant
    # Weights 1/6, 1/2, 1/3 about 0, 1.5, 3: the mean 1.75 is nearest to 1.5.
    assert constant[0, 0] == 1.5
