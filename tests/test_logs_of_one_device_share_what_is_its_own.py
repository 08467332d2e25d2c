"""Several logs: one device, a constant force for each, and a word where they are not of one device."""

from dataclasses import replace

import numpy as np
import pytest
from measured_device import Truth, measured, multisine

from avc_casadi.files.device_file import parse_device
from avc_casadi.identification.device import device_file
from avc_casadi.identification.identify import identify
from avc_casadi.identification.model import Estimate
from avc_casadi.identification.read import read_logs
from avc_casadi.identification.record import Columns, Record, records_of
from avc_casadi.identification.told import identification_document

DEVICE = Truth(mass=0.12, damping=0.8, coulomb=0.1, delay=1.3, encoder=20e-6, spring=20.0, damper=0.6)
GAPS = (
    '["delay_samples", "coulomb_friction_n", "position_noise_rms_m", "amplifier_bandwidth_hz", "max_force_n", '
    '"backlash_m", "resonance"]'
)


def log(name, seed, seconds=8.0, **changed):
    random = np.random.default_rng(seed)
    truth = replace(DEVICE, **changed)
    time, position, force = measured(truth, multisine(random, seconds, truth.period, 0.5, 150.0, 3.0), random)
    return Columns(name, time, position, force)


def record(columns):
    return Record(columns.file, 1e-3, columns.position_m, columns.force_n)


@pytest.mark.thorough
def test_a_device_turned_over_is_the_same_device():
    found = identify([record(log("up", 1, offset=0.27)), record(log("down", 2, offset=-0.33))])
    for key, truth in (
        ("mass_kg", 0.12),
        ("damping_ns_per_m", 0.8),
        ("coulomb_friction_n", 0.1),
        ("offset_n", 0.27),
        ("log_2.offset_n", -0.33),
    ):
        one = found.estimates[key]
        assert abs(truth - one.value) <= one.high - one.low, (key, one)
        assert one.value == pytest.approx(truth, rel=2e-3)
    assert found.estimates["log_2.offset_n"].how == "output error, in down"
    assert not any("do not agree" in note for note in found.notes)
    assert "log_2.offset_n" in identification_document(found)["estimates"]


@pytest.mark.thorough
def test_pieces_of_one_log_have_one_constant_force():
    whole = log("whole", 3, offset=0.2)
    kept = np.ones(whole.time_s.size, dtype=bool)
    kept[4000:4003] = False
    cut = replace(whole, time_s=whole.time_s[kept], position_m=whole.position_m[kept], force_n=whole.force_n[kept])
    records, faults, _ = records_of(cut)
    assert not faults
    assert len(records) == 2
    assert {one.whole for one in records} == {"whole"}
    found = identify(records)
    assert found.estimates["offset_n"].value == pytest.approx(0.2, abs=1e-3)
    assert not any(name.startswith("log_") for name in found.names)


@pytest.mark.thorough
def test_the_weight_of_a_known_mass_is_no_scale_of_the_force(tmp_path):
    paths = []
    for index, added in enumerate((0.0, 0.05)):
        columns = log("", 10 + index, mass=0.12 + added, offset=9.81 * added)
        paths.append(tmp_path / f"{index}.csv")
        np.savetxt(
            paths[-1],
            np.column_stack([columns.time_s, columns.position_m, columns.force_n]),
            delimiter=",",
            header="time_s,position_m,force_n",
        )
    records, _ = read_logs(paths, None, (0.0, 0.05))
    found = identify(records)
    assert found.estimates["force_scale"].value == pytest.approx(1.0, rel=2e-3)
    assert found.estimates["mass_kg"].value == pytest.approx(0.12, rel=2e-3)


@pytest.mark.thorough
def test_a_share_that_is_assumed_at_the_end_of_its_interval_is_written():
    """Found on a log of a thousand: its two digits lay outside of what the log allowed."""
    found = identify([record(log("log", 1))])
    mode = {
        f"resonance.{key}": Estimate(f"resonance.{key}", unit, value, 0.9 * value, 1.1 * value, 0.95, "output error")
        for key, unit, value in (("frequency_hz", "Hz", 80.0), ("damping_ratio", "", 0.03))
    }
    found = replace(found, assumed_share=(0.41624, 0.1, 0.41624), estimates={**found.estimates, **mode})
    written = device_file(found, None).device
    assert written.resonance.mass_ratio == 0.42
    assert written.range.resonance.mass_ratio == (0.1, 0.42)


@pytest.mark.thorough
def test_a_file_of_another_device_is_doubted():
    said = "[device]\nsample_time_s = 2e-3\nmass_kg = 5.0\ndamping_ns_per_m = 0.7\nencoder_resolution_m = 1e-4\n"
    graded = "".join(
        f'{key} = {{ grade = "assumed", source = "the test" }}\n'
        for key in ("sample_time_s", "mass_kg", "damping_ns_per_m", "encoder_resolution_m")
    )
    base = parse_device(f'title = "Other"\ngaps = {GAPS}\n{said}[sources]\n{graded}', name="other")
    found = identify([record(log("log", 1))], base=base)
    (note,) = (one for one in found.notes if one.startswith("other says"))
    assert "sample_time_s 0.002, the logs 0.001" in note
    assert "mass_kg 2.5 to 10, the logs 0.12" in note
    assert "encoder_resolution_m" in note
    assert "damping" not in note


@pytest.mark.thorough
def test_logs_of_two_devices_are_told():
    found = identify([record(log("light", 1)), record(log("heavy", 2, mass=0.2))])
    (note,) = (one for one in found.notes if "do not agree" in one)
    assert "by light alone" in note
    assert "by heavy" in note


@pytest.mark.thorough
@pytest.mark.one_of(2)
@pytest.mark.parametrize(("side", "resonance"), [("rooted", 30.0), ("rooted", 60.0), ("ground", 60.0)])
def test_a_spring_may_be_on_either_side_of_a_resonance(side, resonance):
    """Force to position of the motor is the same; the intervals hold both devices."""
    changed = {"resonance": resonance, "ratio": 0.03, "share": 0.35, "encoder": 5e-6, side: 250.0}
    found = identify([record(log("log", 5, seconds=20.0, **changed))])
    assert {"resonance", "stiffness"} <= set(found.terms)
    for key, truth in (("mass_kg", 0.12), ("stiffness_n_per_m", 250.0), ("resonance.mass_ratio", 0.35)):
        assert found.estimates[key].low <= truth <= found.estimates[key].high, key
    assert any("either side of the resonance" in note for note in found.notes)
