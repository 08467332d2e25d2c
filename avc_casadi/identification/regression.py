"""Regressions on a log: feedback of the position as its force, and inverse dynamics as the start of the search.

Where feedback is the whole force of a log, the motion comes from an input that is not logged, the operator's hand, and
a fit takes the one for a response to the other, whatever its prediction error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import signal

from avc_casadi._util.arrays import FloatArray, IndexArray
from avc_casadi.identification.log import Record
from avc_casadi.identification.terms import FRICTION, offset_of

_TINY = 1e-300
"""Stands for 0 in a divisor."""
_LAGS = 40
"""Lags of the autocorrelation that is answered, ..."""
_JUDGED_LAGS = 20
"""... and those up to which it is judged."""
_WHITE = 0.25
"""Largest autocorrelation of errors that are about white."""
_HEAVIEST_TAILS = 6
"""Largest kurtosis of errors that are about white; that of a normal distribution is 3."""


def whiteness(errors: Sequence[FloatArray], *, resampled: bool) -> tuple[FloatArray, bool]:
    """Return the autocorrelation of prediction errors from lag 1 on, shape (lags,), and whether they are about white.

    About white means an autocorrelation of 1/4 at most and a kurtosis n sum(e^4)/sum(e^2)^2 below 6.
    """
    every_error = np.concatenate(errors)
    total = float(every_error @ every_error) + _TINY
    lags = np.array([sum(float(e[lag:] @ e[:-lag]) for e in errors) / total for lag in range(1, _LAGS + 1)])
    # Interpolated positions make neighbours of white noise alike.
    judged = lags[int(resampled) : _JUDGED_LAGS]
    light_tails = every_error.size * np.sum(every_error**4) < _HEAVIEST_TAILS * total**2
    return lags, bool(np.abs(judged).max() < _WHITE and light_tails)


@dataclass(frozen=True)
class Feedback:
    """F(n) = k x(n-lag) + b v(n-lag) + offset, v(n) = keep v(n-1) + (1 - keep) (x(n) - x(n-1))/T, and its residual.

    The residual is a root mean square.
    """

    stiffness_n_per_m: float
    damping_ns_per_m: float
    keep: float
    offset_n: float
    residual_n: float


_ALIKE_COLUMNS = 1e-9
"""Singular values below this share of the largest: the columns are alike."""
_LONGEST_FILTER = 0.98
"""A filter of the velocity that keeps more from sample to sample is none."""
_GOES_ON_MOVING = 0.1
"""Share of the travel of the first half of a record that the second half exceeds, where the device goes on moving."""
_NO_FORCE = 1e-9
"""Forces up to this share of the largest are none, ..."""
_SATURATED = 0.999
"""... and from this share on saturated."""
_MOST_LAG_SAMPLES = 4
"""Longest delay of a controller."""
_FEWEST_ROWS = 100
"""Fewest samples of neither that show a controller."""
_RESIDUAL_OF_CHANGES = 0.05
"""Largest residual of a controller, as a share of the changes of its force from sample to sample, ..."""
_RESIDUAL_OF_FORCE = 5e-3
"""... or of its force."""


def regression(columns: FloatArray, target: FloatArray) -> tuple[FloatArray, float] | None:
    """Return the factors of least squares, shape (columns,), and the residual, root mean square.

    None where columns are alike, or as many as rows.
    """
    rows, count = columns.shape
    scale = np.sqrt(np.mean(columns**2, axis=0))
    if rows <= count or not scale.all():
        return None
    factors, _, rank, _ = np.linalg.lstsq(columns / scale, target, rcond=_ALIKE_COLUMNS)
    if rank < count:
        return None
    residual = target - columns @ (factors / scale)
    return np.asarray(factors / scale), float(np.sqrt(np.mean(residual**2)))


def feedback(
    position: FloatArray, force: FloatArray, rows: IndexArray, lag: int, period_s: float, *, filtered: bool
) -> Feedback | None:
    """Return the spring and damper that explain a force best, with a filter of the velocity or without.

    F = keep F_before + k (1 - keep) x + (b (1 - keep)/T + k keep)(x - x_before) + offset (1 - keep), at the given rows.
    """
    x, x_before = position[rows - lag], position[rows - lag - 1]
    columns = [x - x.mean(), x - x_before, np.ones(rows.size)]
    if filtered:
        columns.append(force[rows - 1])
    explained = regression(np.stack(columns, axis=1), force[rows])
    if explained is None:
        return None
    factors, residual_n = explained
    keep = float(factors[3]) if filtered else 0.0
    if not 0 <= keep < _LONGEST_FILTER:
        return None
    of_position, of_change, constant = (float(factor) for factor in factors[:3])
    k = of_position / (1 - keep)
    b = (of_change - k * keep) * period_s / (1 - keep)
    offset_n = constant / (1 - keep) - k * float(x.mean())
    return Feedback(stiffness_n_per_m=k, damping_ns_per_m=b, keep=keep, offset_n=offset_n, residual_n=residual_n)


def only_feedback(records: Sequence[Record]) -> bool:
    """Return whether a controller explains the whole force of every record, while the device goes on moving."""
    # A released device settles.
    return any(map(_goes_on_moving, records)) and all(map(_is_feedback, records))


def _goes_on_moving(record: Record) -> bool:
    first_half, second_half = np.array_split(record.position_m, 2)
    return float(np.ptp(second_half)) > _GOES_ON_MOVING * float(np.ptp(first_half))


def _is_feedback(record: Record) -> bool:
    """Return whether the force of a record is that of a spring and damper on its own measured position.

    It is fitted at several delays, with and without a filter of the velocity; what is left must be small.
    """
    position, force = record.position_m, record.force_n
    size = np.abs(force)
    commanded = (size > _NO_FORCE * size.max()) & (size < _SATURATED * size.max())
    for lag in range(_MOST_LAG_SAMPLES + 1):
        rows = np.flatnonzero(commanded)
        rows = rows[rows > lag + 1]
        rows = rows[commanded[rows - 1]]
        if rows.size < _FEWEST_ROWS:
            return False
        for filtered in (False, True):
            controller = feedback(position, force, rows, lag, record.sample_time_s, filtered=filtered)
            most_n = _RESIDUAL_OF_CHANGES * float(np.std(force[rows] - force[rows - 1]))
            if not filtered:
                # An output of few bits rounds by more than its changes from sample to sample.
                most_n = max(most_n, _RESIDUAL_OF_FORCE * float(np.std(force[rows])))
            if controller is not None and controller.residual_n <= most_n and _damps(controller, record.sample_time_s):
                return True
    return False


def _damps(controller: Feedback, period_s: float) -> bool:
    """Return whether a controller acts against the position, with a damper that does not drive it."""
    spring = controller.stiffness_n_per_m
    return spring < 0 and controller.damping_ns_per_m < -spring * period_s


_EDGE = 60
"""Samples at the ends of a record that the filters spoil."""
_HIGHEST_CUTOFF_HZ = 40.0
"""Cutoff of the filter of positions and forces, at most, ..."""
_CUTOFF_SAMPLES = 12
"""... and samples of its period, at least."""
_FILTER_ORDER = 4
_SLOW_SHARE = 0.05
"""Speeds below about this share of their root mean square have no direction in the regressor of friction."""
_NO_SPEED_M_PER_S = 1e-12
"""Added to that speed, for a device at rest."""
_LATEST_START_SAMPLES = 8.5
"""Delays of a start are below this, ..."""
_DELAY_STEP_SAMPLES = 0.5
"""... in steps of this."""
_KEYS = ("mass_kg", "damping_ns_per_m", FRICTION, "stiffness_n_per_m")
"""Parameters of the regressors acceleration, velocity, direction and position."""
_POSITION_COLUMN = 3
_SPRING_RESIDUAL = 0.5
"""Share of the residual of a free device below which it is on a spring.

A spring leaves 0.004 to 0.22 of it, and 0.76 and more where there is none.
"""
_SMALL_INERTIA = 0.05
"""Share of the force that inertia is taken to have, where the regression finds less or the wrong sign."""
_UNEXPLAINED = 0.5
"""Share of the force beyond which motion that a rigid device leaves unexplained tells nothing of the ticks."""


@dataclass(frozen=True)
class Start:
    """Start of the search, that of a device on a spring, and how well and in which direction it follows the force.

    Values are by key, in SI units. `spring_start` is empty where the spring or its mass would be negative; `against`
    says that the device moves against the force.
    """

    values: dict[str, float]
    spring_start: dict[str, float]
    r_squared: float
    against: bool


@dataclass(frozen=True, eq=False)
class _Explained:
    """What a regression with a delay explains: squared residual and squared force, N^2, and the parameters."""

    delay_samples: float
    residual: float
    force: float
    parameters: FloatArray

    def values(self, count: int) -> dict[str, float]:
        """Return the first parameters by key."""
        return dict(zip(_KEYS[:count], map(float, self.parameters), strict=False))


class Motion:
    """Inverse dynamics as a regression; derivatives of every other sample, those between as instruments.

    F(t - delay) = m a + b v + c sign(v) + k x + offset. Regressors and instruments have the shape (samples, columns):
    acceleration, velocity, direction, position, and one constant for each log.
    """

    def __init__(self, records: Sequence[Record], offsets: int) -> None:
        """Set up the low-passed regressors of m a + b v + k x + offset = F of all records, and their instruments."""
        self.records = records
        self.period = records[0].sample_time_s
        self.cutoff_hz = min(_HIGHEST_CUTOFF_HZ, 1 / (_CUTOFF_SAMPLES * self.period))
        logs = list(dict.fromkeys(record.whole for record in records))
        regressors: list[FloatArray] = []
        instruments: list[FloatArray] = []
        for record in records:
            constant = np.zeros((record.position_m.size, offsets))
            if offsets:
                constant[:, min(logs.index(record.whole), offsets - 1)] = 1.0
            for first, columns in enumerate((regressors, instruments)):
                columns.append(np.concatenate([self._columns(record, first), constant], axis=1)[_EDGE:-_EDGE])
        self.regressors = np.concatenate(regressors)
        self.instruments = np.concatenate(instruments)

    def _columns(self, record: Record, first: int) -> FloatArray:
        """Return acceleration, velocity, direction and position of every other sample, interpolated between."""
        time = np.arange(record.position_m.size)
        smooth = self._smooth(np.interp(time, time[first::2], record.position_m[first::2]))
        velocity = np.gradient(smooth, self.period)
        speed = float(np.sqrt(np.mean(velocity**2)))
        direction = self._smooth(np.tanh(velocity / (_SLOW_SHARE * speed + _NO_SPEED_M_PER_S)))
        return np.stack([np.gradient(velocity, self.period), velocity, direction, smooth - smooth.mean()], axis=1)

    def _smooth(self, values: FloatArray) -> FloatArray:
        sections = signal.butter(_FILTER_ORDER, self.cutoff_hz, fs=1 / self.period, output="sos")
        return np.asarray(signal.sosfiltfilt(sections, values), dtype=np.float64)

    def _explained(self, delay_samples: float, *, spring: bool) -> _Explained:
        """Return what a device with a delay explains of the force, on a spring or free."""
        regressors, instruments = self.regressors, self.instruments
        if not spring:
            regressors = np.delete(regressors, _POSITION_COLUMN, axis=1)
            instruments = np.delete(instruments, _POSITION_COLUMN, axis=1)
        delayed = []
        for record in self.records:
            time = np.arange(record.force_n.size)
            # The force of a hold acts half a sample after its command on average.
            late = np.interp(time - delay_samples - 0.5, time, record.force_n)
            delayed.append(self._smooth(late)[_EDGE:-_EDGE])
        force = np.concatenate(delayed)
        factors = np.linalg.lstsq(instruments.T @ regressors, instruments.T @ force, rcond=None)[0]
        residual = float(np.sum((force - regressors @ factors) ** 2))
        squared_force = max(float(np.sum((force - force.mean()) ** 2)), _TINY)
        return _Explained(delay_samples, residual, squared_force, np.asarray(factors, dtype=np.float64))

    def _best_delay(self, *, spring: bool) -> _Explained:
        """Return what the delay with the least residual explains."""
        delays = np.arange(0.0, _LATEST_START_SAMPLES, _DELAY_STEP_SAMPLES)
        candidates = [self._explained(delay, spring=spring) for delay in delays]
        return min(candidates, key=lambda candidate: candidate.residual)

    def start(self) -> Start:
        """Return the parameters of a rigid device, on a spring where that leaves a far smaller residual."""
        free = self._best_delay(spring=False)
        held = self._best_delay(spring=True)
        on_spring = held.residual < _SPRING_RESIDUAL * free.residual
        best = held if on_spring else free
        sizes = dict(zip(_KEYS, np.std(self.regressors, axis=0), strict=False))
        values = best.values(4 if on_spring else 3)
        # The regressor with the largest share of the force has the sign of the device. A controller is a spring
        # against the position too, but without a mass.
        largest = max(values, key=lambda key: abs(values[key] * sizes[key]))
        against = values[largest] < 0 and values["mass_kg"] < 0
        if on_spring and not against and float(free.parameters[0]) > 0:
            # Above its resonance a device on a spring starts as a free one, and the evidence adds the spring.
            best, on_spring = free, False
            values = best.values(3)
        force_rms_n = float(np.sqrt(best.force / len(self.regressors)))
        small_kg = force_rms_n * _SMALL_INERTIA / float(sizes["mass_kg"] or _TINY)
        if abs(values["mass_kg"]) < small_kg or (values["mass_kg"] < 0 and not against):
            # Below a resonance, or in friction, inertia is a small share of the force: the fit finds it.
            values["mass_kg"] = small_kg
        constants = best.parameters[4 if on_spring else 3 :]
        offsets = {offset_of(log): -float(force) for log, force in enumerate(constants)}
        return Start(
            values={**values, **offsets, "delay_samples": float(best.delay_samples)},
            spring_start=_spring_start(held),
            r_squared=1 - best.residual / best.force,
            against=against,
        )


def _spring_start(held: _Explained) -> dict[str, float]:
    """Return the start of a device on a spring, or nothing where its mass or its spring is negative."""
    values = {"delay_samples": held.delay_samples, **held.values(4)}
    return values if min(values["mass_kg"], values["stiffness_n_per_m"]) > 0 else {}


def in_ticks(records: Sequence[Record]) -> tuple[list[Record], list[str]]:
    """Take the forces of clocks that scatter as acting so many ticks late as explains the motion best.

    Return the records with these forces, and notes for the user.
    """
    ticks = max(0 if record.later_n is None else len(record.later_n) for record in records)
    acting = [[_acting_late(record, late) for record in records] for late in range(ticks)]
    residuals = [1 - Motion(late_records, 1).start().r_squared for late_records in acting]
    best = int(np.argmin(residuals)) if residuals else 0
    if best == 0 or residuals[best] > _UNEXPLAINED:
        return list(records), []
    return acting[best], [f"the clock scatters, and the forces act {best} tick(s) after they are logged"]


def _acting_late(record: Record, ticks: int) -> Record:
    return record if record.later_n is None else replace(record, force_n=record.later_n[ticks])
