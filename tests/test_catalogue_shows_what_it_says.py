"""Each file of the catalogue has the property for which it is there."""

import itertools
import math

import mpmath
import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.paper.loop import loop_at

LADDER = ["ve2", "ve3", "ve4", "ve5", "ve6", "ve7"]
PLAIN = {"figure5", "soft", "damper", "spring", "damped", *LADDER}
HARD = {
    "rigid",
    "near-rigid",
    "stiffer-target",
    "free-space",
    "infeasible-box",
    "resonance",
    "case-boundary",
    "long-delay",
    "near-nyquist",
    "low-frequency",
    "massless",
    "undamped-device",
    "wide-box",
    "pinned-box",
}


def loop_of(name):
    problem = avc.load_problem(name)
    return problem, loop_at(problem, problem.frequencies_hz())


def sign_changes(values):
    return int(np.count_nonzero(np.diff(np.sign(values))))


def test_the_catalogue_is_whole():
    names = {entry.name for entry in avc.catalogue()}
    assert names >= PLAIN | {f"hard/{name}" for name in HARD}


@pytest.mark.parametrize("entry", avc.catalogue(), ids=lambda entry: entry.name)
def test_every_entry_loads_and_says_what_it_is(entry):
    problem = avc.load_problem(entry.name)
    assert problem == avc.load_problem(entry.path)
    assert problem.name == entry.name
    assert avc.catalogue_path(entry.name) == entry.path
    assert problem.title == entry.title != ""
    assert problem.source == entry.source
    assert "assumed" in problem.source
    assert problem.source.startswith("Hard case: ") == entry.name.startswith("hard/")
    frequency = problem.frequencies_hz()
    assert np.all(np.diff(frequency) > 0)
    assert np.all(frequency * problem.device.sample_time_s < 0.5)


def test_figure5_is_the_wall_of_the_paper():
    wall = avc.load_problem("figure5").environment
    assert (wall.damping_ns_per_m, wall.stiffness_n_per_m) == (10.0, 1e5)
    assert avc.load_problem("damped").environment == wall
    assert avc.load_problem("ve7").environment == wall


def test_the_reference_file_shows_the_defaults():
    shown = avc.load_problem("figure5")
    bare = avc.Problem(device=shown.device, environment=shown.environment, boundaries=shown.boundaries)
    assert bare == shown.model_copy(update={"name": "", "title": "", "source": ""})


def test_the_ladder_rises_and_crosses_what_a_hand_holds():
    walls = [avc.load_problem(name) for name in LADDER]
    stiffness = [wall.environment.stiffness_n_per_m for wall in walls]
    assert all(1.2 < upper / lower < 5 for lower, upper in itertools.pairwise(stiffness))
    # Without delay a hand with damping b_h holds about 2 (b_d + b_h)/T.
    lowest, highest = (
        2 * (walls[0].device.damping_ns_per_m + damping) / walls[0].device.sample_time_s
        for damping in walls[0].hands.damping_ns_per_m
    )
    assert stiffness[1] < lowest < stiffness[2] < highest < stiffness[3]


def test_plain_cases():
    assert avc.load_problem("damper").environment.stiffness_n_per_m == 0
    assert avc.load_problem("spring").environment.damping_ns_per_m == 0
    assert avc.load_problem("damped").coupling.contact_damping_ns_per_m == (0, 150)
    _, soft = loop_of("soft")
    assert soft.without_coupling.real.min() > 0


def test_rigid_and_near_rigid():
    _, rigid = loop_of("hard/rigid")
    assert np.all(rigid.desired_gap == 0)
    _, near = loop_of("hard/near-rigid")
    gap = np.abs(near.desired_gap / near.environment)
    assert np.all((gap > 0.9e-12) & (gap < 1.1e-12))


def test_stiffer_target():
    _, loop = loop_of("hard/stiffer-target")
    np.testing.assert_allclose(loop.desired, 2 * loop.environment, rtol=1e-14)


def test_free_space():
    _, loop = loop_of("hard/free-space")
    assert np.all(loop.environment == 0)
    assert np.all(loop.target == loop.device)


def test_the_infeasible_box_holds_no_passive_gain():
    problem, loop = loop_of("hard/infeasible-box")
    damping, stiffness = problem.coupling.damping_ns_per_m, problem.coupling.stiffness_n_per_m
    best = max(loop.perceived(b, k).real.max() for b in np.linspace(*damping, 11) for k in np.geomspace(*stiffness, 21))
    assert best < -10


def test_resonance():
    _, loop = loop_of("hard/resonance")
    assert sign_changes(loop.target.imag) == 1
    smallest = np.abs(loop.target).min()
    assert smallest < 1e-3
    assert np.abs(loop.device)[np.abs(loop.target).argmin()] > 1e4 * smallest


def test_the_case_boundary_is_met_from_both_sides_to_rounding():
    problem, loop = loop_of("hard/case-boundary")
    with mpmath.workdps(50):
        period, damping = mpmath.mpf(problem.device.sample_time_s), problem.device.damping_ns_per_m
        upper, lower = problem.boundaries.upper, problem.boundaries.lower
        desired_b = (mpmath.mpf(upper.damping_ns_per_m) + lower.damping_ns_per_m) / 2
        desired_k = (mpmath.mpf(upper.stiffness_n_per_m) + lower.stiffness_n_per_m) / 2
        real = [
            damping + mpmath.cos(mpmath.pi * f * period) ** 2 * (desired_b - desired_k * period / 2)
            for f in problem.frequencies_hz()
        ]
    assert min(real) < -1e-6
    assert max(real) > 1e-6
    assert sum(-1e-15 < value < -3e-16 for value in real) == 2
    assert sum(3e-16 < value < 1e-15 for value in real) == 2
    assert sum(abs(value) < 1e-20 for value in real) == 1
    np.testing.assert_allclose(loop.target.real, np.array(real, dtype=float), atol=5e-15)


def test_long_delay():
    problem, loop = loop_of("hard/long-delay")
    assert problem.device.delay_samples == 20
    assert sign_changes(loop.target.real) > 5


def test_ends_of_the_frequency_axis():
    near_nyquist = avc.load_problem("hard/near-nyquist")
    nyquist = 0.5 / near_nyquist.device.sample_time_s
    assert math.isclose(near_nyquist.frequencies_hz()[-1], 0.999 * nyquist)
    low = avc.load_problem("hard/low-frequency")
    assert (low.frequencies_hz()[0], low.device.sample_time_s) == (0.01, 1e-4)


def test_devices_and_boxes_at_their_limits():
    assert avc.load_problem("hard/massless").device.mass_kg == 0
    assert avc.load_problem("hard/undamped-device").device.damping_ns_per_m == 0
    for interval in ("damping_ns_per_m", "stiffness_n_per_m"):
        lowest, highest = getattr(avc.load_problem("hard/wide-box").coupling, interval)
        assert math.isclose(highest / lowest, 1e12)
        lowest, highest = getattr(avc.load_problem("hard/pinned-box").coupling, interval)
        assert lowest == highest > 0
