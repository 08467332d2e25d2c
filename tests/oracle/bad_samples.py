"""The exported C of couplings behind a sensor that tells nonsense, and before fast hands: `bad_samples.c`, compiled."""

from __future__ import annotations

import math
import tempfile
from dataclasses import dataclass
from pathlib import Path

from exported import WARNINGS
from hardware_bench import export_c, require, run, scratch

from avc_casadi.coupling import Coupling

_SOURCE = Path(__file__).with_name("bad_samples.c")
PLAIN = ("gcc", "-std=c99", "-O2")
SANITIZED = (
    *("clang", "-std=c99", "-O1", "-g"),
    *("-fsanitize=address,undefined,float-divide-by-zero", "-fno-sanitize-recover=all"),
)
UNDECLARED_STEP_M = 1e-6
"""Of an encoder that the problem does not declare, at the handle."""


@dataclass(frozen=True)
class BadSamples:
    """What came of bad samples in a row, the device at rest outside."""

    largest_n: float  # beyond what a sound sensor gives there
    forces: int  # runs with more force than that
    bad: int


@dataclass(frozen=True)
class Strikes:
    """What came of hands that struck."""

    samples: int
    refused: int
    largest_n: float


class BadSensor:
    """The exported C of a coupling to any end, built once."""

    def __init__(self, coupling: Coupling, build: tuple[str, ...] = PLAIN) -> None:
        require(build[0])
        problem = coupling.problem
        self._device = problem.device
        end, scale = "WALL", 1.0
        if problem.simulation is not None:
            end = "HELD" if problem.simulation.exchange == "held-force" else "ENGINE"
            scale = problem.simulation.position_scale
        elif problem.follower is not None:
            end, scale = "FOLLOWER", problem.follower.position_scale
        folder = Path(tempfile.mkdtemp(dir=scratch()))
        for name, text in export_c(coupling).items():
            (folder / name).write_text(text, encoding="ascii")
        tool, *options = build
        sources = (str(folder / "avc_coupling.c"), str(_SOURCE))
        self._program = str(folder / "bad")
        flags = (f"-DEND={end}", f"-DSCALE={scale!r}", f"-I{folder}", *WARNINGS, "-ffp-contract=off")
        run(tool, *options, *flags, *sources, "-lm", "-o", self._program)

    def _told(self, *words: object) -> list[float]:
        return [float(word) for word in run(self._program, *map(str, words)).split()]

    def _step(self) -> float:
        return self._device.encoder_resolution_m or UNDECLARED_STEP_M / self._device.metres_per_unit

    def bad_samples(self, runs: int, seed: int = 1) -> BadSamples:
        """Let the sensor of a device at rest tell up to six bad samples in a row, up to three times in each run."""
        largest_n, forces, bad = self._told("bad", runs, seed, self._step(), self._device.metres_per_unit)
        return BadSamples(largest_n, int(forces), int(bad))

    def strikes(self, runs: int, speeds_m_per_s: tuple[float, float], seed: int = 1) -> Strikes:
        """Let hands strike at speeds of a range."""
        device = self._device
        where = (self._step(), device.metres_per_unit, *speeds_m_per_s)
        mechanics = (device.mass_kg, device.damping_ns_per_m, device.sample_time_s, math.ceil(device.delay_samples))
        samples, refused, largest_n = self._told("strike", runs, seed, *where, *mechanics)
        return Strikes(int(samples), int(refused), largest_n)
