"""Rows of a recommendation: verdict, rows by the kind of the answer, reason and assumptions."""

from __future__ import annotations

from collections.abc import Sequence
from functools import singledispatch
from shlex import quote

from avc_casadi.present.row import Answer, Mark, Row, caution, row
from avc_casadi.present.rows import other_ends, reasons, subject, wall
from avc_casadi.recommendation.assumptions import Slip
from avc_casadi.recommendation.recommendation import (
    Decision,
    NoCoupling,
    NoPair,
    NoWallCoupling,
    PairRecommendation,
    Recommendation,
    WallRecommendation,
)


def recommendation(recommended: Recommendation, shown: str = "", file: str | None = None) -> Answer:
    """Return the answer of `recommend`; ``file`` holds the coupling."""
    problem = recommended.problem
    onwards = _onwards(recommended)
    if recommended.deployable and file is not None:
        onwards = f"export {quote(file)} --c firmware"
    complaint = "" if recommended.deployable else f"avc: {problem.name}: no coupling is deployable"
    rows = [*rows_of(recommended), *_details(recommended)]
    return subject.answer("recommend", recommended.data(), problem, shown, rows, onwards, complaint=complaint)


@singledispatch
def rows_of(recommended: Recommendation) -> list[Row]:
    """Return the rows of a recommendation of one kind, the most important first."""
    raise TypeError(f"no rows for {type(recommended).__name__}")


rows_of.register(NoWallCoupling, wall.no_wall_rows)
rows_of.register(WallRecommendation, wall.wall_rows)
rows_of.register(NoPair, other_ends.no_pair_rows)
rows_of.register(PairRecommendation, other_ends.pair_rows)


@singledispatch
def _onwards(recommended: Recommendation) -> str:  # noqa: ARG001
    """Return the command to type next."""
    return "recommend {} --out coupling.json"


@_onwards.register
def _onwards_from_none(recommended: NoCoupling) -> str:  # noqa: ARG001
    return "check {}"


@_onwards.register
def _onwards_from_no_wall(recommended: NoWallCoupling) -> str:
    return "recommend {}" if recommended.limits.no_stiffer else "check {}"


@_onwards.register
def _onwards_from_wall(recommended: WallRecommendation) -> str:
    """Return the next command after a recommendation for a wall; {} stands for its file."""
    nothing = (
        recommended.decision is Decision.NOTHING_RENDERED or recommended.problem.environment.stiffness_n_per_m == 0
    )
    if not recommended.deployable and (nothing or wall.slips(recommended)):
        return "check {}"
    if recommended.limits.no_stiffer:
        return "recommend {} --stiffest --out coupling.json"
    if not recommended.deployable or wall.is_noticed(recommended.rendered):
        return "recommend {} --stiffest"
    return "recommend {} --out coupling.json"


def ringing(rows: Sequence[Row]) -> list[Row]:
    """Return the rows that say of a coupling that it rings: its verdict is a caution."""
    return [shown for shown in rows if shown.label == subject.DAMPING_RATIO and shown.mark is Mark.CAUTION]


def verdict(recommended: Recommendation, rows: Sequence[Row]) -> tuple[str, bool]:
    """Return the verdict in a line, and whether it is a yes; of a coupling that rings it says so first."""
    units = recommended.problem.units
    if recommended.coupling is None:
        return f"Deploy nothing: {reasons.headline(recommended.why, units)}.", False
    if not recommended.deployable:
        return f"Do not deploy this coupling: {recommended.reason}.", False
    doubtful = [shown for shown in rows if shown.mark in {Mark.CAUTION, Mark.FAIL}]
    lightly_damped = ringing(rows)
    doubts = ", ".join(dict.fromkeys(shown.label for shown in doubtful if shown not in lightly_damped))
    rings = "".join(f"; its damping ratio is {shown.text(units)}" for shown in lightly_damped)
    return f"Deploy this coupling{rings}{f'; see {doubts}' if doubts else ''}.", True


@singledispatch
def _details(recommended: Recommendation) -> list[Row]:
    """Return the rows of lower rank: what was simulated, why this one, assumptions."""
    trial = recommended.trial
    rows = [] if trial is None else [row("Simulated effects", ", ".join(trial.by_motion), rank=1)]
    return [*rows, row("Reason", recommended.reason, rank=1), *_assumed(recommended)]


@_details.register
def _wall_details(recommended: WallRecommendation) -> list[Row]:
    """Return the rows of lower rank: limit cycles, what was simulated, why this one, assumptions."""
    rest, trial = recommended.rest, recommended.trial
    noticed = wall.is_noticed(recommended.rendered)
    simulated = filter(None, (", ".join(trial.effects), ", ".join(trial.by_motion)))
    return [
        row("Limit cycles", f"{rest.word}: {rest.sentence}", rank=1),
        row("Simulated effects", "; ".join(simulated), rank=1),
        row("Reason", recommended.reason, mark=caution(noticed), rank=0 if noticed else 1),
        *_assumed(recommended),
    ]


def _assumed(recommended: Recommendation) -> list[Row]:
    assumed = (assumption.text for assumption in recommended.assumed if not isinstance(assumption, Slip))
    return subject.notes(assumed, "Assumed", Mark.NONE, 1)
