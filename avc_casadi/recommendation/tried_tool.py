"""Which coupling to a simulation hands settle with: the stiffest first, softer ones after it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from avc_casadi._util.progress import SILENT, Progress
from avc_casadi._util.text import quantity
from avc_casadi.loops.engine import required_tool
from avc_casadi.simulation.population.operators import people_of
from avc_casadi.simulation.population.other_ends import try_tool

if TYPE_CHECKING:
    from avc_casadi.design.virtual_tool import ToolSearch
    from avc_casadi.model.ends import ToolGains
    from avc_casadi.model.problem import Problem
    from avc_casadi.simulation.population.trial import Trial


@dataclass(frozen=True)
class ToolOptions:
    """Numbers of the recommendation.

    Attributes:
        gain_margin: K and B may be this many times as large before a hand, released, a tool or a contact is unstable.
            Usual design margins lie between 1.5 and 2 (Astrom and Murray, Feedback Systems, 10.3).
        share_of_safe: where no stiffness is wanted, the initial stiffness is this share of the stiffest that has the
            gain margin: with freedom to choose the damper.
        softer: ratio of successive stiffnesses while hands do not settle.
        tries: largest number of stiffnesses.
        for_friction: largest number of softer ones tried to settle without dry friction.
    """

    gain_margin: float = 1.5
    share_of_safe: float = 0.9
    softer: float = 0.8
    tries: int = 12
    for_friction: int = 2


OPTIONS = ToolOptions()
# Screening hands (corners) and their motions: a coupling that fails with them is tried no further.
_FIRST, _HARDEST = 16, ("touch", "free")


def tried_coupling(
    problem: Problem,
    search: ToolSearch,
    hands: int = 100,
    seed: int = 0,
    progress: Progress = SILENT,
    options: ToolOptions = OPTIONS,
) -> tuple[ToolGains | None, Trial | None, tuple[float, Trial] | None]:
    """Return the coupling that is recommended, alone: the stiffest with its margin with which all hands settle."""
    (stiffest, local), wanted = search.limit, required_tool(problem).stiffness_n_per_m
    if wanted is not None:
        if not search.holds(wanted, local=local):
            return None, None, None
        return _tried(problem, search, wanted, hands, seed, progress, options, local=local)
    safe = search.stiffest_with_margin(stiffest, options.gain_margin, local=local)
    first = options.share_of_safe * (safe or stiffest.stiffness_n_per_m / options.gain_margin)
    return _tried(problem, search, first, hands, seed, progress, options, local=local)


def _tried(
    problem: Problem,
    search: ToolSearch,
    first_n_per_m: float,
    hands: int,
    seed: int,
    progress: Progress,
    options: ToolOptions,
    *,
    local: bool,
) -> tuple[ToolGains | None, Trial | None, tuple[float, Trial] | None]:
    """Return the stiffest coupling with which all hands settle, without dry friction if one does."""
    tool = required_tool(problem)
    people = people_of(problem.hands, hands, seed)
    count = options.tries if tool.stiffness_n_per_m is None else 1
    trial, stiffness = None, first_n_per_m
    first = people.pick(slice(0, _FIRST))
    leaning: tuple[ToolGains, Trial] | None = None
    refuted: tuple[float, Trial] | None = None
    before = refuted
    for number in range(count):
        progress.advance(number, count, f"K of {quantity(stiffness, problem.units.unit('N/m'))}")
        tries: list[Trial] = []
        for gains in search.damped(stiffness, local=local, gain_margin=options.gain_margin):
            trial = try_tool(problem, gains, first, seed, _HARDEST)
            if trial.settled_with_friction and search.refuted(gains, options.gain_margin):
                continue
            if trial.settled_with_friction:
                trial = try_tool(problem, gains, people, seed)
            if trial.settled:
                return gains, trial, refuted
            if leaning is None and trial.settled_with_friction:
                leaning, before = (gains, trial), refuted
            tries.append(trial)
        if tries:
            refuted = stiffness, max(tries, key=_settled_share)
        if leaning is not None and number >= options.for_friction:
            break
        stiffness *= options.softer
    return (*leaning, before) if leaning else (None, trial, refuted)


def _settled_share(trial: Trial) -> float:
    each = trial.stable & trial.stable_with_dropped_steps & trial.stable_without_friction
    return float(each.mean())


def unsettled(stiffness_n_per_m: float, trial: Trial) -> str:
    """Return how many hands do not settle with a stiffness, and in which motion most of them."""
    name, settled = min(trial.by_motion.items(), key=lambda one: int(one[1].sum()))
    count, where = int((~settled).sum()), f"in {name}"
    if count == 0:
        count, where = int((~trial.stable_with_dropped_steps).sum()), "where the engine misses steps"
    if count == 0:
        count, where = int((~trial.stable_without_friction).sum()), "without dry friction"
    some = f"{count} of {trial.hands} hands {'does' if count == 1 else 'do'} not settle"
    return f"with K {stiffness_n_per_m:.6g} {some}, {where}"
