"""Stiffest wall that a device renders to simulated hands, and the sensitivity of that limit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

from avc_casadi._util.json_values import plain
from avc_casadi._util.parallel import mapped
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.claims.deployable import deployable
from avc_casadi.design.robust.cma_continuation import moved
from avc_casadi.loops.walls import softest_wall_n_per_m, stiffest_wall
from avc_casadi.model.hands import hand_corners, with_released
from avc_casadi.recommendation.preconditions import assumed, not_used, why_infeasible
from avc_casadi.recommendation.rank import Judged, best_of, devices_of
from avc_casadi.recommendation.search_schedule import judged_candidates
from avc_casadi.recommendation.sensitivity import linear_changes, simulated_changes
from avc_casadi.simulation.population.coupling_trial import try_coupling
from avc_casadi.simulation.population.operators import people_of

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from avc_casadi.design.robust.cma_continuation import Step
    from avc_casadi.loops.walls import DampingRange
    from avc_casadi.model.device import Device
    from avc_casadi.model.problem import Problem

# Unreachable stiffness, over the limit of spring and damper.
_FAR = 1e3
# Numbers of continuations: for the device as it is those of a recommendation and of a second search; one for a changed
# device.
_AS_IT_IS, _ONCE = (range(2), range(2, 4)), range(1)


@dataclass(frozen=True)
class _Asked:
    """Settings of the trials: number of hands, seed, whether settling by dry friction suffices."""

    hands: int
    seed: int
    lean_on_friction: bool


def stiffest(
    problem: Problem,
    hands: int = 100,
    seed: int = 0,
    *,
    lean_on_friction: bool = False,
    workers: int = 1,
    progress: Progress = SILENT,
    executor: Executor | None = None,
) -> dict[str, Any]:
    """Return the stiffest wall at which simulated hands settle as safely as in `recommend`, and its sensitivities.

    The search is that of `recommend` for an unreachable wall, with every declared effect simulated. The law of the
    device as it is serves as initial guess for each changed device, possibly a poor one; its best coupling is tried
    there too, so that an improvement never counts as a loss where that coupling stays stable.

    Args:
        problem: the device and its hands; its wall and detents do not matter.
        hands: number of simulated hands, corners of [hands] among them.
        seed: of their draw.
        lean_on_friction: whether settling by the declared dry friction alone suffices.
        workers: processes; more than one start this program anew, so that a script needs its guard.
        progress: reports the searches.
        executor: runs the searches instead, as for `mapped`.

    Returns:
        The document of `avc recommend P --stiffest`: JSON values. ``stiffest_wall_n_per_m`` is the static stiffness
        rendered by the coupling found, None where there is none; ``plain_wall_n_per_m`` is that of a spring and damper
        by linear stability alone, with the ``damping_ns_per_m`` that it needs; 0 where none is stable.
    """
    simple, _ = _unreachable_wall(problem)
    asked = _Asked(hands, seed, lean_on_friction)
    better = linear_changes(problem) | simulated_changes(problem)
    done = partial(mapped, _called, executor=executor, workers=workers, things="searches", progress=progress)
    with progress.step("stiffest wall"):
        begun: list[_Task] = [partial(_as_it_is, problem, asked, numbers) for numbers in _AS_IT_IS]
        best = _best_of(done(begun), asked)
    reached = "no wall" if best is None else f"{best.judged.felt_n_per_m:.4g}"
    changed: list[_Task] = [partial(_changed, best, one, asked) for one in better.values()]
    if best is not None:
        changed += [partial(_kept, best, one, asked) for one in better.values()]
    with progress.step(f"{reached} as it is; what would help"):
        found = done(changed)
    helps = []
    for place, change in enumerate(better):
        one = _best_of(found[place :: len(better)], asked)
        helps.append({"change": change, **_told(None if one is None else one.judged)})
    judged = None if best is None else best.judged
    document: dict[str, Any] = plain(
        {
            "problem": problem.name,
            **_told(judged),
            "by": None if judged is None else judged.coupling.method,
            "quiet": None if judged is None else int(judged.trial.quiet.sum()),
            "at_force_limit": None if judged is None else int(judged.trial.at_force_limit.sum()),
            "confirmed": None if judged is None or judged.others is None else judged.others.counts(),
            "plain_wall_n_per_m": simple.stiffness_n_per_m,
            "damping_ns_per_m": [simple.lowest_ns_per_m, simple.highest_ns_per_m],
            "what_would_help": sorted(helps, key=_safest_then_stiffest),
            "assumed": list(assumed(problem.changed(detent=None), devices=devices_of(judged))),
            "not_used": list(not_used(problem)),
        }
    )
    return document


def _unreachable_wall(problem: Problem) -> tuple[DampingRange, Problem]:
    """Return the limit of spring and damper, and the problem with a much stiffer undamped wall."""
    simple = stiffest_wall(problem.device, with_released(hand_corners(problem.hands)))
    far = _FAR * max(simple.stiffness_n_per_m, softest_wall_n_per_m(problem.device))
    wall = {"stiffness_n_per_m": far, "damping_ns_per_m": 0.0}
    return simple, problem.changed(environment=wall, detent=None)


@dataclass(frozen=True)
class _Best:
    """The best coupling of a device.

    Attributes:
        judged: the coupling with its trial.
        step: the wall and the law behind it; None behind a spring and damper.
    """

    judged: Judged
    step: Step | None


_Task = Callable[[], "_Best | None"]


def _called(task: _Task) -> _Best | None:
    return task()


def _best(
    problem: Problem,
    limit: DampingRange,
    asked: _Asked,
    *,
    climbs: range,
    start: Step | None = None,
) -> _Best | None:
    """Return the stiffest coupling, if any is stable; arguments as for `judged_candidates`."""
    if why_infeasible(problem):
        return None
    people, lean = people_of(problem.hands, asked.hands, asked.seed), asked.lean_on_friction
    found = judged_candidates(
        problem,
        people,
        asked.seed,
        limit,
        SILENT,
        lean_on_friction=lean,
        start=start,
        climbs=climbs,
        stiffest=True,
    )
    if not found.judged:
        return None
    best = best_of(found.judged, lean_on_friction=lean, stiffest=True)
    law = best.coupling.runtime.state_feedback
    laws = ((step, one) for step in found.steps for one in step.candidates if one.law is law)
    steps = (replace(step, candidates=(one,)) for step, one in laws)
    return _Best(best, next(steps, None))


def _as_it_is(problem: Problem, asked: _Asked, climbs: range) -> _Best | None:
    """Search on the unchanged device."""
    simple, walled = _unreachable_wall(problem)
    return _best(walled, simple, asked, climbs=climbs)


def _changed(before: _Best | None, changed: Problem, asked: _Asked) -> _Best | None:
    """Search on a changed device, from the law of the unchanged one if any."""
    simple, walled = _unreachable_wall(changed)
    start = None
    if before is not None and before.step is not None:
        start = moved(before.step, before.judged.coupling.problem, walled)
    return _best(walled, simple, asked, climbs=_ONCE, start=start)


def _kept(before: _Best, changed: Problem, asked: _Asked) -> _Best | None:
    """Try the coupling of the unchanged device on a changed one; None at another rate or where not deployable."""
    if changed.device.sample_time_s != before.judged.coupling.problem.device.sample_time_s:
        return None
    if _only_stronger(changed.device, before.judged.coupling.problem.device):
        return before
    coupling, (_, walled) = before.judged.coupling, _unreachable_wall(changed)
    other = replace(coupling, problem=coupling.problem.changed(device=walled.device))
    if not deployable(other).passed:
        return None
    people = people_of(walled.hands, asked.hands, asked.seed)
    return _Best(Judged(other, try_coupling(other, people, asked.seed), 0), None)


def _only_stronger(device: Device, before: Device) -> bool:
    """Return whether only the force limit differs, which the coupling need not reach."""
    force: dict[str, Any] = {"max_force_n": True, "range": {"max_force_n": True}}
    return device.model_dump(exclude=force) == before.model_dump(exclude=force)


def _safest_then_stiffest(told: dict[str, Any]) -> tuple[float, ...]:
    counts = (told["at_rest_without_friction"] == told["hands"], told["at_rest"] == told["hands"])
    return (*(-float(everybody) for everybody in counts), -(told["stiffest_wall_n_per_m"] or 0.0))


def _best_of(found: Sequence[_Best | None], asked: _Asked) -> _Best | None:
    """Return the best of several results, which may be None."""
    some = [one for one in found if one is not None]
    if not some:
        return None
    best = best_of([one.judged for one in some], lean_on_friction=asked.lean_on_friction, stiffest=True)
    return next(one for one in some if one.judged is best)


def _told(best: Judged | None) -> dict[str, Any]:
    if best is None:
        return {"stiffest_wall_n_per_m": None, "hands": None, "at_rest": None, "at_rest_without_friction": None}
    count = best.trial.counts()
    return {
        "stiffest_wall_n_per_m": best.felt_n_per_m,
        **{key: count[key] for key in ("hands", "at_rest", "at_rest_without_friction")},
    }
