"""A current loop is told with its own damping ratio: taken with another it is a resonance, a lag or a wrong delay."""

from dataclasses import replace

import numpy as np
import pytest
from measured_device import Truth, measured, multisine

from avc_casadi.files.device_file import DeviceFile
from avc_casadi.identification.fit import Window, best_observer, fit
from avc_casadi.identification.identify import identify
from avc_casadi.identification.lag_vs_resonance import behind_a_structure
from avc_casadi.identification.predictor import Observer, Predictor
from avc_casadi.identification.record import Record
from avc_casadi.identification.terms import Structure
from avc_casadi.identification.told import identification_text


def told(seed, base=None, **device):
    truth = Truth(mass=0.1, damping=0.5, spring=30.0, delay=1.0, encoder=5e-6, **device)
    random = np.random.default_rng(seed)
    wanted = multisine(random, 10.0, truth.period, 0.5, 300.0, 1.0 + truth.coulomb)
    _, position, force = measured(truth, wanted, random)
    return truth, identify([Record("log", truth.period, position, force)], base=base)


def base(**device):
    """A device file with guesses of its own."""
    nominal = {"mass_kg": 0.1, "damping_ns_per_m": 0.5, "amplifier_order": 2, "amplifier_bandwidth_hz": 250.0}
    return DeviceFile.model_validate({"name": "guess.toml", "device": nominal | device})


@pytest.mark.thorough
@pytest.mark.one_of(2)
@pytest.mark.parametrize(
    ("bandwidth", "ratio", "friction"),
    [
        (100.0, 0.4, 0.3),  # was a resonance of 100 Hz
        (250.0, 0.3, 0.0),
        (250.0, 0.6, 0.3),  # was a resonance beyond the excited frequencies, and so neither
        (250.0, 1.0, 0.0),
        (250.0, 1.3, 0.3),  # was a lag of 114 Hz
    ],
)
def test_its_bandwidth_ratio_and_delay_are_inside_their_intervals(bandwidth, ratio, friction):
    truth, found = told(3, coulomb=friction, bandwidth=bandwidth, loop_damping=ratio)
    true = {
        "mass_kg": truth.mass,
        "damping_ns_per_m": truth.damping,
        "delay_samples": truth.delay,
        "coulomb_friction_n": friction,
        "amplifier_bandwidth_hz": bandwidth,
        "amplifier_damping_ratio": ratio,
    }
    for key, value in true.items():
        assert found.estimates[key].low <= value <= found.estimates[key].high, key
    assert found.estimates["amplifier_damping_ratio"].value == pytest.approx(ratio, rel=0.03)
    assert "resonance" not in found.terms
    assert found.amplifier_order == 2


@pytest.mark.thorough
def test_the_device_file_says_it_with_its_range_and_source():
    _, found = told(3, coulomb=0.3, bandwidth=250.0, loop_damping=0.4)
    device = found.device.device
    low, high = device.range.amplifier_damping_ratio
    assert low < device.amplifier_damping_ratio < high
    assert found.device.sources.amplifier_damping_ratio.grade == "measured"
    assert "the damping ratio of the current loop" in identification_text(found)
    assert not any("damping ratio" in note for note in found.notes)


@pytest.mark.thorough
def test_where_it_makes_no_difference_it_is_a_gap_at_what_the_file_of_the_device_says():
    """A ratio of 0.7 is not told from one that is a little off; the interval of the bandwidth holds such."""
    _, found = told(5, coulomb=0.3, bandwidth=200.0, loop_damping=0.7)
    assert "loop-damping" not in found.terms
    assert "amplifier_damping_ratio" in found.device.gaps
    assert any("amplifier_damping_ratio" in note for note in found.notes)
    _, believed = told(5, base(amplifier_damping_ratio=0.6), coulomb=0.3, bandwidth=200.0, loop_damping=0.6)
    assert believed.amplifier_order == 2
    told_so = "loop-damping" in believed.terms
    assert believed.device.device.amplifier_damping_ratio == pytest.approx(0.6, abs=0.02 if told_so else 0.0)


@pytest.mark.thorough
def test_a_lag_has_none():
    _, found = told(3, coulomb=0.3, bandwidth=300.0)
    assert found.amplifier_order == 1
    assert "amplifier_damping_ratio" not in found.estimates
    assert "amplifier_damping_ratio" not in found.device.device.model_fields_set


@pytest.mark.thorough
@pytest.mark.parametrize(("hertz", "ratio", "noisy"), [(90.0, 0.25, False), (150.0, 0.35, True), (100.0, 0.4, True)])
def test_a_resonance_of_a_structure_stays_one(hertz, ratio, noisy):
    """With the encoder at the handle it differs from a loop that rings by a zero, and by what friction meets."""
    truth = Truth(
        mass=0.12, damping=0.7, coulomb=0.25, delay=0.9, encoder=2e-6, resonance=hertz, ratio=ratio, share=0.35,
        at_handle=1.0,
    )  # fmt: skip
    random = np.random.default_rng(4)
    wanted = multisine(random, 10.0, truth.period, 0.5, 300.0, 1.0)
    if noisy:
        wanted = np.repeat(random.choice([-1.0, 1.0], 5000), 2)
    _, position, force = measured(replace(truth, spring=30.0), wanted, random)
    found = identify([Record("log", truth.period, position, force)])
    assert "resonance" in found.terms
    assert "amplifier" not in found.terms
    assert found.encoder_at == "handle"
    true = {"mass_kg": 0.12, "delay_samples": 0.9, "resonance.frequency_hz": hertz, "resonance.damping_ratio": ratio}
    for key, value in true.items():
        assert found.estimates[key].low <= value <= found.estimates[key].high, key


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("device", "beside"),
    [
        # Of an encoder that is taken to be at the motor; the resonance is damped as none is.
        ({"resonance": 150.0, "ratio": 0.35, "share": 0.35, "at_handle": 1.0}, (42.0, 1.9, 0.32)),
        (
            {"resonance": 90.0, "ratio": 0.04, "share": 0.35, "bandwidth": 150.0, "loop_damping": 0.4},
            (90.0, 0.04, 0.35),
        ),
    ],
    ids=["one mode", "a mode and a loop"],
)
def test_a_mode_seen_from_the_handle_takes_the_place_of_a_loop_and_of_a_resonance_beside_it(device, beside):
    truth = Truth(mass=0.12, damping=0.7, coulomb=0.25, delay=0.9, encoder=2e-6, **device)
    random = np.random.default_rng(4)
    wanted = np.repeat(random.choice([-1.0, 1.0], 5000), 2)
    _, position, force = measured(replace(truth, spring=30.0), wanted, random)
    predictor = Predictor([Record("log", truth.period, position, force)], 0.0)
    window = Window.of([position.size], truth.period)
    structure = Structure(("base", "coulomb", "resonance", "amplifier", "loop-damping"), {}, {}, amplifier_order=2)
    frequency, ratio, share = beside
    start = {
        "mass_kg": 0.12,
        "damping_ns_per_m": 0.7,
        "delay_samples": 0.6,
        "offset_n": 0.0,
        "coulomb_friction_n": 0.25,
        "resonance.frequency_hz": frequency,
        "resonance.damping_ratio": ratio,
        "resonance.mass_ratio": share,
        "amplifier_bandwidth_hz": 155.0,
        "amplifier_damping_ratio": 0.4,
    }
    both = fit(predictor, structure, start, Observer(60.0), window)
    both = fit(predictor, structure, both.values, best_observer(predictor, both, window), window)
    assert both.values["amplifier_damping_ratio"] < 0.5  # as a structure may be
    found = behind_a_structure(predictor, both, window)
    if "bandwidth" in device:
        assert found is None
        return
    assert found.structure.terms == ("base", "coulomb", "resonance")
    assert found.structure.encoder_at == "handle"
    assert found.values["resonance.frequency_hz"] == pytest.approx(150.0, rel=0.01)
    assert found.values["resonance.damping_ratio"] == pytest.approx(0.35, rel=0.02)
    assert found.rms_m < both.rms_m / 2


@pytest.mark.thorough
@pytest.mark.parametrize(("bandwidth", "friction"), [(570.0, 0.3), (220.0, 0.0)])
def test_a_bandwidth_that_another_kind_explains_as_well_is_refused_and_its_lag_told_as_delay(bandwidth, friction):
    """Too little is excited to set a lag and a current loop apart: the delay with the lag in it is told."""
    truth = Truth(mass=0.1, damping=0.5, coulomb=friction, spring=50.0, delay=1.3, encoder=2e-5, bandwidth=bandwidth)
    random = np.random.default_rng(6)
    wanted = multisine(random, 10.0, truth.period, 0.5, 60.0, 1.0 + friction)
    _, position, force = measured(truth, wanted, random, noise=1e-5)
    found = identify([Record("log", truth.period, position, force)])
    late = found.estimates["delay_samples"]
    assert "amplifier_bandwidth_hz" not in found.estimates
    assert late.low <= truth.delay + 1 / (2 * np.pi * bandwidth * truth.period) <= late.high
    assert late.high - late.low < 0.1
