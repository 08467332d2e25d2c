"""What a file declares beside [simulation] or [follower] is used, or told as not used, of the device that has it."""

import pytest

import avc_casadi as avc
from avc_casadi.recommendation.preconditions import not_used

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
