"""The schedule against the same problem in plain casadi.Opti, and against every path of a tiny lattice."""

import itertools

import numpy as np
import pytest
from plain_schedule import PlainSchedule
from schedule_problems import figure5

from avc_casadi import solve
from avc_casadi.design.schedule.dynamic_programme import cheapest_path
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
    gains = solve(problem, "schedule")
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


@pytest.mark.thorough
@pytest.mark.one_of(3)
@pytest.mark.parametrize("penalty", [0.05, 0.005])
@pytest.mark.parametrize("limit", [np.inf, 3.0])
@pytest.mark.parametrize("seed", range(4))
def test_lattice_programme_equals_all_paths(seed, limit, penalty):
    rng = np.random.default_rng(seed)
    x, axes = np.array([0.0, 0.7, 1.0, 2.0]), [np.array([0.0, 1.5, 3.0]), np.array([0.0, 2.0, 4.0, 6.0])]
    nodes = np.array(list(itertools.product(*axes))).T
    costs = rng.random((4, 12)) * (np.array([0.35, 0.5, 0.65, 0.5]) / 2.0)[:, None]
    found = cheapest_path(costs, axes, x, penalty, limit)

    def total(path):
        at = [int(np.flatnonzero((nodes == state[:, None]).all(axis=0))[0]) for state in path.T]
        return costs[range(4), at].sum() + penalty * (np.diff(path, axis=1) ** 2 / np.diff(x)).sum() / 2.0

    reach = np.maximum(limit * np.diff(x), np.array([[1.5], [2.0]]) * 1.001)
    best = min(
        total(nodes[:, list(path)])
        for path in itertools.product(range(12), repeat=4)
        if (np.abs(np.diff(nodes[:, list(path)], axis=1)) <= reach).all()
    )
    assert (np.abs(np.diff(found, axis=1)) <= reach).all()
    assert total(found) == pytest.approx(best, rel=1e-12)
