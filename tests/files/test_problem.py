"""Every fault of a problem file is reported at once, with its line and key, and none hides another."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

import avc_casadi as avc
from avc_casadi.files.admittance_file import load_sensor_problem
from avc_casadi.files.catalogue import admittance_names, catalogue_names, device_names
from avc_casadi.files.plausibility import USUAL, device_plausibility, plausibility
from avc_casadi.files.problem_file import load_any
from avc_casadi.recommendation.preconditions import assumed

# Without its kind nothing is known of the other keys of a motion, and let_go may be true.
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


RULES = [
    ("[frequency]\nstop_hz = 500.0", "frequency.stop_hz"),
    ("[frequency]\nstart_hz = 20\nstop_hz = 10", "frequency.stop_hz"),
    ("[frequency]\nvalues_hz = []", "frequency.values_hz"),
    ("[frequency]\nvalues_hz = [3, 1]", "frequency.values_hz[1]"),
    ("[frequency]\nvalues_hz = [1]\npoints = 3", "frequency.points"),
    ("[coupling]\ncontact_damping_ns_per_m = [0, 1]", "coupling.contact_damping_ns_per_m"),
    ("[device.range]\nmass_kg = [0.2, 0.3]", "device.range.mass_kg"),
    ("[device.range]\nmax_force_n = [1, 2]", "device.range.max_force_n"),
    (MODE + "[device.range.resonance]\nmass_ratio = [0.4, 0.5]", "device.range.resonance.mass_ratio"),
    ("[device.resonance]\nfrequency_hz = 100\ndamping_ratio = 0.1", "device.resonance.mass_ratio"),
    ("[boundaries.upper]\ndamping_ns_per_m = 1\nstiffness_n_per_m = 1", "boundaries.lower"),
    ("[scene]\nduration_s = 5e-4", "scene.duration_s"),
    ("[[scene.effects]]\nkind = 'saturation'", "scene.effects[0].force_n"),
    ("[hands]\nmass_kg = [1e-12, 1]", "hands.mass_kg[0]"),
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


PLAUSIBILITY_MODE = {"frequency_hz": 150.0, "damping_ratio": 0.05, "mass_ratio": 0.5}


@pytest.mark.parametrize(
    ("tables", "key"),
    [
        ({"device": {"mass_kg": 250.0}}, "device.mass_kg"),
        ({"device": {"encoder_resolution_m": 0.06}}, "device.encoder_resolution_m"),
        ({"device": {"sample_time_s": 1.0}, "frequency": {"values_hz": [0.1]}}, "device.sample_time_s"),
        ({"device": {"range": {"delay_samples": [0.0, 0.0025]}}}, "device.range.delay_samples"),
        ({"device": {"max_force_n": 0.01}}, "device.max_force_n"),
        ({"device": {"resonance": PLAUSIBILITY_MODE | {"frequency_hz": 1e4}}}, "device.resonance.frequency_hz"),
        ({"device": {"range": {"mass_kg": [1e-6, 9.0]}}}, "device.range.mass_kg"),
        ({"device": {"encoder_at": "handle"}}, "device.encoder_at"),
        ({"device": {"amplifier_order": 2}}, "device.amplifier_order"),
        ({"device": {"range": {"amplifier_damping_ratio": [0.5, 0.9]}}}, "device.range.amplifier_damping_ratio"),
        ({"device": {"backlash_m": 1e-4, "encoder_at": "handle", "resonance": PLAUSIBILITY_MODE}}, "device.backlash_m"),
        ({"device": {"coulomb_friction_n": 3.0, "max_force_n": 2.0}}, "device.coulomb_friction_n"),
        ({"hands": {"damping_ns_per_m": (0, 0), "stiffness_n_per_m": (0, 0)}}, "hands.stiffness_n_per_m"),
    ],
)
def test_an_unlikely_value_is_doubted_and_valid(tables, key):
    problem = avc.parse_problem(SMALL).changed(**tables)
    (doubt,) = plausibility(problem)
    assert doubt.key == key
    assert any(f"{key} {doubt.message}" in assumption.text for assumption in assumed(problem))


OWN_LAW = {"stiffness_n_per_m": 500.0, "damping_ns_per_m": 5.0}
FOLLOWER = {"mass_kg": 0.3, "damping_ns_per_m": 1.0}
ENGINE = {"step_s": 0.002, "tool_mass_kg": 0.2}
WINDOW = {"kind": "window", "samples": 250}
COMPENSATION = {"force_n": 500.0, "velocity_m_per_s": 0.02}


@pytest.mark.parametrize(
    ("tables", "key"),
    [
        ({"simulation": ENGINE | {"tool_mass_kg": 200.0}}, "simulation.tool_mass_kg"),
        ({"simulation": ENGINE | {"tool_mass_kg": [0.002, 90.0]}}, "simulation.tool_mass_kg"),
        ({"simulation": ENGINE | {"step_s": 2.0}}, "simulation.step_s"),
        ({"simulation": ENGINE | {"position_scale": 1000.0}}, "simulation.position_scale"),
        ({"follower": FOLLOWER | {"mass_kg": 300.0}}, "follower.mass_kg"),
        ({"follower": FOLLOWER | {"range": {"mass_kg": [0.3, 300.0]}}}, "follower.range.mass_kg"),
        ({"follower": FOLLOWER | {"position_scale": 1000.0}}, "follower.position_scale"),
        ({"law": OWN_LAW | {"stiffness_n_per_m": 1e6}}, "law.stiffness_n_per_m"),
        ({"law": OWN_LAW | {"damping_ns_per_m": 5000.0}}, "law.damping_ns_per_m"),
        ({"law": OWN_LAW | {"local_damping_ns_per_m": -5000.0}}, "law.local_damping_ns_per_m"),
        ({"law": OWN_LAW | {"dead_zone_m": 0.5}}, "law.dead_zone_m"),
        ({"law": OWN_LAW | {"velocity": WINDOW}}, "law.velocity.samples"),
        ({"law": OWN_LAW | {"friction_compensation": COMPENSATION}}, "law.friction_compensation.force_n"),
        (
            {
                "device": {"coulomb_friction_n": 0.1},
                "law": OWN_LAW | {"friction_compensation": COMPENSATION | {"force_n": 0.5}},
            },
            "law.friction_compensation.force_n",
        ),
    ],
)
def test_an_unlikely_value_of_a_law_or_another_end_is_doubted(tables, key):
    (doubt,) = plausibility(avc.parse_problem(SMALL).changed(**tables))
    assert doubt.key == key


SENSOR = {"stiffness_n_per_m": 2e4, "handle_mass_kg": 0.3, "noise_rms_n": 0.05, "max_force_n": 200.0}
SERVO = {"drive": "velocity", "drive_bandwidth_hz": 20.0, "delay_samples": 1}
ADMITTANCE = {"mass_kg": 5.0, "damping_ns_per_m": 50.0}


@pytest.mark.parametrize(
    ("sensor", "law", "key"),
    [
        ({"stiffness_n_per_m": 1e3}, {}, "device.force_sensor.stiffness_n_per_m"),
        ({"handle_mass_kg": 300.0}, {}, "device.force_sensor.handle_mass_kg"),
        ({"noise_rms_n": 50.0}, {}, "device.force_sensor.noise_rms_n"),
        ({"resolution_n": 50.0}, {}, "device.force_sensor.resolution_n"),
        ({"max_force_n": 0.2}, {}, "device.force_sensor.max_force_n"),
        ({"max_force_n": 2.0, "noise_rms_n": 2.0}, {}, "device.force_sensor.noise_rms_n"),
        ({"max_force_n": 2.0, "resolution_n": 2.0}, {}, "device.force_sensor.resolution_n"),
        ({}, {"mass_kg": 12000.0}, "law.admittance.mass_kg"),
    ],
)
def test_an_unlikely_value_of_a_device_with_a_force_sensor_is_doubted(sensor, law, key):
    tables = {"device": SERVO | {"force_sensor": SENSOR | sensor}, "law": {"admittance": ADMITTANCE | law}}
    (doubt,) = plausibility(avc.AdmittanceProblem.model_validate(tables))
    assert doubt.key == key


@pytest.mark.parametrize(("device", "gain", "key"), [({"mass_kg": 0.004}, 1.0, "device.mass_kg"), ({}, 1000.0, "gain")])
def test_an_unlikely_force_feedback_is_doubted(device, gain, key):
    device = {"mass_kg": 4.0, "damping_ns_per_m": 8.0, "force_sensor": SENSOR} | device
    law = {"damping_ns_per_m": 20.0, "force_feedback": {"gain": gain}}
    (doubt,) = plausibility(avc.ForceFeedbackProblem.model_validate({"device": device, "law": law}))
    assert doubt.key.endswith(key)


def test_no_value_of_the_catalogue_is_doubted_but_hands_that_cannot_press():
    problems = [avc.load_problem(name) for name in catalogue_names()]
    sensors = [load_sensor_problem(name) for name in admittance_names()]
    doubts = [doubt for problem in (*problems, *sensors) for doubt in plausibility(problem)]
    doubts += [doubt for name in device_names() for doubt in device_plausibility(avc.load_device(name))]
    # Hands of 0 are what that problem is about.
    assert [(doubt.file, doubt.key) for doubt in doubts] == [("diverging", "hands.stiffness_n_per_m")]


def test_every_usual_value_is_of_a_key_and_says_where_it_comes_from():
    headers = {key.partition(".")[0] for key in USUAL}
    assert headers == {"device", "follower", "environment", "hands", "simulation", "law", "contact"}
    assert all(usual.source and usual.lowest < usual.highest for usual in USUAL.values())


ROTARY = (
    '[device]\nmotion = "rotary"\nhandle_radius_m = 0.05\ninertia_kgm2 = 1e-4\ndamping_nms_per_rad = 0.0\n'
    "{key} = {value}\n[environment]\nstiffness_nm_per_rad = 1.0\ndamping_nms_per_rad = 0.0\n"
)
TURN = 2 * math.pi


@pytest.mark.parametrize(
    ("key", "typed", "attribute", "value"),
    [
        ("inertia_kgm2", "50 g.cm2, gear 10", "mass_kg", 5e-4),
        ("encoder_resolution_rad", "14-bit", "encoder_resolution_m", TURN / 2**14),
        ("encoder_counts_per_turn", 4096, "encoder_resolution_m", TURN / 4096),
        ("sample_time_s", "1 kHz", "sample_time_s", 1e-3),
    ],
)
def test_a_value_of_a_sheet_is_the_value_of_the_file(key, typed, attribute, value):
    written = f'"{typed}"' if isinstance(typed, str) else typed
    lines = [line for line in ROTARY.splitlines() if not line.startswith(f"{key} =")]
    found = avc.parse_problem("\n".join(lines).format(key=key, value=written)).device
    assert getattr(found, attribute) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize(
    ("key", "typed", "write"),
    [
        ("encoder_resolution_rad", "1024 ppr", "counts"),
        ("inertia_kgm2", "120 g", "g.cm2"),
        ("max_torque_nm", "13 kg.cm", "kgf.cm"),
        ("max_torque_nm", "90 mNm, gear 0", "above 0"),
        ("max_torque_nm", "0.2 N.m, pitch 5 mm", "without it"),
    ],
)
def test_a_value_that_cannot_be_read_is_refused_with_what_to_write(key, typed, write):
    lines = [line for line in ROTARY.splitlines() if not line.startswith(f"{key} =")]
    with pytest.raises(avc.InputError) as refused:
        avc.parse_problem("\n".join(lines).format(key=key, value=f'"{typed}"'))
    (fault,) = refused.value.faults
    assert fault.key == f"device.{key}"
    assert write in fault.message


def test_a_way_on_a_device_that_turns_is_at_the_radius_of_its_own_table():
    wall = ROTARY.replace("nm_per_rad = 1.0", 'nm_per_rad = "3 kN/m"')
    follower = ROTARY.partition("[environment]")[0].replace("[device]", "[follower]").replace("0.05", '"2 cm"')
    found = avc.parse_problem(
        wall.format(key="encoder_resolution_rad", value='"4000 counts per 10 mm"')
        + follower.format(key="max_torque_nm", value='"10 N"')
    )
    assert found.environment.stiffness_n_per_m == pytest.approx(3e3 * 0.05**2)
    assert found.follower.max_force_n == pytest.approx(0.2)


PLANTED = st.one_of(
    st.none(),
    st.booleans(),
    st.sampled_from([-1, 0, 1, 2, 10**400, 0.5, math.nan, "1 kg", "rotary", "handle", [0.1, 0.2], [2, 1], {}, [{}]]),
    st.floats(),
    st.text(max_size=3),
)


KEYS = [*avc.Problem.model_fields, "motion", "mass_kg", "range", "values_hz", "stop_hz", "step_s", "kind", "effects"]
KEYS += ["handle_radius_m", "encoder_counts_per_turn", "inertia_kgm2", "damping_ns_per_m", "stiffness_n_per_m"]


@pytest.mark.slow
@given(
    st.dictionaries(
        st.sampled_from(sorted(avc.Problem.model_fields)),
        st.one_of(PLANTED, st.dictionaries(st.sampled_from(KEYS), PLANTED)),
    )
)
def test_any_tables_are_a_problem_or_refused_by_key(tables):
    refusal = None
    try:
        load_any(tables)
    except avc.InputError as error:
        refusal = error
    assert refusal is None or all(fault.key and fault.message for fault in refusal.faults)


@pytest.mark.parametrize(
    ("table", "symbol", "key"),
    [
        ("environment", "k", "stiffness_n_per_m"),
        ("device", "m", "mass_kg"),
        ("device", "dt", "sample_time_s"),
        ("law", "Kp", "stiffness_n_per_m"),
        ("law", "ki", "integral_n_per_m_s"),
    ],
)
def test_the_symbol_of_a_value_leads_to_its_key(table, symbol, key):
    with pytest.raises(avc.InputError, match=rf"{table}\.{symbol}.* did you mean {key}\?"):
        avc.Problem(**{table: {symbol: 1.0}})


@pytest.mark.parametrize(
    ("line", "write"),
    [
        ("mass_kg = 0,12", "a decimal point is a dot: mass_kg = 0.12"),
        ("mass_kg = -0,12  # of the handle", "a decimal point is a dot: mass_kg = -0.12"),
        ("mass_kg=.12", "a digit stands before the decimal point: mass_kg=0.12"),
        ("mass_kg = 120 g", 'a value with a unit needs quotation marks: mass_kg = "120 g"'),
        ("sample_time_s = 1kHz # fast", 'a value with a unit needs quotation marks: sample_time_s = "1kHz"'),
        ("mass_kg = = 3", ""),
    ],
)
def test_a_number_that_is_no_toml_is_answered_with_what_to_write(line, write):
    (fault,) = faults_of(f"[device]\n{line}\n")
    assert fault.line == 2
    assert fault.message.endswith(write or line)


@pytest.mark.parametrize(
    ("key", "typed", "example"),
    [
        ("device.mass_kg", "3 N", '"45 g"'),
        ("device.damping_ns_per_m", "3 N", '"0.012 N.s/mm"'),
        ("device.delay_samples", "3 N", '"2 ms"'),
        ("device.sample_time_s", "3 N", '"1 kHz"'),
        ("device.amplifier_bandwidth_hz", "3 N", '"0.08 kHz"'),
        ("environment.stiffness_n_per_m", "3 N", '"3 N/mm"'),
        ("environment.stiffness_n_per_m", "0,3 N/mm", "a decimal point is a dot: 0.3"),
        ("environment.stiffness_n_per_m", "nan N/m", '"3 N/mm"'),
    ],
)
def test_a_refused_text_names_one_that_is_read(key, typed, example):
    table, name = key.split(".")
    tables = {"device": {"mass_kg": 0.1, "damping_ns_per_m": 2.0}}
    tables["environment"] = {"damping_ns_per_m": 1.0, "stiffness_n_per_m": 1.0}
    tables[table][name] = typed
    with pytest.raises(avc.InputError) as refused:
        avc.certify_law(tables)
    (fault,) = refused.value.faults
    assert (fault.key, example in fault.message) == (key, True)


@pytest.mark.parametrize(
    ("device", "samples"),
    [
        ('delay_samples = "1 ms"', 1),
        ('delay_samples = "1 ms"\nsample_time_s = 5e-4', 2),
        ('delay_samples = "0.3 ms"\nsample_time_s = "4 kHz"', 1.2),
        ('delay_samples = "2 samples"\nsample_time_s = 5e-4', 2),
        ('delay_samples = "2 ms"\nfrom = "phantom-omni"\nsample_time_s = 2e-3', 1),
    ],
)
def test_a_delay_may_be_a_time(device, samples):
    wall = "[environment]\ndamping_ns_per_m = 1\nstiffness_n_per_m = 1\n"
    stated = avc.parse_problem(f"[device]\nmass_kg = 0.1\ndamping_ns_per_m = 2.0\n{device}\n{wall}").device
    assert stated.delay_samples == pytest.approx(samples, rel=1e-12)


def test_a_range_of_delays_and_a_delay_of_a_follower_are_times_of_their_device():
    device = "[device]\nmass_kg = 0.1\ndamping_ns_per_m = 2.0\nsample_time_s = 5e-4\ndelay_samples = 2\n"
    device += '[device.range]\ndelay_samples = ["0.5 ms", "2 ms"]\n'
    follower = '[follower]\nfrom = "phantom-omni"\nsample_time_s = "500 Hz"\ndelay_samples = "2 ms"\n'
    problem = avc.parse_problem(device + follower)
    assert problem.device.range.delay_samples == (1, 4)
    assert problem.follower.delay_samples == 1


@pytest.mark.parametrize(
    ("table", "value", "shown", "allowed"),
    [
        ("law.velocity", '"window 3"', '"window 3"', "window"),
        ("law.velocity", "3", "3", "kalman"),
        ("scene.motion", '"press"', '"press"', "press"),
        ("hands", "3", "3", "mass_kg"),
    ],
)
def test_a_value_in_place_of_a_table_is_shown_with_what_that_table_states(table, value, shown, allowed):
    outer, _, key = table.rpartition(".")
    law = "stiffness_n_per_m = 1\n" if outer == "law" else ""
    text = f"[{outer}]\n{law}{key} = {value}\n" if outer else ""
    faults = faults_of((f"{key} = {value}\n" if not outer else "") + SMALL + text)
    (message,) = (fault.message for fault in faults if fault.key == table)
    assert message.startswith(f"is {shown}, not a table; allowed: a table")
    assert allowed in message.partition("allowed: ")[2]
    assert outer != "law" or "stiffness_n_per_m" not in message


FOLLOWER_LINES = "[follower]\nmass_kg = 1\n"
ENGINE_LINES = "[simulation]\nstep_s = 0.002\ntool_mass_kg = 0.2\n"


@pytest.mark.parametrize(
    ("addition", "keys"),
    [
        (ENGINE_LINES + FOLLOWER_LINES, ["follower.damping_ns_per_m", "follower"]),
        (ENGINE_LINES + "[law]\nstiffness_n_per_m = -1\n", ["law.stiffness_n_per_m", "law"]),
        (ENGINE_LINES + "[detent]\nforce_n = 1\n", ["detent.pitch_m", "detent"]),
        (
            "[frequency]\nstart_hz = 100\nstop_hz = 10\npoints = 1.5\n",
            ["frequency.stop_hz", "frequency.points"],
        ),
    ],
)
def test_a_refused_value_hides_no_fault_of_what_is_stated(addition, keys):
    assert sorted(fault.key for fault in faults_of(SMALL + addition)) == sorted(keys)


def test_a_device_that_is_too_slow_for_the_usual_frequencies_is_named_on_its_line():
    (fault,) = faults_of(SMALL.replace("[environment]", "sample_time_s = 1\n[environment]"))
    assert (fault.key, fault.line) == ("device.sample_time_s", 4)
    assert "1 to 450 Hz" in fault.message


def test_entries_of_a_list_that_cannot_be_read_are_the_only_faults():
    text = '[simulation]\ntool_inertia_kgm2 = ["3 g", "10 kg"]\nstep_s = 0.005\n'
    assert [fault.key.rpartition("kgm2")[2] for fault in faults_of(text)] == ["[0]", "[1]"]
