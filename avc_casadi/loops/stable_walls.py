"""Walls K + B (1 - 1/z)/T that are linearly stable, by explicit boundary curves (D-decomposition, Neimark 1949).

On z = exp(j theta) the characteristic equation of the sampled loop is linear in K and B:

    K + B q(z) = L(z),   q = (1 - 1/z)(1 + a1 + a2)/(T (1 + a1/z + a2/z^2)),   L = 1/G,

G from the commanded force to the sampled position, a1 and a2 of an estimator of the velocity (`model.runtime`). Real
and imaginary part give one wall (B, K) for each 0 < theta < pi, theta = pi a line, theta = 0 one at K = -k_h. Where
Im(L - B q) rises through 0 a pair of poles leaves the unit circle as K grows, where it falls one comes back: the stable
K of each B follow from all crossings, sorted, and the number of poles outside at K = 0, counted the same way along B.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray, IndexArray
from avc_casadi.loops.loop import Body
from avc_casadi.loops.plant_family import PlantFamily, plants_of
from avc_casadi.loops.spectrum import ClosedLoops, lowest, root
from avc_casadi.loops.wall import closed
from avc_casadi.model.device import Device
from avc_casadi.model.hands import Hand
from avc_casadi.model.law import Law, Values
from avc_casadi.model.plant import sampled_plant
from avc_casadi.model.runtime import PLAIN, Poles, low_pass

# Complex numbers of responses that are held at once.
_VALUES_AT_ONCE = 8_000_000
# Angles between which B(theta) is monotone: the lowest one, how many there are up to 0.1, and over all angles for each
# sample that the loop is late; about poles of a device with a resonance at distances of so many bandwidths.
_LOWEST_TURN = 1e-7
_LOW_NODES = 121
_NODES_PER_SAMPLE = 12
_BANDWIDTHS = np.array([0.0, 0.3, 1.0, 3.0, 10.0, 30.0])
_LEAST_WIDTH = 1e-4
# Nodes are inserted until the phase of L turns by less, in rad, or neighbours are the same but for rounding.
_LARGEST_PHASE_STEP = 0.4
_SAME_NODE = 1e-9
_INSERTIONS = 40
# Dampings of a crossing this small, relative to those of the curve, are rounding of none.
_NO_DAMPING = 1e-9
# Dampings of a scan; the second and the third lie between two neighbours of the best one.
_SCANNED = 61
# So far below the boundary that explicit curves give, eigenvalues confirm it.
_CONFIRMED_SHARE = 1 - 5e-5
# Halvings of an interval: to the digits of a float.
_BISECTIONS = 50


@dataclass(frozen=True)
class Stretches:
    """Stiffnesses of a wall for which a claim holds at each of n dampings: m intervals, ascending, shape (n, m)."""

    lowest_n_per_m: FloatArray
    largest_n_per_m: FloatArray

    @property
    def first_n_per_m(self) -> FloatArray:
        """Upper end of the softest interval, shape (n,); not a number where there is none."""
        return self.largest_n_per_m[:, 0]

    def holds(self, stiffness_n_per_m: float) -> BoolArray:
        """Whether the claim holds for a wall at each damping, shape (n,)."""
        inside = (self.lowest_n_per_m <= stiffness_n_per_m) & (stiffness_n_per_m <= self.largest_n_per_m)
        return np.asarray(inside.any(axis=1))


def stable_walls(
    corners: Sequence[Device], hands: Hand, damping_ns_per_m: FloatArray, poles: Poles = PLAIN
) -> Stretches:
    """Return for each damping B, N.s/m, the intervals of stiffness K, N/m, with which a wall K + B v is stable.

    Stable means with every hand at every corner of a device. `poles` are those of the estimator of the velocity v.
    """
    rows = len(damping_ns_per_m)
    loops = _Curves.of(corners, hands, poles)
    if loops is None:
        return Stretches(np.full((rows, 1), np.nan), np.full((rows, 1), np.nan))
    nodes = _nodes(loops, corners, float(damping_ns_per_m.max(initial=0.0)))
    outside = np.zeros(rows, dtype=np.intp)
    crossings: list[_Crossings] = []
    at_once = max(1, _VALUES_AT_ONCE // (rows * nodes.shape[1]))
    for begin in range(0, len(nodes), at_once):
        cases = slice(begin, begin + at_once)
        part = loops.pick(cases)
        inverse, damper = part.response(nodes[cases])
        curve = inverse.imag / damper.imag
        outside += _outside_without_spring(part, nodes[cases], (inverse / damper).imag, curve, damping_ns_per_m)
        crossings += _crossings(part, nodes[cases], inverse.imag, damper.imag, damping_ns_per_m)
    return _stretches(outside, _Crossings.joined(crossings))


@dataclass(frozen=True)
class _Curves:
    """Every corner with every hand from the force to the sampled position, from sample to sample."""

    # A - 1, the columns of the newest force and of the one before, and where no spring restores the device.
    change: FloatArray
    new: FloatArray
    old: FloatArray
    whole_delay: FloatArray
    output: int
    free: BoolArray
    sample_time_s: float
    poles: Poles

    @classmethod
    def of(cls, corners: Sequence[Device], hands: Hand, poles: Poles) -> _Curves | None:
        """Return the sampled motion of every corner with every hand; None if one of them has no mass to move."""
        h = len(hands)
        plant = plants_of(corners, hands)
        s = len(plant.names)
        # In metres per sample, velocities are of the size of positions.
        scale = np.array([plant.sample_time_s if name.endswith("_per_s") else 1.0 for name in plant.names])
        matrix = (plant.matrix * scale[:, None] / scale).reshape(-1, s, s)
        new = (plant.new * scale).reshape(-1, s)
        old = (plant.old * scale).reshape(-1, s)
        if not (np.isfinite(matrix).all() and np.isfinite(new).all()):
            return None
        return cls(
            change=matrix - np.eye(matrix.shape[-1]),
            new=new,
            old=old,
            whole_delay=np.repeat([math.floor(corner.delay_samples) for corner in corners], h).astype(np.float64),
            output=int(np.argmax(plant.output_row)),
            free=np.tile(np.broadcast_to(np.asarray(hands.stiffness_n_per_m) == 0, (h,)), len(corners)),
            sample_time_s=plant.sample_time_s,
            poles=poles,
        )

    def pick(self, cases: IndexArray | slice) -> _Curves:
        """Return some of the cases, each a corner of the device with a hand."""
        return replace(
            self,
            change=self.change[cases],
            new=self.new[cases],
            old=self.old[cases],
            whole_delay=self.whole_delay[cases],
            free=self.free[cases],
        )

    def response(self, angle: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        """Return L = 1/G (N/m) and q (1/s) at angles theta of the cases, shape (cases) or (cases, m), z = exp(j theta).

        G is the sampled position over the commanded force of device and hand, with its delay, and q = (1 - 1/z)/T
        behind the estimator's low pass: K + B q = L is the stability limit of a wall.
        """
        case = (slice(None), *(None,) * (angle.ndim - 1))
        step = np.empty(angle.shape, dtype=np.complex128)
        # z - 1, exact at small angles too.
        step.real = -2 * np.sin(angle / 2) ** 2
        step.imag = np.sin(angle)
        back = -step.conj()
        damper = back / self.sample_time_s * low_pass(back, self.poles)
        change = self.change
        if change.shape[-1] == 2:
            a, b, c, d = (change[:, i, j][case] for i in (0, 1) for j in (0, 1))
            denominator = step**2 - step * (a + d) + (a * d - b * c)
            columns: list[Any] = [(step - d) * u[:, 0][case] + b * u[:, 1][case] for u in (self.new, self.old)]
        else:
            eye = np.eye(change.shape[-1])
            pushes = np.stack([self.new, self.old], axis=-1)[case]
            states = np.linalg.solve(step[..., None, None] * eye - change[case], pushes.astype(np.complex128))
            denominator = np.ones_like(step)
            columns = [states[..., self.output, index] for index in (0, 1)]
        numerator = columns[0] + columns[1] * (1 + step.conj()) if self.old.any() else columns[0]
        late = np.exp(1j * angle * self.whole_delay[case]) if self.whole_delay.any() else 1.0
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(denominator / numerator * late), damper


def _nodes(loops: _Curves, corners: Sequence[Device], most_damping_ns_per_m: float) -> FloatArray:
    """Return angles theta, shape (cases, m), between which B(theta) = Im L/Im q of the stability limit is monotone.

    L = 1/G is N/m over the device with hand, q 1/s of the velocity: K + B q = L. Angles are even, dense at poles, added
    where the phase of L jumps, and where B has an extremum below 8 times the largest damping that is asked for.
    """
    delay = max(corner.delay_samples for corner in corners)
    # Walls softer than m (theta/T)^2 at the first angle, m the total moving mass, are taken as that one.
    low = np.geomspace(_LOWEST_TURN, 0.1, _LOW_NODES)
    even = np.linspace(0.0, np.pi, 1 + _NODES_PER_SAMPLE * math.ceil(delay + 3))[1:-1]
    common = np.unique(np.concatenate([low, even, np.pi - low]))
    angle = np.broadcast_to(common, (len(loops.new), len(common)))
    if loops.change.shape[-1] > 2:
        poles = 1 + np.linalg.eigvals(loops.change).astype(np.complex128)
        width = np.maximum(np.abs(np.log(np.maximum(np.abs(poles), 1e-9))), _LEAST_WIDTH)[..., None]
        about = np.abs(np.angle(poles))[..., None] + width * np.concatenate([-_BANDWIDTHS, _BANDWIDTHS])
        angle = np.sort(np.concatenate([angle, np.clip(about.reshape(len(angle), -1), low[0], np.pi - low[0])], axis=1))
    inverse, damper = loops.response(angle)
    # A zero of the device near the circle turns the phase of L by pi within few nodes: more are inserted.
    for _ in range(_INSERTIONS):
        far = np.abs(np.angle(inverse[:, 1:] * inverse[:, :-1].conj())) > _LARGEST_PHASE_STEP
        far &= np.diff(angle) > _SAME_NODE * angle[:, 1:]
        if not far.any():
            break
        angle = _insert(angle, far, (angle[:, 1:] + angle[:, :-1]) / 2)
        inverse, damper = loops.response(angle)
    curve = inverse.imag / damper.imag
    rise = np.diff(curve)
    turns = np.zeros(curve.shape, dtype=bool)
    turns[:, 1:-1] = (rise[:, 1:] * rise[:, :-1] < 0) & (np.maximum(curve[:, 2:], curve[:, :-2]) > 0)
    turns &= np.isfinite(curve) & (curve < 8 * most_damping_ns_per_m)
    case, index = np.nonzero(turns)
    if len(case) == 0:
        return angle
    turning = loops.pick(case)
    down = curve[case, index] < curve[case, index - 1]

    def upright(angles: FloatArray) -> FloatArray:
        inverse, damper = turning.response(angles)
        return np.asarray(np.where(down, 1, -1) * inverse.imag / damper.imag)

    extremum = angle.copy()
    extremum[case, index] = lowest(upright, angle[case, index - 1], angle[case, index], angle[case, index + 1])
    return _insert(angle, turns, extremum)


def _insert(angle: FloatArray, where: BoolArray, new_angle: FloatArray) -> FloatArray:
    """Merge new nodes into those of each case; a case with fewer of them repeats its first node."""
    case, index = np.nonzero(where)
    place = (np.cumsum(where, axis=1) - 1)[case, index]
    new = np.repeat(angle[:, :1], int(where.sum(axis=1).max()), axis=1)
    new[case, place] = new_angle[case, index]
    return np.sort(np.concatenate([angle, new], axis=1))


@dataclass(frozen=True, eq=False)
class _Crossings:
    """Where poles cross the unit circle as K grows: row of B, K, and how many leave; shape (n,)."""

    row: IndexArray
    stiffness: FloatArray
    leaving: IndexArray

    @classmethod
    def joined(cls, parts: Sequence[_Crossings]) -> _Crossings:
        """Return the crossings of all parts."""
        return cls(
            row=np.concatenate([part.row for part in parts]),
            stiffness=np.concatenate([part.stiffness for part in parts]),
            leaving=np.concatenate([part.leaving for part in parts]),
        )

    def pick(self, chosen: IndexArray | BoolArray) -> _Crossings:
        """Return some of them, or all in another order."""
        return _Crossings(self.row[chosen], self.stiffness[chosen], self.leaving[chosen])


def _crossings(
    loops: _Curves, angle: FloatArray, inverse_imag: FloatArray, damper_imag: FloatArray, damping: FloatArray
) -> list[_Crossings]:
    """Return at which stiffness K poles cross the unit circle for each damping B, and how many leave there.

    Between two angles, where Im(L - B q) changes sign, a pair crosses; at half the sample rate a single pole does.
    `inverse_imag` is Im L and `damper_imag` Im q at the angles of each case, `damping` the B, N.s/m.
    """
    above = inverse_imag > damping[:, None, None] * damper_imag
    flips = above[..., 1:] != above[..., :-1]
    row, case, index = np.unravel_index(np.flatnonzero(flips), flips.shape)
    crossing = loops.pick(case)
    b = damping[row]

    def beyond(angles: FloatArray) -> FloatArray:
        inverse, damper = crossing.response(angles)
        return np.asarray(inverse.imag - b * damper.imag)

    inverse, damper = crossing.response(root(beyond, angle[case, index], angle[case, index + 1]))
    stiffness = inverse.real - b * damper.real
    leaving = np.where(above[row, case, index], -2, 2)
    all_rows, all_cases = (axis.ravel() for axis in np.indices((len(damping), len(angle))))
    inverse, damper = loops.response(np.full(len(angle), np.pi))
    # A mass without damping has no response at Nyquist.
    at_nyquist = np.nan_to_num(inverse.real, nan=np.inf)[all_cases] - damping[all_rows] * damper.real[all_cases]
    real = np.where(above[..., -1].ravel(), -1, 1)
    return [_Crossings(row, stiffness, leaving), _Crossings(all_rows, at_nyquist, real)]


def _outside_without_spring(
    loops: _Curves, angle: FloatArray, slope: FloatArray, curve: FloatArray, damping: FloatArray
) -> IndexArray:
    """Return how many poles of all cases lie outside the circle at each damping B, for a spring K just above 0.

    They are counted along B: where Im(L/q) changes sign a pair crosses at B = Re(L/q). `slope` is Im(L/q), `curve` Im
    L/Im q at the angles, `damping` the B, N.s/m.
    """
    case, index = np.nonzero((slope[:, 1:] > 0) != (slope[:, :-1] > 0))
    crossing = loops.pick(case)

    def ratio(angles: FloatArray) -> ComplexArray:
        inverse, damper = crossing.response(angles)
        return np.asarray(inverse / damper)

    between = ratio(root(lambda angles: ratio(angles).imag, angle[case, index], angle[case, index + 1])).real
    # Poles of a device and hand without any damping are on the circle at B = 0, but for rounding: out only if B drives.
    between[np.abs(between) < _NO_DAMPING * np.median(np.abs(slope), axis=1)[case]] = 0
    inverse, damper = loops.response(np.full(len(angle), np.pi))
    places = np.concatenate([between, np.nan_to_num((inverse / damper).real, nan=np.inf)])
    leaving = np.concatenate([np.where(slope[case, index] > 0, -2, 2), np.where(slope[:, -1] > 0, -1, 1)])
    below = ((places > 0) | ((places == 0) & (leaving > 0))) & (places < damping[:, None])
    # Without damping a spring with any delay at all destabilises a free mass.
    falling = 2 * (loops.free & (curve[:, 0] >= damping[:, None]))
    return np.asarray((below * leaving).sum(axis=1) + falling.sum(axis=1))


def _stretches(outside: IndexArray, crossings: _Crossings) -> Stretches:
    """Return the intervals of K without poles outside the unit circle, of each damping B.

    `outside` is the number of poles outside at K = 0; each crossing adds those that leave there.
    """
    positive = crossings.pick(crossings.stiffness > 0)
    ordered = positive.pick(np.lexsort((positive.stiffness, positive.row)))
    # Crossings by row of B, those of fewer filled up to infinity.
    count = np.bincount(ordered.row, minlength=len(outside))
    column = np.arange(len(ordered.row)) - np.repeat(np.cumsum(count) - count, count)
    most = int(count.max(initial=0))
    ends = np.full((len(outside), most), np.inf)
    leaving = np.zeros((len(outside), most), dtype=np.intp)
    ends[ordered.row, column] = ordered.stiffness
    leaving[ordered.row, column] = ordered.leaving
    low = np.pad(ends, ((0, 0), (1, 0)))
    high = np.pad(ends, ((0, 0), (0, 1)), constant_values=np.inf)
    total = outside[:, None] + np.pad(leaving, ((0, 0), (1, 0))).cumsum(axis=1)
    stable = (total == 0) & (high > low)
    width = max(1, int(stable.sum(axis=1).max(initial=0)))
    first = np.argsort(~stable, axis=1, kind="stable")[:, :width]
    is_stable = np.take_along_axis(stable, first, axis=1)
    return Stretches(
        np.where(is_stable, np.take_along_axis(low, first, axis=1), np.nan),
        np.where(is_stable, np.take_along_axis(high, first, axis=1), np.nan),
    )


def in_contact(devices: Sequence[Device], hands: Hand, k: Values, b: Values) -> ClosedLoops:
    """Return the loop of one spring, of either sign, and damper, with every hand on every device, one axis."""
    pairs = Body.of(sampled_plant(devices, hands)).flat()
    return closed(pairs, Law.spring_damper(k, b, pairs.sample_time_s))


@dataclass(frozen=True)
class DampingRange:
    """Damping of a wall within which every hand is stable."""

    stiffness_n_per_m: float
    lowest_ns_per_m: float
    highest_ns_per_m: float


def damping_range(family: PlantFamily, stiffness_n_per_m: float) -> DampingRange:
    """Return the damping, one interval, with which a wall is stable with every hand at every corner of the device."""
    for scan, walls in _scans(family):
        inside = np.flatnonzero(walls.holds(stiffness_n_per_m))
        if len(inside):
            return _between_edges(family, stiffness_n_per_m, scan, inside)
    return DampingRange(stiffness_n_per_m, np.nan, np.nan)


def softest_wall_n_per_m(device: Device) -> float:
    """Return 1 N/m at the hand, the softest wall of a search."""
    return device.metres_per_unit**2


def stiffest_wall(family: PlantFamily) -> DampingRange:
    """Return the stiffest wall, N/m, that is stable with every hand for some damping, to 0.01 %, and its dampings."""
    stiffest = 0.0
    damping = 0.0
    if family.device.mass_kg + float(np.min(family.hands.mass_kg)) > 0:
        for scan, walls in _scans(family):
            limits = np.nan_to_num(walls.first_n_per_m)
            best = int(np.argmax(limits))
            stiffest = float(limits[best])
            damping = scan[best]
    stiffest *= _CONFIRMED_SHARE
    if stiffest < softest_wall_n_per_m(family.device):
        return DampingRange(0.0, np.nan, np.nan)
    scan = np.array([0.0, damping, _most_damping(family)])
    return _between_edges(family, stiffest, scan, np.array([1]))


def _most_damping(family: PlantFamily) -> float:
    """Return 2 m/T of the total moving mass: more damping stabilises no wall."""
    return 2 * family.heaviest_kg / family.device.sample_time_s


def _scans(family: PlantFamily) -> Iterator[tuple[FloatArray, Stretches]]:
    """Yield dampings with their stable walls, twice more about the one with the stiffest wall."""
    scan = np.linspace(0.0, _most_damping(family), _SCANNED)
    for _ in range(3):
        walls = stable_walls(family.devices, family.hands, scan)
        yield scan, walls
        best = int(np.argmax(np.nan_to_num(walls.first_n_per_m)))
        scan = np.linspace(scan[max(best - 1, 0)], scan[min(best + 1, len(scan) - 1)], _SCANNED)


def _between_edges(family: PlantFamily, stiffness_n_per_m: float, scan: FloatArray, inside: IndexArray) -> DampingRange:
    """Return the range of dampings B, N.s/m, with which a wall of a stiffness is stable, its ends by bisection.

    `scan` are dampings in increasing order, `inside` the places of those that are stable.
    """
    # Linear in the damping.
    undamped = in_contact(family.devices, family.hands, stiffness_n_per_m, 0.0)
    per_damping = in_contact(family.devices, family.hands, stiffness_n_per_m, 1.0).maps - undamped.maps

    def radius(damping: float, chosen: slice = slice(None)) -> FloatArray:
        return replace(undamped, maps=undamped.maps[chosen] + damping * per_damping[chosen]).radius

    def edge(stable: float, unstable: float) -> float:
        """Return the limit between two dampings: of the worst loop, until all others hold there."""
        while stable != unstable:
            radii = radius(unstable)
            worst = int(np.argmax(radii))
            if radii[worst] < 1:
                break
            low = stable
            high = unstable
            for _ in range(_BISECTIONS):
                middle = (low + high) / 2
                fits = radius(middle, slice(worst, worst + 1))[0] < 1
                low, high = (middle, high) if fits else (low, middle)
            unstable = low
        return unstable

    first = inside[0]
    last = inside[-1]
    return DampingRange(
        stiffness_n_per_m,
        lowest_ns_per_m=float(edge(scan[first], scan[max(first - 1, 0)])),
        highest_ns_per_m=float(edge(scan[last], scan[min(last + 1, len(scan) - 1)])),
    )
