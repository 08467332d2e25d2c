"""Rows of the paper's question: the gains of one method, the methods side by side, a whole run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from shlex import quote
from typing import Any, ClassVar

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.json_values import Document, plain
from avc_casadi._util.text import plural
from avc_casadi._util.units import Quantity
from avc_casadi.design.comparison.comparison import Comparison, CrossCheck
from avc_casadi.design.solution import SolvedGains
from avc_casadi.files.model_file import TipMass
from avc_casadi.files.new_options import Option
from avc_casadi.files.problem_file import problem_document
from avc_casadi.loops.wall import passive_limit_n_per_m
from avc_casadi.model.gains import GainSchedule
from avc_casadi.model.problem import Problem
from avc_casadi.paper.errata import PaperError
from avc_casadi.paper.realism import RealismResult
from avc_casadi.present.row import Answer, Mark, Part, Row, Value, commas, grade, parts, row, span
from avc_casadi.present.rows import subject
from avc_casadi.present.rows.judge import levels
from avc_casadi.present.rows.look import Doubt


def solution(result: SolvedGains, shown: str = "", file: str | None = None) -> Answer:
    """Return the answer of `solve`."""
    problem, gains = result.problem, result.gains
    rows = [
        _gains(gains),
        *([row("Coupling", _coupling(gains, problem))] if _rows_with_gains(gains) else []),
        row("Status", subject.counts(gains.counts())),
        *_errors(gains),
        _realism(result.realism),
        subject.deployable(result.verdict),
        subject.passive_limit(result.passive_limit_n_per_m),
        *subject.law_not_used(problem),
    ]
    if result.as_printed:
        errors = f"{len(result.paper_errors)} in the printed paper; these gains include the errors of (10) and (17)"
        rows.append(row("Paper's errors", errors, mark=Mark.CAUTION))
    rows += subject.notes(gains.notes, rank=1, mark=Mark.NONE)
    if result.certificate is not None:
        rows += levels(result.certificate.levels)
    rows += printed_errors(result.paper_errors)
    onwards = _after_solution(result, file)
    complaint = without_gains(gains)
    return subject.answer("solve", result.document(), problem, shown, rows, onwards, complaint=complaint)


def _after_solution(result: SolvedGains, file: str | None) -> str:
    """Return the command to type after `solve`; {} in it is the problem."""
    if result.verdict is None:
        return "recommend {} --out coupling.json"
    if file:
        of_problem = "{} " if Path(file).suffix == ".csv" else ""
        return f"certify {of_problem}{quote(file)}"
    printed = " --as-printed" if result.as_printed else ""
    return f"solve {{}} --method {result.gains.method}{printed} --out gains.json"


def _rows_with_gains(gains: GainSchedule) -> int:
    return int(np.isfinite(gains.damping_ns_per_m).sum())


def _gains(gains: GainSchedule) -> Row:
    """Return at how many frequencies a method has gains, and its time."""
    have, of = _rows_with_gains(gains), gains.rows
    by = gains.method + (f" ({gains.solver})" if gains.solver else "")
    solved = (f"{by}: at {have} of {of} frequencies in", Value(gains.solve_seconds, "time"))
    return row("Gains", solved, mark=grade(have == of))


def _coupling(gains: GainSchedule, problem: Problem) -> tuple[Part, ...]:
    """Return the gains of a table with their spans; an infinite one is left out."""
    columns = (gains.damping_ns_per_m, gains.stiffness_n_per_m, gains.contact_damping_ns_per_m)
    damping, stiffness, contact_damping = (column[np.isfinite(column)].tolist() for column in columns)
    return subject.gain_spans(damping, stiffness, contact_damping, problem)


def _realism(result: RealismResult) -> Row:
    inside = ("between U and L at", Value(result.share_inside_bounds, "share"), "of the frequencies,")
    near = ("within", Value(result.jnd, "share"), "of the impedance at", Value(result.share_inside_jnd, "share"))
    return row("Realism", inside, near)


def printed_errors(errors: Sequence[PaperError]) -> list[Row]:
    """Return the errors of the printed paper, of lower rank."""
    return [
        row(error.equation, f"printed {error.as_printed}; correct {error.correct}; {error.effect}", rank=1)
        for error in errors
    ]


def without_gains(gains: GainSchedule) -> str:
    """Describe the rows without gains, each state with its first reason; empty where all have."""
    missing = np.flatnonzero(~np.isfinite(gains.damping_ns_per_m)).tolist()
    if not missing:
        return ""
    lines = [f"avc: {len(missing)} of {gains.rows} frequencies have no gains ({gains.method})"]
    for status in dict.fromkeys(gains.status[place] for place in missing):
        first, *more = (place for place in missing if gains.status[place] == status)
        also = f"; {len(more)} more {status}" if more else ""
        lines.append(f"  {status} at {gains.frequency_hz[first]:.4g} Hz: {gains.reason[first]}{also}")
    return "\n".join(lines)


def _errors(gains: GainSchedule) -> list[Row]:
    """Return the largest errors of magnitude and impedance, and their frequencies."""
    errors: tuple[tuple[str, FloatArray, Quantity], ...] = (
        ("Error of |Z|", gains.magnitude_error, "damping"),
        ("Impedance error", gains.complex_error, "share"),
    )
    rows = []
    for label, error, quantity in errors:
        known = np.isfinite(error) & np.isfinite(gains.damping_ns_per_m)
        if known.any():
            largest, hz = max(zip(error[known].tolist(), gains.frequency_hz[known].tolist(), strict=True))
            rows.append(row(label, "at most", Value(largest, quantity), ", at", Value(hz, "frequency")))
    return rows


def comparison(result: Comparison, shown: str = "") -> Answer:
    """Return the answer of `compare`."""
    problem = result.definition
    realism = {name: judged.realism for name, judged in result.judged.items()}
    inside = commas((_spaced(name), Value(real.share_inside_bounds, "share")) for name, real in realism.items())
    near = commas((_spaced(name), Value(real.share_inside_jnd, "share")) for name, real in realism.items())
    jnd = next(iter(realism.values())).jnd
    rows = [
        *methods(result),
        _deployable(result),
        row("Between U, L", "of the frequencies:", inside),
        row("Impedance error", "within", Value(jnd, "share"), ":", near),
        *_own_pair(result),
        subject.passive_limit(passive_limit_n_per_m(problem.device)),
        *subject.law_not_used(problem),
    ]
    if result.scope != "pointwise":
        rows.append(row("Not compared", f"gains of scope {result.scope} (avc solve)", mark=Mark.CAUTION))
    complaint = without_gains(result.methods[result.optimum])
    return subject.answer("compare", result.document(), problem, shown, rows, "recommend {}", complaint=complaint)


def _spaced(method: str) -> str:
    """Return the name of a method without hyphens."""
    return method.replace("-", " ")


def _own_pair(result: Comparison) -> list[Row]:
    """Return at how many frequencies a constant pair of one's own meets (12)."""
    pair = result.methods.get("mine")
    if pair is None:
        return []
    met = pair.real_part >= result.definition.stability.margin_ns_per_m
    spring = Value(float(pair.stiffness_n_per_m[0]), "stiffness")
    damper = Value(float(pair.damping_ns_per_m[0]), "damping")
    counted = f": meets (12) at {int(met.sum())} of {len(met)}"
    return [row("Mine", spring, ",", damper, counted, mark=grade(bool(met.all()), Mark.CAUTION))]


def methods(result: Comparison) -> list[Row]:
    """Return a row for each method of a comparison, and the verdicts on the frequencies."""
    rows = [_method(name, gains, result) for name, gains in result.methods.items() if name != "mine"]
    return [*rows, row("Verdicts", f"{subject.counts(result.counts())}, pointwise")]


def _method(name: str, gains: GainSchedule, result: Comparison) -> Row:
    """Return where a method has gains, and the first reason why not, or its distance from the other optimum."""
    missing = np.flatnonzero(~np.isfinite(gains.damping_ns_per_m)).tolist()
    label = _spaced(name).capitalize()
    have = f"at {gains.rows - len(missing)} of {gains.rows} frequencies"
    mark = Mark.PASS
    if missing:
        mark = Mark.FAIL if name == result.optimum else Mark.CAUTION
    check = result.cross_check
    if name == "exact" and check is not None:
        return row(label, have, ";", *_agreement(check), mark=_mark_of_agreement(check, mark))
    if missing:
        first = missing[0]
        hz = Value(float(result.frequency_hz[first]), "frequency")
        return row(label, have, "; at", hz, gains.reason[first], mark=mark)
    return row(label, have, mark=mark)


def _agreement(check: CrossCheck) -> tuple[Part, ...]:
    """Return by how much `exact` differs from `direct`."""
    if not check["agree"]:
        return ("DISAGREES with direct",)
    partings = len(check["partings"])
    differ = f", differs at {partings} frequencies" if partings else ""
    return parts("agrees with direct within", Value(check["magnitude_error"], "number", 1), f"of |Z|{differ}")


def _mark_of_agreement(check: CrossCheck, otherwise: Mark) -> Mark:
    if not check["agree"]:
        return Mark.FAIL
    return Mark.CAUTION if check["partings"] else otherwise


def _deployable(result: Comparison) -> Row:
    """Return which methods may be deployed, and which may not."""
    passing = [name for name, judged in result.judged.items() if judged.safe]
    failing = [name for name, judged in result.judged.items() if not judged.safe]
    groups = [", ".join(passing)] if passing else []
    if failing:
        groups.append(f"not {', '.join(failing)}: not stable with every hand and released")
    mark = Mark.PASS
    if failing:
        mark = Mark.CAUTION if passing else Mark.FAIL
    return row("Deployable", "; ".join(groups), mark=mark)


_FIRST_ROWS = 8
"""Rows of the recommendation that stand first in the answer of `run`."""


def run(data: Mapping[str, Any], deploy: Answer, pushed: Row, compared: Comparison) -> Answer:
    """Return the answer of `run`: what to deploy, what the device received, the paper's question."""
    shown = [fact for fact in deploy.rows if fact.rank == 0]
    doubts = [fact for fact in shown[_FIRST_ROWS:] if fact.mark in {Mark.CAUTION, Mark.FAIL}]
    first = [*shown[:_FIRST_ROWS], *doubts]
    later = [replace(fact, rank=1) for fact in shown if fact not in first]
    later += [fact for fact in deploy.rows if fact.rank > 0]
    return replace(deploy, kind="run", data=data, rows=(*first, pushed, *methods(compared), *later))


@dataclass(frozen=True)
class ModelledMass:
    """Mass at the tip of a model that a draft took.

    Attributes:
        file: file of the model.
        tip: name of the tip.
        mass: what the model says.
    """

    file: str
    tip: str
    mass: TipMass

    def document(self) -> dict[str, Any]:
        """Return JSON values."""
        return {"file": self.file, "tip": self.tip, **plain(self.mass)}


@dataclass(frozen=True)
class Drafted(Document):
    """A problem file that `avc new` wrote.

    Attributes:
        file: the file.
        problem: the problem in it.
        held: how the device is held.
        assumed: values that were not given, by their keys.
        proposed_damper: of the wall, with its unit; "0" where none helps, empty where one was given.
        unknown: values that are not known, and what that costs.
        warnings: unusual values.
        model: where mass and damping come from; None where they were given.
    """

    JSON_KEYS: ClassVar = (
        "file",
        ("problem", "stated"),
        "held",
        "assumed",
        "proposed_damper",
        "not_known",
        "warnings",
        "model",
    )

    file: str
    problem: Problem
    held: str
    assumed: Mapping[str, str]
    proposed_damper: str
    unknown: tuple[Option, ...]
    warnings: tuple[Doubt, ...]
    model: ModelledMass | None

    @property
    def stated(self) -> dict[str, Any]:
        """The document of the problem."""
        return problem_document(self.problem)

    @property
    def not_known(self) -> list[Doubt]:
        """The values that are not known, by their keys."""
        return [Doubt(self.problem.units.key(option.key), option.cost) for option in self.unknown]


def new(result: Drafted, shown: str) -> Answer:
    """Return the answer of `new`: what is assumed, what is unknown and what is unlikely."""
    problem, units = result.problem, result.problem.units
    hands = problem.hands
    ranges = commas(
        [
            span(hands.mass_kg, "mass"),
            span(hands.damping_ns_per_m, "damping"),
            span(hands.stiffness_n_per_m, "stiffness"),
        ]
    )
    assumed = ", ".join(f"{units.key(key)} {value}" for key, value in result.assumed.items())
    rows = [
        *([] if result.model is None else _model(result.model)),
        row("Hands", f"{result.held}:", ranges),
        *([row("Assumed", assumed)] if assumed else []),
        *_proposed(result.proposed_damper),
        *subject.notes((f"{units.key(option.key_in_table)}: {option.cost}" for option in result.unknown), "Not known"),
        *subject.notes((doubt.text for doubt in result.warnings), "Warning"),
    ]
    return subject.answer("new", result.document(), problem, shown, rows, "recommend {} --out coupling.json")


def _proposed(damper: str) -> list[Row]:
    """Return what is said of a damper of the wall that was proposed; nothing where one was given."""
    if not damper:
        return []
    if damper == "0":
        return [row("Wall damper", "none: no damper of a wall helps this device")]
    why = f"{damper}, proposed: contact is well damped; --wall-damping 0 for a wall without damper"
    return [row("Wall damper", why)]


def _model(model: ModelledMass) -> list[Row]:
    """Return the mass at the tip of a model over its poses, and what was left out of it."""
    mass = model.mass
    poses = f"over {plural(mass.poses, 'pose')} and all normals of {model.tip}"
    rows = [row("Mass", Value(mass.mass_kg, "mass"), ",", span(mass.range_kg, "mass"), poses)]
    if mass.singular_poses:
        near = f"{plural(mass.singular_poses, 'pose')} near a singular one, where the mass grows without limit"
        rows.append(row("Left out", near, mark=Mark.CAUTION))
    if mass.has_dry_friction:
        rows += subject.notes(
            ["dry friction of the model's joints; state the friction at the tip by --friction"], "Not used"
        )
    return rows
