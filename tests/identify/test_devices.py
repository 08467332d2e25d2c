"""Devices of a simulator that shares no code with the project come back from their logs, inside the intervals."""

from dataclasses import replace

import numpy as np
import pytest
from buzzing_device import Buzzing, logged
from held_device import held_log
from hypothesis import given, settings
from hypothesis import strategies as st
from measured_device import Truth, measured, multisine
from quick import first

import avc_casadi as avc
from avc_casadi.diagnose.law import find_law
from avc_casadi.diagnose.oscillation import find_oscillation, log_of
from avc_casadi.files.device_file import load_device
from avc_casadi.identification.device import device_text
from avc_casadi.identification.identify import identify
from avc_casadi.identification.log import Columns, Record, faults_of, records_of

PERIOD = 1e-3
RIGID = {"mass_kg": 0.1, "damping_ns_per_m": 2.0}


def record(truth, seconds=4.0, rms=2.0, seed=0, high=300.0, noise=0.0, name="log"):
    random = np.random.default_rng(seed)
    wanted = multisine(random, seconds, truth.period, 0.5, high, rms)
    _, position, force = measured(truth, wanted, random, noise=noise)
    return Record(name, truth.period, position, force)


def holds(found, within=None, **truth):
    for key, value in truth.items():
        one = found.estimates[key.replace("mode_", "resonance.")]
        more = 1e-3 * abs(value)
        assert one.low - more <= value <= one.high + more, (key, value, one)
        assert within is None or not value or one.value == pytest.approx(value, rel=within), (key, one)


@pytest.fixture(scope="module")
def flexible():
    truth = Truth(coulomb=0.4, delay=1.4, resonance=140.0, ratio=0.05, share=0.35, encoder=2e-5, spring=50.0)
    return identify([record(truth, seconds=5.0)])


@pytest.mark.slow
def test_resonance_friction_and_fractional_delay(flexible, tmp_path):
    holds(flexible, 0.03, **RIGID, delay_samples=1.4, coulomb_friction_n=0.4, encoder_resolution_m=2e-5)
    holds(flexible, mode_frequency_hz=140.0, mode_damping_ratio=0.05, mode_mass_ratio=0.35)
    assert flexible.encoder_at == "motor"
    assert {"amplifier_bandwidth_hz", "max_force_n"} <= set(flexible.unknown)
    (tmp_path / "mine.toml").write_text(device_text(flexible.device))
    read = avc.load_device(tmp_path / "mine.toml")
    assert read.device == flexible.device.device
    assert read.sources["mass_kg"].grade == "measured"


@pytest.mark.slow
def test_encoder_at_the_handle_tells_the_resonance_but_not_how_the_mass_divides():
    """Nothing but viscous damping acts on the motor: other shares with another damping ratio predict the same."""
    truth = Truth(delay=1.0, resonance=150.0, ratio=0.04, share=0.3, at_handle=1.0, encoder=1e-5, spring=50.0)
    found = identify([record(truth, seed=12)])
    holds(found, **RIGID, delay_samples=1.0, mode_frequency_hz=150.0, mode_damping_ratio=0.04, mode_mass_ratio=0.3)
    assert found.encoder_at == "handle"
    assert not found.estimates["resonance.mass_ratio"].identified
    low, high = found.device.device.range.resonance.mass_ratio
    assert low <= 0.3 <= high


@pytest.mark.slow
def test_a_rigid_device_without_friction_claims_neither():
    found = identify([record(Truth(delay=0.6, encoder=5e-6, spring=30.0), seconds=2.0, seed=3)])
    holds(found, 1e-3, **RIGID, delay_samples=0.6)
    assert found.rungs == ("rigid",)
    assert found.estimates["coulomb_friction_n"].low == 0


@pytest.mark.slow
def test_a_stiff_controller_in_a_loop_leaves_no_bias():
    """A wall of 2 kN/m with damping, noise of the encoder fed back through it: least squares is biased, this is not."""
    truth = Truth(mass=0.2, coulomb=0.3, delay=1.0, encoder=5e-5, spring=2000.0, damper=4.0)
    found = identify([record(truth, rms=3.0, seed=4, noise=2e-5)])
    holds(found, mass_kg=0.2, damping_ns_per_m=2.0, delay_samples=1.0, coulomb_friction_n=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("delay", [0.1, 1.7])
def test_friction_that_turns_inside_a_sample_leaves_only_the_rounding(delay):
    # A twelfth of the velocity decays in a sample: taken to change evenly it misses mass and friction by 3e-4.
    truth = Truth(mass=0.05, damping=4.0, coulomb=0.8, delay=delay, encoder=1e-7, spring=30.0)
    found = identify([record(truth, seconds=6.0, seed=4)])
    holds(found, 5e-5, mass_kg=0.05, damping_ns_per_m=4.0, coulomb_friction_n=0.8)
    assert found.estimates["delay_samples"].value == pytest.approx(delay, abs=5e-5)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rung", "truth"),
    [
        ("lag", {"coulomb": 0.3, "delay": 0.5, "bandwidth": 200.0, "encoder": 1e-5}),
        ("loop", {"coulomb": 0.3, "delay": 1.0, "bandwidth": 150.0, "loop_damping": 0.5, "encoder": 5e-6}),
    ],
)
def test_an_amplifier_is_told_from_delay(rung, truth):
    found = identify([record(Truth(damping=0.5, spring=30.0, **truth), seconds=8.0, rms=1.3, seed=3)])
    assert rung in found.rungs
    holds(found, 0.03, delay_samples=truth["delay"], amplifier_bandwidth_hz=truth["bandwidth"], mass_kg=0.1)


@pytest.mark.slow
def test_a_spring_that_holds_the_device_is_found():
    found = identify([record(Truth(ground=400.0, delay=1.0, encoder=5e-6), seed=8)])
    holds(found, 0.01, stiffness_n_per_m=400.0, mass_kg=0.1)
    assert any("spring" in note for note in found.notes)


def sines(amplitude, top_hz, period=PERIOD, seed=1, *, spring=0.0, damper=0.0):
    omega = 2 * np.pi * np.linspace(0.2, top_hz, 30) * period
    phase = np.random.default_rng(seed).uniform(0, 2 * np.pi, 30)
    return lambda tick, z, u: amplitude * np.sin(omega * tick + phase).sum() - spring * z - damper * u


def of(columns):
    log = records_of(columns)
    assert not log.faults
    return log.records


HELD = {"mass": 0.1, "damping": 1.0, "friction": 0.05, "spring": 500.0, "ticks": 5000, "parts": 40}


@pytest.mark.slow
def test_a_device_on_a_spring_is_found_below_its_resonance():
    found = identify(of(held_log(sines(0.22, 6.0), **HELD)))
    holds(found, 0.02, mass_kg=0.1, damping_ns_per_m=1.0, stiffness_n_per_m=500.0, coulomb_friction_n=0.05)


def test_a_force_of_reversed_sign_is_refused():
    for records in (of(held_log(sines(0.22, 6.0), **HELD)), [record(Truth(delay=1.0, encoder=1e-5))]):
        with pytest.raises(avc.InputError, match="--flip-force"):
            identify(records, flip_force=True)


@pytest.mark.slow
@pytest.mark.parametrize(("period", "scatter", "late"), [(0.005, 0.002, 0.0), (0.01, 0.004, 0.0), (0.002, 0.0, 1e-4)])
def test_a_clock_that_scatters_is_taken_as_it_is(period, scatter, late):
    law = sines(0.35, min(15.0, 0.08 / period), period, seed=3, spring=30.0)
    device = {"mass": 0.2, "damping": 2.0, "friction": 0.3}
    found = identify(
        of(held_log(law, **device, period=period, ticks=round(12 / period), scatter=scatter, late=late, parts=40))
    )
    holds(found, 0.03, mass_kg=0.2, damping_ns_per_m=2.0, coulomb_friction_n=0.3)


def spinning(ways, seconds=6.0, friction=0.036):
    """A motor that turns freely under a torque of one sign in each record: more than a thousand radians."""
    truth = Truth(mass=1.2e-4, damping=9.5e-5, coulomb=friction, delay=1.0, encoder=2 * np.pi / 16384)
    records = []
    for at, way in enumerate(ways):
        random = np.random.default_rng(at)
        levels = np.repeat(random.uniform(0.03, 0.065, round(seconds / 0.2)), 200)
        _, position, force = measured(truth, way * levels, random)
        records.append(Record(f"log {at}", PERIOD, position, force, motion="rotary"))
    return records


@pytest.mark.slow
def test_a_motor_that_spins_both_ways_tells_its_friction():
    found = identify(spinning((1, -1)), handle_radius_m=0.05)
    holds(found, 0.03, mass_kg=1.2e-4, damping_ns_per_m=9.5e-5, coulomb_friction_n=0.036)
    assert found.device.device.motion == "rotary"


@pytest.mark.slow
@pytest.mark.parametrize("case", [("sine", 3.0, 2.0, 0.2), ("slow", 4.0, 1.0, 0.5)])
def test_what_a_log_does_not_tell_is_a_range_that_holds_it(case):
    kind, hertz, size, coulomb = case
    truth = Truth(damping=0.5, coulomb=coulomb, delay=1.0, encoder=2e-5, spring=100.0 * (kind == "slow"))
    wanted = size * np.sin(2 * np.pi * hertz * np.arange(8000) * PERIOD)
    if kind == "slow":
        wanted = multisine(np.random.default_rng(9), 8.0, PERIOD, 0.5, hertz, size)
    _, position, force = measured(truth, wanted, np.random.default_rng(4))
    found = identify([Record(kind, PERIOD, position, force)])
    holds(found, mass_kg=0.1, damping_ns_per_m=0.5, delay_samples=1.0, coulomb_friction_n=coulomb)


def test_forces_that_do_not_act_and_ticks_that_are_not_logged_are_refused(tmp_path):
    (tmp_path / "d.toml").write_text(
        "[device]\nmass_kg = 0.1\ndamping_ns_per_m = 2.0\nsample_time_s = 5e-4\nmax_force_n = 3.0\n"
    )
    one = record(Truth(encoder=1e-5, spring=50.0), seconds=2.0)
    with pytest.raises(avc.InputError) as caught:
        identify([one], base=load_device(tmp_path / "d.toml"))
    assert [fault.key for fault in caught.value.faults] == ["force", "time"]


# A hand that goes to and fro in a wall, by its own will.
PRESSED = Buzzing(mass=0.12, damping=0.8, friction=0.1, encoder=2e-5, stiffness=1500.0, damper=2.0, end=0.01)


@pytest.mark.parametrize("changed", [{}, {"keep": 0.6}, {"lag": 2.0}, {"two_sided": 1.0, "stiffness": 800.0}])
def test_a_force_that_is_pure_feedback_tells_no_device(changed):
    loop = replace(PRESSED, sway=4e-3, **changed)
    _, position, force = logged(loop, 6.0)
    with pytest.raises(avc.InputError):
        identify([Record("pressed", loop.period, position, force)])


# A row without a number is no measurement, and the rest of the log tells as much as before.


@given(st.integers(0, 10**6))
@settings(max_examples=20)
def test_a_loop_that_buzzes_or_taps_is_no_counter_that_wraps(seed):
    random = np.random.default_rng(seed)
    loop = Buzzing(
        stiffness=float(random.uniform(300, 12000)),
        damper=float(random.uniform(0, 30)),
        delay=float(random.uniform(0, 3)),
        encoder=float(10 ** random.uniform(-6, -4)),
    )
    time, position, force = logged(loop, 3.0)
    assert not faults_of(Columns("log", time, position, force), swing=True)


def with_holes(log, rows, **lost):
    """Return a log with its positions, or other columns too, not a number at some rows, as a reader leaves them out."""
    columns = {name: getattr(log, name).copy() for name in ("time_s", "position_m", "force_n")}
    for name in ("position_m", *lost):
        columns[name][rows] = np.nan
    return replace(log, **columns).complete()


HOLES = [337, 338, 900, 1501]


@pytest.mark.parametrize("lost", first([{}, {"force_n": True}, {"time_s": True, "force_n": True}]))
def test_what_is_read_beside_rows_without_a_number_is_what_the_whole_log_tells(lost):
    """The law and two rates are exact in these logs, and none is with a row of a wrong position."""
    time = 1e-3 * np.arange(2000)
    moved = 1e-3 * np.sin(31 * time) + 4e-4 * np.sin(57 * time + 1)
    plain = 3000 * moved + 12 * np.diff(moved, prepend=moved[0]) / 1e-3
    slow = 3000 * moved[np.arange(2000) // 10 * 10] + 12 * np.diff(moved, prepend=moved[0]) / 1e-3

    def grid(force):
        return log_of(with_holes(Columns("log", time, moved, -force), HOLES, **lost))[0]

    def law_of(log):
        return find_law(log, find_oscillation(log, None), None, 0.0)

    law = law_of(grid(plain))
    assert (law.stiffness_n_per_m, law.damping_ns_per_m) == pytest.approx((3000, 12), rel=1e-6)
    assert law.misfit < 1e-6
    frames = law_of(grid(slow)).frames
    assert (frames.slow, frames.ticks) == ("spring", 10)
