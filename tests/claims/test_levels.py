"""Certificates: each level claims what it says, no more, and rows without gains fail."""

import dataclasses
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from schedule_problems import changed, figure5

from avc_casadi import load_problem, parse_problem
from avc_casadi.claims.certify import certify
from avc_casadi.claims.hands import scope_slack
from avc_casadi.claims.llewellyn import llewellyn_margin
from avc_casadi.claims.worst_frequency import worst_margin
from avc_casadi.design.methods import solve
from avc_casadi.design.static import static_coupling
from avc_casadi.loops.wall import SampledLoop, frozen_law, linear_stability
from avc_casadi.model.gains import Status
from avc_casadi.model.hands import hand_corners, hand_set
from avc_casadi.model.problem_ranges import least_damped
from avc_casadi.paper.equations import loop_at
from avc_casadi.paper.rows import gain_schedule


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


@pytest.mark.parametrize(("share", "passive"), [(0.5, True), (0.99, True), (1.01, False), (3.0, False)])
def test_a_damper_that_stores_nothing_is_passive_up_to_the_damping_of_the_device(share, passive):
    """By Colgate and Schenkel b_d > b + K T/2: with no stiffness at rest, K = 0, nothing but the damper counts."""
    environment = {"damping_ns_per_m": share, "stiffness_n_per_m": 0.0}
    case = changed(problem(b_d=1.0, rows=1), environment=environment)
    result = certify(case, table(case, 1e9, 0.0)).levels["L3"]
    assert result.passed == passive
    assert result.margin_ns_per_m == pytest.approx(1 - share, rel=1e-6)


def test_the_papers_criterion_passes_and_the_loop_diverges():
    case = problem(b_d=1.0)
    levels = certify(case, table(case, 1.1, 9300.0)).levels
    assert [levels[level].passed for level in ("L0", "L1", "L2", "L3", "L4")] == [True, True, True, False, True]
    assert levels["L3"].frequency_hz == 500.0
    assert levels["L5"].detail.released_spectral_radius == pytest.approx(1.0114, abs=1e-4)
    assert not levels["L5"].detail.released_passed


@pytest.mark.slow
@settings(max_examples=30)
@given(st.floats(0.1, 20), st.floats(0, 30), st.floats(0, 4e4), st.sampled_from([0.0, 3.0]), st.sampled_from([0, 1, 3]))
def test_levels_imply_each_other_where_they_must(b_d, b, k, contact, delay):
    case = problem(b_d, delay, model="sampled-data", band_factor=2.0)
    levels = certify(case, table(case, b, k, contact), draws=2).levels
    if levels["L3"].passed:  # all frequencies: then every band and every single one, and any hand
        assert levels["L1"].passed
        assert levels["L5"].passed
        assert levels["L5"].detail.released_spectral_radius <= 1 + 1e-9
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
    hand = result.detail.worst_hand
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
            shifted.device, frozen_law(shifted, 20.0, k), hand_corners(shifted.hands)
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
        return float(linear_stability(case.device, frozen_law(case, 0.0, k), hands).radius.max())

    low, high = 1e2, 1e5
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if radius(middle) < 1 else (low, middle)
    for share, sign in ((0.99, -1), (1.01, 1)):
        level = certify(case, table(case, 0.0, share * low)).levels["L5"]
        assert 0 < sign * (level.detail.spectral_radius - 1) < 1e-3
        assert level.passed == (sign < 0)


def decades(low, high):
    return st.floats(low, high).map(lambda x: float(10**x))


gain = st.one_of(
    st.sampled_from([0.0, np.inf, -np.inf, np.nan, 5e-324, 1e308, -1e308]),
    decades(-6, 6),
    decades(-300, 300),
    decades(-3, 6).map(lambda x: -x),
)


@pytest.mark.slow
@settings(max_examples=60)
@given(
    mass=st.one_of(st.just(0.0), decades(-4, 2)),
    b_d=st.one_of(st.just(0.0), decades(-4, 4)),
    sample_time=decades(-5, -1),
    delay=st.sampled_from([0, 1, 2, 20]),
    wall=st.tuples(st.one_of(st.just(0.0), decades(-6, 6)), st.one_of(st.just(0.0), decades(-6, 9))),
    model=st.sampled_from(["paper", "sampled-data"]),
    rows=st.lists(st.tuples(gain, gain, st.one_of(st.just(0.0), decades(-3, 4))), min_size=1, max_size=5),
)
def test_every_table_gets_a_certificate(mass, b_d, sample_time, delay, wall, model, rows):
    n = len(rows)
    values = ", ".join(repr(0.45 / sample_time * (row + 1) / n) for row in range(n))
    problem = parse_problem(
        f"[device]\nmass_kg={mass}\ndamping_ns_per_m={b_d}\nsample_time_s={sample_time}\ndelay_samples={delay}\n"
        f"[environment]\ndamping_ns_per_m={wall[0]}\nstiffness_n_per_m={wall[1]}\n"
        f"[stability]\nmodel='{model}'\n[frequency]\nvalues_hz=[{values}]\n"
    )
    b, k, contact = np.array(rows).T
    one = np.ones(n)
    table = dataclasses.replace(
        gain_schedule(problem, "file", (one, one, 0 * one), (Status.SOLVED,) * n),
        requested_damping_ns_per_m=b,
        requested_stiffness_n_per_m=k,
        contact_damping_ns_per_m=contact,
    )
    certificate = certify(problem, table, requested=True, draws=2)
    json.dumps(certificate.document(), allow_nan=False)
    absent = np.isnan(b) | np.isnan(k)
    for level in certificate.levels.values():
        assert not level.row_passed[absent].any()
        assert not (level.row_passed & np.isnan(level.row_margin_ns_per_m) & (level.level != "L5")).any()
    whole = certificate.levels["L3"].row_passed
    with np.errstate(invalid="ignore"):
        negative = certificate.dc_stiffness_n_per_m < 0
    assert not (whole & negative).any()


ROWS = np.array([1.0, 20.0, 100.0, 400.0])
GAINS = np.array([0.1, 5.0, 40.0, 200.0]), np.array([500.0, 2e3, 8e3, 5e4]), np.array([0.0, 5.0, 0.0, 20.0])


def damping_margin_problem(b_d, margin, delay=0):
    return parse_problem(
        f"[device]\nmass_kg=0.1\ndamping_ns_per_m={b_d}\ndelay_samples={delay}\n"
        "[environment]\ndamping_ns_per_m=10.0\nstiffness_n_per_m=1e5\n"
        f'[stability]\nmodel="sampled-data"\nscope="hands"\nmargin_ns_per_m={margin}\n'
        '[coupling]\nstructure="series"\ndamping_ns_per_m=[0.0, 1e3]\nstiffness_n_per_m=[0.0, 1e6]\n'
        "[frequency]\nstart_hz=2.0\nstop_hz=200.0\npoints=5\n"
    )


@pytest.mark.parametrize("delay", [0, 2])
@pytest.mark.parametrize("margin", [0.5, 2.0])
def test_scope_of_frozen_rows(margin, delay):
    robbed = scope_slack(damping_margin_problem(2.0 - margin, 0.0, delay), ROWS, *GAINS)
    asked = scope_slack(damping_margin_problem(2.0, margin, delay), ROWS, *GAINS)
    np.testing.assert_allclose(asked.slack, robbed.slack, rtol=0, atol=1e-12)
    free = scope_slack(damping_margin_problem(2.0, 0.0, delay), ROWS, *GAINS)
    assert (free.slack - asked.slack > 1e-5).all()


@pytest.mark.slow
def test_gains_that_keep_it():
    margin, case = 1.5, damping_margin_problem(2.0, 1.5)
    gains = solve(case, "schedule")
    assert gains.usable.all()
    found = gains.damping_ns_per_m, gains.stiffness_n_per_m, gains.contact_damping_ns_per_m
    robbed = damping_margin_problem(2.0 - margin, 0.0)
    radius = linear_stability(robbed.device, frozen_law(robbed, *found), hand_set(robbed.hands)).radius
    assert (radius.max(axis=1) < 1).all()
    # Gains that need not keep it do not: the margin decides here.
    bold = solve(damping_margin_problem(2.0, 0.0), "schedule")
    radius = linear_stability(
        robbed.device,
        frozen_law(robbed, bold.damping_ns_per_m, bold.stiffness_n_per_m, bold.contact_damping_ns_per_m),
        hand_set(robbed.hands),
    ).radius
    assert (radius.max(axis=1) > 1).any()


DAMPED = {"structure": "damped", "contact_damping_ns_per_m": (0.0, 60.0)}
RANGE = {"damping_ns_per_m": (0.8, 2.5), "mass_kg": (0.07, 0.13)}


def least_real_part(problem, gains, damping):
    """Smallest Re Z_h with another damping of the device."""
    device = changed(problem, device={"damping_ns_per_m": damping, "range": type(problem.device.range)()})
    rows = gains.damping_ns_per_m, gains.stiffness_n_per_m, gains.contact_damping_ns_per_m
    return np.nanmin(np.where(gains.usable, loop_at(device, gains.frequency_hz).perceived(*rows).real, np.nan))


def ranged(**tables):
    problem = figure5(points=20, **tables)
    return problem.changed(device={"range": RANGE})


@pytest.mark.parametrize("coupling", [{}, DAMPED], ids=["series", "damped"])
@pytest.mark.parametrize(
    ("method", "require"), [("direct", "none"), ("exact", "none"), ("schedule", "none"), ("schedule", "jnd")]
)
def test_every_device_of_the_range_keeps_the_margin(method, require, coupling):
    problem = ranged(coupling=coupling, realism={"require": require, "jnd": 0.9})
    gains = solve(problem, method)
    assert gains.usable.any()
    assert least_real_part(problem, gains, 0.8) >= -1e-12
    if method != "schedule":
        # Nothing more than that is asked: without the range the least damped device would not keep it.
        assert least_real_part(problem, solve(figure5(points=20, coupling=coupling), method), 0.8) < -0.1


def test_closed_form_injects_what_the_range_lacks():
    problem = ranged()
    known, unknown = solve(figure5(points=20), "closed-form"), solve(problem, "closed-form")
    pushed = (known.real_part < 1e-9) & known.usable & unknown.usable
    assert pushed.any()
    np.testing.assert_allclose(unknown.real_part[pushed], 1.2, atol=1e-9)


def test_the_damping_of_the_hand_counts_where_it_is_credited():
    problem = ranged(schedule={"hand_damping_ns_per_m": 1.0})
    assert -1.0 - 1e-9 <= least_real_part(problem, solve(problem, "schedule"), 0.8) < -0.5


@pytest.mark.slow
@pytest.mark.parametrize("coupling", [{}, DAMPED], ids=["series", "damped"])
def test_constant_gains_are_safe_with_every_device_of_the_range(coupling):
    problem, known = ranged(coupling=coupling), figure5(points=20, coupling=coupling)
    loop = SampledLoop.of(least_damped(problem))
    for condition, margin in (("llewellyn", llewellyn_margin), ("all", worst_margin)):
        values = []
        for case in (problem, known):
            found = static_coupling(case, condition)
            gains = found.damping_ns_per_m, found.stiffness_n_per_m, found.contact_damping_ns_per_m
            judged = margin(loop, *gains)
            values.append(judged[0][0] if condition == "llewellyn" else judged.margin_ns_per_m[0])
        assert values[0] >= -1e-12
        assert values[1] < -0.1
