"""The optimum of (11)-(12) to 50 digits, by the topology of the feasible set instead of a list of candidates.

The feasible part of the gain box falls into pieces, each bounded by stretches of the box's edges and by arcs of
Re Z = margin. On a connected piece |Z| takes every value between its smallest and its largest, so that the error is 0
where |Z_h_ds| lies between them for some piece, and otherwise the distance to the nearest end. Where |Z| = |Z_h_ds| is
never asked. Crossings and stationary points come from polynomials interpolated on the impedances themselves.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import mpmath

from avc_casadi.model.problem import Problem
from avc_casadi.model.problem_ranges import margin_over_range
from avc_casadi.paper.equations import ImpedanceLoop, loop_at
from avc_casadi.paper.numbers import Complex, NumberSystem, Real, abs2


def mpmath_numbers(digits: int) -> NumberSystem:
    own = mpmath.mp.clone()
    own.dps = digits
    return NumberSystem(own.sinpi, own.mpc, own.mpf, lambda x: own.mpf(1) if x == 0 else x)


# Ten digits more than are claimed.
NUMBERS = mpmath_numbers(60)
MP = NUMBERS.complex(0, 0).context
Gains = tuple[Real, Real]


@dataclass
class Stretch:
    """A feasible stretch of the box's perimeter: its ends and every stationary point of |Z| on it."""

    ends: tuple[Gains, Gains]
    magnitudes: list[Real]


class Reference:
    """One frequency at one contact damping: least ||Z_h_ds| - |Z_h_avc||, None where the box has no feasible gains."""

    def __init__(self, problem: Problem, frequency_hz: float, contact: Real = None) -> None:
        box = problem.coupling
        self.loop: ImpedanceLoop = loop_at(problem, MP.mpf(frequency_hz), NUMBERS)
        self.margin = MP.mpf(margin_over_range(problem))
        self.contact = MP.mpf(box.contact_damping_ns_per_m[0] if contact is None else contact)
        self.radius = abs(self.loop.target)
        (b0, b1), (k0, k1) = ([MP.mpf(end) for end in ends] for ends in (box.damping_ns_per_m, box.stiffness_n_per_m))
        self.corners = [(b0, k0), (b1, k0), (b1, k1), (b0, k1)]
        self.error = self._error()

    def impedance(self, gains: Gains) -> Complex:
        """Z_h_avc of (b, k)."""
        return self.loop.perceived(*gains, self.contact)

    def _excess(self, gains: Gains) -> Real:
        return self.impedance(gains).real - self.margin

    def _error(self) -> Real | None:
        stretches, crossings = self._perimeter()
        if not stretches:
            return None
        errors = []
        for piece, arcs in self._pieces(stretches, crossings):
            magnitudes = [value for stretch in piece for value in stretch.magnitudes]
            if any(arc[0].imag * arc[1].imag <= 0 for arc in arcs):
                magnitudes.append(abs(self.margin))
            low, high = min(magnitudes), max(magnitudes)
            errors.append(max(low - self.radius, self.radius - high, MP.mpf(0)))
        return min(errors)

    def _perimeter(self) -> tuple[list[Stretch], list[Gains]]:
        """Walk around the box; return the feasible stretches and the points where feasibility changes."""
        walked: list[tuple[bool, Stretch]] = []
        for start, end in itertools.pairwise([*self.corners, self.corners[0]]):
            if start != end:
                walked += self._edge(start, end)
        changes = [two[1].ends[0] for one, two in itertools.pairwise([*walked[-1:], *walked]) if one[0] != two[0]]
        stretches = [stretch for feasible, stretch in walked if feasible]
        # A corner may be feasible alone: no coupling on a device without damping, or a box without extent.
        reached = {end for stretch in stretches for end in stretch.ends}
        alone = [
            corner for corner in dict.fromkeys(self.corners) if corner not in reached and self._excess(corner) >= 0
        ]
        return [*stretches, *(Stretch((corner, corner), [abs(self.impedance(corner))]) for corner in alone)], changes

    def _edge(self, start: Gains, end: Gains) -> list[tuple[bool, Stretch]]:
        def at(share: Real) -> Gains:
            return start[0] + share * (end[0] - start[0]), start[1] + share * (end[1] - start[1])

        def weighted(value: Any) -> Any:
            return lambda share: value(at(share)) * self._weight(at(share))

        excess = _polynomial(weighted(self._excess), 2)
        top, bottom = _polynomial(weighted(lambda g: abs2(self.impedance(g))), 2), _polynomial(weighted(lambda _: 1), 2)
        # d(top/bottom) = 0; the cubic terms cancel.
        turning = [
            top[1] * bottom[0] - top[0] * bottom[1],
            2 * (top[2] * bottom[0] - top[0] * bottom[2]),
            top[2] * bottom[1] - top[1] * bottom[2],
        ]
        stationary = _roots(turning)
        cuts = [MP.mpf(0), *sorted(_roots(excess)), MP.mpf(1)]
        found = []
        for low, high in itertools.pairwise(cuts):
            if low < high:
                inside = [low, high, *(s for s in stationary if low < s < high)]
                stretch = Stretch((at(low), at(high)), [abs(self.impedance(at(s))) for s in inside])
                found.append((self._excess(at((low + high) / 2)) >= 0, stretch))
        return found

    def _weight(self, gains: Gains) -> Real:
        """|Z_e + Z_avc|^2, which makes polynomials of Re Z and |Z|^2; 1 in free space, where Z is constant."""
        loop, free = self.loop, abs2(self.loop.environment) == 0
        if free:
            return MP.mpf(1)
        b, k = gains
        half = k * loop.angle.sample_time_s / 2
        return abs2(loop.environment + MP.mpc(b + half, -half * loop.angle.cos / loop.angle.sin))

    def _pieces(
        self, stretches: list[Stretch], crossings: list[Gains]
    ) -> list[tuple[list[Stretch], list[tuple[Any, Any]]]]:
        """Join stretches that touch, or that an arc of Re Z = margin through the box joins.

        Z moves one way along that curve, and passes infinity outside the box: the crossings, ordered by Im Z, are
        entry and exit by turns.
        """
        ordered = sorted(((self.impedance(gains), gains) for gains in crossings), key=lambda pair: pair[0].imag)
        arcs = list(zip(ordered[::2], ordered[1::2], strict=True))
        group = list(range(len(stretches)))

        def merge(one: Gains, two: Gains) -> None:
            touching = {group[i] for i, s in enumerate(stretches) if one in s.ends or two in s.ends}
            for i, number in enumerate(group):
                if number in touching:
                    group[i] = min(touching)

        for corner in self.corners:
            merge(corner, corner)
        for stretch in stretches:
            for end in stretch.ends:
                merge(end, end)
        for (_, one), (_, two) in arcs:
            merge(one, two)
        pieces = []
        for number in sorted(set(group)):
            members = [s for i, s in enumerate(stretches) if group[i] == number]
            touched = {end for stretch in members for end in stretch.ends}
            pieces.append((members, [(z1, z2) for (z1, g1), (z2, g2) in arcs if {g1, g2} & touched]))
        return pieces


def _polynomial(value: Any, degree: int) -> list[Real]:
    """Coefficients, lowest first, of a polynomial known by its values, taken at positive points."""
    nodes = [MP.mpf(2 * i + 1) / (2 * degree + 1) for i in range(degree + 1)]
    matrix = MP.matrix([[node**power for power in range(degree + 1)] for node in nodes])
    return list(MP.lu_solve(matrix, MP.matrix([value(node) for node in nodes])))


def _roots(quadratic: list[Real]) -> list[Real]:
    """Real roots within (0, 1) of a quadratic, coefficients lowest first."""
    c, b, a = quadratic
    discriminant = b * b - 4 * a * c
    if discriminant < 0:
        return []
    half = -(b + (MP.sqrt(discriminant) if b >= 0 else -MP.sqrt(discriminant))) / 2
    pairs = ((half, a), (c, half))
    return [top / bottom for top, bottom in pairs if bottom != 0 and 0 < top / bottom < 1]


def series_error(problem: Problem, frequency_hz: float, contact: Real = None) -> Real | None:
    """Return the smallest ||Z_h_ds| - |Z_h_avc|| at one contact damping; None where nothing is feasible."""
    return Reference(problem, frequency_hz, contact).error


def damped_error(problem: Problem, frequency_hz: float, *, samples: int = 24, halvings: int = 40) -> Real | None:
    """Return the smallest error found over the contact damping too: a scan, then golden section about its best.

    An upper bound of the optimum, and the optimum itself where the scan meets its valley.
    """
    low, high = (MP.mpf(end) for end in problem.coupling.contact_damping_ns_per_m)
    scale = abs(Reference(problem, frequency_hz, low).loop.target)

    def error(share: Real) -> Real:
        contact = MP.mpf(share) * scale / (1 - MP.mpf(share))
        found = series_error(problem, frequency_hz, min(max(contact, low), high))
        return MP.inf if found is None else found

    first, last = low / (scale + low), high / (scale + high)
    shares = [first + (last - first) * i / samples for i in range(samples + 1)]
    errors = [error(share) for share in shares]
    best = min(range(len(shares)), key=errors.__getitem__)
    left, right = shares[max(best - 1, 0)], shares[min(best + 1, samples)]
    golden = (MP.sqrt(5) - 1) / 2
    lowest = errors[best]
    for _ in range(halvings):
        one, two = right - golden * (right - left), left + golden * (right - left)
        at_one, at_two = error(one), error(two)
        lowest = min(lowest, at_one, at_two)
        left, right = (left, two) if at_one <= at_two else (one, right)
        if lowest == 0:
            break
    return None if lowest == MP.inf else lowest
