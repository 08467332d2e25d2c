"""What a file declares is judged: contacts up to rigid, every delay, every steady step; by loops written out."""

from __future__ import annotations

import itertools
import math
from fractions import Fraction

import lifted_engine
import lifted_teleoperator
import numpy as np
import pytest
from quick import first
from teleoperator_simulator import run

import avc_casadi as avc
from avc_casadi.design.virtual_tool import FollowerSearch, ToolSearch
from avc_casadi.loops.contacts import Swing
from avc_casadi.loops.engine import ToolLoops, clock_ranges
from avc_casadi.loops.follower import FollowerLoops, Link, Touch, link_clocks, round_trips
from avc_casadi.loops.loop import Body
from avc_casadi.model.ends import ToolGains
from avc_casadi.model.hands import Hand
from avc_casadi.model.plant import sampled_plant

RELEASED = (0.0, 0.0, 0.0)
END_STOP_N_PER_M = 1e8


def device(mass_kg, damping_ns_per_m, sample_time_s, delay=1):
    return (
        f"mass_kg = {mass_kg}\ndamping_ns_per_m = {damping_ns_per_m}\nsample_time_s = {sample_time_s}\n"
        f"delay_samples = {delay}\n"
    )


def measured_force(contact):
    """Return a pair that sends the measured force, 4 ms each way, with a damper of 2 N.s/m in its contact."""
    return avc.parse_problem(
        f"[device]\n{device(0.12, 0.8, 0.002)}[follower]\n{device(0.1, 1.0, 0.002)}delay_s = 0.004\n"
        f'architecture = "position-force"\nforce = "measured"\ncontact_stiffness_n_per_m = {contact}\n'
        "contact_damping_ns_per_m = 2.0\n"
    )


def grows(gains, contact_n_per_m, damper_ns_per_m=2.0, phase=0.5):
    """Return the growth a sample of that pair, released, by the loop written out."""
    ends = (0.12, 0.8, 0.002, 1), (0.1, 1.0, 0.002, 1), gains, 0.004, 0.004
    springs = np.atleast_1d(contact_n_per_m)
    contacts = springs, damper_ns_per_m * (springs > 0)
    how = {"hand": RELEASED, "contacts": contacts, "architecture": "measured", "phase": phase}
    return lifted_teleoperator.growth(*ends, **how)


@pytest.mark.parametrize(
    "contact",
    ["[0.0, 1e6]", *(pytest.param(far, marks=pytest.mark.slow) for far in ("[5e5, 1e6]", "1e6", "[0.0, inf]"))],
)
def test_a_contact_stiffer_than_m_over_t_squared_is_judged(contact):
    gains, stated = ToolGains(60.0, 1.5), measured_force(contact)
    assert grows((60.0, 1.5), 1e6)[0] == pytest.approx(1.00804, abs=1e-5)
    loops = FollowerLoops(stated)
    assert not loops.stable_over_ranges(gains)
    radius, case = loops.radius(gains)
    assert case.hand["mass_kg"] == 0.0
    assert radius >= 1.00804 - 1e-5
    worst = max(grows((60.0, 1.5), case.environment_n_per_m, phase=phase)[0] for phase in (0.0, 0.5))
    assert radius == pytest.approx(worst, abs=1e-6)


def test_a_stiff_contact_that_is_refuted_grows_in_a_plain_simulation():
    ends = (0.12, 0.8, 0.002, 1), (0.1, 1.0, 0.002, 1), (60.0, 1.5, 0.0), 6.0, 0.004, 0.004
    moved = run(*ends, contact=(1e6, 2.0), phase=0.5, force="measured", kick=1e-6)
    size = np.diff(moved[0]) ** 2
    growth = (size[-500:].sum() / size[-2000:-1500].sum()) ** (1 / 3000)
    # Aliased swings beat, so that the size of a window is not smooth.
    assert growth == pytest.approx(1.00804, abs=2e-4)


@pytest.mark.slow
def test_every_contact_of_a_band_is_refuted_and_the_limit_is_below_it():
    """The guide's follower, K 1 000 and B 5: each contact of 416 to 866 kN/m grows, by up to 1.0011 a sample."""
    stated = avc.parse_problem(
        f"[device]\n{device(0.12, 0.8, 0.001)}[follower]\n{device(0.3, 1.0, 0.001)}delay_s = 0.005\n"
        "contact_stiffness_n_per_m = [0.0, 1e7]\ncontact_damping_ns_per_m = 3.0\n"
    )
    band = np.linspace(416e3, 866e3, 40)
    ends = (0.12, 0.8, 0.001, 1), (0.3, 1.0, 0.001, 1)
    how = {"hand": RELEASED, "architecture": "position-position", "phase": 0.5}
    values = lifted_teleoperator.growth(*ends, (1e3, 5.0), 0.005, 0.005, contacts=(band, 3.0 + 0 * band), **how)
    assert values.min() > 1
    assert values.max() == pytest.approx(1.0011, abs=1e-4)
    loops, gains = FollowerLoops(stated), ToolGains(1e3, 5.0)
    assert not loops.stable_over_ranges(gains)
    assert loops.radius(gains)[0] >= values.max() - 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("damper", [0.0, 2.0, 20.0])
@pytest.mark.parametrize("contact", ["[0.0, 1e6]", "[5e5, 1e7]", "[0.0, inf]"])
def test_no_contact_of_many_grows_faster_than_the_searched_one(contact, damper):
    stated = measured_force(contact).changed(follower={"contact_damping_ns_per_m": damper})
    low, high = stated.follower.contact_stiffness_n_per_m
    loops, gains = FollowerLoops(stated), (25.0, 0.8)
    radius = loops.radius(ToolGains(*gains))[0]
    angles = np.linspace(*(math.sqrt(k / 0.1) * 0.002 for k in (max(low, 1.0), min(high, 3e8))), 4000)
    found = max(grows(gains, 0.1 * (angles / 0.002) ** 2, damper, phase).max() for phase in (0.0, 0.5))
    assert found <= radius + 1e-6


def test_knots_of_a_contact_lie_closer_than_the_bands_of_its_swing():
    swing = Swing(mass_kg=0.1, period_s=0.002, late_samples=6.0)
    knots = swing.knots_n_per_m(10.0, 3e8)
    assert (np.diff(knots) > 0).all()
    assert (knots[0], knots[-1]) == (10.0, 3e8)
    angles = np.sqrt(knots / 0.1) * 0.002
    bands = 2 * math.pi / (6.0 + 1)
    assert np.diff(angles[(angles > 0.4) & (angles < 16 * math.pi)]).max() <= bands / 4 + 1e-9
    # What swings in a sample as if it were slower meets the slow modes of a hand.
    for turn in (1, 2, 7):
        assert np.abs(angles - 2 * math.pi * turn).min() < 1e-9
        assert np.sort(np.abs(angles - 2 * math.pi * turn))[1] < 0.03


def radii(clock, stated, hands, contact):
    body = Body.of(sampled_plant(stated.device, hands)).flat().axes(slice(None), None)
    touch = Touch.of(
        sampled_plant(stated.follower.at_leader(), contact), contact.stiffness_n_per_m, contact.damping_ns_per_m
    )
    link = Link(body, touch, clock, stated.follower)
    return tuple(np.round(link.closed(ToolGains(700.0, 4.0)).radius.ravel() ** (1 / link.samples), 8))


@pytest.mark.parametrize("ratio", first([1.0, 1.5, 0.5, 4 / 3]))
@pytest.mark.parametrize("sent", first([None, "commanded", "measured"]))
def test_the_round_trip_alone_decides_which_loops_two_clocks_make(ratio, sent):
    """Every phase of the clocks, and every share of the delay on the way there, is one of a few loops."""
    architecture = "position-position" if sent is None else "position-force"
    stated = avc.parse_problem(
        f"[device]\n{device(0.12, 0.8, 0.001)}[follower]\n{device(0.1, 1.0, ratio * 1e-3)}"
        f'architecture = "{architecture}"\nforce = "{sent or "commanded"}"\n'
    )
    hands = Hand(np.array([0.1, 0.0]), np.array([3.0, 0.0]), np.array([300.0, 0.0]))
    contact = Hand(np.zeros(2), np.array([0.0, 4.0]), np.array([0.0, 3e3]))
    times = 1e-3, ratio * 1e-3
    for there, back in ((0.0, 1e-3), (3e-3, 2e-3), (3.7e-3, 1.3e-3), (4.25e-3, 3.1e-3)):
        every = {radii(clock, stated, hands, contact) for clock in link_clocks(*times, there, back)}
        trips = round_trips(*times, (there, there), (back, back), sends_force=sent is not None)
        assert {radii(trip.clock, stated, hands, contact) for trip in trips} == every
    # Of ranges: every delay inside is among them.
    known = {radii(trip.clock, stated, hands, contact) for trip in round_trips(*times, (1e-3, 3e-3), (2e-3, 2.5e-3))}
    for there, back in itertools.product(np.linspace(1e-3, 3e-3, 5), (2e-3, 2.3e-3)):
        assert {radii(clock, stated, hands, contact) for clock in link_clocks(*times, there, back)} <= known


def engine(step_s, sample_time_s, **keys):
    table = {"tool_mass_kg": 0.2, "integrator": "implicit", "exchange": "ahead"} | keys
    lines = "\n".join(f"{key} = {f'{value!r}'.replace(chr(39), chr(34))}" for key, value in table.items())
    return avc.parse_problem(
        f"[device]\n{device(0.12, 0.8, sample_time_s)}[simulation]\nstep_s = [{step_s[0]}, {step_s[1]}]\n{lines}\n"
    )


def engine_growth(gains, ratio, sample_time_s, hands=(RELEASED,), **how):
    phases = Fraction(0), Fraction(1, 2 * ratio.denominator)
    ends = (0.12, 0.8, sample_time_s, 1), hands, (0.2, 0.0), gains, ratio
    return max(lifted_engine.growth(*ends, phase=phase, **how).max() for phase in phases)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("step_s", "sample_time_s", "keys", "lag_s"),
    [
        ((0.005, 0.015), 0.0005, {}, 0.01),
        ((0.005, 0.015), 0.0005, {}, 0.002),
        ((0.0155, 0.0178), 0.001, {"integrator": "semi-implicit", "exchange": "on-time"}, 0.01),
        ((0.0012, 0.004), 0.001, {"integrator": "semi-implicit", "exchange": "late"}, 0.004),
        ((0.00502, 0.005673), 0.001, {}, 0.002),
    ],
)
def test_every_steady_step_of_a_range_is_stable_below_the_limit(step_s, sample_time_s, keys, lag_s):
    """Whole multiples of T, and steps that are none, whose patterns recur after up to 97 steps."""
    search, k = ToolSearch(engine(step_s, sample_time_s, **keys)), 10.0
    while search.gain_margin(ToolGains(4 * k, 4 * k * lag_s)) and k < 1e6:
        k *= 4
    k *= search.gain_margin_over_ranges(ToolGains(k, k * lag_s))
    assert 10.0 < k < 1e6
    how = {"integrator": "implicit", "exchange": "ahead"} | keys
    random, (shortest, longest) = np.random.default_rng(3), (one / sample_time_s for one in step_s)
    whole = [Fraction(one) for one in range(math.ceil(shortest - 1e-9), math.floor(longest + 1e-9) + 1)]
    steps = whole + [Fraction(random.uniform(shortest, longest)).limit_denominator(97) for _ in range(60)]
    hands = [RELEASED, *itertools.product((0.05, 0.3), (3.0, 20.0), (200.0, 800.0))]
    # The device at its end stop moves nothing but the tool.
    people = {0.0: [*hands, (0.0, 7e3, END_STOP_N_PER_M)], math.inf: hands}
    gains = 0.98 * k, 0.98 * k * lag_s
    worst = max(
        (engine_growth(gains, ratio, sample_time_s, people[spring], contact=(spring, 0.0), **how), ratio, spring)
        for ratio in steps
        if shortest - 1e-9 <= ratio <= longest + 1e-9
        for spring in people
    )
    assert worst[0] <= 1 + 1e-9, worst


def test_patterns_of_a_range_of_steps_are_whole_ones_and_all_between():
    ranges = clock_ranges((0.0048, 0.0071), 0.001)
    whole = [clock.samples[0] for clock, (low, high) in ranges if low == high]
    assert whole == [5, 6, 7]
    between = sorted({ends for _, ends in ranges if ends[0] < ends[1]})
    assert between[0][0] == pytest.approx(0.0048)
    assert between[-1][1] == pytest.approx(0.0071)
    assert all(one[1] == pytest.approx(other[0]) for one, other in itertools.pairwise(between))
    for clock, (low, high) in ranges:
        assert 0.93 * low <= sum(clock.samples) / len(clock.samples) * 1e-3 <= 1.07 * high


@pytest.mark.slow
def test_a_beat_of_two_clocks_that_feeds_a_narrow_range_of_steps_is_found():
    """A released device on a held force: steps of 2.173 to 2.179 samples grow, those of 13/6 and 11/5 do not."""
    stated = avc.parse_problem(
        f"[device]\n{device(0.127, 1.31, 0.001, 2)}[simulation]\ntool_mass_kg = 0.177\n"
        'step_s = [0.00184, 0.002208]\nintegrator = "exact"\nexchange = "held-force"\n'
    )
    gains = 3436.0, 27.84
    ends = (0.127, 1.31, 0.001, 2), [RELEASED], (0.177, 0.0), gains
    how = {"integrator": "exact", "exchange": "held-force", "contact": (math.inf, 0.0)}

    def fastest(ratio):
        phase = Fraction(1, 2 * ratio.denominator)
        return float(lifted_engine.growth(*ends, ratio, phase=phase, **how)[0])

    beaten = fastest(Fraction(37, 17))
    assert max(fastest(Fraction(13, 6)), fastest(Fraction(11, 5))) < 0.999
    assert beaten > 1.002
    loops = ToolLoops(stated)
    assert not loops.stable_over_ranges(ToolGains(*gains))
    radius, case = loops.radius(ToolGains(*gains))
    # A step of about two samples.
    assert radius ** (1 / 2.176) >= beaten - 5e-4
    assert 2.17e-3 < case.step_s < 2.182e-3


def test_springs_of_an_engine_without_an_end_are_judged_from_the_softest_on():
    """A semi-implicit engine cannot hold springs up to rigid; an implicit one can."""
    keys = {"exchange": "on-time", "contact_stiffness_n_per_m": [500.0, 1e12]}
    gains = ToolGains(500.0, 5.0)
    explicit = ToolLoops(engine((0.004, 0.004), 0.001, **keys | {"integrator": "semi-implicit"}))
    assert not explicit.engine_alone_stable()
    assert not explicit.stable_over_ranges(gains)
    implicit = ToolLoops(engine((0.004, 0.004), 0.001, **keys))
    assert implicit.engine_alone_stable()
    assert implicit.stable_over_ranges(gains)


@pytest.mark.slow
def test_no_spring_of_an_exact_engine_grows_faster_than_the_searched_one():
    """An engine that moves a tool exactly holds any spring, and swings on it many times a step."""
    keys = {"integrator": "exact", "exchange": "on-time", "contact_damping_ns_per_m": 0.5}
    stated = engine((0.008, 0.008), 0.001, contact_stiffness_n_per_m=[0.0, 2e6], **keys)
    loops, gains = ToolLoops(stated), (2500.0, 10.0)
    radius = loops.radius(ToolGains(*gains))[0] ** (1 / 8)
    how = {"integrator": "exact", "exchange": "on-time"}
    springs = 0.2 * np.linspace(0.05, math.sqrt(2e6 / 0.2) * 0.008, 1500) ** 2 / 0.008**2
    found = max(engine_growth(gains, Fraction(8), 0.001, contact=(float(k), 0.5), **how) for k in springs)
    assert found <= radius + 1e-6


@pytest.mark.slow
def test_the_margin_of_a_follower_on_a_stiff_contact_is_that_of_the_loop_written_out():
    search = FollowerSearch(measured_force("[5e5, 1e6]"))
    margin = search.gain_margin_over_ranges(ToolGains(10.0, 0.25))
    springs = np.concatenate([[0.0], np.linspace(5e5, 1e6, 400)])
    at = {
        share: max(
            grows((10.0 * share * margin, 0.25 * share * margin), springs, 2.0, phase).max() for phase in (0.0, 0.5)
        )
        for share in (0.98, 1.02)
    }
    assert at[0.98] < 1 < at[1.02]


def test_a_follower_without_mass_is_refused_as_nothing_moves_it_between_contacts():
    with pytest.raises(avc.InputError, match=r"follower\.mass_kg"):
        avc.parse_problem(f"[device]\n{device(0.12, 0.8, 0.001)}[follower]\n{device(0.0, 1.0, 0.001)}delay_s = 0.005\n")


@pytest.mark.slow
def test_a_rotary_twin_at_scales_has_the_same_worst_contact():
    """Twice the length and three times the force, then all of it at a radius: one growth a sample, k by the scale."""
    scaled = "position_scale = 2.0\n{}_scale = 3.0\n"
    linear = avc.parse_problem(
        f"[device]\n{device(0.12, 0.8, 0.002)}[follower]\n{device(0.1, 1.0, 0.002)}delay_s = 0.004\n"
        'architecture = "position-force"\nforce = "measured"\ncontact_stiffness_n_per_m = [5e5, 1e6]\n'
        f"contact_damping_ns_per_m = 2.0\n{scaled.format('force')}"
    )
    square = 0.25**2

    def turning(mass, damping):
        return (
            f'motion = "rotary"\nhandle_radius_m = 0.25\ninertia_kgm2 = {mass * square}\nsample_time_s = 0.002\n'
            f"damping_nms_per_rad = {damping * square}\ndelay_samples = 1\n"
        )

    rotary = avc.parse_problem(
        f"[device]\n{turning(0.12, 0.8)}[follower]\n{turning(0.1, 1.0)}delay_s = 0.004\n"
        f'architecture = "position-force"\ntorque = "measured"\n'
        f"contact_stiffness_nm_per_rad = [{5e5 * square}, {1e6 * square}]\n"
        f"contact_damping_nms_per_rad = {2.0 * square}\n{scaled.format('torque')}"
    )
    radius, case = FollowerLoops(linear).radius(ToolGains(60.0, 1.5))
    twin, twin_case = FollowerLoops(rotary).radius(ToolGains(60.0 * square, 1.5 * square))
    assert twin == pytest.approx(radius, abs=1e-9)
    assert twin_case.environment_n_per_m == pytest.approx(square * case.environment_n_per_m, rel=1e-3)
    assert 6 * 5e5 <= case.environment_n_per_m <= 6 * 1e6
