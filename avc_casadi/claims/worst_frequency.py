"""The worst margin of Re Z_h over a band of frequencies, and the other conditions of passivity."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
from avc_casadi._util.progress import SILENT, Progress, chunks
from avc_casadi.loops.spectrum import lowest
from avc_casadi.loops.wall import PartialFractions, SampledLoop, fractions
from avc_casadi.model.law import Values

# Represents the limit of zero frequency: small enough for every term, large enough to divide by.
_ZERO_TURNS = 1e-150


def real_part(
    loop: SampledLoop, parts: PartialFractions, contact_damping_ns_per_m: Values, frequency_hz: Values
) -> FloatArray:
    """Return Re Z_h at 0 <= frequency_hz <= Nyquist, N.s/m; at 0 its limit; all arguments broadcast.

        Re Z_h = b_d + h {(g + b_p) cos psi - r sin(psi + phi)/(2 sin phi)
                 + c [(1 - rho) cos psi - 2 sin phi sin(psi + phi)]/[(1 - rho)^2 + 4 rho sin^2 phi]}

    phi = omega T/2, hold and delay are h exp(-j psi), b_d the device and b_p the contact damper; g, r, c and the pole
    rho are the partial fractions of coupling and wall, g + r w/(1 - w) + c w/(1 - rho w), w = 1/z.
    """
    amplitude, terms = _terms(loop, parts, contact_damping_ns_per_m, frequency_hz)
    return np.asarray(loop.device_damping_ns_per_m + amplitude * sum(terms))


def size_of_terms(
    loop: SampledLoop, parts: PartialFractions, contact_damping_ns_per_m: Values, frequency_hz: Values | None = None
) -> FloatArray:
    """Return the sum of the sizes of the terms of Re Z_h, N.s/m, of which rounding errors are a multiple.

    It is that at given frequencies, Hz, or without them a bound over all frequencies.
    """
    if frequency_hz is not None:
        amplitude, terms = _terms(loop, parts, contact_damping_ns_per_m, frequency_hz)
        return np.asarray(loop.device_damping_ns_per_m + amplitude * sum(np.abs(term) for term in terms))
    # |sin(psi + phi)/(2 sin phi)| is at most half of 2 d + 3, the number of half-turns of its numerator.
    reach = loop.delay_samples + 1.5
    decay = np.abs(parts.decaying) / np.maximum(np.abs(parts.pole_gap), np.finfo(np.float64).tiny)
    steady = np.abs(parts.direct) + np.abs(contact_damping_ns_per_m) + reach * np.abs(parts.integral)
    return np.asarray(loop.device_damping_ns_per_m + steady + decay)


def _terms(
    loop: SampledLoop, parts: PartialFractions, contact: Values, frequency_hz: Values
) -> tuple[FloatArray, tuple[FloatArray, ...]]:
    """Return h and the terms whose sum times h is Re of the held rendering, N.s/m; those of opposite sign apart.

    `parts` are g + r w/(1 - w) + c w/(1 - rho w), w = exp(-j omega T), of coupling and wall; h is 1, in the paper's
    model cos phi. With phi = omega T/2 and psi the lag of hold and delay, the terms are g cos psi, b_p cos psi (b_p the
    `contact` damping), -r sin(psi + phi)/(2 sin phi), and two of c w/(1 - rho w).
    """
    turns = np.maximum(np.asarray(frequency_hz, dtype=np.float64) * loop.sample_time_s, _ZERO_TURNS)
    sine = np.sin(np.pi * turns)
    cosine = np.sin(np.pi * (0.5 - turns))
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
# Local minima of a row that are refined, where roots resolve them.
_MINIMA = 6
# Largest degree of which roots are computed: eigenvalues cost the cube of the degree.
_MOST_ROOTS = 64
# Frequencies of a scan for each half-wave, where roots stand beside it and where it stands alone.
_SEEDS_WITH_ROOTS = 4
_SEEDS_ALONE = 24


def real_parts_of_roots(rows: FloatArray) -> FloatArray:
    """Return the real parts of the roots of rows of Chebyshev coefficients, (n, degree), by eigenvalues."""
    roots = np.ones((rows.shape[0], rows.shape[1] - 1))
    significant = np.abs(rows) > _EPS * np.max(np.abs(rows), axis=1, keepdims=True)
    degrees = np.where(significant.any(axis=1), significant.shape[1] - 1 - np.argmax(significant[:, ::-1], axis=1), 0)
    for degree in np.unique(degrees[degrees > 0]):
        of_degree = np.flatnonzero(degrees == degree)
        matrices = _colleague(rows[of_degree, : degree + 1])
        roots[of_degree, :degree] = np.linalg.eigvals(matrices).real
    return roots


def _colleague(rows: FloatArray) -> FloatArray:
    """Return the symmetrised colleague matrices of rows of Chebyshev coefficients: eigenvalues are the roots.

    Shape (n, degree, degree).
    """
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
    seeds = _SEEDS_WITH_ROOTS if has_roots(oscillations) else _SEEDS_ALONE
    return np.linspace(0.0, nyquist_hz, seeds * oscillations + 1)


def has_roots(degree: int) -> bool:
    """Return whether stationary points of this degree are computed as roots; beyond, a fine scan replaces them."""
    return degree <= _MOST_ROOTS


def refine_minima(value: Callable[[FloatArray], FloatArray], points: FloatArray, oscillations: int) -> FloatArray:
    """Refine the lowest local minima of sorted points, or all those of a scan, by golden section.

    Args:
        value: function of points (n, m), whose values have that shape.
        points: sorted along each row, shape (n, m).
        oscillations: half-waves of the function; beyond 64 as many minima are refined as it may have.

    Returns:
        The points with the refined ones behind them, shape (n, m + count).
    """
    values = value(points)
    before, after, first = _neighbours(points)
    below_before = values <= np.take_along_axis(values, before, axis=1)
    below_after = values <= np.take_along_axis(values, after, axis=1)
    local = np.where(first & below_before & below_after, values, np.inf)
    count = min(_MINIMA if has_roots(oscillations) else oscillations // 2 + _MINIMA, points.shape[1])
    chosen = np.argsort(local, axis=1)[:, :count]
    left, right = (np.take_along_axis(points, np.take_along_axis(side, chosen, 1), 1) for side in (before, after))
    centre = np.take_along_axis(points, chosen, axis=1)
    return np.concatenate([points, lowest(value, left, centre, right)], axis=1)


def _neighbours(points: FloatArray) -> tuple[IndexArray, IndexArray, BoolArray]:
    """Return the positions of the next lower and higher point, and whether each point is the first of its equals."""
    size = points.shape[1]
    position = np.broadcast_to(np.arange(size), points.shape)
    first = np.diff(points, axis=1, prepend=-np.inf) > 0
    last = np.diff(points, axis=1, append=np.inf) > 0
    begin = np.maximum.accumulate(np.where(first, position, 0), axis=1)
    end = np.minimum.accumulate(np.where(last, position, size - 1)[:, ::-1], axis=1)[:, ::-1]
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


def stationary_cosines(loop: SampledLoop, parts: PartialFractions, contact_damping_ns_per_m: FloatArray) -> FloatArray:
    """Return c = cos(omega T) where Re Z_h may be stationary, shape (n, roots): real parts of the roots, in [-1, 1].

    d Re Z_h/dc times D^2 is a polynomial in c, D = 1 + rho^2 - 2 rho c the square of the distance to the pole rho.
    """
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
    """Return Re H, Re H w/(1 - w) and Re H w as Chebyshev coefficients in cos(omega T), H hold and delay, w = 1/z."""
    d = loop.whole_delay("the polynomial of stationary points")
    unit = np.eye(d + 3)
    # Re w^n/(1 - w) = -(1/2 + c_1 + ... + c_(n-1)), c_i the Chebyshev polynomials, for n = d + 1 and d + 2.
    ramp = np.array([[-0.5, *([-1.0] * (n - 1)), *([0.0] * (d + 3 - n))] for n in (d + 1, d + 2)])
    if loop.model == "paper":
        return (
            (unit[d] + unit[d + 1])[: d + 2] / 2,
            (ramp[0] + ramp[1])[: d + 2] / 2,
            (unit[d + 1] + unit[d + 2]) / 2,
        )
    return unit[d + 1][: d + 2], ramp[1][: d + 2], unit[d + 2]


def _times_distance(rows: FloatArray, rho: FloatArray) -> FloatArray:
    """Return rows of Chebyshev coefficients in c multiplied by D = 1 + rho^2 - 2 rho c, rho of each row."""
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
# Frequencies of a row beside the seeds and the roots: those of the slowest pole, both ends and some to spare.
_MORE_CANDIDATES = 28
# Decades towards the slowest pole: its angle to these powers, from beyond it to Nyquist.
_POLE_POWER = 1.2
_POLE_POINTS = 25
_SLOWEST_GAP = 1e-16
# Relative to the terms of the sum: rounding of gains given in double precision and of the evaluation.
RELATIVE_TOLERANCE = 1e-12
# Values that differ by less than this share of the terms are equal.
_EQUAL = 1e-15


class WorstMargin(NamedTuple):
    """The smallest Re Z_h of each row, shape (n,).

    Attributes:
        margin_ns_per_m: the smallest Re Z_h.
        frequency_hz: its frequency.
        poles_stable: whether every pole of the rendering lies inside the unit circle.
        dc_stiffness_n_per_m: DC stiffness of the rendering.
        tolerance_ns_per_m: rounding of the margin.
    """

    margin_ns_per_m: FloatArray
    frequency_hz: FloatArray
    poles_stable: BoolArray
    dc_stiffness_n_per_m: FloatArray
    tolerance_ns_per_m: FloatArray


def lowest_of(candidates: Sequence[Sequence[FloatArray]]) -> FloatArray:
    """Return, for each of n rows, all values of that entry (values, n) whose first value is the lowest."""
    entries = np.array(candidates)
    return np.asarray(np.take_along_axis(entries, entries[:, :1].argmin(axis=0)[None], axis=0)[0])


def worst_margin(
    loop: SampledLoop,
    damping_ns_per_m: Values,
    stiffness_n_per_m: Values,
    contact_damping_ns_per_m: Values = 0.0,
    band_hz: tuple[Values, Values] = (0.0, np.inf),
    *,
    refine: bool = True,
    progress: Progress = SILENT,
) -> WorstMargin:
    """Return the smallest Re Z_h of frozen gains over a band of frequencies, ends included, exactly.

    Re Z_h is rational in cos(omega T): every stationary point and both ends are evaluated, and the lowest are refined
    on Re Z_h itself. Beyond 62 samples of delay, where roots cost too much, a scan takes the place of these points.
    """
    columns = np.broadcast_arrays(
        *(
            np.asarray(value, dtype=np.float64)
            for value in (
                damping_ns_per_m,
                stiffness_n_per_m,
                contact_damping_ns_per_m,
                *band_hz,
                loop.device_damping_ns_per_m,
                loop.environment_damping_ns_per_m,
                loop.environment_stiffness_n_per_m,
            )
        )
    )
    b, k, contact, low, high, b_d, b_e, k_e = (np.ravel(column) for column in columns)
    rows = _Rows(b=b, k=k, contact=contact, low_hz=low, high_hz=high, b_d=b_d, b_e=b_e, k_e=k_e)
    if np.array_equal(low, high):
        return _worst(loop, rows, None, refine=False)
    degree = loop.whole_delay("the worst passivity margin over a band of frequencies") + 2
    numbers_of_a_row = len(seeds_hz(degree, 1.0)) + degree + _MORE_CANDIDATES
    at_once = max(1, _NUMBERS_AT_ONCE // numbers_of_a_row)
    pieces = [
        _worst(loop, rows.part(part), degree, refine=refine) for part in chunks(len(b), at_once, progress, "passivity")
    ]
    return WorstMargin._make(np.concatenate(column) for column in zip(*pieces, strict=True))


@dataclass(frozen=True)
class _Rows:
    """Gains, bands, device and wall of n rows, each of shape (n,), in the symbols of the equations."""

    b: FloatArray
    k: FloatArray
    contact: FloatArray
    low_hz: FloatArray
    high_hz: FloatArray
    b_d: FloatArray
    b_e: FloatArray
    k_e: FloatArray

    def part(self, rows: slice) -> _Rows:
        """Return some of the rows."""
        return replace(self, **{item.name: getattr(self, item.name)[rows] for item in fields(self)})

    def loop(self, loop: SampledLoop, index: Any = slice(None)) -> SampledLoop:
        """Return a loop with device and wall of the rows, each indexed alike: a new axis, for instance."""
        return replace(
            loop,
            device_damping_ns_per_m=self.b_d[index],
            environment_damping_ns_per_m=self.b_e[index],
            environment_stiffness_n_per_m=self.k_e[index],
        )


def _worst(loop: SampledLoop, rows: _Rows, degree: int | None, *, refine: bool) -> WorstMargin:
    """Return the margins of some rows; `degree` of Re Z_h in cos(omega T), None for bands of a single frequency."""
    parts = fractions(rows.loop(loop), rows.b, rows.k)
    column_loop = rows.loop(loop, (slice(None), None))
    column_parts = parts.pick((slice(None), None))
    column_contact = rows.contact[:, None]

    def value(frequency_hz: FloatArray) -> FloatArray:
        return real_part(column_loop, column_parts, column_contact, frequency_hz)

    candidates = _candidates_hz(loop, rows, parts, degree)
    frequency = refine_minima(value, candidates, degree) if refine and degree is not None else candidates
    values = value(frequency)
    worst = np.take_along_axis(frequency, np.argmin(values, axis=1)[:, None], axis=1)
    size = size_of_terms(column_loop, column_parts, column_contact, worst)
    # Among equal values the first: an end or a stationary point, rather than a refinement within rounding.
    first = np.argmax(values <= values.min(axis=1, keepdims=True) + _EQUAL * size, axis=1)[:, None]
    worst_hz = np.take_along_axis(frequency, first, axis=1)
    return WorstMargin(
        margin_ns_per_m=value(worst_hz)[:, 0],
        frequency_hz=worst_hz[:, 0],
        poles_stable=parts.stable,
        dc_stiffness_n_per_m=parts.integral / loop.sample_time_s,
        tolerance_ns_per_m=RELATIVE_TOLERANCE * size[:, 0],
    )


def _candidates_hz(loop: SampledLoop, rows: _Rows, parts: PartialFractions, degree: int | None) -> FloatArray:
    """Return frequencies in the band of each row, sorted, shape (n, m): ends, stationary points and a scan."""
    nyquist = loop.nyquist_hz
    low = np.minimum(rows.low_hz, nyquist)[:, None]
    high = np.minimum(rows.high_hz, nyquist)[:, None]
    candidates = low
    if degree is not None:
        # They resolve the hold's oscillation and the slowest pole.
        even = seeds_hz(degree, nyquist)
        corner = np.clip(np.abs(parts.pole_gap), _SLOWEST_GAP, 1.0)[:, None]
        decades = corner ** np.linspace(_POLE_POWER, 0, _POLE_POINTS)[None, :] / np.pi * nyquist
        scan = np.broadcast_to(even, (len(low), len(even)))
        candidates = np.concatenate([scan, decades, low, high], axis=1)
    if degree is not None and has_roots(degree):
        roots_hz = np.arccos(stationary_cosines(loop, parts, rows.contact)) / np.pi * nyquist
        candidates = np.concatenate([candidates, roots_hz], axis=1)
    return np.asarray(np.sort(np.clip(candidates, low, high), axis=1))
