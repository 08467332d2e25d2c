"""A fault names the file or the option that holds it, in the keys and units that were typed there."""

import json
from pathlib import Path

import numpy as np
import pytest

from avc_casadi.cli import main

LEVER = """
title = "a lever"
[device]
motion = "rotary"
capstan_radius_m = 0.05
inertia_kgm2 = 2e-4
damping_nms_per_rad = 5e-3
sample_time_s = 0.001
max_torque_nm = 0.3
[environment]
stiffness_{stiffness} = 2000
damping_{damping} = 1
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "lever.toml").write_text(LEVER.format(stiffness="n_per_m", damping="ns_per_m"))
    time, random = np.arange(4000) * 1e-3, np.random.default_rng(0)
    tones = np.geomspace(0.5, 100, 40)
    torque = 0.01 * np.cos(2 * np.pi * tones[:, None] * time + random.uniform(0, 6, (40, 1))).sum(axis=0)
    angle, speed = np.zeros_like(time), 0.0
    for row in range(1, len(time)):
        speed += (torque[row - 1] - 5e-3 * speed - 0.05 * angle[row - 1]) / 2e-4 * 1e-3
        angle[row] = angle[row - 1] + 1e-3 * speed
    rows = zip(time, angle, torque, strict=True)
    (tmp_path / "turn.csv").write_text(
        "time_s,angle_rad,torque_Nm\n" + "".join(f"{t:.3f},{x:.9g},{u:.9g}\n" for t, x, u in rows)
    )
    rows = zip(time, 0.05 * angle, torque / 0.05, strict=True)
    (tmp_path / "line.csv").write_text(
        "time_s,position_m,force_N\n" + "".join(f"{t:.3f},{x:.9g},{u:.9g}\n" for t, x, u in rows)
    )
    return tmp_path


def told(capsys, *arguments):
    assert main([*arguments]) == 2
    return capsys.readouterr().err


def test_a_wall_behind_a_capstan_is_linear_and_that_is_said(folder, capsys):
    (folder / "turned.toml").write_text(LEVER.format(stiffness="nm_per_rad", damping="nms_per_rad"))
    said = told(capsys, "check", "turned.toml")
    assert said.count("is a key of what turns; allowed: ") == 2
    assert 'device.motion = "rotary"' not in said


@pytest.mark.parametrize("radius", ['"50 mm"', "0.0", "1e9", "true"])
def test_a_wrong_capstan_is_one_fault(folder, capsys, radius):
    text = LEVER.format(stiffness="n_per_m", damping="ns_per_m").replace("= 0.05", f"= {radius}")
    (folder / "wrong.toml").write_text(text)
    said = told(capsys, "check", "wrong.toml")
    assert said.count("\n") == 1
    assert "wrong.toml:5: device.capstan_radius_m: is " in said


@pytest.mark.thorough
@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("verb", ["identify", "diagnose"])
def test_a_problem_says_of_its_device_what_a_device_file_would(capsys, verb):
    document = json.loads(run(capsys, verb, "line.csv", "--device", "lever.toml", "--json"))
    assert document["schema"] == f"avc-{verb}/1"


def run(capsys, *arguments):
    main([*arguments])
    return capsys.readouterr().out


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("log", "asked", "right"),
    [
        ("turn.csv", ["--handle-radius-m", "0.02", "--known", "mass_kg=2e-4"], "inertia_kgm2"),
        ("turn.csv", ["--device", "smartknob", "--known", "mass_kg=2e-4"], "inertia_kgm2"),
        ("line.csv", ["--known", "inertia_kgm2=2e-4"], "mass_kg"),
    ],
)
def test_a_known_value_of_the_other_motion_is_refused(capsys, log, asked, right):
    assert f"allowed: {right}, " in told(capsys, "identify", log, *asked)


def test_a_limit_above_the_boards_is_refused_with_its_unit(capsys):
    pytest.importorskip("unicorn")
    assert " N\n" in told(capsys, "device", "--port", "emulator", "--force-n", "1e4")
    assert " N.m\n" in told(capsys, "device", "--port", "emulator", "--torque-nm", "1e4", "--motion", "rotary")


def test_another_rate_than_the_emulated_boards_is_refused(capsys):
    said = told(capsys, "device", "--port", "emulator", "--baud", "9600")
    assert "--baud: is 9600; the line of the emulated board runs at 115200" in said


@pytest.mark.parametrize("verb", ["device", "monitor"])
def test_a_rate_that_no_port_has_is_refused(verb, capsys):
    said = told(capsys, verb, "--port", "loop://", "--baud", str(2**31))
    assert "--baud: is 2147483648; allowed: 1200 to 12000000" in said


@pytest.mark.parametrize("port", ["socket://localhost", "loop://?a=b", "hwgrep://("])
def test_a_port_that_is_none_is_told_in_plain_words(port, capsys):
    said = told(capsys, "device", "--port", port)
    assert f"{port}: cannot be opened (no name of a port; allowed: a path, or a URL of pyserial" in said
    assert "'" not in said.partition("; `avc doctor")[0]


@pytest.mark.parametrize("mark", ["\x1b", "\x07", "\x9b", "\u202e"])
def test_no_key_of_a_file_commands_the_terminal(mark, folder, capsys):
    coupling = json.loads((Path(__file__).parent / "goldens" / "couplings" / "wall.json").read_text(encoding="ascii"))
    (folder / "c.json").write_text(json.dumps(coupling | {f"{mark}[2Jkey": 1}))
    said = told(capsys, "certify", "c.json")
    assert f"{ascii(mark)[1:-1]}[2Jkey" in said
    assert all(one.isprintable() or one == "\n" for one in said)


def test_a_key_of_a_file_is_not_told_as_an_option(folder, capsys):
    (folder / "broken.toml").write_text("coupling = 3\n" + LEVER.format(stiffness="n_per_m", damping="ns_per_m"))
    said = told(capsys, "diagnose", "line.csv", "--problem", "broken.toml")
    assert "broken.toml:1: coupling: " in said
    assert "--coupling" not in said
