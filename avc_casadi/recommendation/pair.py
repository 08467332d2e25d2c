"""Recommend the coupling between a device and a simulation or a follower: spring, dampers, what is rendered, limits."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from avc_casadi._util.progress import SILENT, Progress
from avc_casadi._util.text import quantity
from avc_casadi.claims.llewellyn import Teleoperator, least_damping_ns_per_m, passivity_margin
from avc_casadi.coupling import Coupling
from avc_casadi.design.virtual_tool import CouplingSearch, FollowerSearch, ToolSearch, certify_pair
from avc_casadi.loops.engine import ToolLoops, tool_of
from avc_casadi.loops.follower import follower_of
from avc_casadi.model.device import Device
from avc_casadi.model.ends import ToolGains, VirtualTool
from avc_casadi.model.hands import Hand
from avc_casadi.model.problem import Problem
from avc_casadi.recommendation.felt import rendered_pair
from avc_casadi.recommendation.preconditions import assumed, not_used
from avc_casadi.recommendation.recommendation import Pair, Recommendation
from avc_casadi.recommendation.sensitivity import (
    same_stiffness,
    search_ends,
    stable_on_other_devices,
    what_would_help_tool,
)
from avc_casadi.simulation.population.operators import people_of
from avc_casadi.simulation.population.other_ends import WITH_TOOL, try_bilateral, try_tool
from avc_casadi.simulation.population.trial import Trial

GAIN_MARGIN = 1.5
"""K and B may be this many times as large before a hand, released, a tool or a contact is unstable.

Usual design margins lie between 1.5 and 2 (Astrom and Murray, Feedback Systems, 10.3).
"""


def recommend_tool(
    problem: Problem,
    hands: int = 100,
    seed: int = 0,
    *,
    versions: Mapping[str, str] | None = None,
    progress: Progress = SILENT,
) -> Recommendation:
    """Return spring and damper to a simulation: every loop stable with a margin, and simulated hands settle."""
    tool, search = tool_of(problem), ToolSearch(problem)
    (stiffest, local), wanted = search.limit, tool.stiffness_n_per_m
    limit = stiffest.stiffness_n_per_m
    why, tried = _why_infeasible(problem, search), _Tried()
    if not why and (wanted is None or search.held(wanted, local=local)):

        def trial_of(gains: ToolGains, people: Hand, *, screen: bool) -> Trial:
            return try_tool(problem, gains, people, seed, ("touch", "free") if screen else WITH_TOOL)

        first, count = (_first(search, stiffest, local=local), 12) if wanted is None else (wanted, 1)
        people = people_of(problem.hands, hands, seed)
        tried = _stiffest_settled(problem, search, people, trial_of, first, count, 0.8, progress, local=local)
    gains, trial, stiffer = tried
    if not why and gains is None:
        why = _why_no_tool(problem, limit, trial)
    coupling, deployable = None, gains is not None
    certificate: dict[str, Any] = {}
    if gains is not None and trial is not None:
        certificate = certify_pair(problem, gains, search)
        coupling = Coupling.between(problem, gains, certificate, trial.document(), versions or {})
    # What is only linearly stable is no help where hands refute it.
    same = gains.stiffness_n_per_m if gains is not None else wanted if trial is None else None
    return Recommendation(
        problem=problem,
        coupling=coupling,
        deployable=deployable,
        reason=why or _tool_reason(problem, certificate.get("gain_margin", 0.0), stiffer),
        trial=trial if deployable else None,
        helps=what_would_help_tool(problem, search, local=local),
        assumed=(*assumed(problem), *_assumed_of_tool(tool)),
        not_used=not_used(problem),
        pair=Pair(
            stiffest=stiffest,
            worst=search.loops.radius(stiffest.times(1.02) if limit else search.softest)[1],
            loops=len(search.loops),
            gain_margin=certificate.get("gain_margin"),
            motor_margins=certificate.get("motor_margins", ()),
            mode=None if gains is None else search.loops.slowest(gains),
            felt=() if gains is None else rendered_pair(problem, gains),
            set_by=_unsettled(problem, *stiffer) if gains is not None and stiffer is not None else "",
            mismatch_stable=None if gains is None else stable_on_other_devices(problem, gains),
            local_dampers_ns_per_m=search.local_dampers_ns_per_m(gains) if local and gains is not None else None,
            **({} if same is None else same_stiffness(problem, same, local=local)),
            searched_to=search_ends(problem),
        ),
    )


def recommend_bilateral(
    problem: Problem,
    hands: int = 50,
    seed: int = 0,
    *,
    versions: Mapping[str, str] | None = None,
    progress: Progress = SILENT,
) -> Recommendation:
    """Return the spring and dampers between a leader and its follower."""
    search = FollowerSearch(problem)
    loops, wanted, stiffest = search.loops, search.loops.follower.stiffness_n_per_m, search.stiffest()
    first = _first(search, stiffest, local=False)
    local, tried = wanted is not None and wanted > first, _Tried()
    if stiffest.stiffness_n_per_m > 0 or local:

        def trial_of(gains: ToolGains, people: Hand, *, screen: bool) -> Trial:  # noqa: ARG001
            return try_bilateral(problem, gains, people, seed)

        # A wanted K alone, twice: loops get known.
        start, count, softer = (first, 5, 0.85) if wanted is None else (wanted, 2, 1.0)
        people = people_of(problem.hands, hands, seed)
        tried = _stiffest_settled(problem, search, people, trial_of, start, count, softer, progress, local=local)
    gains, trial, _ = tried
    margin, needed = _passivity(problem, gains or stiffest)
    margins = {} if gains is None else search.margins(gains)
    coupling = None
    if gains is not None and trial is not None:
        certificate = {"loops": len(loops), **margins, "passivity_margin_ns_per_m": margin}
        coupling = Coupling.between(problem, gains, certificate, trial.document(), versions or {})
    return Recommendation(
        problem=problem,
        coupling=coupling,
        deployable=gains is not None,
        reason=_follower_reason(problem, gains, stiffest, trial),
        trial=trial if gains is not None else None,
        assumed=(*assumed(problem), *_assumed_of_follower(problem)),
        not_used=not_used(problem),
        pair=Pair(
            stiffest=stiffest,
            worst=loops.radius(stiffest.times(1.05) if stiffest.stiffness_n_per_m else search.softest)[1],
            loops=len(loops),
            **margins,
            mode=None if gains is None else loops.slowest(gains),
            felt=() if gains is None else rendered_pair(problem, gains),
            passivity_margin_ns_per_m=margin,
            passive_damping_ns_per_m=needed,
        ),
    )


def _first(search: CouplingSearch, stiffest: ToolGains, *, local: bool) -> float:
    """Return the initial stiffness where none is wanted: nine tenths of the stiffest that has the gain margin."""
    each = (search.stiffest_with_margin(stiffest, margin, local=local) for margin in (GAIN_MARGIN, search.least))
    return 0.9 * (next(filter(None, each), 0.0) or stiffest.stiffness_n_per_m / GAIN_MARGIN)


class _Tried(NamedTuple):
    """The coupling with which hands settle, the last trial, and the softest stiffer coupling with which they do not."""

    gains: ToolGains | None = None
    trial: Trial | None = None
    stiffer: tuple[float, Trial] | None = None


def _stiffest_settled(
    problem: Problem,
    search: CouplingSearch,
    people: Hand,
    trial_of: Callable[..., Trial],
    stiffness: float,
    count: int,
    softer: float,
    progress: Progress,
    *,
    local: bool,
) -> _Tried:
    """Return the stiffest coupling with which all hands settle, without dry friction if one of the next two does."""
    trial, few = None, people.pick(slice(0, 16))
    leaning: _Tried | None = None
    stiffer: tuple[float, Trial] | None = None
    for number in range(count):
        progress.advance(number, count, f"K of {quantity(stiffness, problem.units.unit('N/m'))}")
        tries: list[Trial] = []
        for gains in search.damped(stiffness, local=local, gain_margin=GAIN_MARGIN):
            trial = trial_of(gains, few, screen=True)
            if trial.all_settle_with_friction and search.has_counterexample(gains, GAIN_MARGIN):
                continue
            if trial.all_settle_with_friction:
                trial = trial_of(gains, people, screen=False)
            if trial.all_settle:
                return _Tried(gains, trial, stiffer)
            if leaning is None and trial.all_settle_with_friction:
                leaning = _Tried(gains, trial, stiffer)
            tries.append(trial)
        if tries:
            stiffer = stiffness, max(tries, key=lambda one: float(one.hand_settles.mean()))
        if leaning is not None and number >= 2:
            break
        stiffness *= softer
    return leaning or _Tried(None, trial, stiffer)


def _unsettled(problem: Problem, stiffness_n_per_m: float, trial: Trial) -> str:
    """Return how many hands do not settle with a stiffness, and in which motion most of them."""
    name, settled = min(trial.by_motion.items(), key=lambda one: int(one[1].sum()))
    count, where = int((~settled).sum()), f"in {name}"
    if count == 0:
        count, where = int((~trial.beside["with_dropped_steps"]).sum()), "where the engine misses steps"
    if count == 0:
        count, where = int((~trial.stable_without_friction).sum()), "without dry friction"
    some = f"{count} of {trial.hands} hands {'does' if count == 1 else 'do'} not settle"
    return f"with K {quantity(stiffness_n_per_m, problem.units.unit('N/m'))} {some}, {where}"


def _why_infeasible(problem: Problem, search: ToolSearch) -> str:
    """Return why no coupling to a tool is stable at all; empty where one is."""
    tool, unit = tool_of(problem), problem.units.unit
    if problem.device.mass_kg == 0:
        return "the device has no mass (device.mass_kg is 0): released, nothing is there that a coupling could hold"
    if search.limit[0].stiffness_n_per_m > 0:
        return ""
    if not search.loops.engine_alone_stable():
        lightest = min(tool.tool_mass_kg or (math.inf,))
        stiffest = quantity(tool.contact_stiffness_n_per_m[1], unit("N/m"))
        step, mass = quantity(max(tool.step_s), "s"), quantity(lightest, unit("kg"))
        return (
            f"your engine, not the coupling: its own contact of {stiffest} is unstable at a step of {step} with a mass "
            f"of {mass} (dt sqrt(k/m) must stay well below 2); a shorter step, a softer or a rigid contact, a heavier "
            "tool, an implicit integrator"
        )
    return "no spring and damper is stable with every hand, released, tool and contact"


def _why_not_wanted(problem: Problem, wanted_n_per_m: float, limit_n_per_m: float) -> str:
    """Return why a wanted stiffness is not to be had."""
    asked, most = (quantity(one, problem.units.unit("N/m")) for one in (wanted_n_per_m, limit_n_per_m))
    if wanted_n_per_m > limit_n_per_m:
        return f"{asked} is wanted, and the stiffest coupling that is stable is {most}"
    return f"{asked} is wanted, and no damper gives that its gain margins, though a stiffer coupling, {most}, is stable"


def _why_no_tool(problem: Problem, limit: float, trial: Trial | None) -> str:
    wanted = tool_of(problem).stiffness_n_per_m
    if trial is None:
        return "no damper keeps the gain margins" if wanted is None else _why_not_wanted(problem, wanted, limit)
    name, fewest = min(trial.by_motion.items(), key=lambda one: int(one[1].sum()))
    found = f"of {trial.hands} simulated hands {int(trial.stable.sum())} settle with the last coupling that was tried"
    if fewest.all():
        return f"{found}, {int(trial.beside['with_dropped_steps'].sum())} where the engine misses steps"
    return f"{found}; hardest for them: {name}, {int(fewest.sum())} settle"


def _tool_reason(problem: Problem, margin: float, stiffer: tuple[float, Trial] | None) -> str:
    tool = tool_of(problem)
    what = (
        "the stiffest with its margin and all hands settled"
        if tool.stiffness_n_per_m is None
        else "the stiffness that is wanted"
    )
    if margin < GAIN_MARGIN:
        what += f"; K and B may be no more than {math.floor(100 * margin) / 100:g} times as large"
    if stiffer is not None:
        what += f"; {_unsettled(problem, *stiffer)}"
    return f"{what}, exchange {tool.exchange}"


def _follower_reason(problem: Problem, gains: ToolGains | None, stiffest: ToolGains, trial: Trial | None) -> str:
    follower = follower_of(problem)
    wanted, limit = follower.stiffness_n_per_m, stiffest.stiffness_n_per_m
    if gains is not None:
        most = "the stiffest that keeps its margin without local dampers"
        return f"{most if wanted is None else 'the stiffness that is wanted'}, all hands settled"
    if trial is None:
        none = f"the stiffest coupling that is stable has K {quantity(limit, problem.units.unit('N/m'))}"
        return none if wanted is None else _why_not_wanted(problem, wanted, limit)
    name, settled = min(trial.by_motion.items(), key=lambda one: int(one[1].sum()))
    found = (
        f"of {trial.hands} simulated hands {int(trial.stable.sum())} settle with the softest coupling that was tried; "
        f"hardest for them: {name}, {int(settled.sum())} settle"
    )
    swings = "the follower has no damping of its own, and swings long on a soft spring: damp it, or ask for more K"
    return found if _least_damping(follower) > 0 else f"{found}; {swings}"


def _passivity(problem: Problem, gains: ToolGains) -> tuple[float | None, float | None]:
    """Return the passivity margin of the two-port and the damping that passivity needs; None where not known."""
    follower, leader = follower_of(problem), problem.device
    other, t = follower.at_leader(), leader.sample_time_s
    if follower.architecture != "position-position" or not math.isclose(t, other.sample_time_s, rel_tol=1e-9):
        return None, None
    damping, far_damping = _least_damping(leader), _least_damping(other)
    late, far_late = (max(one.range.delay_samples or (one.delay_samples,)) for one in (leader, other))
    pairs = []
    for delays_s in follower.delays_s:
        there, back = (delay_s / t for delay_s in delays_s)
        # Unsynchronised clocks delay messages by at most this many samples, both ends together.
        wait = 1 + (-(there + back)) % 1
        pairs.append(Teleoperator(damping, far_damping, t, there + wait / 2, back + wait / 2, late, far_late))
    return (
        min(passivity_margin(pair, gains)[0] for pair in pairs),
        max(least_damping_ns_per_m(pair, gains) for pair in pairs),
    )


def _least_damping(device: Device) -> float:
    return min(device.range.damping_ns_per_m or (device.damping_ns_per_m,))


def _assumed_of_tool(tool: VirtualTool) -> list[str]:
    found = []
    if tool.constraint and tool.tool_mass_kg is not None:
        found.append("the engine's contacts are constraints: the tool is free or held; give a range with an end")
    if len(set(tool.step_s)) == 1:
        found.append("the engine's step is steady: a range of step_s is judged at each steady step in it")
    else:
        found.append("the engine's step is steady, any of step_s: steps that vary are in the trial alone")
    return found


def _assumed_of_follower(problem: Problem) -> list[str]:
    follower = follower_of(problem)
    found = ["the trial has no dry friction, at neither end"]
    if "contact_stiffness_n_per_m" not in follower.model_fields_set:
        found.append("the follower touches anything from nothing to a rigid object")
    if follower.contact_damping_ns_per_m is None:
        found.append("what the follower touches is damped by a tenth of the critical damping")
    if follower.jitter == 0 and follower.lost_share == 0:
        found.append("the link is even: no jitter and no lost messages are declared")
    return found


def unusual(problem: Problem) -> dict[str, str]:
    """Return unusual values of a [simulation] by key: costliest in stiffness, or beyond any coupling."""
    tool, t, found = tool_of(problem), problem.device.sample_time_s, {}
    if not ToolLoops(problem).engine_alone_stable():
        found["contact_stiffness_n_per_m"] = (
            "makes the engine's own contact unstable at this step, whatever the coupling"
        )
    if tool.exchange == "ahead" and tool.tool_mass_kg is not None:
        found["exchange"] = (
            "is ahead: the device is given a place and a velocity that lie in the future of the force that made "
            "them, which takes its damping: a damper of the device's own loop has to make that good; hand out the "
            "state that the step began with (on-time)"
        )
    if tool.integrator == "explicit":
        found["integrator"] = "is explicit: it feeds whatever swings; take semi-implicit where the engine has it"
    if tool.substeps > 1:
        found["substeps"] = "hold a force as long as a slower engine: compute it anew in each of them (step_s)"
    if any(abs(one / t - round(one / t)) > 1e-6 for one in tool.step_s):
        found["step_s"] = f"is no whole multiple of T = {t:g} s: every phase of the two clocks is judged"
    return found
