"""A coupling that was designed for another device: what that changes is said before the verdict."""

import pytest

import avc_casadi as avc
from avc_casadi.cli import main
from avc_casadi.coupling import Coupling
from avc_casadi.files.coupling_file import write_coupling
from avc_casadi.model.ends import ToolGains
from avc_casadi.model.gains import Gains

OF_A_WALL = Coupling.constant(avc.load_problem("figure5").changed(frequency={"points": 10}), Gains(0.0, 1e3, 5.0), "x")
OF_A_TOOL = Coupling.to_end(avc.load_problem("tool/mujoco-500hz"), ToolGains(615.7, 0.2317))


@pytest.mark.parametrize("coupling", [OF_A_WALL, OF_A_TOOL], ids=["wall", "simulation"])
def test_the_first_row_says_that_a_coupling_was_designed_for_another_device(coupling, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_coupling(coupling, "c.json")
    mine = coupling.problem.changed(device={"mass_kg": 1.1 * coupling.problem.device.mass_kg})
    (tmp_path / "mine.toml").write_text(avc.dump_problem(mine), encoding="utf-8")
    main(["certify", "mine.toml", "c.json"])
    rows = capsys.readouterr().out.partition("\n\n")[2]
    assert rows.split()[:2] == ["!", "Note"]
    assert "with a different [device]" in " ".join(rows.partition("Deployable")[0].split())
    main(["certify", "c.json"])
    assert "different [device]" not in capsys.readouterr().out
