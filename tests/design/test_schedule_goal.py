"""The schedule's cost is the goal that the problem states, summed up here from its gains alone."""

import numpy as np
import pytest
from plain_schedule import perceived
from schedule_problems import figure5

from avc_casadi import solve
from avc_casadi.design.schedule.programme import Programme
from avc_casadi.design.schedule.scope import Slots

ERRORS = {
    "magnitude": lambda ratio, _: np.abs(ratio) - 1,
    "complex": lambda ratio, _: np.abs(ratio - 1),
    "perceptual": lambda ratio, jnd: np.maximum(np.abs(ratio - 1) / jnd - 1, 0),
}


def stated_goal(problem, gains):
    """Return the weighted mean of the squared error, and that of the penalty on b_p.

    Trapezoids over ln(frequency), a tenth outside the frequencies of interaction, divided by their sum.
    """
    upper, lower = problem.boundaries.upper, problem.boundaries.lower
    desired = (
        (upper.damping_ns_per_m + lower.damping_ns_per_m) / 2,
        (upper.stiffness_n_per_m + lower.stiffness_n_per_m) / 2,
    )
    wall = problem.environment.damping_ns_per_m, problem.environment.stiffness_n_per_m
    rows = zip(gains.frequency_hz, gains.damping_ns_per_m, gains.stiffness_n_per_m, strict=True)
    z = np.array([complex(*perceived(problem, f, b, k, wall)) for f, b, k in rows])
    target = np.array([complex(*perceived(problem, f, None, None, desired)) for f in gains.frequency_hz])
    late = np.exp(-2j * np.pi * gains.frequency_hz * problem.device.sample_time_s)
    z = z + late * gains.contact_damping_ns_per_m
    x = np.log(gains.frequency_hz)
    weight = np.array([(x[min(i + 1, len(x) - 1)] - x[max(i - 1, 0)]) / 2 for i in range(len(x))])
    low, high = problem.schedule.interaction_hz
    weight[(gains.frequency_hz < low) | (gains.frequency_hz > high)] /= 10
    weight /= weight.sum()
    penalty = problem.schedule.contact_damping_penalty * (gains.contact_damping_ns_per_m / np.abs(target)) ** 2
    error = ERRORS[problem.realism.objective](z / target, problem.realism.jnd)
    return float(weight @ error**2), float(weight @ penalty)


@pytest.mark.parametrize("objective", list(ERRORS))
@pytest.mark.parametrize("interaction", [(2.0, 20.0), (30.0, 300.0)])
def test_errors_weigh_a_tenth_outside_interaction_and_contact_damping_costs_its_penalty(interaction, objective):
    problem = figure5(
        points=15,
        coupling={"structure": "damped", "contact_damping_ns_per_m": (0.0, 150.0)},
        stability={"model": "sampled-data", "scope": "band"},
        realism={"objective": objective, "jnd": 0.05},
        # Perceptual errors count thresholds, so that a penalty must be larger to be seen beside them.
        schedule={
            "slope_penalty": 0.0,
            "contact_damping_penalty": 10.0 if objective == "perceptual" else 1e-1,
            "interaction_hz": interaction,
        },
    )
    gains = solve(problem, "schedule")
    assert gains.usable.all()
    cost = float(gains.notes[0].split()[1].rstrip(":"))
    error, penalty = stated_goal(problem, gains)
    assert cost == pytest.approx(error + penalty, rel=1e-5)
    # What the solver minimises is that too, also where the lattice's path is returned.
    programme, free = Programme.of(problem), np.full((2, gains.rows), -np.inf)
    start = np.repeat((programme.states.low + programme.states.high)[:, None] / 2, gains.rows, axis=1)
    solved = programme.solve(Slots.of(problem, gains.frequency_hz), free, start)
    assert solved.cost == pytest.approx(programme.cost_of(solved.states), rel=1e-4)
    # Both parts count: ten times the penalty, or another weight outside, would be another goal.
    assert penalty > 1e-3 * cost
    plain, _ = stated_goal(problem.changed(schedule={"interaction_hz": (0.1, 1e4)}), gains)
    assert abs(plain - error) > 1e-2 * cost
