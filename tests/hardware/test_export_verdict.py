"""The header of every exported C says for which hands and which margin its verdict is, in the units of the device."""

import pytest
from quick import first

import avc_casadi as avc
from avc_casadi.claims.judged_for import JudgedFor
from avc_casadi.coupling import Coupling
from avc_casadi.files.problem_file import load_any
from avc_casadi.model.ends import ToolGains
from avc_casadi.model.gains import Gains
from avc_casadi.present.rows import engines
from avc_hardware import admittance_files, export_c

LINEAR = {
    "device": {"mass_kg": 0.1, "damping_ns_per_m": 1.0},
    "hands": {"mass_kg": [0.06, 0.25], "damping_ns_per_m": [4.0, 15.0], "stiffness_n_per_m": [0.0, 7000.0]},
}
LINEAR_HANDS = "hands of 60.0 g to 250 g, 4.00 N.s/m to 15.0 N.s/m, 0 N/m to 7.00 kN/m, and released"
ROTARY = {
    "device": {"motion": "rotary", "inertia_kgm2": 5e-3, "damping_nms_per_rad": 0.01, "handle_radius_m": 0.1},
    "hands": {
        "inertia_kgm2": [2e-3, 4e-3],
        "damping_nms_per_rad": [0.05, 0.05],
        "stiffness_nm_per_rad": [0.5, 2.0],
    },
}
ROTARY_HANDS = "hands of 0.00200 kg.m2 to 0.00400 kg.m2, 0.0500 N.m.s/rad, 500 mN.m/rad to 2.00 N.m/rad, and released"
WALL = {"environment": {"stiffness_n_per_m": 500.0, "damping_ns_per_m": 0.0}}
ROTARY_WALL = {"environment": {"stiffness_nm_per_rad": 0.5, "damping_nms_per_rad": 0.0}}
MASSLESS = {"device": {"mass_kg": 0.0, "damping_ns_per_m": 1.0}, "hands": LINEAR["hands"]}


def to_wall(tables):
    return Coupling.constant(load_any(tables), Gains(1.0, 100.0), "x")


def to_end(tables):
    return Coupling.to_end(load_any(LINEAR | tables), ToolGains(100.0, 1.0))


@pytest.mark.parametrize(
    ("exported", "judged_for"),
    [
        (to_wall(LINEAR | WALL), f"{LINEAR_HANDS}, with a disk margin of at least 0.15"),
        (
            to_wall(LINEAR | WALL | {"robustness": {"disk_margin": 0.05}}),
            f"{LINEAR_HANDS}, with a disk margin of at least 0.05",
        ),
        (to_wall(ROTARY | ROTARY_WALL), f"{ROTARY_HANDS}, with a disk margin of at least 0.15"),
        (
            load_any(LINEAR | {"law": {"stiffness_n_per_m": 100.0}}),
            f"{LINEAR_HANDS}, with a disk margin of at least 0.15",
        ),
        (
            to_end({"simulation": {"tool_mass_kg": 0.2, "step_s": 2e-3}}),
            f"{LINEAR_HANDS}, with a gain margin of at least 1.22",
        ),
        pytest.param(
            to_end({"follower": {"mass_kg": 0.3, "damping_ns_per_m": 1.0}, "robustness": {"gain_margin": 1.5}}),
            f"{LINEAR_HANDS}, with a gain margin of at least 1.5",
            marks=pytest.mark.slow,
        ),
    ],
    ids=["wall", "own margin", "rotary", "law", "simulation", "follower"],
)
def test_the_header_says_for_which_hands_and_margin_the_verdict_is(exported, judged_for):
    header = " ".join(export_c(exported, unsafe=True)["avc_coupling.h"].replace("\n * ", " ").split())
    assert f"judged for {judged_for} sample time" in header


@pytest.mark.parametrize(
    ("name", "hands", "contacts"),
    first(
        [
            (
                "admittance/cobot",
                "hands of 500 g to 2.00 kg, 10.0 N.s/m to 40.0 N.s/m, 100 N/m to 1.00 kN/m",
                "contacts of 0 N/m to 5.00 kN/m, 5.00 N.s/m",
            ),
            (
                "admittance/pedal",
                "hands of 500 g to 3.00 kg, 30.0 N.s/m to 150 N.s/m, 500 N/m to 10.0 kN/m",
                "without contact",
            ),
        ]
    ),
)
def test_the_header_of_an_admittance_law_says_for_which_hands_and_contacts_it_is(name, hands, contacts):
    header = " ".join(admittance_files(avc.load_admittance(name))["avc_coupling.h"].replace("\n * ", " ").split())
    margin = "with a disk margin of at least 0.15"
    assert f"judged for {hands}, and released, {contacts}, {margin} sample time" in header


def test_parameters_for_an_engine_say_for_which_hands_they_are():
    coupling = to_end({"simulation": {"tool_mass_kg": 0.2, "step_s": 2e-3}})
    answer = engines.parameters(coupling, "pybullet")
    assert answer.data["judged_for"] == JudgedFor.of_coupling(coupling).document()
    assert f"{LINEAR_HANDS}, with a gain margin of at least 1.22" in " ".join(str(answer).split())


def test_a_massless_device_has_no_disk_margin_and_no_c():
    massless = to_wall(MASSLESS | WALL)
    assert JudgedFor.of_coupling(massless).sentence == LINEAR_HANDS
    with pytest.raises(avc.UnsupportedError, match="mass_kg is 0"):
        export_c(massless, unsafe=True)
