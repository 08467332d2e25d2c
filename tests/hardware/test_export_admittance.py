"""Exported admittance laws: the law sample by sample, a device and a hand around them, and sensors that fail."""

import ctypes
import dataclasses
import functools
import math
import tempfile
from pathlib import Path

import numpy as np
import pytest
from admittance_handles import HANDLE_SPEED, PushedHandles
from admittance_loop import PlainDevice
from hardware_bench import require, run, scratch
from quick import first

import avc_casadi as avc
from avc_casadi.claims.admittance import unstable_at_corners_hz
from avc_casadi.cli import main
from avc_hardware import admittance_files
from avc_hardware.codegen.admittance_export import HELD_SAMPLES, STOP_S, FaultBounds

REAL = {"single": ctypes.c_float, "double": ctypes.c_double}
WARNINGS = ("-std=c99", "-O2", "-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror", "-fPIC", "-shared")


@functools.cache
def compiled(problem, precision, compiler):
    """The library of a law, judged and compiled once for all tests of a worker."""
    require(compiler)
    folder = Path(tempfile.mkdtemp(dir=scratch()))
    for name, text in admittance_files(problem, precision=precision).items():
        (folder / name).write_text(text, encoding="ascii")
    target = folder / "law.so"
    run(compiler, *WARNINGS, str(folder / "avc_coupling.c"), "-o", str(target))
    return ctypes.CDLL(str(target))


class Exported:
    """The compiled step of a law."""

    def __init__(self, problem, precision="double", compiler="gcc"):
        library, real = compiled(problem, precision, compiler), REAL[precision]
        self._step = library.avc_coupling_step
        self._step.argtypes, self._step.restype = [ctypes.c_void_p, real, real], real
        self._start = library.avc_coupling_start
        self._state = ctypes.create_string_buffer(512)
        self.start()

    def start(self):
        self._start(self._state)

    def step(self, position, force):
        return self._step(self._state, position, force)


def law_of(problem, forces, positions):
    """The law in Python, clamped, from readings that are all believed."""
    device = problem.device
    # A sensor of 1 N/m reads the force that its handle is displaced by.
    plain = dataclasses.replace(PlainDevice.of(problem), sensor_n_per_m=1.0, sensor_ratio=0.0, handle_kg=1.0)
    memory, out = (0.0, 0.0), []
    for force, position in zip(forces, positions, strict=True):
        filtered, velocity = plain.command(memory, (position, 0.0, 0.0, position + force, 0.0))
        velocity = min(max(velocity, -device.max_speed_m_per_s), device.max_speed_m_per_s)
        memory = filtered, velocity
        out.append(velocity)
    return np.array(out)


@pytest.mark.parametrize("name", first(["admittance/cobot", "admittance/pedal"]))
@pytest.mark.parametrize(("precision", "digits"), first([("double", 1e-12), ("single", 2e-4)]))
def test_the_step_is_the_law(name, precision, digits):
    problem = avc.load_admittance(name)
    exported = Exported(problem, precision)
    time = np.arange(3000) * problem.device.sample_time_s
    forces = 25.0 * np.sin(2 * np.pi * 0.7 * time) * np.exp(-time / 4)
    positions = 0.002 * np.sin(2 * np.pi * 0.5 * time)
    given = np.array([exported.step(*pair) for pair in zip(positions, forces, strict=True)])
    # The first reading is believed with the second, where nothing has been yet.
    expected = law_of(problem, [0.0, *forces[1:]], positions)
    assert np.abs(given - expected).max() <= digits * np.abs(expected).max()


@pytest.mark.slow
def test_a_drive_of_positions_is_given_the_change_of_its_position():
    problem = avc.load_admittance("admittance/cobot").changed(device={"drive": "position", "drive_order": 2})
    period = problem.device.sample_time_s
    exported = Exported(problem)
    forces = 25.0 * np.sin(2 * np.pi * 0.7 * np.arange(1500) * period)
    given = np.array([exported.step(0.0, force) for force in forces])
    expected = period * law_of(problem, [0.0, *forces[1:]], np.zeros(1500))
    assert np.abs(given - expected).max() <= 1e-12 * np.abs(expected).max()
    assert "by how much to move the commanded position" in admittance_files(problem)["avc_coupling.h"]


@pytest.mark.slow
def test_clang_and_another_name_compile(tmp_path, monkeypatch, capsys):
    problem = avc.load_admittance("admittance/pedal")
    Exported(problem, "single", "clang")
    monkeypatch.chdir(tmp_path)
    assert main(["export", "admittance/pedal", "--c", "firmware", "--name", "pedal"]) == 0
    assert "velocity out" in capsys.readouterr().out
    assert {path.name for path in tmp_path.joinpath("firmware").iterdir()} == {"pedal.c", "pedal.h"}
    require("g++")
    run("g++", "-std=c++11", "-c", "-Werror", "-x", "c++", "firmware/pedal.c", "-o", "p.o")


def test_what_swings_with_hands_between_the_corners_alone_is_refused_too():
    sensor = {"stiffness_n_per_m": 365826.0, "damping_ratio": 0.037, "handle_mass_kg": 0.407, "max_force_n": 100.0}
    drive = {"drive_bandwidth_hz": 86.5, "drive_order": 2, "drive_damping_ratio": 0.743, "max_speed_m_per_s": 0.5}
    law = {"mass_kg": 1.03, "damping_ns_per_m": 2300.0, "cutoff_hz": 152.0}
    device = {"drive": "velocity", **drive, "sample_time_s": 4e-3, "delay_samples": 2, "force_sensor": sensor}
    hands = {"mass_kg": [0.1, 1.8], "damping_ns_per_m": [5.3, 8.7], "stiffness_n_per_m": [586.0, 856.0]}
    between = avc.AdmittanceProblem.model_validate({"device": device, "law": {"admittance": law}, "hands": hands})
    assert unstable_at_corners_hz(between, between.law.admittance) is None
    with pytest.raises(avc.NotDeployableError):
        admittance_files(between)


@pytest.mark.slow
def test_what_swings_or_states_no_limits_is_refused():
    problem = avc.load_admittance("admittance/cobot")
    swinging = problem.changed(law={"admittance": {"mass_kg": 40.0, "damping_ns_per_m": 10.0}})
    with pytest.raises(avc.NotDeployableError, match="unstable"):
        admittance_files(swinging)
    assert "NOT DEPLOYABLE" in admittance_files(swinging, unsafe=True)["avc_coupling.h"]
    limits = problem.changed(device={"max_speed_m_per_s": None, "force_sensor": {"max_force_n": None}})
    with pytest.raises(avc.InputError) as refused:
        admittance_files(limits)
    keys = {fault.key for fault in refused.value.faults}
    assert keys == {"device.max_speed_m_per_s", "device.force_sensor.max_force_n"}


def at_rest(problem, readings, noise_n=0.0, seed=0):
    """Velocities of a device at rest whose sensor reads noise, and what is given in between."""
    random = np.random.default_rng(seed)
    exported = Exported(problem)
    quiet = [noise_n * random.standard_normal() for _ in range(50)]
    after = [noise_n * random.standard_normal() for _ in range(6000)]
    velocities = [exported.step(0.0, reading) for reading in (*quiet, *readings, *after)]
    assert all(math.isfinite(velocity) for velocity in velocities)
    return np.array(velocities)


BAD = (math.nan, math.inf, -math.inf, 1e300, 200.0, -199.0, 60.0)


@pytest.mark.parametrize("bad", BAD)
def test_one_bad_reading_moves_nothing(bad):
    problem = avc.load_admittance("admittance/cobot")
    assert np.abs(at_rest(problem, [bad])).max() == 0
    assert np.abs(at_rest(problem, [bad, 0.0, -bad, 0.0, bad])).max() == 0


def test_a_hand_that_meets_the_stiffest_contact_at_a_metre_a_second_is_believed_under_noise():
    problem = avc.load_admittance("admittance/cobot")
    sensor, random = problem.device.force_sensor, np.random.default_rng(2)
    exported, period = Exported(problem), problem.device.sample_time_s
    stiffest = problem.hands.stiffness_n_per_m[1] + problem.contact.stiffness_n_per_m[1]
    rising = np.append(np.zeros(50), stiffest * 1.0 * period * np.arange(1, 16))
    noisy = rising + sensor.noise_rms_n * random.standard_normal(rising.size)
    forces = sensor.resolution_n * np.round(noisy / sensor.resolution_n)
    assert np.abs(forces).max() < sensor.max_force_n
    given = np.array([exported.step(0.0, force) for force in forces.tolist()])
    # A reading that were refused would hold the one before.
    expected = law_of(problem, [0.0, *forces[1:]], np.zeros(forces.size))
    assert np.abs(given - expected).max() <= 1e-12 * np.abs(expected).max()


@pytest.mark.parametrize("count", first([2, 3, 10]))
@pytest.mark.parametrize("force", first([40.0, 150.0, -199.0]))
def test_bad_readings_in_a_row_move_no_further_than_the_header_says(count, force):
    problem = avc.load_admittance("admittance/cobot")
    bounds = FaultBounds.of(problem, problem.law.admittance)
    velocities = at_rest(problem, [force] * count)
    moved = abs(float(velocities.sum())) * problem.device.sample_time_s
    assert 0 < moved <= count * bounds.push_m * (1 + 1e-9)
    assert np.abs(velocities).max() <= problem.device.max_speed_m_per_s


def test_without_readings_the_velocity_falls_to_0_and_comes_back_after_half_a_swing_of_good_ones():
    problem = avc.load_admittance("admittance/cobot")
    exported, period = Exported(problem), problem.device.sample_time_s
    moving = [exported.step(0.0, 2.0 + 0.01 * (sample % 2)) for sample in range(400)]
    lost = [exported.step(0.0, bad) for bad in [math.nan, 1e9, math.inf, 200.0] * 50]
    assert moving[-1] > 0.006
    assert lost[HELD_SAMPLES - 1] > 0.005
    stopped = HELD_SAMPLES + math.ceil(STOP_S / period) + 1
    assert np.abs(lost[stopped:]).max() == 0
    again = FaultBounds.of(problem, problem.law.admittance).again
    # A hand of 2 kg with the handle of 1 kg on 1 MN/m swings at 92 Hz: half a swing is 2.7 samples.
    assert again == 4
    # The first reading is refused for a jump.
    back = [exported.step(0.0, 2.0 + 0.1 * (sample % 2)) for sample in range(again + 2)]
    assert np.abs(back[:again]).max() == 0
    assert 0 < back[again] < back[again + 1]


def test_a_sensor_that_is_stuck_is_seen():
    problem = avc.load_admittance("admittance/cobot")
    bounds = FaultBounds.of(problem, problem.law.admittance)
    assert 0 < bounds.repeated < 20
    exported, period = Exported(problem), problem.device.sample_time_s
    velocities = np.array([exported.step(0.0, 1.5) for _ in range(300)])
    stopped = bounds.repeated + math.ceil(STOP_S / period) + 3
    assert np.abs(velocities[stopped:]).max() == 0
    assert velocities.sum() * period <= stopped * period * 1.5 / problem.law.admittance.damping_ns_per_m


def test_noise_on_steps_is_not_taken_for_a_stuck_sensor():
    problem = avc.load_admittance("admittance/cobot")
    sensor, random = problem.device.force_sensor, np.random.default_rng(1)
    exported = Exported(problem)
    noisy = 4.0 + sensor.noise_rms_n * random.standard_normal(200_000)
    readings = sensor.resolution_n * np.round(noisy / sensor.resolution_n)
    velocities = np.array([exported.step(0.0, reading) for reading in readings.tolist()])
    # Steady motion: a stop would be seen as a velocity of 0.
    assert velocities[2000:].min() > 0.5 * 4.0 / problem.law.admittance.damping_ns_per_m


@pytest.mark.parametrize("name", first(["admittance/cobot", "admittance/pedal"]))
def test_random_faults_never_exceed_the_limit_and_end(name):
    problem = avc.load_admittance(name)
    random = np.random.default_rng(7)
    full = problem.device.force_sensor.max_force_n
    for seed in range(10):
        kinds = [math.nan, math.inf, full, -full, 0.3 * full, 1e38, -1e38]
        readings = [kinds[random.integers(len(kinds))] if random.random() < 0.7 else 0.0 for _ in range(400)]
        velocities = at_rest(problem, readings, seed=seed)
        assert np.abs(velocities).max() <= problem.device.max_speed_m_per_s
        assert abs(velocities[-1]) < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("name", ["admittance/cobot", "admittance/pedal"])
def test_hands_come_to_rest_around_the_exported_law(name):
    """Thirty hands and contacts of the ranges push, hold and let go, in a plant of other code."""
    problem = avc.load_admittance(name)
    hands = problem.hands
    exported, random = Exported(problem, "single"), np.random.default_rng(3)
    for _ in range(30):
        kinds = random.random() < 0.5, random.random() < 0.5
        carried = [kinds[0] * random.uniform(*ends) for ends in (hands.mass_kg, hands.damping_ns_per_m)]
        spring = kinds[0] * random.uniform(*hands.stiffness_n_per_m)
        contact = kinds[1] * random.uniform(*problem.contact.stiffness_n_per_m)
        damper = kinds[1] * random.uniform(*problem.contact.damping_ns_per_m)
        plant = PlainDevice.of(problem, carried[0], carried[1] + damper, spring + contact)
        exported.start()
        assert settled(plant, exported, push_n=random.uniform(1.0, 8.0)), (carried, spring, contact)


def settled(plant, exported, push_n, seconds=20.0):
    """Whether the handle rests at the end: a push of half a second, then the hand or contact alone."""
    steps = max(20, math.ceil(6 * plant.sample_s * math.sqrt(plant.sensor_n_per_m / plant.handle_kg)))
    step, late = plant.sample_s / steps, int(plant.late_samples)
    # One sample of the motion per unit of it, of the command and of a push, by Runge and Kutta.
    moved_kg = plant.handle_kg + plant.hand_kg

    def rates(motion, command, push):
        found = plant.rates(motion, command)
        found[4] += push / moved_kg
        return found

    def advance(motion, command, push):
        for _ in range(steps):
            k1 = rates(motion, command, push)
            k2 = rates(motion + step / 2 * k1, command, push)
            k3 = rates(motion + step / 2 * k2, command, push)
            k4 = rates(motion + step * k3, command, push)
            motion = motion + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        return motion

    matrix = np.array([advance(unit, 0.0, 0.0) for unit in np.eye(5)]).T
    by_command, by_push = advance(np.zeros(5), 1.0, 0.0), advance(np.zeros(5), 0.0, 1.0)
    motion, past, speeds = np.zeros(5), [0.0] * (late + 1), []
    samples = round(seconds / plant.sample_s)
    for sample in range(samples):
        command = exported.step(motion[0], plant.force(motion))
        past = [command, *past][: late + 1]
        push = push_n if sample < 0.5 / plant.sample_s else 0.0
        motion = matrix @ motion + by_command * past[late] + by_push * push
        speeds.append(max(abs(motion[1]), abs(motion[4])))
    tenth = samples // 10
    return max(speeds[-tenth:]) < 0.02 * max(speeds)


SWINGING = {
    "device": {
        "drive": "velocity",
        "drive_bandwidth_hz": 65.6,
        "sample_time_s": 2e-3,
        "delay_samples": 2.84,
        "max_speed_m_per_s": 0.43,
        "force_sensor": {
            "stiffness_n_per_m": 112e3,
            "damping_ratio": 0.052,
            "handle_mass_kg": 1.67,
            "noise_rms_n": 0.19,
            "resolution_n": 0.12,
            "max_force_n": 967.0,
        },
    },
    "law": {"admittance": {"mass_kg": 2.66, "damping_ns_per_m": 26.5, "cutoff_hz": 12.0}},
    "hands": {"mass_kg": [0.32, 0.34], "damping_ns_per_m": [46.0, 58.0], "stiffness_n_per_m": [75.0, 2460.0]},
    "contact": {"stiffness_n_per_m": [0.0, 1287.0], "damping_ns_per_m": [0.6, 2.0]},
}
"""A handle that swings on its sensor by 30 degrees in a sample: its force jumps, but for its peaks."""


@pytest.mark.slow
@pytest.mark.parametrize("struck_m_per_s", [0.1, 1.0])
def test_a_handle_that_is_struck_does_not_swing_on_by_what_the_step_refuses(struck_m_per_s):
    """Peaks that were believed, with the readings between them refused, drove this handle at 0.25 m/s for ever."""
    problem = avc.AdmittanceProblem.model_validate(SWINGING)
    hands, random = np.array([[0.0, 0.0, 0.0], [0.33, 50.0, 1000.0]]), np.random.default_rng(1)
    plant = PushedHandles(problem, hands, np.array([[1.0, 1200.0]] * 2))
    plant.held[0] = False
    exported, sensor = [Exported(problem), Exported(problem)], problem.device.force_sensor
    plant.state[:, HANDLE_SPEED] = struck_m_per_s
    speeds = []
    for _ in range(3000):
        noisy = plant.force() + sensor.noise_rms_n * random.standard_normal(2)
        readings = sensor.resolution_n * np.round(noisy / sensor.resolution_n)
        commands = [law.step(*pair) for law, *pair in zip(exported, plant.state[:, 0], readings, strict=True)]
        plant.move(commands, 0.0, 0.0)
        speeds.append(np.abs(plant.state[:, [1, HANDLE_SPEED]]).max())
    assert max(speeds[-250:]) < 5e-3


@pytest.mark.parametrize(("name", "returns"), first([("admittance/pedal", True), ("admittance/cobot", False)]))
def test_with_a_spring_the_device_returns_to_its_rest_position_as_the_header_says(name, returns):
    problem = avc.load_admittance(name)
    exported = Exported(problem)
    header = " ".join(admittance_files(problem)["avc_coupling.h"].replace(" * ", " ").split())
    assert ("returns to its rest position, position 0" in header) == returns
    assert ("moves the rest position by 0.000125 m for each N" in header) == returns
    period_s, start_m = problem.device.sample_time_s, 0.01
    position_m = start_m
    for sample in range(3000):
        # Noise of one step, without which the sensor counts as stuck.
        position_m += period_s * exported.step(position_m, 0.05 * (-1) ** sample)
    assert position_m == pytest.approx(0.0 if returns else start_m, abs=1e-4)


def test_an_offset_moves_the_rest_position_as_far_as_the_header_says():
    problem = avc.load_admittance("admittance/pedal")
    exported = Exported(problem)
    position_m = 0.0
    for sample in range(5000):
        position_m += problem.device.sample_time_s * exported.step(position_m, 8.0 + 0.05 * (-1) ** sample)
    assert position_m == pytest.approx(8.0 / 8000.0, rel=1e-3)
