"""The global optimum of (11)-(12) per frequency, from the geometry of circle arcs.

|Z_h_avc| has no extremum but 0 inside the image of the gain box: an optimum lies at a corner, on an edge (an arc), at
the goal, where |Z| = |Z_h_ds| meets Re Z = margin, or at Z = margin; contact damping sweeps the image along H, which
adds segments. All candidates are evaluated, only strictly feasible ones are compared, ties broken lexicographically.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.model.gains import GainSchedule, Status
from avc_casadi.model.problem import Problem
from avc_casadi.model.problem_ranges import least_damped, margin_over_range
from avc_casadi.paper.equations import ImpedanceLoop, coupling_gains, coupling_impedance, loop_at
from avc_casadi.paper.numbers import abs2
from avc_casadi.paper.rows import (
    GainArrays,
    SolveRecord,
    best_candidate,
    gain_schedule,
    guarded_margin,
    in_parts,
    pointwise_notes,
    row_status,
    wanted_points,
)

_LARGEST_STEP = 1e-3
"""Share of t up to which a Newton step is taken: a larger one is no refinement."""
_NEWTON_STEPS = 2
"""Newton steps of a point of given real part."""
_DIGITS = 5
"""A relaxation that is shown has this power of ten below its first digit, and so six digits."""
_FREQUENCIES_AT_ONCE = 10_000
"""Frequencies whose candidates are in memory at a time."""


def real_roots(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """Return the real roots of a t^2 + b t + c, shape (2, ...), free of cancellation; not a number for none."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        half = -0.5 * (b + np.copysign(np.sqrt(b * b - 4 * a * c), b))
        return np.stack((half / a, c / half))


@dataclass(frozen=True)
class Arcs:
    """A stack of arcs Z(t) = (a0 + a1 t)/(c0 + c1 t); every coefficient has a shape that broadcasts to (m, n) arcs.

    Attributes:
        a0: constant term of the numerator.
        a1: its slope.
        c0: constant term of the denominator.
        c1: its slope.
        turn: a1 c0 - a0 c1, free of cancellation: dZ/dt = turn/(c0 + c1 t)^2.
    """

    a0: ComplexArray
    a1: ComplexArray
    c0: ComplexArray
    c1: ComplexArray
    turn: ComplexArray

    def _numerator(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the coefficients of |a0 + a1 t|^2, of t^2, t and 1."""
        return _abs2_of_line(self.a0, self.a1)

    def _denominator(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the coefficients of |c0 + c1 t|^2, of t^2, t and 1."""
        return _abs2_of_line(self.c0, self.c1)

    def magnitude_roots(self, magnitude: FloatArray) -> FloatArray:
        """Return t where |Z(t)| has a given value, shape (2, m, n)."""
        pairs = zip(self._numerator(), self._denominator(), strict=True)
        a, b, c = (top - magnitude * magnitude * bottom for top, bottom in pairs)
        return real_roots(a, b, c)

    def magnitude_extrema(self) -> FloatArray:
        """Return t where d|Z|^2/dt = 0, shape (2, m, n): Re{turn conj((a0 + a1 t)(c0 + c1 t))} = 0."""
        turn = np.conj(self.turn)
        return real_roots(
            (turn * self.a1 * self.c1).real,
            (turn * (self.a0 * self.c1 + self.a1 * self.c0)).real,
            (turn * self.a0 * self.c0).real,
        )

    def _projected(self, direction: complex) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the coefficients of Re(direction * numerator * conj(denominator)), of t^2, t and 1."""
        a0 = direction * self.a0
        a1 = direction * self.a1
        c0 = self.c0
        c1 = self.c1
        return (
            a1.real * c1.real + a1.imag * c1.imag,
            a0.real * c1.real + a0.imag * c1.imag + a1.real * c0.real + a1.imag * c0.imag,
            a0.real * c0.real + a0.imag * c0.imag,
        )

    def level_roots(self, level: FloatArray | float, *, imaginary: bool = False) -> FloatArray:
        """Return t where Re Z (or Im Z) has a given value, shape (2, m, n)."""
        pairs = zip(self._projected(-1j if imaginary else 1.0), self._denominator(), strict=True)
        a, b, c = (top - level * bottom for top, bottom in pairs)
        return real_roots(a, b, c)

    def level_extrema(self, *, imaginary: bool = False) -> FloatArray:
        """Return t where Re Z (or Im Z) is stationary, shape (2, m, n): Re{turn conj(c0 + c1 t)^2} = 0."""
        turn = np.conj(self.turn) * (1j if imaginary else 1.0)
        return real_roots(
            (turn * self.c1 * self.c1).real,
            2 * (turn * self.c0 * self.c1).real,
            (turn * self.c0 * self.c0).real,
        )


def _abs2_of_line(start: ComplexArray, slope: ComplexArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the coefficients of |start + slope t|^2, of t^2, t and 1."""
    return abs2(slope), 2 * (start.real * slope.real + start.imag * slope.imag), abs2(start)


@dataclass(frozen=True)
class Edges:
    """The four edges of the (b, k) box at given contact dampings; arrays broadcast to (edges, n).

    Along an edge one gain t moves between its ends, and the coupling's impedance is base + slope t.

    Attributes:
        loop: the loop at n frequencies.
        base: impedance of the coupling at t = 0, N.s/m.
        slope: its change with t.
        damping: b of edges along k, N.s/m.
        stiffness: k of edges along b, N/m.
        moves_k: whether t is the stiffness; else it is the damping.
        low: lower end of t.
        high: upper end of t.
        contact: contact damping b_p, N.s/m.
    """

    loop: ImpedanceLoop
    base: ComplexArray
    slope: ComplexArray
    damping: FloatArray
    stiffness: FloatArray
    moves_k: NDArray[np.bool_]
    low: FloatArray
    high: FloatArray
    contact: FloatArray

    @classmethod
    def of(cls, problem: Problem, loop: ImpedanceLoop, contacts: tuple[float, ...]) -> Edges:
        """Return the edges of a problem's gain box at each contact damping, N.s/m."""
        b0, b1 = problem.coupling.damping_ns_per_m
        k0, k1 = problem.coupling.stiffness_n_per_m
        # Two edges along k, at either end of b, and two along b, at either end of k.
        b = np.array([b0, b1, b0, b0] * len(contacts))[:, None]
        k = np.array([k0, k0, k0, k1] * len(contacts))[:, None]
        moves_k = np.array([True, True, False, False] * len(contacts))[:, None]
        base = coupling_impedance(loop.angle, np.where(moves_k, b, 0.0), np.where(moves_k, 0.0, k))
        slope = np.where(moves_k, coupling_impedance(loop.angle, 0.0, 1.0), 1.0)
        return cls(
            loop=loop,
            base=base,
            slope=slope,
            damping=b,
            stiffness=k,
            moves_k=moves_k,
            low=np.where(moves_k, k0, b0),
            high=np.where(moves_k, k1, b1),
            contact=np.repeat(contacts, 4)[:, None],
        )

    def rendered(self) -> Arcs:
        """Return Z_eavc = Z_e Z_avc/(Z_e + Z_avc), N.s/m, along each edge: Z_avc runs on a line in b or k."""
        environment = self.loop.environment
        return Arcs(
            environment * self.base,
            environment * self.slope,
            environment + self.base,
            self.slope,
            environment * environment * self.slope,
        )

    def perceived(self) -> Arcs:
        """Return Z_h_avc = Z_d + H (Z_eavc + b_p), N.s/m, along each edge of the gain box."""
        start = self.loop.device + self.loop.hold * self.contact
        inner = self.rendered()
        return Arcs(
            start * inner.c0 + self.loop.hold * inner.a0,
            start * inner.c1 + self.loop.hold * inner.a1,
            inner.c0,
            inner.c1,
            self.loop.hold * inner.turn,
        )

    def derivative(self, t: FloatArray) -> ComplexArray:
        """Return dZ/dt along each edge, without cancellation."""
        b, k = np.where(self.moves_k, self.damping, t), np.where(self.moves_k, t, self.stiffness)
        return np.asarray(self.loop.sensitivity(b, k) * self.slope)

    def gains(self, t: FloatArray) -> GainArrays:
        """Return (b, k, b_p) at t, not a number outside the edge."""
        t = np.where((t >= self.low) & (t <= self.high), t, np.nan)
        return (
            np.where(self.moves_k, self.damping, t),
            np.where(self.moves_k, t, self.stiffness),
            self.contact + 0 * t,
        )


def row_reasons(problem: Problem, status: tuple[Status, ...]) -> tuple[str, ...]:
    """Return for each infeasible row the violated constraint, by how much, and the smallest relaxation."""
    rows = [row for row, item in enumerate(status) if item is Status.INFEASIBLE]
    reasons = [""] * len(status)
    if rows:
        # Reported for the least damped device of the range, which is critical.
        largest, b, k = largest_real_part(least_damped(problem), problem.frequencies_hz()[rows])
        for place, row in enumerate(rows):
            reasons[row] = _reason(problem, largest[place], b[place], k[place])
    return tuple(reasons)


def _reason(problem: Problem, value: float, damping: float, stiffness: float) -> str:
    """Return why no gains meet the margin: the largest Re Z_h, its gains, and the smallest relaxation."""
    margin = problem.stability.margin_ns_per_m
    damping_unit = problem.units.unit("N.s/m")
    stiffness_unit = problem.units.unit("N/m")
    gains = f"b = {damping:.6g} {damping_unit}, k = {stiffness:.6g} {stiffness_unit}"
    largest = f"{value:.6g} {damping_unit}, at {gains}"
    claim = f"Re Z_h >= {margin:g} (stability.margin_ns_per_m)"
    if value >= margin:
        return (
            f"{claim} is just met at an edge of the gain box: {largest}; rounding decides; add device damping, or widen"
            " the box of [coupling]"
        )
    # Rounded to six digits, upwards, so that the relaxation shown suffices.
    step = 10.0 ** (np.floor(np.log10(margin - value)) - _DIGITS)
    missing = float(np.ceil((margin - value) / step) * step) if step > 0 else margin - value
    # A margin cannot be lowered below 0.
    lower = "lower the margin by this, " if margin >= missing else ""
    return (
        f"{claim} cannot be met in the gain box: at most {largest}; missed by {missing:.6g} {damping_unit}; {lower}add "
        "this much device damping, or widen the box of [coupling]"
    )


def largest_real_part(problem: Problem, frequency_hz: FloatArray) -> GainArrays:
    """Return (max Re Z_h over the gain box, b, k), each (n,).

    Re Z_h is harmonic in the gains, so that its maximum is on an edge of the box.
    """
    loop = loop_at(problem, frequency_hz)
    edges = Edges.of(problem, loop, problem.coupling.contact_damping_ns_per_m)
    stationary = edges.perceived().level_extrema()
    ends = np.broadcast_to(np.stack((edges.low, edges.high)), stationary.shape)
    t = np.concatenate((stationary, ends))
    b, k, p = (gain.reshape(-1, t.shape[-1]) for gain in edges.gains(t))
    value = loop.perceived(b, k, p).real
    best = (np.nanargmax(value, axis=0), np.arange(value.shape[1]))
    return value[best], b[best], k[best]


def _edge_candidates(edges: Edges, radius: FloatArray, margin: float) -> list[FloatArray]:
    """Return gains on the edges of the box that may be optimal: corners, extrema, and two kinds of crossings.

    |Z_h| = `radius` meets the goal (11), Re Z_h = `margin` is the limit (12), N.s/m; Newton steps refine them.
    """
    loop, arcs = edges.loop, edges.perceived()
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        on_circle = arcs.magnitude_roots(radius)
        b, k, p = edges.gains(on_circle)
        z = loop.perceived(b, k, p)
        step = (abs2(z) - radius * radius) / (2 * (np.conj(z) * edges.derivative(on_circle)).real)
        on_circle = np.where(np.abs(step) < _LARGEST_STEP * on_circle, on_circle - step, on_circle)

        on_line = arcs.level_roots(margin)
        for _ in range(_NEWTON_STEPS):
            b, k, p = edges.gains(on_line)
            rendered = loop.rendered(b, k) + p
            z = loop.device + loop.hold * rendered
            step = (z.real - guarded_margin(loop.device, loop.hold, rendered, margin)) / edges.derivative(on_line).real
            on_line = np.where(np.abs(step) < _LARGEST_STEP * on_line, on_line - step, on_line)
    ends = np.broadcast_to(np.stack((edges.low, edges.high)), on_line.shape)
    t = np.concatenate((on_circle, on_line, arcs.magnitude_extrema(), arcs.level_extrema(), ends))
    return [gain.reshape(-1, t.shape[-1]) for gain in edges.gains(t)]


def _inner_candidates(
    problem: Problem, loop: ImpedanceLoop, radius: FloatArray, margin: float, edges: Edges
) -> list[list[FloatArray]]:
    """Return gains inside the box that render the wanted points, with the smallest admissible contact damping.

    A wanted point has |Z_h| = `radius` or is the nearest with Re Z_h = `margin`, N.s/m.
    """
    lowest, highest = problem.coupling.contact_damping_ns_per_m
    wanted, gap = wanted_points(loop, radius, margin)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        b, k = coupling_gains(loop.angle, loop.environment * (wanted - lowest) / (gap + lowest))
        candidates = [[b, k, np.full(b.shape, lowest)]]
        if highest > lowest:
            arcs = edges.rendered()
            for point in wanted:
                t = arcs.level_roots(point.imag, imaginary=True)
                b, k, _ = edges.gains(t)
                p = point.real - loop.rendered(b, k).real
                shape = (-1, t.shape[-1])
                candidates.append([b.reshape(shape), k.reshape(shape), p.reshape(shape)])
    return candidates


def _segment_candidates(
    problem: Problem, loop: ImpedanceLoop, radius: FloatArray, margin: float, edges: Edges
) -> list[FloatArray]:
    """Return gains b, k, b_p on the segments that b_p sweeps from corners and from stationary Im Z_eavc.

    On each they have |Z_h| = `radius`, Re Z_h = `margin`, N.s/m, or are the nearest to 0 or an end.
    """
    folds = np.concatenate(
        (
            edges.rendered().level_extrema(imaginary=True),
            np.stack(np.broadcast_arrays(edges.low + 0 * loop.hold.real, edges.high + 0 * loop.hold.real)),
        )
    )
    b, k, _ = edges.gains(folds)
    b, k = b.reshape(-1, b.shape[-1]), k.reshape(-1, k.shape[-1])
    rendered = loop.rendered(b, k)
    start = loop.device + loop.hold * rendered
    ones = np.ones_like(start)
    line = Arcs(a0=start, a1=loop.hold * ones, c0=ones, c1=np.zeros_like(start), turn=loop.hold * ones)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        on_line = (margin - start.real) / loop.hold.real
        on_line += (guarded_margin(loop.device, loop.hold, rendered + on_line, margin) - margin) / loop.hold.real
        ends = [np.full(b.shape, end) for end in problem.coupling.contact_damping_ns_per_m]
        nearest = -(start * np.conj(loop.hold)).real / abs2(loop.hold)
        p = np.stack((*line.magnitude_roots(radius), on_line, nearest, *ends))
    return [gain.reshape(-1, p.shape[-1]) for gain in np.broadcast_arrays(b, k, p)]


def exact_gains(problem: Problem, loop: ImpedanceLoop, *, progress: Progress = SILENT) -> GainArrays:
    """Return the optimal (b, k, b_p), each (n,); not a number where no gains of the box meet the constraint."""
    return in_parts(loop, _FREQUENCIES_AT_ONCE, progress, lambda part: _by_arcs(problem, part))


def _by_arcs(problem: Problem, loop: ImpedanceLoop) -> GainArrays:
    """Return the best of all candidates at the frequencies of a loop."""
    margin = margin_over_range(problem)
    radius = np.abs(loop.target)
    contacts = problem.coupling.contact_damping_ns_per_m
    edges = Edges.of(problem, loop, contacts if contacts[1] > contacts[0] else contacts[:1])
    groups = [_edge_candidates(edges, radius, margin)]
    plain_edges = Edges.of(problem, loop, contacts[:1])
    groups += _inner_candidates(problem, loop, radius, margin, plain_edges)
    if contacts[1] > contacts[0]:
        groups.append(_segment_candidates(problem, loop, radius, margin, plain_edges))
    b, k, p = (np.concatenate(column) for column in zip(*groups, strict=True))
    return best_candidate(problem, loop, b, k, p)


def solve_exact(problem: Problem, *, progress: Progress = SILENT) -> GainSchedule:
    """Solve (11)-(12) at every frequency by arc geometry: the global optimum, without iteration."""
    started = time.perf_counter()
    loop = loop_at(problem, problem.frequencies_hz())
    gains = exact_gains(problem, loop, progress=progress)
    status = row_status(problem, *gains)
    seconds = time.perf_counter() - started
    reason, notes = row_reasons(problem, status), pointwise_notes(problem)
    record = SolveRecord(reason=reason, solve_seconds=seconds, notes=notes)
    return gain_schedule(problem, "exact", gains, status, record)
