"""The characteristic function of a frozen loop with a rigid device, enclosed over cells of frequency and hands.

With delta = z - 1, w = 1/z, eta = 1 - w, and M, B, k total mass, damping and stiffness,

    F = T A(delta) E(eta) + Q(delta) G(eta) w^n

where A = (M/T^2) delta^2 + (B phi/T + 2 k psi) delta + k N is the mechanics discretised exactly, with N = phi^2 + beta
phi psi + kappa psi^2; Q = B1 delta + (beta phi + kappa psi) B1 + phi B2 is the response to a held force, with B1 = psi
and B2 = phi, or less where a fractional delay lets it arrive inside the sample (the previous force acts until then);
and G/(T E) is the coupling with its wall. No term cancels as the frequency goes to 0. F times a power of z is a
polynomial whose zeros are the eigenvalues of the loop, and 0; its degree is the same everywhere.

The motion of a mass on a spring and a damper within one sample: its power series with the remainder enclosed.

In units of the sample time, u'' + beta u' + kappa u = 0 with u(0) = 0 and u'(0) = 1: phi(s) = u(s), and psi(s) its
integral from 0, which is the step response. With c(n) = n! times the coefficient of s^n in u,

    c(0) = 0, c(1) = 1, c(n+2) = -beta c(n+1) - kappa c(n),    |c(n)| <= q^(n-1) for q >= beta + sqrt(kappa),

for q^2 >= beta q + kappa. The same sequence with plus signs has coefficients that are not negative and is convex, so
that its derivatives are at most its value with beta or kappa greater by 1.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
from avc_casadi._util.json_values import plain
from avc_casadi.claims.prove.interval import ComplexInterval, Interval, Jet, sine, sine_and_cosine

_REMAINDER = 1e-18
_MOST_TERMS = 120


def oscillator(
    beta: Interval, kappa: Interval, late: Jet[Interval] | None = None
) -> tuple[Jet[Interval], Jet[Interval]]:
    """Enclose phi and psi over cells of beta and kappa, neither negative.

    Args:
        beta: damping times sample time over mass, shape (n,).
        kappa: stiffness times sample time squared over mass, shape (n,).
        late: s in [0, 1] with its slopes, of which the last belongs to s; None takes s = 1.

    Returns:
        phi and psi; slopes along beta, kappa and, where it is given, s.
    """
    variables = 2 if late is None else 3
    zero = np.zeros((variables, *beta.shape))

    def variable(value: Interval, index: int) -> Jet[Interval]:
        unit = zero.copy()
        unit[index] = 1.0
        return Jet(value, Interval.of(unit))

    damping, spring = variable(beta, 0), variable(kappa, 1)
    reach = (beta + (kappa + 1.0).sqrt() + 1.0).high
    terms, left = _terms(reach)
    before, now = (Jet(Interval.of(np.full(beta.shape, start)), Interval.of(zero)) for start in (0.0, 1.0))
    series = [now]
    for _ in range(terms - 1):
        before, now = now, -(damping * now + spring * before)
        series.append(now)
    # Horner's scheme: u = s (c1 + s/2 (c2 + s/3 (c3 + ...))), and one order higher for the integral.
    phi, psi = (Jet(Interval.of(np.zeros(beta.shape)), Interval.of(zero)) for _ in range(2))
    for n in range(terms, 0, -1):
        phi, psi = ((one + series[n - 1]) for one in (phi, psi))
        if late is not None:
            phi, psi = phi * late, psi * late
        phi, psi = _over(phi, n), _over(psi, n + 1)
    if late is not None:
        psi = psi * late
    spread = Interval(-left, left)
    return Jet(phi.value + spread, phi.slope + spread), Jet(psi.value + spread, psi.slope + spread)


def _over(one: Jet[Interval], number: int) -> Jet[Interval]:
    return Jet(one.value / float(number), one.slope / float(number))


def _terms(reach: FloatArray) -> tuple[int, FloatArray]:
    """Return the number of summed terms, and the bound of the remainder and of its slopes."""
    terms = 8
    while True:
        q = Interval.of(reach)
        power = Interval.of(np.ones_like(reach))
        for n in range(1, terms + 1):
            power = power * q / float(n)
        left = (power / (1.0 - q / float(terms + 1))).high
        bound = np.where(reach < terms, left, np.inf)
        if terms >= _MOST_TERMS or bool((bound < _REMAINDER).all()):
            return terms, bound
        terms += 4


ANGLE, MASS, DAMPING, STIFFNESS, LATE = range(5)
"""Rows of a cell: z = exp(j angle) in rad; M, kg; B, N.s/m; k, N/m; fraction of the delay, where it varies."""

_NUMBERS = ("wall_damping_ns_per_m", "wall_stiffness_n_per_m", "sample_time_s")
_GAINS = ("damping_ns_per_m", "stiffness_n_per_m", "contact_damping_ns_per_m")


@dataclass(frozen=True)
class FrozenGains:
    """Rows of gains in series with a wall; every number counts as exact.

    Attributes:
        damping_ns_per_m: b of the coupling, shape (rows,); infinite where it is rigid.
        stiffness_n_per_m: k of the coupling; infinite where it is rigid.
        contact_damping_ns_per_m: b_p.
        wall_damping_ns_per_m: b_e.
        wall_stiffness_n_per_m: k_e.
        sample_time_s: T.
    """

    damping_ns_per_m: FloatArray
    stiffness_n_per_m: FloatArray
    contact_damping_ns_per_m: FloatArray
    wall_damping_ns_per_m: float
    wall_stiffness_n_per_m: float
    sample_time_s: float

    def __len__(self) -> int:
        return len(self.damping_ns_per_m)

    @property
    def rigid(self) -> BoolArray:
        """Whether the coupling is rigid in all rows."""
        return np.isinf(self.damping_ns_per_m) | np.isinf(self.stiffness_n_per_m)

    @property
    def calls_back(self) -> BoolArray:
        """Whether coupling and wall have a stiffness at rest."""
        return np.asarray((self.wall_stiffness_n_per_m > 0) & (self.rigid | (self.stiffness_n_per_m > 0)))

    def pick(self, rows: IndexArray) -> FrozenGains:
        """Return some of the rows."""
        return replace(
            self,
            damping_ns_per_m=self.damping_ns_per_m[rows],
            stiffness_n_per_m=self.stiffness_n_per_m[rows],
            contact_damping_ns_per_m=self.contact_damping_ns_per_m[rows],
        )

    def document(self) -> dict[str, Any]:
        """Return JSON values; an infinite gain is null."""
        return {name: plain(value) for name, value in vars(self).items()}

    @classmethod
    def from_document(cls, found: Mapping[str, Any]) -> FrozenGains:
        """Read the output of `document`."""
        b, k, contact = (np.array([np.inf if gain is None else float(gain) for gain in found[name]]) for name in _GAINS)
        wall_b, wall_k, time = (float(found[name]) for name in _NUMBERS)
        return cls(b, k, contact, wall_b, wall_k, time)

    def polynomials(self) -> tuple[Interval, Interval]:
        """Return the coefficients of E, shape (2, rows), and of G, shape (3, rows), in powers of eta."""
        t, rigid = self.sample_time_s, self.rigid
        one, none = Interval.of(np.ones(len(self))), Interval.of(np.zeros(len(self)))
        contact, wall_b = one * self.contact_damping_ns_per_m, one * self.wall_damping_ns_per_m
        wall_k = Interval.of(t) * self.wall_stiffness_n_per_m * np.ones(len(self))
        b = Interval.of(np.where(rigid, 1.0, self.damping_ns_per_m))
        k = t * Interval.of(np.where(rigid, 1.0, self.stiffness_n_per_m))
        rest, rate = k + wall_k, b + wall_b
        low = [rest, rate]
        high = [k * wall_k, k * wall_b + b * wall_k + contact * rest, b * wall_b + contact * rate]
        stiff = ([one, none], [wall_k, wall_b + contact, none])
        # Two dampers: the position of the joint has no effect, and its eigenvalue of 1 is no part of the loop.
        loose = (self.stiffness_n_per_m == 0) & (self.wall_stiffness_n_per_m == 0) & ~rigid
        both = (self.damping_ns_per_m > 0) & (self.wall_damping_ns_per_m > 0)
        joined = _where(both, b * wall_b / (b + wall_b), none)
        damped = ([one, none], [none, joined + contact, none])
        for where, (some_low, some_high) in ((loose, damped), (rigid, stiff)):
            low = [_where(where, new, old) for new, old in zip(some_low, low, strict=True)]
            high = [_where(where, new, old) for new, old in zip(some_high, high, strict=True)]
        return stacked(low), stacked(high)


@dataclass(frozen=True)
class FrozenLoop:
    """F of rows of gains; a delay of `whole_delay` samples and a fraction, fixed or a row of the cells.

    Attributes:
        gains: the rows; each cell refers to one.
        whole_delay: n.
        fraction: of the delay, in [0, 1]; None where it varies.
    """

    gains: FrozenGains
    whole_delay: int
    fraction: float | None

    @property
    def variables(self) -> int:
        """Rows of a cell."""
        return 4 if self.fraction is not None else 5

    def over(self, cells: Interval, rows: IndexArray) -> Jet[ComplexInterval]:
        """Enclose F and its slopes over cells, shape (variables, n), of the rows (n,) that they belong to."""
        factors = self._of_angle(cells[ANGLE], rows)
        moved = self._of_mechanics(cells)
        terms = list(zip(moved, factors[: len(moved)], strict=True))
        value = _total([real.value * factor.value for real, factor in terms])
        by_angle = _total([real.value * factor.slope for real, factor in terms])
        by_hand = _total([real.slope * factor.value for real, factor in terms])
        slope = ComplexInterval(_joined(by_angle.real, by_hand.real), _joined(by_angle.imag, by_hand.imag))
        return Jet(value, slope)

    def at(self, points: FloatArray, rows: IndexArray) -> ComplexInterval:
        """Enclose F at points, shape (variables, n), of the rows (n,) that they belong to."""
        cells = Interval.of(points)
        moved = self._of_mechanics(cells)
        factors = self._of_angle(cells[ANGLE], rows)[: len(moved)]
        return _total([real.value * factor.value for real, factor in zip(moved, factors, strict=True)])

    @cached_property
    def _coefficients(self) -> tuple[Interval, Interval]:
        return self.gains.polynomials()

    def _of_angle(self, angle: Interval, rows: IndexArray) -> list[Jet[ComplexInterval]]:
        """Return delta^2 E, delta E, E, delta G w^n, G w^n, delta G w^(n+1), G w^(n+1)."""
        sin, cos = sine_and_cosine(angle)
        lift = 2.0 * sine(angle * 0.5).square()
        delta = Jet(ComplexInterval(-lift, sin), ComplexInterval(-sin[None], cos[None]))
        eta = Jet(ComplexInterval(lift, sin), ComplexInterval(sin[None], cos[None]))
        low, high = (_polynomial(coefficients[:, rows], eta) for coefficients in self._coefficients)
        late = [high * _delayed(angle, self.whole_delay + more) for more in (0, 1)]
        at_once = delta * low
        return [delta * at_once, at_once, low, delta * late[0], late[0], delta * late[1], late[1]]

    def _of_mechanics(self, cells: Interval) -> list[Jet[Interval]]:
        """Return T times the coefficients of A, and those of Q for the newer force and the older one."""
        t = self.gains.sample_time_s
        mass, damping, stiffness = cells[MASS], cells[DAMPING], cells[STIFFNESS]
        beta, kappa = damping * t / mass, stiffness * Interval.of(t).square() / mass
        count = cells.shape[1]
        size = self.variables - 1
        unit = [Interval.of(np.eye(size)[:, index : index + 1] * np.ones(count)) for index in range(3)]
        m, b, k = (Jet(cells[row], unit[row - 1]) for row in (MASS, DAMPING, STIFFNESS))
        per_mass = 1.0 / mass
        slopes = (-beta * per_mass, t * per_mass, -kappa * per_mass, Interval.of(t).square() * per_mass)
        whole = _chained(oscillator(beta, kappa), slopes, size)
        phi, psi = whole
        beta_jet = _chained((Jet(beta, _basis(0, count)),), slopes, size)[0]
        kappa_jet = _chained((Jet(kappa, _basis(1, count)),), slopes, size)[0]
        decay = beta_jet * phi + kappa_jet * psi
        left = phi.square() + psi * decay
        mechanics = [m.times(1.0 / Interval.of(t)), b * phi + (k * psi).times(2.0 * t), (k * left).times(t)]

        def moves(one: Jet[Interval], two: Jet[Interval]) -> list[Jet[Interval]]:
            return [one, decay * one + phi * two]

        if self.fraction == 0:
            return mechanics + moves(psi, phi)
        phi_new, psi_new = _chained(oscillator(beta, kappa, self._rest(cells)), slopes, size)
        return mechanics + moves(psi_new, phi_new) + moves(psi - psi_new, phi - phi_new)

    def _rest(self, cells: Interval) -> Jet[Interval]:
        """Return the share of a sample after the arrival of the force, with slopes along beta, kappa and itself."""
        count = cells.shape[1]
        late = cells[LATE] if self.fraction is None else Interval.of(np.full(count, self.fraction))
        slope = np.zeros((3, count))
        slope[2] = 1.0
        return Jet(1.0 - late, Interval.of(slope))


def _basis(index: int, count: int) -> Interval:
    return Interval.of(np.eye(2)[:, index : index + 1] * np.ones(count))


def _chained(jets: tuple[Jet[Interval], ...], slopes: tuple[Interval, ...], size: int) -> list[Jet[Interval]]:
    """Return slopes along beta, kappa (and s) as those along mass, damping, stiffness (and the fraction, 1 - s)."""
    beta_mass, beta_damping, kappa_mass, kappa_stiffness = slopes
    found = []
    for jet in jets:
        beta, kappa = jet.slope[0], jet.slope[1]
        rows = [beta * beta_mass + kappa * kappa_mass, beta * beta_damping, kappa * kappa_stiffness]
        if size == 4:
            rows.append(-jet.slope[2] if jet.slope.shape[0] == 3 else beta * 0.0)
        found.append(Jet(jet.value, stacked(rows)))
    return found


def _polynomial(coefficients: Interval, eta: Jet[ComplexInterval]) -> Jet[ComplexInterval]:
    total = Jet(eta.value * 0.0 + coefficients[-1], eta.slope * 0.0)
    for power in range(coefficients.shape[0] - 2, -1, -1):
        total = (total * eta).plus(coefficients[power])
    return total


def _delayed(angle: Interval, samples: int) -> Jet[ComplexInterval]:
    """Return w^samples."""
    turned = angle * float(samples)
    sin, cos = sine_and_cosine(turned)
    return Jet(ComplexInterval(cos, -sin), ComplexInterval(-sin[None], -cos[None]) * float(samples))


def _total(terms: list[ComplexInterval]) -> ComplexInterval:
    total = terms[0]
    for term in terms[1:]:
        total = total + term
    return total


def _where(condition: BoolArray, one: Interval, other: Interval) -> Interval:
    return Interval(np.where(condition, one.low, other.low), np.where(condition, one.high, other.high))


def stacked(rows: list[Interval]) -> Interval:
    """Stack intervals of one shape."""
    return Interval(np.stack([row.low for row in rows]), np.stack([row.high for row in rows]))


def _joined(one: Interval, other: Interval) -> Interval:
    return Interval(np.concatenate([one.low, other.low]), np.concatenate([one.high, other.high]))
