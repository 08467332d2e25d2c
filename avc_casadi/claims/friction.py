"""Up to which swing dry friction brings a law to rest that grows without it, by describing functions.

A swing of amplitude A and angular frequency w on dry friction F loses as much as on a damper 4 F/(pi A w). A friction
compensation f sat(v/v_0) drives it as its steepest damper times N(A w/v_0) does, with N(u) = 1 up to u = 1 and
(2/pi)(asin(1/u) + sqrt(1 - 1/u^2)/u) beyond (Gelb and Vander Velde 1968, 2.3 and 3.1). Small swings rest; the smallest
one that a loop with these two keeps up is the limit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.claims.law_points import LawPoint, around
from avc_casadi.claims.stated_law import static_gain
from avc_casadi.model.device import Device
from avc_casadi.model.law import FRICTION_COMPENSATION, Law

LEAST_IMPACT_M_PER_S = 1.0
"""Speed at the handle of a fast strike: a law that leans on friction has to come to rest from it.

A released device that swings further diverges, so that a slow tap is not enough.
"""
UNDECLARED_SHARE = 0.5
"""Share of a declared friction that counts where no range is declared: it wears off, and varies with the place."""
# Amplitudes that are tried, as shares of the way that the spring takes up the friction in.
_REACH = 1e3
_TRIED = 61
_BISECTIONS = 20
# Rounds in which frequency and damper of a swing agree.
_ROUNDS = 4
# Points that are looked at: those of the largest radii without friction.
_POINTS = 24


@dataclass(frozen=True)
class FrictionCredit:
    """What dry friction does for a law that grows without it.

    Attributes:
        friction_n: the least that counts: of the declared range, or half of the declared.
        swing_m: the largest amplitude that comes to rest; 0 where none does, infinite where each does.
        speed_m_per_s: of the impact that begins it.
        frequency_hz: of that swing.
    """

    friction_n: float
    swing_m: float
    speed_m_per_s: float
    frequency_hz: float

    def suffices(self, device: Device) -> bool:
        """Whether a fast strike comes to rest."""
        return self.speed_m_per_s * device.metres_per_unit >= LEAST_IMPACT_M_PER_S


def least_friction_n(device: Device) -> float:
    """Return the dry friction that counts: the least of the declared range, or half of the declared value."""
    declared = device.range.coulomb_friction_n
    return UNDECLARED_SHARE * device.coulomb_friction_n if declared is None else declared[0]


def credited(
    laws: Sequence[tuple[Law, Sequence[LawPoint]]], device: Device, full_speed_m_per_s: float | None
) -> FrictionCredit:
    """Return up to which swing friction brings every law to rest at every point.

    Args:
        laws: each with the points at which it acts.
        device: with its friction.
        full_speed_m_per_s: the speed from which a friction compensation pushes with all of its force; None without one.
    """
    friction_n = least_friction_n(device)
    of_laws = [_Swings(law, points, friction_n, full_speed_m_per_s).credit() for law, points in laws]
    return min(of_laws, key=lambda credit: credit.speed_m_per_s)


@dataclass(frozen=True)
class _Swings:
    """The loops of a law at points, with the damper that friction is to a swing."""

    law: Law
    points: Sequence[LawPoint]
    friction_n: float
    full_speed_m_per_s: float | None

    def credit(self) -> FrictionCredit:
        """Return the largest swing that comes to rest."""
        loops = around(self.law, self.points).closed
        worst = np.argsort(-loops.radius)[:_POINTS]
        swings = replace(self, points=[self.points[place] for place in worst])
        turns = np.abs(np.angle(loops.leading[worst]))
        if self.friction_n == 0:
            swing_m, turn = (math.inf, 0.0) if loops.radius.max() < 1 else (0.0, float(turns[0]))
        else:
            swing_m, turn = swings.largest(turns)
        rate = turn / self.law.sample_time_s
        speed = math.inf if math.isinf(swing_m) else swing_m * rate
        return FrictionCredit(self.friction_n, swing_m, speed, rate / (2 * math.pi))

    def largest(self, turns: FloatArray) -> tuple[float, float]:
        """Return the largest amplitude that comes to rest, and the angle by which its swing turns in a sample."""
        stiffness = static_gain(self.law.linear)
        stiffness = stiffness if 0 < stiffness < math.inf else abs(float(self.law.linear.d[0, 0])) or 1.0
        unit_m = self.friction_n / stiffness
        rests = 0.0
        for swing_m in (unit_m * np.geomspace(1 / _REACH, _REACH, _TRIED)).tolist():
            radius, turn = self._loops(swing_m, turns)
            if radius >= 1:
                return self._edge(rests, swing_m, turns) if rests else (0.0, turn)
            rests = swing_m
        radius, turn = self._loops(math.inf, turns)
        return (math.inf, turn) if radius < 1 else (rests, turn)

    def _edge(self, rests: float, grows: float, turns: FloatArray) -> tuple[float, float]:
        turn = 0.0
        for _ in range(_BISECTIONS):
            middle = math.sqrt(rests * grows)
            radius, at_middle = self._loops(middle, turns)
            rests, grows = (middle, grows) if radius < 1 else (rests, middle)
            turn = at_middle
        return rests, turn

    def _loops(self, swing_m: float, turns: FloatArray) -> tuple[float, float]:
        """Return the largest radius of the loops of a swing, and the angle by which it turns in a sample."""
        period_s = self.law.sample_time_s
        for _ in range(_ROUNDS):
            # What creeps has no speed, however far it goes.
            speeds = np.multiply(swing_m, turns, out=np.zeros_like(turns), where=turns > 0) / period_s
            points = [self._of_swing(point, float(speed)) for point, speed in zip(self.points, speeds, strict=True)]
            leading = around(self.law, points).closed.leading
            turning = np.abs(np.angle(leading))
            turns = np.where(turning > 0, turning, turns)
        worst = int(np.abs(leading).argmax())
        return float(np.abs(leading[worst])), float(turns[worst])

    def _of_swing(self, point: LawPoint, speed_m_per_s: float) -> LawPoint:
        """Return a point with what friction and its compensation are to a swing of a speed."""
        # What does not swing has no amplitude that friction could act on.
        damper = 4 * self.friction_n / (math.pi * speed_m_per_s) if speed_m_per_s > 0 else 0.0
        damping = point.device.damping_ns_per_m + damper
        slopes = dict(point.slopes)
        if self.full_speed_m_per_s is not None and FRICTION_COMPENSATION.name in slopes:
            slopes[FRICTION_COMPENSATION.name] = _saturated(speed_m_per_s / self.full_speed_m_per_s)
        return LawPoint(point.device.model_copy(update={"damping_ns_per_m": damping}), point.hand, slopes)


def _saturated(u: float) -> float:
    """Return the describing function N of sat at an amplitude u."""
    if u <= 1:
        return 1.0
    return 0.0 if math.isinf(u) else 2 / math.pi * (math.asin(1 / u) + math.sqrt(1 - 1 / u**2) / u)
