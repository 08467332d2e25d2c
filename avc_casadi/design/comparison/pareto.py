"""Trade-off of guarantee and realism: the cost of each guarantee, and the gain of adaptive over constant gains.

A study of the source distribution (`avc study pareto`); kept here while `pareto` is deprecated, for release 0.3.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from avc_casadi._util.arrays import Comparable, FloatArray
from avc_casadi._util.checkpoint import Chunked
from avc_casadi._util.json_values import plain
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi._util.text import Columns, Tabular
from avc_casadi._util.units import NS_PER_M
from avc_casadi.claims.certify import certify
from avc_casadi.claims.passivity.sampled_loop import passive_limit_n_per_m
from avc_casadi.design.schedule.solver import solve_schedule
from avc_casadi.files.problem_file import AnyProblem, of_problem, with_wall
from avc_casadi.model.schedule import GainSchedule

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from avc_casadi.model.problem import Problem

Study = Literal["scope", "slope", "contact"]

HANDS_HZ = (1.0, 50.0)
"""Frequencies at which hands move and contact chatters."""
_BAND_FACTORS = (1.5, 2.0, 4.0, 10.0)
_SLOPE_LIMITS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
_CONTACT_SHARES = (0.0, 0.05, 0.1, 0.2, 0.35, 0.5, 0.75, 1.0)
"""Largest contact damping as a share of 2 m/T, where a sampled damper alone becomes unstable."""


@dataclass(frozen=True)
class Variant:
    """One variant to be solved by `schedule`.

    Attributes:
        study: which quantity is varied.
        label: its value, in words.
        value: its value as a number, or None where it has none (no limit, all frequencies, hands).
        constant: whether the gains may not vary with frequency.
        problem: the problem to solve.
    """

    study: Study
    label: str
    value: float | None
    constant: bool
    problem: Problem


def variants(problem: Problem) -> list[Variant]:
    """Return the variants of the study of a problem, all with its own model, box and objective unless said otherwise.

    - scope: its own frequency, bands, all frequencies, hands; each with adaptive and with constant gains;
    - slope: limits on the slopes under the problem's own scope;
    - contact: limits on b_p with structure `damped`, complex error and scope `hands`, adaptive and constant.

    Where the problem names no interaction frequencies, those of hands are taken, so that the measured error is the one
    minimised.
    """
    if problem.schedule.interaction_hz is None:
        problem = problem.changed(schedule={"interaction_hz": HANDS_HZ})
    found: list[Variant] = []
    settings = problem.stability
    factors = sorted({*_BAND_FACTORS, settings.band_factor} - {1.0})
    scopes: list[tuple[str, float | None, dict[str, Any]]] = [
        ("own frequency", 1.0, {"scope": "pointwise"}),
        *((f"band {factor:g}", factor, {"scope": "band", "band_factor": factor}) for factor in factors),
        ("all frequencies", None, {"scope": "all"}),
        ("hands", None, {"scope": "hands"}),
    ]
    for label, value, keys in scopes:
        scoped = problem.changed(stability=keys)
        found += [
            Variant("scope", label, value, False, scoped),
            Variant("scope", label, value, True, scoped),
        ]
    found.append(Variant("slope", "constant", 0.0, True, problem))
    for limit in (*_SLOPE_LIMITS, None):
        label = "no limit" if limit is None else f"{limit:g}"
        found.append(Variant("slope", label, limit, False, problem.changed(schedule={"slope_limit": limit})))
    largest = 2 * problem.device.mass_kg / problem.device.sample_time_s
    for share in _CONTACT_SHARES if largest > 0 else (0.0,):
        damped = problem.changed(
            coupling={"structure": "damped", "contact_damping_ns_per_m": (0.0, share * largest)},
            stability={"scope": "hands"},
            realism={"objective": "complex"},
        )
        value = share * largest
        found += [
            Variant("contact", f"{value:g} {NS_PER_M}", value, False, damped),
            Variant("contact", f"{value:g} {NS_PER_M}", value, True, damped),
        ]
    return found


@dataclass(frozen=True, eq=False)
class Point(Comparable):
    """One design, its errors and certificate; not a number where it has no gains at some frequency.

    Attributes:
        study: which quantity is varied: scope, slope or contact.
        label: its value in words.
        value: its value as a number, or None.
        constant: whether the gains are constant.
        scope: required scope of frequencies.
        objective: the one minimised.
        magnitude_error: root mean square of ||Z_h_ds| - |Z_h||/|Z_h_ds| over ln(frequency) in the band of hands.
        complex_error: the same of |Z_h - Z_h_ds|/|Z_h_ds|.
        dc_stiffness_n_per_m: k k_e/(k + k_e) of the row of the lowest frequency, felt by a hand at rest.
        steepest: largest |d ln(gain)/d ln(frequency)| of b and k between neighbouring rows that have them.
        contact_damping_ns_per_m: largest b_p of the table.
        rows_without_gains: number of rows without gains.
        passed: by level of the certificate, whether all rows meet it.
        margin_ns_per_m: by level, the worst margin.
        seconds: time to solve.
    """

    study: Study
    label: str
    value: float | None
    constant: bool
    scope: str
    objective: str
    magnitude_error: float
    complex_error: float
    dc_stiffness_n_per_m: float
    steepest: float
    contact_damping_ns_per_m: float
    rows_without_gains: int
    passed: dict[str, bool]
    margin_ns_per_m: dict[str, float]
    seconds: float = field(compare=False)


@dataclass(frozen=True, eq=False, repr=False)
class Pareto(Tabular):
    """The study of one problem.

    Attributes:
        problem: its name.
        title: its title.
        model: hold model of the constraints.
        band_hz: band of averaging.
        dc_frequency_hz: frequency of the row whose DC stiffness is stated.
        wall_stiffness_n_per_m: k_e.
        desired_stiffness_n_per_m: k of the mean of the bounds.
        passive_limit_n_per_m: 2 b_d/((1 + d) T), which no passive linear rendering exceeds.
        points: all designs.
    """

    problem: str
    title: str
    model: str
    band_hz: tuple[float, float]
    dc_frequency_hz: float
    wall_stiffness_n_per_m: float
    desired_stiffness_n_per_m: float
    passive_limit_n_per_m: float
    points: tuple[Point, ...]

    def to_dict(self) -> Columns:
        """Return the designs as columns, one row each."""
        names = (
            "label",
            "study",
            "constant",
            "scope",
            "objective",
            "magnitude_error",
            "complex_error",
            "dc_stiffness_n_per_m",
            "steepest",
            "contact_damping_ns_per_m",
            "rows_without_gains",
        )
        columns = {name: np.array([getattr(point, name) for point in self.points]) for name in names}
        levels = self.points[0].passed if self.points else ()
        return columns | {f"{level}_passed": np.array([p.passed[level] for p in self.points]) for level in levels}

    def _summary(self) -> str:
        low, high = self.band_hz
        return f"{self.problem!r}: {len(self.points)} designs, errors from {low:.4g} to {high:.4g} Hz"

    def of(self, study: Study, *, constant: bool | None = None) -> list[Point]:
        """Return the points of one study, in order; adaptive or constant ones, or both."""
        return [p for p in self.points if p.study == study and constant in {None, p.constant}]

    def document(self) -> dict[str, Any]:
        """Return the `pareto` document: JSON values only, null where a number is undefined."""
        facts = {name: value for name, value in vars(self).items() if name != "points"}
        return {"schema": "avc-pareto/1", **plain(facts), "points": [plain(vars(point)) for point in self.points]}


@of_problem
def study_pareto(
    problem: AnyProblem,
    progress: Progress = SILENT,
    *,
    executor: Executor | None = None,
    workers: int = 1,
) -> Pareto:
    """Solve, measure and certify about thirty schedules of a problem.

    Args:
        problem: the problem; or a problem file, or a name of the catalogue.
        progress: reports the designs.
        executor: solves and certifies some of the designs, as for `Chunked.run`.
        workers: processes, where there is no executor.
    """
    problem = with_wall(problem)
    frequency = problem.frequencies_hz()
    low, high = problem.schedule.interaction_hz or HANDS_HZ
    inside = (frequency >= low) & (frequency <= high)
    if not inside.any():
        inside[:] = True
    weight = np.where(inside, _log_weights(frequency), 0.0)
    study: Chunked[Variant, list[Point]] = Chunked(
        {}, partial(_point, weight / weight.sum()), variants(problem), list, things="designs"
    )
    points = study.run(executor, workers=workers, progress=progress)
    upper, lower = problem.boundaries.upper, problem.boundaries.lower
    return Pareto(
        problem=problem.name,
        title=problem.title,
        model=problem.stability.model,
        band_hz=(float(frequency[inside][0]), float(frequency[inside][-1])),
        dc_frequency_hz=float(frequency[0]),
        wall_stiffness_n_per_m=problem.environment.stiffness_n_per_m,
        desired_stiffness_n_per_m=(upper.stiffness_n_per_m + lower.stiffness_n_per_m) / 2,
        passive_limit_n_per_m=passive_limit_n_per_m(problem.device),
        points=tuple(points),
    )


def pareto(
    problem: AnyProblem,
    progress: Progress = SILENT,
    *,
    executor: Executor | None = None,
    workers: int = 1,
) -> Pareto:
    """Return the trade-off of guarantee and realism, of release 0.2; deprecated, removed in 0.4.

    Arguments as for `study_pareto`.

    Example:
        >>> study = avc.pareto("figure5")
        >>> study.of("scope", constant=False)[0].label
        'own frequency'
    """
    warnings.warn(
        "avc.pareto goes with 0.4: the trade-off is a study of the source distribution since 0.3, `avc study pareto`",
        DeprecationWarning,
        stacklevel=2,
    )
    return study_pareto(problem, progress, executor=executor, workers=workers)


def _point(weight: FloatArray, variant: Variant) -> Point:
    problem = variant.problem
    gains = solve_schedule(problem, constant=variant.constant)
    certificate = certify(problem, gains)
    with np.errstate(divide="ignore", invalid="ignore"):
        magnitude = gains.magnitude_error / np.abs(gains.target)
    used = weight > 0
    return Point(
        study=variant.study,
        label=variant.label,
        value=variant.value,
        constant=variant.constant,
        scope=problem.stability.scope,
        objective=problem.realism.objective,
        magnitude_error=_root_mean_square(magnitude[used], weight[used]),
        complex_error=_root_mean_square(gains.complex_error[used], weight[used]),
        dc_stiffness_n_per_m=float(certificate.dc_stiffness_n_per_m[0]),
        steepest=_steepest(gains),
        contact_damping_ns_per_m=float(np.max(gains.contact_damping_ns_per_m)),
        rows_without_gains=certificate.rows_without_gains,
        passed={level: result.passed for level, result in certificate.levels.items()},
        margin_ns_per_m={level: result.margin_ns_per_m for level, result in certificate.levels.items()},
        seconds=gains.build_seconds + gains.solve_seconds,
    )


def _root_mean_square(values: FloatArray, weight: FloatArray) -> float:
    return float(np.sqrt(weight @ values**2))


def _log_weights(frequency_hz: FloatArray) -> FloatArray:
    """Return trapezoidal weights over ln(frequency), (n,)."""
    if len(frequency_hz) == 1:
        return np.ones(1)
    return np.asarray(np.convolve(np.diff(np.log(frequency_hz)), [0.5, 0.5]))


def _steepest(gains: GainSchedule) -> float:
    if gains.rows < 2:
        return 0.0
    table = np.stack((gains.damping_ns_per_m, gains.stiffness_n_per_m))
    with np.errstate(divide="ignore", invalid="ignore"):
        slopes = np.diff(np.log(table), axis=1) / np.diff(np.log(gains.frequency_hz))
    slopes = slopes[np.isfinite(slopes)]
    return float(np.abs(slopes).max(initial=0.0))
