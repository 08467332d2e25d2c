"""Recommend the coupling between a device and a simulation: spring, damper, rendered impedance, limits."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from avc_casadi._util.json_values import plain
from avc_casadi._util.printed import Printed
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi._util.text import quantity
from avc_casadi.claims.stability.tool_loop import ToolLoops, required_tool
from avc_casadi.design.tool_certificate import tool_certificate
from avc_casadi.design.virtual_tool import ToolSearch
from avc_casadi.files.other_end_coupling_file import other_end_document
from avc_casadi.model.lifted_loop import ToolGains
from avc_casadi.other_end_coupling import ToolCoupling
from avc_casadi.recommendation.preconditions import assumed, not_used
from avc_casadi.recommendation.tool_impedance import Felt, rendered_tool
from avc_casadi.recommendation.tool_sensitivity import (
    ToolHelp,
    exchanges_that_hold,
    least_tool_mass_kg,
    search_ends,
    slowest_step_s,
    stable_on_other_devices,
    what_would_help,
)
from avc_casadi.recommendation.tried_tool import OPTIONS, ToolOptions, tried_coupling, unsettled

if TYPE_CHECKING:
    from avc_casadi.claims.stability.periodic import Mode
    from avc_casadi.claims.stability.tool_loop import ToolCase
    from avc_casadi.model.problem import Problem
    from avc_casadi.model.virtual_tool import VirtualTool
    from avc_casadi.simulation.population.tool_trial import ToolTrial


@dataclass(frozen=True, eq=False, repr=False)
class ToolRecommendation(Printed):
    """A deployable coupling to a simulation and its analysis.

    Attributes:
        problem: as stated.
        coupling: tried and judged; None where none is deployable.
        deployable: whether it may be loaded into device and engine.
        reason: one sentence: why this one, or why none.
        set_by: which hands do not settle with the next stiffer K that was tried; empty where none was.
        stiffest: the limit: the stiffest K that is linearly stable with every hand, tool and contact, with its B.
        gain_margin: common gain margin of K and B; None without a coupling.
        mode: the least damped oscillation of all loops; None without a coupling.
        worst: the loop with the largest spectral radius at the limit.
        felt: impedance rendered at the handle.
        trial: result with simulated hands; None without a coupling.
        mismatch: whether devices a tenth off and a quarter of a sample late are linearly stable too.
        local_dampers_ns_per_m: range of the damper in the device's local loop that keeps K and B stable; None where
            that does not damp.
        least_tool_mass_kg: the lightest tool with which the same K is stable with some B; None where none is, or where
            nothing moves.
        slowest_step_s: the longest step of the engine with which it is.
        exchanges: with which exchanges it is.
        helps: sensitivities of the stiffness limit.
        assumed: assumptions.
        not_used: declared keys that the analysis does not use.
    """

    problem: Problem
    coupling: ToolCoupling | None
    deployable: bool
    reason: str
    set_by: str
    stiffest: ToolGains
    gain_margin: float | None
    mode: Mode | None
    worst: ToolCase
    felt: tuple[Felt, ...]
    trial: ToolTrial | None
    mismatch: bool | None
    local_dampers_ns_per_m: tuple[float, float] | None
    least_tool_mass_kg: float | None
    slowest_step_s: float | None
    exchanges: Mapping[str, bool]
    helps: tuple[ToolHelp, ...]
    assumed: tuple[str, ...]
    not_used: tuple[str, ...]

    def __repr__(self) -> str:
        if self.coupling is None:
            return f"ToolRecommendation({self.problem.name!r}: none; {self.reason})"
        k, b = self.coupling.gains.stiffness_n_per_m, self.coupling.gains.damping_ns_per_m
        told = f"K {k:.6g}, B {b:.4g}"
        return f"ToolRecommendation({self.problem.name!r}: {told}; {self.reason})"

    def document(self) -> dict[str, Any]:
        """Return the `recommend` document: JSON values only; keys that need a wall are null."""
        gains = None if self.coupling is None else self.coupling.gains
        tried = None if self.trial is None else self.trial.document()
        rendered = None if tried is None else tried["rendered_stiffness_n_per_m"]
        found: dict[str, Any] = plain(
            {
                "schema": "avc-recommend/1",
                "problem": self.problem.name,
                "deployable": self.deployable,
                "rest": None,
                "reason": self.reason,
                "coupling": None if self.coupling is None else other_end_document(self.coupling),
                "simulation": {
                    "stiffness_n_per_m": None if gains is None else gains.stiffness_n_per_m,
                    "damping_ns_per_m": None if gains is None else gains.damping_ns_per_m,
                    "local_damping_ns_per_m": None if gains is None else gains.local_damping_ns_per_m,
                    "in_scene": None if self.coupling is None else vars(self.coupling.in_scene),
                    "set_by": self.set_by or None,
                    "stiffest_n_per_m": self.stiffest.stiffness_n_per_m,
                    "stiffest_with": vars(self.stiffest),
                    "least_tool_mass_kg": self.least_tool_mass_kg,
                    "slowest_step_s": self.slowest_step_s,
                    "exchanges": dict(self.exchanges),
                    "searched_to": search_ends(self.problem),
                    "rendered_stiffness_n_per_m": rendered,
                    "gain_margin": self.gain_margin,
                    "least_damped": None if self.mode is None else asdict(self.mode),
                    "felt": [asdict(one) for one in self.felt],
                    "mismatch_stable": self.mismatch,
                    "local_dampers_ns_per_m": self.local_dampers_ns_per_m,
                    "limited_by": asdict(self.worst),
                },
                "felt": {"stiffness_n_per_m": rendered, "share_of_wall": None},
                "stiffest_wall_n_per_m": None,
                "plain_wall_n_per_m": None,
                "with_friction_n_per_m": None,
                "trial": tried,
                "confirmed": None,
                "other_hands": {},
                "off_file": None,
                "certificate": None if self.coupling is None else dict(self.coupling.certificate or {}),
                "what_would_help": [vars(one) for one in self.helps],
                "considered": 1,
                "assumed": list(self.assumed),
                "not_used": list(self.not_used),
            }
        )
        return found


def recommend_tool(
    problem: Problem,
    hands: int = 100,
    seed: int = 0,
    *,
    versions: Mapping[str, str] | None = None,
    progress: Progress = SILENT,
    options: ToolOptions = OPTIONS,
) -> ToolRecommendation:
    """Return the spring and damper between a device and the tool of a simulation.

    Every loop of the answer is linearly stable: hands of [hands] and the device released, free and rigid contact and
    the springs between, every corner of device and tool, with a margin; and simulated hands settle in every motion.

    Args:
        problem: with [simulation].
        hands: number of simulated hands, corners of [hands] among them.
        seed: of their draw.
        versions: of the software that made it, by package; written into the coupling.
        progress: reports the couplings tried.
        options: numbers of the recommendation.

    Raises:
        InputError: the problem has no [simulation].
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
        coupling = ToolCoupling(problem, gains, certificate, trial.document(), versions or {})
    same = gains.stiffness_n_per_m if gains is not None else wanted
    return ToolRecommendation(
        problem=problem,
        coupling=coupling,
        deployable=deployable,
        reason=why or _reason(tool, wanted, margin or 0.0, options, stiffer),
        set_by=unsettled(*stiffer) if gains is not None and stiffer is not None else "",
        stiffest=stiffest,
        gain_margin=margin,
        mode=mode,
        worst=search.loops.radius(stiffest.times(1.02) if limit else search.softest)[1],
        felt=() if gains is None else tuple(rendered_tool(problem, gains)),
        trial=trial if deployable else None,
        mismatch=None if gains is None else stable_on_other_devices(problem, gains),
        local_dampers_ns_per_m=search.local_dampers_ns_per_m(gains) if local and gains is not None else None,
        least_tool_mass_kg=None
        if same is None or tool.tool_mass_kg is None
        else least_tool_mass_kg(problem, same, local=local),
        slowest_step_s=None if same is None else slowest_step_s(problem, same, local=local),
        exchanges={} if same is None else exchanges_that_hold(problem, same, local=local),
        helps=what_would_help(problem, search, local=local),
        assumed=(*assumed(problem), *_assumed(tool)),
        not_used=not_used(problem),
    )


def why_infeasible(problem: Problem, search: ToolSearch) -> str:
    """Return why no coupling is stable at all; empty where one is.

    Args:
        problem: with [simulation].
        search: of it.
    """
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
    """Return why a wanted stiffness is not to be had.

    Args:
        wanted_n_per_m: of the file.
        limit_n_per_m: the stiffest that is stable.
    """
    asked, most = (f"{one:.6g}" for one in (wanted_n_per_m, limit_n_per_m))
    if wanted_n_per_m == 0:
        return f"{asked} is wanted, which couples nothing: leave stiffness_n_per_m out for the stiffest"
    if wanted_n_per_m > limit_n_per_m:
        return f"{asked} is wanted, and the stiffest coupling that is stable is {most}"
    return f"{asked} is wanted, and no damper makes that stable, though a stiffer coupling, {most}, is stable"


def _why_none(problem: Problem, wanted: float | None, limit: float, trial: ToolTrial | None) -> str:
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
    stiffer: tuple[float, ToolTrial] | None,
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
    """Return unusual values of a [simulation] by key: costliest in stiffness, or beyond any coupling.

    Args:
        problem: with [simulation].
    """
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
