"""Device files: every value has a source and a grade, gaps are named, and problems refer to them and override them."""

import pytest

import avc_casadi as avc
from avc_casadi.files.catalogue import device_names
from avc_casadi.model.device import Device

HOW_MEANT = {"motion", "handle_radius_m", "amplifier_order", "encoder_at", "held", "range"}
# Most amplifiers are lags, which have no damping ratio.
QUANTITIES = set(Device.model_fields) - HOW_MEANT - {"amplifier_damping_ratio"}
WALL = "[environment]\ndamping_ns_per_m = 0.0\nstiffness_n_per_m = 5e3\n"
SMALL = """title = "mine"
gaps = ["delay_samples", "coulomb_friction_n", "position_noise_rms_m", "amplifier_bandwidth_hz", "backlash_m"]
[device]
mass_kg = 0.2
damping_ns_per_m = 1.0
sample_time_s = 1e-3
encoder_resolution_m = 1e-5
max_force_n = 9.0
resonance = { frequency_hz = 120.0, damping_ratio = 0.05, mass_ratio = 0.4 }
[device.range]
mass_kg = [0.1, 0.3]
damping_ns_per_m = [0.5, 2.0]
resonance = { frequency_hz = [100.0, 140.0], mass_ratio = [0.3, 0.5] }
[sources]
mass_kg = { grade = "measured", source = "scale" }
damping_ns_per_m = { grade = "measured", source = "log" }
sample_time_s = { grade = "vendor", source = "manual" }
encoder_resolution_m = { grade = "vendor", source = "manual" }
max_force_n = { grade = "vendor", source = "manual" }
resonance = { grade = "measured", source = "chirp" }
"""


def device_of(text, **options):
    return avc.parse_problem(text + WALL, **options).device


@pytest.mark.parametrize("name", sorted(device_names()))
def test_every_value_has_a_source_and_every_gap_a_name(name):
    file = avc.load_device(name)
    assert file.name == name
    assert file.title
    sources = file.model_dump()["sources"]
    stated = (file.device.model_fields_set | file.device.range.model_fields_set) & QUANTITIES
    assert set(sources) == stated
    assert all(source["source"] for source in sources.values())
    assert stated | set(file.gaps) == QUANTITIES
    assert all(sources[gap]["grade"] == "assumed" for gap in set(file.gaps) & stated)
    for key in file.device.range.model_fields_set:
        low, high = getattr(file.device.range, key)
        assert low <= getattr(file.device, key) <= high
    if file.sdk_example is not None:
        assert file.sdk_example.source


def test_an_override_replaces_the_value_and_its_doubt(tmp_path):
    (tmp_path / "mine.toml").write_text(SMALL)

    def changed(*lines):
        return device_of("\n".join(("[device]", 'from = "mine.toml"', *lines, "")), folder=tmp_path)

    plain = changed()
    assert changed("max_force_n = 3.0") == plain.model_copy(update={"max_force_n": 3.0})
    heavier = changed("mass_kg = 0.9")
    assert heavier.mass_kg == 0.9
    assert heavier.range.mass_kg is None
    assert heavier.range.damping_ns_per_m == (0.5, 2.0)
    ranged = changed("mass_kg = 0.9", "range = { mass_kg = [0.8, 1.0] }")
    assert ranged.range.mass_kg == (0.8, 1.0)
    assert ranged.range.resonance == plain.range.resonance
    mode = changed("resonance = { frequency_hz = 300.0 }")
    assert mode.resonance.frequency_hz == 300.0
    assert mode.resonance.mass_ratio == 0.4
    assert mode.range.resonance.frequency_hz is None
    assert mode.range.resonance.mass_ratio == (0.3, 0.5)
    wider = changed("range = { resonance = { mass_ratio = [0.1, 0.9] } }")
    assert wider.range.resonance.mass_ratio == (0.1, 0.9)
    assert wider.range.resonance.frequency_hz == (100.0, 140.0)
