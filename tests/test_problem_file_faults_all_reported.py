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


MANY_FAULTS = """title = 3
surplus = 1
environment = 3
[device]
mass_kg = -1
damping_ns_per_m = "2"
dampling_ns_per_m = 2
sample_time_s = 2e-3
range.mass_kg = [2, 1]
[boundaries.upper]
damping_ns_per_m = 1
stiffness_n_per_m = 1
[boundaries.lower]
damping_ns_per_m = 2
stiffness_n_per_m = inf
[coupling]
structure = "serie"
damping_ns_per_m = [0, 1, 2]
stiffness_n_per_m = [ # neither a "]" in a comment nor one in a text ends this
    true, "]",
]
[frequency]
stop_hz = 250
[scene]
motion = {kind = "pres"}
[[scene.effects]]
[[scene.effects]]
kind = "notch"
depth = 1.5
[[scene.effects]]
kind = "delay"
delay = 1
samples = -1
[[scene.effects]]
kind = "adaptation"
passive = 1
[[scene.effects]]
kind = 3
"""


def test_faults_of_many_kinds_are_told_together():
    told = [(fault.line, fault.key, fault.message) for fault in faults_of(MANY_FAULTS)]
    expected = [
        (1, "title", "not a text"),
        (2, "surplus", "not a known key"),
        (3, "environment", "not a table"),
        (5, "device.mass_kg", "is -1; allowed: 0 or 1e-9 to 1e6 kg"),
        (6, "device.damping_ns_per_m", 'is "2", not a number'),
        (7, "device.dampling_ns_per_m", "did you mean damping_ns_per_m?"),
        (9, "device.range.mass_kg", "reversed"),
        (11, "boundaries.upper.damping_ns_per_m", "is 1, below the lower bound 2"),
        (15, "boundaries.lower.stiffness_n_per_m", "is inf"),
        (17, "coupling.structure", 'did you mean "series"?'),
        (18, "coupling.damping_ns_per_m", "two numbers"),
        (19, "coupling.stiffness_n_per_m[0]", "is true, not a number"),
        (19, "coupling.stiffness_n_per_m[1]", 'is "]", not a number'),
        (23, "frequency.stop_hz", "Nyquist frequency 250 Hz"),
        (25, "scene.motion.kind", 'did you mean "press"?'),
        (26, "scene.effects[0].kind", "is missing"),
        (27, "scene.effects[1].frequency_hz", "is missing; allowed: 1e-6 to 1e7 Hz"),
        (29, "scene.effects[1].depth", "is 1.5; allowed: 0 or 1e-9 to 1"),
        (32, "scene.effects[2].delay", "not a known key; allowed: kind, samples"),
        (33, "scene.effects[2].samples", "is -1; allowed: 0 or 0.001 to 1000 samples"),
        (36, "scene.effects[3].passive", "is 1; allowed: true or false"),
        (38, "scene.effects[4].kind", "is 3; allowed:"),
    ]
    assert [item[:2] for item in told] == [item[:2] for item in expected]
    for (_, _, message), (_, key, part) in zip(told, expected, strict=True):
        assert part in message, key


@pytest.mark.parametrize(
    ("sample_time_s", "end"),
    [(1.0, "allowed: below 0.5 Hz; sample_time_s is in seconds: 1 ms is 0.001"), (0.02, "allowed: below 25 Hz")],
)
def test_a_sample_time_in_milliseconds_is_told_its_unit(sample_time_s, end):
    text = f"""
        [device]
        mass_kg = 0.1
        damping_ns_per_m = 2.0
        sample_time_s = {sample_time_s}
        [environment]
        damping_ns_per_m = 0.0
        stiffness_n_per_m = 1000.0
        [frequency]
        stop_hz = 30.0
    """
    assert faults_of(text)[-1].message.endswith(end)


def test_windows_line_ends_do_not_move_the_lines():
    unix = faults_of(MANY_FAULTS)
    assert faults_of(MANY_FAULTS.replace("\n", "\r\n")) == unix


@pytest.mark.parametrize(
    ("addition", "key", "message"),
    [
        (
            "[frequency]\nstop_hz = 500.0",
            "frequency.stop_hz",
            "where the Tustin map is infinite; allowed: below 500 Hz",
        ),
        ("[frequency]\nstart_hz = 20\nstop_hz = 10", "frequency.stop_hz", "is 10, below start_hz = 20"),
        ("[frequency]\nstart_hz = 460", "frequency.stop_hz", "is 450.0 (the default), below start_hz = 460"),
        (
            "[frequency]\nstart_hz = 10\nstop_hz = 10",
            "frequency.points",
            "is 200, too many between 10 and 10 Hz",
        ),
        ("[frequency]\nstart_hz = 600\npoints = 1", "frequency.start_hz", "Nyquist"),
        ("[frequency]\npoints = 10.0", "frequency.points", "not an integer"),
        ("[frequency]\npoints = 0", "frequency.points", "an integer 1 to 20000"),
        ("[frequency]\nvalues_hz = []", "frequency.values_hz", "at least one"),
        ("[frequency]\nvalues_hz = [3, 1]", "frequency.values_hz[1]", "is 1 and is below the one before, 3"),
        (
            "[frequency]\nvalues_hz = [1, 2, 2]",
            "frequency.values_hz[2]",
            "is 2 and repeats the one before, 2",
        ),
        ("[frequency]\nvalues_hz = [1, 500]", "frequency.values_hz[1]", "Nyquist"),
        ("[frequency]\nvalues_hz = [1]\npoints = 3", "frequency.points", "stands beside values_hz"),
        ("[coupling]\ncontact_damping_ns_per_m = [0, 1]", "coupling.contact_damping_ns_per_m", "damped"),
        ("[device.range]\nmass_kg = [0.2, 0.3]", "device.range.mass_kg", "device.mass_kg = 0.1"),
        ("[device.range]\ndamping_ns_per_m = [0, 1]", "device.range.damping_ns_per_m", "= 2.0"),
        ("[device.range]\ndelay_samples = [1, 2.5]", "device.range.delay_samples", "device.delay_samples = 0"),
        ("[device.range]\nbacklash_m = [1e-3, 2e-3]", "device.range.backlash_m", "device.backlash_m = 0.0"),
        ("[device.range]\nmax_force_n = [1, 2]", "device.range.max_force_n", "device.max_force_n is missing"),
        (
            "[device.range.resonance]\nmass_ratio = [0.2, 0.4]",
            "device.range.resonance.mass_ratio",
            "device.resonance.mass_ratio is missing",
        ),
        (
            MODE + "[device.range.resonance]\nmass_ratio = [0.4, 0.5]",
            "device.range.resonance.mass_ratio",
            "device.resonance.mass_ratio = 0.3",
        ),
        (
            "[device.resonance]\nfrequency_hz = 100\ndamping_ratio = 0.1\nmass_ratio = 1.0",
            "device.resonance.mass_ratio",
            "1e-6 to 0.999999",
        ),
        (
            MODE + "[device.range]\nmass_kg = [0, 0.2]",
            "device.range.mass_kg",
            "allowed: from above 0 kg",
        ),
        (
            "[device.range]\nmass_kg = [0, 0.2]",
            "device.range.mass_kg",
            "allowed: from above 0 kg",
        ),
        ("[device.resonance]\nfrequency_hz = 100\ndamping_ratio = 0.1", "device.resonance.mass_ratio", "is missing"),
        ("[boundaries.upper]\ndamping_ns_per_m = 1\nstiffness_n_per_m = 1", "boundaries.lower", "is missing"),
        (
            "[scene]\nduration_s = 5e-4",
            "scene.duration_s",
            "at least one sample, device.sample_time_s = 0.001",
        ),
        ("[scene]\neffects = 3", "scene.effects", "one [[scene.effects]] for each effect"),
        ("[scene.effects]\nkind = 'hand'", "scene.effects", "one [[scene.effects]] for each effect"),
        ("[[scene.effects]]\nkind = 'saturation'", "scene.effects[0].force_n", "device.max_force_n"),
        ("[[device_]]", "device_", "did you mean device?"),
        ("[coupling]\nmotion = 'rotary'", "coupling.motion", "it belongs in [device] or [scene]"),
        ("[hands]\ncoulomb_friction_n = 1", "hands.coulomb_friction_n", "it belongs in [device]"),
        ("[coupling]\nmass_kg = 1", "coupling.mass_kg", "it belongs in [device] or [hands]"),
        (
            "[[scene.effects]]\nkind = 'saturation'\nmax_force_n = 1",
            "scene.effects[0].max_force_n",
            "did you mean force_n?",
        ),
        ("[hands]\nmass_kg = [1e-12, 1]", "hands.mass_kg[0]", "is 1e-12"),
        ("[stability]\nscope = 'all '", "stability.scope", 'did you mean "all"?'),
        ('["a b"]', '"a b"', "is not a known key"),
        ("[hands]\nkind = 'mass_kg'", "hands.kind", "is not a known key"),
        ("[[scene.effects]]\nkind = []", "scene.effects[0].kind", "is []; allowed:"),
        (
            "[[scene.effects]]\nkind = 'delay'\nsamples = -1.5",
            "scene.effects[0].samples",
            "is -1.5; allowed: 0 or 0.001 to 1000",
        ),
        ("[name]", "name", "the file's own name"),
    ],
)
def test_each_rule_names_its_key(addition, key, message):
    (fault,) = faults_of(SMALL + addition)
    assert fault.key == key
    assert message in fault.message
    assert fault.line is None or fault.line > SMALL.count("\n")


def test_a_range_that_is_wrong_hides_no_other_one():
    ranges = "[device.range]\nmass_kg = [0.3, 0.1]\ndelay_samples = [2, 3]\ndamping_ns_per_m = [-1, 'x']\n"
    found = {fault.key for fault in faults_of(SMALL + ranges)}
    keys = ("mass_kg", "delay_samples", "damping_ns_per_m[0]", "damping_ns_per_m[1]")
    assert found == {f"device.range.{key}" for key in keys}


def test_a_fault_hides_no_broken_rule_that_does_not_need_it():
    text = SMALL + "[frequency]\nstart_hz = 'one'\npoints = 2.5\nstop_hz = 600\n[scene]\nduration_s = 0.0001\n"
    keys = [fault.key for fault in faults_of(text)]
    assert keys == ["frequency.start_hz", "frequency.points", "frequency.stop_hz", "scene.duration_s"]
    assert [fault.key for fault in faults_of(text.replace("600", "0.5"))] == [*keys[:2], keys[3]]


HUGE = "1" + "0" * 400


@pytest.mark.parametrize("value", ["inf", "-inf", "nan", "-1.0", '"1"', "true", "1e308", "5e-324", "[]", HUGE])
@pytest.mark.parametrize("key", ["mass_kg", "damping_ns_per_m", "sample_time_s", "coulomb_friction_n", "max_force_n"])
def test_unphysical_numbers_are_refused(key, value):
    table = {"mass_kg": "0.1", "damping_ns_per_m": "2.0", key: value}
    device = "".join(f"{name} = {text}\n" for name, text in table.items())
    (fault,) = faults_of(f"[device]\n{device}[environment]\ndamping_ns_per_m = 1\nstiffness_n_per_m = 1\n")
    assert fault.key == f"device.{key}"
    assert "allowed: " in fault.message


def test_missing_tables_and_keys_are_faults():
    assert [(fault.line, fault.key) for fault in faults_of("title = 'x'")] == [
        (None, "device"),
        (None, "environment"),
    ]
    assert [(fault.line, fault.key) for fault in faults_of("[device]\n[environment]\nstiffness_n_per_m = 0")] == [
        (1, "device.mass_kg"),
        (1, "device.damping_ns_per_m"),
        (2, "environment.damping_ns_per_m"),
    ]


def test_a_syntax_error_has_its_line():
    (fault,) = faults_of(SMALL + "[frequency]\npoints = \n")
    assert fault.line == SMALL.count("\n") + 2
    assert "is not TOML" in fault.message
    (fault,) = faults_of(SMALL + '[frequency]\nspacing = """')
    assert fault.line == SMALL.count("\n") + 2


def test_the_messages_of_pydantic_stay_inside():
    for fault in faults_of(MANY_FAULTS):
        assert "pydantic" not in fault.message
        assert "nput should" not in fault.message
        assert "http" not in fault.message


def test_the_document_of_bad_input_holds_the_first_faults_and_counts_the_rest():
    with pytest.raises(avc.InputError) as caught:
        avc.parse_problem(MANY_FAULTS, file="mine.toml")
    document = avc.fault_document(caught.value)
    assert list(document) == ["errors"]
    *first, more = document["errors"]
    assert [entry["line"] for entry in first] == [fault.line for fault in caught.value.faults[: len(first)]]
    assert more["message"] == f"has {len(caught.value.faults) - len(first)} more faults"
    assert all(set(entry) == {"file", "line", "key", "message"} for entry in document["errors"])
    assert {entry["file"] for entry in document["errors"]} == {"mine.toml"}
    assert str(caught.value).startswith("mine.toml:1: title: is 3, not a text")


def test_a_problem_made_in_python_keeps_the_same_rules():
    problem = avc.load_problem("figure5")
    with pytest.raises(ValueError, match=r"frequency.stop_hz: is 500.0, at or above the Nyquist frequency"):
        avc.Problem(device=problem.device, environment=problem.environment, frequency={"stop_hz": 500.0})


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ('device = "phantom-omni"\n[device]\nmass_kg = 0.1\n', 2),
        ("[device]\nmass_kg = 0.1\nmass_kg = 0.2\n", 3),
        ("[environment]\ndamping_ns_per_m = 1\n[environment]\n", 3),
    ],
)
def test_what_is_given_twice_is_told_as_that(text, line):
    with pytest.raises(avc.InputError) as caught:
        avc.parse_problem(text)
    (fault,) = caught.value.faults
    assert fault.line == line
    assert "a second time" in fault.message
    assert ("from =" in fault.message) == text.startswith("device =")


@pytest.mark.parametrize("period", [2e-3, 0.01])
def test_a_slow_device_needs_no_band_of_its_own(period):
    text = WALL.format(period=period)
    assert avc.parse_problem(text).frequencies_hz().max() == pytest.approx(0.45 / period)
    with pytest.raises(avc.InputError, match=r"frequency\.stop_hz: is 450\.0, at or above"):
        avc.parse_problem(text + "[frequency]\nstop_hz = 450.0\n")


WALL = """
[device]
mass_kg = 0.1
damping_ns_per_m = 1.0
sample_time_s = {period}
[environment]
stiffness_n_per_m = 100.0
damping_ns_per_m = 1.0
"""


@pytest.mark.parametrize(
    ("key", "hint"),
    [
        ("force_n", "did you mean max_force_n?"),  # [detent] has a key of this name
        ("damping_ratio", "it belongs in [device.resonance]"),
        ("frequency_hz", "it belongs in [device.resonance]"),
        ("stiffness_n_per_m", "it belongs in [environment] or [coupling] or [hands]"),
    ],
)
def test_the_likeliest_place_of_a_key_is_told(key, hint):
    (fault,) = faults_of(SMALL.replace("[environment]", f"{key} = 3.0\n[environment]"))
    assert fault.key == f"device.{key}"
    assert fault.message.endswith(hint)


def test_a_key_that_is_of_the_device_alone_has_no_other_table_in_its_range():
    (fault,) = faults_of(SMALL + "[device.range]\nsample_time_s = [1e-3, 2e-3]")
    assert "belongs" not in fault.message
