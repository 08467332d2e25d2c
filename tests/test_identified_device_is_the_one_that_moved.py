"""Devices of a simulator that shares no code with the project come back from their logs, inside the intervals."""

import json

import numpy as np
import pytest
from measured_device import Truth, measured, multisine

import avc_casadi as avc
from avc_casadi.cli import main
from avc_casadi.files.device_file import load_device
from avc_casadi.identification.device import device_text
from avc_casadi.identification.identify import identify
from avc_casadi.identification.record import Columns, Record, records_of

PERIOD = 1e-3


def record(truth, seconds=4.0, rms=2.0, seed=0, high=300.0, noise=0.0, added=0.0, tremble=0.0):
    random = np.random.default_rng(seed)
    wanted = multisine(random, seconds, truth.period, 0.5, high, rms)
    _, position, force = measured(truth, wanted, random, noise=noise, tremble=tremble)
    return Record("simulated", truth.period, position, force, added)


def holds(found, **truth):
    for key, value in truth.items():
        one = found.estimates[key.replace("mode_", "resonance.")]
        assert one.low <= value <= one.high, (key, one)
        assert one.low <= one.value <= one.high


def refused(found):
    return {one.key for one in found.refused}


@pytest.fixture(scope="module")
def flexible():
    truth = Truth(coulomb=0.4, delay=1.4, resonance=140.0, ratio=0.05, share=0.35, encoder=2e-5, spring=50.0)
    return identify([record(truth, seconds=5.0)])


@pytest.mark.thorough
def test_resonance_friction_and_fractional_delay(flexible):
    holds(flexible, mass_kg=0.1, damping_ns_per_m=2.0, delay_samples=1.4, coulomb_friction_n=0.4)
    holds(flexible, mode_frequency_hz=140.0, mode_damping_ratio=0.05, mode_mass_ratio=0.35, encoder_resolution_m=2e-5)
    assert flexible.encoder_at == "motor"
    assert flexible.estimates["mass_kg"].value == pytest.approx(0.1, rel=0.01)
    assert flexible.estimates["resonance.frequency_hz"].value == pytest.approx(140.0, rel=0.01)
    assert {"amplifier_bandwidth_hz", "force_scale", "friction_asymmetry_n", "max_force_n"} <= refused(flexible)


@pytest.mark.thorough
@pytest.mark.parametrize("lost", [True, False])
def test_what_drifts_goes_on_over_lost_samples_and_between_the_pieces_of_a_long_log(lost):
    truth = Truth(coulomb=0.2, delay=1.0, offset=0.1, drift=0.05, encoder=1e-5)
    random = np.random.default_rng(3)
    time, position, force = measured(truth, multisine(random, 12.0, truth.period, 0.5, 300.0, 2.0), random)
    if lost:
        kept = random.random(position.size) > 0.002
        records, _, told = records_of(Columns("log", time[kept], position[kept], force[kept]))
        assert "28 gaps in time" in told[0]
        found = identify(records)
    else:
        found = identify([Record("log", truth.period, position, force)], most_samples=4000)
    holds(found, mass_kg=0.1, offset_n=0.1, offset_drift_n_per_s=0.05)
    assert found.estimates["offset_drift_n_per_s"].value == pytest.approx(0.05, rel=0.01)


@pytest.mark.thorough
@pytest.mark.parametrize(("bandwidth", "delay"), [(400.0, 1.0), (60.0, None)])
def test_the_lag_of_an_amplifier_that_is_known_already_counts_once(bandwidth, delay, tmp_path):
    """Told with the delay by the log, it stays in the amplifier; one that lags more than the log tells is none."""
    truth = Truth(coulomb=0.2, delay=1.0, bandwidth=400.0, encoder=1e-4)
    device = f"mass_kg = 0.1\ndamping_ns_per_m = 2.0\namplifier_bandwidth_hz = {bandwidth}\n"
    (tmp_path / "base.toml").write_text(f'title = "b"\n[device]\n{device}')
    found = identify([record(truth, high=15.0)], base=avc.load_device(tmp_path / "base.toml"))
    assert "amplifier_bandwidth_hz" in refused(found)
    device = found.device.device
    low, high = device.range.delay_samples
    if delay is None:
        assert device.amplifier_bandwidth_hz is None
        assert "amplifier_bandwidth_hz" in found.device.gaps
        assert device.delay_samples == pytest.approx(found.estimates["delay_samples"].value, rel=1e-3)
    else:
        assert device.amplifier_bandwidth_hz == bandwidth
        assert low <= delay <= high
        assert device.delay_samples == pytest.approx(delay, abs=0.05)
        assert found.estimates["delay_samples"].value == pytest.approx(delay + 0.398, abs=0.05)
        assert "less the lag of the amplifier, 0.398 samples" in device_text(found.device)


@pytest.mark.thorough
def test_device_file_is_usable_at_once(flexible, tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(device_text(flexible.device))
    read = avc.load_device(path)
    assert read.device == flexible.device.device
    assert read.sources.mass_kg.grade == "measured"
    low, high = read.device.range.mass_kg
    assert low <= 0.1 <= high
    (tmp_path / "p.toml").write_text(
        'title = "t"\ndevice = "mine.toml"\n[environment]\nstiffness_n_per_m = 1e3\ndamping_ns_per_m = 1.0\n'
    )
    assert avc.load_problem(tmp_path / "p.toml").device == read.device


@pytest.mark.thorough
def test_encoder_at_the_handle_tells_the_resonance_but_not_how_the_mass_divides():
    """Nothing but viscous damping acts on the motor: other shares with another damping ratio predict the same."""
    truth = Truth(delay=1.0, resonance=150.0, ratio=0.04, share=0.3, at_handle=1.0, encoder=1e-5, spring=50.0)
    found = identify([record(truth, seed=12)])
    holds(found, mass_kg=0.1, damping_ns_per_m=2.0, delay_samples=1.0)
    holds(found, mode_frequency_hz=150.0, mode_damping_ratio=0.04)
    assert found.encoder_at == "handle"
    assert "resonance.mass_ratio" in refused(found)
    low, high = found.device.device.range.resonance.mass_ratio
    assert low <= 0.3 <= high
    assert "resonance" not in found.device.gaps


@pytest.mark.thorough
def test_rigid_device_without_friction_claims_neither():
    found = identify([record(Truth(delay=0.6, encoder=5e-6, spring=30.0), seed=3)])
    holds(found, mass_kg=0.1, damping_ns_per_m=2.0, delay_samples=0.6)
    assert not {"resonance", "coulomb", "stribeck", "amplifier"} & set(found.terms)
    assert found.estimates.get("coulomb_friction_n") is None or found.estimates["coulomb_friction_n"].low == 0


@pytest.mark.thorough
def test_stiff_controller_in_a_loop_does_not_lean_the_estimates():
    """A wall of 2 kN/m with damping, noise of the encoder fed back through it: least squares is biased, this is not."""
    truth = Truth(mass=0.2, coulomb=0.3, delay=1.0, encoder=5e-5, spring=2000.0, damper=4.0)
    found = identify([record(truth, rms=3.0, seed=4, noise=2e-5)])
    holds(found, mass_kg=0.2, damping_ns_per_m=2.0, delay_samples=1.0, coulomb_friction_n=0.3)
    assert found.feedback
    assert any("closed loop" in note for note in found.notes)


@pytest.mark.thorough
def test_known_added_mass_tells_the_scale_of_the_force():
    plain = Truth(mass=0.15, damping=3.0, scale=0.8, delay=1.0, encoder=1e-5, spring=50.0)
    loaded = Truth(mass=0.35, damping=3.0, scale=0.8, delay=1.0, encoder=1e-5, spring=50.0)
    found = identify([record(plain, seed=5), record(loaded, seed=6, added=0.2)])
    holds(found, mass_kg=0.15, damping_ns_per_m=3.0, force_scale=0.8)
    assert "force_scale" not in refused(found)


@pytest.mark.thorough
def test_something_that_holds_the_device_is_named():
    found = identify([record(Truth(ground=400.0, delay=1.0, encoder=5e-6), seed=8)])
    holds(found, stiffness_n_per_m=400.0, mass_kg=0.1)
    assert any("holds the device" in note for note in found.notes)


@pytest.mark.thorough
def test_slow_log_refuses_what_it_does_not_tell():
    """Up to 4 Hz nothing is said of a delay below a sample; the mass goes under in friction."""
    found = identify([record(Truth(coulomb=0.5, delay=1.0, encoder=6e-5, spring=200.0), high=4.0, rms=1.0, seed=9)])
    holds(
        found, **{key: value for key, value in {"mass_kg": 0.1, "delay_samples": 1.0}.items() if key in found.estimates}
    )
    for one in found.refused:
        assert one.why
        assert one.excitation
    assert "resonance" in refused(found)


@pytest.mark.thorough
def test_verb_writes_device_document_and_page(tmp_path, capsys):
    random = np.random.default_rng(1)
    truth = Truth(delay=1.0, encoder=1e-5, spring=50.0)
    time, position, force = measured(truth, multisine(random, 3.0, PERIOD, 0.5, 200.0, 2.0), random)
    log = tmp_path / "log.csv"
    columns = np.column_stack([1e3 * time, 1e6 * position, force])
    np.savetxt(log, columns, delimiter=",", header="time_ms,position_um,force_N", comments="")
    out, page = tmp_path / "d.toml", tmp_path / "p.html"
    assert main(["identify", str(log), "--out", str(out), "--report", str(page), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["kind"] == "identify"
    assert document["estimates"]["mass_kg"]["low"] <= 0.1 <= document["estimates"]["mass_kg"]["high"]
    names = document["correlation"]["names"]
    assert np.array(document["correlation"]["of_estimates"]).shape == (len(names), len(names))
    assert avc.load_device(out).device.mass_kg == pytest.approx(0.1, rel=0.01)
    text = page.read_text(encoding="utf-8")
    # Two pictures, each for a desktop and with its panels stacked for a phone.
    assert text.count("data:image/svg+xml;base64,") == 4
    assert "http://" not in text.replace("http://www.w3.org", "")


@pytest.mark.thorough
@pytest.mark.parametrize(("hertz", "size", "coulomb"), [(3.0, 2.0, 0.2), (4.0, 3.0, 0.1)])
def test_friction_that_one_sine_does_not_tell_from_damping_is_not_said_to_be_none(hertz, size, coulomb):
    truth = Truth(damping=0.5, coulomb=coulomb, delay=1.0, encoder=2e-5)
    wanted = size * np.sin(2 * np.pi * hertz * np.arange(8000) * PERIOD)
    _, position, force = measured(truth, wanted, np.random.default_rng(4))
    found = identify([Record("sine", PERIOD, position, force)])
    one = found.estimates.get("coulomb_friction_n")
    assert one is None or one.low <= coulomb <= one.high
    for key, value in {"mass_kg": 0.1, "damping_ns_per_m": 0.5, "delay_samples": 1.0}.items():
        assert key in refused(found) or found.estimates[key].low <= value <= found.estimates[key].high


@pytest.mark.thorough
def test_forces_that_the_device_does_not_give_and_ticks_that_are_not_logged_are_refused(tmp_path):
    (tmp_path / "d.toml").write_text(
        "[device]\nmass_kg = 0.1\ndamping_ns_per_m = 2.0\nsample_time_s = 5e-4\nmax_force_n = 3.0\n"
    )
    one = record(Truth(encoder=1e-5, spring=50.0))
    with pytest.raises(avc.InputError) as caught:
        identify([one], base=load_device(tmp_path / "d.toml"))
    first, second = (str(fault) for fault in caught.value.faults)
    assert "for more than device.max_force_n, 3 N" in first
    assert "steps by 1 ms, 2 times device.sample_time_s" in second
    (tmp_path / "d.toml").write_text("[device]\nmass_kg = 0.1\ndamping_ns_per_m = 2.0\nmax_force_n = 30.0\n")
    assert identify([one], base=load_device(tmp_path / "d.toml")).estimates["mass_kg"].value > 0
