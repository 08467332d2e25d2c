"""The goal of the search as a sum of largest values, with their slopes by the numbers of the law.

Spectral radii and peaks over frequency have corners where another loop or frequency takes over; each eigenvalue and
each frequency by itself is smooth. What is near the largest is told beside it, so that a step knows of the corner.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray, IndexArray
from avc_casadi.claims.stability.state_feedback import Laws, state_feedback_loops, stiffness_at_rest
from avc_casadi.design.robust.goal import (
    BESIDE_DECAY_PER_S,
    DECAY_PER_S,
    FREE_DECAY_PER_S,
    HOPELESS_SOFTNESS,
    PER_DECAY,
    PER_GAIN,
    PER_SENSITIVITY,
    PER_SOFTNESS,
    RANGED_DECAY_PER_S,
    SLOW_DECAY_PER_S,
    USUAL_SENSITIVITY,
    VARIED_DECAY_PER_S,
    is_quick,
    responses,
)

if TYPE_CHECKING:
    from avc_casadi.claims.stability.frozen_loop import Rendering
    from avc_casadi.design.robust.law import Space
    from avc_casadi.design.robust.loops import Loops, Plants

# Of the logarithms, for slopes of the law; the slope of an eigenvalue is exact.
_STEP = 1e-5
# Of each sum so many eigenvalues, or values at frequencies, are told.
_EIGENVALUES, _FREQUENCIES = 6, 12
# What keeps a search out of where a law is none: for each 1/s by which a loop decays more slowly than so, and for
# softness beyond so much of what is hopeless.
_LEAST_DECAY_PER_S, _PER_GROWTH = 0.5, 10.0
_SOFT, _PER_SOFT = 0.5 * HOPELESS_SOFTNESS, 500.0


@dataclass(frozen=True)
class Piece:
    """One summand of the goal: its weight times the largest of some values, or 0 if that is more.

    Attributes:
        weight: of it.
        values: near the largest, shape (m,).
        slopes: by the logarithms of the knobs, shape (m, knobs).
    """

    weight: float
    values: FloatArray
    slopes: FloatArray

    @property
    def cost(self) -> float:
        """What it adds to the goal."""
        return self.weight * max(0.0, float(self.values.max()))


def pieces_of(space: Space, loops: Loops, rendering: Rendering, point: FloatArray) -> list[Piece] | None:
    """Return the summands of the goal at a point, and what keeps a search where laws are; None where there is no law.

    Args:
        space: what is searched.
        loops: what the law must hold.
        rendering: coupling and wall behind it.
        point: logarithms of the knobs.
    """
    points = np.concatenate([point[None], point + _STEP * np.eye(len(point))])
    laws = space.laws(points, stiffness_at_rest(rendering))
    if not all(np.isfinite(part).all() for part in (laws.innovation, laws.feedback)):
        return None
    return [*_felt(laws, rendering, loops), *_damped(laws, rendering, loops)]


def _felt(laws: Laws, rendering: Rendering, loops: Loops) -> list[Piece]:
    found = responses(laws, rendering, loops)
    softness = [found.softness_3hz - found.bound_3hz, found.softness_10hz - found.bound_10hz]
    return [
        _piece(PER_SENSITIVITY, found.sensitivity),
        _piece(PER_SENSITIVITY, found.sensitivity_any_share - USUAL_SENSITIVITY),
        _piece(PER_GAIN, found.gain),
        *(_piece(PER_SOFTNESS, over) for over in softness),
        *(_piece(_PER_SOFT, over - _SOFT) for over in softness),
    ]


def _piece(weight: float, values: FloatArray) -> Piece:
    """Take the largest of what stands at a point, first, and at the points a step away."""
    each = values.reshape(len(values), -1)
    largest = np.argsort(-each[0], kind="stable")[:_FREQUENCIES]
    here = each[0, largest]
    return Piece(weight, here, ((each[1:, largest] - here) / _STEP).T)


def _damped(laws: Laws, rendering: Rendering, loops: Loops) -> list[Piece]:
    t = loops.sample_time_s
    varied = _Poles.of(loops.varied, laws, rendering, t, tuple(VARIED_DECAY_PER_S))
    free = _Poles.of(loops.free, laws, rendering, t)
    nominal = _Poles.of(loops.nominal, laws, rendering, t, tuple(DECAY_PER_S))
    quick = is_quick(nominal.values, t)
    held = [varied.slowest([(row, None) for row in range(len(VARIED_DECAY_PER_S))])]
    held += [free.slowest([(0, None)])]
    held += [nominal.slowest([(row, part[row]) for row in range(len(DECAY_PER_S)) for part in (quick, ~quick)])]
    decay_ranged: list[float] = []
    if loops.ranged is not None:
        ranged = _Poles.of(loops.ranged, laws, rendering, t, tuple(RANGED_DECAY_PER_S))
        held += [ranged.slowest([(row, None) for row in range(len(RANGED_DECAY_PER_S))])]
        decay_ranged = list(RANGED_DECAY_PER_S.values())
    beside = [_Poles.of(part, laws, rendering, t).slowest([(0, None)])[0] for part in loops.beside]
    asked = [
        *VARIED_DECAY_PER_S.values(),
        FREE_DECAY_PER_S,
        *(decay for passed, most in DECAY_PER_S.items() for decay in (most, SLOW_DECAY_PER_S * passed)),
        *decay_ranged,
    ]
    growing = [one for part in held for one in part]
    pieces = [
        Piece(PER_DECAY, values + decay, slopes)
        for (values, slopes), decay in zip(growing, asked, strict=True)
        if len(values)
    ]
    for some, weight, decay in ((beside, PER_DECAY, BESIDE_DECAY_PER_S), (growing, _PER_GROWTH, _LEAST_DECAY_PER_S)):
        values, slopes = (np.concatenate(part) for part in zip(*some, strict=True))
        pieces.append(Piece(weight, values + decay, slopes))
    return pieces


@dataclass(frozen=True)
class _Poles:
    """Eigenvalues of loops, shape (shares, plants, s), with their vectors, and the loops' slopes by each knob.

    Attributes:
        values: the eigenvalues.
        vectors: in columns.
        slopes: shape (knobs, shares, plants, s, s).
        sample_time_s: T.
    """

    values: ComplexArray
    vectors: ComplexArray
    slopes: FloatArray
    sample_time_s: float

    @classmethod
    def of(
        cls, plants: Plants, laws: Laws, rendering: Rendering, t: float, shares: tuple[float, ...] = (1.0,)
    ) -> _Poles:
        """Close the loops with the law of the point and with those a step away."""
        loop = state_feedback_loops(plants, laws, rendering, shares)
        values, vectors = np.linalg.eig(loop[0])
        return cls(values, vectors, (loop[1:] - loop[0]) / _STEP, t)

    def slowest(self, parts: list[tuple[int, BoolArray | None]]) -> list[tuple[FloatArray, FloatArray]]:
        """Return how fast those grow that decay most slowly, 1/s, and their slopes, of each part.

        Args:
            parts: the share of the innovation, by its place, and which of its eigenvalues count.
        """
        growth = np.log(np.maximum(np.abs(self.values), 1e-9)) / self.sample_time_s
        # Of a pair one will do.
        growth[self.values.imag < 0] = -np.inf
        places = []
        for share, counts in parts:
            those = growth[share] if counts is None else np.where(counts, growth[share], -np.inf)
            slow = np.argsort(-those, axis=None, kind="stable")[:_EIGENVALUES]
            slow = slow[np.isfinite(those.ravel()[slow])]
            places.append(np.stack([np.full(len(slow), share), *np.unravel_index(slow, those.shape)]))
        every = np.concatenate(places, axis=1)
        ends = np.cumsum([place.shape[1] for place in places])[:-1]
        values, slopes = growth[tuple(every)], self._slopes(every)
        return list(zip(np.split(values, ends), np.split(slopes, ends), strict=True))

    def _slopes(self, places: IndexArray) -> FloatArray:
        """Return the slopes of log(abs(value))/T: y' dM v / (y' v), y and v the left and the right vectors."""
        share, plant, place = places
        right = self.vectors[share, plant]
        with np.errstate(all="ignore"):
            left = np.linalg.inv(right)[np.arange(len(place)), place]
        vector = right[np.arange(len(place)), :, place]
        moved = np.moveaxis(self.slopes[:, share, plant], 0, 1)
        change = ((left[:, None, None, :] @ moved)[:, :, 0] @ vector[..., None])[..., 0]
        with np.errstate(all="ignore"):  # an eigenvalue of 0 has no logarithm, and hides nothing that is slow
            slope = (change / self.values[share, plant, place][:, None]).real / self.sample_time_s
        return np.asarray(np.nan_to_num(slope, posinf=0.0, neginf=0.0))
