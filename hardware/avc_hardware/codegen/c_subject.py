"""What is exported as one function from position to force, a coupling or a stated law, as its header describes it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from avc_casadi import InputError, NotDeployableError, UnsupportedError, certify_law
from avc_casadi.claims.judged_for import JudgedFor
from avc_casadi.coupling import hash_of
from avc_casadi.files.problem_file import require_device
from avc_hardware.codegen import c_frame

if TYPE_CHECKING:
    from avc_casadi.claims.deployable import Deployable
    from avc_casadi.coupling import Coupling
    from avc_casadi.model.gains import GainTable
    from avc_casadi.model.problem import Problem

Place = Literal["wall", "detents", "everywhere"]
"""Where a force acts: in a wall, about places that are fixed, or about 0 on both sides."""

_COUPLING_HEAD = """\
Coupling {id} for {problem}{title}
method {method}, structure {structure}, {rows}
wall: {wall_b:.9g} N.s/m and {wall_k:.9g} N/m, on one side, at position 0; contact law {contact}
beside the gains: {beside}{detents}"""
_LAW_HEAD = """\
Law {id} for {problem}{title}
{pieces}
{acts}
the law runs at {rate}{detents}"""
_IN_WALL = (
    "in the wall, where position_m is above 0, and never pulling: spring, damper, integral; outside: {everywhere}"
)
_ACTS_OUTSIDE = {
    "local_damping_ns_per_m": "local damper",
    "virtual_mass_kg": "virtual mass",
    "friction_compensation": "friction compensation",
}
_EVERYWHERE = "everywhere, on both sides of position 0"


@dataclass(frozen=True)
class CSubject:
    """What is exported.

    Attributes:
        what: it in the first line of the header.
        id: its identifier.
        head: lines of the header that say what it is.
        meant: what a sample time other than its own would change.
        problem: device, names and detents.
        passed: whether it is deployable.
        sound: whether nothing of it is doubted.
        sentence: the verdict on its deployment.
        judged_for: hands and margin that the verdict is for.
        place: where it acts.
        ahead_m: by how much an observer looks before the measured position.
        table: gains that are looked up; None for constant ones.
    """

    what: str
    id: str
    head: tuple[str, ...]
    meant: str
    problem: Problem
    passed: bool
    sound: bool
    sentence: str
    judged_for: JudgedFor
    place: Place
    ahead_m: float = 0.0
    table: GainTable | None = None


def coupling_subject(coupling: Coupling, verdict: Deployable) -> CSubject:
    """Return a coupling to a wall as what is exported to C: its head, units, verdict and table."""
    problem, table = coupling.problem, coupling.table
    feedback = coupling.runtime.state_feedback
    low, high = table.frequency_hz[[0, -1]]
    head = _COUPLING_HEAD.format(
        id=coupling.id,
        **c_frame.head_words(problem),
        method=c_frame.comment(coupling.method),
        structure=c_frame.comment(coupling.structure),
        contact=c_frame.comment(coupling.contact),
        rows="constant gains" if table.constant else f"{len(table)} rows, {low:.6g} to {high:.6g} Hz",
        wall_b=coupling.wall.damping_ns_per_m,
        wall_k=coupling.wall.stiffness_n_per_m,
        beside=_beside(coupling),
        detents=_detents(problem),
    )
    return CSubject(
        what="A virtual coupling with its wall",
        id=coupling.id,
        head=tuple(head.split("\n")),
        meant="the gains mean",
        problem=problem,
        passed=verdict.passed,
        sound=verdict.sound,
        sentence=verdict.sentence if verdict.passed else f"UNSAFE, written by request: {verdict.sentence}",
        judged_for=JudgedFor.of_coupling(coupling),
        place="wall" if problem.detent is None else "detents",
        ahead_m=0.0 if feedback is None else max(feedback.face_m, 0.0),
        table=None if table.constant else table,
    )


def law_subject(problem: Problem, *, unsafe: bool) -> CSubject:
    """Return the law of a problem as what is exported.

    Raises:
        InputError: there is no law.
        NotDeployableError: it is not deployable, or not judged, and `unsafe` does not override that.
        UnsupportedError: there is no device.
    """
    law = require_device(problem).law
    if law is None:
        raise InputError.of("is missing; allowed: a table [law], or a coupling file", file=problem.name, key="law")
    verdict = _verdict(problem)
    if not verdict.passed and not unsafe:
        raise NotDeployableError(
            f"{problem.name}, [law]: {verdict.sentence}; --unsafe (in Python unsafe=True) overrides."
        )
    period = law.period_s(problem.device.sample_time_s)
    acting = [name for key, name in _ACTS_OUTSIDE.items() if getattr(law, key)]
    everywhere = ", ".join(acting) or "nothing"
    head = _LAW_HEAD.format(
        id=law_id(problem),
        **c_frame.head_words(problem),
        pieces=c_frame.comment_lines(", ".join(_pieces(problem))),
        acts=c_frame.comment_lines(_IN_WALL.format(everywhere=everywhere) if problem.law_in_wall else _EVERYWHERE),
        rate=f"{1 / period:.9g} Hz" + (f", every {law.rate_divider} calls" if law.rate_divider > 1 else ""),
        detents=_detents(problem),
    )
    in_wall: Place = "wall" if problem.detent is None else "detents"
    return CSubject(
        what="Your own law",
        id=law_id(problem),
        head=tuple(head.split("\n")),
        meant="its numbers mean",
        problem=problem,
        passed=verdict.passed,
        sound=verdict.sound,
        sentence=verdict.sentence if verdict.passed else f"UNSAFE, written by request: {verdict.sentence}",
        judged_for=JudgedFor.of_law(problem),
        place=in_wall if problem.law_in_wall else "everywhere",
    )


def law_id(problem: Problem) -> str:
    """Return the identifier of a law on its device: 8 hexadecimal digits."""
    law, detent = problem.law, problem.detent
    stated: dict[str, Any] = {
        "law": None if law is None else law.document(),
        "in_wall": problem.law_in_wall,
        "device": problem.device.model_dump(mode="json"),
        "detent": None if detent is None else detent.model_dump(mode="json"),
    }
    return hash_of(stated)


@dataclass(frozen=True)
class _LawVerdict:
    """The verdict on a law that is exported."""

    passed: bool
    """Whether it is deployable."""
    sound: bool
    """Whether nothing of it is doubted."""
    sentence: str


def _verdict(problem: Problem) -> _LawVerdict:
    """Return the verdict on the law of a problem; what is not judged is neither deployable nor sound."""
    # What is beyond a limit is said of a spring and damper; the limits of many numbers take long.
    limits = problem.law is not None and problem.law.is_spring_damper
    try:
        certificate = certify_law(problem, remedies=False, limits=limits)
    except UnsupportedError as error:
        return _LawVerdict(passed=False, sound=False, sentence=f"not judged: {error}")
    word = "deployable" if certificate.passed else "not deployable"
    return _LawVerdict(certificate.passed, certificate.sound, f"{word}: {certificate.reason}")


def _pieces(problem: Problem) -> list[str]:
    """Return the numbers of a law, by their keys in a file, as a header lists them."""
    law = problem.law
    if law is None:
        return []
    stated = {key for key, field in type(law).model_fields.items() if getattr(law, key) != field.default}
    values = {key: value for key, value in law.document().items() if key in stated}
    return [f"{key} {_said(value)}" for key, value in problem.units.keyed(values).items()]


def _said(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key} {_said(inner)}" for key, inner in value.items())
    if isinstance(value, list):
        return "; ".join(f"[{_said(inner)}]" if isinstance(inner, dict) else _said(inner) for inner in value)
    return f"{value:.9g}" if isinstance(value, float) else str(value)


def _detents(problem: Problem) -> str:
    values = {} if problem.detent is None else problem.detent.model_dump()
    stated = c_frame.comment(", ".join(f"{key} {value:.9g}" for key, value in values.items()))
    return f"\ndetents everywhere: {stated}" if stated else ""


def _beside(coupling: Coupling) -> str:
    """Return what runs beside the gains, by the keys of [runtime]."""
    runtime = coupling.runtime
    keys = [] if coupling.table.constant else ["estimator", "hold_s", "slew_per_s", "passive"]
    keys += [key for key in ("observer_mass_kg", "guard") if getattr(runtime, key) is not None]
    words = [f"{key} {getattr(runtime, key)}" for key in keys]
    if runtime.state_feedback is not None:
        words.append(f"an observer of {runtime.state_feedback.states} states, and feedback")
    return c_frame.comment(", ".join(words) or "nothing")
