"""The exported C of a stated law: the simulation's forces to single precision, and nothing of a sensor that fails."""

import json
import math

import numpy as np
import pytest
from exported import C99, CLANG_CPP17, Exported
from exported_bench import ran
from exported_law import MORE_WARNINGS, positions, rounding_n, sanitized, simulated
from faulty_sensor import FaultySensor
from hardware_bench import export_c
from quick import first
from stated_law import drawn_law

import avc_casadi as avc
import avc_hardware
from avc_casadi.cli import main
from avc_casadi.files.problem_file import load_any
from avc_hardware.codegen.sensor import fade_samples

SAMPLES = 20_000
FEW = 3000
DIGITS = 20.0
"""Last digits of single precision by which forces may differ."""


def forces_of(problem, way, compiler=C99):
    return Exported(problem, compiler=compiler, flags=MORE_WARNINGS if compiler is C99 else ()).forces(way)


@pytest.mark.parametrize(
    ("seed", "samples"),
    [(3, FEW), *(pytest.param(seed, SAMPLES, marks=pytest.mark.slow) for seed in (0, 2, 5))],
)
def test_c_is_the_simulation_to_single_precision(seed, samples):
    problem = load_any(drawn_law(seed))
    way = positions(problem, seed, samples)
    expected = simulated(problem, way)
    assert np.ptp(expected) > 0.01
    assert np.abs(forces_of(problem, way) - expected).max() < DIGITS * rounding_n(problem, way)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 4, 7])
def test_sanitizers_cpp_and_arm_give_the_same_bits(seed):
    problem = load_any(drawn_law(seed))
    way = positions(problem, seed, 2000)
    forces = forces_of(problem, way)
    assert forces.tobytes() == forces_of(problem, way, CLANG_CPP17).tobytes()
    assert forces.tobytes() == sanitized(problem, way).tobytes()
    for board in ("Cortex-M0", "Cortex-M4F"):
        assert ran(board, problem, way[None, :300]).forces.tobytes() == forces[:300].tobytes()


SLOW = {"kind": "low-pass", "cutoff_hz": 0.5, "order": 2}
NOTCH = {"kind": "notch", "frequency_hz": 0.5, "depth": 0.1, "width": 0.5}


@pytest.mark.parametrize("item", first([SLOW, NOTCH, {"kind": "low-pass", "cutoff_hz": 0.05}]))
def test_filters_that_are_slow_beside_the_sample_rate_keep_their_digits(item):
    tables = drawn_law(0)
    tables["law"] = {"stiffness_n_per_m": 500.0, "filters": [item]}
    problem = load_any(tables)
    way = positions(problem, 3, 2 * FEW)
    expected = simulated(problem, way)
    assert np.abs(forces_of(problem, way) - expected).max() < 1e-5 * np.abs(expected).max()


LAW = {
    "stiffness_n_per_m": 900.0,
    "damping_ns_per_m": 4.0,
    "local_damping_ns_per_m": 0.5,
    "friction_compensation": {"force_n": 0.1, "velocity_m_per_s": 0.02},
}
DEVICE = {"mass_kg": 0.12, "damping_ns_per_m": 0.8, "encoder_resolution_m": 2e-5, "max_force_n": 8.0}
WALL = {"stiffness_n_per_m": 1000.0, "damping_ns_per_m": 0.0}
WALLED = load_any({"device": DEVICE, "law": LAW, "environment": WALL})
SERVO = load_any({"device": DEVICE, "law": LAW})


@pytest.mark.parametrize("wrong_m", [0.1, -1.0, math.nan, -3e38])
def test_wrong_samples_at_rest_give_no_force(wrong_m):
    walled, servo = Exported(WALLED), Exported(SERVO)
    for lasts in (1, 2, 30):
        outside = np.full(150, -5e-3)
        outside[50 : 50 + lasts] += wrong_m
        walled.start()
        assert np.abs(walled.forces(outside)).max() == 0
        held = np.full(250, 2e-3)
        held[100 : 100 + lasts] += wrong_m
        servo.start()
        forces = servo.forces(held)
        assert np.abs(forces[100 : 100 + lasts]).max() == 0
        assert np.isfinite(forces).all()
        assert np.abs(forces).max() <= 1.8001
        assert forces[-1] == pytest.approx(1.8)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [8, 14])
def test_a_sensor_that_fails_before_a_wall_gives_no_force_at_rest(seed):
    """Local damper, virtual mass and friction compensation act outside too; the device rests there."""
    problem = load_any(drawn_law(seed))
    assert problem.law_in_wall
    assert problem.law.acts_outside
    plant = FaultySensor(problem.device, export_c(problem))
    for kind in ("glitch", "no number", "elsewhere", "dropped"):
        assert plant.meets(kind, 200, seed, thrown=False).outside_n.max() == 0


def test_a_law_on_both_sides_begins_without_force_and_rises():
    forces = Exported(SERVO).forces(np.full(200, -5e-3))
    fade = fade_samples(SERVO.device)
    assert forces[0] == pytest.approx(-4.5 / fade, rel=1e-5)
    assert forces[fade - 1 :] == pytest.approx(-4.5, rel=1e-5)


def test_noise_of_any_kind_is_finite_and_limited():
    draw = np.random.default_rng(1)
    for problem in (WALLED, SERVO):
        device = Exported(problem)
        for scale in (1e-4, 1e-2, 10.0):
            forces = device.forces(scale * draw.standard_normal(3000))
            assert np.isfinite(forces).all()
            assert np.abs(forces).max() <= 8.0


@pytest.mark.slow
def test_what_is_not_deployable_is_refused(tmp_path, capsys):
    stiff = load_any({"device": DEVICE, "law": {**LAW, "stiffness_n_per_m": 1e6, "friction_compensation": None}})
    with pytest.raises(avc.NotDeployableError, match=r"\[law\]: not deployable: unstable"):
        avc_hardware.export_c(stiff)
    assert "UNSAFE, written by request: not deployable" in avc_hardware.export_c(stiff, unsafe=True)["avc_coupling.h"]
    with pytest.raises(avc.InputError, match=r"allowed: a table \[law\]"):
        avc_hardware.export_c(SERVO.changed(law=None), unsafe=True)
    file = tmp_path / "own.toml"
    file.write_text(
        "[device]\nmass_kg = 0.12\ndamping_ns_per_m = 0.8\n"
        "[law]\nstiffness_n_per_m = 900.0\ndamping_ns_per_m = 4.0\n"
        'filters = [{ kind = "notch", frequency_hz = 150.0 }]\n',
        encoding="utf-8",
    )
    assert main(["export", str(file), "--c", str(tmp_path / "c"), "--json"]) == 0
    written = json.loads(capsys.readouterr().out)
    assert written["passed"]
    header = (tmp_path / "c" / "avc_coupling.h").read_text(encoding="ascii")
    assert "filters [kind notch, frequency_hz 150, depth 0.1, width 0.5]" in " ".join(header.replace(" *", "").split())
    assert f"Law {written['law']} for own" in header
    assert main(["export", str(file), "--parameters", "mujoco"]) == 2
