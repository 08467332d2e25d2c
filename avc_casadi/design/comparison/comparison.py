"""Solve a problem by several methods and compare the results."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from numbers import Real
from typing import Any, TypedDict

import numpy as np

from avc_casadi._errors import InputError
from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi._util.json_values import plain_table
from avc_casadi._util.printed import Columns, Tabular, short
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.coupling import Coupling
from avc_casadi.design.comparison.evaluation import CausalGains, Evaluation, causal_gains, judge_gains
from avc_casadi.design.methods import solve
from avc_casadi.design.registry import METHODS, MethodName
from avc_casadi.files.coupling_file import gain_document
from avc_casadi.files.problem_file import AnyProblem, accepts_problem, require_wall
from avc_casadi.loops.wall import passive_limit_n_per_m
from avc_casadi.model.gains import GainSchedule, Status
from avc_casadi.model.problem import Problem
from avc_casadi.model.quantity import DAMPING, STIFFNESS
from avc_casadi.model.table import shown
from avc_casadi.paper.equations import loop_at
from avc_casadi.paper.realism import perceived_bounds
from avc_casadi.paper.rows import gain_schedule

POINTWISE: tuple[MethodName, ...] = tuple(name for name, known in METHODS.items() if known.pointwise)
"""The methods that solve the paper's problem pointwise in frequency, which are compared."""
OPTIMISERS: tuple[MethodName, ...] = tuple(name for name, known in METHODS.items() if known.optimises)


class Parting(TypedDict):
    """A frequency at which two solutions differ."""

    frequency_hz: float
    reason: str


class CrossCheck(TypedDict):
    """Two independent solutions of (11)-(12), compared; JSON values.

    Attributes:
        agree: whether both have gains at the same frequencies, with the same magnitude error.
        magnitude_error: largest difference of the magnitude errors, relative to a scale.
        distance: largest difference of the distances to Z_h_ds, relative to it.
        only_one: number of frequencies at which one has gains alone.
        partings: the frequencies at which they differ.
    """

    agree: bool
    magnitude_error: float
    distance: float
    only_one: int
    partings: list[Parting]


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Tabular):
    """Gains of several methods at the same frequencies; every array has shape (n,), impedances in N.s/m.

    The comparison is pointwise, each frequency on its own, as (12) is in the paper.

    Attributes:
        problem: name of the problem.
        scope: what the gains of `delivered` meet: the problem's own scope, with the realism that it requires.
        frequency_hz: frequencies of interaction.
        methods: gains by method; a constant pair of one's own as "mine".
        without_coupling: perceived impedance of device and environment joined directly.
        target: desired perceived impedance Z_h_ds.
        upper: perceived impedance of the realistic bound U.
        lower: perceived impedance of the realistic bound L.
        optimum: the method that the verdicts compare with the closed form.
        delivered: the method whose gains are deployed: `optimum`, or "schedule, scope ..." after `with_delivered`.
        verdict: one for each frequency.
        reason: one sentence for each frequency.
        cross_check: `direct` against `exact`, where both were requested.
        causal: what a causal coupling renders, after `with_causal`.
        judged: certificate and realism of each method.
        definition: the problem as stated, for ``print``.

    Example:
        >>> comparison = avc.compare("soft")
        >>> len(comparison.frequency_hz), list(comparison.methods)
        (200, ['closed-form', 'direct', 'exact'])
    """

    problem: str
    scope: str
    frequency_hz: FloatArray
    methods: Mapping[str, GainSchedule]
    without_coupling: ComplexArray
    target: ComplexArray
    upper: ComplexArray
    lower: ComplexArray
    optimum: str
    delivered: str
    verdict: tuple[MethodVerdict, ...]
    reason: tuple[str, ...]
    cross_check: CrossCheck | None
    judged: Mapping[str, Evaluation]
    definition: Problem
    causal: CausalGains | None = None

    def to_dict(self) -> Columns:
        """Return frequency x method as columns "method: quantity with unit", each of shape (n,)."""
        columns: Columns = {"frequency_hz": self.frequency_hz, "target_ns_per_m": self.target}
        for name, gains in self.methods.items():
            rows = gains.to_dict()
            columns |= {f"{name}: {key}": column for key, column in rows.items() if key not in columns}
        return columns | {"verdict": np.array([verdict.value for verdict in self.verdict])}

    def _summary(self) -> str:
        counts = ", ".join(f"{count} {verdict}" for verdict, count in self.counts().items() if count)
        return (
            f"{self.problem!r}, {short(self.frequency_hz, 'Hz')}, by {', '.join(self.methods)}:\n"
            f"  closed form against {self.optimum}: {counts}"
        )

    def counts(self) -> dict[str, int]:
        """Return how many frequencies have each verdict; verdicts that do not occur count 0."""
        counted = Counter(self.verdict)
        return {verdict.value: counted[verdict] for verdict in MethodVerdict}

    def document(self) -> dict[str, Any]:
        """Return the JSON document, null where a number is undefined."""
        curves = ("without_coupling", "target", "upper", "lower")
        stated = self.definition
        kept = ("problem", "frequency_hz", "optimum", "delivered", "reason", "cross_check")
        return plain_table(
            {
                **{name: getattr(self, name) for name in kept},
                "title": stated.title,
                "model": stated.stability.model,
                "structure": stated.coupling.structure,
                "margin_ns_per_m": stated.stability.margin_ns_per_m,
                "passive_limit_n_per_m": passive_limit_n_per_m(stated.device),
                "scope": "pointwise",
                "problem_scope": self.scope,
                "methods": {
                    name: gain_document(gains) | self.judged[name].document() for name, gains in self.methods.items()
                },
                "verdict": [verdict.value for verdict in self.verdict],
                "counts": self.counts(),
                **{f"{name}_re": getattr(self, name).real for name in curves},
                **{f"{name}_im": getattr(self, name).imag for name in curves},
                "safety": {name: judged.safety() for name, judged in self.judged.items()},
                "causal": self.causal,
            }
        )


# Two methods agree when their magnitude errors differ by less than this share of |Z_d| + |H Z_ds|: the NLP stays
# strictly inside (12) while the projection stands on it, and the error moves much faster than Re Z_h along it.
AGREEMENT = 1e-8
# Of the same magnitude error those whose distances to Z_h_ds differ by more than this share are two points.
_SAME_POINT = 1e-6


class MethodVerdict(StrEnum):
    """The verdict at one frequency; the first of this list that applies."""

    INFEASIBLE = "infeasible"
    CLOSED_FORM_NOT_REALISABLE = "closed-form-not-realisable"
    DIRECT_BETTER = "direct-better"
    BOUND_ACTIVE = "bound-active"
    AGREE = "agree"


def verdicts(
    closed_form: GainSchedule, optimum: GainSchedule, scale: FloatArray
) -> tuple[tuple[MethodVerdict, ...], tuple[str, ...]]:
    """Return for every frequency how the closed form compares with the optimum, and a sentence why.

    A verdict is infeasible (no gains at all), closed form not realisable, direct better, bound active (equal errors,
    at a bound of the gain box) or agree. The optimum has the least magnitude error, N.s/m. ``scale`` is
    |Z_d| + |H Z_ds|, N.s/m: errors that differ by less than 1e-8 of it are equal.
    """
    better = closed_form.magnitude_error > optimum.magnitude_error + AGREEMENT * scale
    judged = [_verdict(closed_form, optimum, row, better=bool(better[row])) for row in range(optimum.rows)]
    return tuple(verdict for verdict, _ in judged), tuple(reason for _, reason in judged)


def _verdict(closed_form: GainSchedule, optimum: GainSchedule, row: int, *, better: bool) -> tuple[MethodVerdict, str]:
    """Return the verdict at one frequency, and its reason."""
    method = optimum.method
    error = f"{optimum.magnitude_error[row]:.3g}"
    reason = optimum.reason[row]
    if not optimum.status[row].has_gains:
        return MethodVerdict.INFEASIBLE, reason or f"{method} found no gains"
    if not closed_form.status[row].has_gains:
        why = f"the closed form {closed_form.reason[row]}; {method} reaches a magnitude error of {error}"
        return MethodVerdict.CLOSED_FORM_NOT_REALISABLE, why
    if better:
        damped = optimum.structure == "damped"
        cause = "contact damper leaves out the virtual mass" if damped else "projection keeps Im Z_h_ds"
        closed_form_error = f"{closed_form.magnitude_error[row]:.3g}"
        why = f"the closed form has a magnitude error of {closed_form_error}: its {cause}; {method} reaches {error}"
        return MethodVerdict.DIRECT_BETTER, why
    if optimum.status[row] is Status.ACTIVE_BOUND:
        return MethodVerdict.BOUND_ACTIVE, f"same error; {reason or f'{method} is at a bound of the gain box'}"
    return MethodVerdict.AGREE, f"both reach a magnitude error of {error}"


def cross_check(direct: GainSchedule, exact: GainSchedule, scale: FloatArray) -> CrossCheck:
    """Compare two independent solutions of (11)-(12): by how much they differ, at which frequencies, and why.

    Magnitude error and distance |Z_h - Z_h_ds| count relative to ``scale``, |Z_d| + |H Z_ds|, N.s/m.
    """
    both_usable = direct.usable & exact.usable
    only_one_usable = direct.usable != exact.usable
    magnitude = np.where(both_usable, direct.magnitude_error - exact.magnitude_error, 0.0) / scale
    farther = np.abs(direct.impedance - direct.target) - np.abs(exact.impedance - exact.target)
    distance = np.where(both_usable, farther, 0.0) / scale
    differ = (np.abs(magnitude) > AGREEMENT) | (np.abs(distance) > _SAME_POINT)
    parted = np.flatnonzero(only_one_usable | differ).tolist()
    largest_magnitude = float(np.abs(magnitude).max(initial=0.0))
    return {
        "agree": bool(largest_magnitude <= AGREEMENT and not only_one_usable.any()),
        "magnitude_error": largest_magnitude,
        "distance": float(np.abs(distance).max(initial=0.0)),
        "only_one": int(only_one_usable.sum()),
        "partings": [
            {"frequency_hz": float(direct.frequency_hz[row]), "reason": _parting(direct, exact, row, magnitude[row])}
            for row in parted
        ],
    }


def _parting(direct: GainSchedule, exact: GainSchedule, row: int, magnitude: float) -> str:
    """Return why two solutions differ at one frequency."""
    if not (direct.usable[row] and exact.usable[row]):
        without = exact if direct.usable[row] else direct
        return without.reason[row] or f"{without.method} has no gains"
    if abs(magnitude) > AGREEMENT:
        farther = direct if magnitude > 0 else exact
        return (
            f"{farther.method} stopped short: its magnitude error is larger by {abs(magnitude):.2g} of |Z_d| + |H Z_ds|"
        )
    return "the same magnitude error at another point: a local minimum of the distance to Z_h_ds"


@accepts_problem
def compare(
    problem: AnyProblem,
    methods: Sequence[MethodName] = POINTWISE,
    mine: tuple[float, float] | None = None,
    *,
    progress: Progress = SILENT,
) -> Comparison:
    """Compare the gains of several methods at each frequency: the closed form, CasADi and the exact optimum.

    The paper's (12) is pointwise, and so is the comparison, whatever scope and realism the problem requires.

    Args:
        problem: the problem; or a problem file, or a name of the catalogue.
        methods: must hold "closed-form" and at least one of `OPTIMISERS`; the closed form is compared with the
            first of these.
        mine: a hand-tuned constant pair (k in N/m, b in N.s/m).
        progress: reports each method.

    Returns:
        Gains of each method at the same frequencies, arrays of shape (n,); perceived impedances, N.s/m, complex.

    Raises:
        InputError: ``methods`` or ``mine`` cannot be compared.

    Example:
        >>> comparison = avc.compare("figure5", mine=(2000.0, 7.0))
        >>> comparison.judged["mine"].safety()["deployable"]
        True
    """
    optimum = _checked_optimum(methods, mine)
    stated = require_wall(problem)
    scope = _demanded(stated)
    pointwise = stated.changed(stability={"scope": "pointwise"}, realism={"require": "none"})
    gains = {method: solve(pointwise, method, progress=progress) for method in dict.fromkeys(methods)}
    if mine is not None:
        k, b = (np.full(len(pointwise.frequencies_hz()), gain) for gain in mine)
        gains["mine"] = gain_schedule(pointwise, "mine", (b, k, 0 * b), (Status.SOLVED,) * len(b))
    return _compared(stated, scope, pointwise, gains, optimum)


def _compared(
    stated: Problem, scope: str, pointwise: Problem, gains: Mapping[str, GainSchedule], optimum: MethodName
) -> Comparison:
    """Compare gain tables of a problem, of which ``pointwise`` asks for (12) alone and ``scope`` says what it asks.

    Magnitude errors count relative to |Z_d| + |H Z_ds|, N.s/m, the sizes that (10) adds up at each frequency.
    """
    loop = loop_at(pointwise, pointwise.frequencies_hz())
    scale = np.abs(loop.device) + np.abs(loop.hold * loop.desired)
    verdict, reason = verdicts(gains["closed-form"], gains[optimum], scale)
    upper, lower = perceived_bounds(pointwise, loop)
    return Comparison(
        problem=pointwise.name,
        scope=scope,
        frequency_hz=pointwise.frequencies_hz(),
        methods=gains,
        without_coupling=np.asarray(loop.without_coupling),
        target=np.asarray(loop.target),
        upper=upper,
        lower=lower,
        optimum=optimum,
        delivered=optimum,
        verdict=verdict,
        reason=reason,
        cross_check=(cross_check(gains["direct"], gains["exact"], scale) if set(gains) >= set(OPTIMISERS) else None),
        judged={name: judge_gains(pointwise, table) for name, table in gains.items()},
        definition=stated,
    )


def _checked_optimum(methods: Sequence[MethodName], mine: tuple[float, float] | None) -> MethodName:
    """Return the method that the closed form is compared with; refuse what cannot be compared."""
    if isinstance(methods, str) or not isinstance(methods, Sequence):
        raise InputError.of(f"is {shown(methods)}; allowed: a list of names of methods", key="methods")
    for method in methods:
        METHODS.named(method)
    optimum = next((method for method in methods if method in OPTIMISERS), None)
    if "closed-form" not in methods or optimum is None:
        raise InputError.of(
            f"{', '.join(methods) or 'nothing'} cannot be compared; "
            f"allowed: closed-form and at least one of {', '.join(OPTIMISERS)}",
            key="methods",
        )
    if mine is not None:
        is_pair = isinstance(mine, Sequence | np.ndarray) and getattr(mine, "ndim", 1) == 1 and len(mine) == 2
        if not is_pair or not all(isinstance(gain, Real) and not isinstance(gain, bool) for gain in mine):
            raise InputError.of(f"is {shown(mine)}; allowed: stiffness and damping, as (7000, 10)", key="mine")
        if not all(0 <= gain <= quantity.highest for gain, quantity in zip(mine, (STIFFNESS, DAMPING), strict=True)):
            raise InputError.of(
                f"{','.join(map(shown, mine))} are not valid gains; give stiffness and damping, finite and >= 0, as"
                " 7000,10",
                key="mine",
            )
    return optimum


def with_delivered(comparison: Comparison, problem: Problem, gains: GainSchedule) -> Comparison:
    """Add the gains of a wider scope or of required realism to the pointwise ones, as a method."""
    name = f"{gains.method}, scope {_demanded(problem)}"
    return replace(
        comparison,
        methods={**comparison.methods, name: gains},
        judged={**comparison.judged, name: judge_gains(problem, gains)},
        delivered=name,
    )


def with_causal(comparison: Comparison, coupling: Coupling) -> Comparison:
    """Add what a causal coupling, stable with every hand, renders: what causality and every hand cost."""
    return replace(comparison, causal=causal_gains(coupling))


def _demanded(problem: Problem) -> str:
    """Return the name of a problem's scope, with the realism that it requires."""
    scope, require = problem.stability.scope, problem.realism.require
    return scope if require == "none" else f"{scope}, realism {require}"
