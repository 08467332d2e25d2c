"""Rows of judgements: certificates, laws of one's own, stable walls and pairs, simulated scenes, trials."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import singledispatch
from pathlib import Path
from shlex import quote
from typing import Any, SupportsFloat

from avc_casadi._util.json_values import plain
from avc_casadi._util.page import worded
from avc_casadi._util.text import percent, plural
from avc_casadi._util.units import Quantity, Units
from avc_casadi.claims.deployable import CertifiedCoupling, Deployable, DeployClaim
from avc_casadi.claims.engine_port import EnginePort, PortPassivity
from avc_casadi.claims.law_analysis import CaseResult, LawRemedy, SpringDamper
from avc_casadi.claims.levels import LevelResult
from avc_casadi.claims.own_law import LawCertificate
from avc_casadi.claims.zwidth import Curve, CurveKey, ZWidth
from avc_casadi.design.pair_certificate import PairCertificate
from avc_casadi.design.scene_coupling import SimulatedPair, SimulatedScene
from avc_casadi.design.tool_region import ToolCurve, ToolRegion
from avc_casadi.design.virtual_tool import PairFault
from avc_casadi.loops.damped_wall import RINGS_BELOW
from avc_casadi.loops.margins import LEAST_DISK, SOUND_DISK
from avc_casadi.model import EFFECTS
from avc_casadi.model.effects import SaturationEffect
from avc_casadi.model.ends import End, Simulation, ToolGains, Wall
from avc_casadi.model.problem import Problem
from avc_casadi.present import words
from avc_casadi.present.row import Answer, Mark, Part, Row, Value, caution, commas, grade, parts, row, verdict_mark
from avc_casadi.present.rows import pieces, subject
from avc_casadi.present.rows.claim_words import detent_row_text
from avc_casadi.present.rows.other_ends import stability
from avc_casadi.recommendation.assumptions import Unused
from avc_casadi.simulation.population.trial import RestCount
from avc_casadi.simulation.scene import Run
from avc_casadi.simulation.screen import EffectCost, SceneCost

_ENDING_MARKS = {"asymptotic": Mark.PASS, "held-by-friction": Mark.CAUTION, "unstable": Mark.FAIL}
"""Marks of a run by its claim."""
_CURVES: dict[CurveKey, tuple[str, str]] = {
    "passive-sampled-data": ("Passive", ""),
    "stable-released": ("Stable, released", ""),
    "stable-hands": ("Stable, all hands", ", held only, not released"),
    "passive-paper": ("Passive, paper", ", with the ideal hold of the paper, which this device does not have"),
}
"""Names of the curves, and for what they hold where that is not the device."""


@dataclass(frozen=True)
class _LawValue:
    """A value of a law: its name in an answer, its option of the command line if it has one, what it measures."""

    name: str
    option: str
    quantity: Quantity


_LAW = {
    "stiffness_n_per_m": _LawValue("k", "--k", "stiffness"),
    "damping_ns_per_m": _LawValue("b", "--b", "damping"),
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
        *subject.notes(result.notes),
        *subject.law_not_used(
            problem, "this answer is about the coupling; avc certify without a gain file judges the law"
        ),
        subject.deployable(result.verdict),
        *_claims(result.verdict, levels_of["L5"]),
        *(_proof(level) for level in levels_of.values() if level.outcome),
        row("Passivity", "; ".join(_passivity_levels(levels_of))),
        subject.passive_limit(result.certificate.passive_limit_n_per_m),
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
    """Return each claim, of those on detents the worst alone; then their spectral radii, of lower rank."""
    claims = [] if verdict is None else list(verdict.claims)
    worst_first = sorted(claims, key=lambda claim: (claim.passed, -_finite(claim.radius)))
    worst: dict[str, DeployClaim] = {}
    for claim in worst_first:
        worst.setdefault(words.CLAIMS[claim.name], claim)
    labels = [label for label in dict.fromkeys(words.CLAIMS.values()) if label in worst]
    radii = commas(
        (label.lower(), Value(worst[label].radius, "number", 5))
        for label in labels
        if math.isfinite(worst[label].radius)
    )
    rows = [_claim(label, worst[label], hands) for label in labels]
    return [*rows, row("Spectral radius", radii, rank=1)] if radii else rows


def _finite(value: float) -> float:
    return value if math.isfinite(value) else 0.0


def _claim(label: str, claim: DeployClaim, hands: LevelResult) -> Row:
    """Return a claim; of all hands also how much less damping the device may have."""
    if not claim.passed or not math.isfinite(claim.radius):
        return row(label, claim.sentence, mark=grade(claim.passed))
    reserve = hands.margin_ns_per_m
    if claim.name != "hands" or not math.isfinite(reserve):
        return row(label, "linearly stable", mark=Mark.PASS)
    reserve_of_damping = ("linearly stable, also with", Value(reserve, "damping"), "less device damping")
    return row(label, reserve_of_damping, mark=Mark.PASS)


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
    title = _law(law) if isinstance(result.law, SpringDamper) else pieces.as_stated(result.law, problem)
    onwards = []
    typed = [remedy.changes for remedy in result.remedies or () if all(_LAW[key].option for key in remedy.changes)]
    if typed:
        onwards.append(f"avc certify {quote(shown)} {_options(law | dict(typed[0]))}")
    detents_hold = result.detent is None or result.detent.passed
    if problem.environment.stiffness_n_per_m and detents_hold:
        onwards.append(f"avc recommend {quote(shown)} --out coupling.json")
    return Answer(
        kind="certify-law",
        data=result.document(),
        title=parts(shown, " ", title, subject.device_line(problem.device)),
        rows=tuple(_law_rows(result)),
        commands=tuple(onwards),
        units=problem.units,
        complaint="" if result.passed else f"avc: {shown}: these gains are not deployable",
    )


def _options(law: Mapping[str, float]) -> str:
    """Return the options of the command line that state a law."""
    return " ".join(f"{_LAW[key].option} {value:g}" for key, value in law.items() if value)


def _law(values: Mapping[str, float]) -> tuple[Part, ...]:
    return commas((_LAW[key].name, Value(value, _LAW[key].quantity)) for key, value in values.items())


def _law_rows(result: LawCertificate) -> list[Row]:
    """Return the rows of the verdict on a law: margins, worst hand, limits, friction, and what would help."""
    mark = verdict_mark(result.passed, result.sound)
    rows = [
        row("Deployable", f"{'yes' if result.passed else 'no'}: {result.reason}", mark=mark),
        *_law_loops(result),
        row("Least stable", subject.hand(result.held.hand)),
    ]
    if result.free is not None:
        disk = result.free.margins.disk
        alone = "" if isinstance(result.law, SpringDamper) else f"{pieces.acting_outside(result.law)} alone:"
        margin = (alone, "disk margin", Value(disk, "number", 2))
        rows.append(row("Outside the wall", margin, mark=_mark_of_disk(disk)))
    rows += _law_detents(result)
    rows += pieces.law_limits(result)
    rows += pieces.friction(result)
    problem = result.problem
    if not isinstance(problem.end, Wall):
        other_end = "[simulation] or [follower]: this law acts in the device's own loop, every"
        period = Value(problem.device.sample_time_s, "time")
        rows.append(row("Not used", other_end, period, mark=Mark.CAUTION))
    if not result.sound and result.remedies is not None:
        helps = commas(map(_remedy, result.remedies), ";")
        rows.append(row("Would help", helps or "none of k, b, cutoff (down to 1 %), sample time and delay alone"))
    typed_cutoff_hz = getattr(result.law, "cutoff_hz", None) if problem.law is None else None
    return [*rows, *subject.unusual(problem, typed_cutoff_hz)]


def _law_detents(result: LawCertificate) -> list[Row]:
    """Return what is claimed of detents outside the wall, and what to do where that does not hold."""
    claim = result.detent
    if claim is None:
        return []
    rows = [row(words.CLAIMS[claim.name], detent_row_text(claim, claim.units), mark=grade(claim.passed))]
    if claim.advice:
        rows.append(row("Would help", claim.advice))
    return rows


def _mark_of_disk(disk: float) -> Mark:
    """Return the mark of a disk margin: fails below what a device needs, a caution where it is thin."""
    return Mark.FAIL if disk < LEAST_DISK else grade(disk >= SOUND_DISK, Mark.CAUTION)


def _law_loops(result: LawCertificate) -> list[Row]:
    """Return margins, settling time and damping ratio, each of the worst of the held and the released loop."""
    cases: dict[words.Who, CaseResult] = {}
    if any(result.held.hand.values()) or result.released is None:
        cases["worst_hand"] = result.held
    if result.released is not None:
        cases["released"] = result.released
    disk = min(case.margins.disk for case in cases.values())
    margin_mark = Mark.CAUTION if result.leans else _mark_of_disk(disk)
    settling_s, slowest = max((case.settling_s, which_loop) for which_loop, case in cases.items())
    ratio, hz, swinging = min(
        (case.damping_ratio, case.damping_ratio_hz, which_loop) for which_loop, case in cases.items()
    )
    rows = [
        subject.margins({which_loop: case.margins for which_loop, case in cases.items()}, margin_mark),
        subject.settling(None if math.isinf(settling_s) else settling_s, slowest),
    ]
    if not result.stable:
        return rows
    damping = subject.damping_ratio(ratio, hz, swinging, result.problem.device.sample_time_s)
    if ratio < RINGS_BELOW:
        damping = row(damping.label, damping.values, ": lightly damped", mark=Mark.CAUTION)
    return [*rows, damping]


def _remedy(remedy: LawRemedy) -> tuple[Part, ...]:
    return parts(_law(remedy.changes), "(disk margin", Value(remedy.disk_margin, "number", 2), ")")


@dataclass(frozen=True)
class CertifiedPair:
    """What `avc certify` finds of a coupling to another end than a wall.

    Attributes:
        problem: the problem.
        gains: the coupling.
        file: the file of the coupling, or of the problem.
        certificate: stability and passivity.
        fault: why it should not run on a device; None where it may.
        not_used: declared keys that are no part of it.
        notes: where the coupling was designed for another problem.
    """

    problem: Problem
    gains: ToolGains
    file: str
    certificate: PairCertificate
    fault: PairFault | None
    not_used: tuple[Unused, ...]
    notes: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether it may be deployed."""
        return self.fault is None

    @property
    def sentence(self) -> str:
        """The verdict in words."""
        return "linearly stable" if self.fault is None else worded(self.fault, self.problem.units)

    def document(self) -> dict[str, Any]:
        """Return the `certify` document: JSON values only."""
        return {
            "problem": self.problem.name,
            "gains": self.file,
            **plain(self.gains),
            "deployable": {"pass": self.passed, "sentence": self.sentence},
            **self.certificate.document(),
            "not_used": [str(unused) for unused in self.not_used],
            "notes": list(self.notes),
        }


def pair_certificate(result: CertifiedPair) -> Answer:
    """Return the answer of `certify` of a coupling to a simulation: stability, and passivity apart."""
    problem, certificate = result.problem, result.certificate
    rows = [
        *subject.notes(result.notes),
        row("Deployable", f"{'yes' if result.passed else 'no'}: {result.sentence}", mark=grade(result.passed)),
        row("Coupling", subject.pair_of(result.gains)),
        *stability(problem.end, certificate),
        *passivity(problem.end, certificate.passivity),
        *(*subject.not_used(result.not_used), *subject.unusual(problem)),
        row("Claim", certificate.claim, rank=1),
    ]
    complaint = "" if result.passed else f"avc: {result.file}: not deployable"
    return subject.answer("certify", result.document(), problem, result.file, rows, complaint=complaint)


@singledispatch
def passivity(end: End, port_passivity: PortPassivity | None) -> list[Row]:  # noqa: ARG001
    """Return whether the port of an end is passive; of most none is known."""
    return []


@passivity.register
def _engine_passivity(tool: Simulation, port_passivity: PortPassivity | None) -> list[Row]:
    """Return whether the engine's port is passive, and the engines to which that applies."""
    if port_passivity is None or tool.tool_mass_kg is None:  # where the tool is fixed the engine is no port
        return []
    port = port_passivity.port
    if port is None:
        return [row("Engine's port", f"not judged: {port_passivity.refused}", mark=Mark.CAUTION)]
    text = _port_margin(port)
    if port.any_hand is not None:
        text = (*text, f"; {'with' if port.any_hand else 'not with'} any passive hand (Llewellyn)")
    rows = [row("Engine's port", text, mark=Mark.PASS if port.passive else Mark.NONE)]
    if not port.engine_is_implicit:
        why = f"no: {tool.integrator} integrates explicitly; the row Stability still covers the declared tools"
        rows.append(row("Passive engine", why, mark=caution(port.passive)))
    return rows


def _port_margin(port: EnginePort) -> tuple[Part, ...]:
    """Return by how much a port is passive, or what it lacks and with which hand."""
    if not math.isfinite(port.margin_ns_per_m):
        return ("not passive: with the tool held in place the device is unstable",)
    margin = Value(abs(port.margin_ns_per_m), "damping")
    if port.passive:
        return parts("passive with", margin, "in reserve: stable with any passive engine, whatever its tool touches")
    hz = Value(port.frequency_hz, "frequency")
    return parts("not passive: lacks", margin, "at", hz, ",", subject.hand(port.hand))


def region(result: ToolRegion, problem: Problem, shown: str = "") -> Answer:
    """Return the answer of `zwidth` of a problem with [simulation]: a row for each engine rate."""
    rows = [_engine_rate(curve, problem) for curve in result.curves]
    if result.not_used:
        unused = ", ".join(map(problem.units.key, result.not_used))
        rows.append(row("Not used", f"{unused}: used by avc simulate alone", mark=Mark.CAUTION))
    return subject.answer("zwidth", result.document(), problem, shown, rows, "recommend {} --out coupling.json")


def _engine_rate(curve: ToolCurve, problem: Problem) -> Row:
    """Return the stiffest stable coupling at a rate of the engine."""
    label = Value(curve.rate_hz, "frequency").text(problem.units)
    declared = ", as declared" if curve.declared else ""
    if curve.stable is None:
        return row(label, "no coupling is stable", declared, mark=Mark.FAIL)
    return row(label, "stiffest", subject.limit_of_pair(curve.stable), declared)


def walls(result: ZWidth, shown: str = "") -> Answer:
    """Return the answer of `zwidth`: the walls that the device can render."""
    problem = result.definition
    wall = problem.environment
    rows = [_requested_wall(result)] if wall.stiffness_n_per_m or wall.damping_ns_per_m else []
    of_law = "" if problem.law is None else f"zwidth {{}} --over {pieces.number_over(problem.law, problem)}"
    if of_law:
        rows.append(row("Not used", "law: zwidth judges walls instead of the law", mark=Mark.CAUTION))
    if unused := ", ".join(key for key in result.not_used_keys if key != "law"):
        rows.append(row("Not used", f"{unused}: declared, but not part of these claims", mark=Mark.CAUTION))
    curve_of = result.curve_of
    rows += [_stiffest_wall(*words, curve_of[key], result) for key, words in _CURVES.items() if key in curve_of]
    rows.append(subject.passive_limit(result.passive_limit_n_per_m))
    if result.encoder_limit_n_per_m is not None:
        source = "for a passive wall, 2 f_c/Delta (Abbott and Okamura 2005)"
        rows.append(row("Encoder limit", Value(result.encoder_limit_n_per_m, "stiffness"), source))
    rows += subject.notes((worded(refusal, problem.units) for refusal in result.refused), "Not judged")
    return subject.answer("zwidth", result.document(), problem, shown, rows, of_law or "recommend {} --stiffest")


def _requested_wall(result: ZWidth) -> Row:
    """Return which claims hold of the requested wall."""
    met = [str(curve.claim) for curve in result.curves if curve.holds_target]
    whole = len(met) == len(result.curves)
    if result.curve_of["stable-hands"].holds_target and not result.curve_of["stable-released"].holds_target:
        met.append("unstable when released")
    bare = f"this wall is {'; '.join(met)}" if met else "this wall is neither passive nor stable"
    return row("Without coupling", bare, mark=grade(whole, Mark.CAUTION))


def _stiffest_wall(label: str, scope: str, curve: Curve, result: ZWidth) -> Row:
    """Return the stiffest wall of which a claim holds."""
    walls = zip(curve.stiffness_n_per_m.tolist(), result.damping_ns_per_m.tolist(), strict=True)
    known = [(stiffness, damping) for stiffness, damping in walls if math.isfinite(stiffness)]
    if not known:
        return row(label, "none")
    stiffness, damping = max(known)
    beyond = "; larger wall dampings were not searched" if damping == result.damping_ns_per_m[-1] else ""
    wall = (Value(stiffness, "stiffness"), "with a wall damping of", Value(damping, "damping"))
    return row(label, "up to", *wall, f"{scope}{beyond}")


def scene(result: SimulatedScene, problem: Problem, shown: str = "") -> Answer:
    """Return the answer of `simulate` of a coupling to a wall."""
    run = result.run
    rows = [
        *subject.notes(result.notes),
        *([] if run.coupling == "law" else subject.law_not_used(problem)),
        _outcome(run),
        _coupling(result, problem),
        _rendered(run, problem),
        *_rate_hardness(run),
        *_at_the_end(run),
        *([] if result.without_guard is None else [_compared("No guard", result.without_guard)]),
        *(_compared(f"With {alternative.coupling}", alternative) for alternative in result.against),
    ]
    if result.left_out:
        left = f"declared, but not in the scene: {', '.join(map(problem.units.key, result.left_out))}"
        rows.append(row("Left out", left, mark=Mark.CAUTION))
    if result.cost is not None:
        rows += _cost(result.cost)
    complaint = _unsettled(run, problem)
    return subject.answer("simulate", result.document(), problem, shown, rows, complaint=complaint)


def pair_scene(result: SimulatedPair, problem: Problem, shown: str = "") -> Answer:
    """Return the answer of `simulate` of a coupling to a simulation."""
    rows = [
        *subject.notes(result.notes),
        _outcome(result.run),
        row("Coupling", f"{result.coupling}:", subject.pair_of(result.gains)),
        _rendered(result.run, problem),
        *_at_the_end(result.run),
    ]
    complaint = _unsettled(result.run, problem)
    return subject.answer("simulate", result.document(), problem, shown, rows, complaint=complaint)


def _outcome(run: Run) -> Row:
    friction = ", also without dry friction" if run.claim == "asymptotic" else ""
    ending = f"{outcome(run)}{friction}{'; buzzes' if run.buzzing else ''}"
    return row("Outcome", ending, f"({run.samples} samples)", mark=_mark(run))


def outcome(run: Run) -> str:
    """Return the outcome for the one simulated hand."""
    held = any(EFFECTS[kind].role == "hand" for kind in run.effects)
    return f"{words.ENDINGS[run.claim]}{' with this hand' if held else ''}"


def _unsettled(run: Run, problem: Problem) -> str:
    """Return the complaint of a run that does not settle; empty where it does."""
    return "" if run.stable else f"avc: {problem.name}: the device {outcome(run)}"


def _mark(run: Run) -> Mark:
    mark = _ENDING_MARKS[run.claim]
    return Mark.CAUTION if mark is Mark.PASS and run.buzzing else mark


def _coupling(result: SimulatedScene, problem: Problem) -> Row:
    """Return the row of the gains that a scene runs with, and of the frequency at which they are read."""
    run = result.run
    if run.coupling == "none":
        return row("Coupling", "none: the wall itself")
    if run.coupling == "law" and problem.law is not None:
        return row("Law", pieces.named(problem.law), "" if problem.law_in_wall else ", on both sides of 0")
    gains = subject.gain_spans(
        [float(run.damping_ns_per_m[0])],
        [float(run.stiffness_n_per_m[0])],
        [float(run.contact_damping_ns_per_m[0])],
        problem,
    )
    by = "" if run.coupling in words.NAMED_BY_GAINS else f"{run.coupling}:"
    if result.gains_from_hz is None:
        return row("Coupling", by, gains)
    first = "at first " if "adaptation" in run.effects else ""
    return row("Coupling", by, gains, f"; {first}the table at", Value(result.gains_from_hz, "frequency"))


def _rendered(run: Run, problem: Problem) -> Row:
    """Return the row of the stiffness that a hand feels in a scene, N/m, and of its share of the wall."""
    sensed, wall = run.apparent_stiffness_n_per_m, problem.environment.stiffness_n_per_m
    if not math.isfinite(sensed):
        return row("Rendered", "no stiffness: the scene does not end in steady contact")
    with_detents = ", with the slope of the detents" if "detent" in run.effects else ""
    share = f"({percent(sensed / wall)} of the wall)" if wall and not isinstance(problem.end, Simulation) else ""
    text = parts(Value(sensed, "stiffness"), "at the sensor", share, with_detents)
    limits = [effect.force_n for effect in problem.scene.effects if isinstance(effect, SaturationEffect)]
    limit = limits[0] if limits and limits[0] is not None else problem.device.max_force_n
    if "saturation" not in run.effects or not subject.saturates(_mean_force_n(run), limit):
        return row("Rendered", text)
    return row("Rendered", text, "; ends at the limit of", Value(limit, "force"), mark=Mark.CAUTION)


def _mean_force_n(run: Run) -> float | None:
    """Return the mean force at the end; None of a run that diverges."""
    force_n = float(run.judgement.mean_force_n)
    return force_n if math.isfinite(force_n) else None


def _rate_hardness(run: Run) -> list[Row]:
    hardness = float(run.judgement.rate_hardness_n_per_m)
    return [row("Rate-hardness", Value(hardness, "stiffness"), "at contact")] if math.isfinite(hardness) else []


def _at_the_end(run: Run) -> list[Row]:
    """Return force and motion at the end, the ripple of the force, and the energy given out."""
    force = Value(_mean_force_n(run), "force")
    ripple = Value(_finite_or_none(run.judgement.force_ripple_n), "force")
    energy = Value(_finite_or_none(run.energy_generated_j), "energy")
    return [
        row("At the end", force, ",", _peak_to_peak(run), "peak to peak"),
        row("Ripple", ripple, "rms between 20 and 500 Hz"),
        row("Energy", energy, "net output"),
    ]


def _finite_or_none(value: SupportsFloat) -> float | None:
    number = float(value)
    return number if math.isfinite(number) else None


def _peak_to_peak(run: Run) -> Value:
    return Value(_finite_or_none(run.judgement.position_peak_to_peak_m), "length")


def _compared(label: str, run: Run) -> Row:
    """Return the outcome of another run of the scene."""
    ending = f"{words.ENDINGS[run.claim]}{', buzzes' if run.buzzing else ''}:"
    stiffness: Part = "no stiffness"
    if math.isfinite(run.apparent_stiffness_n_per_m):
        stiffness = Value(run.apparent_stiffness_n_per_m, "stiffness")
    energy = Value(_finite_or_none(run.energy_generated_j), "energy")
    return row(
        label, ending, stiffness, ",", _peak_to_peak(run), "peak to peak,", energy, "net output", mark=_mark(run)
    )


def _cost(cost: SceneCost) -> list[Row]:
    """Return what each effect adds to a sample: states, instructions and time."""
    rows = [_effect_cost(effect, cost.scatter_ns) for effect in cost.effects]
    states = (Value(cost.states, "number", 9), "states,")
    instructions = (Value(cost.instructions, "number", 9), f"instructions, {cost.ns_per_step:.0f} ns")
    rows.append(row("Whole sample", states, instructions, rank=1))
    return [*rows, row("Absent", ", ".join(cost.absent), rank=1)]


def _effect_cost(effect: EffectCost, scatter_ns: float) -> Row:
    label = f"Effect {effect.kind}"
    if effect.states is None or effect.instructions is None or effect.ns_per_step is None:
        return row(label, "needed by the scene", rank=1)
    time = f"below {max(scatter_ns, 1):.0f} ns"
    if effect.ns_per_step > scatter_ns:
        time = f"{effect.ns_per_step:.0f} ns"
    states = f"{plural(effect.states, 'state')},"
    return row(label, states, Value(effect.instructions, "number", 9), f"instructions, {time}", rank=1)


def trial(result: RestCount, units: Units, shown: str) -> Answer:
    """Return the answer of `trial`: how many simulated hands settle."""
    low, high = (f"{100 * end:.4g}" for end in result.at_rest_interval)
    interval = f"hands, in every motion ({100 * result.confidence:g} % interval {low} to {high} %)"
    counted = (Value(result.at_rest, "number", 9), "of", Value(result.hands, "number", 9), interval)
    all_settle = result.at_rest == result.hands
    rows = [
        row("Settle", counted, mark=grade(all_settle, Mark.CAUTION)),
        row("By motion", ", ".join(f"{name} {count}" for name, count in result.by_motion.items())),
        row("Simulated", ", ".join(result.effects)),
    ]
    if result.moving:
        more = " and others" if result.hands - result.at_rest > len(result.moving) else ""
        numbers = f"hands number {', '.join(map(str, result.moving))}{more}"
        rows.append(row("Do not settle", numbers, mark=Mark.FAIL))
    friction = "" if result.friction else ", without dry friction"
    title = f"{shown}   coupling {result.coupling} · {result.hands} hands, seed {result.seed}{friction}"
    return Answer("trial", plain(result), (title,), tuple(rows), units=units)
