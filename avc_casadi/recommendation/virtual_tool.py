"""Recommend the coupling between a device and a simulation: spring, damper, rendered impedance, limits."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from avc_casadi._util.progress import SILENT, Progress
from avc_casadi._util.text import quantity
from avc_casadi.coupling import Coupling
from avc_casadi.design.tool_certificate import tool_certificate
from avc_casadi.design.virtual_tool import ToolSearch
from avc_casadi.loops.engine import ToolLoops, required_tool
from avc_casadi.recommendation.preconditions import assumed, not_used
from avc_casadi.recommendation.recommendation import Pair, Recommendation
from avc_casadi.recommendation.tool_impedance import rendered_tool
from avc_casadi.recommendation.tool_sensitivity import (
    exchanges_that_hold,
    least_tool_mass_kg,
    search_ends,
    slowest_step_s,
    stable_on_other_devices,
    what_would_help,
)
from avc_casadi.recommendation.tried_tool import OPTIONS, ToolOptions, tried_coupling, unsettled

if TYPE_CHECKING:
    from avc_casadi.model.ends import VirtualTool
    from avc_casadi.model.problem import Problem
    from avc_casadi.simulation.population.trial import Trial


def recommend_tool(
    problem: Problem,
    hands: int = 100,
    seed: int = 0,
    *,
    versions: Mapping[str, str] | None = None,
    progress: Progress = SILENT,
    options: ToolOptions = OPTIONS,
) -> Recommendation:
    """Return the spring and damper between a device and the tool of a simulation.

    Every loop of the answer is linearly stable: hands of [hands] and the device released, free and rigid contact and
    the springs between, every corner of device and tool, with a margin; and simulated hands settle in every motion.
    """
    tool, search = required_tool(problem), ToolSearch(problem)
    (stiffest, local), wanted = search.limit, tool.stiffness_n_per_m
    limit = stiffest.stiffness_n_per_m
    why = why_infeasible(problem, search)
    gains = trial = stiffer = None
    if not why:
        gains, trial, stiffer = tried_coupling(problem, search, hands, seed, progress, options)
    if not why and gains is None:
        why = _why_none(problem, wanted, limit, trial)
    coupling, deployable = None, gains is not None
    margin = mode = None
    if gains is not None and trial is not None:
        margin, mode = search.gain_margin_over_ranges(gains), search.loops.slowest(gains)
        certificate = tool_certificate(problem, gains, search)
        coupling = Coupling.between(problem, gains, certificate, trial.document(), versions or {})
    # What is only linearly stable is no help where hands refute it.
    same = gains.stiffness_n_per_m if gains is not None else wanted if trial is None else None
    return Recommendation(
        problem=problem,
        coupling=coupling,
        deployable=deployable,
        reason=why or _reason(tool, wanted, margin or 0.0, options, stiffer),
        trial=trial if deployable else None,
        helps=what_would_help(problem, search, local=local),
        assumed=(*assumed(problem), *_assumed(tool)),
        not_used=not_used(problem),
        pair=Pair(
            stiffest=stiffest,
            worst=search.loops.radius(stiffest.times(1.02) if limit else search.softest)[1],
            loops=len(search.loops),
            gain_margin=margin,
            mode=mode,
            felt=() if gains is None else tuple(rendered_tool(problem, gains)),
            set_by=unsettled(*stiffer) if gains is not None and stiffer is not None else "",
            mismatch_stable=None if gains is None else stable_on_other_devices(problem, gains),
            local_dampers_ns_per_m=search.local_dampers_ns_per_m(gains) if local and gains is not None else None,
            least_tool_mass_kg=None
            if same is None or tool.tool_mass_kg is None
            else least_tool_mass_kg(problem, same, local=local),
            slowest_step_s=None if same is None else slowest_step_s(problem, same, local=local),
            exchanges={} if same is None else exchanges_that_hold(problem, same, local=local),
            searched_to=search_ends(problem),
        ),
    )


def why_infeasible(problem: Problem, search: ToolSearch) -> str:
    """Return why no coupling is stable at all; empty where one is."""
    tool = required_tool(problem)
    if problem.device.mass_kg == 0:
        return "the device has no mass (device.mass_kg is 0): released, nothing is there that a coupling could hold"
    if search.limit[0].stiffness_n_per_m > 0:
        return ""
    if not search.loops.engine_alone_stable():
        lightest = min(tool.tool_mass_kg or (math.inf,))
        stiffest = f"{tool.contact_stiffness_n_per_m[1]:.6g}"
        step, mass = quantity(max(tool.step_s), "s"), f"{lightest:.3g}"
        return (
            f"your engine, not the coupling: its own contact of {stiffest} is unstable at a step of {step} with a mass "
            f"of {mass} (dt sqrt(k/m) must stay well below 2); a shorter step, a softer or a rigid contact, a heavier "
            "tool, an implicit integrator"
        )
    return "no spring and damper is stable with every hand, released, tool and contact"


def why_not_wanted(wanted_n_per_m: float, limit_n_per_m: float) -> str:
    """Return why a wanted stiffness is not to be had."""
    asked, most = (f"{one:.6g}" for one in (wanted_n_per_m, limit_n_per_m))
    if wanted_n_per_m == 0:
        return f"{asked} is wanted, which couples nothing: leave stiffness_n_per_m out for the stiffest"
    if wanted_n_per_m > limit_n_per_m:
        return f"{asked} is wanted, and the stiffest coupling that is stable is {most}"
    return f"{asked} is wanted, and no damper makes that stable, though a stiffer coupling, {most}, is stable"


def _why_none(problem: Problem, wanted: float | None, limit: float, trial: Trial | None) -> str:
    if wanted is not None and trial is None:
        return why_not_wanted(wanted, limit)
    if trial is None:
        return "no damper keeps every loop stable"
    name, fewest = min(trial.by_motion.items(), key=lambda one: int(one[1].sum()))
    found = f"of {trial.hands} simulated hands {int(trial.stable.sum())} settle with the last coupling that was tried"
    if fewest.all():
        return f"{found}, {int(trial.stable_with_dropped_steps.sum())} where the engine misses steps"
    coarse = problem.device.encoder_resolution_m > 0 and name == "touch"
    why = (
        "; the encoder is too coarse for the damper that this engine needs: a finer one, a faster engine"
        if coarse
        else ""
    )
    return f"{found}; hardest for them: {name}, {int(fewest.sum())} settle{why}"


def _reason(
    tool: VirtualTool,
    wanted: float | None,
    margin: float,
    options: ToolOptions,
    stiffer: tuple[float, Trial] | None,
) -> str:
    what = (
        "the stiffness that is wanted" if wanted is not None else "the stiffest with its margin and all hands settled"
    )
    if margin < options.gain_margin:
        what += f"; K and B may be no more than {math.floor(100 * margin) / 100:g} times as large"
    if stiffer is not None:
        what += f"; {unsettled(*stiffer)}"
    return f"{what}, exchange {tool.exchange}"


def unusual(problem: Problem) -> dict[str, str]:
    """Return unusual values of a [simulation] by key: costliest in stiffness, or beyond any coupling."""
    tool, t, found = required_tool(problem), problem.device.sample_time_s, {}
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
        found["integrator"] = "is explicit: it gives energy to whatever swings; no engine of note has it by default"
    if any(abs(one / t - round(one / t)) > 1e-6 for one in tool.step_s):
        found["step_s"] = f"is no whole multiple of T = {t:g} s: every phase of the two clocks is judged"
    return found


def _assumed(tool: VirtualTool) -> list[str]:
    found = []
    if tool.rigid and tool.tool_mass_kg is not None:
        found.append(
            "the engine's contacts are constraints: the tool is free or stands still; give a range with an end"
        )
    if len(set(tool.step_s)) == 1:
        found.append("the engine's step is steady: a range of step_s takes jitter in")
    return found
