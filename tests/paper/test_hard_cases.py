"""Every hard case ends in a right answer, checked against 50 digits, or in a refusal that names cause and key."""

import numpy as np
import pytest
from quick import first
from reference_optimum import MP, NUMBERS, series_error

import avc_casadi as avc
from avc_casadi.design.methods import solve
from avc_casadi.model.problem import Problem
from avc_casadi.paper.equations import loop_at

WITHIN = {"exact": 1e-10, "direct": 1e-8}


def problem_of(text_or_tables):
    return Problem.model_validate(text_or_tables)


def wall(*, frequencies=(0.01, 17.0, 499.5), **changes):
    """A stiff wall with bounds about 0.9 of it; ``changes`` are dotted keys with __ for the dot."""
    tables = {
        "device": {"mass_kg": 0.1, "damping_ns_per_m": 2.0},
        "environment": {"damping_ns_per_m": 10.0, "stiffness_n_per_m": 1e5},
        "boundaries": {
            "upper": {"damping_ns_per_m": 11.0, "stiffness_n_per_m": 1.1e5},
            "lower": {"damping_ns_per_m": 7.0, "stiffness_n_per_m": 0.7e5},
        },
        "coupling": {},
        "stability": {},
        "frequency": {"values_hz": list(frequencies)},
    }
    for key, value in changes.items():
        table, name = key.split("__")
        tables[table][name] = value
    return problem_of(tables)


def bounded(share, **changes):
    """The wall with both bounds at a share of it."""
    environment = {
        "damping_ns_per_m": changes.get("environment__damping_ns_per_m", 10.0),
        "stiffness_n_per_m": changes.get("environment__stiffness_n_per_m", 1e5),
    }
    bound = {key: value * share for key, value in environment.items()}
    return wall(boundaries__upper=bound, boundaries__lower=bound, **changes)


def assert_right(problem):
    """`exact` stands on the optimum to 1e-10, `direct` to 1e-8, or both agree that there are no gains."""
    methods = {method: solve(problem, method) for method in ("exact", "direct")}
    for row, frequency in enumerate(problem.frequencies_hz()):
        truth = series_error(problem, float(frequency))
        loop = loop_at(problem, MP.mpf(float(frequency)), NUMBERS)
        for schedule in methods.values():
            if truth is None:
                assert schedule.status[row] == "infeasible"
                assert "missed by" in schedule.reason[row]
                continue
            assert schedule.usable[row], (schedule.method, frequency, schedule.reason[row])
            b, k = (MP.mpf(gain[row]) for gain in (schedule.damping_ns_per_m, schedule.stiffness_n_per_m))
            z, radius = loop.perceived(b, k), abs(loop.target)
            terms = abs(loop.device) + abs(loop.hold * loop.desired)
            within = WITHIN[schedule.method] * max(radius, 1e-6 * terms)
            assert abs(abs(abs(z) - radius) - truth) <= within, (schedule.method, frequency)
            assert z.real - problem.stability.margin_ns_per_m >= -1e-14 * terms


# Frequency


def test_a_hundredth_of_a_hertz_at_ten_kilohertz():
    assert_right(wall(device__sample_time_s=1e-4, frequencies=(0.01, 0.02, 0.1)))


# Environment


@pytest.mark.parametrize("share", first([1.0, 1 - 1e-12, 0.5, 2.0]))
@pytest.mark.parametrize("model", first(["paper", "sampled-data"]))
def test_desired_wall_equal_near_softer_and_stiffer(share, model):
    assert_right(bounded(share, stability__model=model))
    assert_right(bounded(share, stability__model=model, device__damping_ns_per_m=200.0))


@pytest.mark.parametrize(
    ("b_e", "k_e"), first([(0.0, 1e5), (10.0, 0.0), (0.0, 0.0), (10.0, 1e9), (0.0, 1e-8), (1e9, 1e12)])
)
@pytest.mark.parametrize("share", first([0.9]))
def test_pure_spring_pure_damper_free_space_and_very_stiff(b_e, k_e, share):
    environment = {"environment__damping_ns_per_m": b_e, "environment__stiffness_n_per_m": k_e}
    assert_right(bounded(share, **environment))
    assert_right(bounded(share, stability__model="sampled-data", **environment))


# Device


@pytest.mark.parametrize(("sample_time", "frequencies"), [(1e-5, (0.01, 1.0, 4.9e4)), (0.1, (0.001, 1.0, 4.99))])
def test_very_short_and_very_long_samples(sample_time, frequencies):
    assert_right(wall(device__sample_time_s=sample_time, frequencies=frequencies))


# Real part


@pytest.mark.parametrize("offset", [0.0, 4e-16, -4e-16, 1e-12])
def test_case_boundary_of_the_projection(offset):
    """Re Z_h_ds = b_d + cos^2(phi)(b_ds - k_ds T/2) is 0, and hardly so: with b_d = 0 exactly where b_ds = k_ds T/2."""
    bound = {"damping_ns_per_m": 50.0 * (1 + offset), "stiffness_n_per_m": 1e5}
    problem = wall(device__damping_ns_per_m=0.0, boundaries__upper=bound, boundaries__lower=bound)
    real = loop_at(problem, problem.frequencies_hz()).target.real
    assert np.all(np.abs(real) <= 1e-10)
    assert_right(problem)


def test_resonance_where_the_goal_nearly_vanishes():
    problem = avc.load_problem("hard/resonance")
    frequency = problem.frequencies_hz()
    loop = loop_at(problem, frequency)
    nearest = np.argsort(np.abs(loop.target))[:3]
    assert np.abs(loop.target[nearest[0]]) < 0.05 * np.abs(loop.device[nearest[0]])
    values = tuple(sorted(float(frequency[row]) for row in nearest))
    assert_right(problem.changed(frequency=type(problem.frequency)(values_hz=values)))


# Gain box


@pytest.mark.parametrize(
    ("b", "k"),
    [
        ((20.0, 20.0), (0.0, 1e6)),
        ((0.0, 1e3), (5e4, 5e4)),
        ((20.0, 20.0), (5e4, 5e4)),
        ((0.0, 0.0), (0.0, 0.0)),
        ((0.0, 1e-9), (0.0, 1e-9)),
        ((1e-6, 1e6), (1e-3, 1e9)),
        ((1e-9, 1e9), (1e-9, 1e12)),
    ],
)
def test_flat_tiny_and_twelve_decades_wide_boxes(b, k):
    for model in ("paper", "sampled-data"):
        assert_right(wall(coupling__damping_ns_per_m=b, coupling__stiffness_n_per_m=k, stability__model=model))


# Catalogue


@pytest.mark.parametrize("name", first([entry.name for entry in avc.catalogue() if entry.name.startswith("hard/")], 2))
def test_every_hard_problem_of_the_catalogue(name):
    problem = avc.load_problem(name)
    frequency = problem.frequencies_hz()
    rows = np.unique(np.linspace(0, len(frequency) - 1, 8).round().astype(int))
    values = tuple(float(frequency[row]) for row in rows)
    assert_right(problem.changed(frequency=type(problem.frequency)(values_hz=values)))
