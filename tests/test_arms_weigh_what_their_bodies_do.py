"""Arms against other derivations: bodies summed in 30 digits, energy that is conserved, MuJoCo, published masses."""

import subprocess
import sys
from pathlib import Path

import mpmath
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import avc_casadi as avc
from avc_casadi.arm.arm import evaluated
from avc_casadi.arm.effective_mass import (
    effective_masses,
    mass_range,
    mobility,
    one_normal,
    operational_inertia,
    reached,
)
from avc_casadi.arm.mechanisms import arm
from avc_casadi.files.arm_file import load_arm
from avc_casadi.files.catalogue import arm_names

PREMIUM, PANTOGRAPH = arm("phantom-premium-1.5"), arm("pantograph")
ANGLES = st.tuples(*[st.floats(-0.6, 0.6)] * 3)
GANTRY = """home = [0.0, 0.1, 0.2]
[device]
damping_ns_per_m = 2.0
[workspace]
low_m = [-0.05, -0.05, -0.05]
high_m = [0.05, 0.05, 0.05]
[model]
file = "{file}"
tip = "{tip}"
"""


def kinetic(bodies, q, v):
    """Kinetic energy by central differences in 30 digits; bodies: mass, inertia, pose (centre, rotation) of q."""
    with mpmath.workdps(30):
        step, total = mpmath.mpf("1e-12"), mpmath.mpf(0)
        q, v = [mpmath.mpf(float(one)) for one in q], [mpmath.mpf(float(one)) for one in v]
        ends = [[a + sign * step * b for a, b in zip(q, v, strict=True)] for sign in (1, -1)]
        for mass, inertia, pose in bodies:
            (x1, r1), (x0, r0), (_, here) = pose(ends[0]), pose(ends[1]), pose(q)
            speed = (x1 - x0) / (2 * step)
            turn = (r1 - r0) / (2 * step) * here.T
            omega = here.T * mpmath.matrix([turn[2, 1], turn[0, 2], turn[1, 0]])
            total += mass * (speed.T * speed)[0] / 2
            total += sum(i * w**2 for i, w in zip(inertia, omega, strict=True)) / 2
        return float(total)


def about_z(angle):
    c, s = mpmath.cos(angle), mpmath.sin(angle)
    return mpmath.matrix([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def phantom_bodies(links):
    """The bodies of Cavusoglu, Feygin and Tendick; in their plane, radial and up, x of each body leaves the plane."""
    l1, l2, l3 = links.upper_length_m, links.forearm_length_m, links.parallel_length_m

    def body(place, angle):
        def pose(q):
            r, up = place(q)
            c, s = mpmath.cos(angle(q)), mpmath.sin(angle(q))
            # Columns: the body's x across the plane, z along the radius and y up at angle 0.
            own = mpmath.matrix([[0, -s, c], [-1, 0, 0], [0, c, s]])
            return about_z(q[0]) * mpmath.matrix([r, 0, up]), about_z(q[0]) * own

        return pose

    def forearm(q):
        return (l1 * mpmath.cos(q[1]) + l2 / 2 * mpmath.sin(q[2]), l1 * mpmath.sin(q[1]) - l2 / 2 * mpmath.cos(q[2]))

    def parallel(q):
        return (l1 / 2 * mpmath.cos(q[1]) + l3 * mpmath.sin(q[2]), l1 / 2 * mpmath.sin(q[1]) - l3 * mpmath.cos(q[2]))

    def base(q):
        return mpmath.matrix([0, 0, 0]), about_z(q[0])

    def still(_):
        return (0, 0)

    return [
        (links.forearm_mass_kg, links.forearm_inertia_kgm2, body(forearm, lambda q: q[2])),
        (links.parallel_mass_kg, links.parallel_inertia_kgm2, body(parallel, lambda q: q[1])),
        (0.0, links.upper_inertia_kgm2, body(still, lambda q: q[1])),
        (0.0, links.back_inertia_kgm2, body(still, lambda q: q[2])),
        (0.0, (0.0, 0.0, links.base_inertia_kgm2), base),
    ]


def five_bar_bodies(links):
    a, b = mpmath.mpf(links.proximal_length_m), mpmath.mpf(links.distal_length_m)
    half = mpmath.mpf(links.base_distance_m) / 2

    def elbow(q, side):
        return mpmath.matrix([(2 * side - 1) * half + a * mpmath.cos(q[side]), a * mpmath.sin(q[side]), 0])

    def tip(q):
        """Both distal links have length b: two circles, solved by Newton."""
        ends = [elbow(q, side) for side in (0, 1)]
        start = [(ends[0][0] + ends[1][0]) / 2, (ends[0][1] + ends[1][1]) / 2 + b]
        found = mpmath.findroot(
            lambda x, y: [(x - end[0]) ** 2 + (y - end[1]) ** 2 - b**2 for end in ends], start, tol=1e-50
        )
        return mpmath.matrix([found[0], found[1], 0])

    def proximal(side):
        centre = mpmath.mpf(links.proximal_centre_m)
        base = mpmath.matrix([(2 * side - 1) * half, 0, 0])
        return lambda q: (base + about_z(q[side]) * mpmath.matrix([centre, 0, 0]), about_z(q[side]))

    def distal(side):
        def pose(q):
            way = tip(q) - elbow(q, side)
            angle = mpmath.atan2(way[1], way[0])
            return elbow(q, side) + way * (mpmath.mpf(links.distal_centre_m) / b), about_z(angle)

        return pose

    found = [(links.tip_mass_kg, (0, 0, 0), lambda q: (tip(q), about_z(0)))]
    for side in (0, 1):
        turning = links.proximal_inertia_kgm2 + links.motor_inertia_kgm2
        found.append((links.proximal_mass_kg, (0, 0, turning), proximal(side)))
        found.append((links.distal_mass_kg, (0, 0, links.distal_inertia_kgm2), distal(side)))
    return found


def energy(made, q, v):
    return float(v @ evaluated(made.inertia, np.array([q]))[0] @ v / 2)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(
    ("made", "bodies"),
    [(PREMIUM, phantom_bodies(PREMIUM.file.phantom)), (PANTOGRAPH, five_bar_bodies(PANTOGRAPH.file.five_bar))],
    ids=["phantom", "five-bar"],
)
def test_inertia_is_that_of_the_bodies(made, bodies, seed):
    random = np.random.default_rng(seed)
    q, v = made.home + random.uniform(-0.3, 0.3, made.joints), random.standard_normal(made.joints)
    assert energy(made, q, v) == pytest.approx(kinetic(bodies, q, v), rel=1e-12)


@pytest.mark.parametrize("made", [PREMIUM, PANTOGRAPH], ids=["phantom", "five-bar"])
def test_energy_stays_where_nothing_pushes(made):
    q, v = made.home + 0.1, np.linspace(1.0, -2.0, made.joints)
    before, step, none = energy(made, q, v), 1e-4, np.zeros(made.joints)

    def rate(state):
        where, speed = np.split(state, 2)
        return np.concatenate([speed, np.array(made.acceleration(where, speed, none)).ravel()])

    state = np.concatenate([q, v])
    for _ in range(400):
        k1 = rate(state)
        k2 = rate(state + step / 2 * k1)
        k3 = rate(state + step / 2 * k2)
        state = state + step / 6 * (k1 + 2 * k2 + 2 * k3 + rate(state + step * k3))
    assert np.abs(state[: made.joints] - q).max() > 0.02
    assert energy(made, *np.split(state, 2)) == pytest.approx(before, rel=1e-9)


@pytest.mark.thorough
def test_published_masses_of_the_premium():
    here = mobility(PREMIUM, PREMIUM.home[None])
    np.testing.assert_allclose(1e3 * np.diag(operational_inertia(here)[0]), [32, 77, 53], atol=0.8)
    found = mass_range(PREMIUM)
    assert (round(1e3 * found.lightest_kg), round(1e3 * found.heaviest_kg)) == (27, 180)


@given(ANGLES, st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda n: max(map(abs, n)) > 0.1))
def test_held_tangent_is_never_lighter_than_free(angles, normal):
    n = np.array(normal) / np.linalg.norm(normal)
    inverse = mobility(PREMIUM, np.array([angles]))
    free, held = effective_masses(inverse, n[None])[0, 0]
    # Let the normal move by a unit: the tangent follows so that the energy is least, or stays.
    inertia = np.linalg.inv(inverse[0])
    tangent = np.linalg.svd(n[None])[2][1:]
    follows = n - tangent.T @ np.linalg.solve(tangent @ inertia @ tangent.T, tangent @ inertia @ n)
    assert free == pytest.approx(follows @ inertia @ follows, rel=1e-9)
    assert held == pytest.approx(n @ inertia @ n, rel=1e-9)
    assert free <= held * (1 + 1e-12)


@pytest.mark.thorough
@given(st.tuples(*[st.floats(0, 1)] * 3))
def test_points_of_the_workspace_are_reached_or_said_not_to_be(shares):
    low, high = PREMIUM.box_m
    point = low + (high - low) * np.array(shares)
    joints, found = reached(PREMIUM, point[None])
    # The two links and the angle between them make a triangle, whatever the base does.
    links = load_arm("phantom-premium-1.5").phantom
    upper, fore = links.upper_length_m, links.forearm_length_m
    sine = (upper**2 + fore**2 - point @ point) / (2 * upper * fore)
    least, most = np.sin(np.radians(links.angle_between_deg))
    assume(min(abs(sine - least), abs(sine - most)) > 1e-6)
    assert found[0] == (least < sine < most)
    if found[0]:
        assert np.abs(evaluated(PREMIUM.tip, joints)[0, :, 0] - point).max() < 1e-8
        assert np.sin(joints[0, 1] - joints[0, 2]) == pytest.approx(sine, abs=1e-6)


def test_urdf_is_the_closed_form_of_the_gantry():
    made, stages = arm("gantry-urdf"), load_arm("gantry").gantry.stage_mass_kg
    poses = np.random.default_rng(0).uniform(-0.05, 0.05, (20, 3))
    carried = np.diag(np.cumsum(stages[::-1])[::-1])
    assert np.abs(evaluated(made.inertia, poses) - carried).max() < 1e-10
    assert np.abs(evaluated(made.jacobian, poses) - np.eye(3)).max() < 1e-10
    assert np.abs(evaluated(made.tip, poses)[..., 0] - poses - [0, 0, 0.12]).max() < 1e-10
    assert np.abs(operational_inertia(mobility(made, poses)) - carried).max() < 1e-10


BODIES = """<mujoco><compiler inertiafromgeom="false"/><worldbody>
<body name="a" pos="0 0 0.1"><joint name="ja" type="slide" axis="1 0 0" armature="0.01"/>
<inertial pos="0 0 0" mass="0.5" diaginertia="1e-3 1e-3 1e-3"/>
<body name="b" pos="0.1 0 0" euler="20 0 10"><joint name="jb" type="hinge" axis="0 1 0" armature="1e-4"/>
<inertial pos="0.1 0 0.02" quat="0.9 0.1 0.2 0" mass="0.3" diaginertia="1e-3 2e-3 1.5e-3"/>
<body name="c" pos="0 0.2 0.1"><joint name="jc" type="hinge" axis="0 0 1"{extra}/>
{inertial}</body></body></body></worldbody></mujoco>"""
INERTIAL = """<inertial pos="0.05 0 0" mass="0.1" diaginertia="1e-3 1e-3 1e-3"/>
<body name="tip" pos="0.05 0.03 0"><inertial pos="0 0 0" mass="0.02" diaginertia="1e-5 1e-5 1e-5"/></body>"""


def written(folder, text, tip, ending):
    (folder / f"model.{ending}").write_text(text)
    (folder / "arm.toml").write_text(GANTRY.format(file=f"model.{ending}", tip=tip))
    return folder / "arm.toml"


def test_mjcf_moves_as_in_mujoco(tmp_path):
    mujoco = pytest.importorskip("mujoco")
    text = BODIES.format(extra="", inertial=INERTIAL)
    made = arm(written(tmp_path, text, "tip", "xml"))
    model = mujoco.MjModel.from_xml_string(text)
    data, random = mujoco.MjData(model), np.random.default_rng(1)
    for _ in range(5):
        q, push = random.uniform(-1, 1, 3), random.standard_normal(3)
        data.qpos[:], data.qvel[:], data.qfrc_applied[:] = q, 0.0, push
        model.opt.gravity[:] = 0.0
        mujoco.mj_forward(model, data)
        there = evaluated(made.tip, q[None])[0, :, 0]
        np.testing.assert_allclose(there, data.body("tip").xpos, atol=1e-10)
        np.testing.assert_allclose(evaluated(made.inertia, q[None])[0] @ data.qacc, push, atol=1e-10)
        moved = np.zeros((3, 3))
        mujoco.mj_jacBody(model, data, moved, None, model.body("tip").id)
        np.testing.assert_allclose(evaluated(made.jacobian, q[None])[0], moved, atol=1e-10)


@pytest.mark.parametrize(
    ("text", "ending", "said"),
    [
        (Path(load_arm("gantry-urdf").model.file).read_text().replace('value="0.15"', 'value="-1"'), "urdf", "stage_y"),
        (Path(load_arm("gantry-urdf").model.file).read_text().replace('"0.1"/><ine', '"0"/><ine'), "urdf", "stage_z"),
        (Path(load_arm("gantry-urdf").model.file).read_text().replace("prismatic", "planar"), "urdf", "x (planar)"),
        (BODIES.format(extra="", inertial=""), "xml", "c"),
        (BODIES.format(extra=' pos="0.1 0 0"', inertial=INERTIAL), "xml", "jc stands beside"),
        (BODIES.format(extra="", inertial='<joint name="jd" axis="1 0 0"/>' + INERTIAL), "xml", "c has 2 joints"),
    ],
)
def test_models_without_inertias_or_of_other_joints_are_refused_by_name(text, ending, said, tmp_path):
    path = written(tmp_path, text, "tool" if ending == "urdf" else "c", ending)
    with pytest.raises(avc.UnsupportedError, match="model") as caught:
        arm(path)
    assert said in str(caught.value)


URDF = Path(load_arm("gantry-urdf").model.file).read_text()


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('<child link="tool"/>', '<child link="claw"/>', "joint parent or child missing Element 'joint', line 11"),
        ('<child link="tool"/>', '<child link="frame"/>', "body not found Element 'link', line 3"),
        ('<child link="tool"/>', '<child link="stage_x"/>', "body has multiple parents: Element 'joint', line 11"),
        ('joint name="y"', 'joint name="x"', "has 2 joints of the name 'x'"),
        ('<axis xyz="0 1 0"/>', '<axis xyz="0 1"/>', "'xyz' does not have enough data Element 'axis', line 9"),
        ('<axis xyz="0 1 0"/>', '<axis xyz="0 0 0"/>', "axis too small in joint Element name 'y'"),
        ('<mass value="0.15"/>', "", "missing element: 'mass' Element 'inertial', line 5"),
        ('value="0.15"', 'value="nan"', "mass value is 'nan'; allowed: finite numbers"),
        ('iyy="5e-4"', 'iyy="-5e-4"', "inertia must have positive eigenvalues' in fullinertia Element name 'stage_y'"),
        ('iyy="5e-4" ', "", "required attribute missing: 'iyy' Element 'inertia', line 5"),
        ('<inertia ixx="5e-4"', '<moments ixx="5e-4"', "missing element: 'inertia' Element 'inertial', line 5"),
        ('<joint name="y" ', "<joint ", "required attribute missing: 'name' Element 'joint', line 9"),
        ('lower="-0.06"', 'lower="low"', "bad format in attribute 'lower' Element 'limit', line 10"),
        ('lower="-0.06"', 'lower="0.06"', "joint z: limit goes from 0.06 to 0.06"),
        (
            '<child link="tool"/>',
            '<child link="tool"/><child link="tip"/>',
            "repeated element: 'child' Element 'child', line 11",
        ),
        (
            '<link name="tool"/>',
            '<link name="tool"/><link name="claw"/>',
            "has 2 links that are no child of a joint (frame, claw); allowed: one, the base",
        ),
        ("robot", "robots", "Unrecognized XML model type: 'robots'"),
    ],
)
def test_what_is_wrong_in_a_urdf_is_told_by_name(old, new, said, tmp_path):
    with pytest.raises(avc.InputError) as caught:
        arm(written(tmp_path, URDF.replace(old, new), "stage_z", "urdf"))
    assert said in str(caught.value)


def test_what_a_urdf_may_leave_out_is_what_it_means(tmp_path):
    lacks = URDF.replace('<axis xyz="1 0 0"/>', "").replace('<origin xyz="0.02 0 0" rpy="0 0 0"/>', "")
    lacks = lacks.replace('<origin xyz="0 0 0.2" rpy="0 0 0"/>', "").replace(' rpy="0 0 0"', "").replace("0.06", "0.6")
    # Axes need not be of unit length.
    lacks = lacks.replace('<axis xyz="0 1 0"/>', '<axis xyz="0 2 0"/>')
    # A point mass has moments of 0. What is there to be drawn or driven may be as it is.
    lacks = lacks.replace('iyy="5e-4"', 'iyy="0"').replace('ixx="5e-4"', 'ixx="0"').replace('izz="5e-4"', 'izz="0"')
    mesh = '<geometry><mesh filename="package://tool.stl"/></geometry>'
    lacks = lacks.replace('effort="20" velocity="1"', "").replace(
        '<link name="tool"/>', f'<link name="tool"><visual>{mesh}</visual><collision>{mesh}</collision></link>'
    )
    made, whole = arm(written(tmp_path, lacks, "tool", "urdf")), arm("gantry-urdf")
    q = np.array([[0.01, -0.02, 0.03]])
    np.testing.assert_allclose(evaluated(made.inertia, q), evaluated(whole.inertia, q), atol=1e-12)
    np.testing.assert_allclose(
        evaluated(made.tip, q)[0, :, 0], evaluated(whole.tip, q)[0, :, 0] - [0, 0, 0.2], atol=1e-12
    )


def test_faults_of_an_arm_file_are_told_at_once(tmp_path):
    path = tmp_path / "arm.toml"
    path.write_text(
        "home = [0.0]\n[device]\nmass_kgs = 1\ndamping_ns_per_m = -1.0\n[workspace]\nlow_m = [0.0, 0.0, 0.0]\n"
        "high_m = [0.1, 0.0, 0.1]\n[gantry]\nstage_mass_kg = [1.0, 1.0]\n[model]\nfile = 'x.urdf'\ntip = 'y'\n"
    )
    with pytest.raises(avc.InputError) as caught:
        load_arm(path)
    keys = {fault.key for fault in caught.value.faults}
    assert keys == {
        "home",
        "device.mass_kgs",
        "device.damping_ns_per_m",
        "workspace.high_m",
        "gantry.stage_mass_kg",
        "",
    }
    path.write_text("[device]\nmass_kg = 1.0\n")
    with pytest.raises(avc.InputError, match="mass of an arm is that of its pose"):
        load_arm(path)


def test_every_arm_of_the_catalogue_says_what_is_assumed():
    for name in arm_names():
        file = load_arm(name)
        assert file.title
        assert "ssumed" in file.source


@pytest.mark.thorough
def test_adam_is_loaded_for_models_alone():
    program = "import sys\nfrom avc_casadi.cli import main\nmain(['arm', 'pantograph', '--json'])\n"
    program += "assert not {'adam', 'mujoco'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", program], check=True, stdout=subprocess.DEVNULL)  # noqa: S603 - ours


@pytest.mark.parametrize("size", [1e308, 1e200, 1.0, 1e-200, 1e-320])
def test_a_normal_has_a_direction_whatever_its_size(size):
    made = arm("phantom-premium-1.5")
    assert one_normal(made, (0.0, 0.6 * size, 0.8 * size)) == pytest.approx(np.array([[0.0, 0.6, 0.8]]), rel=1e-3)
