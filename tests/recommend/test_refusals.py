"""`check` says at once what `recommend` refuses, in the keys of the file: against presses integrated here."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from quick import first

import avc_casadi as avc
from avc_casadi.cli import main
from avc_casadi.coupling import Coupling
from avc_casadi.model.gains import Gains
from avc_casadi.present.rows.recommend import rows_of
from avc_casadi.recommendation.recommend import judged_as_recommended
from avc_casadi.recommendation.recommendation import Decision
from avc_casadi.recommendation.refusals import no_press_renders

KNOB = """
[device]
motion = "rotary"
handle_radius_m = 0.03
inertia_kgm2 = 3e-5
damping_nms_per_rad = 0.0
coulomb_friction_nm = {friction}
encoder_resolution_rad = 0.0015
max_torque_nm = {limit}
[environment]
stiffness_nm_per_rad = 1.0
damping_nms_per_rad = 0.01
"""
ENGINE = "[device]\nmass_kg = 0.12\ndamping_ns_per_m = 0.8\n[simulation]\nstep_s = 0.002\ntool_mass_kg = 0.2\n"


def said(text: str, folder: Path, capsys: pytest.CaptureFixture[str], verb: str) -> str:
    file = folder / "odd.toml"
    file.write_text(text, encoding="utf-8")
    main([verb, str(file)])
    return " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(
    ("friction", "limit", "key"),
    first([(0.3, 0.5, "device.coulomb_friction_nm"), (0.0, 0.02, "device.max_torque_nm")]),
)
def test_check_and_recommend_refuse_a_knob_that_no_hand_presses_in_its_own_keys(
    friction: float, limit: float, key: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = KNOB.format(friction=friction, limit=limit)
    checked = said(text, tmp_path, capsys, "check")
    assert "Not deployable" in checked
    assert key in checked
    recommended = said(text, tmp_path, capsys, "recommend")
    reason = avc.recommend(avc.parse_problem(text)).reason
    assert reason in checked
    assert reason in recommended


def test_a_knob_that_hands_press_is_not_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "Not deployable" not in said(KNOB.format(friction=0.01, limit=0.3), tmp_path, capsys, "check")


@pytest.mark.slow
def test_gains_that_no_hand_presses_are_refused_for_rendering_nothing() -> None:
    problem = avc.load_problem("soft").changed(
        device={"coulomb_friction_n": 20.0, "max_force_n": 10.0}, environment={"stiffness_n_per_m": 500.0}
    )
    gains = Coupling.constant(problem, Gains(10.0, 1e3), "mine").schedule
    found = judged_as_recommended(problem, gains, hands=4)
    assert found.decision is Decision.NOTHING_RENDERED
    rendered = next(shown for shown in rows_of(found) if shown.label == "Rendered")
    assert "dry friction" in rendered.text(problem.units)


@pytest.mark.parametrize(
    ("more", "word"),
    [
        ("stiffness_n_per_m = 1e7\n", "simulation.stiffness_n_per_m"),
        ('integrator = "explicit"\ncontact_stiffness_n_per_m = [1e6, 1e6]\n', "your engine"),
    ],
)
def test_check_refuses_an_engine_that_no_coupling_stabilises(
    more: str, word: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    checked = said(ENGINE + more, tmp_path, capsys, "check")
    assert "Not deployable" in checked
    assert word in checked


def pressed(mass: float, hand: tuple[float, float, float], friction: float, wall: float) -> float:
    """Force on the wall at the end of a press from -10 to 10 mm at 70 mm/s, by semi-implicit steps of 20 us."""
    step_s, speed = 2e-5, 0.07
    inertia, damper, spring = mass + hand[0], hand[1], hand[2]
    position, velocity = -0.01, 0.0
    for tick in range(round(1.5 / step_s)):
        moving = tick * step_s * speed < 0.02
        target, pace = (-0.01 + tick * step_s * speed, speed) if moving else (0.01, 0.0)
        force = spring * (target - position) + damper * (pace - velocity) - wall * max(position, 0.0)
        impulse = inertia * velocity + step_s * force
        velocity = float(np.sign(impulse) * max(abs(impulse) - step_s * friction, 0.0)) / inertia
        position += step_s * velocity
    return wall * max(position, 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("index", range(8))
def test_what_is_refused_is_what_no_press_reaches(index: int) -> None:
    random = np.random.default_rng([6, index])
    stiffness, wall = float(random.uniform(300, 900)), float(random.uniform(500, 2000))
    hand = (float(random.uniform(0.05, 0.3)), float(random.uniform(2, 10)), stiffness)
    still = stiffness * 0.01
    moving = still + 0.07 * (hand[1] + np.sqrt((0.1 + hand[0]) * stiffness))

    def problem(friction: float, limit: float | None) -> avc.Problem:
        ends = {
            key: (value, value)
            for key, value in zip(("mass_kg", "damping_ns_per_m", "stiffness_n_per_m"), hand, strict=True)
        }
        device = {"mass_kg": 0.1, "coulomb_friction_n": friction, "max_force_n": limit}
        wall_of = {"stiffness_n_per_m": wall, "damping_ns_per_m": 0.0}
        return avc.load_problem("soft").changed(device=device, environment=wall_of, hands=ends)

    for friction, refused in ((0.95 * still, False), (1.01 * moving, True)):
        assert (no_press_renders(problem(friction, None)) is not None) is refused
        assert (pressed(0.1, hand, friction, wall) < 1e-9) is refused
    force = pressed(0.1, hand, 0.0, wall)
    for share in (0.9, 1.1):
        assert (no_press_renders(problem(0.0, force / 0.97 / share)) is not None) is (share > 1)


ARM = """
[device]
drive = "velocity"
drive_bandwidth_hz = 15.0
sample_time_s = 0.002
delay_samples = 2
[device.force_sensor]
stiffness_n_per_m = 1e6
handle_mass_kg = 1.0
noise_rms_n = {noise}
[law]
admittance = {{ mass_kg = 12.0, damping_ns_per_m = 300.0, cutoff_hz = 40.0 }}
[hands]
mass_kg = [0.5, 2.0]
damping_ns_per_m = [{least_damping}, {most_damping}]
stiffness_n_per_m = [100.0, 1000.0]
"""


@pytest.mark.parametrize(("noise", "most_damping"), first([(150.0, 40.0), (0.2, 4e5)]))
def test_check_and_recommend_refuse_an_arm_that_noise_moves_or_a_hand_destabilises(
    noise: float, most_damping: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = ARM.format(noise=noise, least_damping=0.0, most_damping=most_damping)
    reason = "no virtual mass and damping has a disk margin of 0.2"
    assert reason in said(text, tmp_path, capsys, "check")
    assert reason in said(text, tmp_path, capsys, "recommend")


def test_an_arm_that_a_law_suits_is_not_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = ARM.format(noise=0.2, least_damping=10.0, most_damping=40.0)
    assert "no virtual mass" not in said(text, tmp_path, capsys, "check")


@pytest.mark.parametrize(("contact", "refused"), first([(1e5, True), (10.0, False)]))
def test_check_refuses_a_joint_whose_contact_is_unstable_in_its_engine(
    contact: float, refused: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # Semi-implicit steps of 5 ms of 3 g m2 are stable up to 4 J/dt^2 = 480 N.m/rad.
    joint = (
        '[simulation]\ntool_inertia_kgm2 = 0.003\nstep_s = 0.005\nintegrator = "semi-implicit"\n'
        f"contact_stiffness_nm_per_rad = [0.0, {contact}]\n"
    )
    reason = "damping ratio of 0.7"
    assert (reason in said(joint, tmp_path, capsys, "check")) is refused
    assert (reason in said(joint, tmp_path, capsys, "recommend")) is refused
