"""Trials of admittance laws: the plant against one that is written out a second time, and what hands find."""

import json
import math

import numpy as np
import pytest
from admittance_handles import DRIVE, DRIVE_SPEED, HANDLE, HANDLE_SPEED, PushedHandles
from admittance_loop import PlainDevice, largest_pole
from quick import first

import avc_casadi as avc
from avc_casadi.cli import main
from avc_casadi.files.admittance_file import dump_admittance
from avc_casadi.model.hands import Hand
from avc_casadi.simulation.population.admittance_run import MOTIONS
from avc_casadi.simulation.population.admittance_trial import try_admittance
from avc_casadi.simulation.population.handle_lanes import HandleLanes, HandTarget

HANDS = np.array([(0.5, 30.0, 800.0), (2.0, 40.0, 1000.0), (1.0, 15.0, 600.0), (0.0, 5.0, 300.0)])
CONTACTS = np.array([(5.0, 5e3), (5.0, 5e3), (0.0, 800.0), (20.0, 2e4)])
DEVICES = (
    {},
    {"delay_samples": 1.3, "drive_order": 2, "drive_damping_ratio": 0.5},
    {"delay_samples": 0, "force_sensor": {"stiffness_n_per_m": 2e4, "handle_mass_kg": 0.2}},
)


@pytest.mark.parametrize("device", first(DEVICES))
def test_handles_that_touch_and_leave_move_as_those_of_a_second_program(device):
    """Three of four hands let go in the contact; the second program looks at the contact a hundred times a sample."""
    problem = avc.load_admittance("admittance/cobot").changed(device=device)
    law, period = problem.law.admittance, problem.device.sample_time_s
    lanes = HandleLanes(problem.device, Hand(*HANDS.T), Hand(np.zeros(4), *CONTACTS.T))
    lanes.place(np.full(4, -0.004), np.full(4, -0.004), np.full(4, 0.05))
    second = PushedHandles(problem, HANDS, CONTACTS, parts_per_radian=150.0)
    second.state[:, DRIVE], second.state[:, HANDLE], second.state[:, HANDLE_SPEED] = -0.004, -0.004, 0.05
    share = 1 - math.exp(-2 * math.pi * law.cutoff_hz * period)
    filtered, velocity, touched, left = np.zeros(4), np.zeros(4), np.zeros(4, bool), np.zeros(4, bool)
    for sample in range(250):
        filtered = filtered + share * (lanes.sensor_n - filtered)
        velocity = (law.mass_kg * velocity + period * filtered) / (law.mass_kg + law.damping_ns_per_m * period)
        if sample == 150:
            released = np.array([True, True, True, False])
            lanes.release(released)
            second.held &= ~released
        target = np.full(4, 0.06 * math.sin(2 * math.pi * 3 * sample * period) * (sample < 120))
        speed = np.full(4, 0.01)
        lanes.move(velocity, HandTarget(target, speed))
        second.move(velocity, target, speed)
        places = DRIVE, DRIVE_SPEED, HANDLE, HANDLE_SPEED
        mine, other = lanes.state[[0, 1, -2, -1]].T, second.state[:, places]
        assert np.abs(mine[:, [0, 2]] - other[:, [0, 2]]).max() < 2e-6, sample
        assert np.abs(mine[:, [1, 3]] - other[:, [1, 3]]).max() < 2e-3, sample
        touched |= lanes.touching
        left |= touched & ~lanes.touching
    assert touched.all()
    assert left.sum() >= 3


@pytest.mark.slow
def test_a_hand_feels_the_law_that_it_guides():
    """Rms of force over speed at 1 Hz is that of mass, damping and spring, with the handle, behind the low pass."""
    for name in ("admittance/cobot", "admittance/pedal"):
        problem = avc.load_admittance(name)
        found = try_admittance(problem, 12)
        law, omega = problem.law.admittance, 2 * math.pi
        ideal = law.mass_kg + problem.device.force_sensor.handle_mass_kg
        expected = abs(law.damping_ns_per_m + 1j * (omega * ideal - law.stiffness_n_per_m / omega))
        assert found.effort.effort_ns_per_m == pytest.approx(expected, rel=0.05)
        speed = 2 * math.pi * found.effort.way_m
        assert found.effort.rms_n == pytest.approx(expected * speed / math.sqrt(2), rel=0.1)
        assert found.effort.rms_n < found.effort.peak_n < 1.6 * found.effort.rms_n
        assert found.released.at_release_m_per_s == pytest.approx(speed, rel=0.1)
        assert found.rests


@pytest.mark.slow
def test_the_handle_moves_on_as_far_as_its_mass_takes_it():
    """A released law M dv/dt + B v = 0 stops after v M/B: what filter and delay lag behind adds v times that time."""
    quiet = {"noise_rms_n": 0.0, "resolution_n": 0.0}
    problem = avc.load_admittance("admittance/cobot").changed(device={"force_sensor": quiet})
    for mass in (12.0, 24.0):
        found = try_admittance(problem.changed(law={"admittance": {"mass_kg": mass}}), 8)
        lag = mass / 300.0 + 1 / (2 * math.pi) * (1 / 40.0 + 1 / 15.0) + 2.5 * 2e-3
        assert found.released.way_m == pytest.approx(found.released.at_release_m_per_s * lag, rel=0.15)


@pytest.mark.slow
@pytest.mark.parametrize(("damping", "stable"), [(300.0, True), (40.0, False)])
def test_what_the_poles_say_of_a_contact_is_what_hands_find(damping, stable):
    """12 kg and 40 N.s/m swing on the contact of 5 kN/m under a light hand; in free space they rest."""
    problem = avc.load_admittance("admittance/cobot").changed(law={"admittance": {"damping_ns_per_m": damping}})
    poles = [largest_pole(PlainDevice.of(problem, mass, 15.0, 6e3)) for mass in (0.5, 2.0)]
    assert (max(poles) < 1) == stable
    found = try_admittance(problem, 10)
    assert found.rests == stable
    assert bool(found.moving) != stable
    touching = {name for name, motion in MOTIONS.items() if motion.touches and not motion.released}
    assert {name for name, count in found.by_motion.items() if count < 10} == (set() if stable else touching)


@pytest.mark.slow
def test_limits_are_reported_and_keep_a_swing_from_growing():
    """A handle of 40 kg and 20 N.s/m on 20 kN/m grows by the contact until the largest speed is commanded."""
    law = {"admittance": {"mass_kg": 40.0, "damping_ns_per_m": 20.0}}
    problem = avc.load_admittance("admittance/cobot").changed(law=law, contact={"stiffness_n_per_m": [2e4, 2e4]})
    found = try_admittance(problem, 10)
    assert not found.rests
    assert found.at_speed_limit + found.at_force_limit > 0
    largest = max(found.released.largest_m_per_s, found.rebound.released_m_per_s)
    assert largest < 2 * problem.device.max_speed_m_per_s
    unlimited = problem.changed(device={"max_speed_m_per_s": None, "force_sensor": {"max_force_n": None}})
    assert try_admittance(unlimited, 2).at_speed_limit == 0


@pytest.mark.slow
def test_blocks_devices_and_contacts_are_those_of_the_file():
    problem = avc.load_admittance("admittance/cobot").changed(
        device={"range": {"delay_samples": [1.0, 2.0]}}, contact={"stiffness_n_per_m": [500.0, 5e3]}
    )
    found = try_admittance(problem, 11, seed=3)
    assert (found.devices, found.contacts, found.hands) == (2, 3, 11)
    assert found.rests
    assert set(found.by_motion.values()) == {11}
    low, high = found.at_rest_interval
    assert low < 1 == high


@pytest.mark.slow
def test_a_radius_scales_the_motions_of_a_device_that_turns():
    linear = avc.load_admittance("admittance/cobot")
    radius = 0.1
    tables = linear.model_dump(exclude={"name"}, exclude_unset=True)
    tables["device"] |= {"motion": "rotary", "handle_radius_m": radius, "max_speed_m_per_s": 0.5 / radius}

    def turned(values, keys, power):
        return values | {key: (np.array(values[key]) * radius**power).tolist() for key in keys}

    sensor = turned(tables["device"]["force_sensor"], ("stiffness_n_per_m", "handle_mass_kg"), 2)
    tables["device"]["force_sensor"] = turned(sensor, ("noise_rms_n", "resolution_n", "max_force_n"), 1)
    tables["law"]["admittance"] = turned(tables["law"]["admittance"], ("mass_kg", "damping_ns_per_m"), 2)
    tables["hands"] = turned(tables["hands"], ("mass_kg", "damping_ns_per_m", "stiffness_n_per_m"), 2)
    tables["contact"] = turned(tables["contact"], ("stiffness_n_per_m", "damping_ns_per_m"), 2)
    one = try_admittance(linear, 4)
    other = try_admittance(avc.AdmittanceProblem.model_validate(tables), 4)
    assert other.by_motion == one.by_motion
    assert other.effort.way_m * radius == pytest.approx(one.effort.way_m)
    assert other.effort.peak_n / radius == pytest.approx(one.effort.peak_n, rel=1e-3)
    assert other.released.way_m * radius == pytest.approx(one.released.way_m, rel=1e-3)


@pytest.mark.slow
def test_the_command_prints_counts_and_its_code_is_the_verdict(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["trial", "admittance/cobot", "--hands", "9", "--workers", "1"]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "Settle 9 of 9 hands" in text
    assert "Rebound a pressed handle leaves the contact" in text
    assert "guide 9, hold 9, release 9, press 9, tap 9, leave 9" in text
    assert main(["trial", "admittance/pedal", "--hands", "3", "--json", "--workers", "1"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert (data["kind"], data["at_rest"], data["rebound"]) == ("trial-admittance", 3, None)
    swinging = {"mass_kg": 12.0, "damping_ns_per_m": 5.0}
    problem = avc.load_admittance("admittance/cobot").changed(
        law={"admittance": swinging}, contact={"damping_ns_per_m": 0.0}
    )
    (tmp_path / "swinging.toml").write_text(dump_admittance(problem), encoding="utf-8")
    assert main(["trial", "swinging.toml", "--hands", "1", "--workers", "1"]) == 1
    assert "Do not settle" in capsys.readouterr().out
    assert main(["trial", "admittance/cobot", "--without-friction"]) == 2
    assert "states no friction" in capsys.readouterr().err


@pytest.mark.slow
def test_a_handle_that_coasts_for_long_is_watched_until_it_rests():
    """Of 12 kg and 5 N.s/m the time constant of a released handle is 13/5 s: 8.5 s from 0.13 m/s to 5 mm/s."""
    quiet = {"noise_rms_n": 0.0, "resolution_n": 0.0}
    problem = avc.load_admittance("admittance/cobot").changed(
        device={"force_sensor": quiet},
        law={"admittance": {"damping_ns_per_m": 5.0}},
        contact={"stiffness_n_per_m": [0.0, 0.0]},
    )
    found = try_admittance(problem, 4)
    assert found.by_motion["release"] == 4
    assert found.longest_s > 4.0 + 13.0 / 5.0 * math.log(0.125 / 5e-3)


def test_without_a_law_or_a_hand_nothing_is_tried():
    problem = avc.load_admittance("admittance/cobot")
    with pytest.raises(avc.InputError, match="law: is missing"):
        try_admittance(problem.changed(law=None), 2)
    with pytest.raises(avc.InputError, match="hands: is 0"):
        try_admittance(problem, 0)
