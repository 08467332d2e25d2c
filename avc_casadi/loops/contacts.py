"""Contact stiffnesses at which a search of sampled loops looks, so that it misses no band of unstable ones.

A contact of stiffness k on a mass m swings by the angle phi = sqrt(k/m) T in a sample T, and what a loop sees of it
depends on k in two ways: on that angle modulo a turn, as a sampled swing cannot be told from a slower one, and on the
compliance 1/k. Unstable contacts therefore lie in bands, some for each turn, as many as the loop is late by samples:
a delayed force meets the swing in each phase as often. Beyond the first turns a band moves with 1/phi alone, so that
the turns 8, 16, 32 and so on stand for those between them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from avc_casadi._util.arrays import FloatArray

KNOTS_PER_BAND = 4
"""Knots over one turn of the phase of a delayed force; between two of them an ascent finds the top."""
_KNOTS_PER_DECADE = 4
_LEAST_KNOTS_PER_TURN = 16
CONSECUTIVE_TURNS = 8
"""Turns that are all searched, from the softest contact on."""
# About whole turns the swing looks as slow as the hand moves, whose modes are narrow: more knots there, in radians.
_NEAR_WHOLE_TURNS = (0.02, 0.06, 0.15)
# Below this angle of a swing in a sample, in radians, loops depend on the stiffness alone.
_FIRST_RAD = 0.4
# Share of the knots of a turn that are left where the swing hardly outlives a sample.
_LEAST_DENSITY = 0.5
# A swing that decays to this share in a sample leaves nothing that a later sample could meet.
_NOTHING_LEFT = 1e-3
SLOWEST_HZ = 0.5
"""A contact on which the mass alone swings more slowly counts as none: it is softer than any hand."""


@dataclass(frozen=True)
class Swing:
    """What decides how a sampled loop depends on the stiffness of a contact.

    Attributes:
        mass_kg: the lightest mass in contact, which swings fastest.
        period_s: time between two looks at it.
        late_samples: samples by which the loop around it is late.
        damping_ratio: of the contact, where its damper grows with its stiffness; 0 for a damper of its own.
        decay_per_s: least rate at which the swing decays, where the damper does not grow.
        last_rad: angle in a sample beyond which the loop depends on the stiffness alone, by its integrator.
        looks: samples until a loop of two clocks recurs; slow modes meet swings of whole turns in that time.
    """

    mass_kg: float
    period_s: float
    late_samples: float
    damping_ratio: float = 0.0
    decay_per_s: float = 0.0
    last_rad: float = math.inf
    looks: int = 1

    @property
    def softest_n_per_m(self) -> float:
        """The softest contact that counts."""
        return self.mass_kg * (2 * math.pi * SLOWEST_HZ) ** 2

    def angle_rad(self, stiffness_n_per_m: float) -> float:
        """Return phi = sqrt(k/m) T."""
        return math.sqrt(stiffness_n_per_m / self.mass_kg) * self.period_s

    @property
    def _end_rad(self) -> float:
        """Angle beyond which no swing outlives a sample: exp(-zeta phi), or exp(-T/tau) whatever the stiffness."""
        logarithm = -math.log(_NOTHING_LEFT)
        if self.decay_per_s * self.period_s > logarithm:
            return 0.0
        return min(self.last_rad, logarithm / self.damping_ratio if self.damping_ratio else math.inf)

    def knots_n_per_m(self, low_n_per_m: float, high_n_per_m: float) -> FloatArray:
        """Return stiffnesses of contacts at which loops are looked at, N/m, from one end of a range to the other.

        A mass m on a contact k swings by the angle sqrt(k/m) T in a period T of the loop, which is how the loop depends
        on k: the knots lie evenly in that angle, and by decades where it is small or past its end.
        """
        first = self.angle_rad(low_n_per_m)
        last = self.angle_rad(high_n_per_m)
        end = self._end_rad
        turns = self._turns(min(last, end), math.floor(first / (2 * math.pi)))
        inside = turns[(turns > max(first, _FIRST_RAD)) & (turns < min(last, end))]
        parts = (
            np.array([first, last]),
            _by_decades(first, min(last, _FIRST_RAD)),
            inside,
            _by_decades(max(first, end, _FIRST_RAD), last),
        )
        knots = self.mass_kg * (np.unique(np.concatenate(parts)) / self.period_s) ** 2
        knots[0] = low_n_per_m
        knots[-1] = high_n_per_m
        return np.asarray(knots)

    def _turns(self, end_rad: float, number: int) -> FloatArray:
        """Return angles of a swing in a sample, rad, from a number of turns to an end, that cover all bands.

        The first `CONSECUTIVE_TURNS` turns follow each other, then their numbers double.
        """
        turn = 2 * math.pi
        count = max(_LEAST_KNOTS_PER_TURN, math.ceil(KNOTS_PER_BAND * (self.late_samples + 1)))
        parts = np.arange(self.looks) * turn / self.looks
        near = np.concatenate([(parts + reach) % turn for angle in _NEAR_WHOLE_TURNS for reach in (0.0, angle, -angle)])
        angles = [np.zeros(0)]
        while number * turn < end_rad:
            # Where a swing keeps less of itself from sample to sample, bands are shallower.
            left = max(math.exp(-self.damping_ratio * number * turn), _LEAST_DENSITY)
            knots = math.ceil(left * count)
            angles.append(number * turn + np.concatenate([np.arange(knots) * turn / knots, near]))
            number = number + 1 if len(angles) <= CONSECUTIVE_TURNS else 2 * number
        return np.concatenate(angles)


def _by_decades(low: float, high: float) -> FloatArray:
    """Return angles from low to high, evenly in the logarithm of their stiffness; none where high is below low."""
    if high <= low:
        return np.zeros(0)
    return np.geomspace(low, high, 1 + math.ceil(2 * _KNOTS_PER_DECADE * math.log10(high / low)))
