"""The stiff wall, many hands, recommended and adaptive: python tests/benchmarks/ten_thousand_hands.py

Overwrites RESULTS_ten_thousand_hands.md beside this file. About ten minutes on two cores.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from closed_loop import PROBLEMS, WALL_N_PER_M, drawn_hands, scene

from avc_casadi.design.methods import solve
from avc_casadi.files.problem_file import load_problem
from avc_casadi.model.problem import Problem
from avc_casadi.recommendation.recommend import recommend
from avc_casadi.simulation.population.coupling_trial import try_coupling
from avc_casadi.simulation.population.operators import draw_hands
from avc_casadi.simulation.population.settled import exact_interval
from avc_casadi.simulation.scene import simulate_batch

HERE = Path(__file__).parent
# Of the people of figure 5's recommendation none are these.
FRESH_SEED = 99


def without_encoder(problem: Problem) -> Problem:
    kept = tuple(effect for effect in problem.scene.effects if effect.kind not in {"encoder", "observer"})
    return problem.changed(scene={"effects": kept})


def recommended(count: int) -> str:
    """What fresh hands do with the coupling that is recommended for figure 5, in all motions."""
    coupling = recommend("figure5").coupling
    assert coupling is not None
    trial = try_coupling(coupling, draw_hands(coupling.problem.hands, count, FRESH_SEED), FRESH_SEED)
    counts = trial.counts()
    low, high = (f"{100 * share:.2f}" for share in exact_interval(counts["at_rest_without_friction"], count))
    share = np.nanquantile(trial.stiffness_n_per_m / trial.wall_n_per_m, (0.05, 0.5, 0.95))
    felt = ", ".join(f"{100 * value:.1f}" for value in share)
    motions = ", ".join(f"{name} {int(rest.sum())}" for name, rest in trial.by_motion.items())
    return (
        f"{coupling.method}, {coupling.contact}. At rest in every motion without friction: "
        f"{counts['at_rest_without_friction']} of {count} (exact 95 % interval {low} to {high} %); with the 0.2 N of "
        f"the file {counts['at_rest']} ({motions}), quietly {counts['quiet']}. Felt: {felt} % of the wall at the 5 %, "
        f"50 % and 95 % quantiles."
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hands", type=int, default=10_000)
    count = parser.parse_args().hands
    hands, rows = drawn_hands(count), []
    for structure, name in PROBLEMS.items():
        problem = load_problem(name)
        gains = solve(problem, "schedule")
        runs = {"none": without_encoder(problem)}
        runs |= {f"{step} um": scene(problem, step, 0.0, observer=True) for step in (2, 20, 50)}
        for encoder, run in runs.items():
            started = time.perf_counter()
            found = simulate_batch(run, hands, gains)
            seconds = time.perf_counter() - started
            share = np.nanquantile(found.apparent_stiffness_n_per_m / WALL_N_PER_M, (0.05, 0.5, 0.95))
            stiffness = " | ".join(f"{value:.3f}" for value in share)
            counts = f"{found.stable.sum()} | {found.buzzing.sum()}"
            rows.append(f"| {structure} | {encoder} | {counts} | {stiffness} | {seconds:.0f} |")
            print(rows[-1], flush=True)
    text = f"""# {count} hands at the stiff wall

## What is recommended

`recommend("figure5")`, wall 100 kN/m, pressed, tapped and held by hands that its own trial did not see:
{recommended(count)}

## The adaptive schedule, without friction

Made by `python tests/benchmarks/ten_thousand_hands.py --hands {count}`. Wall, device and hands of
[RESULTS_closed_loop.md](RESULTS_closed_loop.md), pressed for 3 s; schedule with fused estimator and adaptation, with
the observer where there is an encoder. At rest: below 5 mm/s at the end. Stiffness: as a share of the wall's, at the
5 %, 50 % and 95 % quantiles; an encoder leaves up to half a step of it open.

| structure | encoder | at rest | buzzing | 5 % | 50 % | 95 % | seconds |
| --- | --- | --- | --- | --- | --- | --- | --- |
""" + "\n".join(rows)
    (HERE / "RESULTS_ten_thousand_hands.md").write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
