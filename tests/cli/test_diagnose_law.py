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


def logged(stiffness, damping):
    """Return time, position and force of a released device of 0.12 kg with a law one sample late, from 2 mm."""
    position, velocity, before, rows = 2e-3, 0.0, None, []
    late = [0.0] * 21
    for tick in range(1500):
        read = 2e-6 * np.round(position / 2e-6)
        change = 0.0 if before is None else (read - before) / 1e-3
        before = read
        force = float(np.clip(-stiffness * read - damping * change, -8.0, 8.0))
        rows.append((1e-3 * tick, read, force))
        for _ in range(20):
            late.append(force)
            velocity += (late.pop(0) - 0.8 * velocity) / 0.12 * 5e-5
            position += velocity * 5e-5
    return np.array(rows)


@pytest.mark.slow
def test_a_cause_in_one_log_and_rest_in_another_are_both_decided(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    device = f"{DEVICE.replace('0.1', '0.12').replace('0.5', '0.8')}delay_samples = 1\nencoder_resolution_m = 2e-6\n"
    (tmp_path / "p.toml").write_text(device, encoding="utf-8")
    logs = {"stiff.csv": logged(9000.0, 12.0), "rests.csv": logged(700.0, 8.0)}
    for name, rows in logs.items():
        np.savetxt(tmp_path / name, rows, delimiter=",", header="time_s,position_m,force_n", comments="")

    def code(*names):
        return main(["diagnose", *names, "--device", "p.toml"])

    assert [code("stiff.csv"), code("rests.csv"), code("stiff.csv", "rests.csv")] == [0, 0, 0]
    assert "stiffness" in capsys.readouterr().out
