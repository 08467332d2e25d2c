"""Parts of a diagnosis against what they are by definition, and what the verb takes and writes."""

from dataclasses import replace

import numpy as np
import pytest
from buzzing_device import Buzzing, declared_of, logged
from held_device import held_log
from hypothesis import given, settings
from hypothesis import strategies as st
from quick import first
from scipy.signal import find_peaks

import avc_casadi as avc
from avc_casadi.diagnose.causes import diagnose
from avc_casadi.diagnose.law import FittedLaw, find_law
from avc_casadi.diagnose.mass import apparent_mass_kg
from avc_casadi.diagnose.oscillation import Oscillation, find_oscillation, log_of
from avc_casadi.diagnose.plant import Hypothesis, IntendedLaw, growth
from avc_casadi.diagnose.remedies import LoggedScene
from avc_casadi.diagnose.steady import levels_off
from avc_casadi.diagnose.structure import PlantStructure
from avc_casadi.diagnose.windows import LogWindow
from avc_casadi.diagnose.work import limited, work_w
from avc_casadi.identification.log import Columns
from avc_casadi.model.device import Device
from avc_casadi.model.hands import Hand
from avc_casadi.model.problem import Hands

HEALTHY = Buzzing(encoder=5e-6, stiffness=3000.0, damper=12.0)
SAMPLES = 1500


def columns(loop, seconds=1.5):
    return Columns("log", *logged(loop, seconds))


def law_of(log, limit=None):
    return find_law(log, find_oscillation(log, limit), limit, 0.0)


def answer_of(loop):
    device = declared_of(replace(loop, limit=50.0)).model_copy(update={"encoder_resolution_m": 0.0})
    return Hypothesis(device, Hand(loop.hand_mass, loop.hand_damping, loop.hand_stiffness))


@settings(max_examples=20, deadline=None)
@given(
    stiffness=st.floats(200.0, 20000.0),
    damper=st.floats(0.0, 80.0),
    keep=st.sampled_from([0.0, 0.3, 0.8]),
    lag=st.integers(0, 4),
    limit=st.sampled_from([5.0, 50.0]),
)
def test_the_law_is_read_from_the_log(stiffness, damper, keep, lag, limit):
    loop = replace(HEALTHY, stiffness=stiffness, damper=damper, keep=keep, lag=float(lag), limit=limit)
    log, _ = log_of(columns(loop))
    law = law_of(log, limit)
    if law is None or law.samples < 100:
        return
    assert law.explains
    assert law.stiffness_n_per_m == pytest.approx(stiffness, rel=1e-3)
    if damper > 1:
        assert law.lag == lag
        assert law.damping_ns_per_m == pytest.approx(damper, rel=1e-3)
        assert law.keep == pytest.approx(keep, abs=1e-3)


@pytest.mark.parametrize(("slow", "lag", "ticks"), first([("spring", 1, 8), ("damper", 0, 5)]))
def test_the_part_that_is_computed_once_a_frame_is_found_with_both_gains(slow, lag, ticks):
    """A spring of 600 N/m and a damper of 4 N.s/m, one of them held over frames."""
    time = np.arange(800) * 1e-3
    position = sum(1e-3 * np.sin(2 * np.pi * hertz * time + hertz) for hertz in (3.1, 7.3, 12.7))
    seen = np.concatenate([np.full(lag, position[0]), position[: time.size - lag]])
    frame = np.arange(time.size) // ticks * ticks
    if slow == "spring":
        force = 600.0 * seen[frame] + 4.0 * np.diff(seen, prepend=seen[0]) / 1e-3
    else:
        force = 600.0 * seen + 4.0 * (seen[frame] - seen[np.maximum(frame - ticks, 0)]) / (ticks * 1e-3)
    law = law_of(log_of(Columns("frames", time, position, -force))[0])
    assert law.frames is not None
    assert (law.frames.slow, law.frames.ticks) == (slow, ticks)
    assert law.lag == lag
    assert (law.stiffness_n_per_m, law.damping_ns_per_m) == pytest.approx((600.0, 4.0), rel=1e-3)


@settings(max_examples=15, deadline=None)
@given(
    hertz=st.floats(12.0, 200.0),
    steps=st.floats(3.0, 200.0),
    growth_per_s=st.sampled_from([0.0, 4.0]),
    seed=st.integers(0, 9),
)
def test_frequency_and_amplitude_of_a_swing_are_measured(hertz, steps, growth_per_s, seed):
    random = np.random.default_rng(seed)
    step, time = 1e-5, np.arange(SAMPLES) * 1e-3
    swing = steps * step / 2 * np.exp(growth_per_s * (time - time[-1])) * np.sin(2 * np.pi * hertz * time)
    position = step * np.round((2e-3 + 1e-3 * time + swing + 0.1 * step * random.standard_normal(SAMPLES)) / step)
    log, _ = log_of(Columns("sine", time, position, np.ones(SAMPLES)))
    found = find_oscillation(log, None)
    assert found.sustained
    assert found.frequency_hz == pytest.approx(hertz, rel=0.05, abs=0.5)
    # The median of its last quarter, in which it grows by up to 40 per cent.
    assert found.peak_to_peak_m == pytest.approx(steps * step, rel=0.6 if growth_per_s else 0.35, abs=2 * step)


@pytest.mark.parametrize("hertz", [15.0, 20.0, 30.0, 40.0])
@pytest.mark.parametrize(("kept", "falls_by"), [(0.3, 4.0), (0.2, 5.0)])
def test_a_swing_that_falls_to_a_size_that_it_keeps_is_a_limit_cycle_from_its_last_third_on(hertz, kept, falls_by):
    """Twelve cycles, over which ln of what is above that size falls by so much: it is still seen to fall."""
    size = round(12 / hertz / 1e-3)
    time = np.arange(size) * 1e-3
    envelope = kept + (1 - kept) * np.exp(-falls_by * time / time[-1])
    position = 1e-6 * np.round(1e3 * (2 + envelope * np.sin(2 * np.pi * hertz * time)))
    found = find_oscillation(log_of(Columns("swing", time, position, np.ones(size)))[0], None)
    assert found.kind == "limit cycle"
    # To the nearest turning point, of which a cycle has two.
    assert found.first == pytest.approx(2 / 3 * size, abs=0.5 / hertz / 1e-3)
    assert envelope[found.first] < 1.2 * kept


@settings(max_examples=8, deadline=None)
@given(stiffness=st.floats(2000.0, 30000.0), damper=st.floats(2.0, 60.0), delay=st.floats(0.01, 4.0))
def test_the_loop_model_grows_as_the_simulator_does(stiffness, damper, delay):
    loop = Buzzing(encoder=0.0, stiffness=stiffness, damper=damper, delay=delay, two_sided=1.0, limit=1e15, end=0.0)
    log, _ = log_of(columns(loop))
    rate = growth(answer_of(loop), law_of(log))
    position = log.position_m
    if 8 < rate < 60:
        peaks = find_peaks(position)[0]
        peaks = peaks[position[peaks] < 1e9][-12:]
        slope, _ = np.polyfit(log.time_s[peaks], np.log(position[peaks]), 1)
        assert slope == pytest.approx(rate, rel=0.05, abs=0.5)
    elif rate < -8:
        assert np.ptp(position[1100:]) < np.ptp(position[700:1000])


@pytest.mark.parametrize(("delay", "feeds"), [(0.0, False), (2.0, True)])
def test_work_is_that_of_the_force_as_it_acts(delay, feeds):
    """A spring and damper take energy from a given motion; late by enough they feed it."""
    time = 1e-3 * np.arange(3000)
    position = 1e-3 * np.sin(2 * np.pi * 20 * time)
    force = 1000 * position + 1.5 * np.diff(position, prepend=0.0) / 1e-3
    log, _ = log_of(Columns("log", time, position, -force))
    one = Hypothesis(Device.model_validate({"mass_kg": 0.1, "damping_ns_per_m": 1.0, "delay_samples": delay}), None)
    found = work_w(log, find_oscillation(log, None), one)
    assert (found > 0) == feeds
    late = np.concatenate([np.zeros(int(delay)), force])[: force.size]
    whole = slice(500, 2500)
    assert found == pytest.approx(-np.sum(late[whole] * np.diff(position)[whole]) / 2.0, rel=0.02)


@pytest.mark.parametrize(("limit_n", "bounded"), [(None, False), (0.8, True), (5.0, False)])
def test_a_steady_swing_below_the_force_limit_in_contact_all_the_time_is_not_limited(limit_n, bounded):
    time = 1e-3 * np.arange(3000)
    position = 1e-3 * np.sin(2 * np.pi * 20 * time) + 2e-3
    force = 1000 * position - 2.0
    force = np.clip(force, -(limit_n or np.inf), limit_n or np.inf)
    log, _ = log_of(Columns("log", time, position, -force))
    values = {"mass_kg": 0.1, "damping_ns_per_m": 1.0, "max_force_n": limit_n}
    device = Device.model_validate({key: value for key, value in values.items() if value is not None})
    for hypothesis in (Hypothesis(device, None), Hypothesis(device.model_copy(update={"max_force_n": None}), None)):
        swing = replace(find_oscillation(log, limit_n), contact_share=1.0)
        assert limited(log, swing, law_of(log, limit_n), hypothesis) == bounded


@pytest.mark.parametrize("missed", first([0.2, 0.02, 0.5]))
@pytest.mark.parametrize("share", first([0.08, 0.04, 0.0]))
def test_missing_ticks_are_counted_beside_a_clock_that_scatters(missed, share):
    random = np.random.default_rng(7)
    time = np.append(0.0, np.cumsum(4e-3 * (1 + share * random.standard_normal(3000))))
    kept = np.append(True, random.random(3000) >= missed)
    kept[-1] = True
    log, _ = log_of(Columns("log", time[kept], np.sin(time[kept]), np.cos(time[kept])))
    assert log.missed_share == pytest.approx(1 - kept.mean(), abs=0.002)


@pytest.mark.parametrize("turns", [(35, 50), (40, 40), (36, 48)])
def test_a_relay_is_switched_not_held_where_its_turns_share_a_factor(turns):
    """Each number of ticks between two turns is a multiple of 5, 40 or 12, and the relay is computed in every tick."""
    side = np.tile(np.repeat([1.0, -1.0], turns), 24)
    position = 1e-5 * np.cumsum(side / np.where(side > 0, *turns))
    log, _ = log_of(Columns("log", np.arange(side.size) * 1e-3, position, -5.0 * side))
    assert (log.hold, log.period_s) == (1, pytest.approx(1e-3))


def test_a_force_that_seems_reversed_is_no_verdict_and_an_encoder_that_is_stuck_is_refused():
    """A loop whose force has the wrong sign, or a log that counts the force the other way."""
    log = columns(HEALTHY)
    flipped = replace(log, force_n=-log.force_n)
    found = diagnose(flipped)
    assert (found.verdict, found.candidates) == ("cannot tell", ("sign",))
    assert diagnose(flipped, flip_force=True).verdict == "nothing wrong"
    with pytest.raises(avc.InputError, match="never changes"):
        diagnose(replace(log, position_m=0 * log.position_m))


def test_a_motion_that_is_fastest_before_any_force_acts_is_answered():
    """A handle that is let go at its fastest, with a force that comes six samples late."""
    time_s = np.arange(SAMPLES) * 1e-3
    position_m = 5e-3 * np.exp(-20 * time_s)
    log = Columns("log", time_s, np.round(position_m / 5e-6) * 5e-6, -30.0 * position_m)
    device = Device.model_validate({"mass_kg": 0.1, "damping_ns_per_m": 1.0, "sample_time_s": 1e-3, "delay_samples": 6})
    assert diagnose(log, device=device).verdict in {"nothing wrong", "cannot tell"}


@pytest.mark.parametrize(("kept", "more", "ratio"), [(1.0, 3.0, 0.5), (1.0, 0.8, 0.6), (0.3, 4.0, 0.4)])
def test_a_swing_that_falls_to_a_size_that_it_keeps_levels_off(kept, more, ratio):
    assert levels_off(kept + more * ratio ** np.arange(15)) == 5


@pytest.mark.parametrize(
    "sizes", [0.8 ** np.arange(15), 0.97 ** np.arange(15), 1.0 - 0.06 * np.arange(15), 1 + np.arange(15), np.ones(8)]
)
def test_a_swing_that_dies_away_by_a_damper_or_by_friction_or_grows_does_not_level_off(sizes):
    assert levels_off(sizes) is None


@pytest.mark.parametrize(
    ("period_s", "scale", "words"),
    [(1e-3, 1.0, ()), (5e-4, 1.0, ("device.sample_time_s is 0.5 ms",)), (1e-3, 1e3, ("--units position=mm",))],
)
def test_a_log_of_another_rate_or_unit_than_its_device_says_so(period_s, scale, words):
    log = columns(Buzzing())
    log = replace(log, position_m=scale * log.position_m)
    found = diagnose(log, device=declared_of(Buzzing()).model_copy(update={"sample_time_s": period_s}))
    assert len(found.notes) == len(words)
    assert all(word in note for word, note in zip(words, found.notes, strict=True))


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("mass_kg", [0.05, 0.4])
@pytest.mark.parametrize("sign", [1, -1])
def test_the_mass_that_a_log_shows_is_that_of_the_simulated_device(mass_kg, known, sign):
    """A spring moves it from rest; with a force that is logged the other way the mass is negative."""
    loop = {"mass": mass_kg, "damping": 0.5, "friction": 0.0, "step": 1e-6, "start": 5e-3, "ticks": 600}
    log = held_log(lambda _, z, u: -300 * z - 2 * u, **loop)
    device = Device.model_validate({"mass_kg": 0.2, "damping_ns_per_m": 0.5})
    found = apparent_mass_kg(log_of(replace(log, force_n=sign * log.force_n))[0], device, known=known)
    assert found == pytest.approx(sign * mass_kg, rel=0.03)


LIGHT = {"mass_kg": 0.2, "damping_ns_per_m": 0.8, "delay_samples": 1, "max_force_n": 50.0}


def scene_of(ticks=1500):
    """A swing of 2 mm about the place where no force acts, without encoder steps and noise."""
    swing = Oscillation("limit cycle", 0, ticks, np.zeros(ticks), np.zeros(ticks), 7.0, 2e-3, 2.0)
    return LoggedScene(swing, 0.0, 0.0, 0.0, one_sided=False, encoder_m=0.0, noise_m=0.0, limit_n=50.0)


def fitted(stiffness, damping, keep=0.0):
    return FittedLaw(stiffness, damping, keep, lag=0.0, offset_n=0.0, misfit=0.0, samples=1500)


@pytest.mark.parametrize("keep", [0.0, 0.7])
def test_a_remedy_is_played_as_a_simulator_of_plain_steps_moves(keep):
    filtered = [0.0]

    def law(_, seen, speed):
        filtered[0] = keep * filtered[0] + (1 - keep) * speed
        return -400.0 * seen - 3.0 * filtered[0]

    log = held_log(law, mass=0.2, damping=0.8, friction=0.0, delay=1, start=1e-3, step=1e-9, limit=50.0, ticks=400)
    played, _ = scene_of().play(Hypothesis(Device.model_validate(LIGHT), None), fitted(400.0, 3.0, keep))
    assert np.abs(played[:400] - log.position_m).max() < 1e-5


def test_the_likeliest_device_alone_has_to_settle_in_a_second_and_every_one_has_to_be_stable():
    """Rates of -(b + b_d - k (delay + half a tick))/(2 m): -8, -0.8 and +3 per s, where ln 0.02 a second is -3.9."""
    light = Hypothesis(Device.model_validate(LIGHT), None)
    heavy, late = light.vary(mass_kg=2.0), light.vary(delay_samples=12.0)
    scene, law = scene_of(), fitted(400.0, 3.0)
    assert scene.rests([light, heavy], law).settles
    assert not scene.rests([heavy, light], law).settles
    assert not scene.rests([light, heavy, late], law).settles


def test_free_flights_between_stops_leave_no_residual():
    """A device that slows down by its damper and bounces off two stops, each time at another speed."""
    device = Device.model_validate({"mass_kg": 0.1, "damping_ns_per_m": 0.8, "delay_samples": 1})
    rate, period, stop = 0.8 / 0.1, 1e-3, 0.01
    position = []
    for number, speed in enumerate((0.9, 0.6, 0.8, 0.5)):
        flight = speed / rate * (1 - np.exp(-rate * period * np.arange(200)))
        flight = flight[flight < 2 * stop] - stop
        # In contact for three ticks.
        position += [*((-1) ** number * flight), *[(-1) ** number * 1.1 * stop] * 3]
    x = np.array(position)
    window = LogWindow(x[0], x - x[0], np.zeros(x.size + 20), np.zeros(x.size), np.ones(x.size, dtype=bool),
                       np.ones((x.size, 1)))  # fmt: skip
    free = PlantStructure(
        IntendedLaw(device, known=True, hands=Hands()), period, hand=False, encoder_at=None, names=("delay",),
        middle=np.ones(1), spread=np.ones(1), most_delay=14.0,
    )  # fmt: skip
    point = np.ones(1)
    assert replace(free, stops=(-stop, stop)).rms(point, [window])[0] < 1e-6 * stop
    assert free.rms(point, [window])[0] > 0.1 * stop
