"""`avc run` writes every file, the same each time apart from times, and needs no extra to finish."""

import json
from pathlib import Path

import numpy as np
import pytest
from avc_process import avc, strict_json

from avc_casadi import deployable, dump_problem, load_problem, solve
from avc_casadi.cli import main
from avc_casadi.files.coupling_file import read_coupling, read_file

FILES = {
    "coupling.json",
    "gains.json",
    "gains.csv",
    "compare.json",
    "report.html",
    *(f"{name}{ending}" for name in ("perceived", "comparison", "rendered", "loop") for ending in (".png", ".svg")),
}

# A wall that a contact damper holds, so that the coupling to deploy is found at once.
HELD_PLAINLY = {"stiffness_n_per_m": 5e4}


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    done = avc("run", "figure5", cwd=folder)
    again = avc("run", "figure5", "--out", "again", "--json", cwd=folder)
    return folder, done, again


@pytest.mark.thorough
def test_the_device_gets_the_recommended_coupling(results):
    folder, _, again = results
    document = strict_json(again.stdout)
    coupling = read_coupling(folder / "again" / "coupling.json")
    assert deployable(coupling).passed
    assert document["deploy"]["coupling"]["id"] == document["push"]["coupling_id"] == coupling.id
    assert document["push"]["in_the_loop"]["at_rest"] is True
    assert document["push"]["in_the_loop"]["coupling_id"] == coupling.id


@pytest.mark.thorough
def test_a_method_that_is_not_deployable_is_not_pushed_unless_asked(tmp_path):
    few = load_problem("figure5").changed(frequency={"points": 12}, environment=HELD_PLAINLY)
    (tmp_path / "few.toml").write_text(dump_problem(few))
    done = avc("run", "few.toml", "--method", "direct", cwd=tmp_path)
    assert done.returncode == 1
    done = avc("run", "few.toml", "--method", "direct", "--unsafe", "--json", cwd=tmp_path)
    assert strict_json(done.stdout)["push"]["readback_equal"] is True


@pytest.mark.thorough
def test_document(results):
    folder, _, again = results
    document = strict_json(again.stdout)
    assert set(document["files"]) == FILES == {path.name for path in (folder / "again").iterdir()}
    assert document["push"]["readback_equal"] is True
    assert document["rows_with_gains"] == 200
    assert document["passive_limit_n_per_m"] == pytest.approx(2 * 2.0 / 1e-3)


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["gains.csv", *sorted(name for name in FILES if name.endswith((".png", ".svg")))])
def test_files_repeat_byte_for_byte(results, name):
    folder = results[0]
    assert (folder / "avc-figure5" / name).read_bytes() == (folder / "again" / name).read_bytes()


def without_seconds(value):
    if isinstance(value, dict):
        return {key: without_seconds(item) for key, item in value.items() if key != "seconds"}
    return [without_seconds(item) for item in value] if isinstance(value, list) else value


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["gains.json", "compare.json"])
def test_documents_repeat_apart_from_times(results, name):
    first, second = (
        without_seconds(json.loads((results[0] / run / name).read_text())) for run in ("avc-figure5", "again")
    )
    assert first == second


@pytest.mark.thorough
def test_gain_files_hold_the_direct_gains(results):
    expected = solve(load_problem("figure5"), "direct")
    for name in ("gains.json", "gains.csv"):
        gains = read_file(results[0] / "avc-figure5" / name)
        np.testing.assert_array_equal(gains.frequency_hz, expected.frequency_hz)
        np.testing.assert_array_equal(gains.damping_ns_per_m, expected.damping_ns_per_m)
        np.testing.assert_array_equal(gains.stiffness_n_per_m, expected.stiffness_n_per_m)
    document = json.loads((results[0] / "avc-figure5" / "gains.json").read_text())
    assert set(document["certificate"]["levels"]) >= {"L0", "L1", "L2", "L3", "L4", "L5"}


@pytest.mark.thorough
@pytest.mark.one_of(2)
@pytest.mark.parametrize("scope", ["hands", "all"])
def test_the_gains_of_the_problems_own_scope_are_those_drawn_and_told(scope, tmp_path):
    problem = load_problem("figure5")
    stability = {"scope": scope, "model": "sampled-data"}
    changed = problem.changed(stability=stability, frequency={"points": 12}, environment=HELD_PLAINLY)
    (tmp_path / "wide.toml").write_text(dump_problem(changed))
    assert avc("run", "wide.toml", cwd=tmp_path).returncode == 0
    name = f"schedule, scope {scope}"
    folder = tmp_path / "avc-wide"
    compare = json.loads((folder / "compare.json").read_text())
    delivered = json.loads((folder / "gains.json").read_text())
    assert (compare["scope"], compare["problem_scope"], compare["delivered"]) == ("pointwise", scope, name)
    drawn = compare["methods"][name]
    for key in ("damping_ns_per_m", "stiffness_n_per_m", "impedance_re"):
        assert drawn[key] == delivered[key]
        assert drawn[key] != compare["methods"]["direct"][key]
    assert drawn["certificate"] == delivered["certificate"]


WITHOUT_EXTRA = """
import sys
sys.modules["unicorn"] = None
from avc_casadi.cli import main
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.thorough
def test_without_the_extra_the_push_is_skipped(tmp_path):
    done = avc("run", "soft", "--json", cwd=tmp_path, program=WITHOUT_EXTRA)
    assert done.returncode == 0
    assert "avc-casadi[emulator]" in strict_json(done.stdout)["push"]["skipped"]
    done = avc("push", str(tmp_path / "avc-soft" / "coupling.json"), "--port", "emulator", program=WITHOUT_EXTRA)
    assert done.returncode == 2
    assert b"Traceback" not in done.stderr


@pytest.mark.thorough
def test_infeasible_problem_still_leaves_everything_and_says_no(tmp_path):
    done = avc("run", "hard/infeasible-box", cwd=tmp_path)
    assert done.returncode == 1
    assert {path.name for path in (tmp_path / "avc-hard-infeasible-box").iterdir()} == FILES
    assert Path(tmp_path / "avc-hard-infeasible-box" / "gains.csv").read_text().count("\n") == 1


@pytest.mark.thorough
@pytest.mark.parametrize("unsafe", [False, True])
def test_what_the_trials_refuse_is_neither_pushed_nor_written_unless_asked_for(unsafe, tmp_path):
    """Every press of these hands ends at the limit of 1.2 N, though the loop is linearly stable with all of them."""
    file, folder = tmp_path / "finger.toml", tmp_path / "out"
    device = "mass_kg = 0.018\ndamping_ns_per_m = 0.05\nmax_force_n = 1.2"
    few = "[frequency]\npoints = 5\n"
    file.write_text(f"[device]\n{device}\n[environment]\nstiffness_n_per_m = 600.0\ndamping_ns_per_m = 0.0\n{few}")
    main(["run", str(file), "--out", str(folder), *["--unsafe"] * unsafe])
    assert (folder / "coupling.json").exists() == unsafe


@pytest.mark.thorough
def test_a_folder_that_cannot_be_written_is_found_before_the_work(tmp_path, monkeypatch, capsys):
    def worked(*_):
        raise AssertionError("the work began")

    monkeypatch.setattr("avc_casadi.cli.design._recommended", worked)
    (tmp_path / "file").write_text("")
    for folder in ("", "/sys/avc", "/sys", str(tmp_path / "file"), "\0", str(tmp_path / "report.html")):
        assert main(["run", "soft", "--json", "--out", folder]) == 2
        (error,) = json.loads(capsys.readouterr().out)["errors"]
        assert error["key"] == "--out"


@pytest.mark.thorough
def test_a_run_that_ends_early_leaves_the_files_before_it(tmp_path, monkeypatch):
    def stop(*_, **__):
        raise KeyboardInterrupt

    (tmp_path / "gains.json").write_text("of the run before")
    monkeypatch.setattr("avc_casadi.cli.design._pushed", stop)
    assert main(["run", "soft", "--out", str(tmp_path)]) == 130
    assert [path.name for path in tmp_path.iterdir()] == ["gains.json"]
    assert (tmp_path / "gains.json").read_text() == "of the run before"
