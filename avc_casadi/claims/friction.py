"""Up to which swing dry friction brings a law to rest that grows without it, by describing functions.

A swing of amplitude A and angular frequency w on dry friction F loses as much as on a damper 4 F/(pi A w). A friction
compensation f sat(v/v_0) drives it as its steepest damper times N(A w/v_0) does, with N(u) = 1 up to u = 1 and
(2/pi)(asin(1/u) + sqrt(1 - 1/u^2)/u) beyond (Gelb and Vander Velde 1968, 2.3 and 3.1). Small swings rest; the smallest
one that a loop with these two keeps up is the limit.

A loop may also drift: without a spring its growing pole is real. At a speed v friction is a damper F/v, and the
compensation its steepest damper times N(u) = 1 up to u = v/v_0 = 1 and 1/u beyond. Without friction a displacement A
that grows as e^(s t) moves at A s.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray
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
# Amplitudes that are tried reach by this factor below and above those at which friction changes what it does.
_REACH = 1e3
_TRIED_OF_A_DECADE = 10
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
        """Return the friction, the largest swing that it brings to rest, m, its speed, m/s, and its frequency, Hz."""
        # The least of motions meets no friction, and its compensation at the steepest.
        at_rest = [self._in_motion(point, 0.0, drifts=False) for point in self.points]
        loops = around(self.law, at_rest).closed
        worst = np.argsort(-loops.radius)[:_POINTS]
        swings = replace(self, points=[self.points[place] for place in worst])
        modes = _Modes.of(loops.leading[worst], self.law.sample_time_s)
        if self.friction_n > 0:
            limit = swings.largest(modes)
        elif loops.radius.max() < 1:
            limit = _Limit(math.inf, 0.0, 0.0)
        else:
            limit = _Limit(0.0, float(modes.rates_per_s[0]), float(modes.turns_per_s[0]))
        speed = math.inf if math.isinf(limit.swing_m) else limit.swing_m * limit.rate_per_s
        return FrictionCredit(self.friction_n, limit.swing_m, speed, limit.turn_per_s / (2 * math.pi))

    def largest(self, modes: _Modes) -> _Limit:
        """Return the largest swing, m, from which friction brings the law to rest, with its rate and frequency, rad/s.

        Swings are tried from the smallest up; the limit is searched between the last that rests and the next. `modes`
        are those of each point's loop at the least of motions, which give the speed of a swing.
        """
        rests_m = 0.0
        for swing_m in self._tried_m(modes).tolist():
            motion = self._motion(swing_m, modes)
            if motion.radius >= 1:
                return self._edge(rests_m, swing_m, modes) if rests_m else motion.limit(0.0)
            rests_m = swing_m
        motion = self._motion(math.inf, modes)
        return motion.limit(math.inf if motion.radius < 1 else rests_m)

    def _tried_m(self, modes: _Modes) -> FloatArray:
        """Return amplitudes to try, in increasing order, about those at which friction or its compensation changes.

        These are the way F/k that the spring takes up the friction in, and those at whose speed the compensation pushes
        with all of its force: a loop that drifts at any speed drifts at that one.
        """
        stiffness = static_gain(self.law.linear)
        stiffness = stiffness if 0 < stiffness < math.inf else abs(float(self.law.linear.d[0, 0])) or 1.0
        changes_m = np.array([self.friction_n / stiffness])
        rates = modes.rates_per_s[modes.rates_per_s > 0]
        if self.full_speed_m_per_s is not None:
            changes_m = np.append(changes_m, self.full_speed_m_per_s / rates)
        low_m = changes_m.min() / _REACH
        high_m = changes_m.max() * _REACH
        count = 1 + math.ceil(_TRIED_OF_A_DECADE * math.log10(high_m / low_m))
        return np.unique(np.concatenate([np.geomspace(low_m, high_m, count), changes_m]))

    def _edge(self, rests_m: float, grows_m: float, modes: _Modes) -> _Limit:
        """Return the limit between a motion that rests and one that grows."""
        motion = self._motion(rests_m, modes)
        for _ in range(_BISECTIONS):
            middle_m = math.sqrt(rests_m * grows_m)
            motion = self._motion(middle_m, modes)
            rests_m, grows_m = (middle_m, grows_m) if motion.radius < 1 else (rests_m, middle_m)
        return motion.limit(rests_m)

    def _motion(self, swing_m: float, modes: _Modes) -> _Motion:
        """Return the least damped of the loops in a motion of an amplitude, m: its radius, rate and turn.

        Friction and its compensation act as dampers that depend on the speed, amplitude x rate, of each mode: a few
        rounds make mode and damper agree.
        """
        for _ in range(_ROUNDS):
            rates = modes.rates_per_s
            # What creeps has no speed, however far it goes.
            speeds = np.multiply(swing_m, rates, out=np.zeros_like(rates), where=rates > 0)
            moving = zip(self.points, speeds.tolist(), modes.drifts.tolist(), strict=True)
            points = [self._in_motion(point, speed, drifts=drifts) for point, speed, drifts in moving]
            leading = around(self.law, points).closed.leading
            modes = modes.turning_as(leading, self.law.sample_time_s)
        worst = int(np.abs(leading).argmax())
        return _Motion(float(np.abs(leading[worst])), float(modes.rates_per_s[worst]), float(modes.turns_per_s[worst]))

    def _in_motion(self, point: LawPoint, speed_m_per_s: float, *, drifts: bool) -> LawPoint:
        """Return a point with the damper that friction is to a swing, or a drift, of a speed.

        Describing function: friction F is a damper 4 F/(pi v) to a swing of the speed v, F/v to a drift; its
        compensation, which saturates at the full speed, has a smaller slope the faster the motion is.
        """
        # What does not move has no speed that friction could act on.
        damper = self.friction_n / speed_m_per_s if speed_m_per_s > 0 else 0.0
        damper *= 1.0 if drifts else 4 / math.pi
        damping = point.device.damping_ns_per_m + damper
        slopes = dict(point.slopes)
        if self.full_speed_m_per_s is not None and FRICTION_COMPENSATION.name in slopes:
            share = speed_m_per_s / self.full_speed_m_per_s
            slopes[FRICTION_COMPENSATION.name] = 1 / max(share, 1.0) if drifts else _saturated(share)
        return LawPoint(point.device.model_copy(update={"damping_ns_per_m": damping}), point.hand, slopes)


@dataclass(frozen=True)
class _Limit:
    """The largest amplitude that comes to rest, its speed over amplitude, and its angular frequency."""

    swing_m: float
    rate_per_s: float
    turn_per_s: float


@dataclass(frozen=True)
class _Motion:
    """The least damped loop of a motion: its radius, its speed over amplitude, and its angular frequency."""

    radius: float
    rate_per_s: float
    turn_per_s: float

    def limit(self, swing_m: float) -> _Limit:
        """Return the limit at an amplitude of this motion."""
        return _Limit(swing_m, self.rate_per_s, self.turn_per_s)


@dataclass(frozen=True)
class _Modes:
    """How the loops at points move, shape (points,): angular frequencies, 0 of a drift, and growth."""

    turns_per_s: FloatArray
    growth_per_s: FloatArray

    @classmethod
    def of(cls, poles: ComplexArray, sample_time_s: float) -> _Modes:
        """Return the modes of leading poles."""
        growth = np.log(np.maximum(np.abs(poles), 1.0))
        return cls(np.abs(np.angle(poles)) / sample_time_s, growth / sample_time_s)

    @property
    def drifts(self) -> BoolArray:
        """Which loops drift."""
        return np.asarray(self.turns_per_s == 0)

    @property
    def rates_per_s(self) -> FloatArray:
        """Speed over amplitude: the angular frequency of a swing, the growth of a drift."""
        return np.where(self.drifts, self.growth_per_s, self.turns_per_s)

    def turning_as(self, poles: ComplexArray, sample_time_s: float) -> _Modes:
        """Return these modes at the frequencies of other leading poles; a loop of a real pole keeps its own."""
        turns = np.abs(np.angle(poles)) / sample_time_s
        return replace(self, turns_per_s=np.where(turns > 0, turns, self.turns_per_s))


def _saturated(u: float) -> float:
    """Return the describing function N of sat at an amplitude u."""
    if u <= 1:
        return 1.0
    return 0.0 if math.isinf(u) else 2 / math.pi * (math.asin(1 / u) + math.sqrt(1 - 1 / u**2) / u)
