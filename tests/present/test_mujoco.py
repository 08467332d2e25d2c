"""Welds and contacts of MuJoCo in N/m: what MuJoCo itself measures under a load."""

import numpy as np
import pytest

from avc_casadi.model.mujoco_constraint import MujocoConstraint

WELD = """<mujoco><option gravity="0 0 0" timestep="0.001"/><worldbody><body name="hand" mocap="true"/>
<body name="tool"><freejoint/><geom type="sphere" size="0.02" mass="{mass}" contype="0" conaffinity="0"/></body>
</worldbody><equality><{kind} body1="tool" body2="hand" {place} solref="{solref}" solimp="{solimp}"/></equality>
</mujoco>"""
CONTACT = """<mujoco><option gravity="0 0 0" timestep="0.001" cone="{cone}"/><worldbody>{ground}
<body name="tool" pos="0 0 0.02"><freejoint/><geom type="sphere" size="0.02" mass="{mass}" {given}/></body></worldbody>
</mujoco>"""
GROUNDS = {
    "plane": '<geom type="plane" size="1 1 .1" {given}/>',
    "box": '<geom type="box" size="1 1 .1" pos="0 0 -0.1" {given}/>',
}


def words(numbers):
    return " ".join(map(repr, numbers))


def loaded(mujoco, text, axis, force, steps=8000):
    """The place of the tool in the end, pushed by a force."""
    model = mujoco.MjModel.from_xml_string(text)
    data, tool = mujoco.MjData(model), model.body("tool").id
    data.xfrc_applied[tool, axis] = force
    for _ in range(steps):
        mujoco.mj_step(model, data)
    return float(data.qpos[axis])


@pytest.mark.parametrize("kind", ["weld", "connect"])
@pytest.mark.parametrize(("mass", "stiffness", "damping"), [(0.05, 500.0, 3.0), (0.2, 3000.0, 30.0), (1.0, 1e4, 100.0)])
def test_pressed_weld_gives_the_stiffness_that_was_asked_for(kind, mass, stiffness, damping):
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install 'avc-casadi[model]'")
    for impedance in (0.001, 0.5, 0.9):
        found = MujocoConstraint.of(stiffness, damping, mass, impedance)
        place = 'anchor="0 0 0"' if kind == "connect" else ""
        text = WELD.format(mass=mass, kind=kind, place=place, solref=words(found.solref), solimp=words(found.solimp))
        for load in (0.2, 3.0):
            assert load / loaded(mujoco, text, 0, load) == pytest.approx(stiffness, rel=1e-6)
            assert found.stiffness_n_per_m(mass, load) == pytest.approx(stiffness, rel=1e-9)


@pytest.mark.parametrize(("mass", "stiffness", "damping"), [(0.05, 500.0, 3.0), (0.2, 3000.0, 30.0), (1.0, 1e4, 100.0)])
def test_tool_on_a_soft_weld_swings_as_on_a_spring_and_damper(mass, stiffness, damping):
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install 'avc-casadi[model]'")
    for impedance, heavier in ((0.001, 1.001001), (0.9, 10.0)):
        found = MujocoConstraint.of(stiffness, damping, mass, impedance)
        text = WELD.format(mass=mass, kind="weld", place="", solref=words(found.solref), solimp=words(found.solimp))
        model = mujoco.MjModel.from_xml_string(text)
        data = mujoco.MjData(model)
        data.qpos[0] = 1e-3
        place, speed, swung = 1e-3, 0.0, []
        for _ in range(300):
            mujoco.mj_step(model, data)
            speed -= 1e-3 / (heavier * mass) * (stiffness * place + damping * speed)
            place += 1e-3 * speed
            swung.append(data.qpos[0] - place)
        assert np.abs(swung).max() < 1e-8


@pytest.mark.parametrize("cone", ["pyramidal", "elliptic"])
@pytest.mark.parametrize("ground", GROUNDS)
@pytest.mark.parametrize(
    "constraint",
    [
        MujocoConstraint(),
        MujocoConstraint((0.005, 0.7)),
        MujocoConstraint((-2e5, -900.0)),
        MujocoConstraint((0.02, 1.0), (0.2, 0.9, 0.002, 0.4, 3.0)),
    ],
    ids=["default", "stiffer", "direct", "another impedance"],
)
def test_pressed_contact_has_the_stiffness_that_is_told(cone, ground, constraint):
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install 'avc-casadi[model]'")
    given = f'solref="{words(constraint.solref)}" solimp="{words(constraint.solimp)}"'
    for mass, load in ((0.05, 0.2), (0.2, 2.0), (1.0, 0.2)):
        text = CONTACT.format(cone=cone, ground=GROUNDS[ground].format(given=given), mass=mass, given=given)
        sunk = 0.02 - loaded(mujoco, text, 2, -load)
        assert load / sunk == pytest.approx(constraint.stiffness_n_per_m(mass, load), rel=1e-5)
