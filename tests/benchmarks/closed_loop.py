"""Stability of constant and adaptive gains at the stiff wall: python tests/benchmarks/closed_loop.py [--hands 300]

Overwrites RESULTS_closed_loop.md beside this file. About six minutes on two cores.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

from avc_casadi.design.methods import solve
from avc_casadi.files.problem_file import load_problem
from avc_casadi.model.effects import CoulombFrictionEffect, EncoderEffect
from avc_casadi.model.hands import Hand
from avc_casadi.model.problem import Problem
from avc_casadi.model.schedule import GainSchedule
from avc_casadi.simulation.judge import Judgement
from avc_casadi.simulation.scene import simulate_batch

HERE = Path(__file__).parent
PROBLEMS = {"damped": "scenes/adaptive-press", "series": "scenes/adaptive-press-series"}
METHODS = ("static-tuned", "schedule")
ENCODERS_UM = (2, 20, 50)
FRICTIONS_N = (0.0, 0.05, 0.1, 0.2)
WALL_N_PER_M = 1e5
SEED = 1


def drawn_hands(count: int) -> Hand:
    rng = np.random.default_rng(SEED)
    return Hand(rng.uniform(0.05, 0.3, count), rng.uniform(3, 20, count), rng.uniform(200, 800, count))


def scene(problem: Problem, encoder_um: float, friction_n: float, *, observer: bool, motion=None, extra=()) -> Problem:
    effects = []
    for effect in problem.scene.effects:
        if effect.kind == "encoder":
            effects.append(EncoderEffect(resolution_m=encoder_um * 1e-6))
        elif effect.kind != "observer" or observer:
            effects.append(effect)
    if friction_n > 0:
        effects.append(CoulombFrictionEffect(force_n=friction_n))
    changed = problem.scene.model_copy(update={"effects": (*effects, *extra), "motion": motion or problem.scene.motion})
    return problem.model_copy(update={"scene": changed})


def cell(found: Judgement) -> str:
    stiffness = found.apparent_stiffness_n_per_m[found.stable]
    stiffness = stiffness[np.isfinite(stiffness)]
    share = f", {np.median(stiffness) / WALL_N_PER_M:.2f}" if len(stiffness) else ""
    return f"{100 * found.stable.mean():.3g} %{share}"


def gains_text(gains: GainSchedule) -> str:
    lowest = int(np.argmin(gains.frequency_hz))
    order = np.argsort(gains.frequency_hz)
    beyond = np.flatnonzero(~(gains.complex_error[order] <= 0.1))
    first = gains.frequency_hz[order][beyond[0]] if len(beyond) else np.inf
    reach = f"impedance error {gains.complex_error[lowest]:.3f} there, above 0.10 from {first:.3g} Hz on"
    return (
        f"k = {gains.stiffness_n_per_m[lowest]:.3g} N/m, b = {gains.damping_ns_per_m[lowest]:.3g}, "
        f"b_p = {gains.contact_damping_ns_per_m[lowest]:.3g} N.s/m at {gains.frequency_hz[lowest]:g} Hz; {reach}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hands", type=int, default=300)
    count = parser.parse_args().hands
    hands, started = drawn_hands(count), time.perf_counter()
    lines = ["# Constant and adaptive gains at the stiff wall", ""]
    lines += [f"Made by `python tests/benchmarks/closed_loop.py --hands {count}`. Wall 1e5 N/m and 10 N.s/m, T = 1 ms,"]
    lines += [
        "device 0.1 kg and 2 N.s/m, hands 0.05-0.3 kg, 3-20 N.s/m, 200-800 N/m. Each cell: hands at rest at the end"
    ]
    lines += ["(below 5 mm/s), and their median stiffness as a share of the wall's.", ""]
    tables: dict[bool, list[str]] = {True: [], False: []}
    for structure, name in PROBLEMS.items():
        problem = load_problem(name)
        for method in METHODS:
            gains = solve(problem, method)
            label = f"{structure}, {method}"
            lines.append(f"- {label}: {gains_text(gains)}")
            for observer, table in tables.items():
                for encoder in ENCODERS_UM:
                    cells = [
                        cell(simulate_batch(scene(problem, encoder, friction, observer=observer), hands, gains))
                        for friction in FRICTIONS_N
                    ]
                    table.append(f"| {label} | {encoder} | " + " | ".join(cells) + " |")
                    print(table[-1], flush=True)
    head = "| gains | encoder, um | " + " | ".join(f"friction {friction:g} N" for friction in FRICTIONS_N) + " |"
    rule = "| --- | --- | " + " | ".join("---" for _ in FRICTIONS_N) + " |"
    for observer, table in tables.items():
        title = "With the observer" if observer else "Without the observer"
        lines += ["", f"## {title}, pressed", "", head, rule, *table]
    lines.append("")
    (HERE / "RESULTS_closed_loop.md").write_text("\n".join(lines), encoding="utf-8")
    print(f"{time.perf_counter() - started:.0f} s")


if __name__ == "__main__":
    main()
