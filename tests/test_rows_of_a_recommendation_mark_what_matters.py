"""Rows of a recommendation, from documents written by hand: what is marked, what is told, and what stays quiet."""

import copy

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.present.pages.recommendation import recommendation_page, recommendation_rows
from avc_casadi.present.pages.stiffest import stiffest_page
from avc_casadi.present.terminal import Mark, Page
from avc_casadi.recommendation.preconditions import not_used

PROBLEM = avc.parse_problem(
    """
    [device]
    mass_kg = 0.12
    damping_ns_per_m = 0.8
    max_force_n = 8.0
    [environment]
    stiffness_n_per_m = 3000.0
    damping_ns_per_m = 0.0
    """,
    name="wall",
)
COUNTS = {"hands": 100, "at_rest": 100, "at_rest_without_friction": 100, "quiet": 100}
MARGINS = {"gain": 5.0, "phase_deg": 40.0, "delay_samples": 2.0}
STIFFEST = COUNTS | {
    "plain_wall_n_per_m": 0.0,
    "confirmed": None,
    "by": "static",
    "stiffest_wall_n_per_m": 3000.0,
    "at_force_limit": 0,
}
# All that rows are made of, of a wall that is rendered as wanted.
DOCUMENT = {
    "deployable": True,
    "reason": "",
    "assumed": [],
    "not_used": [],
    "coupling": {
        "table": {
            "frequency_hz": [1.0],
            "damping_ns_per_m": [0.0],
            "stiffness_n_per_m": [1e8],
            "contact_damping_ns_per_m": [5.0],
        },
        "runtime": {"state_feedback": None, "observer_mass_kg": None},
        "constant": True,
        "max_force_n": 8.0,
        "wall": {"stiffness_n_per_m": 3000.0},
    },
    "felt": {
        "stiffness_n_per_m": 3000.0,
        "stiffness_at_handle_n_per_m": 3000.0,
        "share_of_wall": 1.0,
        "complex_error": {"1": 0.01, "10": 0.05, "50": 0.1},
        "stiffness_in_motion_n_per_m": {"1": 3000.0, "10": 3000.0, "50": 3000.0},
        "shaken": {"amplitude_m": 6e-4},
        "edge_m": {"0.1": 0.0, "0.4": 0.0},
        "edge_force_n": 0.1,
        "rebound": {"0.1": 0.9},
        "rest_error_m": None,
        "encoder_step_n": {"spring": 0.0, "damping": 0.0},
        "ripple": {"force_n": {"0.02": 4e-4}, "hands": 16, "quiet": 16},
    },
    "trial": COUNTS
    | {"at_force_limit": 0, "tap_force_n": 4.0, "tap_depth_m": 1e-3}
    | {"stiffness_n_per_m": {"nine_in_ten": [3000.0, 3000.0]}},
    "confirmed": None,
    "off_file": None,
    "beyond_file": [],
    "other_hands": {},
    "margins": {"released": MARGINS},
    "transient": {
        "released": {"settling_s": 0.1},
        "worst_hand": {"damping_ratio": 0.2, "frequency_hz": 10.0},
    },
    "rest": {"word": "proved"},
    "certificate": {"deployable": {"claims": []}},
    "with_friction_n_per_m": None,
    "what_would_help": [],
}


def changed(**tables):
    """The document with some keys of its tables changed."""
    document = copy.deepcopy(DOCUMENT)
    for name, value in tables.items():
        document[name] = document[name] | value if isinstance(value, dict) else value
    return document


def rows(document, problem=PROBLEM):
    return {row.label: row for row in recommendation_rows(document, problem)}


def test_a_wall_that_is_rendered_as_wanted_has_no_caution():
    found = rows(DOCUMENT)
    assert {row.mark for row in found.values()} == {Mark.PASS, Mark.NONE}
    assert {"Contact onset", "Rebound", "With friction"}.isdisjoint(found)


@pytest.mark.parametrize(("share", "at_1_hz", "lost"), [(1.0, 3000.0, False), (0.17, 69.0, True), (0.17, 310.0, False)])
def test_a_wall_that_is_lost_to_a_moving_hand_is_no_plain_pass(share, at_1_hz, lost):
    motion = {"1": at_1_hz, "10": 3000.0, "50": 3000.0}
    row = rows(changed(felt={"share_of_wall": share, "stiffness_in_motion_n_per_m": motion}))["Coupling"]
    assert row.mark is (Mark.CAUTION if lost else Mark.PASS)
    assert row.text.endswith("hardly anything of the wall is rendered to a moving hand") == lost


def test_a_speed_at_which_no_force_sets_in_is_told():
    assert rows(changed(felt={"edge_m": {"0.1": None, "0.4": 0.0}}))["Contact onset"].text == (
        "no force in the first 10.0 mm at 0.1 m/s, 0 m behind the face at 0.4 m/s"
    )
    # At its handle of 0.15 m 10 mm are 66.7 mrad, 0.1 m/s two thirds of a radian a second.
    wheel = PROBLEM.changed(device={"motion": "rotary", "handle_radius_m": 0.15})
    turned = changed(felt={"edge_m": {"0.666667": None, "2.66667": -0.016}, "edge_force_n": 0.015})
    assert rows(turned, wheel)["Contact onset"].text == (
        "no torque in the first 66.7 mrad at 0.667 rad/s, 16.0 mrad before the face at 2.67 rad/s"
    )


@pytest.mark.parametrize(("quiet", "marked"), [(16, False), (15, False), (9, True)])
def test_a_vibration_that_moving_hands_feel_is_marked_and_stays_on_a_full_page(quiet, marked):
    document = changed(felt={"ripple": {"force_n": {"0.02": 4e-4}, "hands": 16, "quiet": quiet}})
    noisy = PROBLEM.changed(device={"position_noise_rms_m": 5e-5})
    row = rows(document, noisy)["Force"]
    assert row.mark is (Mark.CAUTION if marked else Mark.NONE)
    assert row.text.endswith("vibration with the noise noticed by 7 of 16") == marked
    assert ("noticed by 7 of 16" in recommendation_page(document, noisy, Page())) == marked


@pytest.mark.parametrize(
    ("errors", "share", "marked"),
    [
        ({"1": 0.13, "10": 11.9}, 1.0, True),
        ({"1": 0.3, "10": 0.1}, 1.0, True),
        ({"1": 0.1, "10": 0.19, "50": 1.4}, 1.0, False),
        ({"1": 0.3, "10": 0.39}, 0.6, False),  # no more than a press tells
    ],
)
def test_an_error_in_the_motion_of_hands_is_marked_at_any_of_its_frequencies(errors, share, marked):
    row = rows(changed(felt={"complex_error": errors, "share_of_wall": share}))["Impedance error"]
    assert row.mark is (Mark.CAUTION if marked else Mark.NONE)


@pytest.mark.parametrize(("mass_kg", "near"), [(0.12, ""), (0.76, "10 Hz"), (0.5, ""), (0.0304, "50 Hz")])
def test_errors_near_the_resonance_of_device_and_wall_are_told_as_such(mass_kg, near):
    """3000 N/m on 0.76 kg resonate at 10 Hz, on 0.0304 kg at 50 Hz; on 0.5 kg at 12.3 Hz, where a third is left."""
    problem = PROBLEM.changed(device={"mass_kg": mass_kg})
    text = rows(DOCUMENT, problem)["Impedance error"].text
    assert text.endswith(f"; {near} near the resonance of device and wall, where |Z| is small" if near else "600 um")


def test_a_unit_is_told_again_where_its_prefix_changes():
    motion = {"1": 848.0, "10": 1190.0, "50": 9.0}
    felt = {"stiffness_n_per_m": 1580.0, "share_of_wall": 0.79, "stiffness_in_motion_n_per_m": motion}
    document = changed(felt=felt | {"stiffness_at_handle_n_per_m": 1570.0})
    document["trial"]["stiffness_n_per_m"]["nine_in_ten"] = [1580.0, 1580.0]
    assert rows(document)["Rendered"].text == (
        "1.58 kN/m static (79 % of the wall), 848 N/m at 1 Hz, 1.19 kN/m at 10 Hz, 1.57 at the handle"
    )


def tried(key, value, free, *, asked=False, at_rest=None):
    counts = {"hands": 60, "at_rest_without_friction": free, "at_rest": at_rest, "plain": None}
    return {"key": key, "value": value, "asked": asked} | counts


@pytest.mark.parametrize(
    ("free", "mark", "without"), [(57, Mark.CAUTION, ", 57 without friction"), (60, Mark.PASS, "")]
)
def test_hands_of_the_declared_grip_that_may_lean_on_friction_all_count(free, mark, without):
    found = rows(
        changed(
            beyond_file=[
                tried("mass_share", 0.2, 60),
                tried("held", "stylus", free, asked=True, at_rest=60 if free < 60 else None),
            ]
        )
    )
    assert found["Unmodelled"].text == "60 of 60 settle with 20 % less mass"
    assert found["Unmodelled"].mark is Mark.PASS
    assert found["Declared grip"].text == f"60 of 60 settle with hands on a stylus{without}"
    assert found["Declared grip"].mark is mark


def test_an_unmodelled_effect_that_nobody_asked_for_counts_without_friction():
    effects = [tried("mass_share", 0.2, 58, at_rest=60), tried("mode_hz", 400.0, 60)]
    row = rows(changed(beyond_file=effects))["Unmodelled"]
    assert row.text == "of 60: 58 with 20 % less mass, 60 with a 400 Hz mode"
    assert row.mark is Mark.CAUTION


def test_what_is_asked_of_other_methods_is_told_and_weakens_no_verdict():
    bounds = {side: {"damping_ns_per_m": 0.0, "stiffness_n_per_m": 500.0} for side in ("upper", "lower")}
    tables = {"stability": {"scope": "all"}, "realism": {"require": "jnd"}, "schedule": {"slope_limit": 1.0}}
    asked = PROBLEM.changed(**tables, boundaries=bounds, frequency={"points": 20})
    names = ("boundaries", "stability", "realism", "schedule", "frequency")
    unused = not_used(asked)
    assert unused == tuple(f"{table} (asked of avc solve)" for table in names)
    found = rows(changed(not_used=list(unused)))
    assert found["Coupling"].mark is Mark.PASS
    assert found["Not used"].text == f"{', '.join(names)}: asked of avc solve, not of avc recommend"


def test_tables_that_state_the_defaults_ask_for_nothing():
    wall = {"damping_ns_per_m": 0.0, "stiffness_n_per_m": 3000.0}
    plain = PROBLEM.changed(stability={"scope": "pointwise"}, boundaries={"upper": wall, "lower": wall})
    assert not_used(plain.changed(schedule={"slope_penalty": 1e-3})) == ()
    assert "Not used" not in rows(DOCUMENT)


@pytest.mark.parametrize(
    ("tables", "next_one"),
    [
        ({"deployable": True}, "avc export coupling.json --c DIR"),
        ({"deployable": False}, "avc recommend P --stiffest"),
        ({"deployable": False, "assumed": ["what may be a slip: device.mass_kg is 120"]}, "avc check P"),
        ({"deployable": False, "reason": "nothing of the wall is rendered: too weak"}, "avc check P"),
    ],
)
def test_what_is_next_is_nothing_that_would_be_refused(tables, next_one):
    text = recommendation_page(changed(**tables), PROBLEM, Page(), "P", "coupling.json")
    assert text.splitlines()[-1].strip().startswith(f"next: {next_one}    ")


@pytest.mark.parametrize("short_m", [1.2e-3, 0.8e-3])
@pytest.mark.parametrize("leaning", [3400.0, 3200.0])
def test_what_friction_does_and_what_it_would_help_are_rows_of_their_own(short_m, leaning):
    found = rows(changed(felt={"rest_error_m": short_m}, with_friction_n_per_m=leaning))
    assert ("Dry friction" in found) == (short_m > 1e-3)
    assert ("With friction" in found) == (leaning > 3300.0)
    assert found.get("Dry friction", found["Coupling"]).mark is (Mark.CAUTION if short_m > 1e-3 else Mark.PASS)


def test_half_a_sample_time_keeps_its_symbol():
    helps = [{"change": change, "stiffest_wall_n_per_m": 4000.0} for change in ("half the sample time", "no delay")]
    for one in helps:
        one |= {"at_rest": 100, "at_rest_without_friction": 100, "hands": 100}
    text = stiffest_page(STIFFEST | {"what_would_help": helps}, PROBLEM, Page(), "P")
    labels = [line[4:16].strip() for line in text.splitlines()]
    assert {"Half T", "No delay"} <= set(labels)


@pytest.mark.parametrize("limited", [0, 1, 100])
def test_presses_that_end_at_the_force_limit_stand_beside_the_stiffest_wall(limited):
    text = stiffest_page(STIFFEST | {"what_would_help": [], "at_force_limit": limited}, PROBLEM, Page(), "P")
    assert (f"! Force          {limited} of 100 presses end at the 8.00 N limit" in text) == bool(limited)


def test_a_coupling_that_is_refused_says_why():
    row = rows(changed(deployable=False, reason="11 of 60 hands do not settle with held = fingertip"))["Coupling"]
    assert row.mark is Mark.FAIL
    assert row.text.endswith("NOT deployable: 11 of 60 hands do not settle with held = fingertip")
    failed = {"deployable": {"claims": [{"pass": False, "sentence": "unstable with a hand"}]}}
    unstable = rows(changed(deployable=False, reason="mine; unstable with a hand", certificate=failed))
    assert unstable["Coupling"].text.endswith("NOT deployable")
    assert unstable["Stability"].text == "unstable with a hand"
    nothing = rows(changed(deployable=False, reason="nothing of the wall is rendered: too weak"))
    assert nothing["Coupling"].text.endswith("NOT deployable")
    assert nothing["Rendered"].text == "nothing of the wall is rendered: too weak"


@pytest.mark.parametrize(
    ("strength", "mark"), [(1.0, Mark.NONE), (0.9, Mark.NONE), (0.7, Mark.CAUTION), (2.2, Mark.CAUTION)]
)
def test_a_damper_is_told_in_its_own_unit_of_a_wall_that_pushes_half_of_the_time(strength, mark):
    """Of max(0, b v) under a sine the part at its frequency is b v/2: |F/x| is pi f b."""
    damper = PROBLEM.changed(environment={"stiffness_n_per_m": 0.0, "damping_ns_per_m": 8.0})
    time = (np.arange(4000) + 0.5) / 4000
    wave = np.exp(-2j * np.pi * time)
    motion = {}
    for hz in (1.0, 10.0):
        force = np.maximum(0.0, strength * 8.0 * 2 * np.pi * hz * np.cos(2 * np.pi * time))
        motion[f"{hz:g}"] = float(abs((force @ wave) / (np.sin(2 * np.pi * time) @ wave)))
    row = rows(changed(felt={"stiffness_in_motion_n_per_m": motion, "stiffness_n_per_m": None}), damper)["Rendered"]
    told = f"{8 * strength:.{2 if strength < 1.25 else 1}f} N.s/m"
    assert row.text.startswith(f"a damper of {told} at 1 Hz, {told} at 10 Hz, which never pulls: impedance error")
    assert row.mark is mark


@pytest.mark.parametrize(
    ("share", "at_10_hz", "damping", "marked"),
    [
        (1.0, 3500.0, 0.0, False),
        (1.0, 3700.0, 0.0, True),
        (1.0, 3700.0, 50.0, False),  # |3000 + j 3142| N/m are wanted at 10 Hz
        (1.08, 3000.0, 0.0, False),
        (1.13, 3000.0, 0.0, True),
    ],
)
def test_what_is_stiffer_than_the_wall_is_marked(share, at_10_hz, damping, marked):
    motion = {"1": 3000.0, "10": at_10_hz, "50": 9e3}
    problem = PROBLEM.changed(environment={"stiffness_n_per_m": 3000.0, "damping_ns_per_m": damping})
    row = rows(changed(felt={"share_of_wall": share, "stiffness_in_motion_n_per_m": motion}), problem)["Rendered"]
    assert row.mark is (Mark.CAUTION if marked else Mark.NONE)
    assert row.text.endswith("above the wall in motion, damping included") == (marked and share == 1)


@pytest.mark.parametrize(("quiet", "mark"), [(100, Mark.PASS), (91, Mark.PASS), (58, Mark.CAUTION)])
def test_hands_that_settle_with_a_vibration_that_they_feel_are_no_plain_pass(quiet, mark):
    assert rows(changed(trial={"quiet": quiet}))["Simulated"].mark is mark
    assert rows(changed(trial={"quiet": quiet, "at_rest": 99}))["Simulated"].mark is Mark.FAIL
