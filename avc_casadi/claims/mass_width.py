"""The region of virtual masses and dampings that an admittance device can render: the M-width.

At each damping a scan of masses finds those that are stable, and those with a sound disk margin, at the corners of the
ranges and at the worst points of searches; their ends are found by bisection.
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
from avc_casadi.loops.margins import SOUND_DISK
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
# Angles at which a loop is looked at: evenly in their logarithm, and about each pole of the plant.
_EVEN_TURNS = 420
_LOWEST_TURN = 1e-4
_ABOUT_A_POLE = 13
# Laws on the edge from which the ranges are searched for worse plants.
_SEARCHED = 4
# The rough disk margin of `HandleResponse` is right to two per cent, but for a lightly damped sensor (0.209 for 0.193
# at a damping ratio of 0.02): what `recommend` chooses is confirmed by the exact one.
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

    def radii(self, law: Law) -> FloatArray:
        """Return the largest spectral radius of each of n laws."""
        loops = closed(self.body, law.pick((slice(None), None)))
        return np.asarray(loops.radius.max(axis=-1))

    def disk_margins(self, law: Law) -> FloatArray:
        """Return the smallest disk margin of each of n laws, without asking whether their loops are stable."""
        by_position = law.transfer(self.z[:, None], 0).T[:, None]
        by_force = law.transfer(self.z[:, None], 1).T[:, None]
        gain = -(by_position * self.measured[..., 0] + by_force * self.measured[..., 1])
        with np.errstate(divide="ignore", invalid="ignore"):
            swing = np.nan_to_num(np.abs((1 - gain) / (1 + gain)), nan=1.0, posinf=np.inf)
        return np.asarray(2 / swing.max(axis=(1, 2)))

    def sound(self, law: Law, limit: float = _SOUND_ROUGHLY) -> BoolArray:
        """Return which of n laws are stable with a disk margin of at least a limit."""
        sound = self.stable(law)
        stable = np.flatnonzero(sound)
        if stable.size:
            sound[stable] = self.disk_margins(law.pick(stable)) >= limit
        return sound

    def stable(self, law: Law) -> BoolArray:
        """Return which of n laws are stable."""
        return np.asarray(self.radii(law) < 1)


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

    def least_damping(self, masses_kg: FloatArray, *, sound: bool) -> float:
        """Return the least damping with a mass: between the first of the scan that has one and the one before."""
        dampings = self.scales.dampings_ns_per_m
        known = np.flatnonzero(np.isfinite(masses_kg))
        if not known.size:
            return math.nan
        first = int(known[0])
        held = float(dampings[first])
        other = float(dampings[max(first - 1, 0)])
        for _ in range(_DAMPING_BISECTIONS if first else 0):
            middle = math.sqrt(held * other)
            if math.isnan(self.at(middle, sound=sound).low):
                other = middle
            else:
                held = middle
        return held


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
    first = MassSpans.of(analysis, own)
    dampings = first.scales.dampings_ns_per_m
    # What is the worst on the edge of the region joins the plants of its curves.
    total = _SEARCHED + _DAMPINGS
    for number, damping in enumerate(dampings[_DAMPINGS // _SEARCHED - 1 :: _DAMPINGS // _SEARCHED].tolist()):
        progress.advance(number, total, "hands and contacts")
        edge = first.at(damping, sound=True)
        if math.isfinite(edge.low):
            mass = edge.low or float(first.scales.masses_kg[0])
            analysis.confirmed_margin(own.model_copy(update={"mass_kg": mass, "damping_ns_per_m": damping}))
    spans = MassSpans.of(analysis, own)
    stable, sound = [], []
    for row, damping in enumerate(dampings.tolist()):
        stable.append(spans.at(damping, sound=False))
        sound.append(spans.at(damping, sound=True))
        progress.advance(_SEARCHED + row + 1, total, "dampings")
    least = np.array([found.low for found in stable])
    sound_least = np.array([found.low for found in sound])
    return MassWidth(
        damping_ns_per_m=dampings,
        least_damping_ns_per_m=spans.least_damping(least, sound=False),
        least_sound_damping_ns_per_m=spans.least_damping(sound_least, sound=True),
        least_kg=least,
        largest_kg=np.array([found.high for found in stable]),
        sound_least_kg=sound_least,
        sound_largest_kg=np.array([found.high for found in sound]),
        cutoff_hz=own.cutoff_hz,
        problem=stated,
    )
