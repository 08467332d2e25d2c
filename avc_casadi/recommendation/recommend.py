"""Recommend a coupling to deploy: what it renders, its limits and sensitivities."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Executor
from functools import singledispatch
from typing import Any, Protocol, TypeVar

from avc_casadi._util.counts import hands_count, refuse_counts, seed_count, workers_count
from avc_casadi._util.parallel import Crew
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.coupling import Coupling
from avc_casadi.files.problem_file import AnyProblem, accepts_problem, require_device
from avc_casadi.model.ends import End, Follower, Simulation, Wall
from avc_casadi.model.gains import GainSchedule
from avc_casadi.model.problem import Problem
from avc_casadi.recommendation.pair import FollowerDesign, PairDesign, ToolDesign
from avc_casadi.recommendation.reasons import Reason
from avc_casadi.recommendation.recommendation import Recommendation, WallRecommendation
from avc_casadi.recommendation.request import Request, request_of
from avc_casadi.recommendation.wall import WallDesign, judged

Best = TypeVar("Best")


class CouplingDesign(Protocol[Best]):
    """Design of the coupling to one kind of end: its loops, candidates and trials, and the answer made of them."""

    def why_infeasible(self) -> Reason | None:
        """Return why no coupling is deployable at any gains; None where one may be."""

    def best(self) -> Best | None:
        """Return the best coupling; None where none is deployable."""

    def recommendation(self, best: Best) -> Recommendation:
        """Return the answer with a coupling."""

    def no_coupling(self, infeasible: Reason | None) -> Recommendation:
        """Return the answer without a coupling: infeasible for a reason, or None where trials refused all couplings."""


@singledispatch
def design_of(end: End, problem: Problem, request: Request, crew: Crew) -> CouplingDesign[Any]:  # noqa: ARG001
    """Return how the coupling of a problem is designed, by the kind of its end; other kinds get spring and dampers."""
    return PairDesign(problem, request)


@design_of.register
def _wall_design(end: Wall, problem: Problem, request: Request, crew: Crew) -> CouplingDesign[Any]:  # noqa: ARG001
    return WallDesign(problem, request, crew)


@design_of.register
def _tool_design(end: Simulation, problem: Problem, request: Request, crew: Crew) -> CouplingDesign[Any]:  # noqa: ARG001
    return ToolDesign(problem, request, end)


@design_of.register
def _follower_design(end: Follower, problem: Problem, request: Request, crew: Crew) -> CouplingDesign[Any]:  # noqa: ARG001
    return FollowerDesign(problem, request, end)


@accepts_problem
def recommend(  # noqa: PLR0913 - options by name, of a public call
    problem: AnyProblem,
    hands: int = 100,
    seed: int = 0,
    *,
    stiffest: bool = False,
    lean_on_friction: bool = False,
    prove: bool = False,
    with_trade_off: bool = False,
    versions: Mapping[str, str] | None = None,
    workers: int = 1,
    progress: Progress = SILENT,
    executor: Executor | None = None,
) -> Recommendation:
    """Return the coupling to deploy to a wall, a [simulation] or a [follower], with its analysis.

    Args:
        problem: a problem with a wall, a [simulation] or a [follower]; or its file, or a name of the catalogue.
        hands: number of simulated hands that try each candidate; the extreme hands of [hands] are among them. Twice as
            many new hands try the best coupling to a wall.
        seed: seed of the hands that are drawn.
        stiffest: take the stiffest wall, without a damper, that is rendered within 20 % from 1 to 10 Hz (walls only).
        lean_on_friction: accept couplings that settle only by the declared dry friction (walls only).
        prove: try to prove that every hand comes to rest, as `certify` does (walls only).
        with_trade_off: compute what a disk margin costs, too (walls only).
        versions: versions of the software that are written into the coupling, by name.
        workers: number of processes, this one included (walls only).
        progress: receiver of the progress.
        executor: runs the trials in place of the processes of this call (walls only).

    Raises:
        InputError: faults of the file, a count out of its range (at most 100 000 hands), or an option that does not
            apply to the remote end.
        WorkerLostError: a worker died.

    Example:
        >>> found = avc.recommend("spring", hands=10)
        >>> found.deployable
        True
    """
    stated = require_device(problem)
    refuse_counts(hands_count(hands), seed_count(seed), workers_count(workers))
    options = Request(
        hands=hands,
        seed=seed,
        stiffest=stiffest,
        lean_on_friction=lean_on_friction,
        prove=prove,
        with_trade_off=with_trade_off,
        versions=versions or {},
        workers=workers,
        progress=progress,
        executor=executor,
    )
    request = request_of(stated.end, options)
    with Crew(request.workers) as crew:
        design = design_of(stated.end, stated, request, crew)
        infeasible = design.why_infeasible()
        best = design.best() if infeasible is None else None
        return design.no_coupling(infeasible) if best is None else design.recommendation(best)


def judged_as_recommended(
    problem: Problem,
    gains: GainSchedule,
    hands: int = 100,
    *,
    versions: Mapping[str, str] | None = None,
    progress: Progress = SILENT,
) -> WallRecommendation:
    """Return the gains of a method, whatever the verdict: certified, and tried by hands that press, tap and hold.

    The strikes, the loose grips and the second hands of `recommend` are left out.
    """
    refuse_counts(hands_count(hands))
    return judged(Coupling.from_schedule(problem, gains, versions=versions), gains, hands, progress)
