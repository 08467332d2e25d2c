"""Beside dry friction, which turns inside a sample, an amplifier's lag and a delay are each told as what they are."""

import numpy as np
import pytest
from measured_device import Truth, measured, multisine

from avc_casadi.files.device_file import DeviceFile
from avc_casadi.identification.identify import identify
from avc_casadi.identification.record import Record


def told(seed, **device):
    truth = Truth(mass=0.1, damping=0.5, spring=30.0, **device)
    random = np.random.default_rng(seed)
    wanted = multisine(random, 10.0, truth.period, 0.5, 300.0, 1.0 + truth.coulomb)
    _, position, force = measured(truth, wanted, random)
    return truth, identify([Record("log", truth.period, position, force)])


@pytest.mark.thorough
@pytest.mark.one_of(2)
@pytest.mark.parametrize(
    ("friction", "delay", "bandwidth", "encoder"),
    [(0.3, 0.5, 300.0, 10e-6), (0.3, 1.0, 300.0, 40e-6), (0.1, 1.0, 400.0, 20e-6), (1.0, 2.0, 200.0, 20e-6)],
)
def test_both_intervals_hold_what_was_there(friction, delay, bandwidth, encoder):
    _, found = told(3, coulomb=friction, delay=delay, bandwidth=bandwidth, encoder=encoder)
    late, lag = (found.estimates[key] for key in ("delay_samples", "amplifier_bandwidth_hz"))
    assert late.low <= delay <= late.high
    assert lag.low <= bandwidth <= lag.high
    # The velocity taken to change evenly over a sample misses the delay by 0.03 to 0.15 samples.
    assert abs(late.value - delay) < 0.012


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("friction", "delay", "bandwidth", "encoder"), [(0.5, 0.8, 700.0, 2e-6), (1.0, 1.3, 600.0, 5e-6)]
)
def test_a_fast_lag_does_not_lean_by_the_parts_that_a_sample_is_cut_into(friction, delay, bandwidth, encoder):
    _, found = told(4, coulomb=friction, delay=delay, bandwidth=bandwidth, encoder=encoder)
    # Eight parts alone put it 0.7 to 1 per cent too high.
    assert found.estimates["amplifier_bandwidth_hz"].value == pytest.approx(bandwidth, rel=4e-3)
    assert abs(found.estimates["delay_samples"].value - delay) < 1e-3


@pytest.mark.thorough
def test_a_fast_lag_beside_little_friction_is_told():
    """It and the delay do nearly the same: what either adds is worth a hundred times its own."""
    _, found = told(4, coulomb=0.05, delay=1.3, bandwidth=600.0, encoder=2e-6)
    late, lag = (found.estimates[key] for key in ("delay_samples", "amplifier_bandwidth_hz"))
    assert late.low <= 1.3 <= late.high
    assert lag.low <= 600.0 <= lag.high
    assert found.terms == ("base", "coulomb", "amplifier")


@pytest.mark.thorough
@pytest.mark.one_of(2)
@pytest.mark.parametrize(
    ("friction", "delay", "bandwidth", "ring"),
    [(0.3, 1.0, 200.0, {}), (0.5, 0.5, 350.0, {}), (0.3, 1.0, 250.0, {"resonance": 120.0, "ratio": 0.04})],
)
def test_a_current_loop_of_the_second_order_is_no_lag_of_the_first(friction, delay, bandwidth, ring):
    """Taken for one it put the delay up by a sample and the bandwidth up by half, with narrow intervals."""
    truth, found = told(5, coulomb=friction, delay=delay, bandwidth=bandwidth, encoder=5e-6, loop_damping=0.7, **ring)
    true = {"delay_samples": delay, "amplifier_bandwidth_hz": bandwidth, "mass_kg": truth.mass}
    true |= {"resonance.frequency_hz": ring["resonance"], "resonance.damping_ratio": ring["ratio"]} if ring else {}
    for key, value in true.items():
        assert found.estimates[key].low <= value <= found.estimates[key].high, key
    assert found.amplifier_order == 2
    assert found.device.device.amplifier_order == 2
    assert any("damping ratio of 0.7" in note for note in found.notes)
    assert found.estimates["amplifier_bandwidth_hz"].value == pytest.approx(bandwidth, rel=0.03)


@pytest.mark.thorough
def test_a_lag_of_the_first_order_stays_one():
    _, found = told(3, coulomb=0.3, delay=1.0, bandwidth=300.0, encoder=10e-6)
    assert (found.amplifier_order, found.device.device.amplifier_order) == (1, 1)


@pytest.mark.thorough
def test_a_lag_that_hides_is_counted_as_delay_and_said_to_be():
    truth, found = told(5, delay=1.7, bandwidth=750.0, encoder=20e-6)
    assert "amplifier_bandwidth_hz" in {one.key for one in found.refused}
    late = found.estimates["delay_samples"]
    assert abs(late.value - (truth.delay + 1 / (2 * np.pi * truth.bandwidth * truth.period))) < 0.02
    assert found.estimates["mass_kg"].value == pytest.approx(truth.mass, rel=1e-4)


@pytest.mark.thorough
@pytest.mark.parametrize(("ranges", "leans"), [({}, True), ({"range": {"amplifier_bandwidth_hz": [200, 900]}}, False)])
def test_a_delay_beside_a_lag_that_is_only_declared_is_told_to_lean_on_it(ranges, leans):
    truth, random = Truth(mass=0.3, delay=2.0, encoder=20e-6), np.random.default_rng(3)
    _, position, force = measured(truth, multisine(random, 8.0, truth.period, 0.5, 30.0, 2.0), random)
    device = {"mass_kg": 0.3, "damping_ns_per_m": 2.0, "sample_time_s": truth.period, "amplifier_bandwidth_hz": 600.0}
    base = DeviceFile.model_validate({"name": "base", "title": "base", "device": device | ranges})
    found = identify([Record("log", truth.period, position, force)], base=base)
    assert "amplifier_bandwidth_hz" not in found.estimates
    assert any("600, which base gives without a range" in note for note in found.notes) == leans


@pytest.mark.thorough
def test_an_order_of_the_amplifier_that_the_logs_contradict_is_told():
    truth, random = Truth(mass=0.1, damping=0.5, coulomb=0.3, bandwidth=300.0, encoder=10e-6), np.random.default_rng(3)
    _, position, force = measured(truth, multisine(random, 10.0, truth.period, 0.5, 300.0, 1.3), random)
    device = {"mass_kg": 0.1, "damping_ns_per_m": 0.5, "sample_time_s": truth.period, "amplifier_order": 2}
    base = DeviceFile.model_validate({"name": "base", "title": "base", "device": device})
    found = identify([Record("log", truth.period, position, force)], base=base)
    assert found.amplifier_order == 1
    assert any("amplifier_order 2, the logs 1" in note for note in found.notes)
