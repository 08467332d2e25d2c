"""Each part of a diagnosis against what it is by definition: loops stepped by hand, known swings, known laws."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from avc_casadi.identification.diagnosis import causes as _causes
from avc_casadi.identification.diagnosis import counterfactual as _counterfactual
from avc_casadi.identification.diagnosis import diagnose as _diagnose
from avc_casadi.identification.diagnosis import intended as _intended
from avc_casadi.identification.diagnosis import remedies as _remedies
from avc_casadi.identification.diagnosis import saturation as _saturation
from avc_casadi.identification.diagnosis import verdict as _verdict
from avc_casadi.identification.diagnosis.envelope import line_of
from avc_casadi.identification.diagnosis.evidence import felt
from avc_casadi.identification.diagnosis.hypothesis import (
    Hypothesis,
    at_period,
    growth_of_two_rates,
    limit_of,
    notched_growth,
    worst_mode,
)
from avc_casadi.identification.diagnosis.intended import Declared
from avc_casadi.identification.diagnosis.law import Law, find_law
from avc_casadi.identification.diagnosis.limit_cycle import find_count_limit_cycle
from avc_casadi.identification.diagnosis.log import Log, Ticks, log_of
from avc_casadi.identification.diagnosis.oscillation import Oscillation, TracedOscillation, find_oscillation
from avc_casadi.identification.diagnosis.plant import Search
from avc_casadi.identification.diagnosis.relay import find_switched_force, find_two_rates
from avc_casadi.identification.record import Columns
from avc_casadi.model.device import Device, Resonance
from avc_casadi.model.hands import Hand
from avc_casadi.model.problem import Hands
from avc_casadi.simulation.effects.filters import Notch
from avc_casadi.simulation.population.motions import threshold_m

T = 1e-3
DEVICE = Device(mass_kg=0.1, damping_ns_per_m=0.5, sample_time_s=T, delay_samples=1)
LAW = Law(4000.0, 6.0, 0.0, 0, 0.0, 1e-12, 100)
BOX = Hands(mass_kg=(0.1, 1.0), damping_ns_per_m=(2.0, 20.0), stiffness_n_per_m=(50.0, 500.0))


def log(position, force, encoder=1e-6):
    size, ran = len(position), np.ones(len(position), dtype=bool)
    return Log("log", Ticks(T, 0.0, 0, 0.0, 1), position, np.broadcast_to(force, size), ran, ran, ran, encoder, 0.0)


def swing(first, last, hertz=50.0, size=2e-4, kind="limit cycle", **more):
    found = Oscillation(
        kind, hertz, peak_to_peak_m=size, steps=size / 1e-6, begins_s=T * first, ends_s=T * last, **more
    )
    return TracedOscillation(found, first, last, np.zeros(last), np.ones(last))


TIME = T * np.arange(3000)


def test_a_change_has_the_share_of_the_way_to_rest_that_it_takes_off(monkeypatch):
    """A gain is at half of what it may be... at 0.8 with the change; the stiffness is nearer to its limit."""
    limits = {("now", "stiffness"): 0.5, ("then", "stiffness"): 0.8, ("now", "damping"): 0.1, ("then", "damping"): 0.2}
    monkeypatch.setattr(_causes, "limit_of", lambda answer, _, gain: limits[answer, gain])
    share = _causes._share_of_way("now", "then", LAW, LAW)
    assert share == pytest.approx(1 - math.log(0.8) / math.log(0.5))
    monkeypatch.setattr(_causes, "limit_of", lambda _, __, gain: {"stiffness": 0.9, "damping": 0.3}[gain])
    assert _causes._declared_itself(Hypothesis(DEVICE, None), LAW) == {"stiffness": 1.0}


@pytest.mark.parametrize(("mass", "gone"), [(0.01, True), (0.2, False)])
def test_a_hand_that_is_lighter_than_the_lightest_is_gone(mass, gone):
    answer = Hypothesis(DEVICE, Hand(mass, 0.1, 100.0))
    assert _causes.let_go(answer, Declared.of(DEVICE, BOX, T)) == gone


@pytest.mark.parametrize(
    ("damping", "stiffness", "gone"), [(1.0, 150.0, False), (0.05, 250.0, False), (0.05, 20.0, True)]
)
def test_a_grip_holds_the_device_where_its_spring_or_its_damper_is_that_of_one(damping, stiffness, gone):
    """Its mass is behind it; the loosest of 15 subjects had 0.3 N.s/m and 228 N/m."""
    answer = Hypothesis(DEVICE, Hand(0.0, damping, stiffness))
    assert _causes.let_go(answer, Declared.of(DEVICE, BOX, T)) == gone


@pytest.mark.parametrize(("settled", "share"), [((9, 9), 1.0), ((8, 9), 0.5), ((3, 9), 1 / 3), ((1, 9), 0.0)], ids=str)
def test_a_hand_is_missing_where_the_loop_rests_with_all_of_the_box(settled, share, monkeypatch):
    some, all_ = settled
    growths = np.where(np.arange(all_) < some, -1.0, 1.0)
    monkeypatch.setattr(_causes, "worst_growth_of_hands", lambda *_: growths)
    monkeypatch.setattr(_causes, "_changed", lambda *_: False)
    stiff, found = replace(LAW, stiffness_n_per_m=30000.0), swing(0, 1000).found
    shares = _causes.causes_of(Hypothesis(DEVICE, None), stiff, log(TIME, 1.0), found, Declared.of(DEVICE, BOX, T))
    assert shares.get("let-go", 0.0) == pytest.approx(share)
    assert sum(shares.values()) == pytest.approx(1.0)


def test_a_law_has_no_more_lag_than_was_meant():
    late = replace(LAW, lag=3)
    assert [_causes.shorter(late, meant).lag for meant in (0.0, 1.4, 5.0)] == [0, 1, 3]


def test_a_swing_that_is_far_smaller_is_not_the_same():
    before = Oscillation("limit cycle", peak_to_peak_m=1e-4)
    for share, still in ((1.0, True), (0.5, True), (0.1, False)):
        assert _counterfactual._still(Oscillation("limit cycle", peak_to_peak_m=share * 1e-4), before) == still
    assert not _counterfactual._still(Oscillation("decaying", peak_to_peak_m=1e-4), before)


def test_another_law_is_believed_that_leaves_far_less(monkeypatch):
    fits = []
    monkeypatch.setattr(_diagnose, "fit_plants", lambda *_: fits.append(1) or [])
    judge, declared = SimpleNamespace(relay=lambda *_: "relay"), Declared.of(DEVICE, BOX, T)
    for misfit, told in ((0.004, None), (0.001, "relay")):
        relay = SimpleNamespace(law=SimpleNamespace(misfit=misfit, lag=0))
        monkeypatch.setattr(_diagnose, "find_switched_force", lambda *_, found=relay: found)
        law, made = replace(LAW, misfit=0.01), log(TIME, 1.0)
        assert _diagnose._by_another_law(judge, law, made, None, declared, 0, _diagnose.SILENT) == told
    assert fits == [1]


def test_what_is_felt_is_an_amplitude_over_what_a_hand_detects():
    found = swing(0, 1000, hertz=100.0, size=2e-4)
    assert felt(log(TIME, 1.0), found, Declared.of(DEVICE, BOX, T)) == pytest.approx(
        1e-4 / threshold_m(np.array([100.0]))[0]
    )


def test_a_filter_of_a_velocity_keeps_its_cut_off_at_another_rate():
    law = replace(LAW, keep=math.exp(-2 * math.pi * 80.0 * T))
    assert law.filter_hz(T) == pytest.approx(80.0)
    other, slower = at_period(Hypothesis(DEVICE, None), law, 2 * T)
    assert other.device.sample_time_s == 2 * T
    assert slower.filter_hz(2 * T) == pytest.approx(80.0)


@pytest.mark.parametrize("slow", ["spring", "damper"])
def test_a_loop_of_two_rates_grows_as_it_does_stepped_by_hand(slow):
    """A mass, its forces held over each tick; the slow part is new every fourth one."""
    mass, ticks, k, b = 0.1, 4, 2000.0, 5.0
    device = Device(mass_kg=mass, damping_ns_per_m=0.0, sample_time_s=T, delay_samples=0)
    found = growth_of_two_rates(
        Hypothesis(device, None), replace(LAW, stiffness_n_per_m=k, damping_ns_per_m=b), slow, ticks, 0
    )
    x, v, before, framed, speed, grown = 1.0, 0.0, 1.0, 1.0, 0.0, []
    for tick in range(4000):
        if tick % ticks == 0:
            speed, framed = (x - framed) / (ticks * T), x
            size = math.hypot(x, v * T)
            grown.append(math.log(size))
            x, v, before, framed, speed = (one / size for one in (x, v, before, framed, speed))
        force = k * (framed if slow == "spring" else x) + b * ((x - before) / T if slow == "spring" else speed)
        before = x
        x, v = x + v * T - force * T**2 / (2 * mass), v - force * T / mass
    assert found == pytest.approx(np.mean(grown[500:]) / (ticks * T), abs=0.5)


def test_a_delay_within_a_range_is_anywhere_in_it():
    ranged = Device(
        mass_kg=0.1, damping_ns_per_m=0.5, sample_time_s=T, delay_samples=2, range={"delay_samples": (0, 6)}
    )
    random = np.random.default_rng(1)
    drawn = random.uniform(0, 6, 100_000) + 0.15 * random.normal(size=100_000)
    assert Declared.of(ranged, BOX, T).delay_prior() == pytest.approx((drawn.mean(), drawn.std()), rel=0.02)


@pytest.mark.parametrize("keep", [0.0, 0.6])
def test_force_over_position_of_a_law_is_that_of_its_filter(keep):
    z = np.exp(2j * np.pi * 40.0 * T)
    law = replace(LAW, keep=keep)
    speed = (1 - keep) / (1 - keep / z) * (1 - 1 / z) / T
    found = _intended._dynamic(law.rendering(T), 2 * math.pi * 40.0 * T)
    assert found == pytest.approx(LAW.stiffness_n_per_m + LAW.damping_ns_per_m * speed)


def test_positions_whose_step_is_far_from_the_declared_one_are_in_another_unit():
    device = DEVICE.model_copy(update={"encoder_resolution_m": 1e-5})
    none, declared = Oscillation("none"), Declared.of(device, BOX, T)
    for step, told in ((1e-2, "1000 times too large (mm read as m"), (1e-8, "1000 times too small"), (1e-5, "")):
        said = _intended.other_unit(log(TIME, 1.0, encoder=step), none, None, declared, None, None)
        assert told in said
        assert bool(said) == bool(told)


def test_forces_at_the_limit_tell_nothing_of_the_law_that_they_were_cut_from():
    position = 1e-3 * (1 + np.sin(50 * TIME)) + 1e-4 * np.sin(173 * TIME)
    speed = np.diff(position, prepend=position[0]) / T
    force = np.clip(1500.0 * position + 3.0 * speed, -2.0, 2.0)
    assert np.mean(force == 2.0) > 0.2
    found = find_law(log(position, force), 2.0)
    assert (found.stiffness_n_per_m, found.damping_ns_per_m) == pytest.approx((1500.0, 3.0), rel=1e-3)


@pytest.mark.parametrize(("early", "found"), [(3, True), (4, False)])
def test_what_goes_less_far_in_its_later_cycles_is_no_limit_cycle(early, found):
    cycles = [*(early,) * 10, *(3,) * 8]
    counts = np.concatenate([np.repeat([0, size], 10) for size in cycles] + [np.zeros(5, dtype=int)])
    position = 1e-5 * counts
    assert (find_count_limit_cycle(log(position, 1.0 + 1e3 * position, encoder=1e-5)) is not None) == found


def test_a_log_tells_for_how_long_forces_are_held_and_how_many_ticks_were_missed():
    position = 1e-3 * np.sin(30 * TIME)
    held = np.repeat((1000.0 * position)[::2], 2)
    assert log_of(Columns("log", TIME, position, held))[0].ticks.period_s == pytest.approx(2 * T)
    kept = np.delete(np.arange(3000), [700, 1500, 1501, 2000])
    ticks = log_of(Columns("log", TIME[kept], position[kept], (1000.0 * position)[kept]))[0].ticks
    assert ticks.longest_gap == 2
    assert ticks.missed_share == pytest.approx(4 / 3000)


def test_a_line_has_the_amplitude_and_the_frequency_of_its_sine():
    amplitude, hertz, share = line_of(3e-5 * np.sin(2 * np.pi * 52.0 * TIME[:500]), T)
    assert amplitude == pytest.approx(3e-5, rel=0.03)
    assert hertz == pytest.approx(52.0, abs=0.3)
    assert share > 0.99


@pytest.mark.parametrize(("rate", "kind"), [(0.0, "limit cycle"), (1.0, "growing")])
def test_a_swing_that_is_larger_later_grows(rate, kind):
    position = 1e-3 * np.exp(rate * (TIME - TIME[-1])) * np.sin(2 * np.pi * 20.0 * TIME)
    found = find_oscillation(log(position, 1000.0 * position)).found
    assert found.kind == kind
    assert found.frequency_hz == pytest.approx(20.0, abs=0.3)


def test_a_slow_swing_is_told_in_its_own_time():
    time = T * np.arange(20_000)
    position = 5e-3 * np.sin(2 * np.pi * 2.0 * time)
    found = find_oscillation(log(position, 1000.0 * position)).found
    assert found.kind == "limit cycle"
    assert found.frequency_hz == pytest.approx(2.0, abs=0.05)
    assert found.ends_s == pytest.approx(20.0, abs=1.0)


def test_the_lag_before_a_logged_force_is_part_of_the_declared_delay():
    device = DEVICE.model_copy(update={"delay_samples": 3})
    declared = Declared.of(device, BOX, T)
    begins = [Search((), log(TIME, 1.0), declared, lag, False, "none", False, 50.0)._middle[0] for lag in (0, 1, 5)]
    assert begins == pytest.approx([3.0, 2.0, 0.0])


@pytest.mark.parametrize(("mode", "against"), [("none", 0.0), ("declared", 0.0), ("found", 12.0)])
def test_a_resonance_that_nobody_declared_has_to_be_worth_its_three_numbers(mode, against, monkeypatch):
    """Odds of e^4 against each of them, beside what is left and what the log leaves of what was possible."""
    device = DEVICE.model_copy(update={"resonance": Resonance(frequency_hz=90.0, damping_ratio=0.05, mass_ratio=0.4)})
    search = Search((), log(TIME, 1.0), Declared.of(device, BOX, T), 0, False, mode, False, 50.0)
    point = search._middle
    solved = SimpleNamespace(x=point, jac=np.eye(point.size), cost=3.0)
    monkeypatch.setattr(search, "_solve", lambda *_: solved)
    monkeypatch.setattr(search, "left", lambda _: {0: np.ones(4)})
    found = search.finish(point, None, 1.0, 0, 0)
    assert found.cost == pytest.approx(3.0 + found.volume + against)


@pytest.mark.parametrize(("cause", "verdict"), [("delay", "cannot tell"), ("stiffness", "named")])
def test_a_tremor_is_taken_for_a_delay_and_for_nothing_else(cause, verdict, monkeypatch):
    """A fifth of a millimetre at 9 Hz in a loop that a delay explains: a hand trembles so of its own."""
    found = swing(0, 3000, hertz=9.0, size=2e-4)
    measured = SimpleNamespace(frequency_hz=9.0, growth_per_s=0.1, misfit=1.0)
    measured.delay_samples, measured.declared_delay_samples, measured.delay_error_samples = 1.2, 1.0, 0.02
    plain = {"settled": lambda asked, *_: asked, "unlimited": lambda *_: False, "_together": lambda _: None}
    plain |= {"shares_of": lambda _: {cause: 1.0}, "_measured": lambda *_: measured, "remedies_of": lambda *_: ()}
    plain |= {"_likeliest": lambda *_: (None, SimpleNamespace(at_end=())), "measured_sentences": lambda *_: []}
    plain |= {"named_sentence": lambda *_: "named", "deciding_log": lambda *_, **__: ""}
    for name, one in plain.items():
        monkeypatch.setattr(_verdict, name, one)
    judge = _verdict.Judge(log(TIME, 1.0), found, LAW, Declared.of(DEVICE, BOX, T), [], [])
    told = judge.judged(LAW, [], [])
    assert told.verdict == verdict
    assert ("a hand trembles" in told.conclusion) == (cause == "delay")


def test_a_force_that_a_position_switches_has_half_of_its_swing():
    position = 1e-4 * np.sin(2 * np.pi * 30.0 * TIME + 0.1)
    found = find_switched_force(log(position, np.where(position > 0, 1.5, -1.5)), swing(0, 3000), None, 0.0)
    assert (found.force_n, found.by) == (pytest.approx(1.5), "position")


@pytest.mark.parametrize("ticks", [6, 17])
def test_a_damper_of_every_frame_beside_a_spring_of_every_tick_is_found(ticks):
    position = 1e-3 * np.sin(2 * np.pi * 9.0 * TIME) + 2e-4 * np.sin(2 * np.pi * 31.0 * TIME)
    frames = position[::ticks]
    speed = np.repeat(np.diff(frames, prepend=frames[0]) / (ticks * T), ticks)[: len(position)]
    found = find_two_rates(log(position, 1500.0 * position + 4.0 * speed))
    assert (found.slow, found.ticks) == ("damper", ticks)
    assert found.law.stiffness_n_per_m == pytest.approx(1500.0, rel=1e-3)


UNSTABLE = Hypothesis(DEVICE, Hand(0.1, 2.0, 200.0))
STIFF = Law(9000.0, 6.0, 0.0, 0, 0.0, 1e-12, 100)


def test_a_gain_that_cures_lies_a_reserve_below_its_limit():
    (cure,) = _remedies._gain("stiffness", UNSTABLE, STIFF)
    limit = limit_of(UNSTABLE, STIFF, "stiffness") * STIFF.stiffness_n_per_m
    assert limit < STIFF.stiffness_n_per_m
    assert cure.value == pytest.approx(0.8 * limit)
    assert cure.rests
    softer = replace(STIFF, stiffness_n_per_m=cure.value)
    assert worst_mode(UNSTABLE, softer).growth_per_s == pytest.approx(cure.growth_per_s)


def test_the_filter_that_is_told_is_the_one_with_which_the_loop_decays_fastest():
    law = replace(STIFF, keep=math.exp(-2 * math.pi * 20.0 * T))
    (cure,) = _remedies._quicker(UNSTABLE, law)
    keeps = [math.exp(-2 * math.pi * 20.0 * times * T) for times in (2, 4, 8, 16)]
    growths = [worst_mode(UNSTABLE, replace(law, keep=keep)).growth_per_s for keep in keeps]
    assert cure.growth_per_s == pytest.approx(min(growths))
    assert max(growths) > min(growths) + 1.0


def test_no_other_notch_is_better_at_its_frequency_and_a_tenth_beside():
    (cure,) = _remedies._notch(UNSTABLE, STIFF)
    swings = worst_mode(UNSTABLE, STIFF).frequency_hz
    for turn in (0.6, 0.8, 1.0, 1.25, 1.6):
        for depth in (0.05, 0.3):
            for width in (0.5, 1.0, 2.0):
                beside = [Notch(turn * by * swings, depth, width) for by in (0.9, 1.0, 1.1)]
                worst = max(notched_growth(UNSTABLE, STIFF, one) for one in beside)
                assert worst >= cure.growth_per_s - 1e-9


@pytest.mark.parametrize(("along", "feeds"), [(1.0, True), (-1.0, False)])
def test_a_force_along_the_motion_feeds_a_swing(along, feeds):
    """As large as the damper of the device, which takes as much."""
    position = 1e-3 * np.sin(2 * np.pi * 20.0 * TIME)
    device = DEVICE.model_copy(update={"delay_samples": 0})
    speed = np.diff(position, append=position[-1]) / T
    made = log(position, -along * DEVICE.damping_ns_per_m * speed)
    assert _saturation.fed(made, swing(0, 3000, hertz=20.0), device) == feeds


@pytest.mark.parametrize(("seconds", "too_long"), [(1, False), (2, True)])
def test_a_loop_outgrows_a_few_counts_in_the_time_that_it_takes(seconds, too_long, monkeypatch):
    monkeypatch.setattr(_saturation, "unlimited", lambda *_: True)
    monkeypatch.setattr(_saturation, "worst_mode", lambda *_, **__: SimpleNamespace(growth_per_s=3.0))
    found = swing(0, 1000 * seconds, size=2e-6).found
    assert _saturation.outgrows(None, LAW, log(TIME, 1.0), found, None) == too_long


@pytest.mark.parametrize("rate", [-2.0, 0.5, 3.0])
def test_the_growth_of_a_swing_is_the_rate_of_its_envelope(rate):
    found = replace(swing(0, 2000), envelope_m=np.exp(rate * TIME[:2000]))
    assert _verdict._growth(found, T) == (pytest.approx(rate, rel=0.01), pytest.approx(2.0))
