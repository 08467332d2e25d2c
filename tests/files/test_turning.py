"""Files of a device that turns: keys in rad, N.m and kg.m2, read back as written; those of the other motion refused."""

import pytest
from linear_keys import linear_keys

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.model.gains import Gains

KNOB = """
[device]
motion = "rotary"
handle_radius_m = 0.02
inertia_kgm2 = 3e-5
damping_nms_per_rad = 1e-4
delay_samples = 1
coulomb_friction_nm = 0.002
encoder_counts_per_turn = 16384
max_torque_nm = 0.2
[environment]
stiffness_nm_per_rad = 1.0
damping_nms_per_rad = 0.0
[coupling]
structure = "damped"
contact_damping_nms_per_rad = [0.0, 0.05]
[frequency]
values_hz = [1.0, 10.0, 60.0]
[scene]
duration_s = 1.0
"""


def test_keys_of_the_other_motion_are_refused_at_once():
    wrong = KNOB.replace("inertia_kgm2", "mass_kg").replace("stiffness_nm_per_rad", "stiffness_n_per_m")
    with pytest.raises(avc.InputError) as refused:
        avc.parse_problem(wrong.replace("coulomb_friction_nm = 0.002", "coulomb_friction_nm = -1"))
    lines = {fault.key: fault.line for fault in refused.value.faults}
    assert set(lines) == {"device.mass_kg", "environment.stiffness_n_per_m", "device.coulomb_friction_nm"}
    assert lines["device.coulomb_friction_nm"] == 8
    with pytest.raises(avc.InputError) as refused:
        avc.parse_problem(KNOB.replace('motion = "rotary"\nhandle_radius_m = 0.02', ""))
    wrong = {"device.inertia_kgm2", "environment.stiffness_nm_per_rad", "device.encoder_counts_per_turn"}
    assert wrong | {"device.max_torque_nm"} <= {fault.key for fault in refused.value.faults}


def test_a_problem_is_written_and_read_in_its_own_keys():
    problem = avc.parse_problem(KNOB, name="knob")
    text = avc.dump_problem(problem)
    assert linear_keys(text) == []
    assert avc.parse_problem(text, name="knob") == problem


def test_a_coupling_file_comes_back(tmp_path):
    problem = avc.parse_problem(KNOB, name="knob")
    avc.write_coupling(Coupling.constant(problem, Gains(0.0, 1e8, 0.0017), "mine"), tmp_path / "knob.json")
    text = (tmp_path / "knob.json").read_text()
    assert linear_keys(text) == []
    found = avc.read_coupling(tmp_path / "knob.json")
    assert found.problem == problem
    avc.write_coupling(found, tmp_path / "again.json")
    assert (tmp_path / "again.json").read_text() == text


@pytest.mark.parametrize(
    ("kind", "key", "value", "inner"),
    [
        ("noise", "rms_rad", 1e-4, "rms_m"),
        ("encoder", "resolution_rad", 1e-3, "resolution_m"),
        ("backlash", "gap_rad", 2e-3, "gap_m"),
        ("viscous-friction", "damping_nms_per_rad", 1e-3, "damping_ns_per_m"),
    ],
)
def test_keys_of_effects_are_those_of_the_turn(kind, key, value, inner):
    text = KNOB + f'[[scene.effects]]\nkind = "hand"\n[[scene.effects]]\nkind = "{kind}"\n{key} = {value}\n'
    problem = avc.parse_problem(text, name="knob")
    assert getattr(problem.scene.effects[1], inner) == value
    written = avc.dump_problem(problem)
    assert f"{key} = " in written
    assert avc.parse_problem(written, name="knob") == problem
