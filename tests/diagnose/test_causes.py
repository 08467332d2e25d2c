"""Logs of simulators that share no code with the project: the cause is right or open, and what is told brings rest."""

from dataclasses import replace

import numpy as np
import pytest
from buzzing_device import Buzzing, declared_of, logged
from held_device import held_log
from quick import first
from swings import KINDS, TRUTH, case, declared, settled

from avc_casadi.diagnose.causes import diagnose
from avc_casadi.identification.log import Columns
from avc_casadi.model.device import Device

HEALTHY = Buzzing(encoder=5e-6, stiffness=3000.0, damper=12.0)


def columns(loop, seconds=1.5):
    return Columns("log", *logged(loop, seconds))


def found_of(loop, meant=HEALTHY):
    return diagnose(columns(loop), device=declared_of(meant))


@pytest.mark.slow
def test_a_resonance_that_nobody_declared_is_found():
    found = found_of(replace(HEALTHY, resonance=110.0, ratio=0.02, damper=40.0), replace(HEALTHY, damper=40.0))
    assert found.cause == "resonance", found.conclusion
    assert found.fit.best.device.resonance.frequency_hz == pytest.approx(110.0, rel=0.2)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["rate", "let-go", "rates", "noise", "game", "reversed", "shaken"])
def test_what_is_drawn_is_named_right_or_left_open_and_its_remedies_bring_rest(kind):
    loop, wrong, log = case(kind, 7204, KINDS.index(kind))
    found = diagnose(log, device=declared(loop, wrong))
    assert (found.cause or found.verdict) in {TRUTH.get(kind, kind), "cannot tell"}, found.conclusion
    assert all(held and free for _, held, free in settled(found, wrong, kind))


STEP = 2 * np.pi / 16384


def turning(law, *, mass, damping, friction, period, delay, limit, step=STEP, noise=0.0, **loop):
    """Return the log of a device that turns, and its declaration."""
    made = {"mass": mass, "damping": damping, "friction": friction, "period": period, "delay": delay, "limit": limit}
    log = held_log(law, **made, step=step, noise=noise, rotary=True, **loop)
    keys = ("mass_kg", "damping_ns_per_m", "coulomb_friction_n", "sample_time_s", "delay_samples", "max_force_n")
    device = dict(zip(keys, made.values(), strict=True))
    more = {"motion": "rotary", "handle_radius_m": 0.15, "encoder_resolution_m": step, "position_noise_rms_m": noise}
    return log, Device.model_validate(device | more)


def switched(k, b, c, band=0.0):
    return lambda _, z, u: -(k * z + b * u + (c * np.sign(z) if abs(z) > band else 0.0))


@pytest.mark.parametrize(
    ("k", "b", "c", "mass", "period"),
    [(2.0, 0.05, 0.5, 0.025, 5e-3), (0.8, 0.02, 1.0, 0.03, 4e-3)],
)  # fmt: skip
@pytest.mark.slow
def test_a_relay_beside_spring_and_damper_swings_without_a_hand(k, b, c, mass, period):
    """The logged torque takes energy; as it acts, a sample and the hold later, it feeds the swing."""
    log, device = turning(
        switched(k, b, c), mass=mass, damping=0.02, friction=0.02, period=period, delay=1, limit=2.2, start=0.6,
        ticks=round(6 / period), given_by=lambda force: force - np.clip(force, -0.05, 0.05),
    )  # fmt: skip
    found = diagnose(log, device=device)
    assert found.cause == "relay", found.conclusion
    assert abs(found.law.switch.force_n) == pytest.approx(c, rel=0.02)
    assert [remedy.key for remedy in found.remedies] == ["switch_width"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("k", "b", "c", "band", "mass", "period"),
    [(1.2, 0.05, 0.8, 1e-2, 0.05, 1 / 60), (2.0, 0.08, 0.5, 5e-3, 0.03, 1 / 100)],
)  # fmt: skip
def test_a_minimum_force_with_a_dead_band_is_named_and_over_the_width_told_it_rests(k, b, c, band, mass, period):
    loop = {"mass": mass, "damping": 0.03, "friction": 0.03, "period": period, "delay": 1, "limit": 5.0}
    loop |= {"start": 0.4, "ticks": round(8 / period)}
    log, device = turning(switched(k, b, c, band), **loop)
    found = diagnose(log, device=device)
    assert found.cause == "relay", found.conclusion
    assert found.law.switch.force_n == pytest.approx(c, rel=0.02)
    (remedy,) = found.remedies

    def wide(_, z, u):
        over = np.clip((abs(z) - band) / remedy.value, 0.0, 1.0)
        return -(k * z + b * u + c * np.sign(z) * over)

    # In 25 swings, and without dry friction unless the remedy says that it rests by it.
    loop |= {} if remedy.by_friction else {"friction": 0.0}
    left = turning(wide, **loop | {"ticks": 3 * loop["ticks"]})[0].position_m
    assert np.ptp(left[-loop["ticks"] // 4 :]) < 0.1 * np.ptp(log.position_m[-loop["ticks"] // 4 :])


WHEEL = {"mass": 0.05, "friction": 0.02, "period": 1e-3, "delay": 1, "limit": 5.0}


def stops(travel, stiffness=400.0, damping=2.0):
    def force(_, x, v):
        beyond = x - np.clip(x, -travel, travel)
        return -stiffness * beyond - (damping * v if beyond else 0.0)

    return force


@pytest.mark.slow
@pytest.mark.parametrize(("frame", "late"), first([(16, 1), (8, 2)]))
def test_a_force_that_is_held_and_late_is_no_negative_damper(frame, late):
    """k x of a frame before is exactly k x with a damper of -k times the frame."""
    waiting = [0.0] * (late + 1)

    def law(tick, z, _):
        waiting[:] = [*waiting[1:], -8.0 * z] if tick % frame == 0 else waiting
        return waiting[0]

    log, device = turning(law, **WHEEL, damping=0.05, start=0.1, ticks=4000)
    found = diagnose(log, device=device)
    assert (found.log.hold, found.law.lag, found.law.damping_ns_per_m, found.cause) == (frame, late, 0.0, "rate")
    assert found.law.stiffness_n_per_m == pytest.approx(8.0)
    assert found.data()["measured"]["delay_samples"] == pytest.approx(1 + late * frame, abs=1.0)


@pytest.mark.parametrize(("motor", "k", "b"), [(1, 8, 0.05), (-1, 8, 0.05), (1, -8, -0.05), (1, 8, -0.05)])
@pytest.mark.parametrize("start", [0.1, pytest.param(0.01, marks=pytest.mark.slow)])
def test_a_force_of_the_wrong_sign_is_named(motor, k, b, start):
    loop = {"given_by": lambda force: motor * force, "outside": stops(0.5), "step": STEP / 16, "damping": 0.02}
    log, device = turning(lambda _, z, u: -k * z - b * u, **WHEEL, **loop, start=start, ticks=3000)
    found = diagnose(log, device=device)
    assert (found.cause or found.verdict) == ("sign" if motor * k < 0 or b < 0 else "nothing wrong"), found.conclusion


@pytest.mark.parametrize("counts", [1000, *(pytest.param(steps, marks=pytest.mark.slow) for steps in (2000, 4000))])
@pytest.mark.parametrize("b", [8e-4, 0.05])
def test_a_damper_is_told_with_an_interval_that_holds_it(counts, b):
    """The log is coarser than the position that the law reads: its velocity is hardly seen."""
    log, device = turning(lambda _, z, u: -10 * z - b * u, **WHEEL, damping=0.05, start=0.3, ticks=3000)
    step = 2 * np.pi / counts
    found = diagnose(replace(log, position_m=step * np.round(log.position_m / step)), device=device)
    assert found.verdict == "nothing wrong", found.conclusion
    law = found.law
    assert abs(law.damping_ns_per_m - b) < law.damping_error_ns_per_m


@pytest.mark.slow
@pytest.mark.parametrize(
    ("k", "travel", "seconds"),
    [(25.0, 0.35, 0.81), (40.0, 0.3, 6.0)],
)
def test_travel_stops_are_no_hand_and_no_delay_and_a_stiffness_told_rests(k, travel, seconds):
    loop = {"mass": 0.06, "damping": 0.02, "friction": 0.02, "period": 0.01, "delay": 2, "limit": 9.0, "start": 0.1}
    log, device = turning(lambda _, z, __: -k * z, **loop, ticks=round(seconds / 0.01), outside=stops(travel))
    found = diagnose(log, device=device)
    assert found.cause in {None, "stiffness"}, found.conclusion
    assert seconds > 1.5 or found.cause == "stiffness"
    measured = found.data()["measured"]
    assert measured["stops_m"][1] == pytest.approx(travel, rel=0.2, abs=measured["stops_error_m"])
    assert_rests_softer(found, loop, travel)


def assert_rests_softer(found, loop, travel):
    """The loop rests with each stiffness or damping that is a remedy, and no other is one."""
    assert {one["key"] for one in found.data()["remedies"]} <= {"stiffness_nm_per_rad", "damping_nms_per_rad"}
    for one in found.remedies:
        k, b = (one.value, 0.0) if one.quantity == "stiffness" else (found.law.stiffness_n_per_m, one.value)
        softer, _ = turning(lambda _, z, u: -k * z - b * u, **loop, ticks=4000, outside=stops(travel))  # noqa: B023
        assert np.ptp(softer.position_m[-400:]) < 0.2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("k", "travel", "radius", "seconds"),
    [(25.0, 0.35, 0.1, 0.81), (40.0, 0.25, 0.1, 3.0)],
)
def test_a_device_that_is_not_given_may_be_far_heavier_than_the_assumed_one(k, travel, radius, seconds):
    loop = {"mass": 0.06, "damping": 0.02, "friction": 0.02, "period": 0.01, "delay": 2, "limit": 9.0, "start": 0.1}
    log, _ = turning(lambda _, z, __: -k * z, **loop, ticks=round(seconds / 0.01), outside=stops(travel))
    found = diagnose(log, handle_radius_m=radius)
    assert found.cause in {None, "stiffness"}, found.conclusion
    assert_rests_softer(found, loop, travel)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("declared", "k", "b", "counts", "period"),
    [(True, 3.0, 0.2, 0.7, 2e-3), (False, 1.0, 0.12, 0.5, 1e-3), (None, 3.0, 0.12, 5.0, 2e-3)],
)
def test_noise_through_the_damper_is_named_and_the_damper_of_the_remedy_halves_it(k, b, counts, period, declared):
    """Noise that is declared, that is not, and of a device that is not given."""
    step = np.radians(40) / 870
    loop = {"mass": 0.004, "damping": 0.005, "friction": 0.005, "period": period, "delay": 1, "limit": 5.0}
    loop |= {"step": step, "noise": counts * step, "ticks": round(3 / period), "start": 0.05}
    log, device = turning(lambda _, z, u: -k * z - b * u, **loop)
    device = None if declared is None else device.model_copy(update={} if declared else {"position_noise_rms_m": 0.0})
    found = diagnose(log, device=device, handle_radius_m=0.15)
    assert found.cause == "encoder", found.conclusion
    softer = [remedy.value for remedy in found.remedies if remedy.key == "damping_ns_per_m"]
    assert softer
    for value in softer:
        quiet, _ = turning(lambda _, z, u: -k * z - value * u, **loop)  # noqa: B023
        assert np.std(quiet.force_n[-500:]) < 0.6 * np.std(log.force_n[-500:])
    # Where the noise is larger than a step, a finer encoder reads the same noise.
    assert counts < 1 or "encoder_resolution_m" not in {remedy.key for remedy in found.remedies}


@pytest.mark.parametrize(("sign", "size"), first([(1, 0.06), (-1, 0.035)]))
def test_a_motor_that_turns_freely_under_a_constant_torque_is_no_swing(sign, size):
    log = held_log(
        lambda tick, _, __: sign * (size + 0.005 * np.sin(tick / 40)),
        mass=1.2e-4, damping=9.5e-5, friction=0.03, step=1e-3, ticks=2000, rotary=True,
    )  # fmt: skip
    found = diagnose(log, handle_radius_m=0.05, flip_force=True)
    assert found.verdict == "cannot tell"
    assert not found.remedies


LINEAR = Device(
    mass_kg=0.2,
    damping_ns_per_m=0.8,
    coulomb_friction_n=0.02,
    delay_samples=1,
    encoder_resolution_m=2e-5,
    max_force_n=8.0,
)
FILE_KEYS = {
    "mass": "mass_kg", "friction": "coulomb_friction_n", "limit": "max_force_n", "step": "encoder_resolution_m",
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("slow", "every"), [("spring", 16), ("spring", 10), ("damper", 8)])
def test_two_rates_are_named_with_their_frame(slow, every):
    held = [0.0, 0.0]
    k, b = (300.0, 3.0) if slow == "spring" else (600.0, 40.0)

    def law(tick, z, u):
        if tick % every == 0:
            held[0], held[1] = (-k * z, z) if slow == "spring" else (-b * (z - held[1]) / (every * 1e-3), z)
        return held[0] - (b * u if slow == "spring" else k * z)

    log = held_log(law, mass=0.2, damping=0.2, friction=0.02, ticks=4000, delay=1, start=5e-3)
    found = diagnose(log, device=LINEAR.model_copy(update={"damping_ns_per_m": 0.2}))
    assert found.cause in {"rates", None}, found.conclusion
    assert (found.law.frames.slow, found.law.frames.ticks) == (slow, every)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cause", "k", "b", "held_ticks"),
    first([("stiffness", 12000.0, 4.0, 2000), ("stiffness", 6000.0, 6.0, 0), ("stiffness", 4000.0, 3.0, 0),
                ("damping", 500.0, 230.0, 0), ("let-go", 4000.0, 3.0, 500)]),
)  # fmt: skip
def test_a_hand_never_there_has_not_let_go_and_remedies_rest_released_or_say_so(cause, k, b, held_ticks):
    def log_of(k, b, held_ticks):
        hand = lambda tick, x, v: (500 * (2e-3 - x) - 10 * v) * (tick < held_ticks)  # noqa: E731
        loop = {"mass": 0.2, "damping": 0.8, "friction": 0.02, "delay": 1, "start": 4e-3, "ticks": 2000}
        return held_log(lambda _, z, u: -k * z - b * u, **loop, outside=hand)

    found = diagnose(log_of(k, b, held_ticks), device=LINEAR)
    assert found.cause == cause, found.conclusion
    for one in found.remedies:
        gains = {"stiffness_n_per_m": k, "damping_ns_per_m": b} | {one.key: one.value}
        last = held_ticks if one.while_held else 0
        assert len(gains) > 2 or np.ptp(log_of(*gains.values(), last).position_m[-400:]) < 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("ticks", [700, 1000])
def test_a_hand_that_lets_go_while_the_device_still_moves_has_let_go(ticks):
    """The motion falls by e^3 beside one that grows, but not below a seventh of what it grows to in so short a log."""
    hand = lambda tick, x, v: (500 * (2e-3 - x) - 10 * v) * (tick < 150)  # noqa: E731
    loop = {"mass": 0.2, "damping": 0.8, "friction": 0.02, "delay": 1, "start": 4e-3, "ticks": ticks}
    found = diagnose(held_log(lambda _, z, u: -3500 * z - 3.5 * u, **loop, outside=hand), device=LINEAR)
    assert found.cause == "let-go", found.conclusion


def integral(gain):
    summed = [0.0]

    def law(_, seen, speed):
        summed[0] += seen * 1e-3
        return -300 * seen - 2 * speed - gain * summed[0]

    return held_log(law, mass=0.2, damping=0.8, friction=0.02, ticks=3000, delay=1, start=3e-3)


@pytest.mark.parametrize("gain", first([2500.0, 6000.0]))
def test_a_force_that_is_no_spring_and_damper_is_never_nothing_wrong(gain):
    found = diagnose(integral(gain), device=LINEAR)
    assert (found.verdict, found.remedies) == ("cannot tell", ())
    assert found.decides


@pytest.mark.slow
@pytest.mark.parametrize(("hertz", "size_n"), [(60.0, 1.5), (15.0, 0.3)])
def test_what_is_shaken_from_outside_is_not_said_to_be_the_loop(hertz, size_n):
    def shakes(tick, position, velocity):
        push = size_n * np.sin(2 * np.pi * hertz * tick * 1e-3)
        return 300 * (min(0.03 * tick * 1e-3, 0.02) - position) - velocity + push

    law = lambda _, z, u: -max(2000 * z + 3 * u, 0.0) if z > 0 else 0.0  # noqa: E731
    log = held_log(law, mass=0.3, damping=0.8, friction=0.02, ticks=3000, delay=1, limit=50.0, outside=shakes)
    found = diagnose(log, device=LINEAR.model_copy(update={"max_force_n": 50.0}))
    assert (found.verdict, found.cause) == ("cannot tell", None), found.conclusion


@pytest.mark.slow
@pytest.mark.parametrize(("hertz", "size_n", "travel"), [(50.0, 0.15, 0.02), (30.0, 0.06, 0.02), (20.0, 0.03, 0.05)])
def test_a_shaking_of_few_encoder_steps_after_a_large_motion_is_neither_rest_nor_the_encoder(hertz, size_n, travel):
    def shakes(tick, position, velocity):
        push = size_n * np.sin(2 * np.pi * hertz * tick * 1e-3)
        return 300 * (min(0.03 * tick * 1e-3, travel) - position) - velocity + push

    law = lambda _, z, u: -max(2000 * z + 3 * u, 0.0) if z > 0 else 0.0  # noqa: E731
    loop = {"mass": 0.3, "damping": 0.8, "friction": 0.0, "delay": 1, "limit": 50.0, "step": 2e-6}
    log = held_log(law, **loop, ticks=3000, outside=shakes)
    found = diagnose(log, device=LINEAR.model_copy(update={key: loop[name] for name, key in FILE_KEYS.items()}))
    moved_m = np.ptp(log.position_m)
    assert 2 * loop["step"] < np.ptp(log.position_m[-300:]) < 0.01 * moved_m
    assert found.verdict == "cannot tell", found.conclusion
    assert found.fit.best.shake_hz == pytest.approx(hertz, rel=1e-2)


@pytest.mark.slow
@pytest.mark.parametrize(("hertz", "travel_m"), [(8.0, 0.003), (15.0, 0.002)])
def test_a_hand_that_shakes_the_device_out_of_a_stable_wall_is_no_delay(hertz, travel_m):
    """The hand leaves the wall in each cycle, which bounds the swing of an unstable loop too."""

    def shakes(tick, position, velocity):
        place = min(0.02 * tick * 1e-3 - 0.005, 0.004) + travel_m * np.sin(2 * np.pi * hertz * tick * 1e-3)
        return 400 * (place - position) - 6 * velocity

    law = lambda _, z, u: -max(1000 * z + 10 * u, 0.0) if z > 0 else 0.0  # noqa: E731
    log = held_log(law, mass=0.27, damping=0.8, friction=0.05, ticks=3000, delay=1, limit=8.0, outside=shakes)
    device = LINEAR.model_copy(update={"mass_kg": 0.12, "damping_ns_per_m": 0.8, "max_force_n": 8.0})
    found = diagnose(log, device=device)
    assert (found.verdict, found.cause) == ("cannot tell", None), found.conclusion
    assert found.fit.best.shake_hz == pytest.approx(hertz, rel=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize("play_n", [0.5, 0.6])
def test_an_amplifier_that_no_model_holds_gets_no_remedy(play_n):
    given = [0.0]

    def follows(force):
        given[0] = min(max(given[0], force - play_n), force + play_n)
        return given[0]

    law = lambda _, z, u: -3000 * z - 6 * u  # noqa: E731
    log = held_log(
        law, mass=0.2, damping=0.5, friction=0.02, ticks=3000, delay=1, start=4e-3, limit=12, given_by=follows
    )
    found = diagnose(log, device=LINEAR.model_copy(update={"max_force_n": 12.0}))
    assert (found.verdict, found.remedies) == ("cannot tell", ())


def test_a_press_that_rests_is_nothing_wrong_and_what_has_no_motion_or_force_is_open_or_not_the_loop():
    time, position, force = logged(HEALTHY, 1.2)
    assert diagnose(Columns("press", time, position, force), device=declared_of(HEALTHY)).verdict == "nothing wrong"
    for still in (Columns("still", time, 0 * position, 0 * force), Columns("free", time, position, 0 * force)):
        assert diagnose(still, device=declared_of(HEALTHY)).verdict == "cannot tell"
    found = diagnose(Columns("shaken", time, 1e-3 * np.sin(2 * np.pi * 17 * time), 0 * time))
    assert found.verdict == "not the loop"


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "seed", "number"), [("stops", 9108, 144), ("shaken", 31, 8), ("resonance", 31, 21)])
def test_bounces_and_a_shaken_or_resonating_device_are_told_apart(kind, seed, number):
    """Bounces were named a resonance, and a device that was shaken, or resonates, a delay."""
    loop, wrong, log = case(kind, seed, number)
    found = diagnose(log, device=declared(loop, wrong))
    assert (found.cause or found.verdict) in {TRUTH.get(kind, kind), "cannot tell"}, found.conclusion
    assert all(held and free for _, held, free in settled(found, wrong, kind))


@pytest.mark.slow
def test_the_interval_of_a_resonance_contains_it_and_its_notch_settles_in_another_simulator():
    loop, wrong, log = case("resonance", 31, 30)
    found = diagnose(log, device=declared(loop, wrong))
    low_hz, high_hz = found.fit.resonance_hz
    assert low_hz < wrong.resonance[0] < high_hz < 1.5 * low_hz
    assert ("notch_hz", True, True) in settled(found, wrong, "resonance")
