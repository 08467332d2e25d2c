"""The exported C of couplings behind a sensor that tells nonsense, and before fast hands: `bad_samples.c`, compiled."""

from __future__ import annotations

import dataclasses
import math
import tempfile
from dataclasses import dataclass
from pathlib import Path

from exported import WARNINGS
from exported_cases import drawn
from exported_teleoperator import teleoperator_coupling
from exported_tool import tool_coupling
from hardware_bench import bench_problem, export_c, require, run, scratch, with_gains

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.model.runtime import Runtime

_SOURCE = Path(__file__).with_name("bad_samples.c")
_COMMITTED = Path(__file__).resolve().parents[1] / "goldens" / "couplings"
PLAIN = ("gcc", "-std=c99", "-O1")  # half the time of -O2, and the same bits
SANITIZED = (
    *("clang", "-std=c99", "-O1", "-g"),
    *("-fsanitize=address,undefined,float-divide-by-zero", "-fno-sanitize-recover=all"),
)
UNDECLARED_STEP_M = 1e-6
"""Of an encoder that the problem does not declare, at the handle."""


_WHEEL = """
[device]
motion = "rotary"
handle_radius_m = 0.15
inertia_kgm2 = 0.03
damping_nms_per_rad = 0.2
max_torque_nm = 8.0
encoder_resolution_rad = 1e-4
[environment]
stiffness_nm_per_rad = 60.0
damping_nms_per_rad = 0.2
"""
_TOOL = "tool_mass_kg = 0.2\nstep_s = 0.002\n"
_FOLLOWER = "mass_kg = 0.3\ndamping_ns_per_m = 1.0\ndelay_samples = 1\ndelay_s = 0.002\nreturn_delay_s = 0.002\n"


def laws_of_each_kind() -> dict[str, Coupling]:
    """Couplings of every kind, on catalogue devices, on drawn ones, and on those at the ends of rate and encoder."""
    readme = bench_problem(
        (0.0, 3e3), mass_kg=0.12, damping_ns_per_m=0.8, delay_samples=1, encoder_resolution_m=2e-5, max_force_n=8.0
    )
    fast = bench_problem((0.0, 3e3), sample_time_s=1e-4, encoder_resolution_m=1e-4, max_force_n=8.0)
    light = bench_problem((0.0, 3e3), sample_time_s=2e-3, mass_kg=0.02, encoder_resolution_m=0.0, max_force_n=None)
    observer = with_gains(fast, 1.0, 3e3)
    tank = with_gains(light, 1.0, 3e3)
    return {
        "README wall, spring and damper": with_gains(readme, 1.0, 3e3),
        "README wall, contact damper": avc.read_coupling(_COMMITTED / "wall.json"),
        "figure 5, series, a table": avc.read_coupling(_COMMITTED / "figure5-direct.json"),
        "reference-r1, state feedback": avc.read_coupling(_COMMITTED / "reference-r1.json"),
        "drawn, state feedback, 0.69 ms": drawn(16),
        "drawn, a table, observer, tank, 0.24 ms": drawn(2),
        "100 um, 0.1 ms, observer": dataclasses.replace(observer, runtime=Runtime(observer_mass_kg=0.25)),
        "20 g, no limit, no encoder, 2 ms, guard": dataclasses.replace(
            tank, runtime=Runtime(guard="passivity-controller")
        ),
        "wheel": with_gains(avc.parse_problem(_WHEEL), 0.02, 60.0),
        "engine": tool_coupling(_TOOL, 2000.0, 15.0),
        "engine, held force": tool_coupling(f'{_TOOL}exchange = "held-force"\n', 300.0, 3.0, 4.0),
        "follower": teleoperator_coupling(_FOLLOWER, 800.0, 6.0, 2.0),
    }


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
