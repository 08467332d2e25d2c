"""kp and kd of a joint that an engine moves: the stiffest that is well damped, and those of a required frequency.

The stiffest kp is the largest that has, with some kd, a damping ratio of 0.7 of the free joint and a disk margin of
0.3 over all ranges; kd is the least of those. Of an engine that solves for kd or both, any kp may have both: there kp
ends where the natural frequency is half the step rate, beyond which the step decides how the joint moves.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from numbers import Real
from typing import Any

import numpy as np

from avc_casadi._errors import InputError
from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi._util.json_values import plain
from avc_casadi._util.printed import Printed
from avc_casadi.claims.joint import joint_of
from avc_casadi.files.problem_file import AnyProblem
from avc_casadi.loops.joint import JointFamily, JointGains
from avc_casadi.model.joint import Joint
from avc_casadi.model.problem import Problem
from avc_casadi.model.table import shown
from avc_casadi.recommendation.reasons import NoJointGains

DAMPING_RATIO = 0.7
"""Damping ratio of a joint that hardly overshoots, by 5 %."""
DISK_MARGIN = 0.3
"""Disk margin of a recommended joint: a factor of 1.35 on all forces, or a phase of 17 degrees."""
NO_JOINT_GAINS = NoJointGains(DAMPING_RATIO, DISK_MARGIN)
"""Why no kp is recommended."""
# Natural frequencies of the values of kp that are tried, in radians a step: up to half the step rate.
_SLOWEST_RAD = 1e-3
_FASTEST_RAD = math.pi
_TRIED = 40
# Values of kd that are tried, of that of a continuous joint; and of the kd before, where kp is near its limit.
_DAMPERS = (0.05, 20.0, 60)
_NEAR_DAMPERS = (0.85, 1.2, 41)
# Of those that damp well so many are looked at for their margin.
_MOST_DAMPERS = 16
_BISECTIONS = 24
_SEARCHES = 4


@dataclass(frozen=True)
class JointDesign:
    """kp and kd, the least damping ratio of the free joint, and the least disk margin."""

    gains: JointGains
    damping_ratio: float
    disk_margin: float

    @property
    def sound(self) -> bool:
        """Whether it is as well damped and as robust as a recommended one."""
        return self.damping_ratio >= DAMPING_RATIO and self.disk_margin >= DISK_MARGIN


@dataclass(frozen=True, eq=False, repr=False)
class JointRecommendation(Printed):
    """kp and kd of a joint that an engine moves.

    Attributes:
        stiffest: the largest kp with a damping ratio of 0.7 and a disk margin of 0.3; None where none is.
        limited: whether a larger kp has not both; otherwise any kp has.
        frequency_hz: required; None where none is.
        at_frequency: kp and kd of it; None without, or where no kd is stable and damps it well.
    """

    problem: Problem
    stiffest: JointDesign | None
    limited: bool
    frequency_hz: float | None
    at_frequency: JointDesign | None

    @property
    def passed(self) -> bool:
        """Whether there is what is required."""
        if self.frequency_hz is not None:
            return self.at_frequency is not None and self.at_frequency.sound
        return self.stiffest is not None

    def __repr__(self) -> str:
        stiffest = self.stiffest
        return f"JointRecommendation({'none' if stiffest is None else f'kp {stiffest.gains.kp:.4g}'})"

    def document(self) -> dict[str, Any]:
        """Return JSON values."""
        designs = {"stiffest": self.stiffest, "at_frequency": self.at_frequency}
        head = {"problem": self.problem.name, "limited": self.limited, "frequency_hz": self.frequency_hz}
        return dict(plain(head | {name: _document(design) for name, design in designs.items()}))


def _document(design: JointDesign | None) -> dict[str, Any] | None:
    if design is None:
        return None
    gains = {"stiffness_n_per_m": design.gains.kp, "damping_ns_per_m": design.gains.kd}
    return gains | {"damping_ratio": design.damping_ratio, "disk_margin": design.disk_margin}


def recommend_joint(problem: AnyProblem, frequency_hz: float | None = None) -> JointRecommendation:
    """Return the stiffest kp of a joint that an engine moves, with its kd, and those of a required frequency.

    Args:
        problem: a file with [simulation] and no [device].
        frequency_hz: natural frequency that the heaviest joint of the range shall have.

    Raises:
        InputError: a problem with a device, or a frequency that is not above 0 and below half the step rate.

    Example:
        >>> joint = {"simulation": {"tool_mass_kg": 0.01, "step_s": 0.005, "integrator": "implicit-damping"}}
        >>> avc.recommend_joint(joint, frequency_hz=5.0).at_frequency.sound
        True
    """
    stated = joint_of(problem)
    velocity = stated.law is not None and "velocity" in stated.law.model_fields_set
    engine = stated.end_as(Joint).engine
    half_rate_hz = 0.5 / engine.step_s[1]
    is_number = isinstance(frequency_hz, Real) and not isinstance(frequency_hz, bool)
    if frequency_hz is not None and not (is_number and 0 < frequency_hz < half_rate_hz):
        allowed = f"above 0 and below {half_rate_hz:g} Hz, half the rate of simulation.step_s"
        typed = f"{frequency_hz:g}" if isinstance(frequency_hz, float) else shown(frequency_hz)
        raise InputError.of(f"is {typed}; allowed: {allowed}", key="frequency_hz")
    search = _JointSearch(JointFamily(engine), difference=velocity)
    stiffest, limited = search.stiffest()
    at_frequency = None
    if frequency_hz is not None:
        at_frequency = search.confirmed((2 * math.pi * frequency_hz) ** 2 * search.heaviest_kg)
    return JointRecommendation(stated, stiffest, limited, frequency_hz, at_frequency)


@dataclass(frozen=True)
class _JointSearch:
    """The search for kp and kd of a joint."""

    family: JointFamily
    difference: bool

    @property
    def heaviest_kg(self) -> float:
        """The largest mass of the range."""
        return float(self.family.places["mass_kg"].max())

    def stiffest(self) -> tuple[JointDesign | None, bool]:
        """Return the stiffest design, kp and kd, that no search of the ranges refutes, and whether it is the limit."""
        self._narrow()
        for _ in range(_SEARCHES):
            gains, limited = self._stiffest_gains()
            if gains is None:
                return None, True
            self.family.search(gains, DISK_MARGIN)
            design = self._design(gains)
            if design.sound:
                return design, limited
        return None, True

    def _narrow(self) -> None:
        """Look at the least robust joints alone, of gains by which the heaviest one turns by a radian in a step."""
        kp = self.heaviest_kg / float(self.family.places["step_s"].max()) ** 2
        kd = 2 * DAMPING_RATIO * math.sqrt(kp * self.heaviest_kg)
        self.family.narrow(JointGains(kp, kd, self.difference), DISK_MARGIN)

    def _stiffest_gains(self) -> tuple[JointGains | None, bool]:
        """Return the largest kp that is sound with some kd, and whether a larger one is not.

        Values of kp, N/m, are those at which the heaviest joint turns by small to large angles, sqrt(kp/m) T, in a step
        T.
        """
        step_s = float(self.family.places["step_s"].max())
        slowest, fastest = (self.heaviest_kg * (turn / step_s) ** 2 for turn in (_SLOWEST_RAD, _FASTEST_RAD))
        last = None
        for kp in np.geomspace(slowest, fastest, _TRIED):
            sound = self._sound(float(kp), self._dampers(float(kp)))
            if sound is None and last is not None:
                return self._edge(last, float(kp)), True
            last = sound or last
        return last, False

    def _edge(self, sound: JointGains, unsound_kp: float) -> JointGains:
        """Return the sound gains of the largest kp below an unsound one, by bisection; kd is near the one before."""
        for _ in range(_BISECTIONS):
            middle = math.sqrt(sound.kp * unsound_kp)
            stiffer = self._sound(middle, sound.kd * np.geomspace(*_NEAR_DAMPERS))
            if stiffer is None:
                unsound_kp = middle
            else:
                sound = stiffer
        return sound

    def _dampers(self, kp: float) -> FloatArray:
        """Return the kd that are tried at a kp, in increasing order."""
        continuous = 2 * DAMPING_RATIO * math.sqrt(kp * self.heaviest_kg)
        return np.append(0.0, continuous * np.geomspace(*_DAMPERS))

    def _sound(self, kp: float, dampers: FloatArray) -> JointGains | None:
        """Return kp with the least of some kd that damps it well and is robust; None where none is."""
        damped = dampers[self._are_damped(kp, dampers)]
        if not damped.size:
            return None
        damped = damped[np.unique(np.linspace(0, len(damped) - 1, _MOST_DAMPERS).astype(np.intp))]
        robust = damped[self.family.withstand(kp, damped, DISK_MARGIN, difference=self.difference)]
        return JointGains(kp, float(robust[0]), self.difference) if robust.size else None

    def confirmed(self, kp: float) -> JointDesign | None:
        """Return a kp with its least kd after a search of the ranges; None where no kd is stable and damps it well."""
        gains = self._damped(kp)
        for _ in range(_SEARCHES):
            if gains is None:
                return None
            self.family.search(gains, DISK_MARGIN)
            if self._are_damped(kp, np.array([gains.kd]))[0]:
                break
            gains = self._damped(kp)
        return None if gains is None else self._design(gains)

    def _design(self, gains: JointGains) -> JointDesign:
        ratio, _ = self.family.damping_ratio(gains)
        return JointDesign(gains, ratio, self.family.disk_margin(gains))

    def _damped(self, kp: float) -> JointGains | None:
        """Return kp with the least kd that is stable and damps it well, by scan and bisection; None if none does."""
        dampers = self._dampers(kp)
        damped = self._are_damped(kp, dampers)
        if not damped.any():
            return None
        first = int(damped.argmax())
        least = self._least(kp, float(dampers[first - 1]), float(dampers[first])) if first else 0.0
        return JointGains(kp, least, self.difference)

    def _least(self, kp: float, undamped: float, damped: float) -> float:
        for _ in range(_BISECTIONS):
            middle = 0.5 * (undamped + damped)
            is_damped = bool(self._are_damped(kp, np.array([middle]))[0])
            undamped, damped = (undamped, middle) if is_damped else (middle, damped)
        return damped

    def _are_damped(self, kp: float, dampers: FloatArray) -> BoolArray:
        return self.family.damped(kp, dampers, DAMPING_RATIO, difference=self.difference)
