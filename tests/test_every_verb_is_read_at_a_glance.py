"""Every verb answers in fifteen lines at most, with SI prefixes and the field's terms."""

import re

import pytest
from hardware_bench import require

from avc_casadi.cli import main
from avc_casadi.cli._verbs import OLD_VERBS, VERBS

MOST_LINES = 15
# A power of ten beside a unit that takes a prefix.
POWERS = re.compile(r"\d(\.\d+)?e[+-]\d\d ?(N|kg|g|m|Hz|s|J|rad)\b")
OLD_WORDS = (
    "let go",
    "felt",
    "complex error",
    "at rest",
    "to rest",
    "do not rest",
    "people",
    "subjects",
    "off its file",
    "other hands",
    "beside them",
    "believed hand",
    "innovation that passes",
)
# Verbs that tell a catalogue, or live records: their length is what was asked for.
LONG = ("list", "monitor")
SLOW = pytest.mark.thorough
ASKED = [
    "new stylus.toml --mass 120g --wall 3kN/m",
    "new rim.toml --like direct-drive-wheel --wall 30N.m/rad --held wheel",
    "check figure5",
    "check knob",
    "check devices/reference-r3",
    "check devices/direct-drive-wheel",
    "list",
    "study",
    "solve soft --method exact",
    "solve diverging --method static",
    "simulate soft",
    "simulate scenes/teaching-limit-cycle",
    "excite reference-r1 --plan-only",
    "excite smartknob --plan-only",
    "certify soft.json",
    "export soft.json --c out",
    "trial soft.json --hands 5",
    *(
        pytest.param(asked, marks=SLOW)
        for asked in (
            "recommend soft --hands 10",
            "recommend soft --hands 4 --stiffest",
            "run soft --out out",
            "solve figure5",
            "solve figure5 --as-printed",
            "solve hard/infeasible-box",
            "compare figure5 --mine 7000,10",
            "compare damped",
            "certify figure5 direct.json",
            "certify soft.json --prove",
            "zwidth figure5",
            "zwidth knob",
            "recommend tool/unity-60hz --hands 3 --out tool.json",
            "certify tool.json",
            "zwidth tool/unity-60hz",
            "check tool/unity-60hz",
            "simulate scenes/stiff-wall-pressed --against none,direct",
            "simulate scenes/teaching-plant --screen",
            "certify knob.json",
            "doctor",
            "doctor --ports",
            "excite reference-r1 --seconds 3 --out log.csv",
            "identify log.csv --device reference-r1 --out mine.toml",
            "diagnose log.csv --device reference-r1",
            "commission reference-r1 --port emulator",
            "push soft.json --port emulator",
            "stream soft.json --port emulator --seconds 1",
            "monitor --port emulator --seconds 1",
            "device --port emulator",
            "device --port emulator --clear",
            "firmware reference-r1 --board mps2-an386 --out out",
        )
    ),
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with what some verbs read."""
    there = tmp_path_factory.mktemp("verbs")
    assert main(["solve", "soft", "--method", "static-tuned", "--out", str(there / "soft.json")]) == 0
    return there


def needed(asked, there):
    """Make a file that one verb alone reads."""
    made = {
        "direct.json": ["solve", "figure5", "--out", "direct.json"],
        "knob.json": ["solve", "knob", "--method", "static", "--out", "knob.json"],
        "tool.json": ["recommend", "tool/unity-60hz", "--hands", "3", "--out", "tool.json"],
        "log.csv": ["excite", "reference-r1", "--seconds", "3", "--out", "log.csv"],
    }
    for name, arguments in made.items():
        if name in asked and f"--out {name}" not in asked and not (there / name).exists():
            assert main(arguments) == 0


@pytest.mark.thorough
@pytest.mark.parametrize("asked", ASKED)
def test_it_takes_fifteen_lines_with_prefixes_and_the_terms_of_the_field(asked, folder, monkeypatch, capsys):
    if asked.split()[0] in {"commission", "push", "stream", "monitor", "device", "excite", "firmware", "run"}:
        require("unicorn")
    monkeypatch.chdir(folder)
    needed(asked, folder)
    capsys.readouterr()
    assert main(asked.split()) in {0, 1}
    text = capsys.readouterr().out
    lines = text.splitlines()
    assert asked.split()[0] in LONG or 0 < len(lines) <= MOST_LINES, text
    assert not POWERS.search(text), text
    assert not [word for word in OLD_WORDS if word in text.lower()], text
    if "knob" in asked or "wheel" in asked:
        assert not re.search(r"\bN/m\b|\bN\.s/m\b|\b[kmu]?g\b(?!\.m2)", text), text


def test_no_verb_is_left_out():
    asked = {(one if isinstance(one, str) else one.values[0]).split()[0] for one in ASKED}
    assert set(VERBS) - asked == {"explore"}  # serves until Ctrl-C


@pytest.mark.parametrize(
    ("typed", "meant"), [("recomend", "recommend"), ("cerify", "certify"), ("simulat", "simulate")]
)
def test_a_verb_that_is_mistyped_is_answered_with_the_nearest(typed, meant, capsys):
    assert main([typed, "figure5"]) == 2
    assert f"{typed!r} is no verb; did you mean {meant}" in capsys.readouterr().err


def test_help_lists_every_verb_under_its_question(capsys):
    assert main(["--help"]) == 0
    text = capsys.readouterr().out
    listed = re.findall(r"^  ([a-z]+) +\S", text.partition("judge it:")[0].partition("design")[2], re.MULTILINE)
    assert listed == ["new", "recommend", "run", "solve", "compare"]
    assert [verb for verb in VERBS if re.search(rf"^  {verb} +[A-Z]", text, re.MULTILINE)] == list(VERBS)
    assert not [verb for verb in OLD_VERBS if re.search(rf"^  {verb} ", text, re.MULTILINE)]
