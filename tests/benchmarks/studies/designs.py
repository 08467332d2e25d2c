"""The couplings that are put before the same people, each as the gains that a hand at rest in the wall meets."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi import UnsupportedError
from avc_casadi.design.methods import solve
from avc_casadi.design.registry import METHODS, Candidate, MethodName
from avc_casadi.design.tuning import tuning_problem
from avc_casadi.model.gains import NO_COUPLING, Gains, gains_at
from avc_casadi.model.problem import Impedance
from avc_casadi.model.schedule import GainSchedule
from avc_casadi.paper.closed_form import project

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem

CandidateName = str
"""A name that `COUPLINGS` knows."""

_CANDIDATES: dict[CandidateName, tuple[MethodName, Candidate]] = {
    one.name: (method, one)
    for method, one in sorted(
        ((name, one) for name, method in METHODS.items() for one in method.candidates), key=lambda pair: pair[1].rank
    )
}
COUPLINGS: dict[CandidateName, str] = {
    "none": "device and wall joined directly",
    **{name: one.help for name, (_, one) in _CANDIDATES.items()},
}
MEET_OTHERS: tuple[CandidateName, ...] = (
    "none",
    *(name for name, (_, one) in _CANDIDATES.items() if one.meets_others),
)
"""Those that are tried with hands outside the design set too."""


@dataclass(frozen=True)
class Design:
    """One coupling for one wall.

    Attributes:
        coupling: which one.
        problem: what was solved; its device and environment are those that are simulated.
        gains: gains in force at the table's lowest frequency, that of a hand at rest; None where there are none.
        schedule: the whole table, where there is one.
        reason: why there are no gains.
    """

    coupling: CandidateName
    problem: Problem = field(repr=False)
    gains: Gains | None
    schedule: GainSchedule | None = field(default=None, repr=False)
    reason: str = ""

    def __str__(self) -> str:
        return "\n".join((f"{self.problem.name}: {COUPLINGS[self.coupling]} ({self.coupling})", *self.sentences()))

    def sentences(self) -> tuple[str, str]:
        """Return the gains and why they are so, or why there are none, each in one line for people."""
        return self._gains_sentence(), " ".join(self.reason.split()) or self._why()

    def _gains_sentence(self) -> str:
        if self.gains is None:
            return "no gains"
        b, k, b_p = vars(self.gains).values()
        coupled = "rigid" if self.gains.rigid else f"b = {b:.4g} N.s/m, k = {k:.4g} N/m"
        contact = f", b_p = {b_p:.4g} N.s/m" if b_p else ""
        scheduled = "" if self.in_force is self.gains else " for a hand at rest, scheduled on frequency"
        return coupled + contact + scheduled

    def _why(self) -> str:
        if self.schedule is None:
            return "nothing was searched for"
        coupling, stability = self.problem.coupling, self.problem.stability
        low, high = coupling.contact_damping_ns_per_m
        box = f" with b_p of {low:.4g} to {high:.4g} N.s/m" if coupling.structure == "damped" else ""
        margin = f"{stability.margin_ns_per_m:.4g} N.s/m in reserve"
        return (
            f"solved by {self.schedule.method}: structure {coupling.structure}{box}, {stability.model} model, {margin}"
        )

    @property
    def in_force(self) -> Gains | GainSchedule:
        """What a device would run: a table that changes is followed by estimator and adaptation."""
        if self.gains is None:
            raise ValueError(f"{self.coupling} has no gains: {self.reason}")
        constant = self.schedule is None or _CANDIDATES[self.coupling][1].constant
        return self.gains if constant or self.schedule is None else self.schedule

    def document(self) -> dict[str, float | None] | None:
        """Return the gains of a hand at rest as JSON values; an infinite gain is a rigid coupling, null."""
        if self.gains is None:
            return None
        return {key: value if math.isfinite(value) else None for key, value in vars(self.gains).items()}


def design(problem: Problem, coupling: CandidateName) -> Design:
    """Design one coupling for the wall of a problem; a method that refuses it is a coupling without gains."""
    if coupling == "none":
        return Design(coupling, problem, NO_COUPLING)
    if coupling == "closed-form":
        return _injection(problem)
    method, stated = _stated(problem, coupling)
    try:
        table = solve(stated, method)
    except UnsupportedError as refusal:
        return Design(coupling, stated, None, reason=str(refusal))
    rows = np.flatnonzero(table.usable)
    if len(rows) == 0:
        return Design(coupling, stated, None, table, table.reason[0])
    return Design(coupling, stated, gains_at(table, float(table.frequency_hz[rows[0]])), table)


def _stated(problem: Problem, coupling: CandidateName) -> tuple[MethodName, Problem]:
    method, one = _CANDIDATES[coupling]
    if one.tuned is not None:
        return method, tuning_problem(problem, one.tuned)
    return method, problem if one.model is None else problem.changed(stability={"model": one.model})


def _injection(problem: Problem) -> Design:
    """Render the desired wall with the largest damper that the projection injects at any frequency."""
    bounds = problem.boundaries
    wall = Impedance(
        damping_ns_per_m=(bounds.upper.damping_ns_per_m + bounds.lower.damping_ns_per_m) / 2,
        stiffness_n_per_m=(bounds.upper.stiffness_n_per_m + bounds.lower.stiffness_n_per_m) / 2,
    )
    damper = float(project(problem).injected_damping_ns_per_m.max())
    rendered = problem.changed(environment=wall)
    return Design("closed-form", rendered, Gains(math.inf, math.inf, damper))
