"""Start of the search: inverse dynamics of a rigid device by regression, with instruments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import signal

from avc_casadi._util.arrays import FloatArray
from avc_casadi.identification.log import Record
from avc_casadi.identification.terms import FRICTION, offset_of

_DELAYS = tuple(np.arange(0.0, 8.5, 0.5))
_SHARE_OF_RATE, _CUTOFF_HZ, _EDGE = 1 / 12, 40.0, 60
# A spring leaves at most this share of the residual of a free device: 0.004 to 0.22 of devices on springs, 0.76 and
# more elsewhere.
_SPRING_LEAVES = 0.5
# Share of the force for inertia where its estimate is smaller or of uncertain sign.
_LITTLE = 0.05
# Motion that a rigid device explains so little of tells nothing of the ticks.
_UNLIKE = 0.5


@dataclass(frozen=True)
class Start:
    """Start of the search, that of a device on a spring beside it, and how well and in which direction it follows."""

    values: dict[str, float]
    sprung: dict[str, float]
    explained: float
    against: bool


class Motion:
    """Inverse dynamics as a regression on acceleration, velocity, direction, position and constant forces.

    Velocity and acceleration come from every other sample; those of the samples between are the instruments. Their
    noise is independent of that of the regressors, so that it neither attenuates the estimates nor biases them in a
    closed loop.
    """

    def __init__(self, records: Sequence[Record], offsets: int) -> None:
        self.records, self.period = records, records[0].sample_time_s
        self.cutoff_hz = min(_CUTOFF_HZ, _SHARE_OF_RATE / self.period)
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
        smooth = self._filtered(np.interp(time, time[first::2], record.position_m[first::2]))
        velocity = np.gradient(smooth, self.period)
        speed = float(np.sqrt(np.mean(velocity**2)))
        direction = self._filtered(np.tanh(velocity / (0.05 * speed + 1e-12)))
        return np.stack([np.gradient(velocity, self.period), velocity, direction, smooth - smooth.mean()], axis=1)

    def _filtered(self, values: FloatArray) -> FloatArray:
        sections = signal.butter(4, self.cutoff_hz, fs=1 / self.period, output="sos")
        return np.asarray(signal.sosfiltfilt(sections, values), dtype=np.float64)

    def explains(self, delay: float, *, spring: bool = False) -> tuple[float, float, FloatArray]:
        """Return squared residual, squared force, and parameters, with a delay."""
        # The position is the column 3.
        regressors, instruments = (
            one if spring else np.delete(one, 3, axis=1) for one in (self.regressors, self.instruments)
        )
        # The force of a hold acts half a sample after its command on average.
        times = [np.arange(record.force_n.size) for record in self.records]
        pairs = zip(times, self.records, strict=True)
        late = [np.interp(time - delay - 0.5, time, record.force_n) for time, record in pairs]
        wanted = np.concatenate([self._filtered(force)[_EDGE:-_EDGE] for force in late])
        found = np.linalg.lstsq(instruments.T @ regressors, instruments.T @ wanted, rcond=None)[0]
        left = float(np.sum((wanted - regressors @ found) ** 2))
        return left, max(float(np.sum((wanted - wanted.mean()) ** 2)), 1e-300), np.asarray(found, dtype=np.float64)

    def start(self) -> Start:
        """Return the parameters of a rigid device, on a spring where that leaves a far smaller residual."""
        rigid, held = (
            min(((delay, *self.explains(delay, spring=spring)) for delay in _DELAYS), key=lambda one: one[1])
            for spring in (False, True)
        )
        keys = ("mass_kg", "damping_ns_per_m", FRICTION, "stiffness_n_per_m")
        spring = held[1] < _SPRING_LEAVES * rigid[1]
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
        delay, left, whole, numbers = best
        little = float(np.sqrt(whole / len(self.regressors))) * _LITTLE / float(sizes["mass_kg"] or 1e-300)
        if abs(found["mass_kg"]) < little or (found["mass_kg"] < 0 and not against):
            # Below a resonance, or in friction, inertia is a small share of the force: the fit finds it.
            found["mass_kg"] = little
        offsets = {offset_of(log): -float(force) for log, force in enumerate(numbers[3 + spring :])}
        sprung = dict(zip(("delay_samples", *keys), (held[0], *map(float, held[3][:4])), strict=True))
        sprung = sprung if min(sprung["mass_kg"], sprung["stiffness_n_per_m"]) > 0 else {}
        return Start({**found, **offsets, "delay_samples": float(delay)}, sprung, 1 - left / whole, against)


def in_ticks(records: Sequence[Record]) -> tuple[list[Record], list[str]]:
    """Take the forces of clocks that scatter as acting so many ticks late as explains the motion best.

    A loop that computes a force in one tick and gives it in the next delays it by the step that happens to be between
    them.
    """
    most = max(0 if record.later_n is None else len(record.later_n) for record in records)
    acting = [
        [one if one.later_n is None else replace(one, force_n=one.later_n[late]) for one in records]
        for late in range(most)
    ]
    left = [1 - Motion(some, 1).start().explained for some in acting]
    best = int(np.argmin(left)) if left else 0
    if best == 0 or left[best] > _UNLIKE:
        return list(records), []
    return acting[best], [f"the clock scatters, and the forces act {best} tick(s) after they are logged"]
