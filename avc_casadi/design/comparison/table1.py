"""The paper's experiment with simulated hands: Table 1, who rests at each wall and which coupling feels like it.

Fitted to the paper is only the stiffness of VE4 to VE6, from its column without coupling. The reference of feel is the
same hand at the same wall without sampling, quantisation or coupling; a coupling differs by the larger share of rms in
force or position from contact on, and of two that differ noticeably the nearer one is chosen.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi._util.counts import hands_count, refuse_counts, seed_count, workers_count
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

PAPER_PEOPLE = 10
"""How many people tried each wall in the paper."""


@dataclass(frozen=True)
class PaperRow:
    """What the paper counted of 10 people at one wall.

    Attributes:
        stable: for how many the wall was stable without coupling; with one, it was for all.
        static: how many felt the wall more nearly with the static coupling.
        adaptive: how many did with the adaptive one.
        unable: how many could not tell.
    """

    stable: int
    static: int
    adaptive: int
    unable: int


PAPER = {
    "VE2": PaperRow(stable=10, static=3, adaptive=3, unable=4),
    "VE3": PaperRow(stable=10, static=3, adaptive=5, unable=2),
    "VE4": PaperRow(stable=10, static=6, adaptive=4, unable=0),
    "VE5": PaperRow(stable=4, static=1, adaptive=9, unable=0),
    "VE6": PaperRow(stable=0, static=1, adaptive=9, unable=0),
    "VE7": PaperRow(stable=0, static=2, adaptive=8, unable=0),
}

WEBER_SHARE = 0.10
"""Smallest share of force or position that is noticed.

People notice differences of force of about 7 %, and of stiffness of about 8 to 23 %.
"""
REFERENCE_RATE = 8
"""Samples of the reference wall, which feels continuous, in one of the device."""


@dataclass(frozen=True)
class MethodCandidate:
    """One coupling that all hands try.

    Attributes:
        method: the method that designs it.
        tuned: structure in which it is tuned for the training hands; None for the problem's own.
        model: model of the stability condition, in place of the problem's.
        constant: whether its gains do not vary with frequency.
        meets_set_b: whether hands of set B try it too.
    """

    method: str
    tuned: Structure | None = None
    model: Model | None = None
    constant: bool = False
    meets_set_b: bool = False


COUPLINGS = {
    "none": MethodCandidate("none", meets_set_b=True),
    "static": MethodCandidate("static", constant=True, meets_set_b=True),
    "static-sampled": MethodCandidate("static", model="sampled-data", constant=True),
    "direct": MethodCandidate("direct"),
    "closed-form": MethodCandidate("closed-form"),
    "static-tuned-series": MethodCandidate("static-tuned", tuned="series", constant=True),
    "schedule-series": MethodCandidate("schedule", tuned="series"),
    "static-tuned": MethodCandidate("static-tuned", tuned="damped", constant=True, meets_set_b=True),
    "schedule": MethodCandidate("schedule", tuned="damped", meets_set_b=True),
}


@dataclass(frozen=True)
class Design:
    """One coupling for one wall.

    Attributes:
        problem: the problem that it was designed for.
        in_force: the gains or the table that run; None where there are none.
        gains: the gains of a hand at rest.
        reason: why there are none; empty where there are.
    """

    problem: Problem
    in_force: Gains | GainSchedule | None
    gains: Gains | None
    reason: str = ""


def design(problem: Problem, coupling: str) -> Design:
    """Return a coupling, a name of `COUPLINGS`, designed for the wall of a problem; without gains where refused."""
    if coupling == "none":
        return Design(problem, NO_COUPLING, NO_COUPLING)
    if coupling == "closed-form":
        return _injection(problem)
    candidate = COUPLINGS[coupling]
    if candidate.tuned is not None:
        problem = tuning_problem(problem, candidate.tuned)
    elif candidate.model is not None:
        problem = problem.changed(stability={"model": candidate.model})
    try:
        table = solve(problem, candidate.method)
    except UnsupportedError as refusal:
        return Design(problem, None, None, str(refusal))
    rows = np.flatnonzero(table.usable)
    if len(rows) == 0:
        return Design(problem, None, None, table.reason[0])
    gains = gains_at(table, float(table.frequency_hz[rows[0]]))
    return Design(problem, gains if candidate.constant else table, gains)


def _injection(problem: Problem) -> Design:
    """Return the desired wall, the mean of the bounds U and L, with the largest damper that is injected into it.

    The projection of (13) injects a damper at each frequency. The wall is rigidly coupled; the damper acts in contact
    alone.
    """
    upper, lower = problem.boundaries.upper, problem.boundaries.lower
    wall = Impedance(
        damping_ns_per_m=(upper.damping_ns_per_m + lower.damping_ns_per_m) / 2,
        stiffness_n_per_m=(upper.stiffness_n_per_m + lower.stiffness_n_per_m) / 2,
    )
    gains = Gains(math.inf, math.inf, float(project(problem).injected_damping_ns_per_m.max()))
    return Design(problem.changed(environment=wall), gains, gains)


def of_paper(problem: Problem, gains: Gains | GainSchedule, *more_kinds: str) -> Setup:
    """Return gains on the paper's device: hand, wall and friction, with more kinds of effects that it declares."""
    kinds = {"hand", "wall", FRICTION, *more_kinds}
    effects = [effect for effect in declared_effects(problem) if effect.kind in kinds]
    adapted = () if isinstance(gains, Gains) else (EstimatorEffect(), AdaptationEffect())
    return Setup(problem, gains, (*effects, *adapted))


def reference_traces(problem: Problem, hands: Hand | StylusHand) -> Traces:
    """Press a wall that is sampled so fast that it feels continuous; keep the samples of the device's own clock."""
    step_s = problem.device.sample_time_s / REFERENCE_RATE
    wall = problem.environment
    # The damping makes up for what is left of k_e T/2.
    damped = {"damping_ns_per_m": wall.damping_ns_per_m + wall.stiffness_n_per_m * step_s / 2}
    fast = problem.changed(device={"sample_time_s": step_s, "delay_samples": 0}, environment=damped)
    (pressed,) = traces(of_paper(fast, NO_COUPLING), hands, MOTIONS["press"])
    return Traces(
        pressed.position_m[:, ::REFERENCE_RATE],
        pressed.velocity_m_per_s[:, ::REFERENCE_RATE],
        pressed.force_n[:, ::REFERENCE_RATE],
        problem.device.sample_time_s,
    )


def distance(rendered: Traces, reference: Traces) -> FloatArray:
    """Return how far each hand is from the reference from its first contact on, as a share; infinite if diverged.

    It is the larger of rms(x - x_ref)/rms(x_ref) with x the force and with x the position, shape (hands,).
    """
    touched = np.cumsum(reference.force_n > 0, axis=1) > 0

    def share(values: FloatArray, of_reference: FloatArray) -> FloatArray:
        error = (touched * (values - of_reference) ** 2).sum(axis=1)
        return np.asarray(np.sqrt(error / (touched * of_reference**2).sum(axis=1)))

    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        force_share = share(rendered.force_n, reference.force_n)
        position_share = share(rendered.position_m, reference.position_m)
        larger = np.max([force_share, position_share], axis=0)
    return np.asarray(np.where(np.isfinite(larger), larger, np.inf))


def choose(first: FloatArray, second: FloatArray, weber: float = WEBER_SHARE) -> tuple[BoolArray, BoolArray]:
    """Return who finds the first of two couplings nearer, and who the second, by their distances (hands,)."""
    noticed = np.maximum(first, second) > weber
    with np.errstate(invalid="ignore"):
        able = noticed & (np.abs(first - second) > weber)
    return np.asarray(able & (first < second)), np.asarray(able & (second < first))


@dataclass(frozen=True)
class PaperCount:
    """What the paper counted of 10 people with one coupling at one wall; None of what it did not ask."""

    stable: int
    matched: int | None
    unable: int


@dataclass(frozen=True)
class Table1Row:
    """One coupling at one wall of the paper, tried by all hands of a set.

    Attributes:
        ve: name of the wall.
        stiffness_n_per_m: its stiffness.
        coupling: name of the coupling.
        gains: its gains for a hand at rest; None where there are none.
        reason: why there are none; empty where there are.
        paper: what the paper counted; None of what it did not try.
        stable: hands that rest in every motion; None, as what follows, where there are no gains.
        stable_low: lower end of the exact interval of the share that rests.
        stable_high: its upper end.
        stable_by_motion: hands that rest in each motion.
        asymptotic: hands that rest after a press without dry friction too.
        apparent_stiffness_n_per_m: median stiffness of those that press.
        matched: hands that find it nearer to the continuous wall; None where nothing is compared.
        unable: hands that feel no difference.
        matched_against: the coupling that it is compared with.
    """

    ve: str
    stiffness_n_per_m: float
    coupling: str
    gains: Gains | None
    reason: str
    paper: PaperCount | None
    stable: int | None = None
    stable_low: float | None = None
    stable_high: float | None = None
    stable_by_motion: dict[str, int] | None = None
    asymptotic: int | None = None
    apparent_stiffness_n_per_m: float | None = None
    matched: int | None = None
    unable: int | None = None
    matched_against: str = "schedule"


@dataclass(frozen=True)
class Table1:
    """The paper's Table 1 with simulated hands: `hands` of each set, set A in `rows`, set B in `rows_set_b`."""

    hands: int
    seed: int
    rows: tuple[Table1Row, ...]
    rows_set_b: tuple[Table1Row, ...]


def table1(
    hands: int = 200,
    seed: int = 2026,
    *,
    walls: Sequence[str] = tuple(PAPER),
    couplings: Sequence[str] = tuple(COUPLINGS),
    workers: int = 1,
    executor: Executor | None = None,
    progress: Progress = SILENT,
) -> Table1:
    """Rebuild Table 1; the same seed gives the same hands and the same counts.

    Args:
        hands: how many hands of each set try each wall.
        seed: seed of the hands.
        walls: names of the paper's walls, "VE2" to "VE7".
        couplings: names of `COUPLINGS`.
        workers: processes that share the work.
        executor: runs them in place of processes of its own.
        progress: reported over the hands.
    """
    refuse_counts(hands_count(hands), seed_count(seed), workers_count(workers))
    tasks = [
        _Task(wall, first, min(HANDS_AT_ONCE, hands - first))
        for wall in walls
        for first in range(0, hands, HANDS_AT_ONCE)
    ]
    sizes = [task.count for task in tasks]
    work = partial(_tried, tuple(couplings), seed)
    parts = map_tasks(work, tasks, executor, workers=workers, sizes=sizes, things="hands at walls", progress=progress)
    rows: dict[Population, list[Table1Row]] = {"A": [], "B": []}
    for wall in walls:
        of_wall = [part for task, part in zip(tasks, parts, strict=True) if task.wall == wall]
        for population, rows_of_set in rows.items():
            outcomes = _joined([part.outcomes[population] for part in of_wall])
            rows_of_set += [
                _row(wall, name, of_wall[0].designs[name], outcomes, population)
                for name in couplings
                if population == "A" or COUPLINGS[name].meets_set_b
            ]
    return Table1(hands, seed, tuple(rows["A"]), tuple(rows["B"]))


# Arrays of shape (hands,) by name; distance is absent where nothing is compared.
_Outcome = dict[str, Any]


@dataclass(frozen=True)
class _Task:
    """Some hands at one wall: so many from the first on."""

    wall: str
    first: int
    count: int


@dataclass(frozen=True)
class _Tried:
    """Outcomes of some hands at one wall.

    Attributes:
        outcomes: by set of hands and coupling.
        designs: gains of each coupling, or why there are none.
    """

    outcomes: dict[Population, dict[str, _Outcome]]
    designs: dict[str, Design]


def _joined(parts: list[dict[str, _Outcome]]) -> dict[str, _Outcome]:
    """Return the outcomes of each coupling with the arrays of all parts, one after the other."""
    return {
        name: {key: np.concatenate([part[name][key] for part in parts]) for key in outcome}
        for name, outcome in parts[0].items()
    }


@lru_cache(maxsize=128)
def _designed(wall: str, coupling: str) -> Design:
    return design(load_problem(wall.lower()), coupling)


def _tried(couplings: tuple[str, ...], seed: int, task: _Task) -> _Tried:
    """Return the outcomes of some hands of both sets with each coupling at one wall."""
    problem = load_problem(task.wall.lower())
    designs = {name: _designed(task.wall, name) for name in couplings}
    outcomes: dict[Population, dict[str, _Outcome]] = {"A": {}, "B": {}}
    for population, of_set in outcomes.items():
        hands = draw_population(population, task.count, seed, first=task.first)
        reference = reference_traces(problem, hands) if population == "A" else None
        for name, made in designs.items():
            if made.in_force is not None and (population == "A" or COUPLINGS[name].meets_set_b):
                of_set[name] = _outcome(of_paper(made.problem, made.in_force, "encoder", "delay"), hands, reference)
    return _Tried(outcomes, designs)


def _outcome(setup: Setup, hands: Hand | StylusHand, reference: Traces | None) -> _Outcome:
    """Return whether each hand rests after each motion, with and without friction, and what stiffness it feels, N/m.

    With a reference, the traces of a press against the continuous wall, the distance from it too; arrays of shape
    (hands,).
    """
    (press,) = traces(setup, hands, MOTIONS["press"])
    pressed = press.judge()
    rest = {name: pressed.stable if name == "press" else judge(setup, hands, MOTIONS[name]).stable for name in AT_WALL}
    frictionless = judge(setup.without(FRICTION), hands, MOTIONS["press"])
    stiffness = np.where(pressed.stable, pressed.apparent_stiffness_n_per_m, np.nan)
    outcome = {**rest, "asymptotic": frictionless.stable, "stiffness_n_per_m": stiffness}
    return outcome if reference is None else outcome | {"distance": distance(press, reference)}


def _row(
    wall: str, coupling: str, designed: Design, outcomes: dict[str, _Outcome], population: Population
) -> Table1Row:
    """Return the row of one coupling at one wall: counts of hands that rest, and of those that find it nearer.

    `designed` is the coupling; `outcomes` are arrays (hands,) by coupling and name, without those that were not tried.
    """
    # The paper compared static and adaptive coupling; all others are set against the adaptive one.
    opponent = "static" if coupling == "schedule" else "schedule"
    not_tried = Table1Row(
        ve=wall,
        stiffness_n_per_m=load_problem(wall.lower()).environment.stiffness_n_per_m,
        coupling=coupling,
        gains=designed.gains,
        reason=designed.reason,
        paper=_paper(wall, coupling) if population == "A" else None,
        matched_against=opponent,
    )
    if coupling not in outcomes:
        return not_tried
    outcome = outcomes[coupling]
    rest = {name: outcome[name] for name in AT_WALL}
    stable = np.all(list(rest.values()), axis=0)
    stiffness = outcome["stiffness_n_per_m"][np.isfinite(outcome["stiffness_n_per_m"])]
    low, high = exact_interval(int(stable.sum()), len(stable))
    tried = replace(
        not_tried,
        stable=int(stable.sum()),
        stable_low=low,
        stable_high=high,
        stable_by_motion={name: int(rested.sum()) for name, rested in rest.items()},
        asymptotic=int(outcome["asymptotic"].sum()),
        apparent_stiffness_n_per_m=float(np.median(stiffness)) if len(stiffness) else None,
    )
    if "distance" not in outcome or opponent not in outcomes:
        return tried
    nearer, farther = choose(outcome["distance"], outcomes[opponent]["distance"])
    return replace(tried, matched=int(nearer.sum()), unable=int((~(nearer | farther)).sum()))


def _paper(wall: str, coupling: str) -> PaperCount | None:
    """Return what the paper counted; None of what it did not try."""
    counted = PAPER.get(wall)
    if counted is None or coupling not in ("none", "static", "schedule"):
        return None
    matched = {"none": None, "static": counted.static, "schedule": counted.adaptive}[coupling]
    return PaperCount(counted.stable if coupling == "none" else PAPER_PEOPLE, matched, counted.unable)
