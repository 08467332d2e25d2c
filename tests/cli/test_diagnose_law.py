"""A log is diagnosed from its own force: a law that the problem states is not used, and the answer says so."""

import numpy as np
import pytest

from avc_casadi.cli import main

DEVICE = "[device]\nmass_kg = 0.1\ndamping_ns_per_m = 0.5\n\n"
LAW = "[law]\nstiffness_n_per_m = 300.0\nintegral_n_per_m_s = 100.0\n"
WALL = "[environment]\nstiffness_n_per_m = 300.0\ndamping_ns_per_m = 0.0\n"


@pytest.mark.parametrize(("rest", "says"), [(LAW, True), (WALL, False), ("", False)])
def test_a_stated_law_is_named_as_not_used(tmp_path, monkeypatch, capsys, rest, says):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "p.toml").write_text(DEVICE + rest, encoding="utf-8")
    time_s = np.arange(2000) * 1e-3
    position_m = 1e-3 * np.exp(-3 * time_s) * np.sin(2 * np.pi * 9 * time_s)
    columns = np.stack([time_s, position_m, -300 * position_m], axis=1)
    np.savetxt(tmp_path / "log.csv", columns, delimiter=",", header="time_s,position_m,force_n", comments="")
    main(["diagnose", "log.csv", "--device", "p.toml"])
    said = " ".join(capsys.readouterr().out.split())
    assert "Verdict" in said
    assert ("law: the force of the log is fitted instead; avc certify judges the stated law" in said) == says
