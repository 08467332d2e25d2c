"""Objective of a robust law: small impedance mismatch, and damping at every sector gain of the dead zone."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.claims.passivity.rendered_impedance import Excitation, dead_zone_gain
from avc_casadi.loops.margins import settling_s
from avc_casadi.loops.spectrum import eigenvalues, largest_radius, worst_radius
from avc_casadi.loops.wall import Laws, force_over_innovation, observed_wall, stiffness_at_rest

if TYPE_CHECKING:
    from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray
    from avc_casadi.design.robust.uncertainty_set import Loops
    from avc_casadi.loops.wall import Rendering
    from avc_casadi.model.runtime import StateFeedback

BAND_HZ = np.array([1.0, 3.0, 10.0, 30.0])
"""Band of hand motion and perception; above half the sample rate a law is evaluated there."""
IMPERCEPTIBLE = 0.05
"""Imperceptible relative difference in stiffness: Weber fractions are 0.08 and more (Jones and Hunter 1990)."""
AT_ONCE_S = 0.25
"""Settling time after release below which no difference is noticed."""
_PER_SETTLING, _PER_SOFTER = 0.3, 0.2
DECAY_PER_S = {1.0: 20.2, 0.5: 15.1, 0.25: 11.1, 0.16: 8.0, 0.09: 4.8, 0.05: 3.6, 0.025: 3.4, 0.01: 0.0}
"""Sector gain of the dead zone -> required decay, 1/s, of oscillations above `_SLOW_HZ`."""
_SLOW_HZ = 2.0
# The same of slower ones, times the sector gain; and the decay needed for a press to reach the static stiffness.
SLOW_DECAY_PER_S, _SETTLES_PER_S = 5.0, 1.0
VARIED_DECAY_PER_S = {1.0: 10.0, 0.5: 5.0}
"""The same with every hand on every device: a structure stiffer than assumed becomes unstable at half gain first."""
RANGED_DECAY_PER_S = {0.7: 2.0, 0.4: 2.0, 0.25: 1.5, 0.16: 1.0, 0.09: 0.5, 0.05: 0.5, 0.025: 0.3, 0.01: 0.1}
"""The same on devices of the declared ranges, for which stability is claimed at every sector gain."""
# Required decay of the released device.
FREE_DECAY_PER_S = 1.0
# Required decay with stylus grips and fingertips, which are outside the design set.
BESIDE_DECAY_PER_S = 2.0
# Cost of missing decay, for each 1/s.
PER_DECAY = 1.0
# Softness and spectral radius beyond which a law is not evaluated further.
REJECTED_SOFTNESS, _REJECTED_RADIUS = 0.6, 1.03
_BUZZ_HZ = 40.0


# Bounds of |C/K - 1|, C the force over measured position: at 3 Hz, and at 10 Hz with 6 N.s/m of damping.
_SOFTNESS_3HZ, _SOFTNESS_10HZ = 0.30, 0.25
_DAMPING_NS_PER_M = 6.0
# Cost of softness beyond, of the largest |1/(1 + H)|, H the loop opened at the innovation, and of the largest |C|/K.
PER_SOFTNESS, PER_SENSITIVITY, PER_GAIN = 40.0, 2.0, 2.0
USUAL_SENSITIVITY = 3.0


# Share at rest below which nothing is rendered.
_NOTHING = 1e-9


def static_share(stiffness_n_per_m: float, wanted_n_per_m: float) -> float:
    """Return a stiffness at rest over the wanted one; 1 where none is wanted."""
    return stiffness_n_per_m / wanted_n_per_m if wanted_n_per_m > 0 else 1.0


def distance(mismatch: float, settling_s: float, share: float) -> float:
    """Return the distance from the wall: mismatch in motion, with prices on settling time and softness at rest.

    A settling time four times as long counts as much as a third of the stiffness, a share at rest as a fifth of the
    same share in motion.

    Args:
        mismatch: rms of abs(ln(rendered/wanted)) over `BAND_HZ`; `IMPERCEPTIBLE` at least.
        settling_s: of the slowest oscillation when released; `AT_ONCE_S` at least.
        share: of the wanted stiffness at rest.
    """
    slow, soft = math.log(max(settling_s, AT_ONCE_S) / AT_ONCE_S), max(0.0, -math.log(max(share, _NOTHING)))
    return max(mismatch, IMPERCEPTIBLE) + _PER_SETTLING * slow + _PER_SOFTER * soft


@dataclass(frozen=True)
class Cost:
    """Cost of a law and its properties.

    Attributes:
        total: to be minimised.
        radius: largest spectral radius with every hand on every device evaluated; infinite if not evaluated.
        radius_any_share: the same over all sector gains, on the devices for which that is claimed.
        lacks_per_s: missing decay of an inadmissible law: the fastest growth rate of its loops, and the decay that a
            press lacks to settle; 0 for an admissible one.
        facts: sensitivity, gain, softness, and what the distance is made of.
    """

    total: float
    radius: float = math.inf
    radius_any_share: float = math.inf
    lacks_per_s: float = math.inf
    facts: dict[str, float] = field(default_factory=dict)

    @property
    def holds(self) -> bool:
        """Whether all loops evaluated are damped, and presses settle."""
        return self.lacks_per_s <= 0

    @property
    def distance(self) -> float:
        """Distance from the wall: mismatch over the hand's band, settling time when released, softness at rest."""
        return distance(self.facts["mismatch"], self.facts["settling_s"], self.facts["static_share"])


def cost_of(law: StateFeedback, rendering: Rendering, loops: Loops) -> Cost:
    """Return the cost of a law.

    Args:
        law: observer and feedback.
        rendering: coupling and wall behind it.
        loops: loops that it must stabilise.
    """
    return costs_of(Laws.of(law), rendering, loops)[0]


def costs_of(laws: Laws, rendering: Rendering, loops: Loops) -> list[Cost]:
    """Return the costs of many laws; one with non-finite parameters costs infinity."""
    costs = [Cost(math.inf)] * len(laws)
    defined = np.flatnonzero(np.isfinite(laws.innovation).all(axis=1) & np.isfinite(laws.feedback).all(axis=1))
    felt = _felt(laws.pick(defined), rendering, loops)
    left = []
    for row, one in zip(defined.tolist(), felt, strict=True):
        if one.over > REJECTED_SOFTNESS:
            costs[row] = Cost(2000 + 1000 * one.over, facts=one.facts)
        else:
            left.append((row, one))
    rows = np.array([row for row, _ in left], dtype=np.intp)
    for (row, one), damped in zip(left, _damped(laws.pick(rows), rendering, loops), strict=True):
        total = 0.0 if damped.radius > _REJECTED_RADIUS else PER_SOFTNESS * one.over + _paid(one.facts)
        costs[row] = Cost(total + damped.cost, damped.radius, damped.radius_any_share, damped.lacks_per_s, one.facts)
    return costs


@dataclass(frozen=True)
class _Felt:
    """Rendering of a law: the properties of its cost, and softness beyond the bounds."""

    facts: dict[str, float]
    over: float


@dataclass(frozen=True)
class _Damped:
    """Damping of a law's loops, and its cost."""

    cost: float
    radius: float
    radius_any_share: float = math.inf
    lacks_per_s: float = math.inf


@dataclass(frozen=True)
class Responses:
    """Frequency responses of several laws; the first axis is that of the laws.

    Attributes:
        sensitivity: abs(1/(1 + H)), H the loop opened at the innovation, shape (laws, hands, f).
        sensitivity_any_share: the largest over all sector gains, above `_BUZZ_HZ`.
        gain: abs(C)/K, C the force over measured position, shape (laws, f).
        softness_3hz: abs(C/K - 1), shape (laws,).
        softness_10hz: the same, with its own bound.
        bound_3hz: of `softness_3hz`, up to which it costs nothing.
        bound_10hz: the same of `softness_10hz`.
        mismatch: rms over the band of the hand of the mismatch at the handle, the dead zone included.
    """

    sensitivity: FloatArray
    sensitivity_any_share: FloatArray
    gain: FloatArray
    softness_3hz: FloatArray
    softness_10hz: FloatArray
    bound_3hz: float
    bound_10hz: float
    mismatch: FloatArray


def responses(laws: Laws, rendering: Rendering, loops: Loops) -> Responses:
    """Return the frequency responses of laws."""
    t, stiffness, frequency = loops.sample_time_s, stiffness_at_rest(rendering), loops.frequency_hz
    force, believed = force_over_innovation(laws, rendering, frequency, t)
    cut = believed[:, None] - loops.response * force[:, None]
    rendered = force / (1 + believed) / stiffness
    share = np.clip(-cut.real / np.maximum(np.abs(cut) ** 2, 1e-30), 0, 1)
    buzz = frequency > min(_BUZZ_HZ, float(frequency[-2]))
    softness = np.array([[np.interp(hz, frequency, row) for row in np.abs(rendered - 1)] for hz in (3, 10)])
    beside = _DAMPING_NS_PER_M * loops.metres_per_unit**2
    return Responses(
        1 / np.abs(1 + cut),
        1 / np.abs(1 + share * cut)[..., buzz],
        np.abs(rendered),
        softness[0],
        softness[1],
        _SOFTNESS_3HZ,
        _SOFTNESS_10HZ + 2 * math.pi * 10 * beside / stiffness,
        _mismatch(laws, rendering, loops),
    )


def _mismatch(laws: Laws, rendering: Rendering, loops: Loops) -> FloatArray:
    """Return the mismatch that the shaken handle measures, by the describing function of the dead zone."""
    handle = loops.handle
    excitation = Excitation.of(handle.device, stiffness_at_rest(rendering))
    force, believed = force_over_innovation(laws, rendering, handle.frequency_hz, loops.sample_time_s)
    passed = dead_zone_gain(believed, excitation.amplitude_m, loops.dead_zone_m)
    found = handle.rendered(passed * force / (1 + passed * believed), excitation)
    return np.asarray(np.sqrt(np.mean(found.mismatch**2, axis=1)))


def _felt(laws: Laws, rendering: Rendering, loops: Loops) -> list[_Felt]:
    found, t = responses(laws, rendering, loops), loops.sample_time_s
    facts = {
        "sensitivity": found.sensitivity.max(axis=(1, 2)),
        "sensitivity_any_share": found.sensitivity_any_share.max(axis=(1, 2)),
        "gain": found.gain.max(axis=1),
        "softness_3hz": found.softness_3hz,
        "softness_10hz": found.softness_10hz,
        "mismatch": found.mismatch,
        "settling_s": settling_s(eigenvalues(observed_wall(loops.free.axes(slice(0, 1)), laws, rendering))[:, 0, 0], t),
    }
    over = np.maximum(0, found.softness_3hz - found.bound_3hz) + np.maximum(0, found.softness_10hz - found.bound_10hz)
    facts["static_share"] = np.full(
        len(laws), static_share(stiffness_at_rest(rendering), loops.handle.environment.stiffness_n_per_m)
    )
    return [
        _Felt({name: float(values[row]) for name, values in facts.items()}, float(over[row]))
        for row in range(len(laws))
    ]


def _paid(facts: dict[str, float]) -> float:
    """Return the cost of sensitivity and gain."""
    return (
        PER_SENSITIVITY * facts["sensitivity"]
        + PER_SENSITIVITY * max(0.0, facts["sensitivity_any_share"] - USUAL_SENSITIVITY)
        + PER_GAIN * facts["gain"]
    )


def _damped(laws: Laws, rendering: Rendering, loops: Loops) -> list[_Damped]:
    """Evaluate the damping of laws' loops, for clearly unstable laws by their radius alone."""
    if len(laws) == 0:
        return []
    t = loops.sample_time_s
    held = worst_radius(observed_wall(loops.varied, laws, rendering, tuple(VARIED_DECAY_PER_S)))
    free = worst_radius(observed_wall(loops.free, laws, rendering))[:, 0]
    radius = np.maximum(held[:, 0], free)
    found = [_Damped(1000 + 1000 * (one - 1), one) for one in radius.tolist()]
    rows = np.flatnonzero(radius <= _REJECTED_RADIUS)
    if len(rows) == 0:
        return found
    some = laws.pick(rows)
    every = eigenvalues(observed_wall(loops.nominal, some, rendering, tuple(DECAY_PER_S)))
    beside = [largest_radius(observed_wall(part, some, rendering)).max(axis=(1, 2)) for part in loops.beside]
    ranged = np.zeros((len(rows), len(RANGED_DECAY_PER_S)))
    if loops.ranged is not None:
        ranged = worst_radius(observed_wall(loops.ranged, some, rendering, tuple(RANGED_DECAY_PER_S)))
    largest = [part.max(axis=-1) for part in largest_by_speed(every, t)]
    for place, row in enumerate(rows.tolist()):
        cost = sum(
            PER_DECAY * _missing(one, decay, t)
            for one, decay in zip(held[row].tolist(), VARIED_DECAY_PER_S.values(), strict=True)
        )
        cost += PER_DECAY * _missing(float(free[row]), FREE_DECAY_PER_S, t)
        cost += PER_DECAY * _missing(max(float(part[place]) for part in beside), BESIDE_DECAY_PER_S, t)
        for index, (passed, decay) in enumerate(DECAY_PER_S.items()):
            cost += PER_DECAY * _missing(float(largest[0][place, index]), decay, t)
            cost += PER_DECAY * _missing(float(largest[1][place, index]), SLOW_DECAY_PER_S * passed, t)
        for one, decay in zip(ranged[place].tolist(), RANGED_DECAY_PER_S.values(), strict=True):
            cost += PER_DECAY * _missing(one, decay, t)
        any_share = max(float(part[place].max()) for part in (*largest, ranged))
        lacks = _missing(max(float(radius[row]), any_share), 0.0, t)
        lacks += _missing(float(largest[1][place, 0]), _SETTLES_PER_S, t)
        found[row] = _Damped(cost, float(radius[row]), any_share, lacks)
    return found


def largest_by_speed(poles: ComplexArray, sample_time_s: float) -> tuple[FloatArray, FloatArray]:
    """Return the modulus of the largest fast and the largest slow pole of each loop, 0 where there is none.

    Args:
        poles: of the loops, shape (..., s).
        sample_time_s: T.
    """
    size, quick = np.abs(poles), is_quick(poles, sample_time_s)
    fast, slow = (np.where(part, size, 0.0).max(axis=-1) for part in (quick, ~quick))
    return fast, slow


def is_quick(poles: ComplexArray, sample_time_s: float) -> BoolArray:
    """Return which poles oscillate above `_SLOW_HZ`."""
    return np.asarray(np.abs(np.angle(poles)) > 2 * math.pi * _SLOW_HZ * sample_time_s)


def _missing(radius: float, decay_per_s: float, sample_time_s: float) -> float:
    """Return the missing decay of a loop, 1/s."""
    return max(0.0, math.log(max(radius, 1e-9)) / sample_time_s + decay_per_s)
