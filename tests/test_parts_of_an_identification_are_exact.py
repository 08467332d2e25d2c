"""Each part of an identification against what it is by definition: responses, refits, physics in fine steps."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.identification import device as _device
from avc_casadi.identification import estimates as _estimates
from avc_casadi.identification import lag_vs_resonance as _lag
from avc_casadi.identification import select as _select
from avc_casadi.identification import selection as _selection
from avc_casadi.identification.assumed_mass_ratio import at_the_other_side
from avc_casadi.identification.encoder import encoder_step_m, last_went
from avc_casadi.identification.fit import Block, Fit, Window, best_observer
from avc_casadi.identification.frequency import Response, held_guess, measured_response
from avc_casadi.identification.identifiability import cannot_tell
from avc_casadi.identification.initial_guess import first_guess, play_guess_m
from avc_casadi.identification.linear import linear_derivatives, linear_step, taps_of
from avc_casadi.identification.log_consistency import check_against
from avc_casadi.identification.model import Estimate, Identification, of_the_turn
from avc_casadi.identification.predictor import Observer, Predictor
from avc_casadi.identification.read import read_columns
from avc_casadi.identification.record import Columns, Record, shortened
from avc_casadi.identification.repair import filled, wrapped
from avc_casadi.identification.selection import Selection
from avc_casadi.identification.terms import LOOP_DAMPING, LOOP_RATIO, PARAMETERS, Structure
from avc_casadi.identification.uncertainty import Trial, held_out, spread_of
from avc_casadi.identification.units import Layout
from avc_casadi.model.device import Device

T = 1e-3


@pytest.mark.parametrize("layed", [np.ascontiguousarray, np.asfortranarray, np.transpose])
def test_a_matrix_is_read_however_it_is_stored(layed, tmp_path):
    """By rows, by columns, or with a row for each quantity."""
    time = T * np.arange(400)
    rows = np.stack([time, 1e-3 * np.sin(9 * time), np.cos(9 * time)], axis=1)
    path = tmp_path / "log.npy"
    np.save(path, layed(rows))
    layout = Layout({"time": 1, "position": 2, "force": 3}, {"time": "s", "position": "m", "force": "n"})
    (found,) = read_columns(path, layout)
    np.testing.assert_array_equal(np.stack([found.time_s, found.position_m, found.force_n], axis=1), rows)


def test_a_spring_on_the_other_side_of_a_resonance_moves_the_motor_alike():
    mass, share, hertz, spring = 0.2, 0.3, 40.0, 900.0
    values = {"mass_kg": mass, "resonance.mass_ratio": share, "resonance.frequency_hz": hertz}
    structure = Structure(("base", "resonance", "stiffness"), {}, {})
    fit = SimpleNamespace(structure=structure, values=values | {"stiffness_n_per_m": spring})
    other = at_the_other_side(fit)

    def motor(mass, share, hertz, at_motor, at_handle, s):
        m, h = (1 - share) * mass, share * mass
        between = (2 * np.pi * hertz) ** 2 / (1 / m + 1 / h)
        handle = h * s**2 + between + at_handle
        return handle / ((m * s**2 + between + at_motor) * handle - between**2)

    s = 2j * np.pi * np.array([0.5, 3.0, 20.0, 60.0, 200.0])
    told = [other[key] for key in ("mass_kg", "resonance.mass_ratio", "resonance.frequency_hz", "stiffness_n_per_m")]
    expected = motor(mass, share, hertz, 0.0, spring, s)
    np.testing.assert_allclose(motor(*told, 0.0, s), expected, rtol=1e-9)


def test_ranges_hold_both_directions_and_every_lag_of_the_amplifier():
    key = "damping_asymmetry_ns_per_m"
    found = SimpleNamespace(estimates={key: Estimate(key, "N.s/m", 0.2, -0.1, 0.5, 0.95, "")})
    ranges = {"damping_ns_per_m": (1.0, 2.0)}
    _device._widened(found, {"damping_ns_per_m": 1.5}, ranges)
    assert ranges["damping_ns_per_m"] == pytest.approx((0.5, 2.5))
    # A lag of 1/(2 pi f T) samples, f somewhere between 100 and 200 Hz.
    least, lag, most = (1 / (2 * math.pi * hertz * T) for hertz in (200.0, 150.0, 100.0))
    device = {"sample_time_s": T, "delay_samples": 4.0, "amplifier_bandwidth_hz": 150.0, "amplifier_order": 1}
    ranges = {"delay_samples": (3.5, 4.5), "amplifier_bandwidth_hz": (100.0, 200.0)}
    sources = {"delay_samples": {"source": "log"}}
    _device._without_lag(SimpleNamespace(estimates={"delay_samples": None}), device, ranges, sources, [])
    assert device["delay_samples"] == pytest.approx(4.0 - lag, rel=1e-4)
    assert ranges["delay_samples"] == pytest.approx((3.5 - most, 4.5 - least), rel=1e-4)


def test_the_step_of_an_encoder_is_the_largest_lattice_of_its_readings():
    time = T * np.arange(4000)
    position = np.round(np.sin(5 * time) * 3e-3 / 2e-5) * 2e-5
    assert encoder_step_m([Record("log", T, position, np.zeros(4000))]) == pytest.approx(2e-5, rel=1e-6)


def behind_play(play):
    """A mass that swings, and what an encoder behind a play measures of it."""
    time = T * np.arange(8000)
    mass = 3e-3 * np.sin(2 * np.pi * 3.0 * time)
    seen, at = np.empty(8000), 0.0
    for sample, here in enumerate(mass):
        at = min(max(at, here - play / 2), here + play / 2)
        seen[sample] = at
    return time, mass, np.round(seen / 1e-6) * 1e-6


def test_what_play_hides_of_a_mass_is_half_of_it_to_the_side_to_which_it_went():
    play = 2e-4
    _, mass, seen = behind_play(play)
    way = last_went(seen, 1e-6)
    left = (seen + play / 2 * way - mass)[200:]
    assert np.sqrt(np.mean(left**2)) < 0.1 * play / 2
    assert np.abs(left).max() < 0.5 * play


def test_the_guess_of_play_is_all_of_it():
    """A mass and a damper on a known motion: the force that it takes, held over each sample."""
    play, mass_kg, damping = 2e-4, 0.1, 2.0
    time, _, seen = behind_play(play)
    rate, middle = 2 * np.pi * 3.0, time + T / 2
    force = 3e-3 * (damping * rate * np.cos(rate * middle) - mass_kg * rate**2 * np.sin(rate * middle))
    record = Record("log", T, seen, force)
    assert play_guess_m([record], [last_went(seen, 1e-6)], 0.0) == pytest.approx(play, rel=0.25)


@pytest.mark.parametrize("delay", [0, 3])
def test_a_search_begins_at_the_delay_of_the_force(delay):
    time = T * np.arange(6000)
    rates, phases = 2 * np.pi * np.array([1.3, 3.1, 7.7, 13.0]), np.array([0.0, 1.0, 2.0, 4.0])
    x, v, a = (
        sum(
            1e-2 / rate * np.imag((1j * rate) ** order * np.exp(1j * (rate * at + phase)))
            for rate, phase in zip(rates, phases, strict=True)
        )
        for order, at in ((0, time), (1, time + (delay + 0.5) * T), (2, time + (delay + 0.5) * T))
    )
    found = first_guess([Record("log", T, x, 0.1 * a + 1.0 * v)]).values
    assert found["delay_samples"] == delay
    assert found["mass_kg"] == pytest.approx(0.1, rel=0.02)
    assert found["damping_ns_per_m"] == pytest.approx(1.0, rel=0.02)


@pytest.mark.parametrize("sigma_steps", [0.6, 1.5])
def test_noise_is_what_rounding_to_a_step_leaves_of_the_error(sigma_steps):
    random, step = np.random.default_rng(4), 1e-5
    values = np.cumsum(random.normal(size=(40, 2000)), axis=1) * step + sigma_steps * step * random.normal(
        size=(40, 2000)
    )
    clean = np.round(values / step) * step - values + sigma_steps * step * random.normal(size=(40, 2000))
    blocks = tuple(SimpleNamespace(square=float(e @ e), samples=e.size) for e in clean)
    found = _estimates._noise(SimpleNamespace(blocks=blocks, unit_m=1.0, noise_share=1.0), step)
    assert found.value == pytest.approx(sigma_steps * step, rel=0.03)


def test_a_block_of_what_repeats_itself_holds_the_same_part_of_every_repeat():
    repeat, size = 120, 960
    parts = Window(0, 50, (repeat,)).parts(0, size)
    assert sorted(np.concatenate(parts)) == list(range(size))
    assert len(parts) > 5
    for part in parts:
        places = np.unique(part % repeat)
        assert np.ptp(places) == places.size - 1
        assert part.size == places.size * size // repeat


def test_the_best_observer_is_the_one_with_the_least_error():
    best = 50.0

    class Errors:
        records, sample_time_s = (SimpleNamespace(seconds=20.0),), T

        def predict(self, _, __, observer, **___):
            return [SimpleNamespace(error_m=np.full(100, 1 + abs(math.log(observer.rate_per_s / best))))]

    found = best_observer(Errors(), SimpleNamespace(structure=None, search=None), Window(0, 10))
    assert best / 1.5 < found.rate_per_s < 1.5 * best


def test_a_held_device_is_read_from_its_response_whatever_its_delay():
    hertz, delay_s = np.linspace(0.5, 40.0, 80), 4e-3
    s = 2j * np.pi * hertz
    response = s / (0.2 * s**2 + 3.0 * s + 800.0) * np.exp(-s * delay_s)
    found = held_guess(Response(hertz, response, np.ones(80), np.ones(80)), delay_s)
    assert found == pytest.approx({"mass_kg": 0.2, "damping_ns_per_m": 3.0, "stiffness_n_per_m": 800.0}, rel=1e-6)


def test_a_record_tells_as_much_of_a_response_as_it_is_long():
    random = np.random.default_rng(6)
    records = []
    for size, gain in ((32_000, 1.0), (8000, 3.0)):
        force = random.normal(size=size)
        records.append(Record("log", T, np.cumsum(gain * force * T), force))
    found = np.abs(measured_response(records).velocity_per_force)
    assert float(np.median(found)) == pytest.approx(0.8 * 1.0 + 0.2 * 3.0, rel=0.05)


def test_a_travel_of_a_few_steps_of_the_encoder_tells_nothing():
    assert [one.key for one in cannot_tell(1.0, 8.0)] == ["mass_kg"]
    assert "8 steps" in cannot_tell(1.0, 8.0)[0].why
    assert cannot_tell(1.0, 40.0) == []


@pytest.mark.parametrize("order", [1, 2])
def test_an_amplifier_of_the_other_order_begins_with_as_much_delay_and_lag_together(order, monkeypatch):
    structure = Structure(("base", "amplifier"), {}, {}, amplifier_order=order)
    hertz, delay = 150.0, 2.0
    late = delay + (1.0 if order == 1 else 2 * structure.loop_damping_ratio) / (2 * math.pi * hertz * T)
    begun = []
    monkeypatch.setattr(_lag, "roughly", lambda _, kind, start, __: begun.append((kind, start)))
    monkeypatch.setattr(_lag, "_best", lambda *_: None)
    values = {"delay_samples": delay, "amplifier_bandwidth_hz": hertz}
    _lag.of_the_other_order(SimpleNamespace(sample_time_s=T), SimpleNamespace(structure=structure, values=values), None)
    assert len(begun) == 3
    for kind, start in begun:
        assert kind.amplifier_order == 3 - order
        angle = 1.0 if kind.amplifier_order == 1 else 2 * kind.loop_damping_ratio
        assert start["delay_samples"] + angle / (2 * math.pi * start["amplifier_bandwidth_hz"] * T) == pytest.approx(
            late
        )


VALUES = dict.fromkeys(PARAMETERS, 0.0) | {"mass_kg": 0.1, "damping_ns_per_m": 2.0, "stribeck_speed_m_per_s": 0.01}
VALUES |= {"resonance.frequency_hz": math.nan, "amplifier_bandwidth_hz": math.nan, LOOP_RATIO: 0.7, "force_scale": 1.0}


@pytest.mark.parametrize(("at", "near"), [(1.0003, 1.02), (1.9997, 1.98)])
def test_the_slope_by_a_delay_is_that_inside_its_own_sample(at, near):
    structure = Structure(("base",), {}, {})
    ends = []
    for delay in (at, near):
        values = VALUES | {"delay_samples": delay}
        ends.append(linear_derivatives(values, structure, T, taps_of(values), 0)[:, -1])
    np.testing.assert_allclose(ends[0], ends[1], atol=0.05 * np.abs(ends[1]).max())
    assert np.abs(ends[1]).max() > 0


def test_a_log_of_every_second_tick_is_refused():
    base = SimpleNamespace(name="mine", device=Device(mass_kg=0.1, damping_ns_per_m=1.0, sample_time_s=T))
    with pytest.raises(avc.InputError, match=r"2 times device\.sample_time_s"):
        check_against([Record("log", 2 * T, np.zeros(300), np.zeros(300))], base)
    for period in (T, 1.5 * T, T / 2):
        check_against([Record("log", period, np.zeros(300), np.zeros(300))], base)


def test_a_response_of_a_turn_is_that_of_its_rim():
    """2 m/s a newton at a rim of 0.1 m are 20 rad/s for 0.1 N.m."""
    one, hertz = np.ones(3, dtype=complex), np.arange(1.0, 4.0)
    empty = {field.name: None for field in dataclasses.fields(Identification)}
    empty |= {"estimates": {}, "refused": (), "notes": (), "shown": (), "error_rms_m": 0.0, "error_m": np.zeros(1)}
    response = Response(hertz, 2.0 * one, np.ones(3), np.ones(3))
    found = of_the_turn(Identification(**empty | {"response": response, "modelled": 2.0 * one}), 0.1)
    np.testing.assert_allclose(found.response.velocity_per_force, 200.0 * one)
    np.testing.assert_allclose(found.modelled, 200.0 * one)


def test_a_force_that_stands_against_a_spring_moves_nothing():
    """At rest from the first sample on, with an amplifier that has long reached its force."""
    structure = Structure(("base", "amplifier", "stiffness"), {}, {})
    spring, force = 500.0, 2.0
    values = VALUES | {"delay_samples": 1.0, "amplifier_bandwidth_hz": 60.0, "stiffness_n_per_m": spring}
    record = Record("log", T, np.full(300, force / spring), np.full(300, force))
    (found,) = Predictor([record], 0.0).predict(structure, structure.start(values), Observer(1e-3), slopes=False)
    assert np.abs(found.error_m).max() < 1e-9


@pytest.mark.parametrize("rate_per_s", [20.0, 60.0])
def test_an_observer_of_a_mass_forgets_at_its_rate(rate_per_s):
    """The filter of a double integrator has its two poles at the root of disturbance over noise."""
    values = VALUES | {"damping_ns_per_m": 0.0, "delay_samples": 0.0}
    step = linear_step(values, Structure(("base",), {}, {}), T, (0, 1), parts=0)
    gain, _ = Observer(rate_per_s).gain(step, values["mass_kg"], T)
    row = np.arange(len(gain)) == step.measured
    poles = np.linalg.eigvals(step.matrix @ (np.eye(len(gain)) - np.outer(gain, row)))
    slow = np.sort(np.abs(np.log(poles[np.abs(poles) > 0.5])))[:2] / T
    np.testing.assert_allclose(slow, rate_per_s, rtol=0.1)


def test_pieces_of_a_record_begin_when_they_were_cut_out_and_masses_are_those_at_the_handle():
    time = T * np.arange(40_000)
    pieces, _ = shortened([Record("log", T, time, time)], 8000)
    assert len(pieces) > 2
    for piece in pieces:
        assert piece.begins_s == pytest.approx(piece.position_m[0])
    wheel = Record("log", T, time, time, added_mass_kg=3e-4, motion="rotary")
    assert wheel.at_handle(0.05).added_mass_kg == pytest.approx(3e-4 / 0.05**2)


def test_a_force_is_held_over_a_lost_sample_and_a_counter_has_wrapped_at_the_row_after_its_jump():
    time = T * np.arange(400)
    position, force = np.sin(time), np.where(np.arange(400) < 200, 1.0, 3.0)
    position[200], force[200] = np.nan, np.nan
    whole, _ = filled(Columns("log", time, position, force))
    assert whole.force_n[200] == 1.0
    assert whole.position_m[200] == pytest.approx(np.sin(time[200]), abs=1e-6)
    counts = np.mod(np.arange(400), 256).astype(float)
    assert wrapped(counts, time).tolist() == [256]


def test_friction_from_rest_goes_as_its_law_says():
    """A mass is pushed from rest against friction that falls with the speed, integrated in fine steps."""
    level, excess, slow, mass, pushes = 0.4, 0.5, 0.02, 0.1, 1.6
    structure = Structure(("base", "coulomb", "stribeck"), {}, {})
    values = VALUES | {"damping_ns_per_m": 0.0, "coulomb_friction_n": level, "breakaway_excess_n": excess}
    values |= {"stribeck_speed_m_per_s": slow, "mass_kg": mass}
    record = Record("log", T, np.zeros(40), np.full(40, pushes))
    (found,) = Predictor([record], 0.0).predict(structure, structure.start(values), Observer(1e-3), slopes=False)
    x, v, fine, path = 0.0, 0.0, 2000, []
    for _ in range(40):
        path.append(x)
        for _ in range(fine):
            v += T / fine * (pushes - level - excess * math.exp(-((v / slow) ** 2))) / mass
            x += T / fine * v
    np.testing.assert_allclose(-found.error_m[:4], path[:4], atol=0.01 * path[3])


def test_a_resonance_beyond_what_the_force_excites_is_not_told():
    hertz = np.linspace(1.0, 100.0, 50)
    response = Response(hertz, np.ones(50, dtype=complex), np.ones(50), np.ones(50))
    for place, told in ((90.0, ""), (200.0, "lies beyond the frequencies that the force excites")):
        structure = Structure(("base", "resonance"), {}, {})
        found = SimpleNamespace(values={"resonance.frequency_hz": place}, structure=structure)
        assert _select._beyond(found, "resonance", response, T) == told


def test_of_terms_that_look_alike_the_one_that_leaves_least_is_taken(monkeypatch):
    left = {"stiffness": 2.0, "play": 1.0}
    monkeypatch.setattr(_select, "_tried", lambda _, __, term, *___: SimpleNamespace(rms_m=left[term]))
    chosen = Selection(SimpleNamespace(structure=Structure(("base",), {}, {})))
    chosen.trials = {term: Trial(term, True, -1.0, 9.0, "") for term in left}
    chosen.rough_m = dict(left)
    assert _select._try(None, chosen, tuple(left), {}, None, None, ())
    assert chosen.fit.rms_m == 1.0
    assert {term: trial.taken for term, trial in chosen.trials.items()} == {"stiffness": False, "play": True}


@pytest.mark.parametrize(
    ("order", "ratio", "widens"), [(1, 0.7, True), (1, 2.0, False), (2, 0.7, True), (2, 2.0, True)]
)
def test_a_damping_ratio_that_is_not_told_widens_intervals_unless_a_lag_is_all_that_is_meant(
    order, ratio, widens, monkeypatch
):
    structure = Structure(("base", "amplifier"), {}, {}, amplifier_order=order)
    no, free = Trial(LOOP_DAMPING, False, 0.0, 0.0, ""), SimpleNamespace(values={LOOP_RATIO: ratio})
    monkeypatch.setattr(_selection, "of_the_other_order", lambda *_: None)
    monkeypatch.setattr(_selection, "compared", lambda *_: no)
    monkeypatch.setattr(_selection, "damped_as_it_is", lambda *_: (no, free))
    chosen = Selection(SimpleNamespace(structure=structure))
    _selection.told_by_its_kind(None, chosen, None)
    assert (LOOP_DAMPING in chosen.rivals) == widens


def fitted(columns, wanted, blocks):
    """Least squares of a linear model at its best, as a fit with its blocks."""
    best = np.linalg.lstsq(columns, wanted, rcond=None)[0]
    made = []
    for rows in np.array_split(np.arange(wanted.size), blocks):
        e, j = wanted[rows] - columns[rows] @ best, -columns[rows]
        made.append(Block(0, rows.size, float(e @ e), j.T @ e, j.T @ j))
    structure = Structure(("base",), {"mass_kg": 0.1, "delay_samples": 1.0}, {"coulomb_friction_n": 1.0})
    return Fit(structure, best, Observer(8.0), (wanted - columns @ best,), tuple(made), 1.0, 1.0, 0.0, 0.0, T, False)


def test_the_error_on_a_stretch_that_is_held_out_is_that_of_a_fit_to_the_others():
    random = np.random.default_rng(8)
    columns, blocks = random.normal(size=(60, 2)), 6
    wanted = columns @ [1.0, -2.0] + random.normal(size=60)
    expected = []
    for rows in np.array_split(np.arange(60), blocks):
        others = np.setdiff1d(np.arange(60), rows)
        without = np.linalg.lstsq(columns[others], wanted[others], rcond=None)[0]
        expected.append(float(np.sum((wanted[rows] - columns[rows] @ without) ** 2)))
    np.testing.assert_allclose(held_out(fitted(columns, wanted, blocks)), expected, rtol=1e-9)


def test_what_another_observer_would_have_found_is_in_the_interval():
    random = np.random.default_rng(9)
    columns = random.normal(size=(400, 2))
    noise = random.normal(size=400)
    one = fitted(columns, columns @ [1.0, -2.0] + noise, 20)
    shift = np.array([3.0, 0.0])
    moved = tuple(dataclasses.replace(block, gradient=block.gradient - block.curvature @ shift) for block in one.blocks)
    plain, beside = (spread_of(one, others).half_width for others in ((), [dataclasses.replace(one, blocks=moved)]))
    assert 1.0 < (beside - plain)[0] < 3.01
    assert (beside - plain)[1] == pytest.approx(0.0, abs=0.5)
