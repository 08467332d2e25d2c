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


def whiteness(errors: Sequence[FloatArray], *, resampled: bool) -> tuple[FloatArray, bool]:
    """Return the autocorrelation of prediction errors from lag 1 on, and whether they are about white."""
    whole = np.concatenate(errors)
    total = float(whole @ whole) + 1e-300
    lags = np.array([sum(float(e[lag:] @ e[:-lag]) for e in errors) / total for lag in range(1, 41)])
    # Interpolated positions make neighbours of white noise alike.
    return lags, bool(np.abs(lags[int(resampled) : 20]).max() < 0.25 and whole.size * np.sum(whole**4) < 6 * total**2)


@dataclass(frozen=True)
class Feedback:
    """F(n) = k x(n-lag) + b v(n-lag) + offset, v(n) = keep v(n-1) + (1 - keep) (x(n) - x(n-1))/T, and its residual."""

    stiffness_n_per_m: float
    damping_ns_per_m: float
    keep: float
    offset_n: float
    residual_n: float


def regression(columns: FloatArray, target: FloatArray) -> tuple[FloatArray, float] | None:
    """Return the factors of least squares and the residual, root mean square; None where columns are alike."""
    scale = np.sqrt(np.mean(columns**2, axis=0))
    if columns.shape[0] <= columns.shape[1] or not scale.all():
        return None
    factors, _, rank, _ = np.linalg.lstsq(columns / scale, target, rcond=1e-9)
    if rank < columns.shape[1]:
        return None
    return np.asarray(factors / scale), float(np.sqrt(np.mean((target - columns @ (factors / scale)) ** 2)))


def feedback(
    position: FloatArray, force: FloatArray, rows: IndexArray, lag: int, period_s: float, *, filtered: bool
) -> Feedback | None:
    """Return the spring and damper that explain a force best, with a filter of the velocity or without."""
    x, before = position[rows - lag], position[rows - lag - 1]
    columns = [x - x.mean(), x - before, np.ones(rows.size)] + ([force[rows - 1]] if filtered else [])
    found = regression(np.stack(columns, axis=1), force[rows])
    keep = float(found[0][3]) if found is not None and filtered else 0.0
    if found is None or not 0 <= keep < 0.98:
        return None
    # F = keep F_before + k (1 - keep) x + (b (1 - keep)/T + k keep)(x - x_before)
    k = float(found[0][0]) / (1 - keep)
    b = (float(found[0][1]) - k * keep) * period_s / (1 - keep)
    return Feedback(k, b, keep, float(found[0][2]) / (1 - keep) - k * float(x.mean()), found[1])


def only_feedback(records: Sequence[Record]) -> bool:
    """Return whether a controller explains the whole force of every record, while the device goes on moving."""
    halves = [[float(np.ptp(part)) for part in np.array_split(one.position_m, 2)] for one in records]
    # A released device settles.
    return any(late > 0.1 * early for early, late in halves) and all(map(_is_feedback, records))


def _is_feedback(record: Record) -> bool:
    position, force = record.position_m, record.force_n
    size = np.abs(force)
    whole = (size > 1e-9 * size.max()) & (size < 0.999 * size.max())  # a force nearer to the largest is saturated
    for lag in range(5):
        rows = np.flatnonzero(whole)
        rows = rows[rows > lag + 1]
        rows = rows[whole[rows - 1]]
        if rows.size < 100:
            return False
        for filtered in (False, True):
            one = feedback(position, force, rows, lag, record.sample_time_s, filtered=filtered)
            most = 0.05 * float(np.std(force[rows] - force[rows - 1]))
            # An output of few bits rounds by more than its changes from sample to sample.
            most = most if filtered else max(most, 5e-3 * float(np.std(force[rows])))
            # Against the position, with a damper that does not drive it.
            against = one is not None and one.damping_ns_per_m < -one.stiffness_n_per_m * record.sample_time_s
            if one is not None and one.residual_n <= most and one.stiffness_n_per_m < 0 and against:
                return True
    return False


_EDGE = 60
"""Samples at the ends of a record that the filters spoil."""


@dataclass(frozen=True)
class Start:
    """Start of the search, that of a device on a spring beside it, and how well and in which direction it follows."""

    values: dict[str, float]
    spring_start: dict[str, float]
    r_squared: float
    against: bool


class Motion:
    """Inverse dynamics as a regression; derivatives of every other sample, those between as instruments."""

    def __init__(self, records: Sequence[Record], offsets: int) -> None:
        self.records, self.period = records, records[0].sample_time_s
        self.cutoff_hz = min(40.0, 1 / (12 * self.period))
        logs = list(dict.fromkeys(record.whole for record in records))
        both: tuple[list[FloatArray], list[FloatArray]] = ([], [])
        for record in records:
            constant = np.zeros((record.position_m.size, offsets))
            constant[:, min(logs.index(record.whole), offsets - 1) if offsets else []] = 1.0
            for first, parts in enumerate(both):
                parts.append(np.concatenate([self._columns(record, first), constant], axis=1)[_EDGE:-_EDGE])
        self.regressors, self.instruments = (np.concatenate(parts) for parts in both)

    def _columns(self, record: Record, first: int) -> FloatArray:
        time = np.arange(record.position_m.size)
        smooth = self._smooth(np.interp(time, time[first::2], record.position_m[first::2]))
        velocity = np.gradient(smooth, self.period)
        speed = float(np.sqrt(np.mean(velocity**2)))
        direction = self._smooth(np.tanh(velocity / (0.05 * speed + 1e-12)))
        return np.stack([np.gradient(velocity, self.period), velocity, direction, smooth - smooth.mean()], axis=1)

    def _smooth(self, values: FloatArray) -> FloatArray:
        sections = signal.butter(4, self.cutoff_hz, fs=1 / self.period, output="sos")
        return np.asarray(signal.sosfiltfilt(sections, values), dtype=np.float64)

    def residual(self, delay: float, *, spring: bool = False) -> tuple[float, float, FloatArray]:
        """Return squared residual, squared force, and parameters, with a delay."""
        # The position is the column 3.
        regressors, instruments = (
            one if spring else np.delete(one, 3, axis=1) for one in (self.regressors, self.instruments)
        )
        # The force of a hold acts half a sample after its command on average.
        times = [np.arange(record.force_n.size) for record in self.records]
        pairs = zip(times, self.records, strict=True)
        late = [np.interp(time - delay - 0.5, time, record.force_n) for time, record in pairs]
        force = np.concatenate([self._smooth(one)[_EDGE:-_EDGE] for one in late])
        factors = np.linalg.lstsq(instruments.T @ regressors, instruments.T @ force, rcond=None)[0]
        residual = float(np.sum((force - regressors @ factors) ** 2))
        return residual, max(float(np.sum((force - force.mean()) ** 2)), 1e-300), np.asarray(factors, dtype=np.float64)

    def start(self) -> Start:
        """Return the parameters of a rigid device, on a spring where that leaves a far smaller residual."""
        rigid, held = (
            min(
                ((delay, *self.residual(delay, spring=spring)) for delay in np.arange(0.0, 8.5, 0.5)),
                key=lambda one: one[1],
            )
            for spring in (False, True)
        )
        keys = ("mass_kg", "damping_ns_per_m", FRICTION, "stiffness_n_per_m")
        # A spring leaves 0.004 to 0.22 of the residual of a free device, 0.76 and more where there is none.
        spring = held[1] < 0.5 * rigid[1]
        best = held if spring else rigid
        sizes = dict(zip(keys, np.std(self.regressors, axis=0), strict=False))
        # The regressor with the largest share of the force has the sign of the device. A controller is a spring
        # against the position too, but without a mass.
        found = dict(zip(keys[: 3 + spring], map(float, best[3]), strict=False))
        most = max(found, key=lambda key: abs(found[key] * sizes[key]))
        against = found[most] < 0 and found["mass_kg"] < 0
        if spring and not against and float(rigid[3][0]) > 0:
            # Above its resonance a device on a spring starts as a free one, and the evidence adds the spring.
            best, spring = rigid, False
            found = dict(zip(keys[:3], map(float, best[3]), strict=False))
        delay, residual, whole, numbers = best
        little = float(np.sqrt(whole / len(self.regressors))) * 0.05 / float(sizes["mass_kg"] or 1e-300)
        if abs(found["mass_kg"]) < little or (found["mass_kg"] < 0 and not against):
            # Below a resonance, or in friction, inertia is a small share of the force: the fit finds it.
            found["mass_kg"] = little
        offsets = {offset_of(log): -float(force) for log, force in enumerate(numbers[3 + spring :])}
        spring_start = dict(zip(("delay_samples", *keys), (held[0], *map(float, held[3][:4])), strict=True))
        spring_start = spring_start if min(spring_start["mass_kg"], spring_start["stiffness_n_per_m"]) > 0 else {}
        return Start({**found, **offsets, "delay_samples": float(delay)}, spring_start, 1 - residual / whole, against)


def in_ticks(records: Sequence[Record]) -> tuple[list[Record], list[str]]:
    """Take the forces of clocks that scatter as acting so many ticks late as explains the motion best."""
    most = max(0 if record.later_n is None else len(record.later_n) for record in records)
    acting = [
        [one if one.later_n is None else replace(one, force_n=one.later_n[late]) for one in records]
        for late in range(most)
    ]
    residuals = [1 - Motion(some, 1).start().r_squared for some in acting]
    best = int(np.argmin(residuals)) if residuals else 0
    # Motion that a rigid device hardly explains tells nothing of the ticks.
    if best == 0 or residuals[best] > 0.5:
        return list(records), []
    return acting[best], [f"the clock scatters, and the forces act {best} tick(s) after they are logged"]
