"""What a file declares beside [simulation] or [follower] is used, or told as not used, of the device that has it."""

import json

import pytest

import avc_casadi as avc
from avc_casadi.cli import main
from avc_casadi.recommendation.preconditions import assumed, not_used

DEVICE = "[device]\nmass_kg = 0.12\ndamping_ns_per_m = 0.8\n"
TOOL = "[simulation]\ntool_mass_kg = 0.2\nstep_s = 0.002\n"
PLACE = "[simulation]\nstep_s = 0.002\n"
FOLLOWER = "[follower]\nmass_kg = 0.3\ndamping_ns_per_m = 1.0\n"
WALL = "[environment]\nstiffness_n_per_m = 5e3\ndamping_ns_per_m = 1.0\n"
WHEEL = "[device]\nmotion = 'rotary'\nhandle_radius_m = 0.1\ninertia_kgm2 = 0.01\ndamping_nms_per_rad = 0.01\n"
RANGED = "[device.range]\ncoulomb_friction_n = [0.0, 0.5]\n"


def unused(text):
    return [line.partition(" (")[0] for line in not_used(avc.parse_problem(text))]


@pytest.mark.parametrize("end", [TOOL, PLACE, FOLLOWER])
@pytest.mark.parametrize("period", ["", "sample_time_s = 0.002\n", "sample_time_s = 0.0015\n"])
@pytest.mark.parametrize("device", [DEVICE, WHEEL])
def test_nothing_is_told_as_unused_where_nothing_is_declared_beside(device, end, period):
    """The band of frequencies ends lower by itself where the device is slow."""
    linear = device == DEVICE
    words = {"_kg =": "_kgm2 =", "tool_mass": "tool_inertia", "\nmass": "\ninertia", "_ns_per_m": "_nms_per_rad"}
    for one, other in () if linear else words.items():
        end = end.replace(one, other)
    if not linear and "[follower]" in end:
        end += "motion = 'rotary'\nhandle_radius_m = 0.1\n"
    stated = avc.parse_problem(device + period + end)
    assert not not_used(stated)
    # A table that is written with its default says nothing.
    assert not not_used(stated.changed(robustness={}, coupling={"structure": "series"}))


@pytest.mark.parametrize("end", [TOOL, FOLLOWER])
@pytest.mark.parametrize(
    ("text", "names"),
    [
        (WALL, ["environment"]),
        (WALL + "[boundaries.upper]\nstiffness_n_per_m = 6e3\ndamping_ns_per_m = 1.0\n[boundaries.lower]\n"
         "stiffness_n_per_m = 4e3\ndamping_ns_per_m = 1.0\n", ["environment", "boundaries"]),
        ("[coupling]\nstiffness_n_per_m = [0.0, 3e3]\n", ["coupling"]),
        ("[stability]\nmodel = 'sampled-data'\n", ["stability"]),
        ("[realism]\njnd = 0.05\n", ["realism"]),
        ("[schedule]\nslope_penalty = 0.1\n", ["schedule"]),
        ("[robustness]\nmass_share = 0.3\n", ["robustness"]),
        ("[frequency]\npoints = 10\n", ["frequency"]),
        ("[scene]\nduration_s = 1.0\n", ["scene"]),
        ("[hands]\nmass_kg = [0.1, 0.2]\n", []),
    ],
)  # fmt: skip
def test_tables_of_a_wall_are_told(text, names, end):
    assert unused(DEVICE + end + text) == names


@pytest.mark.parametrize(
    ("text", "names"),
    [
        (TOOL + "contact_damping_ns_per_m = 2.0", ["simulation.contact_damping_ns_per_m"]),
        (TOOL + "contact_damping_ns_per_m = 2.0\ncontact_stiffness_n_per_m = [0.0, 1e3]", []),
        (TOOL + "contact_damping_ns_per_m = 2.0\ncontact_stiffness_n_per_m = [1e3, inf]", []),
        (TOOL + "tool_damping_ns_per_m = 2.0\nintegrator = 'explicit'", []),
        (PLACE + "tool_damping_ns_per_m = 2.0", ["simulation.tool_damping_ns_per_m"]),
        (PLACE + "integrator = 'implicit'", ["simulation.integrator"]),
        (PLACE + "contact_stiffness_n_per_m = [0.0, 1e3]", ["simulation.contact_stiffness_n_per_m"]),
        (PLACE + "exchange = 'late'", []),
        (FOLLOWER + "coulomb_friction_n = 0.5\nencoder_resolution_m = 1e-4", ["follower.coulomb_friction_n"]),
        (FOLLOWER + "backlash_m = 1e-4\n[follower.range]\nposition_noise_rms_m = [0.0, 1e-5]",
         ["follower.position_noise_rms_m", "follower.backlash_m"]),
        (FOLLOWER + RANGED, ["device.coulomb_friction_n"]),
    ],
)  # fmt: skip
def test_keys_without_effect_beside_others_are_told(text, names):
    assert unused(DEVICE + text) == names


def test_assumptions_say_of_which_device_they_are():
    text = FOLLOWER + "encoder_resolution_m = 1e-4\nmax_force_n = 5.0\n[follower.range]\nmass_kg = [0.2, 0.4]\n"
    told = assumed(avc.parse_problem(DEVICE + text))
    of_encoder = [line for line in told if "encoder" in line]
    assert len(of_encoder) == 1
    assert of_encoder[0].startswith("leader: no encoder resolution is declared")
    assert not any("dry friction is declared" in line for line in told)
    assert "follower.range.mass_kg: linear stability at its corners, trial at nominal" in told
    one = assumed(avc.parse_problem(DEVICE + TOOL))
    assert any(line.startswith("no encoder resolution is declared") for line in one)
    assert any(line.startswith("no dry friction is declared") for line in one)
    # A range that begins at none is declared.
    assert not any("no dry friction is declared" in line for line in assumed(avc.parse_problem(DEVICE + RANGED + TOOL)))


def test_pages_name_what_is_not_used(tmp_path, capsys):
    file, coupling = tmp_path / "p.toml", tmp_path / "c.json"
    file.write_text(DEVICE + TOOL + "[coupling]\nstiffness_n_per_m = [0.0, 10.0]\n")
    for words in (["check", file], ["recommend", file, "--hands", "8", "--out", coupling], ["certify", coupling]):
        assert main([str(word) for word in words]) == 0
        page = " ".join(capsys.readouterr().out.split())
        assert "Not used coupling: of a wall in the device's own loop" in page
        main([*map(str, words), "--json"])
        assert len(json.loads(capsys.readouterr().out)["not_used"]) == 1
    assert main(["zwidth", str(file), "--method", "direct"]) == 2
    assert "--method" in capsys.readouterr().err


def test_check_shows_follower_link_and_architecture_and_zwidth_answers_no_leader_at_a_wall(tmp_path, capsys):
    file = tmp_path / "p.toml"
    file.write_text(
        DEVICE + FOLLOWER + "delay_s = [0.005, 0.01]\nlost_share = 0.02\narchitecture = 'position-force'\n"
        "force = 'measured'\ncontact_stiffness_n_per_m = [0.0, 1e3]\nposition_scale = 2.0\nforce_scale = 0.5\n"
    )
    assert main(["check", str(file)]) == 0
    page = " ".join(capsys.readouterr().out.split())
    assert "Follower 300 g, 1.00 N.s/m, 1.00 kHz, delay 0" in page
    assert "Link 5.00 ms to 10.0 ms there, 5.00 ms to 10.0 ms back; 0 % of jitter, 2 % of the messages lost" in page
    assert "Architecture position-force, a measured force is sent back" in page
    assert "Touches nothing, up to a spring of 1.00 kN/m" in page
    assert "Scales 2 m and 2 N for one of the leader" in page
    assert main(["check", str(file), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["follower"]["architecture"] == "position-force"
    assert main(["zwidth", str(file)]) == 2
    assert "couples to a [follower] and has no wall" in capsys.readouterr().err
    for end in (TOOL, FOLLOWER):
        with pytest.raises(avc.UnsupportedError, match="has no wall"):
            avc.zwidth(avc.parse_problem(DEVICE + end))
