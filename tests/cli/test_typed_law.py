"""Your own gains on the command line: numbers in SI units, or with a unit."""

import json

import pytest

import avc_casadi as avc
from avc_casadi._util.units import LINEAR, ROTARY
from avc_casadi.cli import build_parser, main
from avc_casadi.cli.law import read_numbers

RADIUS_M = 0.05
GRAVITY_M_PER_S2 = 9.80665


@pytest.mark.parametrize(
    ("units", "option", "typed", "si"),
    [
        (LINEAR, "k", "3000", 3000.0),
        (LINEAR, "k", "3kN/m", 3000.0),
        (LINEAR, "k", "3 N/mm", 3000.0),
        (LINEAR, "b", "12 N.s/m", 12.0),
        (LINEAR, "b", "0.012 N/(mm/s)", None),
        (LINEAR, "b_p", "50 mN.s/m", 0.05),
        (LINEAR, "ki", "2 kN/(m.s)", 2000.0),
        (LINEAR, "ki", "2 kN/m/s", 2000.0),
        (LINEAR, "virtual_mass", "20 g", 0.02),
        (LINEAR, "virtual_mass", "-20 g", -0.02),
        (LINEAR, "cutoff_hz", "0.08 kHz", 80.0),
        (ROTARY, "k", "500 mN.m/rad", 0.5),
        (ROTARY, "k", "1 kgf.cm/rad", GRAVITY_M_PER_S2 / 100),
        (ROTARY, "k", "200 N/m", 200 * RADIUS_M**2),
        (ROTARY, "b", "2 mN.m.s/rad", 2e-3),
        (ROTARY, "b", "0.8 N.s/m", 0.8 * RADIUS_M**2),
        (ROTARY, "b_p", "2e-3", 2e-3),
        (ROTARY, "ki", "25.5 kN.m/(rad.s)", 25500.0),
        (ROTARY, "virtual_mass", "300 g.cm2", 3e-5),
        (ROTARY, "k", "3 kg", None),
        (ROTARY, "cutoff_hz", "fast", None),
        (LINEAR, "k", "nan", None),
        (LINEAR, "k", "1e999", None),
    ],
)
def test_a_number_of_a_law_has_any_unit_of_its_quantity(units, option, typed, si):
    args = build_parser().parse_args(["certify", "P", f"--{option.replace('_', '-')}={typed}"])
    if si is None:
        with pytest.raises(ValueError, match="not a quantity in") as refused:
            read_numbers(args, units, RADIUS_M)
        assert refused.value.faults[0].key == option
        return
    read_numbers(args, units, RADIUS_M)
    assert getattr(args, option) == pytest.approx(si, rel=1e-14)


JOINT = '[simulation]\n{} = 0.01\nstep_s = 0.005\nintegrator = "implicit-damping"\n'


@pytest.mark.parametrize(
    ("inertia", "typed"),
    [
        ("tool_inertia_kgm2", ["--kp", "100 N/m", "--kd", "1"]),
        ("tool_inertia_kgm2", ["--kp", "100", "--kd", "0.5 N.s/m"]),
        ("tool_inertia_kgm2", ["--kp", "1 N/mm", "--kd", "1"]),
        ("tool_inertia_kgm2", ["--kp", "100", "--ki", "2 N/(m.s)"]),
        ("tool_inertia_kgm2", ["--kp", "100", "--b-p", "1 N.s/m"]),
        ("tool_inertia_kgm2", ["--kp", "100", "--virtual-mass", "20 g"]),
        ("tool_inertia_kgm2", ["--kp", "100", "--friction-compensation", "1 N, 0.1 rad/s"]),
        ("tool_mass_kg", ["--kp", "100 N.m/rad", "--kd", "1"]),
        ("tool_mass_kg", ["--kp", "100", "--kd", "1 N.m.s/rad"]),
    ],
)
def test_a_joint_has_no_handle_at_which_another_unit_could_be_read(inertia, typed, tmp_path, capsys):
    joint = tmp_path / "joint.toml"
    joint.write_text(JOINT.format(inertia))
    assert main(["certify", str(joint), *typed]) == 2
    assert "not a quantity in " in capsys.readouterr().err


@pytest.mark.parametrize("option", ["--k", "--b", "--b-p", "--ki", "--virtual-mass", "--cutoff-hz"])
@pytest.mark.parametrize("problem", ["figure5", "knob"])
def test_a_number_as_typed_has_the_limits_of_its_key(option, problem, capsys):
    gains = {"--k": "1", "--b": "0.001", option: "1e30"}
    assert main(["certify", problem, *(word for pair in gains.items() for word in pair)]) == 2
    assert "is 1e+30; allowed: " in capsys.readouterr().err


def test_all_numbers_that_cannot_be_read_are_refused_at_once(capsys):
    assert main(["certify", "figure5", "--k", "nan", "--b", "inf", "--b-p", "3 kg"]) == 2
    message = capsys.readouterr().err
    assert all(f"{option}: is" in message for option in ("--k", "--b", "--b-p"))
    assert message.count("a finite number") == 2


def test_a_verdict_stands_next_to_the_values_that_may_be_slips(tmp_path, capsys):
    light = tmp_path / "light.toml"
    light.write_text("[device]\nmass_kg = 0.00012\ndamping_ns_per_m = 0.8\n[law]\nstiffness_n_per_m = 3\n")
    main(["certify", str(light)])
    assert "device.mass_kg is 0.00012: usual 0.005 to 30" in " ".join(capsys.readouterr().out.split())


def test_gains_with_and_without_a_unit_are_the_same_law(capsys):
    certificates = []
    for typed in (["--k", "300", "--b", "2"], ["--kp", "0.3 kN/m", "--kd=2000mN.s/m"]):
        assert main(["certify", "figure5", *typed, "--json"]) == 0
        certificates.append(json.loads(capsys.readouterr().out))
    assert certificates[0] == certificates[1]


@pytest.mark.parametrize(
    ("certify", "problem", "law"),
    [
        (avc.certify_law, "knob", {"k": 1.0, "b": 0.002, "remedies": False}),
        (avc.certify_law, "knob", {"k": 0.2, "b": 0.004, "remedies": False}),
        (avc.certify_admittance, "admittance/cobot", {"remedies": False, "limits": False}),
    ],
)
def test_deployable_is_what_its_row_says(certify, problem, law):
    judged = certify(problem, **law)
    assert judged.deployable == judged.document()["deployable"]["pass"]
    assert str(judged).partition("Deployable")[2].split()[0] == ("yes:" if judged.deployable else "no:")
