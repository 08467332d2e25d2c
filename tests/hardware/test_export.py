"""The exported C is the scene's coupling: the bits of its expressions in either precision, on every compiler."""

import dataclasses
import functools
import re

import numpy as np
import pytest
from exported import C99, CLANG, CLANG_CPP17, CPP11, WARNINGS, Exported
from exported_cases import drawn, motions
from hardware_bench import believer, bench_problem, export_c, require, with_gains
from reference_coupling import ReferenceCoupling

import avc_casadi as avc
from avc_casadi._util.arrays import FloatArray
from avc_casadi.model.effects import DelayEffect, EncoderEffect, HandEffect, SaturationEffect, WallEffect
from avc_casadi.model.runtime import Runtime
from avc_casadi.simulation.emit import PRECISIONS

SEEDS = range(22)


@functools.cache
def reference(seed: int, precision: str) -> FloatArray:
    made = drawn(seed)
    ways = motions(made)
    devices = ReferenceCoupling(made, len(ways), PRECISIONS[precision])
    return np.stack([devices.step(column) for column in ways.T], axis=1)


def check_bits(seed: int, compiler: tuple[str, ...], precision: str) -> None:
    made, expected = drawn(seed), reference(seed, precision)
    device = Exported(made, compiler=compiler, precision=precision)
    for way, forces in zip(motions(made), expected, strict=True):
        device.start()
        assert device.forces(way).tobytes() == forces.tobytes()


@pytest.mark.thorough
@pytest.mark.one_of(2)
@pytest.mark.parametrize("seed", SEEDS)
def test_compiled_coupling_gives_the_bits_of_the_expressions(seed: int) -> None:
    for compiler in (C99, (CPP11, CLANG, CLANG_CPP17)[seed % 3]):
        check_bits(seed, compiler, "single")


@pytest.mark.thorough
@pytest.mark.one_of(2)
@pytest.mark.parametrize("seed", SEEDS[1::4])
def test_double_precision_gives_the_bits_of_the_expressions(seed: int) -> None:
    check_bits(seed, (C99, CPP11, CLANG, CLANG_CPP17)[seed // 4 % 4], "double")


@pytest.mark.thorough
@pytest.mark.one_of(2)
@pytest.mark.parametrize("seed", SEEDS)
def test_force_is_a_number_within_its_limit_and_pushes(seed: int) -> None:
    made, forces = drawn(seed), reference(seed, "single")
    assert np.isfinite(forces).all()
    assert (forces[3][[40, 41, 90, 150, 151, 220, 300]] == 0).all()
    assert (forces[:3] > 0).any()
    if made.max_force_n is not None:
        assert np.abs(forces).max() <= np.float32(made.max_force_n)
    if made.runtime.guard is None:
        assert forces.min() >= 0


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [1, 4, 7, 10])
def test_an_int_of_16_bits_is_enough(seed: int) -> None:
    """Where an int is a short the bits stay: no index and no number of the program needs more."""
    made = drawn(seed)
    device = Exported(made, flags=("-Dint=short",))
    for way, forces in zip(motions(made), reference(seed, "single"), strict=True):
        device.start()
        assert device.forces(way).tobytes() == forces.tobytes()
    for text in export_c(made).values():
        code = re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)
        whole = re.findall(r"(?<![\w.+-])(\d+)u?(?![\w.])", code)
        assert all(int(number) < 2**15 for number in whole)
        assert not re.search(r"\b(long|double|size_t|malloc|memcpy|math\.h)\b", code)
        assert set(re.findall(r"#include (\S+)", code)) <= {'"avc_coupling.h"', "<stdbool.h>", "<avr/pgmspace.h>"}


def test_start_forgets() -> None:
    made = drawn(7)
    device = Exported(made)
    way = motions(made)[0] - 1e-4  # begins outside
    first = device.forces(way)
    assert device.forces(way).tobytes() != first.tobytes()
    device.start()
    assert device.forces(way).tobytes() == first.tobytes()


RUNTIMES = {
    "nothing": Runtime("zero-crossing"),
    "observer": Runtime("zero-crossing", observer_mass_kg=0.25),
    "controller": Runtime("zero-crossing", guard="passivity-controller"),
    "state feedback": Runtime("zero-crossing", state_feedback=believer(3)),
    "observer and tank": Runtime("zero-crossing", observer_mass_kg=0.25, guard="energy-tank"),
}


# Largest difference, and the mean square's root, against the largest force: in single precision a step of the look-up's
# frequency that falls the other way moves a force for some samples.
AGREES = {"single": (5e-2, 2e-3), "double": (1e-9, 1e-10)}


@pytest.mark.thorough
@pytest.mark.one_of(3)
@pytest.mark.parametrize(("delay", "contact"), [(0, "gated"), (2, "gated"), (0, "clip-last"), (2, "clip-last")])
@pytest.mark.parametrize("varies", [False, True], ids=["constant", "table"])
@pytest.mark.parametrize("name", RUNTIMES)
def test_export_feels_like_the_scene_in_double_precision(name: str, *, varies: bool, delay: int, contact: str) -> None:
    """The scene's own run, its measured positions given to the exports: the scene's forces, but for the precision."""
    effects = [HandEffect(), WallEffect(), EncoderEffect(), SaturationEffect()] + [DelayEffect()] * (delay > 0)
    motion = {"kind": "tap", "end_m": 0.004, "frequency_hz": 3.0}
    problem = bench_problem((5.0, 5e3), delay_samples=delay, encoder_resolution_m=2e-5, max_force_n=30.0).changed(
        scene={"effects": tuple(effects), "motion": motion, "duration_s": 1.5}, coupling={"contact": contact}
    )
    constant = with_gains(problem, 5.0, 4e3, 3.0)
    made = dataclasses.replace(constant, runtime=RUNTIMES[name])
    if varies:
        rows = np.array([[1.0, 5.0, 4e3, 3.0], [3.0, 8.0, 3e3, 3.0], [50.0, 3.0, 5e3, 1.0]])
        made = dataclasses.replace(made, table=dataclasses.replace(made.table, rows=rows))
    scene = avc.simulate(problem, made)
    assert scene.samples_in_reach == scene.samples
    measured = 2e-5 * np.floor(scene.position_m / 2e-5 + 0.5)
    asked = scene.force_n[delay:]
    assert asked.max() > 2
    for precision in ("single", "double")[: 1 + (delay > 0)]:
        worst, mean = AGREES[precision]
        force = Exported(made, precision=precision).forces(measured)
        difference = np.abs(force[: len(asked)] - asked)
        assert difference.max() < worst * asked.max()
        assert np.sqrt(np.mean(difference**2)) < mean * asked.max()


def test_fast_math_is_refused() -> None:
    require("gcc")
    with pytest.raises(AssertionError, match="compile without -ffast-math"):
        Exported(drawn(0), flags=(*WARNINGS, "-ffast-math"))
