"""The schedule against the same problem written plainly with casadi.Opti and IPOPT, in one run.

Run from the root of the checkout: python tests/benchmarks/bench_schedule.py. With --write it overwrites
RESULTS_schedule.md beside it.
Times are medians; processor seconds stand beside wall seconds because others may share the machine.
"""

from __future__ import annotations

import os
import platform
import statistics
import sys
import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE.parents[1])]

import casadi as ca  # noqa: E402
import numpy as np  # noqa: E402
from plain_schedule import PlainSchedule  # noqa: E402
from schedule_problems import changed, figure5  # noqa: E402
from script_arguments import script_arguments  # noqa: E402

from avc_casadi.claims.stability.scope import scope_slack  # noqa: E402
from avc_casadi.design.schedule import nlp as _nlp  # noqa: E402
from avc_casadi.design.schedule.solver import ScheduleSolver  # noqa: E402
from avc_casadi.design.schedule.states import States  # noqa: E402
from avc_casadi.model.problem import Problem  # noqa: E402
from avc_casadi.paper.loop import loop_at  # noqa: E402

WALLS = (1.02, 0.97, 1.01, 0.95, 1.05, 1.0, 0.98, 1.03, 0.96)
"""Stiffness of the changed walls, as a share of the nominal one."""

Timed = tuple[Any, float, float]


def timed(work: Callable[[], Any]) -> Timed:
    """Return (result, wall seconds, processor seconds)."""
    wall, processor = time.perf_counter(), time.process_time()
    result = work()
    return result, time.perf_counter() - wall, time.process_time() - processor


def softened(problem: Problem, share: float) -> Problem:
    return changed(problem, environment={"stiffness_n_per_m": share * problem.environment.stiffness_n_per_m})


def cold(problem: Problem) -> Timed:
    """Solve with nothing kept from before."""
    _nlp._solver.cache_clear()
    _nlp.schedule_nlp.cache_clear()
    return timed(lambda: ScheduleSolver().solve(problem))


def ours(problem: Problem, repeats: int) -> dict[str, float]:
    """Median times of cold and warm solves, cost and smallest slack."""
    colds = [cold(problem) for _ in range(repeats)]
    gains = colds[0][0]
    solver = ScheduleSolver()
    solver.solve(problem)
    walls = [softened(problem, share) for share in WALLS]
    warms = [timed(lambda wall=wall: solver.solve(wall)) for wall in walls]
    assert all(result.usable.all() for result, _, _ in (*colds, *warms))
    rows = gains.damping_ns_per_m, gains.stiffness_n_per_m, gains.contact_damping_ns_per_m
    return {
        "cold": statistics.median(wall for _, wall, _ in colds),
        "cold_cpu": statistics.median(processor for _, _, processor in colds),
        "warm": statistics.median(wall for _, wall, _ in warms),
        "warm_cpu": statistics.median(processor for _, _, processor in warms),
        "cost": float(gains.notes[0].split()[1].rstrip(":")),
        "slack": float(scope_slack(problem, gains.frequency_hz, *rows).slack.min()),
    }


def plain(problem: Problem) -> dict[str, float]:
    """Times of building and solving with Opti from the middle of the box, and of its restarts."""
    frequency = problem.frequencies_hz()
    states = States.of(problem, loop_at(problem, frequency))
    middle = np.repeat((states.low + states.high)[:, None] / 2, len(frequency), axis=1)
    nominal = problem.environment.stiffness_n_per_m

    def build_and_solve() -> tuple[PlainSchedule, Any, float]:
        model = PlainSchedule(problem, states.floors)
        return model, *model.solve(middle, nominal)

    (model, found, cost), wall, processor = timed(build_and_solve)
    warms = []
    start = found
    for share in WALLS:
        (start, _), *seconds = timed(lambda start=start, share=share: model.solve(start, share * nominal))
        warms.append(seconds)
    rows = states.gains(found)
    return {
        "cold": wall,
        "cold_cpu": processor,
        "warm": statistics.median(wall for wall, _ in warms),
        "warm_cpu": statistics.median(processor for _, processor in warms),
        "cost": cost,
        "slack": float(scope_slack(problem, frequency, *rows).slack.min()),
    }


def row(name: str, stages: int, found: dict[str, float]) -> str:
    times = (found[key] for key in ("cold", "cold_cpu", "warm", "warm_cpu"))
    cells = " | ".join(f"{1e3 * value:.3g}" for value in times)
    return f"| {name} | {stages} | {cells} | {found['cost']:.5g} | {found['slack']:.1e} |"


def main(write: Path | None) -> None:
    """Run everything, print the results, and write them where asked."""
    head = [
        "| what | stages | cold, ms | cold, CPU ms | warm, ms | warm, CPU ms | cost | smallest slack, N.s/m |",
        "|---|---|---|---|---|---|---|---|",
    ]
    compared, ratios = [], []
    for stages in (50, 200):
        problem = figure5(points=stages, stability={"model": "sampled-data", "scope": "band"})
        mine, theirs = ours(problem, 5), plain(problem)
        compared += [row("avc schedule", stages, mine), row("plain Opti + IPOPT", stages, theirs)]
        ratios.append(
            f"- {stages} stages, CPU time: cold {theirs['cold_cpu'] / mine['cold_cpu']:.3g} times, warm "
            f"{theirs['warm_cpu'] / mine['warm_cpu']:.3g} times quicker than plain Opti; cost {mine['cost']:.5g} "
            f"against {theirs['cost']:.5g}"
        )
    scopes = []
    for name, stages, tables in (
        ("paper, pointwise", 200, {"stability": {"scope": "pointwise"}}),
        ("paper, band 2", 200, {"stability": {"scope": "band"}}),
        ("paper, band 4", 200, {"stability": {"scope": "band", "band_factor": 4.0}}),
        ("paper, all", 200, {"stability": {"scope": "all"}}),
        ("sampled-data, band 2", 200, {"stability": {"scope": "band", "model": "sampled-data"}}),
        ("sampled-data, all", 200, {"stability": {"scope": "all", "model": "sampled-data"}}),
        ("hands (slack: 1 - spectral radius)", 200, {"stability": {"scope": "hands", "model": "sampled-data"}}),
        ("sampled-data, band 2", 1000, {"stability": {"scope": "band", "model": "sampled-data"}}),
        ("paper, pointwise", 1000, {"stability": {"scope": "pointwise"}}),
        ("sampled-data, band 2", 5000, {"stability": {"scope": "band", "model": "sampled-data"}}),
    ):
        scopes.append(row(name, stages, ours(figure5(points=stages, **tables), 3)))
        print(scopes[-1], flush=True)
    machine = (
        f"{datetime.now(tz=UTC):%Y-%m-%d}; {platform.machine()}, {os.cpu_count()} shared cores; Python "
        f"{platform.python_version()}, CasADi {ca.__version__} (IPOPT with MUMPS), numpy {np.__version__}."
    )
    lines = [
        "# Joint schedule: time and accuracy",
        "",
        machine,
        "",
        "    python tests/benchmarks/bench_schedule.py",
        "",
        "Figure 5. Cold: everything built and solved from nothing, three starts (5 runs; 3 in the second table).",
        f"Warm: the wall's stiffness changes by up to 10 % from one solve to the next, {len(WALLS)} changes.",
        "Medians, in wall and in processor time, since others may share the machine. Every run of ours ends with gains",
        "at every frequency; the smallest slack is that of the exact check over the whole scope.",
        "",
        "## Against the same problem written plainly with casadi.Opti",
        "",
        "Sampled-data, band factor 2, the same stages, weights, slope penalty and logarithmic states; started in the",
        "middle of the gain box, restarted from its own last solution. Built once (cold includes it), the stiffness",
        "being a parameter. A negative slack would mean that the gains violate (12) somewhere in a band.",
        "",
        *head,
        *compared,
        "",
        *ratios,
        "",
        "## All scopes",
        "",
        *head,
        *scopes,
        "",
    ]
    if write is not None:
        write.write_text("\n".join(lines), encoding="utf-8")
    print("\n".join(lines))


if __name__ == "__main__":
    main(script_arguments(__doc__, results=HERE / "RESULTS_schedule.md").write)
