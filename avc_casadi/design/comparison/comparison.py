"""Solve a problem by several methods and compare the results."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._errors import InputError
from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi._util.printed import Columns, Tabular, short
from avc_casadi.design.comparison.cross_check import CrossCheck, cross_check
from avc_casadi.design.comparison.judged import HandTuned, Judged, constant_pair, judge_gains, judge_hand_tuned
from avc_casadi.design.comparison.verdict import AGREEMENT, Verdict, judge
from avc_casadi.design.methods import solve
from avc_casadi.design.registry import METHODS, MethodName
from avc_casadi.files.problem_file import AnyProblem, of_problem, with_wall
from avc_casadi.loops.sampled_loop import passive_limit_n_per_m
from avc_casadi.model.schedule import GainSchedule
from avc_casadi.paper.closed_form import project
from avc_casadi.paper.equations import tustin
from avc_casadi.paper.loop import Loop, loop_at
from avc_casadi.paper.realism import perceived_bounds

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from avc_casadi.model.problem import Problem


POINTWISE: tuple[MethodName, ...] = tuple(name for name, one in METHODS.items() if one.pointwise)
"""The methods that solve the paper's problem pointwise in frequency, which are compared."""
OPTIMISERS: tuple[MethodName, ...] = tuple(name for name, one in METHODS.items() if one.optimises)
_SHARED = {"frequency_hz", "target_ns_per_m"}


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Tabular):
    """Gains of several methods at the same frequencies; every array has shape (n,), impedances in N.s/m.

    The comparison is pointwise, each frequency on its own, as (12) is in the paper.

    Attributes:
        problem: name of the problem.
        title: its title.
        model: hold model.
        structure: series or damped.
        scope: what the gains of `delivered` meet: the problem's own scope, with the realism that it requires.
        margin_ns_per_m: margin of (12).
        frequency_hz: frequencies of interaction.
        methods: gains by method.
        without_coupling: perceived impedance of device and environment joined directly.
        target: desired perceived impedance Z_h_ds.
        upper: perceived impedance of the realistic bound U.
        lower: perceived impedance of the realistic bound L.
        optimum: the method that the verdicts compare with the closed form.
        delivered: the method whose gains are deployed: `optimum`, or "schedule, scope ..." after `with_delivered`.
        verdict: one for each frequency.
        reason: one sentence for each frequency.
        injection: the closed form as damping injection.
        cross_check: `direct` against `exact`, where both were requested.
        mine: a hand-tuned pair, where one was given.
        judged: certificate and realism of each method, and of the pair under the name "mine".
        passive_limit_n_per_m: largest DC stiffness of any passive linear time-invariant rendering, sampled-data:
            2 b_d/((1 + delay) T).
        stated: the problem as stated, for ``print``.

    Example:
        >>> comparison = avc.compare("soft")
        >>> len(comparison.verdict) == len(comparison.frequency_hz)
        True
    """

    problem: str
    title: str
    model: str
    structure: str
    scope: str
    margin_ns_per_m: float
    frequency_hz: FloatArray
    methods: Mapping[str, GainSchedule]
    without_coupling: ComplexArray
    target: ComplexArray
    upper: ComplexArray
    lower: ComplexArray
    optimum: str
    delivered: str
    verdict: tuple[Verdict, ...]
    reason: tuple[str, ...]
    injection: DampingInjection
    cross_check: CrossCheck | None
    mine: HandTuned | None
    judged: Mapping[str, Judged]
    passive_limit_n_per_m: float
    stated: Problem

    def to_dict(self) -> Columns:
        """Return frequency x method as columns "method: quantity with unit", each of shape (n,)."""
        columns: Columns = {"frequency_hz": self.frequency_hz}
        for name, gains in self.methods.items():
            rows = gains.to_dict()
            columns |= {f"{name}: {key}": column for key, column in rows.items() if key not in _SHARED}
        return columns | {
            "target_ns_per_m": self.target,
            "verdict": np.array([verdict.value for verdict in self.verdict]),
        }

    def _summary(self) -> str:
        found = ", ".join(f"{count} {verdict}" for verdict, count in self.counts().items() if count)
        return (
            f"{self.problem!r}, {short(self.frequency_hz, 'Hz')}, by {', '.join(self.methods)}:\n"
            f"  closed form against {self.optimum}: {found}"
        )

    def counts(self) -> dict[str, int]:
        """Return how many frequencies have each verdict; verdicts that do not occur count 0."""
        found = Counter(self.verdict)
        return {verdict.value: found[verdict] for verdict in Verdict}


@of_problem
def compare(
    problem: AnyProblem,
    methods: Sequence[MethodName] = POINTWISE,
    mine: tuple[float, float] | None = None,
    *,
    solver: Callable[[Problem, MethodName], GainSchedule] = solve,
) -> Comparison:
    """Compare the gains of several methods at each frequency: the closed form, CasADi and the exact optimum.

    The paper's (12) is pointwise, and so is the comparison, whatever scope and realism the problem requires.

    Args:
        problem: the problem; or a problem file, or a name of the catalogue.
        methods: must hold "closed-form" and at least one of `OPTIMISERS`; the closed form is compared with the
            first of these.
        mine: a hand-tuned constant pair (k in N/m, b in N.s/m).
        solver: called as ``solver(problem, method)``; replace it to show progress or to reuse gains.

    Raises:
        InputError: ``methods`` or ``mine`` cannot be compared.

    Example:
        >>> comparison = avc.compare("figure5", mine=(2000.0, 7.0))
        >>> comparison.mine.safer
        'mine'
    """
    for method in methods:
        METHODS.named(method)
    optimum = next((method for method in methods if method in OPTIMISERS), None)
    if "closed-form" not in methods or optimum is None:
        raise InputError.of(
            f"{', '.join(methods) or 'nothing'} cannot be compared; "
            f"allowed: closed-form and at least one of {', '.join(OPTIMISERS)}",
            key="methods",
        )
    if mine is not None and not all(np.isfinite(gain) and gain >= 0 for gain in mine):
        raise InputError.of(
            f"{mine[0]:g},{mine[1]:g} is no pair of gains; allowed: stiffness and damping, finite and >= 0, as 7000,10",
            key="mine",
        )
    stated = with_wall(problem)
    scope = _demanded(stated)
    problem = stated.changed(stability={"scope": "pointwise"}, realism={"require": "none"})
    loop = loop_at(problem, problem.frequencies_hz())
    gains: dict[str, GainSchedule] = {method: solver(problem, method) for method in dict.fromkeys(methods)}
    scale = np.abs(loop.device) + np.abs(loop.hold * loop.desired)
    verdict, reason = judge(gains["closed-form"], gains[optimum], scale)
    both = all(method in gains for method in OPTIMISERS)
    tables = dict(gains) if mine is None else {**gains, "mine": constant_pair(problem, mine)}
    judged = {name: judge_gains(problem, table) for name, table in tables.items()}
    upper, lower = perceived_bounds(problem, loop)
    return Comparison(
        problem=problem.name,
        title=problem.title,
        model=problem.stability.model,
        structure=problem.coupling.structure,
        scope=scope,
        margin_ns_per_m=problem.stability.margin_ns_per_m,
        frequency_hz=problem.frequencies_hz(),
        methods=gains,
        without_coupling=np.asarray(loop.without_coupling),
        target=np.asarray(loop.target),
        upper=upper,
        lower=lower,
        optimum=optimum,
        delivered=optimum,
        verdict=verdict,
        reason=reason,
        injection=damping_injection(problem, loop),
        cross_check=cross_check(gains["direct"], gains["exact"], scale) if both else None,
        mine=None
        if mine is None
        else judge_hand_tuned(
            problem, loop, mine, gains[optimum], AGREEMENT * scale, (judged["mine"].safety, judged[optimum].safety)
        ),
        judged=judged,
        passive_limit_n_per_m=passive_limit_n_per_m(problem.device),
        stated=stated,
    )


def with_delivered(comparison: Comparison, problem: Problem, gains: GainSchedule) -> Comparison:
    """Add the gains of a wider scope or of required realism to the pointwise ones, as a method."""
    name = f"{gains.method}, scope {_demanded(problem)}"
    return replace(
        comparison,
        methods={**comparison.methods, name: gains},
        judged={**comparison.judged, name: judge_gains(problem, gains)},
        delivered=name,
    )


def _demanded(problem: Problem) -> str:
    """Return the name of a problem's scope, with the realism that it requires."""
    scope, require = problem.stability.scope, problem.realism.require
    return scope if require == "none" else f"{scope}, realism {require}"


# The largest damper that a problem can state.
_MOST_NS_PER_M = 1e9


@dataclass(frozen=True, eq=False)
class DampingInjection:
    """The projection read as damping injection; arrays of shape (n,), 0 where the desired wall is passive already.

    Z_h = Z_h_ds + delta with delta = max(0, margin - Re Z_h_ds), so that the coupling renders Z_ds + delta/H. In the
    paper's model without delay 1/H = 1 + s_t T/2: a damper delta and a virtual mass delta T/2.

    Attributes:
        injected_damping_ns_per_m: delta.
        virtual_mass_kg: the part of delta/H that behaves as a mass, Im(delta/H)/Im(s_t).
        contact_damper_ns_per_m: b_p = delta/Re H, which renders delta in the damped structure; not a number where
            Re H <= 0 and no damper can.
        residual_error: |H b_p - delta|/|Z_h_ds|, the relative error of a damper without the virtual mass.
        damped_realisable: whether the damped structure realises it: spring and damper in the gain box render the
            desired wall, and b_p, however large, the injected damping.
        damped_reason: why not; empty where it does.
    """

    injected_damping_ns_per_m: FloatArray
    virtual_mass_kg: FloatArray
    contact_damper_ns_per_m: FloatArray
    residual_error: FloatArray
    damped_realisable: NDArray[np.bool_]
    damped_reason: tuple[str, ...]


def damping_injection(problem: Problem, loop: Loop) -> DampingInjection:
    """Read the closed form of a problem as damping injection."""
    delta = project(problem).injected_damping_ns_per_m
    hold = np.asarray(loop.hold)
    can = hold.real > 0
    needed = delta > 0
    contact = np.where(needed, np.where(can, delta / np.where(can, hold.real, 1.0), np.nan), 0.0)
    size = np.abs(loop.target)
    with np.errstate(divide="ignore", invalid="ignore"):
        residual = np.where(needed, np.abs(hold * contact - delta) / size, 0.0)
    mass = np.imag(delta / hold) / tustin(loop.angle).imag
    damped = solve(_damped(problem), "closed-form")
    return DampingInjection(delta, mass, contact, residual, damped.usable, damped.reason)


def _damped(problem: Problem) -> Problem:
    """Return the same problem in the damped structure, any contact damping allowed."""
    return problem.changed(coupling={"structure": "damped", "contact_damping_ns_per_m": (0.0, _MOST_NS_PER_M)})
