"""Certificates: each level claims what it says, no more, and rows without gains fail."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from avc_casadi import load_problem, parse_problem
from avc_casadi.claims.certify import certify
from avc_casadi.claims.scope import scope_slack
from avc_casadi.design.methods import solve
from avc_casadi.loops.wall import frozen_parts, linear_stability
from avc_casadi.model.hands import hand_corners, hand_set
from avc_casadi.model.schedule import Status
from avc_casadi.paper.rendered import gain_schedule


def problem(b_d=1.0, delay=0, rows=5, **stability):
    table = "".join(f"{key}={value!r}\n" for key, value in stability.items())
    return parse_problem(
        f"[device]\nmass_kg=0.1\ndamping_ns_per_m={b_d}\nsample_time_s=1e-3\ndelay_samples={delay}\n"
        "[environment]\ndamping_ns_per_m=10.0\nstiffness_n_per_m=1e5\n"
        f"[stability]\n{table}[frequency]\nstart_hz=1.0\nstop_hz=400.0\npoints={rows}\n"
    )


def table(case, b, k, contact=0.0, status=Status.SOLVED):
    n = len(case.frequencies_hz())
    gains = tuple(np.broadcast_to(np.asarray(value, dtype=float), (n,)) for value in (b, k, contact))
    return gain_schedule(case, "file", gains, (status,) * n if isinstance(status, Status) else status)


def test_closed_form_of_figure5_stands_on_the_edge_and_nowhere_else():
    case = load_problem("figure5")
    gains = solve(case, "closed-form")
    asked = certify(case, gains, requested=True).levels
    assert asked["L0"].passed
    assert abs(asked["L0"].margin_ns_per_m) <= asked["L0"].tolerance_ns_per_m < 1e-9
    for level, model in (("L2", "paper"), ("L3", "sampled-data")):
        assert not asked[level].passed
        assert asked[level].model == model
        assert asked[level].margin_ns_per_m < -10
    assert asked["L3"].frequency_hz == 500.0
    assert "at 500 Hz" in asked["L3"].claim
    built = certify(case, gains)
    assert built.rows_without_gains == np.count_nonzero(~gains.usable) > 0
    assert not built.levels["L0"].passed
    np.testing.assert_array_equal(built.levels["L0"].row_passed, gains.usable)


def test_the_papers_criterion_passes_and_the_loop_diverges():
    case = problem(b_d=1.0)
    levels = certify(case, table(case, 1.1, 9300.0)).levels
    assert [levels[level].passed for level in ("L0", "L1", "L2", "L3", "L4")] == [True, True, True, False, True]
    assert levels["L3"].frequency_hz == 500.0
    assert levels["L5"].detail["released_spectral_radius"] == pytest.approx(1.0114, abs=1e-4)
    assert not levels["L5"].detail["released_pass"]


@pytest.mark.thorough
@settings(max_examples=30)
@given(st.floats(0.1, 20), st.floats(0, 30), st.floats(0, 4e4), st.sampled_from([0.0, 3.0]), st.sampled_from([0, 1, 3]))
def test_levels_imply_each_other_where_they_must(b_d, b, k, contact, delay):
    case = problem(b_d, delay, model="sampled-data", band_factor=2.0)
    levels = certify(case, table(case, b, k, contact), draws=2).levels
    if levels["L3"].passed:  # all frequencies: then every band and every single one, and any hand
        assert levels["L1"].passed
        assert levels["L5"].passed
        assert levels["L5"].detail["released_spectral_radius"] <= 1 + 1e-9
    if levels["L1"].passed:
        assert levels["L0"].passed
    if levels["L4"].passed and k > 0:  # any passive environment: then this one
        assert levels["L3"].passed
    assert levels["L0"].margin_ns_per_m >= levels["L1"].margin_ns_per_m - 1e-9
    assert levels["L1"].margin_ns_per_m >= levels["L3"].margin_ns_per_m - 1e-9


@pytest.mark.parametrize("k", [5e3, 9e4])
def test_damping_reserve_is_the_edge_of_stability(k):
    case = problem(b_d=1.0, rows=1)
    result = certify(case, table(case, 20.0, k)).levels["L5"]
    hand = result.detail["worst_hand"]
    span = "".join(f"{key} = [{value}, {value}]\n" for key, value in hand.items())
    for offset, stable in ((1e-4, True), (-1e-4, False)):
        damping = 1.0 - result.margin_ns_per_m + offset
        shifted = parse_problem(
            f"[device]\nmass_kg=0.1\ndamping_ns_per_m={max(damping, 0.0)}\nsample_time_s=1e-3\n"
            f"[environment]\ndamping_ns_per_m=10.0\nstiffness_n_per_m=1e5\n[hands]\n{span}"
        )
        if damping < 0:  # the whole damping of the device can go, and some of the hand's
            continue
        radius = linear_stability(
            shifted.device, frozen_parts(shifted, 20.0, k), 0.0, hand_corners(shifted.hands)
        ).radius.max()
        assert (radius < 1) == stable
    assert result.passed == (result.margin_ns_per_m > 0)


def test_scopes_say_what_the_levels_say():
    b, k = np.array([0.1, 1.0, 2.0, 50.0, 300.0]), np.array([500.0, 3e3, 9e3, 3e4, 1e5])
    for model in ("paper", "sampled-data"):
        base = problem(b_d=2.0, model=model)
        levels = certify(base, table(base, b, k)).levels
        for scope, level in (
            ("pointwise", "L0"),
            ("band", "L1"),
            ("all", "L2" if model == "paper" else "L3"),
            ("hands", "L5"),
        ):
            case = problem(b_d=2.0, model=model, scope=scope)
            slack = scope_slack(case, case.frequencies_hz(), b, k)
            np.testing.assert_array_equal(slack.met, levels[level].row_passed)
            if scope != "hands":
                np.testing.assert_array_equal(slack.slack, levels[level].row_margin_ns_per_m)


@pytest.mark.thorough
def test_device_known_to_a_range_is_judged_at_its_worst():
    case = problem(b_d=3.0, rows=3)
    lean = case.device.range.model_copy(update={"damping_ns_per_m": (1.0, 5.0), "mass_kg": (0.05, 0.2)})
    vague = case.changed(device={"range": lean})
    worst = problem(b_d=1.0, rows=3)
    exact, known = certify(worst, table(worst, 2.0, 5e3)), certify(vague, table(vague, 2.0, 5e3))
    for level in ("L0", "L1", "L2", "L3", "L4"):
        assert known.levels[level].margin_ns_per_m == exact.levels[level].margin_ns_per_m
    assert known.passive_limit_n_per_m == exact.passive_limit_n_per_m == 2 * 1.0 / 1e-3
    radii = []
    for mass in (0.05, 0.2):
        for damping in (1.0, 5.0):
            corner = case.changed(device={"mass_kg": mass, "damping_ns_per_m": damping})
            radii.append(certify(corner, table(corner, 2.0, 5e3)).levels["L5"].detail["spectral_radius"])
    assert known.levels["L5"].detail["spectral_radius"] == max(radii)


@pytest.mark.parametrize(
    ("b_d", "b", "k", "fault"),
    [(20.0, 5.0, -200.0, "negative DC stiffness"), (2000.0, 300.0, -2e5, "pole outside the unit circle")],
)
def test_a_real_part_that_is_positive_everywhere_does_not_make_a_rendering_passive(b_d, b, k, fault):
    case = problem(b_d=b_d, rows=2)
    levels = certify(case, table(case, b, k), draws=0).levels
    for level in ("L2", "L3"):
        assert levels[level].margin_ns_per_m > 0
        assert not levels[level].passed
        assert fault in levels[level].claim
    # L0 and L1 speak of Re Z_h alone.
    assert levels["L0"].passed
    assert levels["L1"].passed
    for scope in ("pointwise", "band", "all"):
        asked = problem(b_d=b_d, rows=2, scope=scope)
        assert not scope_slack(asked, asked.frequencies_hz(), b, k).met.any()


def test_a_loop_that_grows_slowly_is_not_stable():
    """Growth of 2 % a second is instability, decay of 2 % a second is not: k at both sides of a radius of 1."""
    case = problem(b_d=1.0, rows=1)
    hands = hand_set(case.hands)

    def radius(k):
        return float(linear_stability(case.device, frozen_parts(case, 0.0, k), 0.0, hands).radius.max())

    low, high = 1e2, 1e5
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if radius(middle) < 1 else (low, middle)
    for share, sign in ((0.99, -1), (1.01, 1)):
        level = certify(case, table(case, 0.0, share * low)).levels["L5"]
        assert 0 < sign * (level.detail["spectral_radius"] - 1) < 1e-3
        assert level.passed == (sign < 0)


@pytest.mark.thorough
def test_the_worst_hand_and_device_of_l5_have_the_radius_stated():
    case = problem(b_d=3.0, rows=2).changed(
        device={"range": {"damping_ns_per_m": (1.0, 5.0), "mass_kg": (0.05, 0.2)}},
        hands={"mass_kg": (0.02, 0.3), "damping_ns_per_m": (1.0, 20.0), "stiffness_n_per_m": (100.0, 900.0)},
    )
    for b, k in ((2.0, 5e3), (0.0, 2e4), (40.0, 8e4)):
        detail = certify(case, table(case, b, k)).levels["L5"].detail
        alone = case.changed(
            device={"range": {}, **detail["worst_device"]},
            hands={key: (value, value) for key, value in detail["worst_hand"].items()},
        )
        radius = linear_stability(alone.device, frozen_parts(alone, b, k), 0.0, hand_corners(alone.hands)).radius.max()
        assert radius == pytest.approx(detail["spectral_radius"], rel=1e-12)
