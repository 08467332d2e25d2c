"""What people read is made from the document: its numbers, the paper's errors, the limit beside every result."""

import json
import re

import pytest
from walled import has_wall

import avc_casadi as avc
from avc_casadi._util.quantity import quantity
from avc_casadi._util.text import ROWS_SHOWN, sample_rows
from avc_casadi.cli import main
from avc_casadi.paper.errata import PAPER_ERRORS
from avc_casadi.present.pages.scene import scene_page
from avc_casadi.present.terminal import Page
from avc_casadi.recommendation import stiffest as _stiffest

MODE = {"frequency_hz": 150.0, "damping_ratio": 0.05, "mass_ratio": 0.5}
HAND = {"mass_kg": 0.1, "damping_ns_per_m": 5.0, "stiffness_n_per_m": 400.0}


def both(capsys, *arguments):
    """Return all of the text for people and the document of the same command."""
    code = main([*arguments, "-v"])
    text = capsys.readouterr().out
    assert main([*arguments, "--json"]) == code
    return text, json.loads(capsys.readouterr().out)


@pytest.mark.thorough
def test_solve(capsys):
    text, document = both(capsys, "solve", "figure5")
    for row in (0, 199):
        for key in ("frequency_hz", "damping_ns_per_m", "stiffness_n_per_m", "real_part"):
            assert f"{document[key][row]:.4g}" in text
    for level, found in document["certificate"]["levels"].items():
        (line,) = [line for line in text.splitlines() if line.startswith(level)]
        assert ("pass" if found["pass"] else "fail") in line
        assert f"{found['margin_ns_per_m']:.3g}" in line
    assert f"{document['passive_limit_n_per_m'] / 1e3:.2f} kN/m static for any passive" in text
    assert "95 solved" in text
    assert document["counts"]["solved"] == 95


@pytest.mark.thorough
def test_as_printed_tells_every_error_of_the_paper(capsys):
    text, document = both(capsys, "solve", "figure5", "--as-printed")
    assert document["paper_errors"] == [vars(error) for error in PAPER_ERRORS]
    for error in PAPER_ERRORS:
        for part in vars(error).values():
            assert part in text
    assert "paper_errors" not in both(capsys, "solve", "figure5", "--method", "closed-form")[1]


@pytest.mark.thorough
def test_compare(capsys):
    text, document = both(capsys, "compare", "figure5", "--mine", "7000,10")
    counts = {verdict: count for verdict, count in document["counts"].items() if count}
    assert ", ".join(f"{count} {verdict}" for verdict, count in counts.items()) in text.splitlines()[5]
    for verdict in counts:
        assert document["reason"][document["verdict"].index(verdict)] in text
    injection = document["damping_injection"]
    assert f"damper {max(injection['injected_damping_ns_per_m']):.4g} N.s/m" in text
    assert f"{100 * document['mine']['share_schedule_better']:.3g} % of the frequencies" in text
    assert "direct and exact agree" in text


@pytest.mark.thorough
def test_what_rounding_leaves_of_a_scene_is_told_as_nothing():
    problem = avc.load_problem("figure5")
    document = avc.simulate(problem).document() | {
        "effects": [],
        "gains_from_hz": None,
        "notes": [],
        "left_out": [],
        "without_guard": None,
    }
    left = {"position_peak_to_peak_m": 6.9e-19, "energy_generated_j": -2e-17, "force_ripple_n": 3e-15}
    text = scene_page(document | left | {"mean_force_n": 2e-9}, problem, Page(), "figure5", None)
    assert "2.00 nN, 0 m peak to peak" in text
    assert "0 J given out" in text
    assert "0 N rms between 20 and 500 Hz" in text


@pytest.mark.thorough
def test_a_stiffest_wall_that_is_not_found_is_told_with_what_was_assumed(capsys, tmp_path, monkeypatch):
    # The backlash is behind the encoder.
    device = {"delay_samples": 9, "backlash_m": 1e-5, "encoder_at": "handle", "resonance": MODE}
    (tmp_path / "late.toml").write_text(avc.dump_problem(avc.load_problem("ve3").changed(device=device)))
    monkeypatch.setattr(_stiffest, "_best", lambda *_, **__: None)
    monkeypatch.setattr("avc_casadi._util.parallel.processors", lambda: 1)
    text, document = both(capsys, "recommend", str(tmp_path / "late.toml"), "--stiffest", "--hands", "3")
    assert document["stiffest_wall_n_per_m"] is document["by"] is document["confirmed"] is None
    assert "stiffest wall: none was found" in text
    assert len(document["what_would_help"]) == 7
    for one in (document | {"change": "as it is"}, *document["what_would_help"]):
        assert any(re.split(r"  +", line.strip()) == [one["change"], "none"] for line in text.splitlines())
    assert document["assumed"]
    assert document["not_used"]
    for gap in document["assumed"]:
        assert f"assumed: {gap}" in text
    for what in document["not_used"]:
        assert f"not used: {what}" in text


@pytest.mark.thorough
def test_list_and_check(capsys):
    code = main(["list"])
    text = capsys.readouterr().out
    assert main(["list", "--json"]) == code
    document = json.loads(capsys.readouterr().out)
    names = [entry["name"] for entry in document["problems"]]
    assert {"figure5", "soft", "hard/rigid"} <= set(names)
    problems, devices = text.split("\n\n")
    assert [line.split()[0] for line in problems.splitlines()[2:]] == names
    assert [line.split()[0] for line in devices.splitlines()[2:-2]] == [one["name"] for one in document["devices"]]
    for name in names:
        text, document = both(capsys, "check", name)
        assert document["problem"] == name
        if not has_wall(name):
            continue
        turns = document.get("motion") == "rotary"
        limit = document["passive_limit_nm_per_rad" if turns else "passive_limit_n_per_m"]
        unit = "N.m/rad" if turns else "N/m"
        assert ("known for a rigid device" if limit is None else f"{quantity(limit, unit)} static") in text


@pytest.mark.parametrize("rows", [1, 2, 19, 20, 21, 200, 100_000])
def test_condensed_tables_show_both_ends(rows):
    shown = sample_rows(rows)
    assert shown == sorted(set(shown))
    assert (shown[0], shown[-1]) == (0, rows - 1)
    assert len(shown) == min(rows, ROWS_SHOWN)
