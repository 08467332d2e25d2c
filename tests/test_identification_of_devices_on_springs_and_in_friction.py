"""Devices on springs below their resonance, logs that are nearly all friction, and clocks that scatter."""

import numpy as np
import pytest
from held_device import held_log

from avc_casadi import InputError
from avc_casadi.files.device_file import DeviceFile
from avc_casadi.identification.device import device_text
from avc_casadi.identification.encoder import encoder_step_m
from avc_casadi.identification.identify import identify
from avc_casadi.identification.initial_guess import in_ticks
from avc_casadi.identification.record import Record, records_of

HELD = {"mass": 0.1, "damping": 1.0, "friction": 0.05, "spring": 500.0, "ticks": 5000, "parts": 40}


def sines(amplitude, top_hz, period=1e-3, seed=1, *, spring=0.0, damper=0.0):
    omega = 2 * np.pi * np.linspace(0.2, top_hz, 30) * period
    phase = np.random.default_rng(seed).uniform(0, 2 * np.pi, 30)
    return lambda tick, z, u: amplitude * np.sin(omega * tick + phase).sum() - spring * z - damper * u


def of(columns):
    records, faults, _ = records_of(columns)
    assert not faults
    return records


def holds(found, key, value, share):
    one = found.estimates[key]
    return one.low * (1 - 1e-3) <= value <= one.high * (1 + 1e-3) and abs(one.value / value - 1) < share


@pytest.mark.thorough
def test_a_device_on_a_spring_is_found_below_its_resonance():
    found = identify(of(held_log(sines(0.22, 6.0), **HELD)))
    assert "stiffness" in found.terms
    truth = {"mass_kg": 0.1, "damping_ns_per_m": 1.0, "stiffness_n_per_m": 500.0, "coulomb_friction_n": 0.05}
    assert all(holds(found, key, value, 0.02) for key, value in truth.items())


def test_a_sign_that_is_wrong_is_told_on_a_spring_as_well():
    log = held_log(sines(0.22, 6.0), **HELD)
    with pytest.raises(InputError, match="--flip-force"):
        identify(of(log), flip_force=True)


def nearly_all_friction():
    target = lambda tick: 0.02 * np.sin(0.5 * np.pi * tick / 400) + 0.01 * np.sin(1.1 * np.pi * tick / 400)  # noqa: E731
    law = lambda tick, z, u: 150 * (target(tick) - z) - u  # noqa: E731
    return held_log(law, mass=0.005, damping=2.0, friction=1.2, period=2.5e-3, ticks=6000, step=4e-5)


@pytest.mark.thorough
def test_friction_is_found_where_it_is_nearly_all_and_the_untold_mass_is_a_gap_with_a_range():
    device = {
        "mass_kg": 0.02,
        "damping_ns_per_m": 1.0,
        "coulomb_friction_n": 0.2,
        "delay_samples": 1,
        "sample_time_s": 2.5e-3,
        "max_force_n": 8.0,
    }
    base = DeviceFile.model_validate({"name": "base", "device": device})
    found = identify(of(nearly_all_friction()), base=base)
    assert holds(found, "coulomb_friction_n", 1.2, 0.01)
    assert holds(found, "damping_ns_per_m", 2.0, 0.01)
    file = found.device
    assert "mass_kg" not in found.estimates
    assert "mass_kg" in file.gaps
    low, high = file.device.range.mass_kg
    assert low < 0.005 < high
    assert file.sources.mass_kg.grade == "assumed"
    assert "gaps" in device_text(file)


@pytest.mark.thorough
@pytest.mark.parametrize(("period", "scatter"), [(0.005, 0.002), (0.01, 0.004), (0.0025, 0.001)])
def test_a_clock_that_scatters_is_taken_as_it_is(period, scatter):
    truth = {"mass": 0.2, "damping": 2.0, "friction": 0.3}
    law = sines(0.35, min(15.0, 0.08 / period), period, seed=3, spring=30.0)
    records, faults, told = records_of(
        held_log(law, **truth, period=period, ticks=round(12 / period), scatter=scatter, parts=40)
    )
    assert not faults
    assert any("scatter" in one for one in told)
    found = identify(records)
    for key, name in (("mass_kg", "mass"), ("damping_ns_per_m", "damping"), ("coulomb_friction_n", "friction")):
        assert holds(found, key, truth[name], 0.03)


def ticking(delay, period=5e-3):
    law = sines(0.15, 15.0, period, seed=3, spring=30.0, damper=0.5)
    device = {"mass": 0.25, "damping": 1.2, "friction": 0.15, "delay": delay}
    return of(held_log(law, **device, period=period, ticks=3200, scatter=0.4 * period, parts=40))


@pytest.mark.parametrize("delay", [0, 1, 3])
def test_forces_of_a_clock_that_scatters_act_after_as_many_ticks_as_they_do(delay):
    records = ticking(delay)
    (taken,), told = in_ticks(records)
    np.testing.assert_array_equal(taken.force_n, records[0].later_n[delay])
    assert [f"act {delay} tick" in note for note in told] == [True] * bool(delay)
    assert encoder_step_m(records) == pytest.approx(2e-5, rel=1e-4)
    # An even clock has one way only to count.
    even = [Record("even", 5e-3, taken.position_m, taken.force_n)]
    assert in_ticks(even) == (even, [])


@pytest.mark.thorough
@pytest.mark.parametrize("delay", [0, 1, 2])
def test_a_delay_that_is_counted_in_ticks_does_not_lean_the_damping(delay):
    found = identify(ticking(delay))
    for key, value in (("mass_kg", 0.25), ("damping_ns_per_m", 1.2), ("coulomb_friction_n", 0.15)):
        assert holds(found, key, value, 0.01)
    assert found.estimates["delay_samples"].value == pytest.approx(delay, abs=0.03)
    assert "resonance" not in found.terms
    assert not found.estimates["damping_ns_per_m"].doubt
