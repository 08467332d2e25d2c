"""The same gains held, tapped, with dropped ticks and with delay: python tests/benchmarks/closed_loop_harder.py

Overwrites RESULTS_closed_loop_harder.md beside this file. About three minutes on two cores.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from closed_loop import METHODS, PROBLEMS, cell, drawn_hands, scene

from avc_casadi.design.methods import solve
from avc_casadi.files.problem_file import load_problem
from avc_casadi.model.effects import DelayEffect, JitterEffect
from avc_casadi.model.problem import Problem
from avc_casadi.model.scene import Hold, Tap
from avc_casadi.simulation.scene import simulate_batch

HERE = Path(__file__).parent


def cases(problem: Problem) -> dict[str, Problem]:
    def with_effect(*extra: object) -> Problem:
        return scene(problem, 20, 0.0, observer=True, extra=extra)

    return {
        "pressed": with_effect(),
        "held": scene(problem, 20, 0.0, observer=True, motion=Hold()),
        "tapped": scene(problem, 20, 0.0, observer=True, motion=Tap()),
        "1 % of ticks dropped": with_effect(JitterEffect(rms_s=0.0, dropped_share=0.01)),
        "forces 0.1 ms late (rms)": with_effect(JitterEffect(rms_s=1e-4)),
        "one sample of delay": with_effect(DelayEffect(samples=1)),
        "two samples of delay": with_effect(DelayEffect(samples=2)),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hands", type=int, default=300)
    count = parser.parse_args().hands
    hands = drawn_hands(count)
    rows, head = [], []
    places = {f"{structure}, {method}": (name, method) for structure, name in PROBLEMS.items() for method in METHODS}
    places["damped, schedule for a delay"] = ("scenes/adaptive-press-delayed", "schedule")
    for label, (name, method) in places.items():
        problem = load_problem(name)
        effects = tuple(effect for effect in problem.scene.effects if effect.kind != "delay")
        problem = problem.changed(scene={"effects": effects})
        gains, runs = solve(problem, method), cases(problem)
        head = list(runs)
        rows.append(
            f"| {label} | " + " | ".join(cell(simulate_batch(run, hands, gains)) for run in runs.values()) + " |"
        )
        print(rows[-1], flush=True)
    text = f"""# Constant and adaptive gains in harder conditions

Made by `python tests/benchmarks/closed_loop_harder.py --hands {count}`. Device, wall and hands of
[RESULTS_closed_loop.md](RESULTS_closed_loop.md), encoder of 20 um, no friction, with the observer. Each cell: hands at
rest at the end, and their median stiffness as a share of the wall's. All gains are designed without delay; the observer
predicts over it. Out of contact, as after a tap, there is no stiffness to tell.

| gains | {" | ".join(head)} |
| --- | {" | ".join("---" for _ in head)} |
""" + "\n".join(rows)
    (HERE / "RESULTS_closed_loop_harder.md").write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
