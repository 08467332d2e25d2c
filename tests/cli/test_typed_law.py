"""Your own gains on the command line: numbers in SI units, or with a unit."""

import json

import pytest
from quick import first

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
    first(
        [
            (avc.certify_law, "knob", {"k": 1.0, "b": 0.002, "remedies": False}),
            (avc.certify_law, "knob", {"k": 0.2, "b": 0.004, "remedies": False}),
            (avc.certify_admittance, "admittance/cobot", {"remedies": False, "limits": False}),
        ]
    ),
)
def test_deployable_is_what_its_row_says(certify, problem, law):
    judged = certify(problem, **law)
    assert judged.deployable == judged.document()["deployable"]["pass"]
    assert str(judged).partition("Deployable")[2].split()[0] == ("yes:" if judged.deployable else "no:")


EVERY_PIECE = """\
[device]
mass_kg = 0.12
damping_ns_per_m = 0.8
encoder_resolution_m = 2e-5
[law]
stiffness_n_per_m = 500.0
damping_ns_per_m = 5.0
local_damping_ns_per_m = 0.5
integral_n_per_m_s = 100.0
virtual_mass_kg = 0.01
velocity = {velocity}
filters = [
  {{ kind = "low-pass", cutoff_hz = 150.0, order = 2 }},
  {{ kind = "notch", frequency_hz = 120.0, depth = 0.3, width = 0.7 }},
  {{ kind = "lead", frequency_hz = 80.0, phase_deg = 20.0 }},
]
dead_zone_m = 1e-4
integral_limit_n = 2.0
friction_compensation = {{ force_n = 0.05, velocity_m_per_s = 0.1 }}
rate_divider = 2
"""
SMOOTHED = '{ kind = "low-pass", cutoff_hz = 30.0, order = 2 }'
WINDOW = '{ kind = "window", samples = 4 }'


def leaves(value, path=""):
    """Return the values of a document by their dotted keys."""
    if isinstance(value, dict):
        return {key: leaf for name, inner in value.items() for key, leaf in leaves(inner, f"{path}.{name}").items()}
    if isinstance(value, list):
        return leaves(dict(enumerate(value)), path)
    return {path.lstrip("."): value}


@pytest.fixture
def _without_limits(monkeypatch):
    certify_law = avc.certify_law
    monkeypatch.setattr(avc, "certify_law", lambda *law, **gains: certify_law(*law, **gains, limits=False))


def judged_law(source, typed, capsys):
    """Return the law that `certify` judges, its values by their keys."""
    main(["certify", str(source), *typed, "--json"])
    return leaves(json.loads(capsys.readouterr().out)["law"])


@pytest.mark.slow
@pytest.mark.usefixtures("_without_limits")
@pytest.mark.parametrize(
    ("option", "typed", "velocity", "replaced"),
    [
        ("k", "600", SMOOTHED, {"stiffness_n_per_m": 600.0}),
        ("b", "6", SMOOTHED, {"damping_ns_per_m": 6.0}),
        ("b-p", "0.6", SMOOTHED, {"local_damping_ns_per_m": 0.6}),
        ("ki", "50", SMOOTHED, {"integral_n_per_m_s": 50.0}),
        ("virtual-mass", "20 g", SMOOTHED, {"virtual_mass_kg": 0.02}),
        ("cutoff-hz", "40", SMOOTHED, {"velocity.cutoff_hz": 40.0}),
        ("velocity", "low-pass 40 Hz", SMOOTHED, {"velocity.cutoff_hz": 40.0}),
        ("velocity", "window 5", WINDOW, {"velocity.samples": 5}),
        ("notch", "100 Hz", SMOOTHED, {"filters.1.frequency_hz": 100.0}),
        ("friction-compensation", "0.04N", SMOOTHED, {"friction_compensation.force_n": 0.04}),
        ("friction-compensation", "0.05N, 0.2m/s", SMOOTHED, {"friction_compensation.velocity_m_per_s": 0.2}),
    ],
)
def test_an_option_replaces_the_value_that_it_names_and_no_other(option, typed, velocity, replaced, tmp_path, capsys):
    source = tmp_path / "law.toml"
    source.write_text(EVERY_PIECE.format(velocity=velocity))
    declared = judged_law(source, [], capsys)
    assert judged_law(source, [f"--{option}={typed}"], capsys) == declared | replaced


@pytest.mark.slow
@pytest.mark.usefixtures("_without_limits")
def test_an_estimator_of_another_kind_replaces_the_whole_estimator(tmp_path, capsys):
    source = tmp_path / "law.toml"
    source.write_text(EVERY_PIECE.format(velocity=SMOOTHED))
    law = judged_law(source, ["--velocity", "window 5"], capsys)
    assert {key: value for key, value in law.items() if key.startswith("velocity")} == {
        "velocity.kind": "window",
        "velocity.samples": 5,
    }


@pytest.mark.usefixtures("_without_limits")
def test_a_notch_is_added_behind_filters_without_one_and_refused_beside_two(tmp_path, capsys):
    device = "[device]\nmass_kg = 0.07\ndamping_ns_per_m = 0.37\n[law]\nstiffness_n_per_m = 500.0\n"
    smoothing = '[[law.filters]]\nkind = "low-pass"\ncutoff_hz = 15\n'
    notch = '[[law.filters]]\nkind = "notch"\nfrequency_hz = 90\n'
    source = tmp_path / "law.toml"
    source.write_text(device + smoothing)
    law = judged_law(source, ["--notch", "200 Hz"], capsys)
    assert (law["filters.0.cutoff_hz"], law["filters.1.frequency_hz"]) == (15.0, 200.0)
    source.write_text(device + smoothing + 2 * notch)
    assert main(["certify", str(source), "--notch", "200 Hz"]) == 2
    assert "law.filters[1] and law.filters[2] are 2 notches" in " ".join(capsys.readouterr().err.split())


@pytest.mark.usefixtures("_without_limits")
def test_a_cutoff_is_refused_for_an_estimator_that_has_none_and_filters_a_difference(tmp_path, capsys):
    source = tmp_path / "law.toml"
    source.write_text(EVERY_PIECE.format(velocity=WINDOW))
    assert main(["certify", str(source), "--cutoff-hz", "40"]) == 2
    message = " ".join(capsys.readouterr().err.split())
    assert 'law.velocity is of kind "window"; leave it out, or replace the estimator' in message
    assert '--velocity "low-pass 40 Hz"' in message
    source.write_text(EVERY_PIECE.format(velocity='{ kind = "difference" }'))
    law = judged_law(source, ["--cutoff-hz", "40"], capsys)
    assert (law["velocity.kind"], law["velocity.cutoff_hz"]) == ("low-pass", 40.0)


LATE_DEVICE = """\
[device]
mass_kg = 0.1
damping_ns_per_m = 0.6
delay_samples = 3
[environment]
stiffness_n_per_m = 5000.0
damping_ns_per_m = 2.0
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("k", "b", "words"),
    [
        ("5600", "32.7", "no: unstable when released, stable with every hand: "),
        ("20000", "1", "no: unstable: "),
    ],
)
def test_an_unstable_law_names_the_loop_that_fails_where_the_other_one_is_stable(k, b, words, tmp_path, capsys):
    source = tmp_path / "late.toml"
    source.write_text(LATE_DEVICE)
    main(["certify", str(source), "--k", k, "--b", b])
    assert words in " ".join(capsys.readouterr().out.split())


def test_the_walls_of_all_hands_are_said_to_be_held_only(tmp_path, capsys):
    source = tmp_path / "late.toml"
    source.write_text(LATE_DEVICE)
    assert main(["zwidth", str(source)]) == 0
    rows = {line.strip().partition("  ")[0]: line for line in capsys.readouterr().out.splitlines()}
    assert "held only, not released" in rows["Stable, all hands"]
    assert "held" not in rows["Stable, released"]


THIN_LAW = """\
[device]
mass_kg = 0.12
damping_ns_per_m = 0.8
[law]
stiffness_n_per_m = {k}
damping_ns_per_m = 12.0
"""


@pytest.mark.slow
@pytest.mark.parametrize("k", [3000, 9000, 40000])
def test_export_gives_the_mark_of_certify(k, tmp_path, capsys):
    source = tmp_path / "law.toml"
    source.write_text(THIN_LAW.format(k=k))
    main(["certify", str(source)])
    certified = next(line for line in capsys.readouterr().out.splitlines() if "Deployable" in line)
    main(["export", str(source), "--c", str(tmp_path), "--unsafe", "--force"])
    exported = next(line for line in capsys.readouterr().out.splitlines() if "Verdict" in line)
    assert exported.split()[0] == certified.split()[0]


@pytest.mark.parametrize(("cutoff_hz", "doubted"), first([(700, True), (500, True), (499, False), (80, False)]))
@pytest.mark.parametrize(
    ("law", "divider", "key"),
    first(
        [
            ("", 1, "cutoff_hz"),
            ("[law]\nstiffness_n_per_m = 300.0\n", 1, "law.velocity.cutoff_hz"),
            ("[law]\nstiffness_n_per_m = 300.0\nrate_divider = 2\n", 2, "law.velocity.cutoff_hz"),
        ]
    ),
)
@pytest.mark.usefixtures("_without_limits")
def test_a_cutoff_at_half_the_rate_or_above_is_a_caution(law, divider, key, cutoff_hz, doubted, tmp_path, capsys):
    source = tmp_path / "p.toml"
    source.write_text(f"[device]\nmass_kg = 0.12\ndamping_ns_per_m = 0.8\n{law}")
    main(["certify", str(source), "--k", "300", "--b", "3", "--cutoff-hz", str(cutoff_hz / divider)])
    text = " ".join(capsys.readouterr().out.split())
    assert ("! Values" in text) is doubted
    assert (f"{key} is {cutoff_hz / divider}, not below half the sample rate" in text) is doubted


@pytest.mark.slow
def test_a_typed_cutoff_of_an_admittance_law_above_half_the_rate_is_a_caution(capsys):
    for cutoff_hz, doubted in (("700", True), ("20", False)):
        main(["certify", "admittance/cobot", "--cutoff-hz", cutoff_hz])
        text = " ".join(capsys.readouterr().out.split())
        assert ("law.admittance.cutoff_hz is 700.0, above half the sample rate" in text) is doubted


def test_check_names_a_filter_of_the_file_at_half_its_rate(tmp_path, capsys):
    source = tmp_path / "p.toml"
    filters = 'filters = [{ kind = "low-pass", cutoff_hz = 100.0 }, { kind = "low-pass", cutoff_hz = 600.0 }]\n'
    law = "[law]\nstiffness_n_per_m = 300.0\n"
    source.write_text(f"[device]\nmass_kg = 0.12\ndamping_ns_per_m = 0.8\n{law}{filters}")
    assert main(["check", str(source)]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "law.filters[1].cutoff_hz is 600.0, not below half the sample rate, 500 Hz" in text
    assert "filters[0]" not in text


KNOB = """[device]
motion = "rotary"
inertia_kgm2 = 0.0002
damping_nms_per_rad = 0.001
delay_samples = 1
handle_radius_m = 0.02
[law]
stiffness_nm_per_rad = 1.0
damping_nms_per_rad = 0.01
integral_nm_per_rad_s = 1.5
"""


@pytest.mark.parametrize(
    ("option", "key", "needed"),
    [
        ("--k", "law.integral_nm_per_rad_s", "stiffness_nm_per_rad"),
        ("--ki", "law.integral_limit_nm", "integral_nm_per_rad_s"),
    ],
)
def test_what_a_typed_gain_makes_wrong_in_a_file_names_the_file_and_its_keys(option, key, needed, tmp_path, capsys):
    knob = tmp_path / "knob.toml"
    knob.write_text(f"{KNOB}integral_limit_nm = 0.2\n", encoding="utf-8")
    assert main(["certify", str(knob), option, "0", "--json"]) == 2
    (fault,) = json.loads(capsys.readouterr().out)["errors"]
    assert (fault["file"], fault["key"]) == (str(knob), key)
    assert needed in fault["message"]


@pytest.mark.slow
@pytest.mark.parametrize(("option", "key"), [("ki", "integral_n_per_m_s"), ("--kd", "damping_ns_per_m")])
def test_the_name_of_an_option_is_one_of_its_number(option, key, tmp_path, capsys):
    knob = tmp_path / "knob.toml"
    knob.write_text(KNOB, encoding="utf-8")
    documents = []
    for named in (option, key):
        assert main(["zwidth", str(knob), f"--over={named}", "--json"]) == 0
        documents.append(json.loads(capsys.readouterr().out))
    assert documents[0] == documents[1]
