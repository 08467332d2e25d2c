"""Where nothing joins the stages, the schedule is the separate optimum; elsewhere it is never better than that."""

import numpy as np
import pytest
from schedule_problems import changed, figure5

from avc_casadi import solve
from avc_casadi.files.problem_file import load_problem


def share(frequencies):
    """What the NLP's tolerance of 1e-8 in the mean squared relative error leaves to one of n frequencies."""
    return (frequencies * 1e-8) ** 0.5


@pytest.mark.parametrize("model", ["paper", "sampled-data"])
@pytest.mark.parametrize("frequency", [1.0, 12.0, 40.0, 90.0, 300.0])
def test_one_frequency_equals_direct(model, frequency):
    problem = changed(load_problem("figure5"), stability={"model": model})
    problem = changed(problem, frequency={"start_hz": frequency, "stop_hz": frequency, "points": 1})
    schedule, direct = solve(problem, "schedule"), solve(problem, "direct")
    size = np.abs(direct.target)
    assert schedule.usable.all()
    assert np.abs(schedule.magnitude_error - direct.magnitude_error)[0] <= share(1) * size[0]


@pytest.mark.parametrize("model", ["paper", "sampled-data"])
@pytest.mark.parametrize("name", ["figure5", "damper", "damped"])
def test_without_smoothness_every_frequency_equals_direct(name, model):
    problem = changed(load_problem(name), stability={"model": model, "scope": "pointwise"}, frequency={"points": 60})
    problem = changed(problem, schedule={"slope_penalty": 0.0, "contact_damping_penalty": 0.0})
    schedule, direct = solve(problem, "schedule"), solve(problem, "direct")
    assert schedule.usable.all()
    excess = (schedule.magnitude_error - direct.magnitude_error) / np.abs(direct.target)
    assert excess.max() <= share(60)
    assert excess.min() >= -1e-9


@pytest.mark.parametrize(
    "tables",
    [
        {"stability": {"scope": "band"}},
        {"stability": {"scope": "band", "model": "sampled-data"}, "schedule": {"slope_limit": 1.0}},
        {"stability": {"scope": "all"}},
        {"realism": {"objective": "complex"}},
        {"realism": {"objective": "perceptual"}, "schedule": {"interaction_hz": (2.0, 20.0)}},
    ],
    ids=str,
)
def test_error_is_never_below_the_separate_optimum(tables):
    problem = figure5(points=50, **tables)
    schedule, exact = solve(problem, "schedule"), solve(problem, "exact")
    assert schedule.usable.all()
    assert ((schedule.magnitude_error - exact.magnitude_error) / np.abs(exact.target)).min() >= -1e-9


def cost(**tables):
    return float(solve(figure5(**tables), "schedule").notes[0].split()[1].rstrip(":"))


@pytest.mark.thorough
def test_cost_grows_with_every_demand():
    scopes = (
        {"scope": "pointwise"},
        {"scope": "band", "band_factor": 2.0},
        {"scope": "band", "band_factor": 4.0},
        {"scope": "all"},
    )
    costs = [cost(stability=scope) for scope in scopes]
    assert costs == sorted(costs)
    smooth = [cost(schedule={"slope_limit": limit}) for limit in (20.0, 2.0, 0.5)]
    assert smooth == sorted(smooth)
    assert smooth[0] < smooth[-1]
