"""A joint without a device on the command line: its rows, and verbs of devices that refuse it."""

import json
import pathlib
import re

import pytest
from quick import first

from avc_casadi.cli import main

JOINT = '[simulation]\ntool_inertia_kgm2 = [0.003, 0.01]\nstep_s = 0.005\nintegrator = "implicit-damping"\n'


@pytest.fixture
def joint(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "joint.toml").write_text(JOINT)
    return "joint.toml"


def test_its_rows_are_of_no_hand_and_no_wall(joint, capsys):
    assert main(["certify", joint, "--kp", "5000", "--kd", "18.97"]) == 0
    text = capsys.readouterr().out
    assert all(label in text for label in ("Stable", "Damping ratio", "Stable kp", "Stable kd", "Largest step"))
    assert "0 N.m/rad to 8.067 kN.m/rad" in text
    assert not any(word in text for word in ("hand", "wall", "released", "device"))


def test_an_unstable_joint_says_what_armature_would_help(joint, capsys):
    assert main(["certify", joint, "--kp", "12000", "--kd", "18.97", "--json"]) == 1
    document = json.loads(capsys.readouterr().out)
    # Of implicit-damping: kp h^2 < 2 (2 I + h kd).
    least = (12000 * 0.005**2 / 2 - 0.005 * 18.97) / 2
    assert document["armature_kgm2"] == pytest.approx(least - 0.003, rel=1e-5)
    assert document["stable_at"]["stiffness_nm_per_rad"][1] == pytest.approx(8068, rel=1e-4)


def quantities(row):
    """Return the numbers of a row with their units."""
    return [(float(number), unit) for number, unit in re.findall(r"([\d.]+) (\S+2)", row)]


@pytest.mark.parametrize(
    ("kp", "kd"), first([("100", "20"), ("500", "5"), ("1000", "4"), ("100", "4.5"), ("3000", "4")])
)
def test_what_is_to_be_added_reaches_the_least_inertia_as_printed(kp, kd, tmp_path, capsys):
    file = tmp_path / "joint.toml"
    file.write_text('[simulation]\ntool_inertia_kgm2 = 0.0102\nstep_s = 0.005\nintegrator = "semi-implicit"\n')
    assert main(["certify", str(file), "--kp", kp, "--kd", kd]) == 1
    (row,) = (line for line in capsys.readouterr().out.splitlines() if "Least inertia" in line)
    (least, unit), (added, of_added) = quantities(row)
    assert 0.0102 + added >= least * (1 - 1e-12)
    assert unit == of_added == "kg.m2"


def test_the_least_inertia_has_the_unit_of_that_of_the_title(tmp_path, capsys):
    file = tmp_path / "knee.toml"
    file.write_text("[simulation]\ntool_inertia_kgm2 = [0.04, 0.12]\ntool_damping_nms_per_rad = 0.1\nstep_s = 0.005\n")
    assert main(["certify", str(file), "--kp", "20", "--kd", "0.1"]) == 0
    (row,) = (line for line in capsys.readouterr().out.splitlines() if "Least inertia" in line)
    ((least, unit),) = quantities(row)
    assert unit == "kg.m2"
    assert 0 < least < 1e-3


def test_gains_are_recommended_and_of_a_required_frequency(joint, capsys):
    assert main(["recommend", joint, "--frequency", "5 Hz", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["at_frequency"]["damping_ratio"] == pytest.approx(0.7, abs=1e-6)
    assert document["stiffest"]["disk_margin"] >= 0.3


@pytest.mark.parametrize(
    "command",
    [
        "simulate P",
        "zwidth P",
        "solve P",
        "compare P",
        "run P",
        "explore P",
        "recommend P --stiffest",
        "certify P --kp 1 --ki 1",
        "trial P",
        "export P --c out",
        "firmware P --board netduinoplus2 --out out",
    ],
)
def test_verbs_of_devices_refuse_it(command, joint, capsys):
    assert main([joint if word == "P" else word for word in command.split()]) == 2
    message = capsys.readouterr().err
    assert any(why in message for why in ("is a joint that an engine moves", "law of a joint"))


def test_it_is_checked(joint, capsys):
    assert main(["check", joint]) == 0
    assert capsys.readouterr().out.endswith(f"next: avc recommend {joint}\n")


@pytest.mark.slow
def test_a_joint_without_a_damper_is_marginal_and_has_a_range_of_kd(joint, capsys):
    assert main(["certify", joint, "--kp", "50", "--json"]) == 1
    limits = json.loads(capsys.readouterr().out)["stable_at"]
    assert limits["stiffness_nm_per_rad"] is None
    low, high = limits["damping_nms_per_rad"]
    assert main(["certify", joint, "--kp", "50"]) == 1
    text = capsys.readouterr().out
    assert "marginal" in text
    assert "--kd KD" in text
    assert "above 0 N.m.s/rad at this kp" in text
    # The integrator solves for the velocity: there is no largest kd, which JSON has as null.
    assert high is None
    for kd in (2 * low + 1e-3, 1e3):
        assert main(["certify", joint, "--kp", "50", "--kd", f"{kd}"]) == 0
        assert "above 0 N.m.s/rad at this kp" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("typed", "named"),
    [("--kp -3", "--kp"), ("--k=-3", "--k"), ("--kp 3 --kd=-1", "--kd"), ("--kp 3 --b -1", "--b"), ("--kp x", "--kp")],
)
def test_an_error_names_the_option_that_was_typed(joint, capsys, typed, named):
    device = pathlib.Path("device.toml")
    device.write_text("[device]\nmass_kg = 0.1\ndamping_ns_per_m = 0.8\n")
    for subject in (joint, str(device)):
        assert main(["certify", subject, *typed.split()]) == 2
        assert f" {named}: is " in capsys.readouterr().err


def test_errors_of_a_rotary_joint_name_its_own_keys(joint, capsys):
    assert main(["certify", joint, "--kp", "-3"]) == 2
    message = capsys.readouterr().err
    assert "--kp: is -3.0" in message
    assert main(["certify", joint, "--kp", "0"]) == 2
    message = capsys.readouterr().err
    assert "stiffness_nm_per_rad" in message
    assert "n_per_m," not in message
