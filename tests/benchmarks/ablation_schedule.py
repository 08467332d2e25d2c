"""What each rule of the joint schedules is worth: left out, one at a time, on the catalogue and on fresh problems.

    OPENBLAS_NUM_THREADS=1 python -m tests.benchmarks.ablation_schedule --count 40 --seed 90002

Solved are `schedule`, its constant gains for every hand (what `static-tuned` solves) for every third problem, and
`direct` where a scope is wider than a frequency or realism is required. A rule whose function is not called with all
rules is not left out there.
"""

from __future__ import annotations

import argparse
import importlib
import itertools
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parent.parent)]

from design_oracles import drawn_device_problem  # noqa: E402
from drawn_problems import drawn_problem  # noqa: E402
from left_out import noted, replaced  # noqa: E402
from studied import about, made_by  # noqa: E402

import avc_casadi as avc  # noqa: E402
from avc_casadi.design.constant.static_tuned import tuned_margin  # noqa: E402
from avc_casadi.model.problem import Problem  # noqa: E402

SCOPES, REQUIRED = ("pointwise", "band", "all", "hands"), ("none", "none", "jnd", "bounds")
# A goal that differs by less than 1 %, or by less than this, is the same; times below 0.2 s are not compared.
NOTHING = {"schedule": 1e-6, "constant": 1e-6, "direct": 1e-4}
SAME, SLOW, SHORT_S = 0.01, 1.5, 0.2
ROOM = "design.schedule"


class Rule(NamedTuple):
    """What is left out: a function or a constant of a module of the room, and what makes its stand-in from it."""

    words: str
    target: str
    without: Callable[[Any], Any]


def _module(name: str) -> Any:
    return importlib.import_module(f"avc_casadi.{ROOM}.{name}")


def _given(place: int) -> Callable[[Any], Any]:
    """Return an argument as it was given."""
    return lambda _: lambda *args: args[place]


def _always(value: Any) -> Callable[[Any], Any]:
    return lambda _: lambda *_args: value


def _without_guess(place: int) -> Callable[[Any], Any]:
    """Let the NLP fail from one of the guesses, which are solved before all else."""

    def without(original: Any) -> Any:
        turns = iter(range(10**6))

        def solve_program(data: Any, objective: str, start: Any, *args: Any, **named: Any) -> Any:
            if next(turns) != place:
                return original(data, objective, start, *args, **named)
            return _module("nlp").Solution(start, np.inf, False, "left out", 0, (0.0, 0.0))

        return solve_program

    return without


def _hands_by_nlp(_: Any) -> Any:
    scoped = _module("scoped")

    def with_hands(problem: Problem, frequency_hz: Any, progress: Any) -> Any:
        task = scoped.Task.of(problem, frequency_hz, objective="tied")
        missing, nowhere = scoped.missing_rows(task), np.full(len(frequency_hz), np.nan)
        best = scoped._in_parts(task, missing, (nowhere,) * 3, -(-len(frequency_hz) // 16), progress)
        return scoped._from_others(task, missing, best), missing.rows, list(missing.reasons)

    return with_hands


def _unseeded(_: Any) -> Any:
    return lambda *args: _module("scope").Slots.of(args[0].problem, args[0].frequency_hz)


def _first_alone(original: Any) -> Any:
    return lambda *args: replace(found := original(*args), solutions=found.solutions[:1])


def _lattice_alone(_: Any) -> Any:
    own = _module("scoped")
    return lambda *args: own._from_starts(*args[:2], [own._lattice_optima(*args[:2])])


RULES = {
    "path": Rule("guess: path of the lattice", f"{ROOM}.coarse_to_fine.solve_program", _without_guess(0)),
    "constant": Rule("guess: constant gains", f"{ROOM}.coarse_to_fine.solve_program", _without_guess(1)),
    "optima": Rule("guess: separate optima", f"{ROOM}.coarse_to_fine.solve_program", _without_guess(2)),
    "seeded": Rule("worst frequencies of the guesses bounded at once", f"{ROOM}.coarse_to_fine._seeded", _unseeded),
    "next": Rule("next solution if the cheapest cannot be refined", f"{ROOM}.solver.solved_from_guesses", _first_alone),
    "tightened": Rule("more asked of rows that just miss", f"{ROOM}.coarse_to_fine._tightened", _given(3)),
    "constants": Rule("constant gains in place of no schedule", f"{ROOM}.solver.constant_gains", _always(None)),
    "lattice": Rule("path of the lattice in place of a dearer NLP", f"{ROOM}.solver.as_guessed", _always(None)),
    "about": Rule("finer tables of the hands about a schedule", f"{ROOM}.solver.with_finer_tables", _given(1)),
    "unreal": Rule("rows that cannot be real told first", f"{ROOM}.infeasible.unrealistic_rows", _always({})),
    "tight": Rule("lattice where a scope has no interior", f"{ROOM}.scoped._best_without_room", _given(2)),
    "others": Rule("gains of other frequencies tried", f"{ROOM}.scoped._from_others", _given(2)),
    "halves": Rule("failed blocks in halves", f"{ROOM}.scoped._solved", lambda _: _module("scoped")._best_outcome),
    "relaxed": Rule("start: pointwise optimum", f"{ROOM}.scoped._best_outcome", _lattice_alone),
    "hands": Rule("search of its own for every hand, not the NLP", f"{ROOM}.scoped._with_hands", _hands_by_nlp),
}


def cases(count: int, seed: int) -> Iterator[tuple[str, str, Problem]]:
    """Yield name, what is solved, and the problem: catalogue, wider scopes of figure 5, drawn ones."""
    loaded = ((one.name, avc.load_problem(one.name)) for one in avc.catalogue())
    # One that couples to an engine has no wall to solve for.
    problems = [(name, problem) for name, problem in loaded if problem.simulation is None]
    five = avc.load_problem("figure5")
    damped = {"structure": "damped", "contact_damping_ns_per_m": (0.0, 150.0)}
    wider: list[dict[str, Any]] = [{}, {"coupling": damped}, {"device": {"delay_samples": 2}}]
    for scope, more in itertools.product(("band", "all"), wider):
        changed = five.changed(stability={"scope": scope}, frequency={"points": 60}, **more)
        problems.append((f"figure5, {scope} {'+'.join(more)}", changed))
    for number in range(count):
        rng, scope, require = np.random.default_rng((seed, number)), SCOPES[number % 4], REQUIRED[number // 4 % 4]
        if number % 4 == number // 4 % 4:
            problem = drawn_problem(rng, frequencies=12).changed(stability={"scope": scope})
        else:
            structure = ("series", "damped")[number // 2 % 2]
            problem = drawn_device_problem(rng, structure=structure, scope=scope, rows=12, require=require)
        goal, penalty = str(rng.choice(["magnitude", "complex"])), float(rng.choice([1e-4, 1e-3, 1e-2]))
        goals = {"realism": {"objective": goal}, "schedule": {"slope_penalty": penalty}}
        problems.append((f"drawn {number}", problem.changed(**goals)))
    for place, (name, problem) in enumerate(problems):
        rows = len(problem.frequencies_hz())
        few = problem.changed(frequency={"points": 60}) if rows > 60 else problem
        yield name, "schedule", few
        if place % 3 == 0:
            reserve = problem.stability.margin_ns_per_m or tuned_margin(problem)
            stability = {"scope": "hands", "margin_ns_per_m": reserve}
            yield name, "constant", few.changed(stability=stability, realism={"require": "none"})
        if problem.stability.scope != "pointwise" or problem.realism.require != "none":
            at_most = 60 if name.startswith("figure5") else 12
            yield name, "direct", few.changed(frequency={"points": at_most}) if rows > at_most else few


def solved(what: str, problem: Problem) -> dict[str, Any]:
    """Solve: rows with gains, their goal, processor time."""
    started = time.process_time()
    if what == "direct":
        found = avc.solve(problem)
        goal = (found.magnitude_error / np.abs(found.target))[found.usable].tolist()
    else:
        found = _module("solver").solve_schedule(problem, constant=what == "constant")
        goal = [float(note.split()[1].rstrip(":")) for note in found.notes if note.startswith("cost ")]
    return {"usable": found.usable.tolist(), "goal": goal, "cpu_s": round(time.process_time() - started, 3)}


def studied(what: str, problem: Problem) -> dict[str, Any]:
    """Solve with all rules, twice so that what is built once is built, then without each that was called."""
    called: set[str] = set()
    with noted({rule.target for rule in RULES.values()}, called):
        solved(what, problem)
    everything, without = solved(what, problem), {}
    for name, rule in RULES.items():
        if rule.target in called:
            with replaced({rule.target: rule.without}):
                without[name] = solved(what, problem)
    return {"all": everything, "without": without}


def change(what: str, one: dict[str, Any], two: dict[str, Any]) -> str:
    """Say what leaving out a rule did to the rows or to their goal: rows, better, worse, or nothing."""
    if one["usable"] != two["usable"]:
        return "rows"
    a, b = np.array(one["goal"]), np.array(two["goal"])
    far = np.abs(a - b) > np.maximum(SAME * a, NOTHING[what])
    return "" if not far.any() else "worse" if (far & (b > a)).any() else "better"


def table_of(rows: list[dict[str, Any]]) -> str:
    """Return a line for each rule."""
    head = "| rule | what it is | solves | other rows | worse | better | 1.5 times slower | processor time |"
    lines = [head, "|---|---|" + "--:|" * 6]
    for name, rule in RULES.items():
        own = [(row["what"], row["all"], row["without"][name]) for row in rows if name in row["without"]]
        found = [change(*each) for each in own]
        counts = " | ".join(str(found.count(word)) for word in ("rows", "worse", "better"))
        slower = sum(max(b["cpu_s"], SHORT_S) > SLOW * max(a["cpu_s"], SHORT_S) for _, a, b in own)
        spent = sum(b["cpu_s"] for *_, b in own) / max(sum(a["cpu_s"] for _, a, _ in own), 1e-9)
        lines.append(f"| `{name}` | {rule.words} | {len(own)} | {counts} | {slower} | {spent:.2f} |")
    return "\n".join(lines)


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=40, help="drawn problems")
    parser.add_argument("--seed", type=int, default=90002)
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    made = about(f"python -m tests.benchmarks.ablation_schedule --count {args.count}", args.seed)
    rows = [{"what": what, **studied(what, one)} for _, what, one in cases(args.count, args.seed)]
    print(f"{made_by(made)}\n\n{len(rows)} solves.\n\n{table_of(rows)}")


if __name__ == "__main__":
    main()
