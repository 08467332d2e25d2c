"""A table with rows left out says where the device has to interpolate across them."""

import json

import pytest

from avc_casadi.cli import main


@pytest.mark.thorough
@pytest.mark.one_of(2)
@pytest.mark.parametrize(
    ("without", "hole"),
    [((), None), ((0, 1), None), ((2, 4, 5), [40.0, 70.0]), ((6,), None), ((1, 3, 4), [30.0, 60.0])],
)
def test_the_widest_hole_between_rows_with_gains(without, hole, tmp_path, capsys):
    rows = range(7)
    gains = {
        "frequency_hz": [10.0 * (row + 1) for row in rows],
        "damping_ns_per_m": [None if row in without else 1.0 for row in rows],
        "stiffness_n_per_m": [None if row in without else 100.0 for row in rows],
        "sample_time_s": 1e-3,
    }
    path = tmp_path / "gains.json"
    path.write_text(json.dumps(gains))
    push = ["push", str(path), "--problem", "soft", "--port", "emulator"]
    assert main([*push, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["widest_hole_hz"] == hole
    assert main(push) == 0
    said = capsys.readouterr().out
    assert ("interpolated" in said) == (hole is not None)
    if hole is not None:
        assert f"from {hole[0]:.1f} Hz to {hole[1]:.1f} Hz" in said
