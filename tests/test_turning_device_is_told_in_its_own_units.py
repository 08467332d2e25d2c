"""A device that turns is read, answered, drawn, reported and exported in rad, N.m and kg.m2, and in nothing else."""

import json
import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

import avc_casadi as avc
from avc_casadi._util import units
from avc_casadi.cli import main
from avc_casadi.coupling import Coupling
from avc_casadi.model.gains import Gains
from avc_casadi.recommendation.preconditions import assumed
from avc_casadi.recommendation.stiffest import Processes

KNOB = """
title = "a knob, N and mm in its own words"
[device]
motion = "rotary"
handle_radius_m = 0.02
inertia_kgm2 = 3e-5
damping_nms_per_rad = 1e-4
delay_samples = 1
coulomb_friction_nm = 0.002
encoder_counts_per_turn = 16384
max_torque_nm = 0.2
[environment]
stiffness_nm_per_rad = 1.0
damping_nms_per_rad = 0.0
[coupling]
structure = "damped"
contact_damping_nms_per_rad = [0.0, 0.05]
[frequency]
values_hz = [1.0, 10.0, 60.0]
[scene]
duration_s = 1.0
"""
# A unit of a linear device after a number, in a heading or in brackets; the user's own title is no answer.
LINEAR_UNIT = re.compile(
    r"(?:(?<=\d )|(?<=[\s(\[,]))(?:k?N/m|N\.s/m|N·s/m|N|kg|mm|um|mm/s|m/s)(?![\w/.·]|\.\w)(?=[\s),;:.\]\"']|$)"
)
LINEAR_KEY = re.compile(r"\b\w+_(?:kg|n|ns_per_m|n_per_m|m_per_s|m|m_per_n)\b")
LENGTHS = {"handle_radius_m", "capstan_radius_m"}


def linear_words(text):
    """Return every linear unit and key of a text, but the title that the user gave."""
    text = text.replace("a knob, N and mm in its own words", "")
    return LINEAR_UNIT.findall(text) + [key for key in LINEAR_KEY.findall(text) if key not in LENGTHS]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("knob")
    (made / "knob.toml").write_text(KNOB)
    # No encoder's steps to resolve, one frequency and a short motion: the same words sooner.
    quick = KNOB.replace("values_hz = [1.0, 10.0, 60.0]", "values_hz = [10.0]").replace(
        "duration_s = 1.0", "duration_s = 0.4"
    )
    (made / "quick.toml").write_text(quick.replace("encoder_counts_per_turn = 16384\n", ""))
    problem = avc.load_problem(made / "knob.toml")
    gains = Gains(0.0, 1e8, 0.0017)
    avc.write_coupling(Coupling.constant(problem, gains, "mine"), made / "knob.json")
    return made


VERBS = {
    "check": ["check", "knob.toml"],
    "solve": ["solve", "knob.toml", "--method", "exact", "--out", "solved.json"],
    "certify": ["certify", "knob.json"],
    "simulate": ["simulate", "knob.json"],
    "screen": ["simulate", "quick.toml", "--screen"],
    "zwidth": ["zwidth", "quick.toml"],
    "compare": ["compare", "knob.toml"],
    "export": ["export", "knob.json", "--c", "c", "--unsafe"],
}


SLOW = {"zwidth", "screen"}


@pytest.mark.thorough
@pytest.mark.one_of(2)
@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_answers_so(verb, folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    assert main(VERBS[verb]) in (0, 1)
    told = capsys.readouterr()
    assert told.out
    assert linear_words(told.out + told.err) == []
    if verb in SLOW:
        return
    assert main([*VERBS[verb], "--json"]) in (0, 1)
    text = capsys.readouterr().out
    document = json.loads(text)
    assert document["motion"] == "rotary"
    assert document["units"]["stiffness"] == "N.m/rad"
    assert linear_words(text) == []


def test_keys_of_the_other_motion_are_refused_at_once():
    wrong = KNOB.replace("inertia_kgm2", "mass_kg").replace("stiffness_nm_per_rad", "stiffness_n_per_m")
    with pytest.raises(avc.InputError) as refused:
        avc.parse_problem(wrong.replace("coulomb_friction_nm = 0.002", "coulomb_friction_nm = -1"))
    told = {fault.key: (fault.line, fault.message) for fault in refused.value.faults}
    assert (
        told["device.mass_kg"][1] == 'is a key of a linear device; allowed: inertia_kgm2, as device.motion is "rotary"'
    )
    assert "stiffness_nm_per_rad" in told["environment.stiffness_n_per_m"][1]
    assert told["device.coulomb_friction_nm"] == (9, "is -1; allowed: 0 or 1e-9 to 1e6 N.m")
    assert len(told) == 3
    with pytest.raises(avc.InputError) as refused:
        avc.parse_problem(KNOB.replace('motion = "rotary"\nhandle_radius_m = 0.02', ""))
    told = {fault.key: fault.message for fault in refused.value.faults}
    assert told["device.inertia_kgm2"].endswith('allowed: mass_kg, or device.motion = "rotary"')
    assert {"environment.stiffness_nm_per_rad", "device.encoder_counts_per_turn", "device.max_torque_nm"} <= set(told)


def test_a_range_of_counts_is_one_of_the_step():
    def device(ends):
        return avc.parse_problem(f"{KNOB}\n[device.range]\nencoder_counts_per_turn = {ends}\n").device

    coarsest, finest = 2 * math.pi / 4000, 2 * math.pi / 16384
    assert device("[4000, 16384]").range.encoder_resolution_m == (finest, coarsest)
    for ends, said in (
        ("[16384, 4000]", "reversed"),
        ("4000", "4 to 1e9 counts"),
        ("[1, 4000]", "4 to 1e9 counts"),
        ("[4000]", "4 to 1e9 counts"),
        ('["a", 4000]', "4 to 1e9 counts"),
        ("[4000, 8000]", "that hold device.encoder_counts_per_turn = 16384"),
        ("[4000, 16384]\nencoder_resolution_rad = [1e-4, 1e-3]", "beside encoder_resolution_rad"),
    ):
        with pytest.raises(avc.InputError) as refused:
            device(ends)
        (fault,) = refused.value.faults
        assert fault.key == "device.range.encoder_counts_per_turn"
        assert said in fault.message


def test_a_box_of_gains_that_no_file_states_bounds_nothing():
    own = "contact_damping_nms_per_rad = [0.0, 0.05]\n"
    for box, told in (("", False), ("stiffness_nm_per_rad = [0.0, 0.5]\n", True)):
        problem = avc.parse_problem(KNOB.replace(own, box), name="knob")
        found = assumed(problem, Coupling.constant(problem, Gains(0.0, 1e6), "x"))
        assert any("gain box of [coupling]" in line for line in found) == told


def test_a_range_of_counts_that_says_nothing_is_refused():
    ends = "\n[device.range]\nencoder_counts_per_turn = [4000, 16384]\n"
    linear = KNOB.replace('motion = "rotary"\nhandle_radius_m = 0.02', "")
    for text, said in (
        (KNOB.replace("encoder_counts_per_turn = 16384\n", ""), "without device.encoder_counts_per_turn"),
        (linear, "is a key of a device that turns"),
    ):
        with pytest.raises(avc.InputError) as refused:
            avc.parse_problem(text + ends)
        told = {fault.key: fault.message for fault in refused.value.faults}
        assert said in told["device.range.encoder_counts_per_turn"]


def test_a_problem_is_written_and_read_in_its_own_keys():
    problem = avc.parse_problem(KNOB, name="knob")
    text = avc.dump_problem(problem)
    assert linear_words(text) == []
    assert avc.parse_problem(text, name="knob") == problem


def test_a_coupling_file_comes_back(folder):
    text = (folder / "knob.json").read_text()
    assert linear_words(text) == []
    found = avc.read_coupling(folder / "knob.json")
    assert found.problem == avc.load_problem(folder / "knob.toml")
    avc.write_coupling(found, folder / "again.json")
    assert (folder / "again.json").read_text() == text


@given(
    st.lists(st.sampled_from(["mass", "force", "stiffness", "at", "0"]), min_size=1),
    st.sampled_from(["_kg", "_n", "_m", "_ns_per_m", "_n_per_m", "_m_per_s", "_m_per_n", "_hz", ""]),
)
def test_names_are_one_to_one(parts, ending):
    key = "_".join(parts) + ending
    assert units.ROTARY.inner(units.ROTARY.key(key)) == key
    assert units.ROTARY.key(units.ROTARY.key(key)) == units.ROTARY.key(key)
    assert units.LINEAR.key(key) == key


def test_a_linear_device_keeps_every_word():
    problem = avc.load_problem("figure5")
    assert problem.units is units.LINEAR
    assert (
        f"a {units.FORCE} of 3 {units.N_PER_M} and 5 {units.MM}, {units.A_MASS}" == "a force of 3 N/m and 5 mm, a mass"
    )
    assert units.spoken_key("device.mass_kg") == "device.mass_kg"
    assert units.LINEAR.document({"mass_kg": 1}) == {"mass_kg": 1}
    assert "rotary" not in avc.dump_problem(problem)
    assert "motion" not in problem.device.model_dump()


def test_a_sentence_is_told_as_the_device_moves():
    sentence = units.Wording.of(
        lambda: (
            f"{units.FORCES:>8} of {units.A_MASS} "
            f"({units.spoken_key('device.mass_kg')}, {units.spoken_key('--force-n')})"
        )
    )
    assert str(sentence) == "  forces of a mass (device.mass_kg, --force-n)"
    with units.speaking(units.ROTARY):
        assert str(sentence) == " torques of an inertia (device.inertia_kgm2, --torque-nm)"
        assert units.spoken_key("device.handle_radius_m") == "device.handle_radius_m"
        assert f"held at 5 m, pushed by 2 {units.NEWTON}" == "held at 5 m, pushed by 2 N.m"


@pytest.mark.parametrize(
    "raised", [avc.InputError.of("no", key="device.mass_kg"), avc.UnsupportedError("no", key="force_n")]
)
def test_an_error_names_its_key_as_the_device_moves(raised):
    with pytest.raises(type(raised)) as caught, units.speaking(units.ROTARY):
        raise raised
    keys = [fault.key for fault in getattr(caught.value, "faults", ())] or [caught.value.key]
    assert keys in (["device.inertia_kgm2"], ["torque_nm"])


def test_the_words_of_the_user_stay_as_they_are(capsys, tmp_path):
    title = "a force of 3 N/m on a mass, device.mass_kg in mm"
    (tmp_path / "own.toml").write_text(KNOB.replace("a knob, N and mm in its own words", title))
    assert main(["check", str(tmp_path / "own.toml"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["title"] == title
    assert title in avc.dump_problem(avc.load_problem(tmp_path / "own.toml"))


def test_what_a_call_returns_is_told_as_the_device_moves():
    problem = avc.parse_problem(KNOB, name="knob")
    coupling = Coupling.constant(problem, Gains(0.0, 1e8, 0.0017), "mine")
    verdict = avc.deployable(coupling)
    told = [
        repr(problem),
        repr(coupling),
        *(claim.sentence for claim in verdict.claims),
        str(avc.solve(problem, "exact")),
    ]
    assert linear_words("\n".join(told)) == []
    assert "N.m/rad" in told[0]


def test_another_process_tells_it_as_this_one():
    with Processes(1) as process, units.speaking(units.ROTARY):
        assert process.submit(units.spoken_key, "force_n").result() == "torque_nm"


@pytest.mark.parametrize(
    ("line", "faults"),
    [
        (
            "handle_radius_mm = 20",
            ["device.handle_radius_m: is missing", ":4: device.handle_radius_mm: is not a"],
        ),
        ("handle_radius_m = 1e-9", [":4: device.handle_radius_m: is 1e-09; allowed: 0.002 to 10 m"]),
    ],
)
def test_a_fault_of_the_radius_is_told_as_it_stands_and_brings_no_others(line, faults, tmp_path):
    file = tmp_path / "knob.toml"
    file.write_text(KNOB.lstrip().replace("handle_radius_m = 0.02", line))
    with pytest.raises(avc.InputError) as caught:
        avc.load_problem(file)
    assert len(caught.value.faults) == len(faults)
    for fault in faults:
        assert fault in str(caught.value)


def test_a_mistyped_key_is_told_with_the_nearest_of_a_turn(tmp_path, capsys):
    path = tmp_path / "typo.toml"
    path.write_text(
        '[device]\nmotion = "rotary"\nhandle_radius_m = 0.02\ninertia_kgm2 = 3e-5\ninertia_kgm = 1.0\n'
        "damping_nms_per_rad = 1e-4\nencoder_count_per_turn = 4096\n"
        "[environment]\nstiffness_nm_per_rad = 1.0\ndamping_nms_per_rad = 0.0\nstifness_nm_per_rad = 2.0\n"
        "[detent]\ntorque_nm = 0.01\npertrn = 24\n"
    )
    assert main(["check", str(path)]) == 2
    said = capsys.readouterr().err
    for key, nearest in {
        "device.inertia_kgm": "inertia_kgm2",
        "device.encoder_count_per_turn": "encoder_counts_per_turn",
        "environment.stifness_nm_per_rad": "stiffness_nm_per_rad",
        "detent.pertrn": "per_turn",
    }.items():
        (line,) = (line for line in said.splitlines() if f"{key}:" in line)
        assert line.endswith(f"; did you mean {nearest}?"), line
    assert "detent.pitch_rad: is missing; allowed: 1e-6 to 10 rad, or per_turn" in said


@pytest.mark.parametrize(
    ("key", "nearest"), [("coulomb_torque_nm", "coulomb_friction_nm"), ("maximum_torque_nm", "max_torque_nm")]
)
def test_a_key_that_begins_with_the_same_word_is_meant_before_a_nearer_one(key, nearest, tmp_path):
    file = tmp_path / "knob.toml"
    file.write_text(KNOB.lstrip().replace("handle_radius_m = 0.02", f"handle_radius_m = 0.02\n{key} = 0.1"))
    with pytest.raises(avc.InputError) as caught:
        avc.load_problem(file)
    assert str(caught.value).endswith(f"did you mean {nearest}?")


@pytest.mark.parametrize(
    ("kind", "key", "value", "inner"),
    [
        ("noise", "rms_rad", 1e-4, "rms_m"),
        ("encoder", "resolution_rad", 1e-3, "resolution_m"),
        ("backlash", "gap_rad", 2e-3, "gap_m"),
        ("viscous-friction", "damping_nms_per_rad", 1e-3, "damping_ns_per_m"),
    ],
)
def test_keys_of_effects_are_those_of_the_turn(kind, key, value, inner):
    text = KNOB + f'[[scene.effects]]\nkind = "hand"\n[[scene.effects]]\nkind = "{kind}"\n{key} = {value}\n'
    problem = avc.parse_problem(text, name="knob")
    assert getattr(problem.scene.effects[1], inner) == value
    written = avc.dump_problem(problem)
    assert f"{key} = " in written
    assert avc.parse_problem(written, name="knob") == problem
