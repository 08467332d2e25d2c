"""The worst margin of Re Z_h over a band of frequencies, and what else passivity asks for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.passivity._roots import has_roots, refine_minima, seeds_hz
from avc_casadi.passivity._sampled import (
    Fractions,
    SampledLoop,
    Values,
    fractions,
    real_part,
    size_of_terms,
)
from avc_casadi.passivity._stationary import stationary_cosines
from avc_casadi.support import SILENT, BoolArray, FloatArray, Progress, chunks

if TYPE_CHECKING:
    from avc_casadi.problem import Model

_NUMBERS_AT_ONCE = 400_000
# Relative to the terms of the sum: rounding of gains given in double precision and of the evaluation.
RELATIVE_TOLERANCE = 1e-12
_EQUAL = 1e-15


@dataclass(frozen=True)
class WorstMargin:
    """The smallest Re Z_h of each row, shape (n,).

    Attributes:
        margin_ns_per_m: its value, N.s/m.
        frequency_hz: where it stands; 0 means the limit of zero frequency.
        poles_stable: whether all poles of the rendered impedance but a simple one at z = 1 lie inside the circle.
        dc_stiffness_n_per_m: k k_e/(k + k_e), the residue at z = 1 over T; passivity needs it not negative.
        tolerance_ns_per_m: what rounding can make of a margin of 0.
    """

    margin_ns_per_m: FloatArray
    frequency_hz: FloatArray
    poles_stable: BoolArray
    dc_stiffness_n_per_m: FloatArray
    tolerance_ns_per_m: FloatArray

    @property
    def passive(self) -> BoolArray:
        """Whether each row is passive at these frequencies to the stated tolerance."""
        residue = self.dc_stiffness_n_per_m >= 0
        return (self.margin_ns_per_m >= -self.tolerance_ns_per_m) & self.poles_stable & residue


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
    """Find the smallest Re Z_h of frozen gains over low_hz <= f <= high_hz, exactly.

    Re Z_h is rational in c = cos(omega T). Every stationary point and both ends are evaluated, together with points
    that resolve the slowest pole of the coupling, and the lowest ones are refined on Re Z_h itself: the margin is
    right to about 1e-12 of the terms that it is the sum of. Beyond 62 samples of delay, where roots cost too much, a
    scan with 24 points to each half-wave of the delay takes the place of the stationary points.

    Args:
        loop: device, environment, hold.
        damping_ns_per_m: b, N.s/m; infinite for a rigid coupling. All arguments broadcast to n rows.
        stiffness_n_per_m: k, N/m.
        contact_damping_ns_per_m: b_p, N.s/m.
        low_hz: lower end of the band; 0 includes the limit of zero frequency.
        high_hz: upper end; clipped at the Nyquist frequency.
        refine: False leaves out the refinement, which takes most of the time; for searches that end with an exact
            check.
        progress: told of the rows.

    Returns:
        One result per row, shape (n,).
    """
    given = (
        damping_ns_per_m,
        stiffness_n_per_m,
        contact_damping_ns_per_m,
        low_hz,
        high_hz,
        loop.device_damping_ns_per_m,
        loop.environment_damping_ns_per_m,
        loop.environment_stiffness_n_per_m,
    )
    columns = [np.ravel(column) for column in np.broadcast_arrays(*(np.asarray(v, dtype=np.float64) for v in given))]
    rows = len(columns[0])
    if np.array_equal(columns[3], columns[4]):
        return _worst(loop, columns, None, refine=False)
    degree = loop.whole_delay("the worst passivity margin over a band of frequencies") + 2
    at_once = max(1, _NUMBERS_AT_ONCE // (len(seeds_hz(degree, 1.0)) + degree + 28))
    pieces = [
        _worst(loop, [column[some] for column in columns], degree, refine=refine)
        for some in chunks(rows, at_once, progress, "passivity")
    ]
    return WorstMargin(
        np.concatenate([piece.margin_ns_per_m for piece in pieces]),
        np.concatenate([piece.frequency_hz for piece in pieces]),
        np.concatenate([piece.poles_stable for piece in pieces]),
        np.concatenate([piece.dc_stiffness_n_per_m for piece in pieces]),
        np.concatenate([piece.tolerance_ns_per_m for piece in pieces]),
    )


def _worst(loop: SampledLoop, columns: list[FloatArray], degree: int | None, *, refine: bool) -> WorstMargin:
    """Judge some rows; `degree` is that of Re Z_h in cos(omega T), None where each band is a single frequency."""
    b, k, contact, low, high, b_d, b_e, k_e = columns
    loop = SampledLoop(b_d, b_e, k_e, loop.sample_time_s, loop.delay_samples, loop.model)
    nyquist = loop.nyquist_hz
    low, high = np.minimum(low, nyquist), np.minimum(high, nyquist)
    parts = fractions(loop, b, k)

    columned = SampledLoop(b_d[:, None], b_e[:, None], k_e[:, None], *_rest(loop))
    spread = parts.pick((slice(None), None))

    def value(frequency_hz: FloatArray) -> FloatArray:
        return real_part(columned, spread, contact[:, None], frequency_hz)

    candidates = low[:, None]
    if degree is not None:
        candidates = np.concatenate([_resolving_points(loop, parts, degree), low[:, None], high[:, None]], axis=1)
    if degree is not None and has_roots(degree):
        roots_hz = np.arccos(stationary_cosines(loop, parts, contact)) / np.pi * nyquist
        candidates = np.concatenate([candidates, roots_hz], axis=1)
    candidates = np.sort(np.clip(candidates, low[:, None], high[:, None]), axis=1)
    frequency = refine_minima(value, candidates, degree) if refine and degree is not None else candidates
    values = value(frequency)
    lowest = np.take_along_axis(frequency, np.argmin(values, axis=1)[:, None], axis=1)
    size = size_of_terms(columned, spread, contact[:, None], lowest)
    # Among equal values the first: an end or a stationary point, rather than what rounding made of it.
    first = np.argmax(values <= values.min(axis=1, keepdims=True) + _EQUAL * size, axis=1)[:, None]
    at = np.take_along_axis(frequency, first, axis=1)
    tolerance = RELATIVE_TOLERANCE * size[:, 0]
    margin = value(at)[:, 0]
    return WorstMargin(margin, at[:, 0], parts.stable, parts.integral / loop.sample_time_s, tolerance)


def _rest(loop: SampledLoop) -> tuple[float, float, Model]:
    return loop.sample_time_s, loop.delay_samples, loop.model


def _resolving_points(loop: SampledLoop, parts: Fractions, degree: int) -> FloatArray:
    """Frequencies, shape (n, m), that resolve the hold's oscillation and the slowest pole: seeds for refinement."""
    even = seeds_hz(degree, loop.nyquist_hz)
    corner = np.clip(np.abs(parts.pole_gap), 1e-16, 1.0)[:, None]
    decades = corner ** np.linspace(1.2, 0, 25)[None, :]
    return np.concatenate([np.broadcast_to(even, (len(corner), len(even))), decades / np.pi * loop.nyquist_hz], axis=1)
