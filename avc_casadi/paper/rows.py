"""Common code of the methods: the order among gains, the status of a row, and the schedule with its impedance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray
from avc_casadi._util.progress import Progress, chunks
from avc_casadi.model.gains import GainSchedule, Status
from avc_casadi.model.law import Law
from avc_casadi.model.problem import Problem
from avc_casadi.model.problem_ranges import margin_over_range
from avc_casadi.model.runtime import StateFeedback
from avc_casadi.paper.equations import (
    ImpedanceLoop,
    SampleAngle,
    backward_difference,
    coupling_impedance,
    environment_impedance,
    loop_at,
    perceived_impedance,
    series,
)
from avc_casadi.paper.numbers import NUMPY

_MARGIN_ROUNDING = 4 * float(np.finfo(np.float64).eps)
"""Rounding of Re Z_h, relative to the magnitudes of its terms."""
_AT_BOUND = 1e-6
"""A gain this near to an end of its box, as a share of the upper end, is at its bound."""


def guarded_margin(device: ComplexArray, hold: ComplexArray, rendered: ComplexArray, margin: float) -> FloatArray:
    """Return the margin plus the rounding of Re(device + hold * rendered), for a point meant to lie on the margin."""
    terms = np.abs(device.real) + np.abs(hold.real * rendered.real) + np.abs(hold.imag * rendered.imag)
    return np.asarray(margin + _MARGIN_ROUNDING * terms)


def wanted_points(loop: ImpedanceLoop, radius: FloatArray, margin: float) -> tuple[ComplexArray, ComplexArray]:
    """Return Z_eavc and Z_e - Z_eavc, (4, n): at the goal, where |Z| = R crosses Re Z = margin (2), at Z = margin."""
    target = loop.target
    at_goal = np.where(target.real >= margin, 0, np.nan)
    # Both parts of Z_eavc may be this large; on the circle a larger guard changes no error.
    sizes = (1 + 1j) * (np.abs(loop.desired) + np.abs(target / loop.hold))
    guarded = guarded_margin(loop.device, loop.hold, sizes, margin)
    with np.errstate(invalid="ignore", divide="ignore"):
        height = np.sqrt(radius * radius - guarded * guarded)
        # Towards the goal's side the two heights nearly cancel; the difference of squares does not.
        side = np.where(target.imag < 0, -1.0, 1.0)
        short_height = (target.real - guarded) * (target.real + guarded) / (height + np.abs(target.imag))
        to_margin = guarded - target.real
        shift_of_z = (
            at_goal + 0j,
            to_margin + 1j * side * short_height,
            to_margin - 1j * (side * height + target.imag),
            to_margin - 1j * target.imag,
        )
        shift = np.stack(shift_of_z) / loop.hold
    return loop.desired + shift, loop.desired_gap - shift


TIE = 1e-12
"""Magnitude errors, and distances |Z_h_avc - Z_h_ds|, that differ by less than this share of |Z_h_ds| are equal."""

GainArrays = tuple[FloatArray, FloatArray, FloatArray]
"""Gains (b, k, b_p), N.s/m, N/m and N.s/m, of one shape: a frequency a column."""


def admissible(problem: Problem, b: FloatArray, k: FloatArray, p: FloatArray) -> BoolArray:
    """Return whether each (b, k, b_p) lies in the gain box, of the shape of the gains."""
    b0, b1 = problem.coupling.damping_ns_per_m
    k0, k1 = problem.coupling.stiffness_n_per_m
    p0, p1 = problem.coupling.contact_damping_ns_per_m
    return np.asarray((b >= b0) & (b <= b1) & (k >= k0) & (k <= k1) & (p >= p0) & (p <= p1))


def in_parts(
    loop: ImpedanceLoop, at_once: int, progress: Progress, solve: Callable[[ImpedanceLoop], GainArrays]
) -> GainArrays:
    """Solve some frequencies at a time: few enough for memory and for progress reports."""
    rows = np.arange(len(loop.target))
    solved = [solve(loop.rows(rows[part])) for part in chunks(len(rows), at_once, progress, "frequencies")]
    b, k, p = (np.concatenate(gain) for gain in zip(*solved, strict=True))
    return b, k, p


def best_candidate(
    problem: Problem, loop: ImpedanceLoop, b: FloatArray, k: FloatArray, p: FloatArray, *, tie: float = TIE
) -> GainArrays:
    """Return per frequency the best of candidates (m, n), each (n,); not a number where none is feasible.

    Feasible ones lie in the gain box with Re Z_h >= margin. Of these, in order: least magnitude error, least distance
    to Z_h_ds, both within ``tie`` of |Z_h_ds|, least b_p, least k, least b, and the first.
    """
    margin = margin_over_range(problem)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        z = loop.perceived(b, k, p)
        feasible = admissible(problem, b, k, p) & (z.real >= margin)
        radius = np.abs(loop.target)
        error = np.where(feasible, np.abs(np.abs(z) - radius), np.inf)
    lowest = error.min(axis=0)
    left = feasible & (error <= lowest + tie * radius)
    distance = np.where(left, np.abs(z - loop.target), np.inf)
    left &= distance <= distance.min(axis=0) + tie * radius
    for gain in (p, k, b):
        ranked = np.where(left, gain, np.inf)
        left &= ranked <= ranked.min(axis=0)
    chosen = (left.argmax(axis=0), np.arange(z.shape[1]))
    empty = ~np.isfinite(lowest)
    best_b, best_k, best_p = (np.where(empty, np.nan, gain[chosen]) for gain in (b, k, p))
    return best_b, best_k, best_p


def pointwise_notes(problem: Problem) -> tuple[str, ...]:
    """Return a note that gains are pointwise where the problem requires more, for methods without other scopes."""
    scope = problem.stability.scope
    note = f"pointwise gains, each frequency on its own: they need not meet scope {scope}, as schedule does"
    return () if scope == "pointwise" else (note,)


def row_status(problem: Problem, b: FloatArray, k: FloatArray, p: FloatArray) -> tuple[Status, ...]:
    """Return the status of solved rows; a gain within 1e-6 of its box's upper end from an end is at its bound."""
    box = problem.coupling
    bounded = [(b, box.damping_ns_per_m), (k, box.stiffness_n_per_m)]
    if box.structure == "damped":
        bounded.append((p, box.contact_damping_ns_per_m))
    active = np.zeros(b.shape, dtype=bool)
    for gain, ends in bounded:
        for end in ends:
            active |= np.abs(gain - end) <= _AT_BOUND * ends[1]
    solved = np.where(active, Status.ACTIVE_BOUND, Status.SOLVED)
    return tuple(Status(item) for item in np.where(np.isnan(b), Status.INFEASIBLE, solved))


def perceived_impedance_of(
    problem: Problem, frequency_hz: FloatArray, gains: GainArrays, law: StateFeedback | None = None
) -> ComplexArray:
    """Return Z_h_avc at each frequency, N.s/m, shape (n,)."""
    loop = loop_at(problem, frequency_hz)
    b, k, contact = gains
    if law is None:
        return np.asarray(loop.perceived(b, k, contact))
    angle = SampleAngle.at(NUMPY, frequency_hz, problem.device.sample_time_s)
    # The law runs on a device: to it the wall is a force over position, in any model of the problem.
    wall = problem.environment
    coupling = coupling_impedance(angle, b, k)
    wall_impedance = environment_impedance(angle, "sampled-data", wall.damping_ns_per_m, wall.stiffness_n_per_m)
    stiffness = (contact + series(coupling, wall_impedance, numbers=NUMPY)) * backward_difference(angle)
    # The impedance of a 1 N/m spring converts force over position to force over velocity, in the problem's model.
    unit = environment_impedance(angle, problem.stability.model, 0.0, 1.0)
    whole = Law.gain(stiffness, problem.device.sample_time_s).behind(law)
    force = whole.transfer(np.exp(2j * np.pi * angle.turns))
    return np.asarray(perceived_impedance(loop.device, loop.hold, force * unit))


@dataclass(frozen=True)
class SolveRecord:
    """What a method reports beside its gains.

    Attributes:
        solver: name of the solver; None without one.
        reason: why each row has no gains, or is not as it should be; empty where it is.
        build_seconds: time in which the solver was made.
        solve_seconds: time in which it solved.
        notes: facts on the whole schedule, a sentence each.
    """

    solver: str | None = None
    reason: tuple[str, ...] = ()
    build_seconds: float = 0.0
    solve_seconds: float = 0.0
    notes: tuple[str, ...] = ()


NOTHING_TO_REPORT = SolveRecord()


def gain_schedule(
    problem: Problem,
    method: str,
    gains: GainArrays,
    status: tuple[Status, ...],
    record: SolveRecord = NOTHING_TO_REPORT,
    *,
    frequency_hz: FloatArray | None = None,
    state_feedback: StateFeedback | None = None,
) -> GainSchedule:
    """Return the schedule of gains (b, k, b_p); one code recomputes the impedances of every method.

    The status of a row decides whether its gains are usable. The frequencies are those of the problem unless others
    are given. A law runs behind the gains as `state_feedback`.
    """
    frequency = problem.frequencies_hz() if frequency_hz is None else frequency_hz
    usable = np.array([item.has_gains for item in status], dtype=bool)
    b, k, bp = (np.where(usable, np.asarray(gain, dtype=np.float64), np.nan) for gain in gains)
    impedance = np.full(frequency.shape, np.nan, dtype=np.complex128)
    if usable.any():
        rendering = b[usable], k[usable], bp[usable]
        impedance[usable] = perceived_impedance_of(problem, frequency[usable], rendering, state_feedback)
    return GainSchedule(
        problem=problem.name,
        method=method,
        solver=record.solver,
        structure=problem.coupling.structure,
        model=problem.stability.model,
        sample_time_s=problem.device.sample_time_s,
        frequency_hz=frequency,
        damping_ns_per_m=b,
        stiffness_n_per_m=k,
        contact_damping_ns_per_m=bp,
        impedance=impedance,
        target=np.asarray(loop_at(problem, frequency).target),
        definition=problem,
        status=status,
        reason=record.reason or ("",) * len(status),
        requested_damping_ns_per_m=b,
        requested_stiffness_n_per_m=k,
        requested_contact_damping_ns_per_m=bp,
        build_seconds=record.build_seconds,
        solve_seconds=record.solve_seconds,
        notes=record.notes,
        state_feedback=state_feedback,
    )
