"""What looks like another cause is set apart from it: by the edge of contact, by half an encoder step, by growth."""

from dataclasses import replace

import numpy as np
import pytest
from buzzing_cases import case_of, declared_of, healthy_case, rests, unfelt
from buzzing_device import Buzzing, logged

from avc_casadi import InputError
from avc_casadi.identification.diagnosis.diagnose import diagnose
from avc_casadi.identification.diagnosis.hypothesis import Hypothesis, limit_of, worst_mode
from avc_casadi.identification.diagnosis.law import find_law
from avc_casadi.identification.diagnosis.log import log_of
from avc_casadi.identification.diagnosis.noise_floor import Level
from avc_casadi.identification.diagnosis.oscillation import find_oscillation
from avc_casadi.identification.diagnosis.relay import find_jump
from avc_casadi.identification.record import Columns
from avc_casadi.model.device import Device
from avc_casadi.model.hands import Hand

LIGHT = Buzzing(mass=0.045, damping=2.0, encoder=2e-6, limit=50.0, stiffness=900.0, damper=130.0, hand_mass=0.08)
STEPS = 400


def columns(loop, missed=None, seconds=1.5):
    return Columns("log", *logged(loop, seconds, missed))


def jump_of(loop):
    log, _ = log_of(columns(loop, seconds=1.0))
    return find_jump(log, find_oscillation(log), find_law(log, loop.limit), loop.limit)


@pytest.mark.thorough
@pytest.mark.parametrize("changed", [{}, {"damper": 180.0, "end": 0.004}, {"damper": 150.0, "hand_stiffness": 300.0}])
def test_a_damper_that_lets_go_of_the_wall_is_no_force_that_is_switched_on(changed):
    loop = replace(LIGHT, **changed)
    log, _ = log_of(columns(loop, seconds=1.0))
    swing = find_oscillation(log)
    touching = log.force_n[swing.first : swing.last] > 0
    assert 0.05 < touching.mean() < 0.98
    assert jump_of(loop) is None
    assert diagnose(columns(loop), device=declared_of(replace(loop, damper=30.0))).cause == "damping"


@pytest.mark.thorough
def test_a_filtered_damper_that_strikes_the_wall_at_its_limit_is_none():
    loop = replace(LIGHT, stiffness=1300.0, damper=26.0, keep=0.6, limit=8.0, resonance=107.0, ratio=0.02, share=0.28)
    loop = replace(loop, delay=1.25, hand_mass=0.24, hand_damping=7.0, hand_stiffness=280.0, end=0.004)
    assert jump_of(loop) is None
    assert diagnose(columns(loop), device=declared_of(loop)).cause != "stiffness"


def test_a_force_at_its_limit_does_not_tell_what_made_it():
    assert jump_of(replace(LIGHT, damper=400.0, limit=8.0)) is None


def test_few_samples_between_rest_and_limit_tell_a_law_that_is_exact():
    loop = replace(LIGHT, damper=400.0, limit=20.0, encoder=1e-6)
    log, _ = log_of(columns(loop, seconds=1.0))
    law = find_law(log, loop.limit)
    assert law.told
    assert law.samples < 25
    assert (law.stiffness_n_per_m, law.damping_ns_per_m) == pytest.approx((900.0, 400.0), rel=1e-6)
    random = np.random.default_rng(0)
    between = (log.force_n > 0) & (log.force_n < loop.limit)
    other = replace(log, force_n=np.where(between, random.uniform(1.0, 19.0, between.size), log.force_n))
    assert find_law(other, loop.limit) is None


@pytest.mark.parametrize("stiffness", [0.0, 400.0])
@pytest.mark.parametrize("damper", [0.0, 3.0])
def test_a_force_that_contact_switches_on_is_one(stiffness, damper):
    loop = Buzzing(stiffness=stiffness, damper=damper, bias=5.0, end=0.002, delay=1.5, encoder=5e-6, limit=20.0)
    jump = jump_of(replace(loop, hand_stiffness=300.0))
    assert jump is not None
    assert jump.force_n == pytest.approx(5.0, rel=0.1)
    assert jump.damping_ns_per_m == pytest.approx(damper, abs=0.3)


def answer_of(loop):
    device = declared_of(loop).model_copy(update={"encoder_resolution_m": None})
    return Hypothesis(device, Hand(loop.hand_mass, loop.hand_damping, loop.hand_stiffness))


@pytest.mark.thorough
def test_ticks_that_are_missed_are_the_cause_of_a_growth_that_is_hardly_there_with_all_of_them():
    loop = Buzzing(mass=0.05, stiffness=9000.0, damper=1.5, delay=1.0, friction=0.08, encoder=5e-6, hand_damping=4.0)
    law = find_law(log_of(columns(loop))[0], None)
    # A hair over the limit: friction holds it at rest with all of its ticks.
    loop = replace(loop, stiffness=1.005 * loop.stiffness * limit_of(answer_of(loop), law, "stiffness"))
    time, position, _ = logged(loop, 1.6)
    assert np.ptp(position[time > 1.3]) < 1.5 * loop.encoder
    missed = (np.random.default_rng(3).random(time.size) < 0.5).astype(float)
    found = diagnose(columns(loop, missed, 1.6), device=declared_of(loop))
    law = replace(law, stiffness_n_per_m=loop.stiffness)
    assert 0 < worst_mode(answer_of(loop), law).growth_per_s < 1
    assert found.cause == "ticks", found.conclusion


@pytest.mark.thorough
def test_a_rate_that_was_halved_is_the_cause_of_a_growth_that_is_hardly_there_at_the_one_that_was_meant():
    meant = Buzzing(mass=0.05, stiffness=6000.0, damper=1.5, delay=1.0, friction=0.08, encoder=5e-6, hand_damping=4.0)
    law = find_law(log_of(columns(meant))[0], None)
    # A hair over the limit: friction holds it at rest at the rate that was meant.
    meant = replace(meant, stiffness=1.005 * meant.stiffness * limit_of(answer_of(meant), law, "stiffness"))
    time, position, _ = logged(meant, 1.6)
    assert np.ptp(position[time > 1.3]) < 1.5 * meant.encoder
    found = diagnose(columns(replace(meant, period=2 * meant.period), seconds=1.6), device=declared_of(meant))
    assert found.cause == "rate", found.conclusion


@pytest.mark.thorough
@pytest.mark.parametrize(("encoder", "end"), [(1e-4, 0.0045), (1.3e-4, 0.005)])
def test_a_hand_over_few_steps_is_not_taken_for_none(encoder, end):
    loop = Buzzing(mass=0.21, damping=1.5, delay=1.6, encoder=encoder, stiffness=4500.0, damper=4.0, limit=8.0)
    loop = replace(loop, hand_mass=0.14, hand_damping=6.0, hand_stiffness=700.0, end=end)
    found = diagnose(columns(loop), device=declared_of(loop))
    assert found.oscillation.steps < 4
    assert found.shares.get("let-go", 0.0) < 0.1, found.conclusion
    assert found.cause == "encoder" or found.candidates[0] == "encoder"


@pytest.mark.thorough
def test_a_resonance_is_no_stiff_grip():
    # A grip of 6 kN/m explained it so well that no resonance was looked for.
    case = case_of("resonance", 8484, 22)
    found = diagnose(case.columns, device=case.declared)
    assert found.cause == "resonance", found.conclusion


def test_what_goes_on_counts_before_what_swung_faster_and_ended():
    time = np.arange(3000) * 1e-3
    # It flies to and fro at first, and then swings at another frequency.
    swings = np.where(time < 1, 1.4e-3 * np.sin(2 * np.pi * 32 * time), 1.2e-3 * np.sin(2 * np.pi * 21 * time))
    position = 1e-6 * np.round(swings / 1e-6)
    found = find_oscillation(log_of(Columns("log", time, position, -1000 * position))[0]).found
    assert found.ends_s == pytest.approx(3.0, abs=0.1)


GRIPPED = Buzzing(
    damping=1.0, friction=0.1, encoder=1e-5, hand_mass=0.4, hand_damping=10.0, hand_stiffness=300.0, end=0.012
)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("cause", "changed"),
    [
        ("damping", {"delay": 2.0, "stiffness": 6000.0, "damper": 58.0, "limit": 5.0}),
        ("damping", {"delay": 2.0, "stiffness": 5000.0, "damper": 62.0, "limit": 20.0}),
        ("stiffness", {"delay": 3.0, "stiffness": 8000.0, "damper": 10.0, "limit": 8.0}),
    ],
)
@pytest.mark.parametrize("grip", [(400.0, 4.0), (600.0, 6.0)])
def test_a_hand_behind_a_grip_is_not_one_that_let_go(grip, cause, changed):
    # Its mass hardly moves where the loop swings: named "hand let go" where only a mass on the device was a hand.
    loop = replace(GRIPPED, grip_stiffness=grip[0], grip_damping=grip[1], **changed)
    found = diagnose(columns(loop), device=declared_of(loop))
    assert found.cause == cause, found.conclusion
    assert found.measured.hand["damping_ns_per_m"] == pytest.approx(grip[1], rel=0.2)


def test_what_rounding_cannot_leave_weighs_more_than_its_size():
    random = np.random.default_rng(0)
    rounded = random.uniform(-0.5, 0.5, STEPS)
    level = Level.of({0: rounded}, 2, 1 / np.sqrt(12), 1.0)
    assert level.beyond_m[0] < 0.5 * level.rms_m[0]
    assert level.beyond_m[1] == np.inf
    # Of a residual that is no rounding both are the same.
    large = Level.of({0: 20 * random.standard_normal(STEPS)}, 1, 1 / np.sqrt(12), 1.0)
    assert large.beyond_m[0] == pytest.approx(large.rms_m[0], rel=0.01)


def test_a_residual_that_repeats_itself_tells_less_than_its_samples():
    random = np.random.default_rng(1)
    white = random.standard_normal(STEPS)
    cycle = np.tile(random.standard_normal(20), STEPS // 20)
    slow = np.cos(np.pi * np.arange(STEPS) / 100)
    sizes = {
        name: Level.of({0: one / one.std()}, 1, 0.0, 0.0).rms_m[0] ** 2
        for name, one in (("white", white), ("cycle", cycle), ("slow", slow))
    }
    assert sizes["white"] == pytest.approx(3, abs=0.5)
    # Bartlett: twenty samples that come twenty times are about twenty, twice over for the sum of squares.
    assert 8 < sizes["cycle"] < 40
    assert sizes["slow"] > 60


@pytest.mark.thorough
def test_a_toggle_that_its_force_cannot_make_felt_is_nothing_wrong():
    time = np.arange(1600) * 1e-3
    position = 3e-3 + 2.6e-6 * (np.sin(2 * np.pi * 130 * time) > 0)
    log = Columns("toggle", time, position, -3.0 - 0.03 * np.sign(np.sin(2 * np.pi * 130 * time)))
    device = Device.model_validate({"mass_kg": 0.1, "damping_ns_per_m": 1.0, "sample_time_s": 1e-3})
    found = diagnose(log, device=device)
    assert found.oscillation.steps == pytest.approx(1.0)
    assert found.verdict == "nothing wrong"
    strong = Columns("toggle", time, position, -3.0 - 3.0 * np.sign(np.sin(2 * np.pi * 130 * time)))
    assert diagnose(strong, device=device).verdict != "nothing wrong"


@pytest.mark.thorough
def test_a_toggle_by_one_step_that_a_hand_feels_is_no_log_with_nothing_wrong():
    loop = Buzzing(mass=0.0825, damping=0.571, delay=1.786, encoder=1.616e-5, period=5e-4, limit=20.0, end=0.0111)
    loop = replace(loop, stiffness=594.0, damper=18.13, hand_mass=0.0748, hand_damping=12.1, hand_stiffness=478.0)
    coarse, fine = loop, replace(loop, encoder=1e-6)
    for one, felt in ((coarse, True), (fine, False)):
        position = logged(one, 1.6)[1]
        assert rests(position, one.period, one.encoder)
        assert unfelt(one, position) != felt
        assert (diagnose(columns(one, seconds=1.6), device=declared_of(one)).verdict != "nothing wrong") == felt
    drawn = healthy_case(51977, 9)
    assert unfelt(drawn.loop, drawn.columns.position_m)


@pytest.mark.thorough
def test_a_force_that_its_limit_cuts_does_not_jump_where_the_law_begins_at_the_wall():
    """Fast strikes: what is left of the force below its limit is far from the edge of contact."""
    loop = Buzzing(mass=0.12, damping=0.8, encoder=2e-5, limit=8.0, stiffness=4000.0, damper=12.0, delay=1.3)
    loop = replace(loop, resonance=120.0, ratio=0.01, share=0.7, hand_mass=0.1, hand_damping=6.0, hand_stiffness=400.0)
    assert jump_of(loop) is None
    assert diagnose(columns(loop, seconds=3.0), device=declared_of(loop)).cause != "stiffness"


@pytest.mark.thorough
def test_what_swings_on_over_coarse_steps_does_not_die_away():
    """The force goes on from one end to the other, whatever becomes of its strongest line."""
    loop = Buzzing(mass=0.12, damping=0.8, encoder=2e-4, limit=8.0, stiffness=3000.0, damper=15.0, delay=1.3)
    loop = replace(loop, friction=0.02, hand_mass=0.1, hand_damping=6.0, hand_stiffness=400.0, end=0.01)
    found = diagnose(columns(loop, seconds=8.0), device=declared_of(loop))
    _, _, force = logged(loop, 8.0)
    assert np.ptp(force[-1000:]) > 5.0
    assert found.verdict != "nothing wrong", found.conclusion
    assert "encoder" in (found.cause, *found.candidates)


def driven(hertz, size_n, seconds=3.0):
    """A loop that rests, all in contact, shaken by a force from outside; nothing of it is in the log."""
    period, inner, mass, damping = 1e-3, 10, 0.13, 1.5
    h, steps = period / inner, round(seconds / period)
    x, v, line, rows = -1e-3, 0.0, [0.0, 0.0], []
    for tick in range(steps):
        counted = 1e-5 * np.floor(x / 1e-5 + 0.5)
        force = max(0.0, 2000.0 * counted + 3.0 * (counted - (rows[-1][1] if rows else counted)) / period)
        rows.append((tick * period, counted, -force))
        line.append(force)
        for part in range(inner):
            time = tick * period + part * h
            aim = min(-1e-3 + 0.03 * time, 0.02)
            push = 300.0 * (aim - x) - damping * v - 0.05 * np.sign(v) + size_n * np.sin(2 * np.pi * hertz * time)
            v += h * (push - line[-2]) / mass
            x += h * v
    return Columns("log", *np.array(rows).T)


DRIVEN = Device(
    mass_kg=0.1,
    damping_ns_per_m=0.5,
    coulomb_friction_n=0.05,
    delay_samples=1,
    encoder_resolution_m=1e-5,
    max_force_n=50.0,
)


@pytest.mark.thorough
@pytest.mark.parametrize(("hertz", "size_n"), [(60.0, 1.5), (30.0, 1.0), (15.0, 0.3)])
def test_what_is_shaken_from_outside_is_not_said_to_be_the_loop(hertz, size_n):
    found = diagnose(driven(hertz, size_n), device=DRIVEN)
    assert found.oscillation.frequency_hz == pytest.approx(hertz, rel=0.03)
    assert found.verdict != "named"


def test_without_the_shaking_there_is_nothing_wrong():
    assert diagnose(driven(60.0, 0.0), device=DRIVEN).verdict == "nothing wrong"


@pytest.mark.thorough
def test_a_damper_that_a_step_drives_to_the_limit_is_not_read_as_none():
    """What is not cut are the samples without a velocity: they tell a spring alone."""
    loop = Buzzing(damper=25.0, stiffness=1500.0, encoder=4e-4, limit=8.0, hand_mass=0.05, hand_damping=3.0)
    log, _ = log_of(columns(loop))
    law = find_law(log, loop.limit)
    assert law is None or not law.told
    found = diagnose(columns(loop), device=declared_of(loop))
    assert found.verdict == "cannot tell"
    assert "its limit" in found.conclusion


def test_a_position_that_never_changes_under_a_force_that_does_is_refused():
    time = np.arange(2000) * 1e-3
    with pytest.raises(InputError, match="position: never changes, and the force does"):
        diagnose(Columns("log", time, np.full(2000, 1e-3), np.sin(time)))
    found = diagnose(Columns("log", time, np.full(2000, 1e-3), np.ones(2000)))
    assert found.verdict == "nothing wrong"
    assert "the position never changes" in found.notes[-1]


@pytest.mark.thorough
@pytest.mark.parametrize(("lasts", "nothing"), [(0.7, True), (2.0, False)])
def test_the_cycles_of_a_touch_before_long_rest_in_contact_are_nothing_wrong(lasts, nothing):
    time = np.arange(4000) * 1e-3
    swings = 4e-4 * np.sin(2 * np.pi * 7.5 * time) * ((time > 0.3) & (time < 0.3 + lasts))
    position = 1e-5 * np.round((1e-3 + swings) / 1e-5)
    found = diagnose(Columns("log", time, position, -2000 * position), device=DRIVEN)
    assert found.oscillation.sustained
    assert (found.verdict == "nothing wrong") == nothing


@pytest.mark.parametrize(("asked", "taken"), [(-1.0, 0.0), (8.4e-4, 0.0), (1e-3, 1e-3), (0.5, 0.5)])
def test_a_delay_that_no_device_may_have_is_none(asked, taken):
    answer = Hypothesis(Device.model_validate({"mass_kg": 0.1, "damping_ns_per_m": 0.5, "delay_samples": 1}), None)
    assert answer.delayed(asked).device.delay_samples == taken


@pytest.mark.thorough
@pytest.mark.parametrize(("damper", "speed", "hand"), [(145.0, 0.03, 3.0), (145.0, 0.07, 8.0), (160.0, 0.07, 3.0)])
def test_what_buzzes_over_a_few_counts_after_a_push_into_the_wall_has_its_own_frequency(damper, speed, hand):
    """The push itself is slow, large and soon over; the force then swings to the end of the log."""
    loop = Buzzing(mass=0.12, damping=0.8, friction=0.1, delay=1.0, encoder=2e-5, limit=8.0, stiffness=1000.0)
    loop = replace(loop, hand_mass=0.06, hand_damping=hand, hand_stiffness=500.0, start=-0.01, end=0.007)
    log = columns(replace(loop, damper=damper, speed=speed), seconds=4.0)
    assert np.ptp(log.force_n[-500:]) > 3
    found = diagnose(log)
    assert found.cause == "encoder" or set(found.candidates) == {"damping", "encoder"}


@pytest.mark.thorough
def test_a_loop_that_a_slow_filter_of_the_velocity_swings_is_offered_a_quicker_one():
    loop = Buzzing(mass=0.12, damping=0.8, friction=0.1, encoder=5e-6, limit=20.0, stiffness=4000.0, damper=15.0)
    loop = replace(loop, hand_mass=0.06, hand_damping=3.0, hand_stiffness=500.0, end=0.005)
    slow = replace(loop, keep=float(np.exp(-2 * np.pi * 8.0 * loop.period)))
    found = diagnose(columns(slow), device=declared_of(slow))
    quicker = [cure for cure in found.cures if cure.key == "velocity_filter_hz"]
    assert quicker
    assert quicker[0].value > 30
    mended = replace(loop, keep=float(np.exp(-2 * np.pi * quicker[0].value * loop.period)))
    assert np.ptp(columns(slow).position_m[-300:]) > 1e-4
    assert np.ptp(columns(mended).position_m[-300:]) < 2e-5
