"""The known limits of the field, reached from the command line."""

import json

import pytest

from avc_casadi.cli import main


def answer(capsys, *arguments):
    code = main([*arguments, "--json"])
    return code, json.loads(capsys.readouterr().out)


@pytest.mark.thorough
def test_zwidth_gives_the_known_values(capsys, tmp_path):
    plot = tmp_path / "z.png"
    code, document = answer(capsys, "zwidth", "figure5", "--method", "exact", "--plot", str(plot))
    assert code == 0
    assert plot.read_bytes().startswith(b"\x89PNG")
    table = document["llewellyn"]
    printed = dict(zip(table["damping_ratio"], table["paper_kc_t_over_b_d"], strict=True))
    assert printed[0.0] == pytest.approx(8.0, rel=1e-9)
    assert [printed[ratio] for ratio in (1.0, 1.175, 4.0, 7.0)] == pytest.approx(
        [9.330, 9.3505, 6.804, 1.922], abs=6e-4
    )
    assert printed[8.0] == pytest.approx(0.0, abs=1e-6)
    device = dict(zip(table["damping_ratio"], table["sampled_data_kc_t_over_b_d"], strict=True))
    assert [device[ratio] for ratio in (0.0, 0.5, 1.0)] == pytest.approx([2.0, 1.0, 0.0], abs=1e-9)
    assert device[1.5] is None
    assert document["passive_limit_n_per_m"] == pytest.approx(4000.0)
    assert document["encoder_limit_n_per_m"] == pytest.approx(2e5)
    assert document["curves"]["passive-sampled-data"]["stiffness_n_per_m"][0] == pytest.approx(4000.0)
    rows = {(row["condition"], row["model"]): row for row in document["static"]}
    assert rows["llewellyn", "sampled-data"]["stiffness_n_per_m"] == pytest.approx(4000.0)
    assert len(document["gains"]["wall_stiffness_n_per_m"]) == len(document["gains"]["frequency_hz"]) == 200


@pytest.mark.thorough
def test_zwidth_of_a_device_without_damping(capsys):
    code, document = answer(capsys, "zwidth", "hard/undamped-device", "--method", "exact")
    assert code == 0
    assert document["llewellyn"] is None
    assert document["static"] == []
    assert document["passive_limit_n_per_m"] == 0.0


def test_static_without_device_damping_is_refused(capsys):
    code, document = answer(capsys, "solve", "hard/undamped-device", "--method", "static")
    assert code == 2
    assert "device.damping_ns_per_m > 0" in document["errors"][0]["message"]
