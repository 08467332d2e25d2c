"""Every fault of a problem file is reported at once, with its line and key, and none hides another."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

import avc_casadi as avc

FIGURE5 = avc.catalogue_path("figure5").read_text(encoding="utf-8")
LINES = FIGURE5.split("\n")
# Without its kind nothing is known of the other keys of a motion, and let_go may be true.
KEY_LINES = [number for number, line in enumerate(LINES, start=1) if re.match(r"(?!kind|let_go)\w+ = ", line)]
WRONG_FOR_EVERY_KEY = ["{}", "[[]]", "1979-05-27", "true", "nan"]
SMALL = """[device]
mass_kg = 0.1
damping_ns_per_m = 2.0
[environment]
damping_ns_per_m = 10.0
stiffness_n_per_m = 1e5
"""
MODE = "[device.resonance]\nfrequency_hz = 100\ndamping_ratio = 0.1\nmass_ratio = 0.3\n"


def faults_of(text):
    with pytest.raises(avc.InputError) as caught:
        avc.parse_problem(text)
    return caught.value.faults


@pytest.mark.thorough
@given(st.dictionaries(st.sampled_from(KEY_LINES), st.sampled_from(WRONG_FOR_EVERY_KEY), min_size=1))
def test_every_spoilt_line_is_named_and_no_other(spoilt):
    lines = [
        line.split(" = ")[0] + " = " + spoilt[number] if number in spoilt else line
        for number, line in enumerate(LINES, start=1)
    ]
    faults = faults_of("\n".join(lines))
    assert {fault.line for fault in faults} == set(spoilt)
    for fault in faults:
        assert LINES[fault.line - 1].split(" = ")[0] == re.sub(r"\[\d+\]", "", fault.key).split(".")[-1]


RULES = [
    ("[frequency]\nstop_hz = 500.0", "frequency.stop_hz"),
    ("[frequency]\nstart_hz = 20\nstop_hz = 10", "frequency.stop_hz"),
    ("[frequency]\nstart_hz = 460", "frequency.stop_hz"),
    ("[frequency]\nstart_hz = 10\nstop_hz = 10", "frequency.points"),
    ("[frequency]\nstart_hz = 600\npoints = 1", "frequency.start_hz"),
    ("[frequency]\npoints = 10.0", "frequency.points"),
    ("[frequency]\nvalues_hz = []", "frequency.values_hz"),
    ("[frequency]\nvalues_hz = [3, 1]", "frequency.values_hz[1]"),
    ("[frequency]\nvalues_hz = [1, 500]", "frequency.values_hz[1]"),
    ("[frequency]\nvalues_hz = [1]\npoints = 3", "frequency.points"),
    ("[coupling]\ncontact_damping_ns_per_m = [0, 1]", "coupling.contact_damping_ns_per_m"),
    ("[device.range]\nmass_kg = [0.2, 0.3]", "device.range.mass_kg"),
    ("[device.range]\nmass_kg = [0, 0.2]", "device.range.mass_kg"),
    ("[device.range]\nmax_force_n = [1, 2]", "device.range.max_force_n"),
    ("[device.range.resonance]\nmass_ratio = [0.2, 0.4]", "device.range.resonance.mass_ratio"),
    (MODE + "[device.range.resonance]\nmass_ratio = [0.4, 0.5]", "device.range.resonance.mass_ratio"),
    ("[device.resonance]\nfrequency_hz = 100\ndamping_ratio = 0.1", "device.resonance.mass_ratio"),
    ("[boundaries.upper]\ndamping_ns_per_m = 1\nstiffness_n_per_m = 1", "boundaries.lower"),
    ("[scene]\nduration_s = 5e-4", "scene.duration_s"),
    ("[scene]\neffects = 3", "scene.effects"),
    ("[[scene.effects]]\nkind = 'saturation'", "scene.effects[0].force_n"),
    ("[[device_]]", "device_"),
    ("[hands]\nmass_kg = [1e-12, 1]", "hands.mass_kg[0]"),
    ("[stability]\nscope = 'all '", "stability.scope"),
    ('["a b"]', '"a b"'),
    ("[name]", "name"),
]


@pytest.mark.parametrize(("addition", "key"), RULES)
def test_each_rule_names_its_key(addition, key):
    (fault,) = faults_of(SMALL + addition)
    assert fault.key == key
    assert fault.message
    assert fault.line is None or fault.line > SMALL.count("\n")


HUGE = "1" + "0" * 400


@pytest.mark.parametrize("value", ["inf", "-inf", "nan", "-1.0", '"1"', "true", "1e308", "5e-324", "[]", HUGE])
@pytest.mark.parametrize("key", ["mass_kg", "damping_ns_per_m", "sample_time_s", "coulomb_friction_n", "max_force_n"])
def test_unphysical_numbers_are_refused(key, value):
    table = {"mass_kg": "0.1", "damping_ns_per_m": "2.0", key: value}
    device = "".join(f"{name} = {text}\n" for name, text in table.items())
    (fault,) = faults_of(f"[device]\n{device}[environment]\ndamping_ns_per_m = 1\nstiffness_n_per_m = 1\n")
    assert fault.key == f"device.{key}"
    assert "allowed: " in fault.message


def test_a_syntax_error_has_its_line():
    (fault,) = faults_of(SMALL + "[frequency]\npoints = \n")
    assert fault.line == SMALL.count("\n") + 2
    assert "is not TOML" in fault.message
    (fault,) = faults_of(SMALL + '[frequency]\nspacing = """')
    assert fault.line == SMALL.count("\n") + 2
