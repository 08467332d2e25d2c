"""Walls K + B (1 - 1/z)/T that are linearly stable, by explicit boundary curves (D-decomposition, Neimark 1949).

On z = exp(j theta) the characteristic equation of the sampled loop is linear in K and B:

    K + B q(z) = L(z),   q = (1 - 1/z)(1 + a1 + a2)/(T (1 + a1/z + a2/z^2)),   L = 1/G,

G from the commanded force to the sampled position, with hold, delay, amplifier, resonance and hand, a1 and a2 those of
a linear estimator of the velocity (`model.velocity`). Real and imaginary part give one wall (B, K) for each 0 < theta <
pi; theta = pi gives a line, theta = 0 one at K = -k_h. Where Im(L - B q) rises through 0 (where B(theta) rises through
the B of a wall, if Im q > 0), a pair of poles leaves the unit circle as K grows; where it falls, a pair comes back. So
the stable K of each B follow from all crossings, sorted, and the number of poles outside at K = 0, which is counted in
the same way along B from the device alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray, IndexArray
from avc_casadi.loops.loop import Body
from avc_casadi.loops.wall import Rendering, plants_of, wall
from avc_casadi.model.corners import LINEAR_KEYS, device_corners
from avc_casadi.model.hands import Hand
from avc_casadi.model.sampled_plant import sampled_plant
from avc_casadi.model.velocity import PLAIN, Poles, low_pass

if TYPE_CHECKING:
    from avc_casadi.model.device import Device
    from avc_casadi.model.hands import StylusHand

# Start of the curves: walls softer than m (theta/T)^2, m the total moving mass, are taken as this one.
_LOWEST_ANGLE = 1e-7
_A_DECADE, _A_HALF_WAVE = 20, 12
# A zero of the device near the circle turns the phase of L by pi within few nodes: more are inserted.
_MOST_TURN, _SPLITS = 0.4, 40
# Nodes about each pole, in bandwidths of its resonance.
_ABOUT = np.array([0.0, 0.3, 1.0, 3.0, 10.0, 30.0])
# Each zoom narrows the bracket of an extremum to a quarter, each root step at least every second one to a half.
_CLOSER, _NINE = 6, np.linspace(0.0, 1.0, 9)
_ROOT_STEPS, _ROOT, _NEAR = 60, 1e-13, 1e-9
_EVENTS_AT_ONCE = 8_000_000
_SCAN, _HALVINGS = 121, 40
# Up to so many pairs of device and hand all are evaluated every time; of more only those once critical, the others at
# the end.
_FEW = 32
# The initial critical pairs are the worst at each of so many dampings.
_PROBED = 9
# The damping of the stiffest wall is scanned at so many values, then repeatedly at so many about the best.
_COARSE, _FINE, _ZOOMS = 61, 61, 2
# Relative distance of the result below the boundary, so that eigenvalues confirm it.
_BELOW = 5e-5


@dataclass(frozen=True)
class Stretches:
    """Stiffnesses of a wall for which a claim holds at each of n dampings: m intervals, ascending, shape (n, m)."""

    lowest_n_per_m: FloatArray
    largest_n_per_m: FloatArray

    @property
    def first_n_per_m(self) -> FloatArray:
        """Upper end of the softest interval, shape (n,); not a number where there is none."""
        return self.largest_n_per_m[:, 0]

    def holds(self, row: int, stiffness_n_per_m: float) -> bool:
        """Whether the claim holds for a wall of the damping of a row."""
        low, high = self.lowest_n_per_m[row], self.largest_n_per_m[row]
        return bool(((low <= stiffness_n_per_m) & (stiffness_n_per_m <= high)).any())


def stable_walls(
    corners: Sequence[Device],
    hands: Hand | StylusHand,
    damping_ns_per_m: FloatArray,
    poles: Poles = PLAIN,
) -> Stretches:
    """Find the stiffnesses with which a wall is stable with every hand at every corner of a device."""
    rows = len(damping_ns_per_m)
    loops = _Curves.of(corners, hands, poles)
    if loops is None:
        return Stretches(np.full((rows, 1), np.nan), np.full((rows, 1), np.nan))
    nodes = _nodes(loops, corners, float(damping_ns_per_m.max(initial=0.0)))
    outside = np.zeros(rows, dtype=np.intp)
    events: list[tuple[IndexArray, FloatArray, IndexArray]] = []
    at_once = max(1, _EVENTS_AT_ONCE // (rows * nodes.shape[1]))
    for begin in range(0, len(nodes), at_once):
        some = slice(begin, begin + at_once)
        part = loops.pick(some)
        inverse, damper = part.response(nodes[some])
        curve = inverse.imag / damper.imag
        outside += _outside_without_spring(part, nodes[some], (inverse / damper).imag, curve, damping_ns_per_m)
        events += _crossings(part, nodes[some], inverse.imag, damper.imag, damping_ns_per_m)
    return _stretches(outside, *(np.concatenate(column) for column in zip(*events, strict=True)))


@dataclass(frozen=True)
class _Curves:
    """Every corner with every hand from the force to the sampled position, from sample to sample."""

    # A - 1, the columns of the newest force and of the one before, and where no spring restores the device.
    change: FloatArray
    new: FloatArray
    old: FloatArray
    whole_delay: FloatArray
    measured: int
    free: BoolArray
    sample_time_s: float
    poles: Poles

    @classmethod
    def of(cls, corners: Sequence[Device], hands: Hand | StylusHand, poles: Poles) -> _Curves | None:
        """Return all cases with an equation of motion; None where a device with a hand has none."""
        first, h = corners[0], len(hands)
        back = hands.stiffness_n_per_m if isinstance(hands, Hand) else hands.arm_stiffness_n_per_m
        plant = plants_of(corners, hands)
        s, period = len(plant.names), plant.sample_time_s
        scale = np.array([period if name.endswith("_per_s") else 1.0 for name in plant.names])
        matrix = (plant.matrix * scale[:, None] / scale).reshape(-1, s, s)
        new, old = (plant.new * scale).reshape(-1, s), (plant.old * scale).reshape(-1, s)
        if not (np.isfinite(matrix).all() and np.isfinite(new).all()):
            return None
        return cls(
            change=matrix - np.eye(matrix.shape[-1]),
            new=new,
            old=old,
            whole_delay=np.repeat([math.floor(corner.delay_samples) for corner in corners], h).astype(np.float64),
            measured=int(np.argmax(plant.measured)),
            free=np.tile(np.broadcast_to(np.asarray(back) == 0, (h,)), len(corners)),
            sample_time_s=first.sample_time_s,
            poles=poles,
        )

    def pick(self, cases: IndexArray | slice) -> _Curves:
        """Return some of the cases."""
        return _Curves(
            self.change[cases], self.new[cases], self.old[cases], self.whole_delay[cases], self.measured,
            self.free[cases], self.sample_time_s, self.poles,
        )  # fmt: skip

    def response(self, angle: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        """Return L (N/m) and q (1/s) at angles of the cases, shape (cases) or (cases, m)."""
        case = (slice(None), *(None,) * (angle.ndim - 1))
        step = np.empty(angle.shape, dtype=np.complex128)
        step.real, step.imag = -2 * np.sin(angle / 2) ** 2, np.sin(angle)
        back = -step.conj()
        damper = back / self.sample_time_s * low_pass(back, self.poles)
        change = self.change
        if change.shape[-1] == 2:
            a, b, c, d = (change[:, i, j][case] for i in (0, 1) for j in (0, 1))
            denominator = step**2 - step * (a + d) + (a * d - b * c)
            sent: list[Any] = [(step - d) * u[:, 0][case] + b * u[:, 1][case] for u in (self.new, self.old)]
        else:
            eye = np.eye(change.shape[-1])
            pushes = np.stack([self.new, self.old], axis=-1)[case]
            states = np.linalg.solve(step[..., None, None] * eye - change[case], pushes.astype(np.complex128))
            denominator, sent = np.ones_like(step), [states[..., self.measured, index] for index in (0, 1)]
        numerator = sent[0] + sent[1] * (1 + step.conj()) if self.old.any() else sent[0]
        late = np.exp(1j * angle * self.whole_delay[case]) if self.whole_delay.any() else 1.0
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(denominator / numerator * late), damper


def _nodes(loops: _Curves, corners: Sequence[Device], most_damping_ns_per_m: float) -> FloatArray:
    """Return angles, shape (cases, m), between which B(theta) is monotone."""
    delay = max(corner.delay_samples for corner in corners)
    low = np.geomspace(_LOWEST_ANGLE, 0.1, 1 + _A_DECADE * 6)
    even = np.linspace(0.0, np.pi, 1 + _A_HALF_WAVE * math.ceil(delay + 3))[1:-1]
    common = np.unique(np.concatenate([low, even, np.pi - low]))
    angle = np.broadcast_to(common, (len(loops.new), len(common)))
    if loops.change.shape[-1] > 2:
        poles = 1 + np.linalg.eigvals(loops.change).astype(np.complex128)
        width = np.maximum(np.abs(np.log(np.maximum(np.abs(poles), 1e-9))), 1e-4)[..., None]
        about = np.abs(np.angle(poles))[..., None] + width * np.concatenate([-_ABOUT, _ABOUT])
        angle = np.sort(np.concatenate([angle, np.clip(about.reshape(len(angle), -1), low[0], np.pi - low[0])], axis=1))
    inverse, damper = loops.response(angle)
    for _ in range(_SPLITS):
        turned = np.abs(np.angle(inverse[:, 1:] * inverse[:, :-1].conj())) > _MOST_TURN
        turned &= np.diff(angle) > 1e-9 * angle[:, 1:]
        if not turned.any():
            break
        angle = _inserted(angle, turned, (angle[:, 1:] + angle[:, :-1]) / 2)
        inverse, damper = loops.response(angle)
    curve = inverse.imag / damper.imag
    rise = np.diff(curve)
    turns = np.zeros(curve.shape, dtype=bool)
    turns[:, 1:-1] = (rise[:, 1:] * rise[:, :-1] < 0) & (np.maximum(curve[:, 2:], curve[:, :-2]) > 0)
    turns &= np.isfinite(curve) & (curve < 8 * most_damping_ns_per_m)
    case, index = np.nonzero(turns)
    if len(case) == 0:
        return angle
    some, down = loops.pick(case), curve[case, index] < curve[case, index - 1]
    left, right, best = angle[case, index - 1], angle[case, index + 1], angle[case, index]
    every = np.arange(len(case))
    for _ in range(_CLOSER):
        points = np.sort(np.concatenate([left[:, None] + (right - left)[:, None] * _NINE, best[:, None]], axis=1))
        inverse, damper = some.response(points)
        values = inverse.imag / damper.imag
        found = np.argmin(np.where(down[:, None], values, -values), axis=1)
        best, last = points[every, found], points.shape[1] - 1
        left, right = points[every, np.maximum(found - 1, 0)], points[every, np.minimum(found + 1, last)]
    extremum = angle.copy()
    extremum[case, index] = best
    return _inserted(angle, turns, extremum)


def _inserted(angle: FloatArray, where: BoolArray, at: FloatArray) -> FloatArray:
    """Merge new nodes into those of each case; a case with fewer of them repeats its first node."""
    case, index = np.nonzero(where)
    place = (np.cumsum(where, axis=1) - 1)[case, index]
    new = np.repeat(angle[:, :1], int(where.sum(axis=1).max()), axis=1)
    new[case, place] = at[case, index]
    return np.sort(np.concatenate([angle, new], axis=1))


def _root(value: Callable[[FloatArray], FloatArray], left: FloatArray, right: FloatArray) -> FloatArray:
    """Return a root in each bracket: false position that halves the weight of a retained end (Illinois)."""
    at_left, at_right = value(left), value(right)
    middle = right
    for _ in range(_ROOT_STEPS):
        span = at_right - at_left
        share = np.where(span == 0, 0.5, at_right / np.where(span == 0, 1.0, span))
        middle = right - (right - left) * np.where(np.isfinite(share), share, 0.5)
        at_middle = value(middle)
        crossed = np.sign(at_middle) != np.sign(at_right)
        moved = np.abs(middle - right)
        left, at_left = np.where(crossed, right, left), np.where(crossed, at_right, at_left / 2)
        right, at_right = middle, at_middle
        if (moved <= _ROOT * np.abs(middle)).all() or not at_middle.any():
            break
    return middle


def _crossings(
    loops: _Curves, angle: FloatArray, inverse_imag: FloatArray, damper_imag: FloatArray, damping: FloatArray
) -> list[tuple[IndexArray, FloatArray, IndexArray]]:
    """Return rows of B, stiffnesses and the poles that leave the circle there as K grows."""
    above = inverse_imag > damping[:, None, None] * damper_imag
    flips = above[..., 1:] != above[..., :-1]
    row, case, index = np.unravel_index(np.flatnonzero(flips), flips.shape)
    some, b = loops.pick(case), damping[row]

    def beyond(at: FloatArray) -> FloatArray:
        inverse, damper = some.response(at)
        return np.asarray(inverse.imag - b * damper.imag)

    inverse, damper = some.response(_root(beyond, angle[case, index], angle[case, index + 1]))
    stiffness = inverse.real - b * damper.real
    leaving = np.where(above[row, case, index], -2, 2)
    of_row, of_case = (axis.ravel() for axis in np.indices((len(damping), len(angle))))
    inverse, damper = loops.response(np.full(len(angle), np.pi))
    # A mass without damping has no response at Nyquist.
    at_nyquist = np.nan_to_num(inverse.real, nan=np.inf)[of_case] - damping[of_row] * damper.real[of_case]
    real = np.where(above[..., -1].ravel(), -1, 1)
    return [(row, stiffness, leaving), (of_row, at_nyquist, real)]


def _outside_without_spring(
    loops: _Curves, angle: FloatArray, slope: FloatArray, curve: FloatArray, damping: FloatArray
) -> IndexArray:
    """Return the number of poles of all cases outside the circle at each B, for K just above 0."""
    case, index = np.nonzero((slope[:, 1:] > 0) != (slope[:, :-1] > 0))
    some = loops.pick(case)

    def ratio(at: FloatArray) -> ComplexArray:
        inverse, damper = some.response(at)
        return np.asarray(inverse / damper)

    at = ratio(_root(lambda at: ratio(at).imag, angle[case, index], angle[case, index + 1])).real
    # Poles of a device and hand without any damping are on the circle at B = 0, but for rounding: out only if B drives.
    at[np.abs(at) < _NEAR * np.median(np.abs(slope), axis=1)[case]] = 0
    inverse, damper = loops.response(np.full(len(angle), np.pi))
    places = np.concatenate([at, np.nan_to_num((inverse / damper).real, nan=np.inf)])
    leaving = np.concatenate([np.where(slope[case, index] > 0, -2, 2), np.where(slope[:, -1] > 0, -1, 1)])
    passed = ((places > 0) | ((places == 0) & (leaving > 0))) & (places < damping[:, None])
    # Without damping a spring with any delay at all destabilises a free mass.
    driven = 2 * (loops.free & (curve[:, 0] >= damping[:, None]))
    return np.asarray((passed * leaving).sum(axis=1) + driven.sum(axis=1))


def _stretches(outside: IndexArray, row: IndexArray, stiffness: FloatArray, leaving: IndexArray) -> Stretches:
    """Return the intervals without poles outside, from the number outside at K = 0 and all crossings."""
    some = stiffness > 0
    row, stiffness, leaving = row[some], stiffness[some], leaving[some]
    order = np.lexsort((stiffness, row))
    row, stiffness, leaving = row[order], stiffness[order], leaving[order]
    count = np.bincount(row, minlength=len(outside))
    column = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
    most = int(count.max(initial=0))
    ends, poles = np.full((len(outside), most), np.inf), np.zeros((len(outside), most), dtype=np.intp)
    ends[row, column], poles[row, column] = stiffness, leaving
    low = np.concatenate([np.zeros((len(outside), 1)), ends], axis=1)
    high = np.concatenate([ends, np.full((len(outside), 1), np.inf)], axis=1)
    total = outside[:, None] + np.concatenate([np.zeros((len(outside), 1), dtype=np.intp), poles], axis=1).cumsum(
        axis=1
    )
    stable = (total == 0) & (high > low)
    width = max(1, int(stable.sum(axis=1).max(initial=0)))
    first = np.argsort(~stable, axis=1, kind="stable")[:, :width]
    there = np.take_along_axis(stable, first, axis=1)
    return Stretches(
        np.where(there, np.take_along_axis(low, first, axis=1), np.nan),
        np.where(there, np.take_along_axis(high, first, axis=1), np.nan),
    )


def loop_radius(
    device: Device, subjects: Hand | StylusHand, stiffness_n_per_m: FloatArray, damping_ns_per_m: FloatArray
) -> FloatArray:
    """Return the spectral radius of the loop in contact at the device's worst corner, shape (walls, hands)."""
    every = _Loops.of(device, subjects).radius(stiffness_n_per_m, damping_ns_per_m)
    return np.asarray(every.reshape(len(every), -1, len(subjects)).max(axis=1))


def loop_poles(
    device: Device, subjects: Hand | StylusHand, stiffness_n_per_m: float, damping_ns_per_m: float
) -> ComplexArray:
    """Return the poles of the loop in contact with a spring of either sign and a damper, shape (pairs, poles)."""
    loops = _Loops.of(device, subjects)
    rate = damping_ns_per_m / loops.body.sample_time_s
    rendering = Rendering(np.array([[stiffness_n_per_m + rate, -rate, 0.0]]), np.zeros((1, 3)))
    return np.asarray(np.linalg.eigvals(wall(loops.body, rendering)[..., :-1, :-1]))


@dataclass(frozen=True)
class _Loops:
    """Every corner of a device with every hand."""

    body: Body
    most_damping_ns_per_m: float
    deciding: set[int]

    @classmethod
    def of(cls, device: Device, subjects: Hand | StylusHand) -> _Loops:
        corners = device_corners(device, LINEAR_KEYS)
        body = Body.of(sampled_plant(corners, subjects)).flat()
        mass = max(corner.mass_kg for corner in corners) + float(np.max(subjects.mass_kg))
        most = 2 * mass / device.sample_time_s
        few = set(range(len(body.a))) if len(body.a) <= _FEW else set()
        return cls(body, most, few)

    def radius(
        self, stiffness_n_per_m: FloatArray, damping_ns_per_m: FloatArray, pairs: IndexArray | None = None
    ) -> FloatArray:
        """Return the spectral radius of walls with all pairs, or some, shape (walls, pairs)."""
        rate = damping_ns_per_m / self.body.sample_time_s
        force = np.stack([stiffness_n_per_m + rate, -rate, np.zeros_like(rate)], axis=-1)
        rendering = Rendering(force, np.zeros_like(force))
        loop = wall(self.body.axes(slice(None) if pairs is None else pairs), rendering.column)
        # The rendering has no state of its own here.
        return np.asarray(np.abs(np.linalg.eigvals(loop[..., :-1, :-1])).max(axis=-1))

    def worst(self, stiffness_n_per_m: float) -> Callable[[FloatArray], FloatArray]:
        """Return the spectral radius of a wall as a function of its damping, with the worst critical pair."""

        def radius(damping: FloatArray) -> FloatArray:
            stiffness = np.full(len(damping), stiffness_n_per_m)
            return np.asarray(self.radius(stiffness, damping, np.array(sorted(self.deciding))).max(axis=1))

        return radius

    def confirmed(self, stiffness_n_per_m: float, damping_ns_per_m: FloatArray) -> bool:
        """Return whether a wall is stable with all pairs; where it is not, the worst become critical."""
        if len(self.deciding) == len(self.body.a):
            return True
        every = self.radius(np.full(len(damping_ns_per_m), stiffness_n_per_m), damping_ns_per_m)
        found = {int(pair) for row in every if row.max() >= 1 for pair in (np.argmax(row),)} - self.deciding
        self.deciding.update(found)
        return not found

    def start(self, stiffness_n_per_m: float) -> None:
        """Take the worst pairs at a scan of dampings as critical."""
        if not self.deciding:
            damping = np.linspace(0.0, self.most_damping_ns_per_m, _PROBED)
            every = self.radius(np.full(len(damping), stiffness_n_per_m), damping)
            self.deciding.update(int(pair) for pair in np.argmax(every, axis=1))


@dataclass(frozen=True)
class DampingRange:
    """Damping of a wall within which every hand is stable."""

    stiffness_n_per_m: float
    lowest_ns_per_m: float
    highest_ns_per_m: float


def damping_range(device: Device, subjects: Hand | StylusHand, stiffness_n_per_m: float) -> DampingRange:
    """Return the damping with which a wall is stable with every hand at every corner of the device.

    The stable damping of each hand is an interval below 2 m/T of the total moving mass.
    """
    return _damping_range(_Loops.of(device, subjects), stiffness_n_per_m)


def _damping_range(loops: _Loops, stiffness_n_per_m: float, known_ns_per_m: float | None = None) -> DampingRange:
    radius = loops.worst(stiffness_n_per_m)
    while True:
        scan, inside = _stable_dampings(loops, stiffness_n_per_m, known_ns_per_m)
        if len(inside) == 0:
            return DampingRange(stiffness_n_per_m, np.nan, np.nan)
        low = 0.0 if scan[inside[0]] == 0 else _edge(radius, scan[inside[0] - 1], scan[inside[0]])
        high = scan[-1] if inside[-1] == len(scan) - 1 else _edge(radius, scan[inside[-1] + 1], scan[inside[-1]])
        if loops.confirmed(stiffness_n_per_m, np.array([low, high])):
            return DampingRange(stiffness_n_per_m, float(low), float(high))


def _stable_dampings(
    loops: _Loops, stiffness_n_per_m: float, known_ns_per_m: float | None
) -> tuple[FloatArray, IndexArray]:
    """Return a scan of dampings and which of them are stable; finer about the least radius where none is.

    The scan is short where one stable damping is known.
    """
    most = loops.most_damping_ns_per_m
    first = np.linspace(0.0, most, _SCAN) if known_ns_per_m is None else np.array([0.0, known_ns_per_m, most])
    loops.start(stiffness_n_per_m)
    radius = loops.worst(stiffness_n_per_m)
    while True:
        scan, found = first, radius(first)
        if not (found < 1).any():
            scan = _about(scan, int(np.argmin(found)))
            found = radius(scan)
        inside = np.flatnonzero(found < 1)
        if len(inside) == 0 or loops.confirmed(stiffness_n_per_m, scan[inside[[0, -1]]]):
            return scan, inside


def _about(scan: FloatArray, best: int) -> FloatArray:
    """Return a finer scan between the neighbours of the best."""
    return np.linspace(scan[max(best - 1, 0)], scan[min(best + 1, len(scan) - 1)], _SCAN)


def _edge(radius: Callable[[FloatArray], FloatArray], outside: float, inside: float) -> float:
    for _ in range(_HALVINGS):
        middle = (outside + inside) / 2
        if radius(np.array([middle]))[0] < 1:
            inside = middle
        else:
            outside = middle
    return inside


def softest_wall_n_per_m(device: Device) -> float:
    """Return 1 N/m at the hand, the softest wall of a search."""
    return device.metres_per_unit**2


def stiffest_wall(device: Device, subjects: Hand | StylusHand) -> DampingRange:
    """Return the stiffest wall that is stable with every hand for some damping, to 0.01 %.

    For each damping the boundary curves give the largest stable stiffness. It is 0, and the damping not a number,
    without any mass, or where no damping stabilises 1 N/m at the hand.
    """
    none = DampingRange(0.0, np.nan, np.nan)
    if device.mass_kg + float(np.min(subjects.mass_kg)) == 0:
        return none
    loops, corners = _Loops.of(device, subjects), device_corners(device, LINEAR_KEYS)
    damping, stiffest, best = np.linspace(0.0, loops.most_damping_ns_per_m, _COARSE), 0.0, 0
    for _ in range(1 + _ZOOMS):
        largest = np.nan_to_num(stable_walls(corners, subjects, damping).first_n_per_m)
        best = int(np.argmax(largest))
        stiffest, known = float(largest[best]), float(damping[best])
        damping = np.linspace(damping[max(best - 1, 0)], damping[min(best + 1, len(damping) - 1)], _FINE)
    stiffest *= 1 - _BELOW
    return none if stiffest < softest_wall_n_per_m(device) else _damping_range(loops, stiffest, known)
