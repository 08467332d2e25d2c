"""The C++ examples run against stubs of CHAI3D, OpenHaptics and Haply's API: the coupling's forces, out of the wall."""

import os
import re
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import pytest
from exported import WARNINGS, Exported
from hardware_bench import coupling, export_c, require, run, scratch

from avc_casadi._util.arrays import FloatArray
from avc_casadi.coupling import Coupling
from avc_casadi.model.runtime import Runtime

STUBS = Path(__file__).parent / "stub_devices"
# Of each example: a point of its wall (m), the normal out of it, and what it is called with.
WALLS = {
    "chai3d": ((0.0, 0.0, -0.02), (0.0, 0.0, 1.0), ()),
    "openhaptics": ((0.0, -0.02, 0.0), (0.0, 1.0, 0.0), ()),
    "haply": ((0.0, 0.0, 0.17), (0.0, 0.0, 1.0), ("port",)),
}


def made(sample_time_s: float = 1e-3) -> Coupling:
    return coupling(
        1,
        largest=(300.0, 1e4, 50.0),
        wall=(5.0, 5e3),
        runtime=Runtime(observer_mass_kg=0.25),
        encoder_resolution_m=2e-5,
        delay_samples=1,
        max_force_n=10.0,
        sample_time_s=sample_time_s,
    )


def built(name: str, what: Coupling, compiler: str = "g++", precision: str = "single") -> Path:
    require(compiler)
    folder = Path(tempfile.mkdtemp(dir=scratch()))
    for place, text in export_c(what, packages=(name,), precision=precision).items():
        (folder / place).parent.mkdir(parents=True, exist_ok=True)
        (folder / place).write_text(text, encoding="ascii")
    program = folder / name
    stubs = ("-include", str(STUBS / "recorded_device.hpp"), f"-I{STUBS}", f"-I{folder / 'src'}")
    sources = (str(folder / "examples" / f"{name}.cpp"), "-x", "c++", str(folder / "src" / "avc_coupling.c"))
    run(compiler, "-std=c++11", "-O1", *WARNINGS, *stubs, *sources, "-o", str(program))
    return program


def played(program: Path, name: str, positions_m: FloatArray, took_us: FloatArray) -> tuple[FloatArray, str, int]:
    """Run it on recorded positions, shape (n, 3); returns forces, shape (m, 3), what it says, and its exit code."""
    lines = [[*map(float.hex, row), float(took).hex()] for row, took in zip(positions_m, took_us, strict=True)]
    file = program.with_suffix(".positions")
    file.write_text("\n".join(" ".join(line) for line in lines) + "\n", encoding="ascii")
    done = subprocess.run(  # noqa: S603 - ours
        [program, *WALLS[name][2]],
        env=os.environ | {"AVC_POSITIONS": str(file)},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
        timeout=600,
    )
    forces = [[float.fromhex(word) for word in line.split()[1:]] for line in re.findall("force .*", done.stdout)]
    return np.array(forces).reshape(-1, 3), done.stderr, done.returncode


def strokes(name: str, samples: int = 300) -> tuple[FloatArray, FloatArray]:
    """Positions (n, 3) that begin inside the wall, go out and tap it, and move along it; and how deep they are."""
    point, normal, _ = WALLS[name]
    time = np.arange(samples) * 1e-3
    depth = np.where(time < 0.02, 1e-3, 2e-3 * np.sin(2 * np.pi * 9 * time))
    along = np.roll(normal, 1) * 0.01 * np.cos(20 * time)[:, None] + np.roll(normal, 2) * 0.02 * time[:, None]
    positions = (np.array(point) - depth[:, None] * np.array(normal) + along).astype(np.float32).astype(float)
    # OpenHaptics' millimetres, and back.
    read = 1e-3 * (1000.0 * positions) if name == "openhaptics" else positions
    return positions, -((read - np.array(point)) @ np.array(normal))


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("name", "compiler", "precision"),
    [("chai3d", "g++", "single"), ("openhaptics", "clang++", "double"), ("haply", "g++", "single")],
)
def test_forces_are_the_couplings_along_the_normal(name: str, compiler: str, precision: str) -> None:
    positions, depth = strokes(name)
    took_us = np.full(len(positions), 0.0 if name == "openhaptics" else 500.0)
    forces, said, _ = played(built(name, made(), compiler, precision), name, positions, took_us)
    outside = int(np.argmax(depth <= 0))
    assert outside > 10
    device = Exported(made(), precision=precision)
    expected = np.concatenate([np.zeros(outside), device.forces(depth[outside:]).astype(float)])
    assert expected.max() > 1
    # Haply's answer is a sample later; then every example lets go.
    expected = np.concatenate([np.zeros(int(name == "haply")), expected, [0.0]])
    assert np.array_equal(forces, expected[:, None] * np.array(WALLS[name][1]))
    assert "does not answer" in said


@pytest.mark.thorough
@pytest.mark.parametrize(("name", "pause_us"), [("chai3d", 1500.0), ("haply", 1500.0), ("openhaptics", 400.0)])
def test_a_computer_too_slow_is_told_and_lets_go(name: str, pause_us: float) -> None:
    """Half a sample late every time, or a scheduler whose sample is 0.4 longer; then fifteen samples at once.

    One in 150 is let pass.
    """
    program = built(name, made())
    positions, _ = strokes(name)
    for pauses in (np.full(300, pause_us), np.where(np.arange(300) == 150, 15_000.0, 10.0)):
        forces, said, _ = played(program, name, positions, pauses)
        assert 10 < len(forces) < 200
        assert (forces[-1] == 0).all()
        assert "does not keep the coupling's sample time" in said
    single, said, _ = played(program, name, positions, np.where(np.arange(300) % 150 == 100, 1100.0, 10.0))
    assert len(single) >= 300
    assert "does not answer" in said


def test_a_rate_that_the_scheduler_lacks_is_refused() -> None:
    forces, said, code = played(built("openhaptics", made(1 / 1500)), "openhaptics", np.zeros((5, 3)), np.zeros(5))
    assert code == 1
    assert len(forces) == 0
    assert "no such rate" in said
