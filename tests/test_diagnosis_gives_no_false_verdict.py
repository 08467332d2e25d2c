"""Logs that a rule of thumb takes for a fault, beside neighbours that have it."""

from dataclasses import replace

import numpy as np
import pytest
from buzzing_cases import declared_of
from buzzing_device import Buzzing, logged
from held_device import held_log

from avc_casadi.identification.diagnosis.diagnose import diagnose
from avc_casadi.identification.diagnosis.law import find_integral, find_law
from avc_casadi.identification.diagnosis.limit_cycle import goes_back
from avc_casadi.identification.diagnosis.log import log_of
from avc_casadi.identification.diagnosis.oscillation import Oscillation, TracedOscillation
from avc_casadi.identification.diagnosis.saturation import fed
from avc_casadi.identification.diagnosis.told import diagnosis_text
from avc_casadi.identification.record import Columns
from avc_casadi.model.device import Device

T = 1e-3

PRESS = Buzzing(
    mass=0.12, damping=0.8, friction=0.1, encoder=2e-5, limit=8.0, stiffness=4000.0, damper=5.5,
    hand_mass=0.08, hand_damping=4.0, hand_stiffness=300.0, start=0.0, speed=0.02, end=0.006,
)  # fmt: skip


def found_of(loop, seconds=2.0):
    return diagnose(Columns("log", *logged(loop, seconds)), device=declared_of(replace(loop, delay=1.0)))


@pytest.mark.parametrize(
    "changed",
    [
        {},
        {"friction": 0.05, "stiffness": 6000.0, "damper": 9.0},
        {"friction": 0.02, "stiffness": 4000.0, "damper": 10.0, "keep": 0.9},
        {"keep": 0.8, "stiffness": 3000.0, "damper": 8.0, "speed": 0.012},
    ],
)
@pytest.mark.parametrize("seconds", [0.4, 2.0])
def test_a_press_over_friction_and_encoder_steps_is_nothing_wrong(changed, seconds):
    """The device goes on from step to step and rests in contact, or the log ends."""
    assert found_of(replace(PRESS, **changed), seconds).verdict == "nothing wrong"


@pytest.mark.thorough
@pytest.mark.parametrize("delay", [4.0, 6.0])
def test_the_same_press_of_a_late_loop_that_friction_does_not_hold_is_a_delay(delay):
    found = found_of(replace(PRESS, delay=delay, friction=0.02))
    assert found.cause == "delay"
    assert abs(found.measured.delay_samples - delay) < 0.3


@pytest.mark.thorough
@pytest.mark.parametrize(("stiffness", "damping", "spring"), [(25000.0, 2.0, 250.0), (12000.0, 1.0, 150.0)])
def test_a_stiff_wall_under_a_loose_grip_is_too_stiff_and_not_released(stiffness, damping, spring):
    loop = replace(PRESS, stiffness=stiffness, damper=5.0, friction=0.02, hand_mass=1e-4)
    found = found_of(replace(loop, hand_damping=damping, hand_stiffness=spring))
    assert found.cause == "stiffness"
    assert found.measured.hand["stiffness_n_per_m"] == pytest.approx(spring, rel=0.2)


@pytest.mark.parametrize(("back", "goes"), [(0, False), (1, True), (2, True)])
def test_an_oscillation_goes_back_in_every_cycle(back, goes):
    """Three steps on in every cycle of 40 ms, after as many back as are told."""
    step, cycles = 2e-5, 20
    one = np.concatenate([np.full(20, -back), np.full(20, 3)])
    counts = np.concatenate([one + 3 * cycle for cycle in range(cycles)])
    time = T * np.arange(counts.size)
    log, _ = log_of(Columns("log", time, step * counts, -1.0 - 4000 * step * counts))
    assert goes_back(log, 0, counts.size, 25.0) == goes


DEVICE = Device(
    mass_kg=0.2,
    damping_ns_per_m=0.8,
    coulomb_friction_n=0.02,
    delay_samples=1,
    encoder_resolution_m=2e-5,
    max_force_n=8.0,
    sample_time_s=T,
)


def controller(integral):
    """Return a spring and damper with an integral term."""
    summed = [0.0]

    def law(_, seen, speed):
        summed[0] += seen * T
        return -300 * seen - 2 * speed - integral * summed[0]

    return law


def integrated(integral):
    return held_log(
        controller(integral), mass=0.2, damping=0.8, friction=0.02, ticks=3000, delay=1, start=3e-3, limit=8.0
    )


@pytest.mark.parametrize("integral", [5000.0, 6000.0, 9000.0])
def test_a_loop_that_an_integral_term_makes_run_away_is_not_said_to_die_away(integral):
    """It slows down at the force limit, below the frequencies at which it began."""
    log = integrated(integral)
    assert np.ptp(log.position_m[-1000:]) > 10 * np.ptp(log.position_m[:1000])
    found = diagnose(log, device=DEVICE)
    assert found.verdict == "cannot tell"
    assert "integral term" in found.conclusion


def test_a_smaller_integral_term_lets_it_die_away():
    log = integrated(2500.0)
    assert np.ptp(log.position_m[-1000:]) < 0.1 * np.ptp(log.position_m[:1000])
    assert diagnose(log, device=DEVICE).verdict == "nothing wrong"


TIME = T * np.arange(3000)
MOVED = 1e-3 * np.sin(31 * TIME) + 4e-4 * np.sin(57 * TIME + 1)


def test_an_integral_term_is_read_from_the_changes_of_the_force():
    speed = np.diff(MOVED, prepend=MOVED[0]) / T
    force = 300 * MOVED + 2 * speed + 6000 * np.cumsum(MOVED) * T + 0.7
    log, _ = log_of(Columns("log", TIME, MOVED, -force))
    found = find_integral(log, find_law(log, None), None)
    assert found.integral_n_per_ms == pytest.approx(6000, rel=1e-3)
    assert (found.stiffness_n_per_m, found.damping_ns_per_m) == pytest.approx((300, 2), rel=1e-3)
    assert found.takes_ns_per_m(5.0) == pytest.approx(6000 / (10 * np.pi) ** 2, rel=1e-3)


@pytest.mark.parametrize("late", [0, 3])
@pytest.mark.parametrize("keep", [0.0, 0.7])
def test_a_lag_and_a_velocity_filter_are_no_integral_term(late, keep):
    speed, filtered = np.diff(MOVED, prepend=MOVED[0]) / T, np.zeros(TIME.size)
    for tick in range(1, TIME.size):
        filtered[tick] = keep * filtered[tick - 1] + (1 - keep) * speed[tick]
    force = np.roll(300 * MOVED + 2 * filtered, late)
    log, _ = log_of(Columns("log", TIME, MOVED, -force))
    assert find_integral(log, find_law(log, None), None) is None


@pytest.mark.parametrize(("growth", "feeds"), [(0.0, False), (2.0, True)])
def test_a_spring_does_no_work_in_whole_cycles(growth, feeds):
    """A hand that starts in the wall and ends outside takes back what it put into the spring before the log began."""
    position = 0.01 * np.cos(2 * np.pi * 0.9 * TIME)
    force = 300 * position - growth * np.diff(position, prepend=position[0]) / T
    log, _ = log_of(Columns("log", TIME, position, -force))
    swing = TracedOscillation(Oscillation("irregular"), 0, TIME.size, position, position)
    assert fed(log, swing, DEVICE) == feeds


def rows_at(time):
    return log_of(Columns("log", time, np.sin(time), np.cos(time)))[0].ticks


@pytest.mark.parametrize("share", [0.02, 0.1, 0.15, 0.2, 0.25, 0.3])
@pytest.mark.parametrize("seed", range(3))
def test_no_tick_is_missing_from_a_clock_whose_ticks_follow_each_other_unevenly(share, seed):
    random = np.random.default_rng(seed)
    steps = 4e-3 * (1 + share * random.standard_normal(2000)).clip(0.3, 1.9)
    ticks = rows_at(np.append(0.0, np.cumsum(steps)))
    assert ticks.missed_share == 0
    assert ticks.sample_time_s == pytest.approx(steps.mean(), rel=1e-3)
    assert ticks.uneven_share == pytest.approx(np.std(steps) / steps.mean(), rel=0.01)


@pytest.mark.parametrize("missed", [0.02, 0.2, 0.5])
@pytest.mark.parametrize("share", [0.0, 0.04, 0.08])
def test_ticks_that_are_missing_are_counted_beside_a_clock_that_scatters(missed, share):
    random = np.random.default_rng(7)
    time = np.append(0.0, np.cumsum(4e-3 * (1 + share * random.standard_normal(3000))))
    kept = np.append(True, random.random(3000) >= missed)
    kept[-1] = True
    ticks = rows_at(time[kept])
    assert ticks.missed_share == pytest.approx(1 - kept.mean(), abs=0.002)


def test_stamps_that_scatter_about_an_even_grid_keep_to_it():
    time = 4e-3 * (np.arange(2000) + np.random.default_rng(1).uniform(-0.2, 0.2, 2000))
    ticks = rows_at(time)
    assert (ticks.missed_share, ticks.uneven_share) == (0, 0)
    assert ticks.jitter_rms_s == pytest.approx(4e-3 * 0.4 / np.sqrt(12), rel=0.05)


@pytest.mark.thorough
@pytest.mark.parametrize("late", [4e-4, 8e-4])
def test_the_loop_of_a_clock_that_is_late_each_time_is_not_told(late):
    """By 15 % of the period in the mean the delay was read as twice what it is, and ticks as missing."""
    log = held_log(
        lambda _, z, u: -1500 * z - 3 * u if z > 0 else 0.0,
        mass=0.2, damping=4.8, friction=0.02, spring=300.0, load=3.0, period=4e-3, ticks=900, delay=1, late=late,
    )  # fmt: skip
    found = diagnose(log)
    assert found.ticks.missed_share == 0
    assert ("uneven times" in found.conclusion) == (late > 5e-4)
    assert found.cause in ({None} if late > 5e-4 else {None, "stiffness"})


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("stiffness", "damping", "loop"),
    [
        (1500.0, -12.0, {"damping": 6.8, "spring": 400.0, "load": 2.4}),
        (300.0, -2.0, {"damping": 0.8, "start": 3e-3}),
    ],
)
def test_a_damper_of_the_wrong_sign_is_named_and_rests_turned_round(stiffness, damping, loop):
    def log_of_damper(b):
        law = lambda _, z, u: -stiffness * z - b * u if z > 0 or "start" in loop else 0.0  # noqa: E731
        return held_log(law, mass=0.2, friction=0.02, ticks=3000, delay=1, **loop)

    log = log_of_damper(damping)
    found = diagnose(log, device=DEVICE.model_copy(update={"mass_kg": 0.12}))
    assert (found.verdict, found.cause) == ("named", "damping")
    assert f"wrong sign: b = {damping:g} N.s/m" in found.conclusion
    (cure,) = found.cures
    assert cure.value == pytest.approx(-damping, rel=0.01)
    assert np.ptp(log_of_damper(cure.value).position_m[-500:]) < 0.05 * np.ptp(log.position_m[-500:])


@pytest.mark.thorough
def test_a_lag_of_half_a_sample_is_no_damper_of_the_wrong_sign():
    """A force of the mean of two positions falls behind by -k T/2."""
    before = [0.0]

    def law(_, seen, __):
        mean, before[0] = (seen + before[0]) / 2, seen
        return -3000 * mean

    log = held_log(law, mass=0.2, damping=0.8, friction=0.02, ticks=2000, delay=4, start=3e-3)
    found = diagnose(log, device=DEVICE)
    assert found.law.damping_ns_per_m == pytest.approx(-1.5, rel=0.01)
    assert "wrong sign" not in found.conclusion


@pytest.mark.thorough
def test_a_delay_is_told_for_the_mass_of_the_device_that_it_goes_with():
    log = held_log(
        lambda _, z, u: -3000 * z - 10 * u,
        mass=0.2, damping=0.8, friction=0.02, ticks=3000, delay=6, start=3e-3,
    )  # fmt: skip
    found = diagnose(log, device=DEVICE)
    (told,) = (line for line in found.evidence if "from position to motion" in line)
    assert ("declared 0.2" in told) == (found.measured.hand is None)
    assert abs(found.measured.delay_samples - 6) < 0.3


def driven(share, stiffness, damping, hand, hand_damping, size, hertz):
    """Return the log of a wall, softer by a share, into which a hand that trembles is pressed."""

    def pressed(tick, position, velocity):
        moves = 0.01 + size * np.sin(2 * np.pi * hertz * T * tick)
        return hand * (moves - position) - hand_damping * velocity

    return held_log(
        lambda _, z, u: -share * stiffness * z - damping * u,
        mass=0.22, damping=0.5, friction=0.05, delay=1, ticks=3000, limit=12.0, outside=pressed,
    )  # fmt: skip


@pytest.mark.thorough
@pytest.mark.parametrize(
    "loop",
    [
        (930, 4.0, 405, 1.0, 1.6e-3, 10.7),
        (1268, 1.9, 410, 5.6, 8e-4, 9.5),
        (544, 2.0, 260, 4.8, 1.5e-3, 6.4),
        (900, 3.0, 350, 3.0, 1.2e-3, 8.0),
    ],
)
def test_what_may_be_driven_from_outside_is_told_no_remedy_in_the_loop(loop):
    """A softer wall lets a hand that trembles move it further."""
    now, softer = (np.ptp(driven(share, *loop).position_m[-1000:]) for share in (1.0, 0.6))
    assert softer > 1.3 * now
    meant = {"mass_kg": 0.15, "damping_ns_per_m": 0.5, "coulomb_friction_n": 0.05, "max_force_n": 12.0}
    found = diagnose(driven(1.0, *loop), device=DEVICE.model_copy(update=meant))
    assert found.verdict == "cannot tell"
    assert "from outside" in found.conclusion
    assert "force off" in found.decides
    assert not found.cures


@pytest.mark.thorough
@pytest.mark.parametrize("play_n", [0.5, 0.6])
def test_no_cause_and_no_remedy_is_told_where_hardly_any_answer_has_one(play_n):
    """An amplifier whose output follows with play in the force is in no model here."""
    given = [0.0]

    def follows(force):
        given[0] = min(max(given[0], force - play_n), force + play_n)
        return given[0]

    log = held_log(
        lambda _, z, u: -3000 * z - 6 * u,
        mass=0.2, damping=0.5, friction=0.02, ticks=3000, delay=1, start=4e-3, limit=12.0, given_by=follows,
    )  # fmt: skip
    found = diagnose(log, device=DEVICE.model_copy(update={"damping_ns_per_m": 0.5, "max_force_n": 12.0}))
    assert found.shares["other"] > 2 / 3
    assert (found.verdict, found.candidates, found.cures) == ("cannot tell", (), ())
    assert "none of the causes it knows" in found.conclusion


@pytest.mark.parametrize("few", [8, 12, 20])
def test_a_damper_of_the_few_forces_below_a_limit_is_no_law_of_those_at_it(few):
    """At the limit of 12 N the damper would ask for 1 N: something else does."""
    time = T * np.arange(2000)
    moved = 0.05 * np.sin(20 * time)
    force = 12 * np.sign(moved + 1e-9)
    rows = np.add.outer(np.linspace(100, 1900, few).astype(int), [0, 1]).ravel()
    # What rounding leaves looks like a velocity filter far above the Nyquist frequency.
    for row in rows:
        force[row] = (moved[row] - moved[row - 1]) / T + 1e-6 * force[row - 1]
    log, _ = log_of(Columns("log", time, moved, -force))
    assert not find_law(log, 12.0).told
    log, _ = log_of(Columns("log", time, moved, -np.clip(4000 * moved, -12, 12)))
    assert find_law(log, 12.0).told


@pytest.mark.parametrize("hertz", [2.0, 2.6])
def test_a_limit_cycle_is_told_by_a_verdict_only(hertz):
    log = driven(1.0, 1870, 2.0, 435, 4.0, 6e-3, hertz)
    found = diagnose(log, device=DEVICE.model_copy(update={"damping_ns_per_m": 0.5, "coulomb_friction_n": 0.05}))
    assert found.verdict == "nothing wrong"
    assert found.oscillation.kind == "limit cycle"
    assert "limit cycle" not in diagnosis_text(found)
