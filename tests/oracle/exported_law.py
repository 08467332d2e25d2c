"""The exported C of a law beside its simulation in double precision: forces at wandering positions."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from exported import WARNINGS
from hardware_bench import export_c, require, run, scratch
from numpy.typing import NDArray
from stated_law import StatedLaw, wandering

from avc_casadi import Problem
from avc_hardware.codegen.sensor import fade_samples

MORE_WARNINGS = (
    *WARNINGS,
    *("-Wshadow", "-Wstrict-prototypes", "-Wmissing-prototypes", "-Wdouble-promotion", "-Wundef", "-Wcast-qual"),
)
SANITIZED = (
    *("clang", "-std=c99", "-O1", "-g"),
    *("-fsanitize=address,undefined,float-divide-by-zero,integer", "-fno-sanitize-recover=all"),
)
_MAIN = """
#include "avc_coupling.h"
#include <stdio.h>
int main(void)
{
    static avc_coupling_t coupling;
    float position_m;
    avc_coupling_start(&coupling);
    while (fread(&position_m, sizeof position_m, 1, stdin) == 1) {
        const float force_n = avc_coupling_step(&coupling, position_m);
        fwrite(&force_n, sizeof force_n, 1, stdout);
    }
    return 0;
}
"""


def positions(problem: Problem, seed: int, samples: int) -> NDArray[np.float64]:
    """Return positions in steps of the encoder that begin outside of a wall, or at 0."""
    step = problem.device.encoder_resolution_m
    way = wandering(seed, samples, step)
    return np.asarray(way - way[0] - (step * 50 if problem.law_in_wall else 0.0))


def simulated(problem: Problem, way: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the forces of the law that is written out, limited; on both sides of 0 they rise from 0 at first."""
    device = problem.device
    law = StatedLaw(problem.law, device.sample_time_s, problem.law_in_wall, float(way[0]))
    forces = np.array([law.force(x) for x in way])
    limit = device.max_force_n or np.inf
    forces = np.clip(forces, -limit, limit)
    if not problem.law_in_wall:
        fade = fade_samples(device)
        forces[:fade] *= np.arange(1, fade + 1) / fade
    return forces


def rounding_n(problem: Problem, way: NDArray[np.float64]) -> float:
    """Return what the last digit of single precision makes of the positions, by the steepest gain.

    Gains of a sample are those of the spring, of dampers over the time of a sample, and of masses over its square;
    filters of a gain above 1 and sums of thousands of samples add some more of it.
    """
    law = problem.law
    period = law.period_s(problem.device.sample_time_s)
    own = law.friction_compensation
    slope = 0.0 if own is None else own.force_n / own.velocity_m_per_s
    dampers = law.damping_ns_per_m + abs(law.local_damping_ns_per_m) + slope
    gain = law.stiffness_n_per_m + 2 * dampers / period + 4 * abs(law.virtual_mass_kg) / period**2
    digit = np.finfo(np.float32).eps
    return float(digit * (gain * np.abs(way).max() + (problem.device.max_force_n or 1.0)))


def sanitized(problem: Problem, way: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return the forces of a program with every sanitizer of clang."""
    require("clang")
    folder = Path(tempfile.mkdtemp(dir=scratch()))
    for name, text in {**export_c(problem), "main.c": _MAIN}.items():
        (folder / name).write_text(text, encoding="ascii")
    tool, *options = SANITIZED
    sources = [str(folder / name) for name in ("main.c", "avc_coupling.c")]
    run(tool, *options, *MORE_WARNINGS, *sources, "-o", str(folder / "law"))
    fed, heard = folder / "positions", folder / "forces"
    fed.write_bytes(way.astype(np.float32).tobytes())
    run("sh", "-c", f"{folder / 'law'} < {fed} > {heard}")
    return np.frombuffer(heard.read_bytes(), dtype=np.float32)
