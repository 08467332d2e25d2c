"""The worst margin of Re Z_h over a band of frequencies, and the other conditions of passivity."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
from avc_casadi._util.progress import SILENT, Progress, chunks
from avc_casadi.loops.spectrum import lowest
from avc_casadi.loops.wall import Fractions, SampledLoop, Values, fractions

# Represents the limit of zero frequency: small enough for every term, large enough to divide by.
_ZERO_TURNS = 1e-150


def real_part(
    loop: SampledLoop, parts: Fractions, contact_damping_ns_per_m: Values, frequency_hz: Values
) -> FloatArray:
    """Re Z_h at 0 <= frequency_hz <= Nyquist, N.s/m; at 0 its limit; all arguments broadcast.

    With H = h exp(-j psi): Re Z_h = b_d + h {(g + b_p) cos psi - r sin(psi + phi)/(2 sin phi)
    + c [(1 - rho) cos psi - 2 sin phi sin(psi + phi)]/[(1 - rho)^2 + 4 rho sin^2 phi]}.
    """
    amplitude, terms = _terms(loop, parts, contact_damping_ns_per_m, frequency_hz)
    return np.asarray(loop.device_damping_ns_per_m + amplitude * sum(terms))


def size_of_terms(
    loop: SampledLoop, parts: Fractions, contact_damping_ns_per_m: Values, frequency_hz: Values | None = None
) -> FloatArray:
    """Sum of the magnitudes of the terms of Re Z_h, N.s/m: rounding errors are a multiple of it."""
    if frequency_hz is not None:
        amplitude, terms = _terms(loop, parts, contact_damping_ns_per_m, frequency_hz)
        return np.asarray(loop.device_damping_ns_per_m + amplitude * sum(np.abs(term) for term in terms))
    reach = loop.delay_samples + 1.5
    decay = np.abs(parts.decaying) / np.maximum(np.abs(parts.pole_gap), np.finfo(np.float64).tiny)
    steady = np.abs(parts.direct) + np.abs(contact_damping_ns_per_m) + reach * np.abs(parts.integral)
    return np.asarray(loop.device_damping_ns_per_m + steady + decay)


def _terms(
    loop: SampledLoop, parts: Fractions, contact: Values, frequency_hz: Values
) -> tuple[FloatArray, tuple[FloatArray, ...]]:
    """Return h and the terms of Re Z_h in the braces of `real_part`, those of opposite sign separate."""
    turns = np.maximum(np.asarray(frequency_hz, dtype=np.float64) * loop.sample_time_s, _ZERO_TURNS)
    sine, cosine = np.sin(np.pi * turns), np.sin(np.pi * (0.5 - turns))
    half_turns = 2 * loop.delay_samples + (1 if loop.model == "paper" else 2)
    amplitude = cosine if loop.model == "paper" else np.ones_like(cosine)
    cos_psi = _cos_half_turns(half_turns, turns)
    sin_next = np.sin(np.pi * (half_turns + 1) * turns)
    distance2 = parts.pole_gap**2 + 4 * parts.pole * sine**2
    decaying = parts.decaying / np.where(distance2 == 0, np.finfo(np.float64).tiny, distance2)
    return amplitude, (
        parts.direct * cos_psi,
        contact * cos_psi,
        -parts.integral * (sin_next / (2 * sine)),
        decaying * parts.pole_gap * cos_psi,
        -decaying * (2 * sine * sin_next),
    )


def _cos_half_turns(count: float, turns: FloatArray) -> FloatArray:
    """cos(count phi), accurate at its zero at Nyquist where ``count`` is odd."""
    if count % 2 == 1:
        sign = 1.0 if count % 4 == 1 else -1.0
        return np.asarray(sign * np.sin(np.pi * count * (0.5 - turns)))
    return np.asarray(np.cos(np.pi * count * turns))


_EPS = float(np.finfo(np.float64).eps)
_MINIMA = 6
# Eigenvalues cost the cube of the degree.
_MOST_ROOTS = 64


def real_parts_of_roots(rows: FloatArray) -> FloatArray:
    """Return the real parts of the roots of rows of Chebyshev coefficients, by eigenvalues of colleague matrices."""
    roots = np.ones((rows.shape[0], rows.shape[1] - 1))
    significant = np.abs(rows) > _EPS * np.max(np.abs(rows), axis=1, keepdims=True)
    degrees = np.where(significant.any(axis=1), significant.shape[1] - 1 - np.argmax(significant[:, ::-1], axis=1), 0)
    for degree in np.unique(degrees[degrees > 0]):
        of_degree = np.flatnonzero(degrees == degree)
        matrices = _colleague(rows[of_degree, : degree + 1])
        roots[of_degree, :degree] = np.linalg.eigvals(matrices).real
    return roots


def _colleague(rows: FloatArray) -> FloatArray:
    """Return the symmetrised colleague matrices, shape (n, degree, degree)."""
    degree = rows.shape[1] - 1
    if degree == 1:
        return np.asarray(-rows[:, :1, None] / rows[:, 1:, None])
    base = np.zeros((degree, degree))
    off = np.full(degree - 1, 0.5)
    off[0] = np.sqrt(0.5)
    base[np.arange(degree - 1), np.arange(1, degree)] = off
    base[np.arange(1, degree), np.arange(degree - 1)] = off
    scale = np.full(degree, np.sqrt(0.5))
    scale[0] = 1.0
    matrices = np.broadcast_to(base, (rows.shape[0], degree, degree)).copy()
    matrices[:, :, -1] -= rows[:, :-1] / rows[:, -1:] * (scale / scale[-1]) * 0.5
    return matrices


def seeds_hz(oscillations: int, nyquist_hz: float) -> FloatArray:
    """Return frequencies, shape (m,), that resolve so many half-waves up to Nyquist; many more without roots."""
    return np.linspace(0.0, nyquist_hz, (4 if has_roots(oscillations) else 24) * oscillations + 1)


def has_roots(degree: int) -> bool:
    """Return whether stationary points of this degree are computed as roots; beyond, a fine scan replaces them."""
    return degree <= _MOST_ROOTS


def refine_minima(value: Callable[[FloatArray], FloatArray], points: FloatArray, oscillations: int) -> FloatArray:
    """Refine the lowest local minima of sorted points, or all those of a scan, by golden section."""
    values = value(points)
    before, after, first = _neighbours(points)
    below = [values <= np.take_along_axis(values, other, axis=1) for other in (before, after)]
    local = np.where(first & below[0] & below[1], values, np.inf)
    count = min(_MINIMA if has_roots(oscillations) else oscillations // 2 + _MINIMA, points.shape[1])
    chosen = np.argsort(local, axis=1)[:, :count]
    left, right = (np.take_along_axis(points, np.take_along_axis(other, chosen, 1), 1) for other in (before, after))
    centre = np.take_along_axis(points, chosen, axis=1)
    return np.concatenate([points, lowest(value, left, centre, right)], axis=1)


def _neighbours(points: FloatArray) -> tuple[IndexArray, IndexArray, BoolArray]:
    """Return the positions of the next lower and higher point, and whether each point is the first of its equals."""
    size = points.shape[1]
    at = np.broadcast_to(np.arange(size), points.shape)
    first = np.diff(points, axis=1, prepend=-np.inf) > 0
    last = np.diff(points, axis=1, append=np.inf) > 0
    begin = np.maximum.accumulate(np.where(first, at, 0), axis=1)
    end = np.minimum.accumulate(np.where(last, at, size - 1)[:, ::-1], axis=1)[:, ::-1]
    return np.maximum(begin - 1, 0), np.minimum(end + 1, size - 1), first


def quadratic_stretch(bend: FloatArray, slope: FloatArray, free: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the ends of the lowest interval of x >= 0 with bend x^2 + slope x + free >= 0; infinite without one."""
    inside = slope**2 - 4 * bend * free
    half = -(slope + np.copysign(np.sqrt(np.maximum(inside, 0.0)), slope)) / 2
    with np.errstate(divide="ignore", invalid="ignore"):
        roots = np.stack([half / bend, free / half])

    def ahead(root: FloatArray) -> BoolArray:
        return np.asarray((inside >= 0) & ((root > 0) | ((root == 0) & (slope < 0))))

    first, second = np.sort(np.where(np.isfinite(roots) & ahead(roots), roots, np.inf), axis=0)
    return np.where(free >= 0, 0.0, first), np.where(free >= 0, first, second)


def stationary_cosines(loop: SampledLoop, parts: Fractions, contact_damping_ns_per_m: FloatArray) -> FloatArray:
    """Return the real parts of all roots, clipped to [-1, 1]."""
    gain, integral, kernel = _shapes(loop)
    rho = parts.pole[:, None]
    gain_slope: FloatArray = np.asarray(chebyshev.chebder(gain), dtype=np.float64)
    integral_slope: FloatArray = np.asarray(chebyshev.chebder(integral), dtype=np.float64)
    smooth = (parts.direct + contact_damping_ns_per_m)[:, None] * gain_slope + parts.integral[:, None] * integral_slope
    # M(c) = kernel of w^n less rho times that of w^(n-1).
    decaying = parts.decaying[:, None] * (kernel[None, :] - rho * np.pad(gain, (0, 1))[None, :])
    degree = loop.whole_delay("the polynomial of stationary points") + 2
    polynomial = _fit(_times_distance(_times_distance(smooth, rho), rho), degree)
    slope: FloatArray = np.asarray(chebyshev.chebder(decaying, axis=1), dtype=np.float64)
    polynomial = polynomial + _fit(_times_distance(slope, rho) + 2 * rho * decaying, degree)
    return np.clip(real_parts_of_roots(polynomial), -1.0, 1.0)


def _shapes(loop: SampledLoop) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return Re H, Re H w/(1 - w) and Re H w as Chebyshev coefficients."""
    d = loop.whole_delay("the polynomial of stationary points")
    unit = np.eye(d + 3)
    ramp = np.array([[-0.5, *([-1.0] * (n - 1)), *([0.0] * (d + 3 - n))] for n in (d + 1, d + 2)])
    if loop.model == "paper":
        return (
            (unit[d] + unit[d + 1])[: d + 2] / 2,
            (ramp[0] + ramp[1])[: d + 2] / 2,
            (unit[d + 1] + unit[d + 2]) / 2,
        )
    return unit[d + 1][: d + 2], ramp[1][: d + 2], unit[d + 2]


def _times_distance(rows: FloatArray, rho: FloatArray) -> FloatArray:
    """Multiply by D = 1 + rho^2 - 2 rho c."""
    product = np.zeros((rows.shape[0], rows.shape[1] + 1))
    product[:, 1:] = rows / 2
    product[:, 1:2] += rows[:, :1] / 2
    product[:, : rows.shape[1] - 1] += rows[:, 1:] / 2
    product *= -2 * rho
    product[:, :-1] += (1 + rho**2) * rows
    return product


def _fit(rows: FloatArray, degree: int) -> FloatArray:
    """Pad with zeros to degree + 1 columns; a wider array has only zeros beyond."""
    short = rows[:, : degree + 1]
    return np.pad(short, ((0, 0), (0, degree + 1 - short.shape[1])))


_NUMBERS_AT_ONCE = 400_000
# Relative to the terms of the sum: rounding of gains given in double precision and of the evaluation.
RELATIVE_TOLERANCE = 1e-12
_EQUAL = 1e-15


class WorstMargin(NamedTuple):
    """The smallest Re Z_h of each row, shape (n,)."""

    margin_ns_per_m: FloatArray
    frequency_hz: FloatArray
    poles_stable: BoolArray
    dc_stiffness_n_per_m: FloatArray
    tolerance_ns_per_m: FloatArray


def lowest_of(candidates: Sequence[Sequence[FloatArray]]) -> FloatArray:
    """Return, for each of n rows, all values of that entry (values, n) whose first value is the lowest."""
    each = np.array(candidates)
    return np.asarray(np.take_along_axis(each, each[:, :1].argmin(axis=0)[None], axis=0)[0])


def worst_margin(
    loop: SampledLoop,
    damping_ns_per_m: Values,
    stiffness_n_per_m: Values,
    contact_damping_ns_per_m: Values = 0.0,
    low_hz: Values = 0.0,
    high_hz: Values = np.inf,
    *,
    refine: bool = True,
    progress: Progress = SILENT,
) -> WorstMargin:
    """Return the smallest Re Z_h of frozen gains over low_hz <= f <= high_hz, exactly.

    Re Z_h is rational in cos(omega T): every stationary point and both ends are evaluated, and the lowest are refined
    on Re Z_h itself. Beyond 62 samples of delay, where roots cost too much, a scan takes the place of these points.
    """
    values = (
        damping_ns_per_m,
        stiffness_n_per_m,
        contact_damping_ns_per_m,
        low_hz,
        high_hz,
        loop.device_damping_ns_per_m,
        loop.environment_damping_ns_per_m,
        loop.environment_stiffness_n_per_m,
    )
    columns = [np.ravel(column) for column in np.broadcast_arrays(*(np.asarray(v, dtype=np.float64) for v in values))]
    rows = len(columns[0])
    if np.array_equal(columns[3], columns[4]):
        return _worst(loop, columns, None, refine=False)
    degree = loop.whole_delay("the worst passivity margin over a band of frequencies") + 2
    at_once = max(1, _NUMBERS_AT_ONCE // (len(seeds_hz(degree, 1.0)) + degree + 28))
    pieces = [
        _worst(loop, [column[some] for column in columns], degree, refine=refine)
        for some in chunks(rows, at_once, progress, "passivity")
    ]
    return WorstMargin._make(np.concatenate(column) for column in zip(*pieces, strict=True))


def _worst(loop: SampledLoop, columns: list[FloatArray], degree: int | None, *, refine: bool) -> WorstMargin:
    """Return the margins of some rows; `degree` of Re Z_h in cos(omega T), None for bands of a single frequency."""
    b, k, contact, low, high = columns[:5]
    b_d, b_e, k_e = columns[5:]

    def of(rows: Any) -> SampledLoop:
        return SampledLoop(b_d[rows], b_e[rows], k_e[rows], loop.sample_time_s, loop.delay_samples, loop.model)

    nyquist = loop.nyquist_hz
    low, high = np.minimum(low, nyquist), np.minimum(high, nyquist)
    parts, column_loop = fractions(of(slice(None)), b, k), of((slice(None), None))

    spread = parts.pick((slice(None), None))

    def value(frequency_hz: FloatArray) -> FloatArray:
        return real_part(column_loop, spread, contact[:, None], frequency_hz)

    candidates = low[:, None]
    if degree is not None:
        # They resolve the hold's oscillation and the slowest pole.
        even, corner = seeds_hz(degree, nyquist), np.clip(np.abs(parts.pole_gap), 1e-16, 1.0)[:, None]
        decades = corner ** np.linspace(1.2, 0, 25)[None, :] / np.pi * nyquist
        each = [np.broadcast_to(even, (len(low), len(even))), decades, low[:, None], high[:, None]]
        candidates = np.concatenate(each, axis=1)
    if degree is not None and has_roots(degree):
        roots_hz = np.arccos(stationary_cosines(loop, parts, contact)) / np.pi * nyquist
        candidates = np.concatenate([candidates, roots_hz], axis=1)
    candidates = np.sort(np.clip(candidates, low[:, None], high[:, None]), axis=1)
    frequency = refine_minima(value, candidates, degree) if refine and degree is not None else candidates
    values = value(frequency)
    worst = np.take_along_axis(frequency, np.argmin(values, axis=1)[:, None], axis=1)
    size = size_of_terms(column_loop, spread, contact[:, None], worst)
    # Among equal values the first: an end or a stationary point, rather than a refinement within rounding.
    first = np.argmax(values <= values.min(axis=1, keepdims=True) + _EQUAL * size, axis=1)[:, None]
    at = np.take_along_axis(frequency, first, axis=1)
    tolerance = RELATIVE_TOLERANCE * size[:, 0]
    margin = value(at)[:, 0]
    return WorstMargin(margin, at[:, 0], parts.stable, parts.integral / loop.sample_time_s, tolerance)
