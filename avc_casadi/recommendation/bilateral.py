"""Recommend the coupling between a leader and a follower: spring, dampers, rendered impedance, limits."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from avc_casadi._util.progress import SILENT, Progress
from avc_casadi._util.text import quantity
from avc_casadi.claims.passivity.teleoperator import Teleoperator, damping_needed_ns_per_m, passivity_margin
from avc_casadi.coupling import Coupling
from avc_casadi.design.virtual_tool import CouplingSearch, Scale, ToolSearchOptions
from avc_casadi.loops.follower import FollowerLoops, required_follower
from avc_casadi.recommendation.preconditions import assumed, not_used
from avc_casadi.recommendation.recommendation import Pair, Recommendation
from avc_casadi.recommendation.tool_impedance import rendered_follower
from avc_casadi.recommendation.virtual_tool import why_not_wanted
from avc_casadi.simulation.population.operators import people_of
from avc_casadi.simulation.population.other_ends import try_bilateral

if TYPE_CHECKING:
    from avc_casadi.model.device import Device
    from avc_casadi.model.ends import ToolGains
    from avc_casadi.model.hands import Hand
    from avc_casadi.model.problem import Problem
    from avc_casadi.simulation.population.trial import Trial


@dataclass(frozen=True)
class BilateralOptions:
    """Numbers of the recommendation.

    Attributes:
        gain_margin: K and B may be this many times as large before a loop is unstable; see `ToolOptions`.
        share_of_safe: where no stiffness is wanted, the initial stiffness is this share of the stiffest that has the
            gain margin.
        softer: ratio of successive stiffnesses while hands do not settle.
        tries: largest number of stiffnesses.
    """

    gain_margin: float = 1.5
    share_of_safe: float = 0.9
    softer: float = 0.85
    tries: int = 5


OPTIONS = BilateralOptions()
# Long delays make large matrices, so fewer dampers are tried.
_SEARCH = ToolSearchOptions(dampers=13, local_ratios=(0.2, 0.5, 1.0), precision=0.01)


def recommend_bilateral(
    problem: Problem,
    hands: int = 50,
    seed: int = 0,
    *,
    versions: Mapping[str, str] | None = None,
    progress: Progress = SILENT,
    options: BilateralOptions = OPTIONS,
) -> Recommendation:
    """Return the spring and dampers between a leader and its follower."""
    follower, loops = required_follower(problem), FollowerLoops(problem)
    slow_s = max(sum(one) for one in follower.delays_s)
    search = CouplingSearch(loops, Scale.of(problem, slow_s), _SEARCH)
    wanted = follower.stiffness_n_per_m
    stiffest = search.stiffest()
    safe = search.stiffest_with_margin(stiffest, options.gain_margin, local=False)
    first = options.share_of_safe * (safe or stiffest.stiffness_n_per_m / options.gain_margin)
    local = wanted is not None and wanted > first
    gains, trial = None, None
    if stiffest.stiffness_n_per_m > 0 or local:
        first = first if wanted is None else wanted
        people = people_of(problem.hands, hands, seed)
        gains, trial = _tried(problem, search, first, people, seed, progress, options, local=local)
    margin, needed = _passivity(problem, gains or stiffest)
    gain_margin = None if gains is None else search.gain_margin_over_ranges(gains)
    coupling = None
    if gains is not None and trial is not None:
        certificate = {"loops": len(loops), "gain_margin": gain_margin, "passivity_margin_ns_per_m": margin}
        coupling = Coupling.between(problem, gains, certificate, trial.document(), versions or {})
    return Recommendation(
        problem=problem,
        coupling=coupling,
        deployable=gains is not None,
        reason=_reason(problem, gains, stiffest, trial),
        trial=trial if gains is not None else None,
        assumed=(*assumed(problem), *_assumed(problem)),
        not_used=not_used(problem),
        pair=Pair(
            stiffest=stiffest,
            worst=loops.radius(stiffest.times(1.05) if stiffest.stiffness_n_per_m else search.softest)[1],
            loops=len(loops),
            gain_margin=gain_margin,
            mode=None if gains is None else loops.slowest(gains),
            felt=() if gains is None else tuple(rendered_follower(problem, gains)),
            passivity_margin_ns_per_m=margin,
            passive_damping_ns_per_m=needed,
        ),
    )


def _tried(
    problem: Problem,
    search: CouplingSearch,
    first_n_per_m: float,
    people: Hand,
    seed: int,
    progress: Progress,
    options: BilateralOptions,
    *,
    local: bool,
) -> tuple[ToolGains | None, Trial | None]:
    """Return the stiffest coupling with which all hands settle, or none; a wanted K alone, twice: loops get known."""
    count, softer = (2, 1.0) if required_follower(problem).stiffness_n_per_m else (options.tries, options.softer)
    trial, stiffness = None, first_n_per_m
    for number in range(count):
        progress.advance(number, count, f"K of {quantity(stiffness, problem.units.unit('N/m'))}")
        for gains in search.damped(stiffness, local=local, gain_margin=options.gain_margin):
            trial = try_bilateral(problem, gains, people, seed)
            if trial.settled and not search.refuted(gains, options.gain_margin):
                return gains, trial
        stiffness *= softer
    return None, trial


def _passivity(problem: Problem, gains: ToolGains) -> tuple[float | None, float | None]:
    follower, leader = required_follower(problem), problem.device
    other, t = follower.at_leader(), leader.sample_time_s
    if follower.architecture != "position-position" or not math.isclose(t, other.sample_time_s, rel_tol=1e-9):
        return None, None
    pairs = []
    for delays_s in follower.delays_s:
        there, back = (delay_s / t for delay_s in delays_s)
        # Unsynchronised clocks delay messages by at most this many samples, both ends together.
        wait = 1 + (-(there + back)) % 1
        pairs.append(
            Teleoperator(
                _least_damping(leader),
                _least_damping(other),
                t,
                there + wait / 2,
                back + wait / 2,
                _longest_delay(leader),
                _longest_delay(other),
            )
        )
    return (
        min(passivity_margin(pair, gains)[0] for pair in pairs),
        max(damping_needed_ns_per_m(pair, gains) for pair in pairs),
    )


def _least_damping(device: Device) -> float:
    known = device.range.damping_ns_per_m
    return device.damping_ns_per_m if known is None else known[0]


def _longest_delay(device: Device) -> float:
    known = device.range.delay_samples
    return device.delay_samples if known is None else known[1]


def _reason(problem: Problem, gains: ToolGains | None, stiffest: ToolGains, trial: Trial | None) -> str:
    wanted = required_follower(problem).stiffness_n_per_m
    if gains is not None:
        what = (
            "the stiffness that is wanted"
            if wanted is not None
            else "the stiffest that keeps its margin without local dampers"
        )
        return f"{what}, all hands settled"
    if trial is None and wanted is not None:
        return why_not_wanted(wanted, stiffest.stiffness_n_per_m)
    if trial is None:
        return f"the stiffest coupling that is stable has stiffness_n_per_m = {stiffest.stiffness_n_per_m:.4g}"
    name, settled = min(trial.by_motion.items(), key=lambda one: int(one[1].sum()))
    found = (
        f"of {trial.hands} simulated hands {int(trial.stable.sum())} settle with the softest coupling that was tried; "
        f"hardest for them: {name}, {int(settled.sum())} settle"
    )
    if _least_damping(required_follower(problem)) > 0:
        return found
    return (
        f"{found}; the follower has no damping of its own, and swings long on a soft spring: damp it, or ask for more K"
    )


def _assumed(problem: Problem) -> list[str]:
    follower = required_follower(problem)
    found = ["the trial has no dry friction, at neither end"]
    if follower.contact_damping_ns_per_m is None:
        found.append("what the follower touches is damped by a tenth of the critical damping")
    if follower.jitter == 0 and follower.lost_share == 0:
        found.append("the link is even: no jitter and no lost messages are declared")
    return found
