"""`avc export --parameters`: the numbers are those of the coupling in each engine's units, and MuJoCo takes them."""

import pytest
from exported_tool import DEVICE, tool_coupling

import avc_casadi as avc
from avc_casadi.model.ends import mujoco_contact_n_per_m
from avc_casadi.present.rows.engines import parameters

TOOL = "tool_mass_kg = 0.2\nstep_s = 0.002\n"
SCALED = f"{TOOL}position_scale = 10.0\nforce_scale = 0.5\n"
K, B = 2000.0, 15.0


def rows(keys, engine, local=0.0, device=DEVICE):
    return parameters(tool_coupling(keys, K, B, local, device), engine).data["parameters"]


def numbers(keys, engine, local=0.0, device=DEVICE):
    """The value of each row by its formula."""
    return {one["formula"]: one["value"] for one in rows(keys, engine, local, device)}


SLIDE = """<mujoco><option gravity="0 0 0" timestep="{step_s}" integrator="{integrator}"/><worldbody><body name="tool">
<joint type="slide" axis="1 0 0" damping="{damping}"/><geom type="sphere" size="0.02" mass="0.2"/></body></worldbody>
</mujoco>"""


@pytest.mark.parametrize(
    ("integrator", "substeps"), [("semi-implicit", 1), ("semi-implicit", 4), ("implicit-damping", 1), ("exact", 1)]
)
@pytest.mark.parametrize("keys", [TOOL, SCALED])
def test_line_of_the_page_is_spring_and_damper_in_mujoco(keys, integrator, substeps):
    """The line is run as it stands: the tool of a device at rest swings as a mass on the spring and the damper."""
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install 'avc-casadi[model]'")
    stated = f'{keys}integrator = "{integrator}"\nsubsteps = {substeps}\n'
    document, told = parameters(tool_coupling(stated, K, B), "mujoco").data, numbers(stated, "mujoco")
    damping = told["B"] if integrator == "implicit-damping" else 0.0
    text = SLIDE.format(integrator=document["integrator"], damping=damping, step_s=told["h/n"])
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    scale = 1.0 if keys is TOOL else 10.0
    k, b = (K, B) if keys is TOOL else (K / 5, B / 5)
    place, speed, t, m = 0.0, 0.0, 0.002 / substeps, 0.2
    for x, v in [(1e-3, 0.0)] * 50 + [(1e-3 + 1e-5 * j, 0.005) for j in range(50)]:
        seen = {"K": told["K"], "B": told["B"], "x": scale * x, "v": scale * v}
        exec(document["law"], {"data": data, "dof": 0, **seen})  # noqa: S102 - the line of our own page
        mujoco.mj_step(model, data, nstep=told["n"])
        pull = k * (scale * x - place) + b * scale * v
        before, held = speed, pull - b * speed
        for _ in range(substeps):
            speed = (m * speed + t * pull) / (m + t * b) if integrator == "implicit-damping" else speed + t / m * held
            place += t * (0.5 * (speed + before) if integrator == "exact" else speed)
        assert data.qpos[0] == pytest.approx(place, abs=1e-7)
    assert abs(place) > 5e-4


@pytest.mark.parametrize(
    ("keys", "engine", "instead"),
    [
        ('integrator = "exact"', "pybullet", 'integrator = "semi-implicit"'),
        ('integrator = "implicit"', "imstk", 'integrator = "semi-implicit"'),
        ("substeps = 2", "unity", "substeps = 1, step_s = 0.001"),
    ],
)
def test_another_loop_of_the_engine_is_refused_with_what_to_say(keys, engine, instead):
    with pytest.raises(avc.InputError, match=instead):
        parameters(tool_coupling(f"{TOOL}{keys}\n", K, B), engine)


# Welds and contacts of MuJoCo in N/m: what MuJoCo itself measures under a load.

MUJOCO_WELD = """<mujoco><option gravity="0 0 0" timestep="0.001"/><worldbody><body name="hand" mocap="true"/>
<body name="tool"><freejoint/><geom type="sphere" size="0.02" mass="{mass}" contype="0" conaffinity="0"/></body>
</worldbody><equality><{kind} body1="tool" body2="hand" {place} solref="{solref}" solimp="{solimp}"/></equality>
</mujoco>"""
CONTACT = """<mujoco><option gravity="0 0 0" timestep="0.001" cone="{cone}"/><worldbody>{ground}
<body name="tool" pos="0 0 0.02"><freejoint/><geom type="sphere" size="0.02" mass="{mass}"/></body></worldbody>
</mujoco>"""
GROUNDS = {
    "plane": '<geom type="plane" size="1 1 .1"/>',
    "box": '<geom type="box" size="1 1 .1" pos="0 0 -0.1"/>',
}


def loaded(mujoco, text, axis, force, steps=8000):
    """The place of the tool in the end, pushed by a force."""
    model = mujoco.MjModel.from_xml_string(text)
    data, tool = mujoco.MjData(model), model.body("tool").id
    data.xfrc_applied[tool, axis] = force
    for _ in range(steps):
        mujoco.mj_step(model, data)
    return float(data.qpos[axis])


@pytest.mark.parametrize("keys", [TOOL, SCALED])
def test_weld_of_the_page_has_the_stiffness_of_the_coupling_in_mujoco(keys):
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install 'avc-casadi[model]'")
    told = numbers(keys, "mujoco")
    solref, solimp = f"{told['-K (1 - d)/m']} {told['-B (1 - d)/m']}", f"{told['d']} {told['d']} 0.001"
    text = MUJOCO_WELD.format(mass=0.2, kind="weld", place="", solref=solref, solimp=solimp)
    assert 1.0 / loaded(mujoco, text, 0, 1.0) == pytest.approx(K if keys is TOOL else K / 5, rel=1e-4)


@pytest.mark.parametrize("cone", ["pyramidal", "elliptic"])
@pytest.mark.parametrize("ground", GROUNDS)
def test_pressed_contact_has_the_stiffness_that_is_told(cone, ground):
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install 'avc-casadi[model]'")
    for mass, load in ((0.05, 0.2), (0.2, 2.0), (1.0, 0.2)):
        text = CONTACT.format(cone=cone, ground=GROUNDS[ground], mass=mass)
        sunk = 0.02 - loaded(mujoco, text, 2, -load)
        assert load / sunk == pytest.approx(mujoco_contact_n_per_m(mass, load), rel=1e-5)
