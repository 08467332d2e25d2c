"""The loop of an arm in space: one axis where nothing couples, the arm's own motion where it does; its gains in C."""

import json
import subprocess

import numpy as np
import pytest
from exported import WARNINGS
from hardware_bench import require, run, scratch
from test_exported_examples_keep_axes_units_and_time import STUBS, played

import avc_casadi as avc
from avc_casadi.arm.arm import evaluated
from avc_casadi.arm.contact import Contacts, contact_loops
from avc_casadi.arm.coupled import coupled_certificate, electronics, radii, random_points
from avc_casadi.arm.design import RESERVE, ArmDesign, DirectedGains, design_arm, gains_document
from avc_casadi.arm.effective_mass import effective_masses, mobility, reached, tip_device
from avc_casadi.arm.mechanisms import arm
from avc_casadi.arm.walls import workspace_map
from avc_casadi.claims.stability.stiffest_wall import loop_radius, stiffest_wall
from avc_casadi.cli import main
from avc_casadi.model.device import Device
from avc_casadi.model.hands import Hand, hand_corners, with_released
from avc_hardware import arm_gains_c

PREMIUM, PANTOGRAPH = arm("phantom-premium-1.5"), arm("pantograph")
NO_HAND = np.zeros((1, 3, 3))
DEVICES = [
    {},
    {"delay_samples": 1},
    {"delay_samples": 1.4, "amplifier_bandwidth_hz": 800.0},
    {"delay_samples": 2, "amplifier_bandwidth_hz": 500.0, "amplifier_order": 2},
    {"amplifier_bandwidth_hz": 200.0, "amplifier_order": 2, "amplifier_damping_ratio": 0.3},
]


@pytest.fixture(scope="module")
def design():
    return design_arm(PANTOGRAPH, points=300)


@pytest.fixture(scope="module")
def premium():
    """The Premium one sample late, with gains that differ by the normal, and the worst contact with them."""
    file = PREMIUM.file
    known = file.device.range.model_copy(update={"delay_samples": None})
    late = file.model_copy(update={"device": file.device.model_copy(update={"delay_samples": 1, "range": known})})
    made, directions = arm(late), np.eye(3)
    stiffness = np.array([[2400.0, 3600.0, 3000.0]])
    one, tangent = np.ones(1), 2300.0
    gains = DirectedGains(
        *made.box_m, (1, 1, 1), directions, stiffness, 2.9e-3 * stiffness, tangent * one, 2.9e-3 * tangent * one
    )
    return gains, coupled_certificate(made, gains, points=300)


@pytest.mark.parametrize("values", DEVICES)
def test_where_nothing_couples_it_is_one_axis(values):
    random = np.random.default_rng(4)
    for _ in range(6):
        mass, damping, hand = random.uniform(0.02, 0.5), random.choice([0.0, 2.0]), random.choice([0.0, 0.2])
        device = Device(mass_kg=mass, damping_ns_per_m=damping, **values)
        k, b = np.full((2, 1), random.uniform(500, 9000)), np.full((2, 1), random.uniform(1, 60))
        same = [np.eye(3)[None] * one for one in (hand, 30 * hand, 2000 * hand)]
        alone = loop_radius(device, Hand(*(np.array([one[0, 0, 0]]) for one in same)), k[0], b[0])[0, 0]
        contact = Contacts(np.eye(3)[None] / mass, np.eye(3)[:1], np.ones(1), np.array([damping]), *same)
        assert contact_loops(device, contact).radius(k, b)[0] == pytest.approx(alone, abs=1e-7)


def test_free_tangent_moves_as_the_lighter_mass_and_held_as_the_heavier():
    """Let go and without damping the normal is alone, at the two ends of the effective mass."""
    joints, _ = reached(PREMIUM, PREMIUM.home_tip_m[None] + [[0.04, 0.05, -0.05]])
    inverse, normal = mobility(PREMIUM, joints), np.array([[0.48, 0.6, 0.64]])
    masses = effective_masses(inverse, normal)[0, 0]
    k, b = np.array([[2500.0], [0.0]]), np.array([[8.0], [0.0]])
    device = Device(mass_kg=1.0, damping_ns_per_m=0.0, delay_samples=1)
    contact = Contacts(inverse, normal, np.zeros(1), np.zeros(1), NO_HAND, NO_HAND, NO_HAND)
    free = loop_radius(device.model_copy(update={"mass_kg": masses[0]}), Hand(*np.zeros((3, 1))), k[0], b[0])
    assert contact_loops(device, contact).radius(k, b)[0] == pytest.approx(free[0, 0], abs=1e-7)
    # A tangent that cannot move: the springs along it are those of the hand, in continuous time.
    wall = 1e7 * (np.eye(3) - normal.T @ normal)[None]
    held = Contacts(inverse, normal, np.zeros(1), np.zeros(1), NO_HAND, 1e3 * wall / 1e7, wall)
    values = contact_loops(device, held)
    slow = loop_radius(device.model_copy(update={"mass_kg": masses[1]}), Hand(*np.zeros((3, 1))), k[0], b[0])
    assert values.radius(k, b)[0] == pytest.approx(slow[0, 0], abs=2e-3)


@pytest.mark.thorough
@pytest.mark.parametrize(("factor", "grows"), [(0.96, False), (1.04, True)])
def test_the_arm_itself_is_unstable_where_the_frozen_loop_is(premium, factor, grows):
    """The nonlinear arm, its joints driven by the coupling's force from samples, let go at the worst contact."""
    gains, worst = premium[0], premium[1].worst
    assert not worst.held
    made, contact, d = PREMIUM, worst.contact, 3
    joints, _ = reached(made, worst.tip_m[None])
    stiffness, damping = gains.at(worst.tip_m[None], contact.normal)
    square = contact.normal.T @ contact.normal
    across = contact.tangent_share[0] * (np.eye(d) - square)
    scale = factor * worst.factor
    spring = scale * (stiffness[0] * square + stiffness[1] * across)
    damper = scale * (damping[0] * square + damping[1] * across) / 1e-3
    rest = worst.tip_m
    q, v = joints[0], 1e-6 * np.array([1.0, -2.0, 1.5])
    waiting = [np.zeros(d)] * int(worst.delay_samples)
    before, size, steps = rest, [], 2

    def rate(state, force):
        q, v = np.split(state, 2)
        jacobian = np.array(made.jacobian(q))
        pushed = jacobian.T @ (-force - contact.damping_ns_per_m[0] * (jacobian @ v))
        return np.concatenate([v, np.array(made.acceleration(q, v, pushed)).ravel()])

    for _ in range(1200):
        tip = np.array(made.tip(q)).ravel()
        waiting.append(spring @ (tip - rest) + damper @ (tip - before))
        before, state, h = tip, np.concatenate([q, v]), 1e-3 / steps
        force = waiting.pop(0)
        for _ in range(steps):
            k1 = rate(state, force)
            k2 = rate(state + h / 2 * k1, force)
            k3 = rate(state + h / 2 * k2, force)
            state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + rate(state + h * k3, force))
        q, v = np.split(state, 2)
        size.append(np.abs(spring @ (tip - rest)).max())
    assert (max(size[-100:]) > max(size[500:600])) == grows
    assert max(size) < 1


@pytest.mark.thorough
def test_gains_keep_the_reserve_on_contacts_that_had_no_part(design):
    gains, certificate = design.gains, design.certificate
    assert certificate.stable
    assert certificate.worst.factor >= RESERVE
    # Each axis alone could grow by 1.25.
    assert design.per_axis_factor < 1.25
    for device in electronics(PANTOGRAPH):
        for held in (True, False):
            points = random_points(PANTOGRAPH, 1500, 77, held=held)
            at = radii(PANTOGRAPH, gains, device, points, held=held)
            assert np.nanmax(at(1.0)) < 1
            assert np.nanmax(at(0.999 * certificate.worst.factor)) < 1
    again = coupled_certificate(PANTOGRAPH, gains.times(1.5), points=200)
    assert not again.stable
    assert again.worst.factor == pytest.approx(certificate.worst.factor / 1.5, rel=0.02)


@pytest.mark.thorough
def test_map_is_never_too_stiff_and_hardly_softer():
    found = workspace_map(PANTOGRAPH, 9)
    subjects = with_released(hand_corners(PANTOGRAPH.file.hands))
    for row in np.flatnonzero(found.there)[:3]:
        for column in range(len(found.labels)):
            device = tip_device(PANTOGRAPH, found.free_kg[row, column], found.held_kg[row, column])
            exact = stiffest_wall(device, subjects).stiffness_n_per_m
            assert 0.92 * exact < found.stiffness_n_per_m[row, column] <= 1.0002 * exact


@pytest.mark.thorough
def test_a_resonance_is_refused_by_name():
    file = PREMIUM.file
    bending = {"frequency_hz": 150.0, "damping_ratio": 0.05, "mass_ratio": 0.5}
    device = type(file.device).model_validate({**file.device.model_dump(exclude_unset=True), "resonance": bending})
    with pytest.raises(avc.UnsupportedError) as caught:
        design_arm(arm(file.model_copy(update={"device": device})), one=True, points=20)
    assert caught.value.key == "device.resonance"


PROGRAM = """#include <stdio.h>
#include "avc_arm_gains.h"
int main(void)
{
    double tip[3] = {0, 0, 0}, normal[3] = {0, 0, 0};
    while (scanf("%lf %lf %lf %lf %lf %lf", tip, tip + 1, tip + 2, normal, normal + 1, normal + 2) == 6) {
        const avc_arm_gains_t found = avc_arm_gains(tip, normal);
        printf("%.17g %.17g %.17g %.17g\\n", found.stiffness_n_per_m, found.tangent_stiffness_n_per_m,
               found.damping_ns_per_m, found.tangent_damping_ns_per_m);
    }
    return 0;
}
"""


@pytest.fixture(scope="module")
def regional(premium):
    """Those gains in twelve regions, each with numbers of its own, and their document."""
    gains, certificate = premium
    share = np.linspace(0.5, 1.0, 12)
    changed = DirectedGains(
        gains.low_m,
        gains.high_m,
        (2, 3, 2),
        gains.directions,
        share[:, None] * gains.stiffness_n_per_m,
        share[:, None] * gains.damping_ns_per_m,
        share * gains.tangent_stiffness_n_per_m,
        share * gains.tangent_damping_ns_per_m,
    )
    masses = np.full((12, 3), 0.1)
    return changed, gains_document(PREMIUM, ArmDesign(changed, changed, 1.0, masses, masses, certificate))


@pytest.mark.thorough
def test_constants_in_c_are_the_gains(regional):
    gains, document = regional
    folder = scratch() / "arm_gains"
    folder.mkdir(exist_ok=True)
    for name, text in arm_gains_c(document).items():
        (folder / name).write_text(text, encoding="ascii")
    (folder / "look.c").write_text(PROGRAM)
    random = np.random.default_rng(3)
    tips = gains.low_m + (gains.high_m - gains.low_m) * random.uniform(-0.1, 1.1, (300, 3))
    normals = random.standard_normal((300, 3))
    text = "\n".join(" ".join(map(repr, row)) for row in np.hstack([tips, normals]).tolist())
    stiffness, damping = gains.at(tips, normals)
    for compiler, standard in (("gcc", "-std=c99"), ("g++", "-std=c++11")):
        require(compiler)
        language = ("-x", "c++") if compiler == "g++" else ()
        run(compiler, standard, *WARNINGS, *language, str(folder / "look.c"), "-o", str(folder / "look"))
        said = subprocess.run([folder / "look"], input=text, capture_output=True, text=True, check=True).stdout  # noqa: S603
        found = np.array([line.split() for line in said.splitlines()], dtype=float)
        np.testing.assert_allclose(found, np.vstack([stiffness, damping]).T, rtol=1e-5)


@pytest.mark.thorough
def test_example_applies_them_along_the_axes_of_the_arm(regional):
    require("g++")
    gains, document = regional
    folder = scratch() / "arm_example"
    folder.mkdir(exist_ok=True)
    for name, text in arm_gains_c(document).items():
        (folder / name).write_text(text, encoding="ascii")
    program = folder / "chai3d_arm"
    stubs = ("-include", str(STUBS / "recorded_device.hpp"), f"-I{STUBS}", f"-I{folder}")
    run("g++", "-std=c++11", "-O1", *WARNINGS, *stubs, str(folder / "chai3d_arm.cpp"), "-o", str(program))
    time = np.arange(300) * 1e-3
    height = -0.02 + np.where(time < 0.15, -1.0, 1.0) * 1e-3 * np.sin(2 * np.pi * 10 * time)
    tips = np.stack([np.full(300, 0.03), np.where(time < 0.15, 0.08, -0.08), height], axis=1)
    forces, said, _ = played(program, "chai3d", tips, np.full(300, 100.0))
    assert "does not answer" in said
    depth = -0.02 - height
    moved = np.concatenate([[0.0], np.diff(height)])
    expected, touched = [], None
    for row in range(300):
        if depth[row] <= 0:
            touched = None
            expected.append(0.0)
            continue
        if touched is None:
            place = PREMIUM.home_tip_m + tips[row] * [-1, -1, 1]
            touched = [one[0, 0] for one in gains.at(place[None], np.array([[0.0, 0.0, 1.0]]))]
        out = max(0.0, touched[0] * depth[row] - touched[1] * moved[row] / 1e-3)
        expected.append(min(out, 8.5))
    assert len(set(np.round(expected, 3))) > 30
    np.testing.assert_allclose(forces[:-1, 2], expected, rtol=1e-4, atol=1e-4)
    assert not forces[:, :2].any()
    _, said, _ = played(program, "chai3d", tips, np.full(300, 2500.0))
    assert "does not keep the sample time" in said


@pytest.mark.thorough
def test_command_writes_what_it_tells(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert (
        main(["arm", "pantograph", "--map", "m.png", "--poses", "9", "--gains", "g", "--one-coupling", "--json"]) == 0
    )
    told = json.loads(capsys.readouterr().out)
    assert (tmp_path / "m.png").read_bytes().startswith(b"\x89PNG")
    assert sorted(path.name for path in (tmp_path / "g").iterdir()) == told["gains"]["files"]
    written = json.loads((tmp_path / "g" / "gains.json").read_text())
    assert written.items() <= told["gains"].items()
    # The same gains every way: the coupled loop has the margin of its axes.
    assert written["claim"]["factor"] == pytest.approx(1.25, rel=0.01)


@pytest.mark.parametrize(
    ("options", "key"),
    [
        (["--regions", "2,2"], "--regions"),
        (["--one-coupling"], "--one-coupling"),
        (["--gains", "g", "--regions", "2,2,2"], "--regions"),
        (["--gains", "g", "--regions", "0,2"], "--regions"),
        (["--at", "1,1"], "--at"),
        (["--at", "1,nan"], "--at"),
        (["--normal", "0,0"], "--normal"),
        (["--map", "m.txt"], "--map"),
    ],
)
def test_faults_of_the_command_name_the_option(options, key, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["arm", "pantograph", *options, "--json"]) == 2
    assert [error["key"] for error in json.loads(capsys.readouterr().out)["errors"]] == [key]


def test_tip_device_is_taken_by_problems(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["arm", "gantry", "--normal", "0,0,1", "--out", "tip.toml"]) == 0
    capsys.readouterr()
    (tmp_path / "wall.toml").write_text(
        'device = "tip.toml"\n[environment]\nstiffness_n_per_m = 1000.0\ndamping_ns_per_m = 0.0\n'
    )
    problem = avc.load_problem("wall.toml")
    assert problem.device.range.mass_kg == pytest.approx((0.11, 0.11))


def test_poses_are_those_of_the_places():
    points = random_points(PREMIUM, 50, 1, held=False)
    low, high = PREMIUM.box_m
    tips = low + (high - low) * points[:, :3]
    joints, there = reached(PREMIUM, tips)
    assert np.abs(evaluated(PREMIUM.tip, joints[there])[..., 0] - tips[there]).max() < 1e-8
