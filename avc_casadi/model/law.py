"""The law that a loop closes around a plant: one discrete state space at the sample time of the device.

    s+ = A s + B y,   u = C s + D y

y holds what is measured, the position in m first, u is the commanded force in N, positive against +x. Small blocks
(gain, difference, low pass) compile to these matrices in parallel (`+`), in series (`then`) or behind an observer
(`behind`); whoever closes a loop sees the matrices alone. Leading axes hold many laws, as the rows of a gain table.

What of a law is not linear stands beside it as a `Sector`. It belongs to the model, below the equations of the paper,
because these, loops, claims, simulation and export all need it, and it needs numbers alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi._util.resolvent import response
from avc_casadi.model.runtime import StateFeedback

Matrix = NDArray[Any]
"""Matrices along the last two axes."""
Values = float | FloatArray
"""One number, or one for each law."""


@dataclass(frozen=True)
class Sector:
    """A part of a law that is not linear, as its range of slopes: w = slope q.

    The law reads w as a further input and gives q as a further output, in the order of its sectors. Its matrices are
    those at the nominal slope: the further input is what w differs by, w - nominal q.
    """

    name: Literal["dead_zone", "force_limit", "spring_dead_zone", "friction_compensation", "integral_limit"]
    least: float = 0.0
    most: float = 1.0
    nominal: float = 1.0


_MOST_DOUBLINGS = 64
"""Rounds of a sum that doubles its terms: poles of 1 - 1e-9 take 36."""

_NO_MORE = 1e-30
"""Share of a sum below which further terms, which a slow pole may make a billion times as large, are rounding."""

DEAD_ZONE = Sector("dead_zone")
"""Share of an observer's innovation that passes its dead zone."""
FORCE_LIMIT = Sector("force_limit")
"""Share of the commanded force that its limit leaves; an observer knows what is left."""
SPRING_DEAD_ZONE = Sector("spring_dead_zone")
"""Share of the position that a spring with a dead zone acts on."""
FRICTION_COMPENSATION = Sector("friction_compensation")
"""Share of the velocity that passes the saturation of a friction compensation."""
INTEGRAL_LIMIT = Sector("integral_limit")
"""Share of an integral that its limit leaves."""


@dataclass(frozen=True, eq=False)
class Law:
    """A law, or many with the same states: A (..., n, n), B (..., n, inputs), C (..., outputs, n), D (..., o, i).

    Attributes:
        a, b, c, d: the matrices at the nominal slopes of the sectors.
        sample_time_s: of the device.
        sectors: what is not linear, each with an input and an output after those of the linear law.
    """

    a: Matrix
    b: Matrix
    c: Matrix
    d: Matrix
    sample_time_s: float
    sectors: tuple[Sector, ...] = ()

    @classmethod
    def gain(cls, value: Values | ComplexArray, sample_time_s: float) -> Law:
        """Return u = value y."""
        d = np.asarray(value)[..., None, None]
        leading = d.shape[:-2]
        nothing = np.zeros((*leading, 0, 1))
        return cls(np.zeros((*leading, 0, 0)), nothing, nothing.swapaxes(-1, -2), d, sample_time_s)

    @classmethod
    def difference(cls, sample_time_s: float) -> Law:
        """Return u = (1 - 1/z) y: by how much y grew in the last sample."""
        unit = np.ones((1, 1))
        return cls(np.zeros((1, 1)), unit, -unit, unit, sample_time_s)

    @classmethod
    def low_pass(cls, pole: Values, sample_time_s: float) -> Law:
        """Return u = (1 - p)/(1 - p/z) y."""
        p = np.asarray(pole, dtype=np.float64)[..., None, None]
        return cls(p, 1 - p, p, 1 - p, sample_time_s)

    @classmethod
    def fraction(cls, numerator: Sequence[float], denominator: Sequence[float], sample_time_s: float) -> Law:
        """Return u = N(z)/D(z) y of polynomials in z, the highest power first, N of no higher degree than D.

        With D monic of degree n: u = d y + c s and s+ = A s + e y, the last n outputs of 1/D as states s, e the first
        unit vector, A the companion matrix of D, d the coefficient of z^n in N, and c the others less d times those
        of D.
        """
        below = np.array(denominator, dtype=np.float64)
        above = np.zeros(len(below))
        above[len(below) - len(numerator) :] = numerator
        above, below = above / below[0], below / below[0]
        states = len(below) - 1
        a = np.eye(states, k=-1)
        a[:1] = -below[1:]
        c = above[1:] - above[0] * below[1:]
        return cls(a, np.eye(states, 1), c[None], above[:1, None], sample_time_s)

    @classmethod
    def integral(cls, sample_time_s: float) -> Law:
        """Return u = y/(1 - 1/z): the sum of y, its newest value counted."""
        unit = np.ones((1, 1))
        return cls(unit, unit, unit, unit, sample_time_s)

    @classmethod
    def of_sector(cls, sector: Sector, sample_time_s: float) -> Law:
        """Return u = w, w = slope y: the part alone, to stand between linear parts."""
        nothing = np.zeros((0, 2))
        d = np.array([[sector.nominal, 1.0], [1.0, 0.0]])
        return cls(np.zeros((0, 0)), nothing, nothing.T, d, sample_time_s, (sector,))

    @classmethod
    def limited_integral(cls, sample_time_s: float) -> Law:
        """Return u = s+ = slope (s + y): the sum of y as `integral`, of which its limit leaves a share."""
        read = np.array([[1.0], [1.0]])
        d = np.array([[1.0, 1.0], [1.0, 0.0]])
        return cls(np.ones((1, 1)), np.ones((1, 2)), read, d, sample_time_s, (INTEGRAL_LIMIT,))

    @classmethod
    def spring_damper(
        cls, stiffness_n_per_m: Values, damping_ns_per_m: Values, sample_time_s: float, pole: float = 0.0
    ) -> Law:
        """Return u = k y + b v, v the backward difference of y behind a low pass with a pole; 0 is none."""
        velocity = cls.difference(sample_time_s)
        if pole:
            velocity = velocity.then(cls.low_pass(pole, sample_time_s))
        # Of the growth in a sample, not of its rate: all states are lengths, which keeps digits.
        return cls.gain(stiffness_n_per_m, sample_time_s) + velocity.times(np.asarray(damping_ns_per_m) / sample_time_s)

    @property
    def states(self) -> int:
        """Number of states n."""
        return int(self.a.shape[-1])

    @property
    def measured(self) -> int:
        """Number of measured inputs."""
        return int(self.b.shape[-1]) - len(self.sectors)

    @property
    def outputs(self) -> int:
        """Number of outputs, those to the sectors apart."""
        return int(self.c.shape[-2]) - len(self.sectors)

    @property
    def shape(self) -> tuple[int, ...]:
        """The leading axes."""
        return np.broadcast_shapes(*(part.shape[:-2] for part in (self.a, self.b, self.c, self.d)))

    def pick(self, index: Any) -> Law:
        """Return some of many laws, by an index of the leading axes."""
        a, b, c, d = (
            np.broadcast_to(part, (*self.shape, *part.shape[-2:]))[index] for part in (self.a, self.b, self.c, self.d)
        )
        return Law(a, b, c, d, self.sample_time_s, self.sectors)

    def times(self, factor: Values) -> Law:
        """Return the law with its force times a factor."""
        states, measured, slopes = _signals(self.states, self.measured, len(self.sectors))
        later, force, inner = self._sample(states, measured, slopes)
        return self._compiled([later], [np.asarray(factor)[..., None, None] * force, inner], self.sectors)

    def __add__(self, addend: Law) -> Law:
        """Return the sum of two laws of the same inputs."""
        states, addend_states, measured, slopes, addend_slopes = _signals(
            self.states, addend.states, self.measured, len(self.sectors), len(addend.sectors)
        )
        later, force, inner = self._sample(states, measured, slopes)
        addend_later, addend_force, addend_inner = addend._sample(addend_states, measured, addend_slopes)
        outputs = [force + addend_force, inner, addend_inner]
        return self._compiled([later, addend_later], outputs, self.sectors + addend.sectors)

    def then(self, following: Law) -> Law:
        """Return both in series: the following law acts on the output of this one."""
        states, following_states, measured, slopes, following_slopes = _signals(
            self.states, following.states, self.measured, len(self.sectors), len(following.sectors)
        )
        later, output, inner = self._sample(states, measured, slopes)
        following_later, force, following_inner = following._sample(following_states, output, following_slopes)
        outputs = [force, inner, following_inner]
        return self._compiled([later, following_later], outputs, self.sectors + following.sectors)

    def behind(self, observer: StateFeedback | None) -> Law:
        """Return the law of the position that an observer gives, which knows the force that is left by its limit.

        With y the measured position, e the share of the innovation y - s_m that passes the dead zone, p the position
        that this law acts on and F its force, a sample is that of `StateFeedback`:

            s+ = s + L e,   p = R s+,   F by this law from p,   then s = A s+ + B F.

        The dead zone and the limit of F are sectors, of which all passes where nothing is said.
        """
        if observer is None:
            return self
        estimate, states, measured, slopes, passes_more, force_more = _signals(
            observer.states, self.states, self.measured, len(self.sectors), 1, 1
        )
        innovation = measured[:1] - estimate[[observer.measures]]
        corrected = estimate + np.outer(observer.innovation, innovation + passes_more)
        position = np.array(observer.feedback)[None] @ corrected
        later, force, inner = self._sample(states, np.concatenate([position, measured[1:]]), slopes)
        left = force + force_more
        predicted = np.array(observer.state) @ corrected + np.array(observer.force_m_per_n)[:, None] * left
        sectors = (*self.sectors, DEAD_ZONE, FORCE_LIMIT)
        return self._compiled([predicted, later], [left, inner, innovation, force], sectors)

    def _sample(self, states: Matrix, measured: Matrix, slopes: Matrix) -> tuple[Matrix, Matrix, Matrix]:
        """Return the next states, the force and what the sectors read, as rows over the same signals as the inputs."""
        inputs = np.concatenate([measured, slopes], axis=-2) if self.sectors else measured
        outputs = self.c @ states + self.d @ inputs
        return self.a @ states + self.b @ inputs, outputs[..., : self.outputs, :], outputs[..., self.outputs :, :]

    def _compiled(self, states: Sequence[Matrix], outputs: Sequence[Matrix], sectors: tuple[Sector, ...]) -> Law:
        """Return the law of rows over its signals: states first, then the measured inputs, then those of sectors.

        `states` are the rows of the next states, `outputs` those of the forces, then of the inputs of sectors.
        """
        leading = np.broadcast_shapes(*(rows.shape[:-2] for rows in (*states, *outputs)))
        parts = [np.broadcast_to(rows, (*leading, *rows.shape[-2:])) for rows in (*states, *outputs)]
        whole = np.concatenate(parts, axis=-2)
        size = sum(rows.shape[-2] for rows in states)
        return Law(
            a=whole[..., :size, :size],
            b=whole[..., :size, size:],
            c=whole[..., size:, :size],
            d=whole[..., size:, size:],
            sample_time_s=self.sample_time_s,
            sectors=sectors,
        )

    @property
    def linear(self) -> Law:
        """The linear law: sectors, ranges of slopes of its nonlinear pieces, are left out at their nominal slope."""
        if not self.sectors:
            return self
        return Law(
            a=self.a,
            b=self.b[..., : self.measured],
            c=self.c[..., : self.outputs, :],
            d=self.d[..., : self.outputs, : self.measured],
            sample_time_s=self.sample_time_s,
        )

    def at_slopes(self, **slopes: Values) -> Law:
        """Return the linear law at slopes of sectors by name, those that are not named nominal.

        With W the slopes less the nominal ones and w = W q, q = C_q s + D_q y + D_qq w: w = (1 - W D_qq)^-1 W (C_q s +
        D_q y), which enters by the sectors' columns of B and D.
        """
        off = [np.asarray(slopes.pop(sector.name, sector.nominal)) - sector.nominal for sector in self.sectors]
        if slopes:
            raise ValueError(f"the law has no sector {', '.join(slopes)}")
        if not off:
            return self
        eye = np.eye(len(off))
        change = np.stack(np.broadcast_arrays(*off), axis=-1)[..., None] * eye
        to_sectors = slice(self.outputs, None)
        from_sectors = slice(self.measured, None)
        closed = np.linalg.solve(eye - change @ self.d[..., to_sectors, from_sectors], change)
        of_states = closed @ self.c[..., to_sectors, :]
        of_measured = closed @ self.d[..., to_sectors, : self.measured]
        linear = self.linear
        into_states = self.b[..., from_sectors]
        into_force = self.d[..., : self.outputs, from_sectors]
        return Law(
            a=linear.a + into_states @ of_states,
            b=linear.b + into_states @ of_measured,
            c=linear.c + into_force @ of_states,
            d=linear.d + into_force @ of_measured,
            sample_time_s=self.sample_time_s,
        )

    @cached_property
    def rest(self) -> FloatArray:
        """States s = A s + B at which the law rests where the position is 1 m, shape (..., n); 0 where it never rests.

        An integral never rests; a law that does and gives no force then leaves a released device at rest anywhere.
        """
        change = np.eye(self.states) - self.a
        rests = np.abs(np.linalg.det(change)) > 0
        solvable = np.where(rests[..., None, None], change, np.eye(self.states))
        states = np.linalg.solve(solvable, np.broadcast_to(self.b[..., :1], (*change.shape[:-1], 1)))[..., 0]
        return np.where(rests[..., None], states, 0.0)

    def transfer(self, z: ComplexArray, measured: int = 0) -> ComplexArray:
        """Return u over a measured input, C (z - A)^-1 B + D; the axes of z end with those of the laws.

        The input is by default the position, so that the transfer is in N/m.
        """
        linear = self.linear
        through = linear.d[..., 0, measured]
        if not self.states:
            return np.broadcast_to(through, np.broadcast_shapes(np.shape(z), linear.shape)).astype(np.complex128)
        of_states = response(np.asarray(z), linear.a, linear.b[..., measured], linear.c[..., :1, :])[0]
        return np.asarray(of_states + through)

    def noise_gain(self) -> float:
        """Return the rms of the force over that of white noise of the position: the root of the sum of h_n^2.

        h is the response to one sample: D, then C A^n B. With P = A P A' + B B' the sum is D^2 + C P C'. P is the sum
        of A^n B B' A'^n, of which each round doubles the terms: a window of 256 samples takes 9 rounds.

        R. A. Smith, Matrix equation XA + BX = C, SIAM J. Applied Mathematics 16 (1968).
        """
        linear = self.linear
        if not self.states:
            return abs(float(linear.d[0, 0]))
        power = linear.a
        covariance = linear.b @ linear.b.T
        for _ in range(_MOST_DOUBLINGS):
            more = power @ covariance @ power.T
            covariance = covariance + more
            if np.abs(more).max() <= _NO_MORE * np.abs(covariance).max():
                break
            power = power @ power
        return math.sqrt(float(linear.d[0, 0] ** 2 + (linear.c @ covariance @ linear.c.T)[0, 0]))


def _signals(*counts: int) -> list[Matrix]:
    """Return the rows of named groups of signals, each over all of them."""
    rows = np.eye(sum(counts))
    return np.split(rows, np.cumsum(counts)[:-1])
