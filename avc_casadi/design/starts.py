"""Laws from which the trust region begins: spring, damper and lag written as an observer law, and the regulator.

The trust region needs a start that is stable with every hand. A spring and a damper of some margin often are; where
none of the wall's stiffness is, a softer spring that a slow lag stiffens up to the wall's is stable at more walls.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi.design.conditions import Condition
from avc_casadi.design.law_family import LawFamily, LawLoops

_SPRING_SHARES = np.geomspace(1, 0.003, 17)  # of the wall's stiffness
_DAMPER_SHARES = np.geomspace(0.003, 1.2, 18)  # of 2 m/(T (1 + delay)), where a damper alone is about unstable
_VELOCITY_POLES = np.array([0.6, 0.2])  # of the velocity's filter, per sample
_LAGS_HZ = np.array([0.3, 0.7, 1.5, 3.0, 6.0])  # corner of the lag that adds the rest of the stiffness
_ENOUGH_MARGIN = 1.25  # times the required disk margin: more of it is worth less than a faster lag
_PER_LAG_HZ = 1e-3
_TURNS_OF_NONE = 0.5  # rad: a return difference that winds by less than this does not wind
_TURNS_OF_RELEASED = 4.0  # rad: two integrators of a released device begin with half a turn
_RESOLVED = 1e-6  # directions that matter less for the fit are left out


@dataclass(frozen=True, eq=False)
class _Springs:
    """Laws spring + damper + lag, each parameter of shape (m,)."""

    spring_n_per_m: FloatArray
    damper_ns_per_m: FloatArray
    velocity_pole: FloatArray
    lag_hz: FloatArray

    @classmethod
    def grid(cls, family: LawFamily) -> _Springs:
        """Return all combinations, those of one spring next to each other."""
        device, k = family.problem.device, family.structure.stiffness_n_per_m
        largest_ns_per_m = 2 * device.mass_kg / device.sample_time_s / (1 + device.delay_samples)
        axes = k * _SPRING_SHARES, largest_ns_per_m * _DAMPER_SHARES, _VELOCITY_POLES, _LAGS_HZ
        return cls(*np.array(np.meshgrid(*axes, indexing="ij")).reshape(4, -1))

    def __len__(self) -> int:
        return len(self.spring_n_per_m)

    def pick(self, row: int) -> _Springs:
        """Return one of the laws of spring, damper and lag."""
        chosen = slice(row, row + 1)
        return _Springs(
            self.spring_n_per_m[chosen],
            self.damper_ns_per_m[chosen],
            self.velocity_pole[chosen],
            self.lag_hz[chosen],
        )

    def force_per_position(self, z: ComplexArray, wall_n_per_m: float, sample_time_s: float) -> ComplexArray:
        """Return force over position at points z, N/m, (m, len(z)): spring, damper, and the rest behind a lag.

            k + b/T (1 - 1/z) (1 - p)/(1 - p/z) + (k_e - k) (1 - l)/(z - l),   l = exp(-2 pi f T)

        k and b are spring and damper, p the pole of the filter of the velocity, f the corner of the lag, k_e the wall.
        """
        spring, damper = self.spring_n_per_m[:, None], self.damper_ns_per_m[:, None]
        pole, lag = self.velocity_pole[:, None], np.exp(-2 * np.pi * self.lag_hz[:, None] * sample_time_s)
        damped = damper / sample_time_s * (1 - 1 / z) * (1 - pole) / (1 - pole / z)
        return np.asarray(spring + damped + (wall_n_per_m - spring) * (1 - lag) / (z - lag))


def _disk_margins(family: LawFamily, springs: _Springs) -> FloatArray:
    """Return the least disk margin 2/|(2 - Rd)/Rd| of each law over every plant, shape (m,); 0 where it is unstable.

    Rd = 1 + P C is the return difference of a plant P and a law C. By Nyquist, the loop with a hand is stable where Rd
    does not wind about 0 from 0 Hz up to half the sample rate. A released device has two integrators, for which Rd
    begins with half a turn.
    """
    z, response = family.z[::2], family.response[:, ::2]
    law = springs.force_per_position(z, family.structure.stiffness_n_per_m, family.problem.device.sample_time_s)
    margins = np.full(len(springs), np.inf)
    for row, plant in enumerate(response):
        return_difference = 1 + plant * law
        turns = np.angle(return_difference[:, 1:] / return_difference[:, :-1]).sum(axis=1)
        if row < len(family.held):
            stable = np.abs(turns + np.angle(return_difference[:, 0])) < _TURNS_OF_NONE
        else:
            stable = (turns > -_TURNS_OF_NONE) & (turns < _TURNS_OF_RELEASED)
        disk = 2 / np.abs((2 - return_difference) / return_difference).max(axis=1)
        margins = np.where(stable, np.minimum(margins, disk), 0.0)
    return margins


def _starts(family: LawFamily, disk_margin: float) -> Iterator[FloatArray]:
    """Yield gains L, shape (states,): of each spring the law of the fastest lag with enough margin, then of the most.

    Enough is 1.25 times the required `disk_margin`. The last gain is the regulator's own.
    """
    springs = _Springs.grid(family)
    margins = _disk_margins(family, springs)
    # Margin counts up to what is enough; of laws with enough the fastest lag decides.
    fast_enough = np.minimum(margins, _ENOUGH_MARGIN * disk_margin) + _PER_LAG_HZ * springs.lag_hz
    of_each_spring = len(springs) // len(_SPRING_SHARES)
    for score in (fast_enough, margins):
        best_of_each = np.argmax(score.reshape(-1, of_each_spring), axis=1)
        for row in best_of_each + np.arange(0, len(springs), of_each_spring):
            if margins[row] > 0:
                yield _nearest_law(family, springs.pick(row))
    yield family.structure.regulator_gain


def _nearest_law(family: LawFamily, spring: _Springs) -> FloatArray:
    """Return the gain L whose law X L/(1 + Y L) is nearest to spring, damper and lag C by the relative change of Rd.

    Rd = 1 + P C is the return difference with a plant P. Linear least squares over the frequencies: X L - C Y L = C,
    weighed by the largest |P/(1 + P C)| of the plants.
    """
    structure = family.structure
    law = spring.force_per_position(family.z, structure.stiffness_n_per_m, family.problem.device.sample_time_s)[0]
    weight = (np.abs(family.response) / np.abs(1 + family.response * law)).max(axis=0)
    rows = (family.coarse.x - law[:, None] * family.coarse.y) * weight[:, None]
    right = law * weight
    parts = np.concatenate([rows.real, rows.imag])
    scale = np.linalg.norm(parts, axis=0)
    solution = np.linalg.lstsq(parts / scale, np.concatenate([right.real, right.imag]), rcond=_RESOLVED)[0]
    return np.asarray(solution / scale)


def promising_starts(family: LawFamily, conditions: tuple[Condition, ...], disk_margin: float) -> list[FloatArray]:
    """Return the gains L that are stable with every hand and released, none twice, those of the least cost first.

    The cost is the squared impedance error + 2 x the price of what the conditions miss.
    """
    cost_of: dict[bytes, tuple[float, int, FloatArray]] = {}
    for order, gain in enumerate(_starts(family, disk_margin)):
        if gain.tobytes() in cost_of or family.structure.observer_radius(gain) >= 1:
            continue
        loops = family.at(gain)
        if loops.radius < 1:
            cost_of[gain.tobytes()] = _cost(loops, conditions), order, gain
    return [gain for _, _, gain in sorted(cost_of.values(), key=lambda ranked: ranked[:2])]


# Factor on what is missing, whose weights are those of the trust region, next to the squared error.
_MISSING = 2.0


def _cost(loops: LawLoops, conditions: tuple[Condition, ...]) -> float:
    missing = sum(condition.weight * max(0.0, condition.worst(loops)) for condition in conditions)
    return _MISSING * missing + loops.performance.error**2
