"""Rows of judgements: certificates, laws of one's own, stable walls and pairs, simulated scenes, trials."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from shlex import quote
from typing import Any

from avc_casadi._util.json_values import plain
from avc_casadi._util.text import percent
from avc_casadi._util.units import Units
from avc_casadi.claims.deployable import CertifiedCoupling, Deployable, DeployClaim
from avc_casadi.claims.levels import LevelResult
from avc_casadi.claims.own_law import Case, LawCertificate, Remedy
from avc_casadi.claims.zwidth import Curve, CurveKey, ZWidth
from avc_casadi.design.tool_region import ToolCurve, ToolRegion
from avc_casadi.loops.margins import LEAST_DISK, SOUND_DISK
from avc_casadi.model import EFFECTS
from avc_casadi.model.effects import SaturationEffect
from avc_casadi.model.problem import Problem
from avc_casadi.present import words
from avc_casadi.present.row import Answer, Mark, Part, Row, Value, caution, commas, fill, grade, parts, row, span
from avc_casadi.present.rows import subject
from avc_casadi.present.rows.recommend import stability
from avc_casadi.simulation.population.trial import RestCount

ENDINGS = {
    "asymptotic": ("settles", Mark.PASS),
    "held-by-friction": ("settles by dry friction alone", Mark.CAUTION),
    "unstable": ("does not settle", Mark.FAIL),
}
_CURVES: dict[CurveKey, str] = {
    "passive-paper": "Passive, paper",
    "passive-sampled-data": "Passive, sampled",
    "stable-released": "Stable, released",
    "stable-hands": "Stable, all hands",
}


@dataclass(frozen=True)
class _LawValue:
    """A value of a law: its name in an answer, its option of the command line if it has one, what it measures."""

    name: str
    option: str
    quantity: str


_LAW = {
    "stiffness_n_per_m": _LawValue("k", "--k", "stiffness"),
    "damping_ns_per_m": _LawValue("b in the wall", "--b", "damping"),
    "local_damping_ns_per_m": _LawValue("b_p everywhere", "--b-p", "damping"),
    "cutoff_hz": _LawValue("cutoff", "--cutoff-hz", "frequency"),
    "sample_time_s": _LawValue("sample time", "", "time"),
    "delay_samples": _LawValue("delay", "", "samples"),
}
"""Values of a law and of its device that a remedy changes, by their keys."""


_PROOF_MARKS = {"proved": Mark.PASS, "refuted": Mark.FAIL, "open": Mark.CAUTION}
"""Marks of a proof by its outcome."""


def certificate(result: CertifiedCoupling, shown: str | None = None) -> Answer:
    """Return the answer of `certify` of a coupling to a wall."""
    problem, levels_of = result.certificate.definition, result.certificate.levels
    shown = subject.name_of(problem) if shown is None else shown
    rows = [
        subject.deployable(result.verdict),
        *_claims(result.verdict, levels_of["L5"]),
        *(_proof(level) for level in levels_of.values() if level.outcome),
        row("Passivity", "; ".join(_passivity_levels(levels_of))),
        subject.passive_limit(result.certificate.passive_limit_n_per_m),
        *subject.notes(result.notes),
        *levels(levels_of),
    ]
    file = result.file
    onwards = [f"recommend {quote(shown)} --out coupling.json"] if shown and not result.passed else []
    if file is not None and result.passed:
        of_problem = f" --problem {quote(shown)}" if Path(file).suffix == ".csv" else ""
        onwards.append(f"export {quote(file)} --c firmware{of_problem}")
    complaint = "" if result.passed else f"avc: {problem.name}: {file} is not deployable"
    return subject.answer("certify", result.document(), problem, file or shown, rows, *onwards, complaint=complaint)


def _proof(level: LevelResult) -> Row:
    """Return the outcome of a proof, with what it says."""
    return row(level.title.capitalize(), f"{level.outcome}: {level.claim}", mark=_PROOF_MARKS[level.outcome])


def _passivity_levels(levels_of: Mapping[str, LevelResult]) -> list[str]:
    """Return the claims of the paper, which deployment does not need: those met, not met and not judged."""
    groups = []
    for state in ("pass", "fail", "refused"):
        names = [words.PASSIVE[name] for name in words.PASSIVE if levels_of[name].word == state]
        if names:
            groups.append(f"{words.LEVEL_WORDS[state]}: {', '.join(names)}")
    return groups


def _claims(verdict: Deployable | None, hands: LevelResult) -> list[Row]:
    """Return each claim with its worst spectral radius; of those on detents the worst alone."""
    claims = [] if verdict is None else list(verdict.claims)
    worst_first = sorted(claims, key=lambda claim: (claim.passed, -_finite(claim.radius)))
    worst: dict[str, DeployClaim] = {}
    for claim in worst_first:
        worst.setdefault(words.CLAIMS[claim.name], claim)
    return [_claim(label, worst[label], hands) for label in dict.fromkeys(words.CLAIMS.values()) if label in worst]


def _finite(value: float) -> float:
    return value if math.isfinite(value) else 0.0


def _claim(label: str, claim: DeployClaim, hands: LevelResult) -> Row:
    """Return a claim with its spectral radius; of all hands also how much less damping the device may have."""
    if not claim.passed or not math.isfinite(claim.radius):
        return row(label, claim.sentence, mark=grade(claim.passed))
    radius = ("spectral radius", Value(claim.radius, "number", 5), "at most")
    reserve = hands.margin_ns_per_m
    if claim.name != "hands" or not math.isfinite(reserve):
        return row(label, radius, mark=Mark.PASS)
    down_to = ("; stays stable down to", Value(reserve, "damping"), "less device damping")
    return row(label, radius, down_to, mark=Mark.PASS)


def levels(levels_of: Mapping[str, LevelResult]) -> list[Row]:
    """Return each level of a certificate with its meaning and worst margin, of lower rank."""
    return [_level(name, level) for name, level in levels_of.items()]


def _level(name: str, level: LevelResult) -> Row:
    text = f"{level.title}: {words.LEVEL_WORDS[level.word]}"
    if not math.isfinite(level.margin_ns_per_m):
        return row(name, text, f"; {level.claim}", rank=1)
    margin = (", margin", Value(level.margin_ns_per_m, "damping"))
    hz = ("at", Value(level.frequency_hz, "frequency")) if math.isfinite(level.frequency_hz) else None
    return row(name, text, margin, hz, f"; {level.claim}", rank=1)


def own_law(result: LawCertificate, shown: str = "") -> Answer:
    """Return the answer of `certify` of a law of one's own."""
    problem = result.problem
    shown = shown or subject.name_of(problem)
    law = {key: value for key, value in vars(result.law).items() if value}
    onwards = []
    typed = [remedy.changes for remedy in result.remedies or () if all(_LAW[key].option for key in remedy.changes)]
    if typed:
        onwards.append(f"avc certify {quote(shown)} {_options(law | dict(typed[0]))}")
    if problem.environment.stiffness_n_per_m:
        onwards.append(f"avc recommend {quote(shown)} --out coupling.json")
    return Answer(
        kind="certify-law",
        data=result.document(),
        title=parts(shown, " ", _law(law), subject.device_line(problem.device)),
        rows=tuple(_law_rows(result)),
        commands=tuple(onwards),
        units=problem.units,
        complaint="" if result.passed else f"avc: {shown}: this law is not deployable",
    )


def _options(law: Mapping[str, float]) -> str:
    """Return the options of the command line that state a law."""
    return " ".join(f"{_LAW[key].option} {value:g}" for key, value in law.items() if value)


def _law(values: Mapping[str, float]) -> tuple[Part, ...]:
    return commas((_LAW[key].name, Value(value, _LAW[key].quantity)) for key, value in values.items())


def _law_rows(result: LawCertificate) -> list[Row]:
    sound = result.disk_margin >= SOUND_DISK and result.quiet
    mark = Mark.FAIL if not result.passed else grade(sound, Mark.CAUTION)
    rows = [
        row("Deployable", f"{'yes' if result.passed else 'no'}: {result.reason}", mark=mark),
        *_law_loops(result),
        row("Worst case", subject.hand(result.held.hand)),
    ]
    if result.free is not None:
        disk = result.free.margins.disk
        rows.append(row("Outside the wall", "disk margin", Value(disk, "number", 2), mark=_mark_of_disk(disk)))
    rows += _law_limits(result)
    problem = result.problem
    if problem.simulation is not None or problem.follower is not None:
        other_end = "the other end: this law acts in the device's own loop, every"
        period = Value(problem.device.sample_time_s, "time")
        rows.append(row("Not used", other_end, period, mark=Mark.CAUTION))
    if not sound and result.remedies is not None:
        helps = commas(map(_remedy, result.remedies), ";")
        rows.append(row("Would help", helps or "no k, b, cutoff down to 1 %, nor sample time or delay"))
    return rows


def _mark_of_disk(disk: float) -> Mark:
    """Return the mark of a disk margin: fails below what a device needs, a caution where it is thin."""
    return Mark.FAIL if disk < LEAST_DISK else grade(disk >= SOUND_DISK, Mark.CAUTION)


def _law_loops(result: LawCertificate) -> list[Row]:
    """Return margins, settling time and damping ratio, each of the worst of the held and the released loop."""
    cases: dict[subject.Who, Case] = {}
    if any(result.held.hand.values()) or result.released is None:
        cases["worst_hand"] = result.held
    if result.released is not None:
        cases["released"] = result.released
    disk = min(case.margins.disk for case in cases.values())
    settling_s, slowest = max((case.settling_s, who) for who, case in cases.items())
    ratio, hz, swinging = min((case.damping_ratio, case.damping_ratio_hz, who) for who, case in cases.items())
    return [
        subject.margins({who: case.margins for who, case in cases.items()}, _mark_of_disk(disk)),
        subject.settling(None if math.isinf(settling_s) else settling_s, slowest),
        subject.damping_ratio(ratio, hz, swinging, result.problem.device.sample_time_s),
    ]


def _law_limits(result: LawCertificate) -> list[Row]:
    """Return what the law renders, its limits, and the noise of its force."""
    at_rest = (Value(result.static_stiffness_n_per_m, "stiffness"), "at rest")
    moving = [(Value(stiffness, "stiffness"), f"at {hz:g} Hz") for hz, stiffness in result.rendered_n_per_m.items()]
    largest, allowed = result.largest_stiffness_n_per_m, result.damping_range_ns_per_m
    noise = (Value(result.noise_n, "force"), "rms at rest;", Value(result.encoder_step_n, "force"))
    return [
        row("Rendered", commas([at_rest, *moving])),
        row("Largest k", Value(largest, "stiffness") if largest else "none", "at this b"),
        row("Stable b", "none" if allowed is None else span(allowed, "damping"), "at this k"),
        row("Force noise", noise, "by one encoder step", mark=caution(not result.quiet)),
    ]


def _remedy(remedy: Remedy) -> tuple[Part, ...]:
    return parts(_law(remedy.changes), "(disk margin", Value(remedy.disk_margin, "number", 2), ")")


def pair_certificate(data: Mapping[str, Any], problem: Problem, shown: str) -> Answer:
    """Return the answer of `certify` of a coupling to a simulation: stability, and passivity apart."""
    verdict = data["deployable"]
    text = f"{'yes' if verdict['pass'] else 'no'}: {verdict['sentence']}"
    rows = [row("Deployable", text, mark=grade(verdict["pass"])), row("Coupling", subject.pair(data))]
    rows += [*stability(data), *passivity(data["passivity"], problem)]
    rows += [*subject.not_used(data["not_used"]), row("Claim", data["claim"], rank=1)]
    complaint = "" if verdict["pass"] else f"avc: {shown}: not deployable"
    return subject.answer("certify", data, problem, shown, rows, complaint=complaint)


def passivity(found: Mapping[str, Any], problem: Problem) -> list[Row]:
    """Return whether the engine's port is passive, and the engines to which that applies."""
    tool = problem.simulation
    if tool is None or tool.tool_mass_kg is None:  # where the tool is fixed the engine is no port
        return []
    if found["refused"]:
        return [row("Engine's port", f"not judged: {found['refused']}", mark=Mark.CAUTION)]
    text: tuple[Part, ...] = ("not passive: with the tool held in place the device is unstable",)
    if found["margin_ns_per_m"] is not None:
        known = {**found, "margin_ns_per_m": abs(found["margin_ns_per_m"])}
        spare = "passive with {margin_ns_per_m} to spare: stable with any passive engine, whatever its tool touches"
        lacks = "not passive: lacks {margin_ns_per_m} at {frequency_hz},"
        text = fill(spare, known) if found["passive"] else parts(fill(lacks, known), subject.hand(found["hand"]))
    if found["any_hand"] is not None:
        text = (*text, f"; {'with' if found['any_hand'] else 'not with'} any passive hand (Llewellyn)")
    rows = [row("Engine's port", text, mark=Mark.PASS if found["passive"] else Mark.NONE)]
    if not found["engine_is_implicit"]:
        why = f"{tool.integrator} is none: it integrates the tool explicitly; Stability holds, for the declared tools"
        rows.append(row("Passive engine", why, mark=caution(found["passive"])))
    return rows


def region(result: ToolRegion, problem: Problem, shown: str = "") -> Answer:
    """Return the answer of `zwidth` of a problem with [simulation]: a row for each engine rate."""
    rows = [_engine_rate(curve, problem) for curve in result.curves]
    return subject.answer("zwidth", result.document(), problem, shown, rows, "recommend {} --out coupling.json")


def _engine_rate(curve: ToolCurve, problem: Problem) -> Row:
    """Return the stiffest stable coupling at a rate of the engine."""
    label = Value(curve.rate_hz, "frequency").text(problem.units)
    declared = ", as declared" if curve.declared else ""
    if curve.stable is None:
        return row(label, "no coupling is stable", declared, mark=Mark.FAIL)
    return row(label, "stiffest", subject.pair_of(curve.stable), declared)


def walls(result: ZWidth, shown: str = "") -> Answer:
    """Return the answer of `zwidth`: the walls that the device can render."""
    problem = result.definition
    rows = [_requested_wall(result)]
    if result.not_used_keys:
        unused = ", ".join(result.not_used_keys)
        rows.append(row("Not used", f"{unused}: declared, and no part of these claims", mark=Mark.CAUTION))
    curve_of = result.curve_of
    rows += [_stiffest_wall(label, curve_of[key], result) for key, label in _CURVES.items() if key in curve_of]
    rows.append(subject.passive_limit(result.passive_limit_n_per_m))
    if result.encoder_limit_n_per_m is not None:
        source = "for a passive wall, 2 f_c/Delta (Abbott and Okamura 2005)"
        rows.append(row("Encoder limit", Value(result.encoder_limit_n_per_m, "stiffness"), source))
    rows += subject.notes(result.refused, "Not judged")
    return subject.answer("zwidth", result.document(), problem, shown, rows, "recommend {} --stiffest")


def _requested_wall(result: ZWidth) -> Row:
    """Return which claims hold of the requested wall."""
    met = [curve.claim for curve in result.curves if curve.holds_target]
    whole = len(met) == len(result.curves)
    if result.curve_of["stable-hands"].holds_target and not result.curve_of["stable-released"].holds_target:
        met.append("unstable when released")
    bare = f"this wall is {'; '.join(met)}" if met else "this wall is neither passive nor stable"
    return row("Without coupling", bare, mark=grade(whole, Mark.CAUTION))


def _stiffest_wall(label: str, curve: Curve, result: ZWidth) -> Row:
    """Return the stiffest wall of which a claim holds."""
    walls = zip(curve.stiffness_n_per_m.tolist(), result.damping_ns_per_m.tolist(), strict=True)
    known = [(stiffness, damping) for stiffness, damping in walls if math.isfinite(stiffness)]
    if not known:
        return row(label, "no wall")
    stiffness, damping = max(known)
    beyond = "; beyond it not looked at" if damping == result.damping_ns_per_m[-1] else ""
    return row(
        label, "up to", Value(stiffness, "stiffness"), "with a wall damping of", Value(damping, "damping"), beyond
    )


def scene(data: Mapping[str, Any], problem: Problem, shown: str = "") -> Answer:
    """Return the answer of `simulate`, of a coupling to a wall or to a simulation."""
    tool = "local_damping_ns_per_m" in data
    free = ", without need of dry friction" if data["outcome"] == "asymptotic" else ""
    ending = f"{outcome(data)}{free}{'; buzzes' if data['buzzing'] else ''}"
    rows = [
        row("Outcome", ending, f"({data['steps']} samples)", mark=_mark(data)),
        row("Coupling", f"{data['coupling']}:", subject.pair(data)) if tool else _coupling(data, problem),
        _rendered(data, problem),
    ]
    if not tool and data["rate_hardness_n_per_m"] is not None:
        rows.append(row("Rate-hardness", fill("{rate_hardness_n_per_m} at contact", data)))
    rows += [
        row("At the end", fill("{mean_force_n}, {position_peak_to_peak_m} peak to peak", data)),
        row("Ripple", fill("{force_ripple_n} rms between 20 and 500 Hz", data)),
        row("Energy", fill("{energy_generated_j} given out beyond that taken in", data)),
        *([_beside("No guard", guarded)] if (guarded := data.get("without_guard")) is not None else []),
        *(_beside(f"With {one['coupling']}", one) for one in data.get("against", ())),
        *subject.notes(data.get("notes", ())),
    ]
    if data.get("left_out"):
        left = f"declared, but not in the scene: {', '.join(map(problem.units.key, data['left_out']))}"
        rows.append(row("Left out", left, mark=Mark.CAUTION))
    rows += _explanation(data)
    complaint = "" if data["stable"] else f"avc: {problem.name}: the device {outcome(data)}"
    return subject.answer("simulate", data, problem, shown, rows, complaint=complaint)


def outcome(data: Mapping[str, Any]) -> str:
    """Return the outcome for the one simulated hand."""
    held = any(EFFECTS[kind].role == "hand" for kind in _kinds(data))
    return f"{ENDINGS[data['outcome']][0]}{' with this hand' if held else ''}"


def _kinds(data: Mapping[str, Any]) -> list[str]:
    return [one if isinstance(one, str) else one["kind"] for one in data["effects"]]


def _mark(data: Mapping[str, Any]) -> Mark:
    mark = ENDINGS[data["outcome"]][1]
    return Mark.CAUTION if mark is Mark.PASS and data["buzzing"] else mark


def _coupling(data: Mapping[str, Any], problem: Problem) -> Row:
    if data["coupling"] == "none":
        return row("Coupling", "none: the wall itself")
    keys = ("damping_ns_per_m", "stiffness_n_per_m", "contact_damping_ns_per_m")
    table = {key: [math.inf if data[key] is None else data[key]] for key in keys}
    read: tuple[Part, ...] = ()
    if data["gains_from_hz"] is not None:
        read = fill(f"; {'at first ' * ('adaptation' in _kinds(data))}the table at {{gains_from_hz}}", data)
    gains = subject.gains(table, problem)
    by = "" if str(gains[0]).startswith(data["coupling"]) else f"{data['coupling']}:"
    return row("Coupling", by, gains, read)


def _rendered(data: Mapping[str, Any], problem: Problem) -> Row:
    sensed, wall = data["apparent_stiffness_n_per_m"], problem.environment.stiffness_n_per_m
    if sensed is None:
        return row("Rendered", "no stiffness: the scene does not end in steady contact")
    beside = ", with the slope of the detents" if "detent" in _kinds(data) else ""
    share = f"({percent(sensed / wall)} of the wall)" if wall and problem.simulation is None else ""
    text = parts(Value(sensed, "stiffness"), "at the sensor", share, beside)
    own = [one.force_n for one in problem.scene.effects if isinstance(one, SaturationEffect)]
    limit = own[0] if own and own[0] is not None else problem.device.max_force_n
    if "saturation" not in _kinds(data) or not subject.saturates(data["mean_force_n"], limit):
        return row("Rendered", text)
    return row("Rendered", text, "; ends at the limit of", Value(limit, "force"), mark=Mark.CAUTION)


def _beside(label: str, one: Mapping[str, Any]) -> Row:
    """Return the outcome of another run of the scene."""
    what = f"{ENDINGS[one['outcome']][0]}{', buzzes' if one['buzzing'] else ''}:"
    stiffness = "no stiffness" if one["apparent_stiffness_n_per_m"] is None else "{apparent_stiffness_n_per_m}"
    text = f"{what} {stiffness}, {{position_peak_to_peak_m}} peak to peak, {{energy_generated_j}} given out"
    return row(label, fill(text, one), mark=_mark(one))


def _explanation(data: Mapping[str, Any]) -> list[Row]:
    """Return what each effect adds to a sample: states, instructions and time."""
    if "states" not in data or "absent" not in data:
        return []
    rows = []
    for one in data["effects"]:
        text = "the scene needs it"
        if one["instructions"] is not None:
            size, scatter = one["ns_per_step"], data["scatter_ns"]
            cost = f"{size:.0f} ns" if size > scatter else f"below {max(scatter, 1):.0f} ns"
            text = f"{subject.plural(one['states'], 'state')}, {{instructions:9}} instructions, {cost}"
        rows.append(row(f"Effect {one['kind']}", fill(text, one), rank=1))
    whole = f"{{states:9}} states, {{instructions:9}} instructions, {data['ns_per_step']:.0f} ns"
    rows.append(row("Whole sample", fill(whole, data), rank=1))
    return [*rows, row("Absent", ", ".join(data["absent"]), rank=1)]


def trial(result: RestCount, units: Units, shown: str) -> Answer:
    """Return the answer of `trial`: how many simulated hands settle."""
    low, high = (f"{100 * end:.4g}" for end in result.at_rest_interval)
    interval = f"hands in every motion ({100 * result.confidence:g} % interval {low} to {high} %)"
    counted = (Value(result.at_rest, "number", 9), "of", Value(result.hands, "number", 9), interval)
    all_settle = result.at_rest == result.hands
    rows = [
        row("Settle", counted, mark=grade(all_settle, Mark.CAUTION)),
        row("By motion", ", ".join(f"{name} {count}" for name, count in result.by_motion.items())),
        row("Simulated", ", ".join(result.effects)),
    ]
    if result.moving:
        more = " and others" if result.hands - result.at_rest > len(result.moving) else ""
        numbers = f"by their number in the draw: {', '.join(map(str, result.moving))}{more}"
        rows.append(row("Do not settle", numbers, mark=Mark.FAIL))
    friction = "" if result.friction else ", without dry friction"
    title = f"{shown}   coupling {result.coupling} · {result.hands} hands, seed {result.seed}{friction}"
    return Answer("trial", plain(result), (title,), tuple(rows), units=units)
