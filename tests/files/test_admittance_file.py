"""Files of admittance devices: keys and their limits, a device that turns, and who refuses them."""

import pytest
from quick import first

import avc_casadi as avc
from avc_casadi.cli import main
from avc_casadi.files.admittance_file import (
    as_admittance,
    dump_admittance,
    is_admittance,
    load_sensor_problem,
    parse_admittance,
)
from avc_casadi.files.catalogue import admittance_names

ARM = """
[device]
drive = "velocity"
drive_bandwidth_hz = 15
sample_time_s = "500 Hz"
delay_samples = 2
[device.force_sensor]
stiffness_n_per_m = "200 N/mm"
handle_mass_kg = "800 g"
[law]
admittance = { mass_kg = 8, damping_ns_per_m = 120 }
[contact]
stiffness_n_per_m = [0, 5e3]
"""
WHEEL = """
[device]
motion = "rotary"
handle_radius_m = 0.15
drive = "velocity"
drive_bandwidth_hz = 20
[device.torque_sensor]
stiffness_nm_per_rad = 2000
handle_inertia_kgm2 = 0.01
noise_rms_nm = 0.02
[law]
admittance = { inertia_kgm2 = 0.1, damping_nms_per_rad = 0.5 }
"""


def test_values_are_read_in_their_units():
    read = parse_admittance(ARM, name="arm")
    assert read.device.sample_time_s == pytest.approx(2e-3)
    assert read.device.force_sensor.stiffness_n_per_m == pytest.approx(2e5)
    assert read.device.force_sensor.handle_mass_kg == pytest.approx(0.8)
    assert read.contact.stiffness_n_per_m == (0.0, 5e3)
    assert read.law.admittance.mass_kg == 8.0


def test_a_device_that_turns_has_the_usual_hands_at_its_radius():
    read = parse_admittance(WHEEL, name="wheel")
    assert read.device.force_sensor.handle_mass_kg == 0.01
    assert read.law.admittance.damping_ns_per_m == 0.5
    assert read.hands.stiffness_n_per_m == pytest.approx((200 * 0.15**2, 800 * 0.15**2))
    assert "kg.m2" in repr(read)


@pytest.mark.parametrize("text", [ARM, WHEEL])
def test_what_is_written_is_read_again(text):
    read = parse_admittance(text, name="p")
    assert parse_admittance(dump_admittance(read), name="p") == read


@pytest.mark.parametrize("name", first(admittance_names()))
def test_those_of_the_catalogue_are_read_and_deployable(name):
    assert is_admittance(name)
    lightened = isinstance(load_sensor_problem(name), avc.ForceFeedbackProblem)
    assert (avc.certify_force_feedback(name) if lightened else avc.certify_admittance(name, remedies=False)).passed


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        ('drive = "velocity"', 'drive = "position"', "device.drive_order: is 1; allowed: 2 with drive"),
        ('drive = "velocity"', 'drive = "speed"', 'drive: is "speed"; allowed: "force", "velocity", "position"'),
        ("delay_samples = 2", "delay_samples = 40", "device.delay_samples: is 40; allowed: 0 or 0.001 to 32"),
        ("delay_samples = 2", "delay_samples = -1", "device.delay_samples: is -1; allowed: 0 or 0.001 to 32"),
        ('"200 N/mm"', "0", "device.force_sensor.stiffness_n_per_m: is 0"),
        ('"800 g"', "0", "device.force_sensor.handle_mass_kg: is 0"),
        ("mass_kg = 8, damping_ns_per_m = 120", "mass_kg = 0, damping_ns_per_m = 0", "mass_kg: is 0, as is damping"),
        ("[0, 5e3]", "[5e3, 0]", "contact.stiffness_n_per_m: is .*reversed"),
        ("[0, 5e3]", "[0, inf]", "contact.stiffness_n_per_m: is"),
        ("[contact]", "[environment]", "environment: is not a known key"),
        ("admittance = {", "stiffness_n_per_m = 1\nadmittance = {", "law.stiffness_n_per_m: is not a known key"),
        ("drive_bandwidth_hz = 15", "handle_radius_m = 0.1\ndrive_bandwidth_hz = 15", "handle_radius_m"),
        (
            "[device.force_sensor]",
            "range = { handle_mass_kg = [1.0, 2.0] }\n[device.force_sensor]",
            r"device.range.handle_mass_kg: is \[1.0, 2.0\]; allowed: one that includes handle_mass_kg = 0.8",
        ),
    ],
)
def test_a_fault_names_its_key(old, new, fault):
    with pytest.raises(avc.InputError, match=fault):
        parse_admittance(ARM.replace(old, new))


def test_a_fault_of_a_device_that_turns_has_its_keys():
    with pytest.raises(avc.InputError, match=r"device.torque_sensor.handle_inertia_kgm2: is -1"):
        parse_admittance(WHEEL.replace("= 0.01", "= -1"))


@pytest.mark.parametrize(
    "command",
    [
        "solve P",
        "run P",
        "compare P",
        "simulate P",
        "accuracy P",
        "firmware P --board f446re --out x",
        "excite P --out log.csv",
    ],
)
def test_a_verb_that_does_not_know_it_refuses_in_one_sentence(command, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    tmp_path.joinpath("arm.toml").write_text(ARM, encoding="utf-8")
    assert main(command.replace("P", "arm.toml", 1).split()) == 2
    said = [line for line in capsys.readouterr().err.splitlines() if "..." not in line]
    assert len(said) == 1
    assert 'device.drive is "velocity"' in said[0]


@pytest.mark.parametrize("command", ["check P", "certify P", "solve P", "compare P", "simulate P", "zwidth P"])
@pytest.mark.parametrize("key", ["mass_kg = 0.1", "drive_bandwidth_hz = 15"])
def test_a_drive_that_is_not_known_is_an_error_on_its_line(command, key, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    text = f'[device]\n{key}\ndrive = "speed"\n\n[environment]\nstiffness_n_per_m = 500\n'
    tmp_path.joinpath("d.toml").write_text(text, encoding="utf-8")
    assert main(command.replace("P", "d.toml").split()) == 2
    said = capsys.readouterr().err
    assert 'd.toml:3: device.drive: is "speed"; allowed: "force", "velocity", "position"' in said


@pytest.mark.parametrize("call", [avc.recommend, avc.zwidth, avc.certify_law, avc.solve, avc.simulate])
def test_so_do_calls_of_python(call, tmp_path):
    path = tmp_path / "arm.toml"
    path.write_text(ARM, encoding="utf-8")
    tables = {"device": {"drive": "velocity"}}
    for problem in (str(path), tables, "admittance/cobot"):
        with pytest.raises(avc.UnsupportedError, match=r'device.drive is "velocity"'):
            call(problem)


@pytest.mark.slow
def test_check_and_certify_know_it(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    tmp_path.joinpath("arm.toml").write_text(ARM, encoding="utf-8")
    assert main(["check", "arm.toml"]) == 0
    assert "virtual mass 8.00 kg" in capsys.readouterr().out
    assert main(["certify", "arm.toml", "--virtual-mass", "1", "--b", "2"]) == 1
    assert "unstable: " in capsys.readouterr().out
    assert main(["certify", "arm.toml", "--ki", "2"]) == 2
    assert "an admittance law is --virtual-mass, --b, --k and --cutoff-hz" in capsys.readouterr().err


RAIL = """
[device]
mass_kg = 4
damping_ns_per_m = 8
sample_time_s = "2 kHz"
delay_samples = 1
[device.force_sensor]
stiffness_n_per_m = "20 N/mm"
damping_ratio = 0.2
handle_mass_kg = "300 g"
[law]
force_feedback = { gain = 1, cutoff_hz = 200 }
damping_ns_per_m = 20
"""


def rail(tmp_path, old="", new=""):
    path = tmp_path / "rail.toml"
    path.write_text(RAIL.replace(old, new) if old else RAIL, encoding="utf-8")
    return path


def test_a_force_sensor_makes_a_device_one_with_force_feedback(tmp_path):
    read = load_sensor_problem(rail(tmp_path))
    assert read.device.drive == "force"
    assert read.device.sample_time_s == pytest.approx(5e-4)
    assert read.law.gain == 1.0
    assert read.apparent_mass_kg == 2.0
    path = tmp_path / "again.toml"
    path.write_text(dump_admittance(read), encoding="utf-8")
    again = load_sensor_problem(path)
    assert (again.device, again.law) == (read.device, read.law)


def test_one_that_turns_has_its_keys_and_hands(tmp_path):
    path = tmp_path / "knob.toml"
    path.write_text(
        """[device]
motion = "rotary"
handle_radius_m = 0.1
inertia_kgm2 = 0.01
damping_nms_per_rad = 0.05
[device.torque_sensor]
stiffness_nm_per_rad = 200
handle_inertia_kgm2 = 0.001
[law]
torque_feedback = { gain = 1.0 }
""",
        encoding="utf-8",
    )
    read = load_sensor_problem(path)
    assert read.device.force_sensor.handle_mass_kg == 0.001
    assert read.law.gain == 1.0
    assert read.hands.stiffness_n_per_m == pytest.approx((200 * 0.1**2, 800 * 0.1**2))


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        ("gain = 1,", "gain = -1,", "law.force_feedback.gain: is -1"),
        ("damping_ns_per_m = 20", "dead_zone_m = 1e-3\nstiffness_n_per_m = 9", "law.dead_zone_m: is not judged"),
        ("damping_ns_per_m = 20", "rate_divider = 2", "law.rate_divider: is not judged"),
        ("mass_kg = 4", "mass_kg = 0", "device.mass_kg: is 0; allowed: above 0"),
        ("delay_samples = 1", "delay_samples = 40", "device.delay_samples: is 40; allowed: 0 or 0.001 to 32"),
        ("delay_samples = 1", "delay_samples = -1", "device.delay_samples: is -1; allowed: 0 or 0.001 to 32"),
        ("[device]", '[device]\ndrive = "forc"', 'device.drive: is "forc"; allowed: "force", "velocity", "position"'),
        ("[device]", '[device]\nfrom = "knob"', "device.from: is not supported for a device with a force sensor"),
    ],
)
def test_a_fault_of_force_feedback_names_its_key(tmp_path, old, new, fault):
    with pytest.raises(avc.InputError, match=fault):
        load_sensor_problem(rail(tmp_path, old, new))


@pytest.mark.parametrize("motion", ["linear", "rotary"])
def test_hands_that_are_assumed_remain_assumed_in_a_file_that_is_written(motion):
    turns = {"motion": "rotary", "handle_radius_m": 0.1} if motion == "rotary" else {}
    sensor = {"stiffness_n_per_m": 1e5, "handle_mass_kg": 0.5}
    if turns:
        sensor = {"stiffness_nm_per_rad": 1e3, "handle_inertia_kgm2": 5e-3}
    name = "torque_sensor" if turns else "force_sensor"
    device = {"drive": "velocity", "drive_bandwidth_hz": 20.0, name: sensor, **turns}
    stated = as_admittance({"device": device})
    again = parse_admittance(dump_admittance(stated))
    assert (stated.assumes_hands, again.assumes_hands) == (True, True)
    assert again.hands == stated.hands
    assert stated.changed(law={"admittance": {"mass_kg": 1.0, "damping_ns_per_m": 2.0}}).assumes_hands
    assert not as_admittance({"device": device, "hands": {}}).assumes_hands


@pytest.mark.parametrize("tables", [{"mass_kg": 1.0}, {}])
def test_a_drive_that_no_device_has_is_the_one_fault_where_no_other_key_says_what_it_is(tables):
    with pytest.raises(avc.InputError) as refused:
        as_admittance({"device": {"drive": "torque", **tables}})
    assert [fault.key for fault in refused.value.faults] == ["device.drive"]


def test_force_feedback_without_a_sensor_is_refused_and_a_plain_device_may_state_its_drive():
    plain = '[device]\ndrive = "force"\nmass_kg = 4\ndamping_ns_per_m = 8\n[law]\n'
    assert avc.parse_problem(f"{plain}stiffness_n_per_m = 10").device.mass_kg == 4.0
    with pytest.raises(avc.InputError, match=r"law.force_feedback: is the feedback of a force sensor; give"):
        avc.parse_problem(f"{plain}force_feedback = {{ gain = 1.0 }}")


@pytest.mark.parametrize(
    "command", ["zwidth P", "simulate P", "explore P", "trial P", "export P --c x", "solve P", "run P"]
)
def test_verbs_that_do_not_know_force_feedback_refuse_it(command, tmp_path, monkeypatch, capsys):
    rail(tmp_path)
    monkeypatch.chdir(tmp_path)
    assert main(command.replace("P", "rail.toml", 1).split()) == 2
    assert "which this does not support; use avc check, recommend or certify rail.toml" in capsys.readouterr().err
    for call in (avc.recommend, avc.certify_law, avc.certify_admittance, avc.load_admittance):
        with pytest.raises(avc.UnsupportedError, match=r"use avc check, recommend or certify rail.toml"):
            call("rail.toml")
    with pytest.raises(avc.UnsupportedError, match=r"avc.certify_admittance judges such"):
        avc.certify_force_feedback("admittance/cobot")


@pytest.mark.slow
def test_check_and_certify_know_force_feedback(tmp_path, monkeypatch, capsys):
    rail(tmp_path)
    monkeypatch.chdir(tmp_path)
    assert main(["check", "rail.toml"]) == 0
    assert "force feedback 1, force below 200 Hz" in capsys.readouterr().out
    assert main(["certify", "rail.toml"]) == 0
    assert "apparent mass 2.00 kg of 4.00 kg" in capsys.readouterr().out
    assert main(["certify", "rail.toml", "--k", "2"]) == 2
    assert "--k: " in capsys.readouterr().err


def test_simulated_hands_refuse_a_drive_of_positions(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    joint = ARM.replace('drive = "velocity"', 'drive = "position"\ndrive_order = 2')
    tmp_path.joinpath("joint.toml").write_text(joint, encoding="utf-8")
    assert main(["check", "joint.toml"]) == 0
    assert main(["trial", "joint.toml"]) == 2
    assert "device.drive" in capsys.readouterr().err


def test_a_file_with_the_keys_of_a_drive_but_without_drive_is_told_the_one_key_that_is_missing(tmp_path, capsys):
    file = tmp_path / "arm.toml"
    text = dump_admittance(avc.load_admittance("admittance/cobot"))
    file.write_text(text.replace('drive = "velocity"\n', ""), encoding="utf-8")
    assert main(["check", str(file)]) == 2
    errors = capsys.readouterr().err
    assert 'device.drive: is missing; allowed: "velocity", "position"' in errors
    assert errors.count("avc:") == 1
