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
from avc_casadi.loops.spectrum import ClosedLoops, lowest, root
from avc_casadi.loops.wall import closed, plants_of
from avc_casadi.model.corners import LINEAR_KEYS, device_corners
from avc_casadi.model.device import Device
from avc_casadi.model.hands import Hand, StylusHand
from avc_casadi.model.law import Law
from avc_casadi.model.plant import sampled_plant
from avc_casadi.model.runtime import PLAIN, Poles, low_pass


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
    corners: Sequence[Device], hands: Hand | StylusHand, damping_ns_per_m: FloatArray, poles: Poles = PLAIN
) -> Stretches:
    """Find the stiffnesses with which a wall is stable with every hand at every corner of a device."""
    rows = len(damping_ns_per_m)
    loops = _Curves.of(corners, hands, poles)
    if loops is None:
        return Stretches(np.full((rows, 1), np.nan), np.full((rows, 1), np.nan))
    nodes = _nodes(loops, corners, float(damping_ns_per_m.max(initial=0.0)))
    outside = np.zeros(rows, dtype=np.intp)
    events: list[tuple[IndexArray, FloatArray, IndexArray]] = []
    at_once = max(1, 8_000_000 // (rows * nodes.shape[1]))
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
    output: int
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
            output=int(np.argmax(plant.output_row)),
            free=np.tile(np.broadcast_to(np.asarray(back) == 0, (h,)), len(corners)),
            sample_time_s=first.sample_time_s,
            poles=poles,
        )

    def pick(self, cases: IndexArray | slice) -> _Curves:
        """Return some of the cases."""
        some: dict[str, Any] = {name: each[cases] for name, each in vars(self).items() if isinstance(each, np.ndarray)}
        return replace(self, **some)

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
            columns: list[Any] = [(step - d) * u[:, 0][case] + b * u[:, 1][case] for u in (self.new, self.old)]
        else:
            eye = np.eye(change.shape[-1])
            pushes = np.stack([self.new, self.old], axis=-1)[case]
            states = np.linalg.solve(step[..., None, None] * eye - change[case], pushes.astype(np.complex128))
            denominator, columns = np.ones_like(step), [states[..., self.output, index] for index in (0, 1)]
        numerator = columns[0] + columns[1] * (1 + step.conj()) if self.old.any() else columns[0]
        late = np.exp(1j * angle * self.whole_delay[case]) if self.whole_delay.any() else 1.0
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(denominator / numerator * late), damper


def _nodes(loops: _Curves, corners: Sequence[Device], most_damping_ns_per_m: float) -> FloatArray:
    """Return angles, shape (cases, m), between which B(theta) is monotone."""
    delay = max(corner.delay_samples for corner in corners)
    # Walls softer than m (theta/T)^2 at the first angle, m the total moving mass, are taken as that one.
    low = np.geomspace(1e-7, 0.1, 121)
    even = np.linspace(0.0, np.pi, 1 + 12 * math.ceil(delay + 3))[1:-1]
    common = np.unique(np.concatenate([low, even, np.pi - low]))
    angle = np.broadcast_to(common, (len(loops.new), len(common)))
    if loops.change.shape[-1] > 2:
        poles = 1 + np.linalg.eigvals(loops.change).astype(np.complex128)
        width = np.maximum(np.abs(np.log(np.maximum(np.abs(poles), 1e-9))), 1e-4)[..., None]
        bandwidths = np.array([0.0, 0.3, 1.0, 3.0, 10.0, 30.0])
        about = np.abs(np.angle(poles))[..., None] + width * np.concatenate([-bandwidths, bandwidths])
        angle = np.sort(np.concatenate([angle, np.clip(about.reshape(len(angle), -1), low[0], np.pi - low[0])], axis=1))
    inverse, damper = loops.response(angle)
    # A zero of the device near the circle turns the phase of L by pi within few nodes: more are inserted.
    for _ in range(40):
        far = np.abs(np.angle(inverse[:, 1:] * inverse[:, :-1].conj())) > 0.4
        far &= np.diff(angle) > 1e-9 * angle[:, 1:]
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
    some, down = loops.pick(case), curve[case, index] < curve[case, index - 1]

    def upright(at: FloatArray) -> FloatArray:
        inverse, damper = some.response(at)
        return np.asarray(np.where(down, 1, -1) * inverse.imag / damper.imag)

    best = lowest(upright, *(angle[case, index + side] for side in (-1, 0, 1)))
    extremum = angle.copy()
    extremum[case, index] = best
    return _insert(angle, turns, extremum)


def _insert(angle: FloatArray, where: BoolArray, at: FloatArray) -> FloatArray:
    """Merge new nodes into those of each case; a case with fewer of them repeats its first node."""
    case, index = np.nonzero(where)
    place = (np.cumsum(where, axis=1) - 1)[case, index]
    new = np.repeat(angle[:, :1], int(where.sum(axis=1).max()), axis=1)
    new[case, place] = at[case, index]
    return np.sort(np.concatenate([angle, new], axis=1))


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

    inverse, damper = some.response(root(beyond, angle[case, index], angle[case, index + 1]))
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

    at = ratio(root(lambda at: ratio(at).imag, angle[case, index], angle[case, index + 1])).real
    # Poles of a device and hand without any damping are on the circle at B = 0, but for rounding: out only if B drives.
    at[np.abs(at) < 1e-9 * np.median(np.abs(slope), axis=1)[case]] = 0
    inverse, damper = loops.response(np.full(len(angle), np.pi))
    places = np.concatenate([at, np.nan_to_num((inverse / damper).real, nan=np.inf)])
    leaving = np.concatenate([np.where(slope[case, index] > 0, -2, 2), np.where(slope[:, -1] > 0, -1, 1)])
    below = ((places > 0) | ((places == 0) & (leaving > 0))) & (places < damping[:, None])
    # Without damping a spring with any delay at all destabilises a free mass.
    falling = 2 * (loops.free & (curve[:, 0] >= damping[:, None]))
    return np.asarray((below * leaving).sum(axis=1) + falling.sum(axis=1))


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


def in_contact(device: Device, subjects: Hand | StylusHand, k: float, b: float) -> ClosedLoops:
    """Return the loop of one spring, of either sign, and damper, with every hand at every corner of a device."""
    pairs = Body.of(sampled_plant(device_corners(device, LINEAR_KEYS), subjects)).flat()
    return closed(pairs, Law.spring_damper(k, b, pairs.sample_time_s))


@dataclass(frozen=True)
class DampingRange:
    """Damping of a wall within which every hand is stable."""

    stiffness_n_per_m: float
    lowest_ns_per_m: float
    highest_ns_per_m: float


def damping_range(device: Device, subjects: Hand | StylusHand, stiffness_n_per_m: float) -> DampingRange:
    """Return the damping, one interval, with which a wall is stable with every hand at every corner of the device."""
    for scan, walls in _scans(device, subjects):
        inside = np.flatnonzero(walls.holds(stiffness_n_per_m))
        if len(inside):
            return _between_edges(device, subjects, stiffness_n_per_m, scan, inside)
    return DampingRange(stiffness_n_per_m, np.nan, np.nan)


def softest_wall_n_per_m(device: Device) -> float:
    """Return 1 N/m at the hand, the softest wall of a search."""
    return device.metres_per_unit**2


def stiffest_wall(device: Device, subjects: Hand | StylusHand) -> DampingRange:
    """Return the stiffest wall that is stable with every hand for some damping, to 0.01 %."""
    stiffest = 0.0
    if device.mass_kg + float(np.min(subjects.mass_kg)) > 0:
        for scan, walls in _scans(device, subjects):
            best = int(np.argmax(np.nan_to_num(walls.first_n_per_m)))
            stiffest, damping = float(np.nan_to_num(walls.first_n_per_m)[best]), scan[best]
    # So far below the boundary eigenvalues confirm it.
    stiffest *= 1 - 5e-5
    if stiffest < softest_wall_n_per_m(device):
        return DampingRange(0.0, np.nan, np.nan)
    scan = np.array([0.0, damping, _most_damping(device, subjects)])
    return _between_edges(device, subjects, stiffest, scan, np.array([1]))


def _most_damping(device: Device, subjects: Hand | StylusHand) -> float:
    """Return 2 m/T of the total moving mass: more damping stabilises no wall."""
    heaviest = max(corner.mass_kg for corner in device_corners(device, LINEAR_KEYS)) + float(np.max(subjects.mass_kg))
    return 2 * heaviest / device.sample_time_s


def _scans(device: Device, subjects: Hand | StylusHand) -> Iterator[tuple[FloatArray, Stretches]]:
    """Yield dampings with their stable walls, twice more about the one with the stiffest wall."""
    corners, scan = device_corners(device, LINEAR_KEYS), np.linspace(0.0, _most_damping(device, subjects), 61)
    for _ in range(3):
        walls = stable_walls(corners, subjects, scan)
        yield scan, walls
        best = int(np.argmax(np.nan_to_num(walls.first_n_per_m)))
        scan = np.linspace(scan[max(best - 1, 0)], scan[min(best + 1, len(scan) - 1)], 61)


def _between_edges(
    device: Device, subjects: Hand | StylusHand, stiffness_n_per_m: float, scan: FloatArray, inside: IndexArray
) -> DampingRange:
    """Return the range of stable dampings, its ends by bisection, from a scan and the stable ones in it."""
    # Linear in the damping.
    undamped, damped = (in_contact(device, subjects, stiffness_n_per_m, b) for b in (0.0, 1.0))

    def radius(damping: float, some: slice = slice(None)) -> FloatArray:
        none, one = undamped.maps[some], damped.maps[some]
        return replace(undamped, maps=none + damping * (one - none)).radius

    def edge(stable: float, unstable: float) -> float:
        while stable != unstable:
            every = radius(unstable)
            worst = int(np.argmax(every))
            if every[worst] < 1:
                break
            inside = stable
            for _ in range(50):
                middle = (inside + unstable) / 2
                fits = radius(middle, slice(worst, worst + 1))[0] < 1
                inside, unstable = (middle, unstable) if fits else (inside, middle)
            unstable = inside
        return unstable

    low, high = inside[0], inside[-1]
    ends = edge(scan[low], scan[max(low - 1, 0)]), edge(scan[high], scan[min(high + 1, len(scan) - 1)])
    return DampingRange(stiffness_n_per_m, float(ends[0]), float(ends[1]))
