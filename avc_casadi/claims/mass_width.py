"""The region of virtual masses and dampings that an admittance device can render: the M-width.

At each damping a scan of masses finds those that are stable, and those with a sound disk margin, at the corners of the
ranges; their ends are found by bisection. Searches of the ranges confirm ends: a plant with which a law on the edge is
not stable or sound joins the corners, until there is none.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray
from avc_casadi._util.json_values import plain
from avc_casadi._util.printed import Columns, Tabular, short
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.claims.admittance import HandleAnalysis
from avc_casadi.files.admittance_file import AnyAdmittance, as_admittance
from avc_casadi.loops.handle import Pair, plants_of
from avc_casadi.loops.loop import Body
from avc_casadi.loops.margins import SOUND_DISK, OpenLoop, angles_about, swing
from avc_casadi.loops.spectrum import ClosedLoops
from avc_casadi.loops.wall import closed
from avc_casadi.model.admittance import AdmittanceProblem, VirtualImpedance, virtual_mass_law
from avc_casadi.model.law import Law

# Dampings of a curve and masses of a scan, and by how much they span the scales of a device: contact stiffness times
# lag is a damping, and that times the lag a mass.
_DAMPINGS = 40
_MASSES = 56
_DAMPING_SHARES = (0.02, 50.0)
_MASS_SHARES = (1e-3, 300.0)
# Of a handle and a hand the mass is at least this share and at most this multiple.
_HANDLE_SHARES = (0.03, 30.0)
# Bisections between two masses of a scan: to 1e-5 of it.
_BISECTIONS = 12
# Bisections of the least damping: to a thousandth of it.
_DAMPING_BISECTIONS = 8
# Angles at which every loop is looked at: evenly in their logarithm, and about each pole of the plant.
_EVEN_TURNS = 420
_LOWEST_TURN = 1e-4
_ABOUT_A_POLE = 13
# A closed loop of a smaller bandwidth, as a share of the angle of its pole, may have its peak between these angles,
# which lie 2.5 per cent apart. So many angles about such a pole show its peak to 1.4 per cent, others to 0.8.
_NARROW = 0.1
_ABOUT_A_NARROW_POLE = 25
# Dampings whose ends searches confirm, and how often an end is searched that plants refuse.
_CONFIRMED = 6
_SEARCHES = 5
# A disk margin of `VelocityResponse` is at most two per cent too large.
_SOUND_ROUGHLY = 1.02 * SOUND_DISK


class VelocityResponse:
    """Frequency responses of plants, which laws share: from the commanded velocity to position and force."""

    def __init__(self, pairs: Sequence[Pair]) -> None:
        self.body = Body.of(plants_of(pairs)).flat()
        poles = np.linalg.eigvals(self.body.a).ravel()
        poles = poles[np.abs(poles) > _LOWEST_TURN]
        width = np.maximum(np.abs(1 - np.abs(poles)), _LOWEST_TURN)[:, None]
        about = np.abs(np.angle(poles))[:, None] + width * np.sinh(np.linspace(-3.0, 3.0, _ABOUT_A_POLE))
        even = np.geomspace(_LOWEST_TURN, math.pi, _EVEN_TURNS)
        inside = about[(about > _LOWEST_TURN) & (about < math.pi)]
        turns = np.unique(np.concatenate([even, np.round(inside, 4)]))
        self.z: ComplexArray = np.exp(1j * turns)
        pencil = self.z[:, None, None] * np.eye(self.body.size) - self.body.a[:, None]
        push = np.broadcast_to(self.body.b[:, None, :, None], (*pencil.shape[:-1], 1)).astype(np.complex128)
        states = np.linalg.solve(pencil, push)[..., 0]
        # What the law reads at each angle, (plants, angles, 2).
        self.measured: ComplexArray = states @ np.swapaxes(self.body.measured, -1, -2)

    def disk_margins(self, law: Law) -> FloatArray:
        """Return the smallest disk margin of each of n laws, without asking whether their loops are stable."""
        return self._disk_margins(law, self._loops(law).poles)

    def sound(self, law: Law, limit: float = _SOUND_ROUGHLY) -> BoolArray:
        """Return which of n laws are stable with a disk margin of at least a limit."""
        poles = self._loops(law).poles
        sound = np.asarray(np.abs(poles).max(axis=(1, 2)) < 1)
        stable = np.flatnonzero(sound)
        if stable.size:
            sound[stable] = self._disk_margins(law.pick(stable), poles[stable]) >= limit
        return sound

    def stable(self, law: Law) -> BoolArray:
        """Return which of n laws are stable."""
        return np.asarray(self._loops(law).radius.max(axis=-1) < 1)

    def _loops(self, law: Law) -> ClosedLoops:
        """Return the loops of each law around each plant."""
        return closed(self.body, law.pick((slice(None), None)))

    def _disk_margins(self, law: Law, poles: ComplexArray) -> FloatArray:
        """Return the smallest disk margin of each of n laws, whose loops have poles (n, plants, s)."""
        by_position = law.transfer(self.z[:, None], 0).T[:, None]
        by_force = law.transfer(self.z[:, None], 1).T[:, None]
        gain = -(by_position * self.measured[..., 0] + by_force * self.measured[..., 1])
        largest = swing(gain).max(axis=(1, 2))
        turn, bandwidth = np.angle(poles), np.abs(1 - np.abs(poles))
        laws, plants, _ = narrow = np.nonzero((turn > _LOWEST_TURN) & (bandwidth < _NARROW * turn))
        about = angles_about(poles[narrow][:, None], _ABOUT_A_NARROW_POLE)
        angles = np.clip(about, _LOWEST_TURN, math.pi)
        loops = OpenLoop.of_bodies(self.body.axes(plants), law.pick(laws))
        np.maximum.at(largest, laws, swing(loops.gain(angles)).max(axis=-1))
        return np.asarray(2 / largest)


@dataclass(frozen=True)
class LawScales:
    """Masses and dampings between which the region of a device lies."""

    masses_kg: FloatArray
    dampings_ns_per_m: FloatArray

    @classmethod
    def of(cls, problem: AdmittanceProblem, cutoff_hz: float | None) -> LawScales:
        """Return those of a problem: with k the stiffest that it meets and tau its lag, k tau and k tau^2.

        The lag is the delay and half a sample, that of the drive and that of the filter.
        """
        device, hands = problem.device, problem.hands
        lags = [device.drive_bandwidth_hz, *([cutoff_hz] if cutoff_hz else [])]
        lag = (device.delay_samples + 0.5) * device.sample_time_s + sum(1 / (2 * math.pi * hz) for hz in lags)
        stiffest = hands.stiffness_n_per_m[1] + problem.contact.stiffest_contact_n_per_m
        carried = device.force_sensor.handle_mass_kg + hands.mass_kg[1]
        damping = max(stiffest * lag, carried / lag * 1e-2)
        lightest = min(_MASS_SHARES[0] * damping * lag, _HANDLE_SHARES[0] * carried)
        heaviest = max(_MASS_SHARES[1] * damping * lag, _HANDLE_SHARES[1] * carried)
        return cls(
            masses_kg=np.geomspace(lightest, heaviest, _MASSES),
            dampings_ns_per_m=np.geomspace(damping * _DAMPING_SHARES[0], damping * _DAMPING_SHARES[1], _DAMPINGS),
        )


@dataclass(frozen=True)
class Span:
    """Lowest and highest value of a run of a scan that hold; not a number where none does.

    The highest is infinite where the last value of the scan holds, the lowest 0 where the first does.
    """

    low: float
    high: float


def held_span(holds: Callable[[FloatArray], BoolArray], scan: FloatArray) -> Span:
    """Return the longest run of values of a scan that hold, its ends by bisection."""
    inside = np.flatnonzero(holds(scan))
    if not inside.size:
        return Span(math.nan, math.nan)
    runs = np.split(inside, np.flatnonzero(np.diff(inside) > 1) + 1)
    longest = max(runs, key=len)
    first, last = int(longest[0]), int(longest[-1])

    def edge(held: float, other: float) -> float:
        for _ in range(_BISECTIONS):
            middle = math.sqrt(held * other)
            if holds(np.array([middle]))[0]:
                held = middle
            else:
                other = middle
        return held

    low = edge(float(scan[first]), float(scan[first - 1])) if first else 0.0
    high = edge(float(scan[last]), float(scan[last + 1])) if last + 1 < len(scan) else math.inf
    return Span(low, high)


@dataclass(frozen=True)
class MassSpans:
    """The masses that hold at a damping, with the spring and the low pass of a law."""

    response: VelocityResponse
    scales: LawScales
    base: VirtualImpedance
    sample_time_s: float

    @classmethod
    def of(cls, analysis: HandleAnalysis, base: VirtualImpedance) -> Self:
        """Return those of the plants of an analysis."""
        scales = LawScales.of(analysis.problem, base.cutoff_hz)
        return cls(VelocityResponse(analysis.pairs), scales, base, analysis.period_s)

    def laws(self, masses_kg: FloatArray | float, dampings_ns_per_m: FloatArray | float) -> Law:
        """Return the laws of masses and dampings."""
        spring, cutoff_hz = self.base.stiffness_n_per_m, self.base.cutoff_hz
        return virtual_mass_law(masses_kg, dampings_ns_per_m, self.sample_time_s, spring, cutoff_hz)

    def at(self, damping_ns_per_m: float, *, sound: bool) -> Span:
        """Return the masses that are stable, or that have a sound disk margin."""
        holds = self.response.sound if sound else self.response.stable
        return held_span(lambda masses: holds(self.laws(masses, damping_ns_per_m)), self.scales.masses_kg)

    def least_damping(self, *, sound: bool) -> float:
        """Return the least damping with a mass: between the first of the scan that has one and the one before."""
        dampings = self.scales.dampings_ns_per_m.tolist()

        def has_mass(damping: float) -> bool:
            return not math.isnan(self.at(damping, sound=sound).low)

        first = next((row for row, damping in enumerate(dampings) if has_mass(damping)), None)
        if first is None:
            return math.nan
        held = dampings[first]
        other = dampings[max(first - 1, 0)]
        for _ in range(_DAMPING_BISECTIONS if first else 0):
            middle = math.sqrt(held * other)
            if has_mass(middle):
                held = middle
            else:
                other = middle
        return float(held)


class _Edges:
    """The ends of the region at each damping, and the least dampings, for plants that searches add to."""

    def __init__(self, analysis: HandleAnalysis, base: VirtualImpedance) -> None:
        self.analysis = analysis
        self.base = base
        self.spans = MassSpans.of(analysis, base)
        self.dampings = self.spans.scales.dampings_ns_per_m.tolist()

    def confirm(self, damping_ns_per_m: float) -> None:
        """Search the ranges at the ends of the masses of a damping, until no plant refuses them."""
        for low in (True, False):
            sound_kg = self._confirmed_kg(damping_ns_per_m, low=low, sound=True)
            # What ends both is stable where it is sound.
            if sound_kg != self._end_kg(damping_ns_per_m, low=low, sound=False):
                self._confirmed_kg(damping_ns_per_m, low=low, sound=False)

    def _confirmed_kg(self, damping_ns_per_m: float, *, low: bool, sound: bool) -> float:
        """Return an end that searches confirm; the plants that refuse one join the others."""
        mass = math.nan
        for _ in range(_SEARCHES):
            mass = self._end_kg(damping_ns_per_m, low=low, sound=sound)
            if math.isnan(mass) or not self._refused(mass, damping_ns_per_m, sound=sound):
                break
        return mass

    def _end_kg(self, damping_ns_per_m: float, *, low: bool, sound: bool) -> float:
        span = self.spans.at(damping_ns_per_m, sound=sound)
        return span.low if low else span.high

    def least_damping(self, *, sound: bool) -> float:
        """Return the least damping with a mass, which searches confirm."""
        least = math.nan
        for _ in range(_SEARCHES):
            least = self.spans.least_damping(sound=sound)
            if math.isnan(least):
                break
            if not self._refused(self.spans.at(least, sound=sound).low, least, sound=sound):
                break
        return least

    def _refused(self, mass_kg: float, damping_ns_per_m: float, *, sound: bool) -> bool:
        """Return whether a search refuses a law; where the scan met no end, that of its first or last mass."""
        masses = self.spans.scales.masses_kg
        mass = float(np.clip(mass_kg, masses[0], masses[-1]))
        law = self.base.model_copy(update={"mass_kg": mass, "damping_ns_per_m": damping_ns_per_m})
        worse = self.analysis.refusing(law, sound=sound)
        if worse:
            self.analysis.pairs += worse
            self.spans = MassSpans.of(self.analysis, self.base)
        return bool(worse)


@dataclass(frozen=True, eq=False, repr=False)
class MassWidth(Tabular):
    """The virtual masses that a device can render at each damping, with every hand and contact and released.

    Masses are not a number where none holds, 0 and infinite where the scan met no end.

    Attributes:
        damping_ns_per_m: dampings, shape (n,).
        least_kg: the lightest stable mass, shape (n,).
        largest_kg: the heaviest stable mass.
        sound_least_kg: the lightest with a disk margin of 0.2.
        sound_largest_kg: the heaviest with a disk margin of 0.2.
        least_damping_ns_per_m: the least damping with a stable mass; not a number without any.
        least_sound_damping_ns_per_m: the least with a mass of a disk margin of 0.2; not a number without any.
        confirmed_rows: the dampings, by their place, whose masses searches of hands and contacts confirm.
        cutoff_hz: of the low pass of the force; None without one.
        problem: device, hands and contact.

    Example:
        >>> region = avc.mass_width("admittance/cobot")
        >>> bool((region.least_kg <= region.sound_least_kg).any())
        True
    """

    damping_ns_per_m: FloatArray
    least_kg: FloatArray
    largest_kg: FloatArray
    sound_least_kg: FloatArray
    sound_largest_kg: FloatArray
    least_damping_ns_per_m: float
    least_sound_damping_ns_per_m: float
    confirmed_rows: tuple[int, ...]
    cutoff_hz: float | None
    problem: AdmittanceProblem

    def to_dict(self) -> Columns:
        """Return the columns by name with unit, each of shape (n,)."""
        names = ("damping_ns_per_m", "least_kg", "largest_kg", "sound_least_kg", "sound_largest_kg")
        return {name: getattr(self, name) for name in names}

    def _summary(self) -> str:
        return f"{self.problem.name}: sound from {short(self.sound_least_kg, self.units.unit('kg'))}"

    def document(self) -> dict[str, Any]:
        """Return JSON values."""
        law = self.problem.law
        own = {"problem": self.problem.name, "cutoff_hz": self.cutoff_hz, "law": law and law.model_dump()}
        least = {key: getattr(self, key) for key in ("least_damping_ns_per_m", "least_sound_damping_ns_per_m")}
        return self.problem.units.document(plain({**own, **least, **self.to_dict()}))


def mass_width(problem: AnyAdmittance, progress: Progress = SILENT) -> MassWidth:
    """Return which virtual masses an admittance device can render at each damping.

    Spring and low pass are those of the law of the problem, if it has one.

    Args:
        problem: an `AdmittanceProblem`, its file or name.
        progress: told how many searches and dampings are done.

    Raises:
        InputError: a value that is refused.

    Example:
        >>> region = avc.mass_width("admittance/cobot")
        >>> region.damping_ns_per_m.shape == region.least_kg.shape
        True
    """
    stated = as_admittance(problem)
    own = stated.law.admittance if stated.law else VirtualImpedance(mass_kg=1.0, damping_ns_per_m=1.0)
    analysis = HandleAnalysis(stated)
    edges = _Edges(analysis, own)
    total = _CONFIRMED + _DAMPINGS + 2
    progress.advance(0, total, "hands and contacts")
    rows = _spread([edges.spans.at(damping, sound=True) for damping in edges.dampings])
    for number, row in enumerate(rows, 1):
        progress.advance(number, total, "hands and contacts")
        edges.confirm(edges.dampings[row])
    progress.advance(_CONFIRMED + 1, total, "least damping")
    least, least_sound = edges.least_damping(sound=False), edges.least_damping(sound=True)
    stable, sound = [], []
    for row, damping in enumerate(edges.dampings, 1):
        stable.append(edges.spans.at(damping, sound=False))
        sound.append(edges.spans.at(damping, sound=True))
        progress.advance(_CONFIRMED + 1 + row, total, "dampings")
    progress.advance(total, total, "dampings")
    return MassWidth(
        damping_ns_per_m=np.array(edges.dampings),
        least_kg=np.array([span.low for span in stable]),
        largest_kg=np.array([span.high for span in stable]),
        sound_least_kg=np.array([span.low for span in sound]),
        sound_largest_kg=np.array([span.high for span in sound]),
        least_damping_ns_per_m=least,
        least_sound_damping_ns_per_m=least_sound,
        confirmed_rows=tuple(row for row in rows if math.isfinite(sound[row].low)),
        cutoff_hz=own.cutoff_hz,
        problem=stated,
    )


def _spread(spans: Sequence[Span]) -> list[int]:
    """Return places of spans that are known: evenly among all, the first and the last too."""
    known = np.flatnonzero([math.isfinite(span.low) for span in spans])
    places = np.linspace(0, len(known) - 1, min(len(known), _CONFIRMED)).astype(int)
    return [int(row) for row in known[places]]
