"""`avc run` writes every file, the same each time apart from times, and needs no extra to finish."""

import pytest
from avc_process import command, strict_json

from avc_casadi import deployable, dump_problem, load_problem
from avc_casadi.cli import main
from avc_casadi.files.coupling_file import read_coupling

# A wall that a contact damper holds, so that the coupling to deploy is found at once.
HELD_PLAINLY = {"stiffness_n_per_m": 5e4}


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    done = command("run", "figure5", cwd=folder)
    again = command("run", "figure5", "--out", "again", "--json", cwd=folder)
    return folder, done, again


@pytest.mark.slow
def test_the_device_gets_the_recommended_coupling(results):
    folder, _, again = results
    document = strict_json(again.stdout)
    coupling = read_coupling(folder / "again" / "coupling.json")
    assert deployable(coupling).passed
    assert document["deploy"]["coupling"]["id"] == document["push"]["coupling_id"] == coupling.id
    assert document["push"]["in_the_loop"]["at_rest"] is True
    assert document["push"]["in_the_loop"]["coupling_id"] == coupling.id


@pytest.mark.slow
def test_a_method_that_is_not_deployable_is_not_pushed_unless_asked(tmp_path):
    few = load_problem("figure5").changed(frequency={"points": 12}, environment=HELD_PLAINLY)
    (tmp_path / "few.toml").write_text(dump_problem(few))
    done = command("run", "few.toml", "--method", "direct", cwd=tmp_path)
    assert done.returncode == 1
    done = command("run", "few.toml", "--method", "direct", "--unsafe", "--json", cwd=tmp_path)
    assert strict_json(done.stdout)["push"]["table_id"] > 0


@pytest.mark.slow
def test_what_is_refused_beforehand_is_neither_pushed_nor_written(tmp_path):
    """Every press of these hands ends at the limit of 1.2 N, though the loop is linearly stable with all of them."""
    file, folder = tmp_path / "finger.toml", tmp_path / "out"
    device = "mass_kg = 0.018\ndamping_ns_per_m = 0.05\nmax_force_n = 1.2"
    few = "[frequency]\npoints = 5\n"
    file.write_text(f"[device]\n{device}\n[environment]\nstiffness_n_per_m = 600.0\ndamping_ns_per_m = 0.0\n{few}")
    main(["run", str(file), "--out", str(folder)])
    assert not (folder / "coupling.json").exists()


@pytest.mark.slow
def test_where_nothing_is_recommended_a_method_writes_a_coupling_on_request(tmp_path):
    late = load_problem("figure5").changed(frequency={"points": 4}, device={"delay_samples": 40})
    (tmp_path / "late.toml").write_text(dump_problem(late))
    done = command("run", "late.toml", "--unsafe", "--out", "none", cwd=tmp_path)
    assert done.returncode == 1
    assert b"--method NAME" in done.stderr
    assert not (tmp_path / "none" / "coupling.json").exists()
    done = command("run", "late.toml", "--unsafe", "--method", "direct", "--out", "direct", cwd=tmp_path)
    assert (tmp_path / "direct" / "coupling.json").exists()
