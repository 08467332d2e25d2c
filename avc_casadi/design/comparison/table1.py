"""The paper's experiment with simulated hands: Table 1, who rests at each wall and which coupling feels like it.

Fitted to the paper is only the stiffness of VE4 to VE6, from its column without coupling. The reference of feel is the
same hand at the same wall without sampling, quantisation or coupling; a coupling differs by the larger share of rms in
force or position from contact on, and of two that differ noticeably the nearer one is chosen.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi._util.parallel import map_tasks
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.design.methods import solve
from avc_casadi.design.tuned import tuning_problem
from avc_casadi.files.problem_file import load_problem
from avc_casadi.model.declared import declared_effects
from avc_casadi.model.effects import AdaptationEffect, EstimatorEffect
from avc_casadi.model.gains import NO_COUPLING, Gains, GainSchedule, gains_at
from avc_casadi.model.hands import Hand, StylusHand
from avc_casadi.model.problem import Impedance, Model, Problem, Structure
from avc_casadi.paper.closed_form import project
from avc_casadi.simulation.judge import Traces
from avc_casadi.simulation.population.motions import AT_WALL, MOTIONS
from avc_casadi.simulation.population.operators import Population, draw_population
from avc_casadi.simulation.population.setup import FRICTION, HANDS_AT_ONCE, Setup, judge, traces
from avc_casadi.simulation.population.trial import exact_interval

# What the paper counted of 10 people: stable without coupling (with one, all were), nearer to the wall with the static
# and with the adaptive coupling, and unable to tell.
PAPER = {
    "VE2": (10, 3, 3, 4),
    "VE3": (10, 3, 5, 2),
    "VE4": (10, 6, 4, 0),
    "VE5": (4, 1, 9, 0),
    "VE6": (0, 1, 9, 0),
    "VE7": (0, 2, 8, 0),
}


@dataclass(frozen=True)
class Candidate:
    """One coupling that all hands try."""

    method: str
    tuned: Structure | None = None  # structure in which it is tuned for the training hands
    model: Model | None = None  # of the stability condition, in place of the problem's
    constant: bool = False
    meets_others: bool = False  # hands of set B try it too


COUPLINGS = {
    "none": Candidate("none", meets_others=True),
    "static": Candidate("static", constant=True, meets_others=True),
    "static-sampled": Candidate("static", model="sampled-data", constant=True),
    "direct": Candidate("direct"),
    "closed-form": Candidate("closed-form"),
    "static-tuned-series": Candidate("static-tuned", tuned="series", constant=True),
    "schedule-series": Candidate("schedule", tuned="series"),
    "static-tuned": Candidate("static-tuned", tuned="damped", constant=True, meets_others=True),
    "schedule": Candidate("schedule", tuned="damped", meets_others=True),
}


@dataclass(frozen=True)
class Design:
    """One coupling for one wall."""

    problem: Problem
    in_force: Gains | GainSchedule | None
    gains: Gains | None
    reason: str = ""

    def document(self) -> dict[str, float | None] | None:
        """Return the gains of a hand at rest as JSON values; an infinite gain is a rigid coupling, null."""
        if self.gains is None:
            return None
        return {key: value if math.isfinite(value) else None for key, value in vars(self.gains).items()}


def design(problem: Problem, coupling: str) -> Design:
    """Design one coupling for the wall of a problem; a method that refuses it gives no gains."""
    if coupling == "none":
        return Design(problem, NO_COUPLING, NO_COUPLING)
    if coupling == "closed-form":
        return _injection(problem)
    one = COUPLINGS[coupling]
    if one.tuned is not None:
        problem = tuning_problem(problem, one.tuned)
    elif one.model is not None:
        problem = problem.changed(stability={"model": one.model})
    try:
        table = solve(problem, one.method)
    except UnsupportedError as refusal:
        return Design(problem, None, None, str(refusal))
    rows = np.flatnonzero(table.usable)
    if len(rows) == 0:
        return Design(problem, None, None, table.reason[0])
    gains = gains_at(table, float(table.frequency_hz[rows[0]]))
    return Design(problem, gains if one.constant else table, gains)


def _injection(problem: Problem) -> Design:
    """Render the desired wall with the largest damper that the projection injects at any frequency."""
    upper, lower = problem.boundaries.upper, problem.boundaries.lower
    wall = Impedance(
        damping_ns_per_m=(upper.damping_ns_per_m + lower.damping_ns_per_m) / 2,
        stiffness_n_per_m=(upper.stiffness_n_per_m + lower.stiffness_n_per_m) / 2,
    )
    gains = Gains(math.inf, math.inf, float(project(problem).injected_damping_ns_per_m.max()))
    return Design(problem.changed(environment=wall), gains, gains)


def of_paper(problem: Problem, gains: Gains | GainSchedule, *more: str) -> Setup:
    """Return gains on the paper's device: a wall, with what more the problem declares of some kinds."""
    effects = [one for one in declared_effects(problem) if one.kind in {"hand", "wall", FRICTION, *more}]
    adapted = () if isinstance(gains, Gains) else (EstimatorEffect(), AdaptationEffect())
    return Setup(problem, gains, (*effects, *adapted))


def reference_traces(problem: Problem, people: Hand | StylusHand) -> Traces:
    """Press a wall that is sampled so fast that it feels continuous; keep the samples of the device's own clock."""
    # The damping makes up for what is left of k_e T/2.
    factor = 8
    step_s, wall = problem.device.sample_time_s / factor, problem.environment
    made_up = {"damping_ns_per_m": wall.damping_ns_per_m + wall.stiffness_n_per_m * step_s / 2}
    fast = problem.changed(device={"sample_time_s": step_s, "delay_samples": 0}, environment=made_up)
    (found,) = traces(of_paper(fast, NO_COUPLING), people, MOTIONS["press"])
    position, velocity, force = (
        values[:, ::factor] for values in (found.position_m, found.velocity_m_per_s, found.force_n)
    )
    return Traces(position, velocity, force, problem.device.sample_time_s)


def distance(felt: Traces, reference: Traces) -> FloatArray:
    """Return how far each hand is from the reference from its first contact on, as a share; infinite if diverged."""
    touched = np.cumsum(reference.force_n > 0, axis=1) > 0
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        shares = [
            np.sqrt((touched * (mine - real) ** 2).sum(axis=1) / (touched * real**2).sum(axis=1))
            for mine, real in ((felt.force_n, reference.force_n), (felt.position_m, reference.position_m))
        ]
        far = np.max(shares, axis=0)
    return np.asarray(np.where(np.isfinite(far), far, np.inf))


def choose(first: FloatArray, second: FloatArray, weber: float = 0.10) -> tuple[BoolArray, BoolArray]:
    """Return who finds the first of two couplings nearer, and who the second; people notice 7 to 23 %."""
    noticed = np.maximum(first, second) > weber
    with np.errstate(invalid="ignore"):
        able = noticed & (np.abs(first - second) > weber)
    return np.asarray(able & (first < second)), np.asarray(able & (second < first))


def table1(
    hands: int = 200,
    seed: int = 2026,
    *,
    walls: Sequence[str] = tuple(PAPER),
    couplings: Sequence[str] = tuple(COUPLINGS),
    workers: int = 1,
    executor: Executor | None = None,
    progress: Progress = SILENT,
) -> dict[str, Any]:
    """Rebuild Table 1; the same seed gives the same hands and the same counts."""
    tasks = [
        (wall, first, min(HANDS_AT_ONCE, hands - first)) for wall in walls for first in range(0, hands, HANDS_AT_ONCE)
    ]
    sizes = [count for *_, count in tasks]
    work = partial(_tried, tuple(couplings), seed)
    parts = map_tasks(work, tasks, executor, workers=workers, sizes=sizes, things="hands at walls", progress=progress)
    rows: dict[Population, list[dict[str, Any]]] = {"A": [], "B": []}
    for wall in walls:
        of_wall = [part for (other, *_), part in zip(tasks, parts, strict=True) if other == wall]
        for population, found in rows.items():
            tried = [part[population] for part, _ in of_wall]
            outcomes = {
                name: {key: np.concatenate([one[name][key] for one in tried]) for key in first}
                for name, first in tried[0].items()
            }
            found += [
                _row(wall, name, of_wall[0][1][name], outcomes, population)
                for name in couplings
                if population == "A" or COUPLINGS[name].meets_others
            ]
    return {"hands": hands, "seed": seed, "rows": rows["A"], "rows_set_b": rows["B"]}


# Arrays of shape (hands,) by name; distance is absent where nothing is compared.
_Outcome = dict[str, Any]


@lru_cache(maxsize=128)
def _designed(wall: str, coupling: str) -> Design:
    return design(load_problem(wall.lower()), coupling)


def _tried(
    couplings: tuple[str, ...], seed: int, task: tuple[str, int, int]
) -> tuple[dict[Population, dict[str, _Outcome]], dict[str, dict[str, Any]]]:
    """Return the outcomes of some hands at one wall, by population and coupling, and the gains of each coupling."""
    wall, first, count = task
    problem = load_problem(wall.lower())
    made = {name: _designed(wall, name) for name in couplings}
    tried: dict[Population, dict[str, _Outcome]] = {"A": {}, "B": {}}
    for population, found in tried.items():
        people = draw_population(population, count, seed, first=first)
        reference = reference_traces(problem, people) if population == "A" else None
        for name, one in made.items():
            if one.in_force is not None and (population == "A" or COUPLINGS[name].meets_others):
                found[name] = _outcome(of_paper(one.problem, one.in_force, "encoder", "delay"), people, reference)
    return tried, {name: {"gains": one.document(), "reason": one.reason} for name, one in made.items()}


def _outcome(setup: Setup, people: Hand | StylusHand, reference: Traces | None) -> _Outcome:
    (press,) = traces(setup, people, MOTIONS["press"])
    pressed = press.judge()
    rest = {name: pressed.stable if name == "press" else judge(setup, people, MOTIONS[name]).stable for name in AT_WALL}
    free = judge(setup.without(FRICTION), people, MOTIONS["press"])
    felt = np.where(pressed.stable, pressed.apparent_stiffness_n_per_m, np.nan)
    outcome = {**rest, "asymptotic": free.stable, "stiffness_n_per_m": felt}
    return outcome if reference is None else outcome | {"distance": distance(press, reference)}


def _row(
    wall: str, coupling: str, made: dict[str, Any], outcomes: dict[str, _Outcome], population: Population
) -> dict[str, Any]:
    # The paper compared static and adaptive coupling; all others are set against the adaptive one.
    opponent = "static" if coupling == "schedule" else "schedule"
    row: dict[str, Any] = {
        "ve": wall,
        "stiffness_n_per_m": load_problem(wall.lower()).environment.stiffness_n_per_m,
        "coupling": coupling,
        **made,
        "paper": _paper(wall, coupling) if population == "A" else None,
        **dict.fromkeys(("stable", "stable_low", "stable_high", "stable_by_motion", "asymptotic")),
        **dict.fromkeys(("apparent_stiffness_n_per_m", "matched", "unable")),
        "matched_against": opponent,
    }
    if coupling not in outcomes:
        return row
    outcome = outcomes[coupling]
    rest = {name: outcome[name] for name in AT_WALL}
    stable = np.all(list(rest.values()), axis=0)
    felt = outcome["stiffness_n_per_m"][np.isfinite(outcome["stiffness_n_per_m"])]
    row |= {
        "stable": int(stable.sum()),
        "stable_by_motion": {name: int(found.sum()) for name, found in rest.items()},
        "asymptotic": int(outcome["asymptotic"].sum()),
        "apparent_stiffness_n_per_m": float(np.median(felt)) if len(felt) else None,
    }
    row["stable_low"], row["stable_high"] = exact_interval(row["stable"], len(stable))
    if "distance" in outcome and opponent in outcomes:
        nearer, farther = choose(outcome["distance"], outcomes[opponent]["distance"])
        row |= {"matched": int(nearer.sum()), "unable": int((~(nearer | farther)).sum())}
    return row


def _paper(wall: str, coupling: str) -> dict[str, int | None] | None:
    if wall not in PAPER or coupling not in ("none", "static", "schedule"):
        return None
    stable, static, adaptive, unable = PAPER[wall]
    matched = {"none": None, "static": static, "schedule": adaptive}[coupling]
    return {"stable": stable if coupling == "none" else 10, "matched": matched, "unable": unable}
