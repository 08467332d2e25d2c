"""The damper that a wall is given so that a device in contact with it does not ring.

A spring k alone in front of a device of mass m swings at sqrt(k/m), and each sample of delay takes damping away: of the
loop F = k x + b v the damper b pays for k (d + 1/2) T first. What is left sets the damping ratio
zeta = (b + b_d - k (d + 1/2) T)/(2 sqrt(k m)) and the settling time, about 4 zeta^-1 sqrt(m/k). A hand adds its mass,
so that the heaviest hand rings longest. The loops themselves are computed here, with every hand, device and delay.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from avc_casadi.loops.margins import SETTLING_BAND, damping_ratios
from avc_casadi.loops.plant_family import PlantFamily
from avc_casadi.loops.stable_walls import damping_range, in_contact, stiffest_wall

RINGS_BELOW = 0.2
"""Damping ratio below which a wall rings: a swing leaves more than a quarter of its size to the next one."""
_DAMPED = 0.3
"""Damping ratio of every loop with a proposed damper: half as much again as where ringing begins."""
_SETTLED_S = 0.25
"""Settling time of every loop with a proposed damper, s: a person does not yet call a contact of this length slow."""
_LARGEST_SHARE = 0.5
"""Share of the largest stable damper that is proposed at most: it keeps a gain margin of 6 dB against the damper."""
_SHARE_OF_STIFFEST = 0.5
"""Share of the stiffest stable spring and damper for which a damper is chosen, where the wall is stiffer than that."""
_TRIED = 41
"""Dampers that are tried, evenly spaced in their logarithm."""
_DECADES = 3.0
"""Decades that they span below the largest one."""
_DIGITS = 2
"""Digits of a proposal."""


@dataclass(frozen=True)
class Ringing:
    """How a spring and damper settle: the worst of all hands and released, on all devices of the ranges."""

    damping_ns_per_m: float
    damping_ratio: float
    settling_s: float
    """By the slowest pole: log(50) over its rate of decay."""

    @property
    def damped(self) -> bool:
        """Whether it neither rings nor lasts."""
        return self.damping_ratio >= _DAMPED and self.settling_s <= _SETTLED_S


def ringing(family: PlantFamily, stiffness_n_per_m: float, damping_ns_per_m: float) -> Ringing:
    """Return damper, least damping ratio and settling time, s, of a spring and damper with the worst device and hand.

    The settling time is ln(band)/ln(r) samples, r the spectral radius of the loop in contact.
    """
    loops = in_contact(family.devices, family.hands, stiffness_n_per_m, damping_ns_per_m)
    radius = float(loops.radius.max())
    samples = math.log(SETTLING_BAND) / math.log(radius) if 0 < radius < 1 else math.inf
    return Ringing(
        damping_ns_per_m,
        float(damping_ratios(loops.poles).min()),
        0.0 if radius == 0 else samples * family.device.sample_time_s,
    )


def softened_n_per_m(family: PlantFamily, stiffness_n_per_m: float) -> float:
    """Return a stiffness, or half of the stiffest stable spring and damper where it is beyond that."""
    return min(stiffness_n_per_m, _SHARE_OF_STIFFEST * stiffest_wall(family).stiffness_n_per_m)


def proposed_damper_ns_per_m(family: PlantFamily, stiffness_n_per_m: float) -> float:
    """Return the least damper with which a spring does not ring, or the one that rings least; 0 where none is stable.

    A wall stiffer than half of the stiffest stable spring and damper has the damper of that half.
    """
    if family.device.mass_kg == 0 or stiffness_n_per_m == 0:
        return 0.0
    stiffness = softened_n_per_m(family, stiffness_n_per_m)
    if stiffness == 0:
        return 0.0
    largest = _LARGEST_SHARE * damping_range(family, stiffness).highest_ns_per_m
    if not largest > 0:
        return 0.0
    dampers = largest * np.logspace(-_DECADES, 0.0, _TRIED)
    tried = [ringing(family, stiffness, damper) for damper in dampers.tolist()]
    stable = [case for case in tried if math.isfinite(case.settling_s)]
    if not stable:
        return 0.0
    least_ringing = max(stable, key=lambda case: min(case.damping_ratio / _DAMPED, _SETTLED_S / case.settling_s, 1.0))
    damper = next((case for case in tried if case.damped), least_ringing).damping_ns_per_m
    return float(f"{damper:.{_DIGITS}g}")
