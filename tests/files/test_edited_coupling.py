"""A coupling file that was changed after avc wrote it: what changes nothing is no edit, whatever else does is one."""

import json
import re

import pytest

import avc_casadi as avc
from avc_casadi.cli import main
from avc_casadi.coupling import Coupling
from avc_casadi.files.coupling_file import coupling_text
from avc_casadi.files.problem_file import load_any
from avc_casadi.model.ends import ToolGains
from avc_casadi.model.gains import Gains

TURNS = {
    "device": {"motion": "rotary", "inertia_kgm2": 5e-5, "damping_nms_per_rad": 1e-4, "handle_radius_m": 0.02},
    "environment": {"stiffness_nm_per_rad": 0.3, "damping_nms_per_rad": 0.0},
}
COUPLINGS = {
    "wall": Coupling.constant(avc.load_problem("figure5").changed(frequency={"points": 3}), Gains(0.0, 1e3, 5.0), "x"),
    "rotary": Coupling.constant(load_any(TURNS), Gains(1e-3, 0.05), "x"),
    "tool": Coupling.to_end(avc.load_problem("tool/mujoco-500hz"), ToolGains(615.7, 0.2317)),
}
OF_ANY = pytest.mark.parametrize("made", COUPLINGS.values(), ids=COUPLINGS)


def read(text, folder):
    (folder / "c.json").write_text(text, encoding="utf-8")
    return avc.read_coupling(folder / "c.json")


def reversed_keys(value):
    """The same JSON values, the keys of each table from the last to the first."""
    if isinstance(value, dict):
        return {key: reversed_keys(item) for key, item in reversed(value.items())}
    return [reversed_keys(item) for item in value] if isinstance(value, list) else value


@OF_ANY
def test_order_spaces_and_spelling_of_numbers_are_no_edit(made, tmp_path):
    text = coupling_text(made, extra=[1.0, -0.0, 1e22, True])
    document = json.loads(text)
    spelt = text.replace("1e+22", "10000000000000000000000")
    spelt = re.sub(r" -?([01])\.0(?!\d|e)", r" \1", spelt)
    for same in (text, json.dumps(document), json.dumps(reversed_keys(document), indent=4), spelt):
        again = read(same, tmp_path)
        assert not again.edited
        assert again.id == made.id


def leaves(value, place=()):
    """Yield the place of every text and number of JSON values."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        yield from leaves(item, (*place, key))
    if isinstance(value, str | int | float):
        yield place


def another(value):
    """Another value of the same kind."""
    if isinstance(value, str):
        return f"{value}x"
    return not value if isinstance(value, bool) else 1.01 * value + 1e-9


@pytest.mark.slow
@OF_ANY
def test_every_value_that_is_changed_and_still_read_is_an_edit(made, tmp_path):
    text = coupling_text(made, extra=[1.0])
    read_anew = 0
    for place in leaves(json.loads(text)):
        document = json.loads(text)
        table = document
        for key in place[:-1]:
            table = table[key]
        was = table[place[-1]]
        table[place[-1]] = (
            f"{was}x" if isinstance(was, str) else not was if isinstance(was, bool) else 1.01 * was + 1e-9
        )
        try:
            edited = read(json.dumps(document), tmp_path).edited
        except avc.InputError:
            continue
        read_anew += 1
        assert edited, place
    assert read_anew > 10


def test_a_file_of_an_earlier_release_has_no_digest_and_is_read_as_before(tmp_path):
    document = json.loads(coupling_text(COUPLINGS["wall"]))
    del document["digest"]
    document["problem_file"]["hands"]["mass_kg"] = [0.1, 0.2]
    assert not read(json.dumps(document), tmp_path).edited


@pytest.mark.parametrize("key", ["method", "stiffness_n_per_m"])
def test_a_key_that_stands_twice_is_refused(key, tmp_path):
    text = coupling_text(COUPLINGS["wall"])
    start = text.index(f'"{key}":')
    twice = f'{text[:start]}"{key}": 1,\n{text[start:]}'
    with pytest.raises(avc.InputError, match="stands twice") as raised:
        read(twice, tmp_path)
    assert raised.value.faults[0].key == key
    assert raised.value.faults[0].file == str(tmp_path / "c.json")


def answered(capsys, *typed):
    assert main([*typed, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_answers_note_an_edit_and_say_what_the_verdict_is_for(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    made = COUPLINGS["wall"]
    text = coupling_text(made)
    document = json.loads(text)
    hands = {"mass_kg": [0.1, 0.2], "damping_ns_per_m": [4.0, 10.0], "stiffness_n_per_m": [300.0, 700.0]}
    document["problem_file"]["hands"] |= hands
    document["problem_file"]["robustness"]["disk_margin"] = 0.05
    (tmp_path / "c.json").write_text(text, encoding="utf-8")
    (tmp_path / "edited.json").write_text(json.dumps(document), encoding="utf-8")
    as_written = answered(capsys, "export", "c.json", "--c", "as_written")
    ranges = made.problem.hands.model_dump(mode="json", exclude={"let_go"})
    assert as_written["judged_for"] == {"hands": ranges, "disk_margin": 0.15}
    assert not as_written["edited"]
    edited = answered(capsys, "export", "edited.json", "--c", "edited")
    assert edited["judged_for"] == {"hands": hands, "disk_margin": 0.05}
    assert edited["edited"]
    for typed in (["export", "edited.json", "--c", "edited"], ["certify", "edited.json"]):
        assert main(typed) == 0
        assert "changed after avc wrote it" in " ".join(capsys.readouterr().out.split())
