"""An option is checked before anything is computed, and its fault names the option with what is allowed."""

import argparse
import json
import math

import numpy as np
import pytest
from quick import first

import avc_casadi as avc
from avc_casadi.cli import VERBS, build_parser, main


@pytest.fixture(autouse=True)
def _folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def log_file(header, seconds=2.0):
    """Write a log of a mass of 0.1 under a force that drives it, in the units of the header."""
    time = np.arange(int(1000 * seconds)) * 1e-3
    force = np.sin(2 * math.pi * 3 * time)
    position = -force / (0.1 * (2 * math.pi * 3) ** 2)
    table = np.column_stack([time, position, force])
    np.savetxt("log.csv", table, delimiter=",", header=header, comments="", fmt="%.9g")


LINEAR_LOG = "time_s,position_m,force_N"
ROTARY_LOG = "time_s,angle_rad,torque_Nm"


def refused(capsys, *arguments):
    """Return the fault of a command that is refused."""
    assert main([*arguments, "--json"]) == 2
    (fault,) = json.loads(capsys.readouterr().out)["errors"]
    return fault


@pytest.fixture
def _nothing_is_computed(monkeypatch):
    def computed(*_, **__):
        raise AssertionError("computed before the option was checked")

    monkeypatch.setattr("avc_casadi.identification.identify.in_ticks", computed)
    monkeypatch.setattr("avc_casadi.diagnose.causes.find_oscillation", computed)


@pytest.mark.usefixtures("_nothing_is_computed")
@pytest.mark.parametrize("verb", ["identify", "diagnose"])
@pytest.mark.parametrize(
    ("header", "radius", "words"),
    [
        (ROTARY_LOG, ("--handle-radius-m", "50"), "0.002 to 10 m"),
        (ROTARY_LOG, ("--handle-radius-m", "0.001"), "0.002 to 10 m"),
        (ROTARY_LOG, (), "is missing"),
        (LINEAR_LOG, ("--handle-radius-m", "3"), "leave it out"),
    ],
)
def test_the_radius_of_the_handle_is_checked_first_and_goes_with_the_motion_of_the_log(
    verb, header, radius, words, capsys
):
    log_file(header)
    fault = refused(capsys, verb, "log.csv", *radius)
    assert fault["key"] == "--handle-radius-m"
    assert words in fault["message"]


@pytest.mark.parametrize(
    ("pair", "words"),
    [
        ("tme=1", "'tme' is not a quantity of a log; allowed: time, position, force"),
        ("speed=1", "'speed' is not a quantity"),
        ("time", "'time' has no value"),
        ("force=3,torque=2", "states force twice"),
    ],
)
def test_a_wrong_column_is_named_with_the_quantities_of_a_log(pair, words, capsys):
    fault = refused(capsys, "identify", "log.csv", "--columns", pair)
    assert fault["key"] == "--columns"
    assert words in fault["message"]


def moved_mass(time):
    """Return the position of a mass of 0.1, and the force of tones that moves it."""
    omega = 2 * math.pi * np.array([2.0, 3.5, 5.5, 9.0, 14.0, 23.0])[:, None]
    tones = np.sin(omega * time + np.arange(6.0)[:, None])
    return (-tones / (0.1 * omega**2)).sum(0), tones.sum(0)


def pushed_away(time):
    """Return a position that grows, in encoder steps, and the force of a spring that drives it away from rest."""
    step_m = 2e-5
    position = step_m * np.round(np.exp(time) * 1e-3 * np.sin(2 * math.pi * 5 * time) / step_m)
    return position, 500.0 * position


@pytest.mark.parametrize(("verb", "motion", "sign"), [("identify", moved_mass, -1.0), ("diagnose", pushed_away, 1.0)])
def test_a_force_of_reversed_sign_leads_to_the_other_use_of_flip_force(verb, motion, sign, capsys):
    time = np.arange(3000) * 1e-3
    position, force = motion(time)
    for towards, flip, advice in ((1.0, (), "with --flip-force"), (-1.0, ("--flip-force",), "without --flip-force")):
        table = np.column_stack([time, position, towards * sign * force])
        np.savetxt("log.csv", table, delimiter=",", header=LINEAR_LOG, comments="", fmt="%.9g")
        assert advice in refused(capsys, verb, "log.csv", *flip)["message"]


@pytest.mark.slow
def test_an_unusual_device_is_identified_with_the_warnings_of_its_file(capsys):
    time = np.arange(3000) * 1e-3
    position, force = moved_mass(time)
    for scale, warned in ((1.0, False), (1e-3, True)):  # of positions in m, and in m that are called mm
        step_m = 2e-6 * scale
        steps = np.round(position * scale / step_m)
        table = np.column_stack([time, step_m * steps, force])
        np.savetxt("log.csv", table, delimiter=",", header=LINEAR_LOG, comments="")
        assert main(["identify", "log.csv", "--device", "reference-r1", "--out", "mine.toml", "--json"]) == 0
        warnings = json.loads(capsys.readouterr().out)["warnings"]
        assert ("device.mass_kg" in {warning["key"] for warning in warnings}) is warned
        assert main(["check", "mine.toml", "--json"]) == 0
        assert json.loads(capsys.readouterr().out)["warnings"] == warnings


DEVICE_FILE = "gaps = []\n[device]\nmass_kg = 0.1\ndamping_ns_per_m = 1.0\n"
PROBLEM_FILE = (
    f"{DEVICE_FILE.removeprefix('gaps = []')}[environment]\nstiffness_n_per_m = 300.0\ndamping_ns_per_m = 1.0\n"
)


@pytest.mark.parametrize(
    ("arguments", "file", "kept", "replaced"),
    [
        (("identify", "log.csv", "--out"), "mine.toml", PROBLEM_FILE, DEVICE_FILE),
        (("recommend", "figure5", "--out"), "mine.toml", DEVICE_FILE, PROBLEM_FILE),
        (("recommend", "figure5", "--out"), "mine.json", '{"name": "package"}', '{"schema": "avc-coupling/1"}'),
        (("solve", "figure5", "--out"), "mine.json", '{"name": "package"}', '{"schema": "avc-gains/1"}'),
        (("solve", "figure5", "--out"), "mine.csv", "time_s,position_m\n0,1\n", "frequency_hz,k,b\n1,1,1\n"),
        (("excite", "figure5", "--out"), "mine.csv", "frequency_hz,k,b\n1,1,1\n", "# of avc\ntick,time_ms\n0,1\n"),
        (("monitor", "--port", "emulator", "--out"), "mine.csv", "notes, of mine = yes", "# of avc\ntick,f\n0,1\n"),
        (("simulate", "figure5", "--plot"), "mine.png", "notes", "\x89PNG"),
        (("simulate", "figure5", "--plot"), "mine.svg", "notes", '<?xml version="1.0"?>\n<svg>'),
        (("simulate", "figure5", "--trace"), "mine.npz", "notes", "PK"),
    ],
    ids=lambda value: value if isinstance(value, str) and value.startswith("mine") else "",
)
def test_a_file_is_written_over_where_it_is_of_the_kind_that_the_option_writes(
    arguments, file, kept, replaced, tmp_path, capsys
):
    path = tmp_path / file
    path.write_text(kept, encoding="latin-1")
    fault = refused(capsys, *arguments, file)
    assert fault["key"] == arguments[-1]
    assert "choose another name" in fault["message"]
    assert path.read_text(encoding="latin-1") == kept
    for accepted in (replaced, ""):
        path.write_text(accepted, encoding="latin-1")
        assert build_parser().parse_args([*arguments, file])


@pytest.mark.parametrize("name", ["coupling.json", "gains.csv", "gains.json", "compare.json"])
def test_a_folder_of_results_keeps_a_file_of_another_kind(name, tmp_path, capsys):
    (tmp_path / name).write_text(PROBLEM_FILE)
    fault = refused(capsys, "run", "figure5", "--out", ".")
    assert fault["key"] == "--out"
    assert name in fault["message"]
    assert (tmp_path / name).read_text() == PROBLEM_FILE


def test_traces_leave_a_coupling_of_their_name(tmp_path, capsys):
    (tmp_path / "mine.json").write_text('{"schema": "avc-coupling/1"}')
    fault = refused(capsys, "simulate", "figure5", "--trace", "mine.npz")
    assert fault["key"] == "--trace"
    assert "'mine.json'" in fault["message"]


WALL_FILE = PROBLEM_FILE.replace("damping_ns_per_m = 1.0", "damping_ns_per_m = 1.0\nmax_force_n = 8.0", 1)
LAW_FILE = f"{WALL_FILE}[law]\nstiffness_n_per_m = 300.0\nvelocity = {{ kind = 'low-pass', cutoff_hz = 60.0 }}\n"
TOOL_FILE = f"{WALL_FILE[: WALL_FILE.index('[environment]')]}[simulation]\ntool_mass_kg = 0.1\nstep_s = 0.01\n"
JOINT_FILE = "[simulation]\ntool_mass_kg = 0.1\nstep_s = 0.005\n"
ADMITTANCE_FILE = """[device]
drive = "velocity"
drive_bandwidth_hz = 15.0
[device.force_sensor]
stiffness_n_per_m = 1e6
handle_mass_kg = 0.3
[law]
admittance = { mass_kg = 12.0, damping_ns_per_m = 60.0 }
"""
FILES = {
    "wall.toml": WALL_FILE,
    "law.toml": LAW_FILE,
    "tool.toml": TOOL_FILE,
    "joint.toml": JOINT_FILE,
    "sensor.toml": ADMITTANCE_FILE,
    "coupling.json": '{"schema": "avc-coupling/1"}',
}


@pytest.fixture
def _files(tmp_path):
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)


@pytest.mark.usefixtures("_files")
@pytest.mark.parametrize(
    ("command", "key", "words"),
    [
        (["certify", "wall.toml", "--k", "3000", "--velocity", "window 0"], "--velocity", "samples is 0"),
        (["certify", "wall.toml", "--k", "3000", "--velocity", "kalman 1e9Hz"], "--velocity", "bandwidth_hz is"),
        (["certify", "wall.toml", "--k", "3000", "--notch", "700 Hz"], "--notch", "below 500 Hz"),
        (["certify", "wall.toml", "--k", "3000", "--ki=-3"], "--ki", "is -3"),
        (["certify", "wall.toml", "--k", "3000", "--virtual-mass=-1"], "--virtual-mass", "is -1"),
        (["certify", "law.toml", "--notch", "700 Hz"], "--notch", "below 500 Hz"),
        (["certify", "tool.toml", "--k", "10", "--ki", "3"], "--ki", "applies to walls only"),
        (["certify", "joint.toml", "--kp", "10", "--ki", "3"], "--ki", "no part of the law of a joint"),
        (["certify", "sensor.toml", "--b=-3"], "--b", "is -3"),
        (["simulate", "wall.toml", "--against", "foo"], "--against", "'foo' is not a known method"),
        (["zwidth", "law.toml", "--over", "foo"], "--over", "no number of the law"),
        (["recommend", "joint.toml", "--frequency=-5"], "--frequency", "is -5; allowed: above 0 and below 100 Hz"),
        (["recommend", "joint.toml", "--frequency", "0"], "--frequency", "is 0; allowed: above 0 and below 100 Hz"),
        (["recommend", "joint.toml", "--frequency", "100"], "--frequency", "is 100; allowed: above 0 and below 100 Hz"),
    ],
)
def test_a_fault_of_the_value_of_an_option_names_the_option_and_no_file(command, key, words, capsys):
    fault = refused(capsys, *command)
    assert (fault["file"], fault["key"]) == ("command line", key)
    assert words in fault["message"]


@pytest.mark.usefixtures("_files")
@pytest.mark.parametrize(
    ("command", "key", "words"),
    [
        (["certify", "law.toml", "--cutoff-hz", "30", "--velocity", "kalman 40 Hz"], "--cutoff-hz", "--velocity"),
        (["certify", "wall.toml", "--k=9", "--cutoff-hz=30", "--velocity=difference"], "--cutoff-hz", "--velocity"),
        (["certify", "coupling.json", "--k", "3000"], "--k", "coupling.json, which has gains"),
        (["export", "coupling.json", "--c", "x", "--parameters", "unity"], "--parameters", "excludes --c"),
        (["excite", "wall.toml", "--port", "COM7", "--on-bench", "wall.toml"], "--on-bench", "--port COM7"),
        (["certify", "sensor.toml", "--friction-compensation", "3N"], "--friction-compensation", "commanded a force"),
        (["recommend", "sensor.toml", "--frequency", "5"], "--frequency", "leave it out"),
        (["recommend", "sensor.toml", "--hands", "5"], "--hands", "no law for a force sensor"),
        (["recommend", "joint.toml", "--hands", "5"], "--hands", "joint that an engine moves"),
        (["trial", "law.toml", "--workers", "2"], "--workers", "trial of a law is one process"),
        (["trial", "law.toml", "--scheduler", "tcp://h:1"], "--scheduler", "trial of a law is one process"),
        (["table1", "--workers", "2", "--scheduler", "tcp://h:1"], "--workers", "--scheduler"),
    ],
)
def test_options_that_contradict_each_other_or_the_file_are_refused_with_both_named(command, key, words, capsys):
    fault = refused(capsys, *command)
    assert fault["key"] == key
    assert words in fault["message"]


def test_a_fault_of_all_logs_names_them(tmp_path, capsys):
    log_file(LINEAR_LOG, seconds=0.4)
    (tmp_path / "other.csv").write_bytes((tmp_path / "log.csv").read_bytes())
    for logs in (("log.csv",), ("log.csv", "other.csv")):
        fault = refused(capsys, "identify", *logs)
        assert (fault["file"], fault["key"]) == (", ".join(logs), "logs")


def of_one_value():
    """Yield a verb, the names of an option that takes a value, and how it is declared."""
    for verb, (_, arguments) in VERBS.items():
        for names, options in arguments:
            if names[0].startswith("--") and options.get("action") not in ("append", "store_true"):
                yield verb, names, options


@pytest.mark.parametrize("verb", first(VERBS, 4))
def test_an_option_that_takes_one_value_is_given_once(verb):
    for name, names, options in of_one_value():
        if name != verb:
            continue
        accepted = next(
            value
            for value in (*options.get("choices", ()), "1", "1,2", "a.csv", "a.toml", "a.npz", "a.png")
            if "type" not in options or takes(options["type"], value)
        )
        for second in names:
            arguments = [verb, f"{names[0]}={accepted}", f"{second}={accepted}"]
            with pytest.raises(avc.InputError, match="give it once") as refusal:
                build_parser().parse_args(arguments)
            assert refusal.value.faults[0].key == names[0]


def takes(read, value):
    """Return whether the reader of an option takes a value."""
    try:
        read(value)
    except argparse.ArgumentTypeError:
        return False
    return True


SENSED_FILE = """\
[device]
drive = "force"
mass_kg = 6.0
damping_ns_per_m = 10.0
[device.force_sensor]
stiffness_n_per_m = 5e4
damping_ratio = 0.1
handle_mass_kg = 0.5
[law]
force_feedback = { gain = 2.0, cutoff_hz = 50.0 }
damping_ns_per_m = 30.0
[contact]
stiffness_n_per_m = [0.0, 1e4]
damping_ns_per_m = 5.0
"""


@pytest.mark.parametrize(
    ("file", "ending", "out"),
    [
        (PROBLEM_FILE, ".json", "c.txt"),
        (PROBLEM_FILE, ".json", "c.toml"),
        (SENSED_FILE, ".toml", "c.txt"),
        (SENSED_FILE, ".toml", "c.json"),
    ],
)
def test_recommend_names_the_one_ending_that_it_writes_for_a_problem(file, ending, out, tmp_path, capsys):
    (tmp_path / "p.toml").write_text(file)
    fault = refused(capsys, "recommend", "p.toml", "--out", out)
    assert fault["key"] == "--out"
    assert f"{out!r} ends in" in fault["message"]
    assert f"allowed: {ending}, " in fault["message"]


def test_an_unknown_method_to_compare_with_is_told_of_none_too(capsys):
    fault = refused(capsys, "simulate", "figure5", "--against", "none,bogus")
    assert "allowed: none, closed-form" in fault["message"]


def test_a_file_of_gains_beside_typed_gains_is_named(capsys):
    assert "'c.json' does not apply" in refused(capsys, "certify", "figure5", "c.json", "--k", "3000")["message"]


def test_a_log_of_one_sample_has_one_sample(tmp_path, capsys):
    (tmp_path / "log.csv").write_text(f"{LINEAR_LOG}\n0,0,0\n")
    assert "has 1 sample;" in refused(capsys, "identify", "log.csv")["message"]


@pytest.mark.slow
def test_what_follows_a_recommendation_is_about_it_and_rows_left_out_are_named_once(tmp_path, capsys):
    (tmp_path / "p.toml").write_text(SENSED_FILE)
    assert main(["recommend", "p.toml"]) == 0
    text = capsys.readouterr().out
    assert "next: avc recommend p.toml --out law.toml" in text
    assert "Would help, Would help" not in text
    assert main(["recommend", "p.toml", "--out", "law.toml"]) == 0
    assert "next: avc certify law.toml" in capsys.readouterr().out
