"""Speed and accuracy of scenes against a plain Python loop, a numba loop and scipy's solve_ivp, in one run.

Run from the root of the checkout: python tests/benchmarks/bench_scene_speed.py. With --write it overwrites
RESULTS_scene_speed.md beside this file. numba is optional: without it its rows are left out.
"""

from __future__ import annotations

import os
import platform
import sys
import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE.parents[1])]

import casadi as ca  # noqa: E402
import numpy as np  # noqa: E402
from scene_reference import Reference, scene_problem  # noqa: E402
from script_arguments import script_arguments  # noqa: E402
from studies.accuracy.integrators import integrator_accuracy  # noqa: E402

import avc_casadi as avc  # noqa: E402
from avc_casadi.model.gains import Gains  # noqa: E402
from avc_casadi.model.hands import Hand  # noqa: E402
from avc_casadi.simulation.compile import compile_scene  # noqa: E402
from avc_casadi.simulation.effects.registry import build_effects  # noqa: E402
from avc_casadi.simulation.execute import execute  # noqa: E402
from avc_casadi.simulation.native import NativeScene  # noqa: E402
from avc_casadi.simulation.scene import compile_for, settled  # noqa: E402
from avc_casadi.simulation.screen import ns_per_step  # noqa: E402

try:
    from numba import njit
except ImportError:
    njit = None

HAND, WALL = 'kind = "hand"', 'kind = "wall"'
FRICTION, ENCODER = 'kind = "coulomb-friction"', 'kind = "encoder"'
GAINS = Gains(10.0, 7e3)
WALL_K, WALL_B, T = 1e5, 10.0, 1e-3
SAMPLES, REFERENCE_SAMPLES = 3000, 600


def best(work: Callable[[], object], repeats: int) -> float:
    """Return the least processor time of some repeats, s; others may share the machine."""
    times = []
    for _ in range(repeats):
        started = time.process_time()
        work()
        times.append(time.process_time() - started)
    return min(times)


def plain_loop(
    target: np.ndarray, moves: np.ndarray, step: tuple[float, float, float, float, float], x: float
) -> np.ndarray:
    """The same linear scene as people write it: transition matrix and coupling, sample by sample."""
    memory, compliance, series, gain_e, share_e = step
    v, stretch, surface = 0.0, 0.0, 0.0
    out = np.empty(len(target) - 1)
    for k in range(len(target) - 1):
        out[k] = x
        free = x - memory * (stretch / 1e-3)
        force = series * (free - share_e * surface * gain_e)
        force = max(force, 0.0)
        tool = free - compliance * force
        stretch, surface = x - tool, max(tool, 0.0)
        vh = (target[k + 1] - target[k]) / 1e-3
        x, v = (
            moves[0, 0] * x + moves[0, 1] * v + moves[0, 2] * force + moves[0, 3] * target[k] + moves[0, 4] * vh,
            moves[1, 0] * x + moves[1, 1] * v + moves[1, 2] * force + moves[1, 3] * target[k] + moves[1, 4] * vh,
        )
    return out


def euler_loop(target: np.ndarray, hand: tuple[float, float, float], x: float) -> np.ndarray:
    """One semi-implicit Euler step a sample: what a scene must not be."""
    mass, damping, stiffness = hand[0] + 0.1, hand[1], hand[2]
    v, stretch, surface = 0.0, 0.0, 0.0
    kappa, kappa_e = 7e3 + 10.0 / T, WALL_K + WALL_B / T
    out = np.empty(len(target) - 1)
    for k in range(len(target) - 1):
        out[k] = x
        free = x - 10.0 / T / kappa * stretch
        force = max(kappa * kappa_e / (kappa + kappa_e) * (free - WALL_B / T / kappa_e * surface), 0.0)
        tool = free - force / kappa
        stretch, surface = x - tool, max(tool, 0.0)
        vh = (target[k + 1] - target[k]) / T
        v += T / mass * (-force - 2.0 * v - damping * (v - vh) - stiffness * (x - target[k]))
        x += T * v
    return out


def one_scene(name: str, effects: tuple[str, ...], rows: list[str]) -> None:
    """Time one scene of 3 s by every means and compare all of them with solve_ivp."""
    problem = scene_problem(effects, name=name)
    scene = compile_scene(problem)
    parameters, inputs = scene.parameter_values(GAINS), scene.input_values()
    started = time.perf_counter()
    native = NativeScene(scene)
    compiling = time.perf_counter() - started
    started = time.process_time()
    reference = Reference(problem, GAINS, scene.target.position_m, scene.target.device_start_m)
    truth = reference.run(REFERENCE_SAMPLES)[0]
    scipy_us = (time.process_time() - started) / REFERENCE_SAMPLES * 1e6
    traces = execute(scene, parameters, inputs, engine="casadi")
    loop = scene.function.mapaccum("run", SAMPLES)
    held = [ca.DM(scene.initial), ca.DM(inputs), ca.repmat(ca.DM(parameters[0]), 1, SAMPLES)]
    rows_of = [
        ("CasADi loop", best(lambda: loop(*held), 7), traces["position_m"][0]),
        ("generated C", best(lambda: native(scene.initial, inputs.T, parameters, 1), 7), traces["position_m"][0]),
    ]
    if effects == (HAND, WALL):
        target = np.append(scene.target.position_m, scene.target.position_m[-1])
        plant = parameters[0][3:]
        moves = np.array(
            [[plant[0], plant[2], plant[4], plant[6], plant[8]], [plant[1], plant[3], plant[5], plant[7], plant[9]]]
        )
        gain_e = 1 / T
        step = (*parameters[0][:3], gain_e, WALL_B / (WALL_K + WALL_B * gain_e))
        start = scene.target.device_start_m
        hand = (0.175, 11.5, 500.0)
        rows_of.append(
            (
                "plain Python loop",
                best(lambda: plain_loop(target, moves, step, start), 3),
                plain_loop(target, moves, step, start),
            )
        )
        if njit is not None:
            quick = njit(plain_loop)
            quick(target, moves, step, start)
            rows_of.append(
                ("numba loop", best(lambda: quick(target, moves, step, start), 7), quick(target, moves, step, start))
            )
        rows_of.append(
            (
                "one Euler step a sample, Python",
                best(lambda: euler_loop(target, hand, start), 3),
                euler_loop(target, hand, start),
            )
        )
    base = rows_of[0][1] / SAMPLES * 1e6
    for label, seconds, position in rows_of:
        error = np.abs(position[:REFERENCE_SAMPLES] - truth).max()
        us = seconds / SAMPLES * 1e6
        rows.append(f"| {name} | {label} | {us:.3g} | {us / base:.3g} | {error:.1e} |")
    rows.append(
        f"| {name} | solve_ivp, events located (DOP853, 1e-12) | {scipy_us:.0f} | {scipy_us / base:.0f} | reference |"
    )
    rows.append(
        f"| {name} | compiling the C, once: {compiling:.2f} s; "
        f"{scene.instructions} instructions, {len(scene.states)} states | | | |"
    )


def adaptive_scene(rows: list[str]) -> None:
    """Time a scene whose gains follow an estimate of the interaction frequency in every sample."""
    effects = (HAND, WALL, 'kind = "estimator"', 'kind = "adaptation"', 'kind = "guard"', FRICTION, ENCODER)
    problem = scene_problem(effects)
    bound, gains, _ = settled(problem, build_effects(problem), avc.solve(problem, "exact"))
    scene = compile_for(problem, bound, gains)
    parameters, inputs = scene.parameter_values(gains), scene.input_values()
    native = NativeScene(scene)
    us = best(lambda: native(scene.initial, inputs.T, parameters, 1), 7) / SAMPLES * 1e6
    slow = ns_per_step(scene, gains) / 1e3
    name = f"adaptive, guard, friction, encoder ({scene.instructions} instructions, {len(scene.states)} states)"
    rows.append(f"| {name} | CasADi loop | {slow:.3g} | 1 | |")
    rows.append(f"| {name} | generated C | {us:.3g} | {us / slow:.3g} | |")


def many_hands(effects: tuple[str, ...], name: str, rows: list[str], count: int = 1000) -> None:
    """Time a thousand hands for 3 s each."""
    problem = scene_problem(effects)
    draw = np.random.default_rng(0).uniform
    hands = Hand(draw(0.05, 0.3, count), draw(3, 20, count), draw(200, 800, count))
    for engine in ("casadi", "native"):
        started, working = time.perf_counter(), time.process_time()
        found = avc.simulate_batch(problem, hands, Gains(200.0, 1e5), engine=engine)
        seconds, worked = time.perf_counter() - started, time.process_time() - working
        us = worked / count / SAMPLES * 1e6
        label = {"casadi": "CasADi loop, one core", "native": "generated C, all cores, compiling included"}[engine]
        rows.append(
            f"| {name} | {label} | {seconds:.2f} | {worked:.2f} | {us:.3g} | {int(found.stable.sum())} of {count} |"
        )


def main(write: Path | None) -> None:
    """Run everything, print the tables, and write them where asked."""
    speed: list[str] = []
    one_scene("linear", (HAND, WALL), speed)
    one_scene("friction", (HAND, WALL, FRICTION), speed)
    one_scene("friction and encoder", (HAND, WALL, FRICTION, ENCODER), speed)
    adaptive_scene(speed)
    batch: list[str] = []
    many_hands((HAND, WALL), "linear", batch)
    many_hands((HAND, WALL, FRICTION, ENCODER), "friction and encoder", batch)
    accuracy = [
        f"| {row.scene} | {row.integrator} | {row.substeps} | {row.error:.1e} "
        f"| {row.seconds / SAMPLES * 1e6:.2f} | {row.instructions} |"
        for name in ("scenes/stiff-wall-pressed", "scenes/texture-stroke", "scenes/soft-tissue")
        for row in integrator_accuracy(avc.load_problem(name), avc.solve(avc.load_problem(name), "exact"))
    ]
    versions = f"Python {platform.python_version()}, CasADi {ca.__version__}, numpy {np.__version__}"
    machine = f"{datetime.now(tz=UTC):%Y-%m-%d}; {platform.machine()}, {os.cpu_count()} cores shared with others"
    text = [
        "# Scenes: speed and accuracy",
        "",
        f"{machine}; {versions}, numba {'absent' if njit is None else 'present'}.",
        "",
        "    python tests/benchmarks/bench_scene_speed.py",
        "",
        "## One scene of 3 s at 1 kHz",
        "",
        "A hand presses the wall of figure 5 (1e5 N/m, 10 N.s/m) through a static coupling of 7 kN/m and 10 N.s/m.",
        f"Error: largest error of the position over the first {REFERENCE_SAMPLES} samples.",
        "",
        "| scene | by | processor us a sample | times the CasADi loop | error (m) |",
        "|---|---|---|---|---|",
        *speed,
        "",
        "## A thousand hands for 3 s each, series coupling 1e5 N/m and 200 N.s/m, judged",
        "",
        "| scene | by | wall s | processor s | processor us a sample | at rest |",
        "|---|---|---|---|---|---|",
        *batch,
        "",
        "## Integrators: error of the position over the whole scene against the exact scheme in substeps",
        "",
        "| scene | integrator | substeps | error (m) | us a sample | instructions |",
        "|---|---|---|---|---|---|",
        *accuracy,
        "",
    ]
    if write is not None:
        write.write_text("\n".join(text), encoding="utf-8")
    print("\n".join(text))


if __name__ == "__main__":
    main(script_arguments(__doc__, results=HERE / "RESULTS_scene_speed.md").write)
