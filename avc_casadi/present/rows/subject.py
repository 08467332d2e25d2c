"""Parts of answers: a problem in a line, gains with their spans, limits, margins, what is declared and not used."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import singledispatch
from shlex import quote
from typing import Any

from avc_casadi.claims.deployable import Deployable
from avc_casadi.claims.judged_for import JudgedFor
from avc_casadi.coupling import Coupling
from avc_casadi.files.catalogue import catalogue_names
from avc_casadi.files.plausibility import above_half_rate, plausibility
from avc_casadi.loops.margins import LEAST_DISK, SOUND_DISK, Margins
from avc_casadi.model.device import Device
from avc_casadi.model.ends import End, Follower, Simulation, ToolGains, Wall
from avc_casadi.model.hands import END_STOP_N_PER_M
from avc_casadi.model.joint import Joint, NoDevice
from avc_casadi.model.problem import Problem
from avc_casadi.model.sensed import SensorProblem
from avc_casadi.present import words
from avc_casadi.present.row import (
    Answer,
    Mark,
    Part,
    Row,
    Value,
    caution,
    commas,
    fill,
    grade,
    largest_value,
    parts,
    row,
    span,
)
from avc_casadi.present.rows.assumption_words import why_unused
from avc_casadi.recommendation.assumptions import Unused, WhyUnused
from avc_casadi.simulation.population.trial import HandCounts

HAND = ("mass_kg", "damping_ns_per_m", "stiffness_n_per_m")


def name_of(problem: Problem) -> str:
    """Return the problem as a user types it: a name of the catalogue, or a file."""
    return problem.name if problem.name in catalogue_names() else f"{problem.name or 'problem'}.toml"


def unusual(problem: Problem | SensorProblem, typed_cutoff_hz: float | None = None) -> list[Row]:
    """Return the values of a problem that may be slips, beside a verdict that takes them as they are.

    A typed cutoff is that of a law that the problem does not state.
    """
    doubts = [f"{doubt.key} {doubt.message}" for doubt in plausibility(problem)]
    if typed_cutoff_hz is not None:
        doubt = above_half_rate(typed_cutoff_hz, problem.device.sample_time_s)
        doubts += [f"cutoff_hz {doubt}"] if doubt else []
    return [row("Values", "; ".join(doubts), mark=Mark.CAUTION)] if doubts else []


def device_line(device: Device) -> tuple[Part, ...]:
    """Return a device in a line."""
    mass, rate = Value(device.mass_kg, "mass"), Value(1 / device.sample_time_s, "frequency")
    return parts("· device", mass, ",", rate, ", delay", Value(device.delay_samples, "samples"))


def headline(problem: Problem, shown: str) -> tuple[Part, ...]:
    """Return a problem in a line: what is rendered, and the device."""
    device = None if isinstance(problem.device, NoDevice) else device_line(problem.device)
    return parts(shown, " ", end_line(problem.end), device)


@singledispatch
def end_line(end: End) -> tuple[Part, ...]:
    """Return an end in a line."""
    return (end.kind,)


@end_line.register
def _wall_line(end: Wall) -> tuple[Part, ...]:
    stiffness, damping = Value(end.stiffness_n_per_m, "stiffness"), Value(end.damping_ns_per_m, "damping")
    return parts("wall", commas(value for value in (stiffness, damping) if value.number) or "none")


@end_line.register
def _tool_line(tool: Simulation) -> tuple[Part, ...]:
    tool_mass = ("fixed place",) if tool.tool_mass_kg is None else ("tool", *span(tool.tool_mass_kg, "mass"))
    late = (",", Value(tool.steps_late, "steps"), "late") if tool.steps_late else ()
    held = f", a force for {tool.substeps} substeps" if tool.substeps > 1 else ""
    rates = span([1 / step for step in tool.step_s], "frequency")
    started = ", stepped by the device's loop" if tool.clock == "device" else ""
    return parts(tool_mass, "at", rates, f", {tool.integrator}, {tool.exchange}", late, held, started)


@end_line.register
def _joint_line(joint: Joint) -> tuple[Part, ...]:
    engine = joint.engine
    late = (",", Value(engine.steps_late, "steps"), "late") if engine.steps_late else ()
    held = f", a force for {engine.substeps} substeps" if engine.substeps > 1 else ""
    rates = span([1 / step for step in engine.step_s], "frequency")
    mass = span(engine.tool_mass_kg or (0.0,), "mass")
    return parts("joint", mass, "at", rates, f", {engine.integrator}", late, held)


@end_line.register
def _follower_line(follower: Follower) -> tuple[Part, ...]:
    rate, delay = 1 / follower.sample_time_s, follower.delays_s[-1][0]
    known = {"mass_kg": follower.mass_kg, "rate_hz": rate, "delay_s": delay}
    return fill(f"follower {{mass_kg}}, {{rate_hz}}, {{delay_s}} away, {follower.architecture}", known)


def answer(
    kind: str,
    data: Mapping[str, Any],
    problem: Problem,
    shown: str,
    rows: Iterable[Row],
    *onwards: str,
    complaint: str = "",
) -> Answer:
    """Return the answer to a question about a problem; {} in a command to type next is the problem."""
    shown = shown or name_of(problem)
    commands = tuple(f"avc {onward.replace('{}', quote(shown))}" for onward in onwards)
    return Answer(kind, data, headline(problem, shown), tuple(rows), commands, problem.units, complaint=complaint)


_WALL_ITSELF = 100
"""Ratio of the spring of a coupling to that of the wall from which on the wall itself is rendered."""


def gain_spans(
    damping_ns_per_m: Sequence[float],
    stiffness_n_per_m: Sequence[float],
    contact_damping_ns_per_m: Sequence[float],
    problem: Problem,
) -> tuple[Part, ...]:
    """Return gains with their spans."""
    contact = None
    if max(contact_damping_ns_per_m, default=0.0) > 0:
        contact = ("contact damper b_p", span(contact_damping_ns_per_m, "damping"))
    if not stiffness_n_per_m:
        return commas([contact, "no spring"])
    if min(stiffness_n_per_m) >= _WALL_ITSELF * problem.environment.stiffness_n_per_m:
        return commas([contact, "wall rendered directly"])
    damper = None
    if max(damping_ns_per_m, default=0.0) > 0:
        damper = ("damper b", span(damping_ns_per_m, "damping"))
    return commas([contact, ("spring k", span(stiffness_n_per_m, "stiffness")), damper])


@singledispatch
def to_recommend(end: End) -> str:  # noqa: ARG001
    """Return the command that recommends what leads to an end."""
    return "recommend {} --out coupling.json"


@to_recommend.register
def _to_recommend_joint(end: Joint) -> str:  # noqa: ARG001
    return "recommend {}"


@singledispatch
def local_damper(end: End) -> str:  # noqa: ARG001
    """Return what the local damper of a coupling to an end is called."""
    return "damper in the device's loop"


@local_damper.register
def _local_dampers(end: Follower) -> str:  # noqa: ARG001
    return "damper of each loop"


def pair_of(gains: ToolGains, local: str = "damper in the device's loop") -> tuple[Part, ...]:
    """Return spring and dampers of a coupling to another end."""
    return _pair(gains, Value(gains.stiffness_n_per_m, "stiffness"), local, digits=3)


def limit_of_pair(gains: ToolGains) -> tuple[Part, ...]:
    """Return a coupling at its limit: the spring rounded down, its dampers with one digit more than the spring."""
    return _pair(gains, largest_value(gains.stiffness_n_per_m, "stiffness"), "damper in the device's loop", digits=4)


def _pair(gains: ToolGains, spring: Value, local: str, digits: int) -> tuple[Part, ...]:
    def damper(name: str, damping_ns_per_m: float) -> tuple[Part, ...] | None:
        return (name, Value(damping_ns_per_m, "damping", digits)) if damping_ns_per_m else None

    dampers = (damper("damper B", gains.damping_ns_per_m), damper(local, gains.local_damping_ns_per_m))
    return commas([("spring K", spring), *dampers])


def hand(values: Mapping[str, float]) -> tuple[Part, ...]:
    """Return a hand by its numbers; all 0 for the device released."""
    if not any(values.values()):
        return ("device released",)
    if values["stiffness_n_per_m"] >= END_STOP_N_PER_M:
        return ("device clamped, as at an end stop",)
    return fill("hand of {mass_kg}, {damping_ns_per_m}, {stiffness_n_per_m}", values)


def passive_limit(limit_n_per_m: float | None) -> Row:
    """Return the row of the largest static stiffness of any passive linear rendering, N/m.

    It is 2 b_d/((1 + d) T), the least over the ranges: b_d the device's damping, d its delay in samples, T the sample
    time.
    """
    if limit_n_per_m is None or math.isnan(limit_n_per_m):
        return row(
            "Passive limit", "not computed: it needs a rigid device, an ideal amplifier and whole samples of delay"
        )
    if limit_n_per_m == 0:
        return row("Passive limit", Value(0.0, "stiffness"), ": [device] declares no damping, and no wall is passive")
    return row(
        "Passive limit",
        Value(limit_n_per_m, "stiffness"),
        "is the largest static stiffness of a passive linear wall",
    )


def thin(disk_margin: float | None) -> str:
    """Return what is to be said of a disk margin; empty where it is sound or not known."""
    if disk_margin is None or disk_margin >= SOUND_DISK:
        return ""
    return f"; disk margin {disk_margin:.2g}, {f'below {LEAST_DISK}' if disk_margin < LEAST_DISK else 'thin'}"


def deployable(verdict: Deployable | None) -> Row:
    """Return the verdict on deployment: the claims that hold, or the first that fails; None where no row has gains."""
    if verdict is None:
        return row("Deployable", "no: there are no gains", mark=Mark.FAIL)
    if not verdict.passed:
        failed = next(claim.sentence for claim in verdict.claims if not claim.passed)
        return row("Deployable", "no:", failed, mark=Mark.FAIL)
    margin = None if math.isnan(verdict.disk_margin) else verdict.disk_margin
    doubt = thin(margin)
    sound = "" if margin is None else f"; disk margin {margin:.2g}"
    text = f"yes: linearly stable with every hand of [hands] and released{doubt or sound}"
    return row("Deployable", text, mark=Mark.CAUTION if doubt else Mark.PASS)


EDITED = "the coupling file was changed after avc wrote it; the changed coupling was judged anew"
"""Note on a coupling whose file has another digest than its content."""


def edited(coupling: Coupling) -> list[Row]:
    """Return the note on a coupling whose file was changed after it was written; nothing without a change."""
    return notes([EDITED]) if coupling.edited else []


def counts(numbers: Mapping[str, int]) -> str:
    """Return counts as "187 solved, 13 infeasible", without zeros."""
    return ", ".join(f"{number} {name}" for name, number in numbers.items() if number) or "none"


def settled(counts: HandCounts, *, doubt: bool = False) -> Mark:
    """Return the mark of a trial: fails where hands do not settle, a caution where some need dry friction for it."""
    if counts.at_rest < counts.hands:
        return Mark.FAIL
    return grade(counts.at_rest_without_friction >= counts.hands and not doubt, Mark.CAUTION)


def saturates(force_n: float | None, limit_n: float | None) -> bool:
    """Whether a force is at its limit, or hardly below it."""
    return None not in (force_n, limit_n) and force_n >= 0.97 * limit_n  # type: ignore[operator]


def peak_force(force_n: float, limit_n: float | None, limited: int = 0, depth_m: float | None = None) -> Row:
    """Return the largest force of a tap, and its depth; where it saturates, how many presses do so too."""
    if saturates(force_n, limit_n):
        presses = f"; {limited} presses reach the limit too" if limited else None
        return row("Peak force", "a tap reaches the limit of", Value(limit_n, "force"), presses, mark=Mark.CAUTION)
    deep = None if depth_m is None else (",", Value(depth_m, "length"), "deep")
    return row("Peak force", Value(force_n, "force"), "in a tap", deep)


def not_used(declared: Iterable[Unused]) -> list[Row]:
    """Return what is declared and no part of a coupling to another end, a row for each reason."""
    by_reason: dict[str, list[str]] = {}
    for unused in declared:
        by_reason.setdefault(why_unused(unused), []).append(unused.key)
    return [row("Not used", f"{', '.join(names)}: {why}", mark=Mark.CAUTION) for why, names in by_reason.items()]


def law_not_used(problem: Problem, why: str | None = None) -> list[Row]:
    """Return that an answer does not use the table [law], and which commands do; nothing without a law."""
    commands = why_unused(Unused("law", WhyUnused.LAW)) if why is None else why
    return [] if problem.law is None else [row("Not used", f"law: {commands}", mark=Mark.CAUTION)]


def notes(sentences: Iterable[str], label: str = "Note", mark: Mark = Mark.CAUTION, rank: int = 0) -> list[Row]:
    """Return a row for each sentence."""
    return [row(label, sentence, mark=mark, rank=rank) for sentence in sentences]


def judged_for(scope: JudgedFor) -> Row:
    """Return the row of the hands and the margin that a verdict on deployment is for."""
    return row("Judged for", scope.sentence)


_THIN_GAIN = 10 ** (3 / 20)
"""Gain margin below which a row has a mark: 3 dB, half of what is usual."""
_THIN_PHASE_DEG = 10.0
"""Phase margin, deg, below which a row has a mark."""


def margins(of_loops: Mapping[words.Who, Margins], mark: Mark = Mark.NONE) -> Row:
    """Return the smallest margin of each kind and its loop; a caution where gain or phase is half of what is usual."""
    gain = _least({which_loop: loop.gain for which_loop, loop in of_loops.items()})
    phase = _least({which_loop: loop.phase_deg for which_loop, loop in of_loops.items()})
    delay = _least({which_loop: loop.delay_samples for which_loop, loop in of_loops.items()})
    disk = _least({which_loop: loop.disk for which_loop, loop in of_loops.items()})
    is_thin = _below(gain, _THIN_GAIN) or _below(phase, _THIN_PHASE_DEG)
    named = [
        ("gain", Value(gain.value, "gain"), gain.loop),
        ("phase", Value(phase.value, "phase"), phase.loop),
        ("delay", Value(delay.value, "samples"), delay.loop),
        ("disk", Value(disk.value, "number"), disk.loop),
    ]
    loops = {loop for _, _, loop in named}
    one_loop = f"{named[0][2]}:" if len(loops) == 1 and named[0][2] else ""
    text = commas((word, value, f"({loop})" if loop and not one_loop else "") for word, value, loop in named)
    return row("Margins", one_loop, text, mark=caution(is_thin) if mark is Mark.NONE else mark)


@dataclass(frozen=True)
class _Least:
    """The smallest margin of a kind, and the words for its loop; None where no loop has a limit."""

    value: float | None
    loop: str


def _least(margins_of: Mapping[words.Who, float]) -> _Least:
    known = [(margin, words.LOOPS[which_loop]) for which_loop, margin in margins_of.items() if math.isfinite(margin)]
    return _Least(*min(known, default=(None, "")))


def _below(least: _Least, limit: float) -> bool:
    return least.value is not None and least.value < limit


def settling(seconds: float | None, which_loop: words.Who) -> Row:
    """Return the settling time of a loop; None where it never settles."""
    text = "never" if seconds is None else Value(seconds, "time")
    return row("Settling time", text, f"({words.LOOPS[which_loop]})", mark=caution(seconds is None or seconds > 1.0))


DAMPING_RATIO = "Damping ratio"
"""Label of the row, by which a verdict finds it."""


def damping_ratio(ratio: float, hz: float, which_loop: words.Who, sample_time_s: float) -> Row:
    """Return the damping ratio of the least damped oscillation of a loop."""
    text: tuple[Part, ...] = ("no oscillation below the Nyquist frequency",)
    if 0 < hz < 0.99 * 0.5 / sample_time_s:
        text = (Value(ratio, "number", 2), "at", Value(hz, "frequency"))
    return row(DAMPING_RATIO, text, f"({words.LOOPS[which_loop]})")
