"""Initial guesses: inverse dynamics by instrumental variables, and initial values for each added term."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import signal

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi.identification.fit import FIRST_RATE_PER_S, Fit, roughly
from avc_casadi.identification.frequency import Response, held_guess, likely_resonances
from avc_casadi.identification.predictor import Predictor
from avc_casadi.identification.record import Record
from avc_casadi.identification.terms import PLAY, TERMS, Structure, lag_of, offset_of

_DELAYS = tuple(np.arange(0.0, 8.5, 0.5))
_SHARE_OF_RATE = 1 / 12
_CUTOFF_HZ = 40.0
_EDGE = 60
# Column of the position among the regressors.
_POSITION = 3
# Shares of the largest force at which it may saturate. With the right limit at most this share of the other residual
# remains (0.13 where it saturates, 0.96 where it does not), and this one of the force.
_CUT_AT = (0.9, 0.75, 0.6, 0.5, 0.4, 0.3, 0.2)
_CUT_LEAVES, _EXPLAINED = 0.5, 0.1
# A spring leaves at most this share of the residual of a free device. Of sixty devices drawn at random it left 0.004 to
# 0.22 in nine of ten on springs (the tenth shows in its frequency response), and 0.76 and more elsewhere.
_HELD_LEAVES = 0.5
# Initial share of the force for inertia where its estimate is smaller or of uncertain sign.
_LITTLE = 0.05


@dataclass(frozen=True)
class Guess:
    """Initial guess of the search.

    Attributes:
        values: mass, damping, Coulomb friction, delay, the constant force of each log, stiffness of a device on a
            spring.
        explained: share of the squared force.
        against: whether most of the force opposes the motion that it causes: its sign is wrong.
    """

    values: dict[str, float]
    explained: float
    against: bool


def first_guess(records: Sequence[Record], *, pushed: bool = False) -> Guess:
    """Return the parameters of a rigid device, on a spring where that leaves a far smaller residual.

    Velocity and acceleration come from every other sample; those of the samples between are the instruments. Their
    noise is independent of that of the regressors, so that it neither attenuates the estimates nor biases them in a
    closed loop.

    Args:
        records: of one device.
        pushed: whether a hand moves the device, and the force is that of a controller's spring.
    """
    motion = _Motion.of(records)
    rigid, held = (
        min(((delay, *motion.explains(delay, held=spring)) for delay in _DELAYS), key=lambda one: one[1])
        for spring in (False, True)
    )
    spring = not pushed and held[1] < _HELD_LEAVES * rigid[1]
    delay, left, whole, found = held if spring else rigid
    names = ("mass_kg", "damping_ns_per_m", "coulomb_friction_n", "stiffness_n_per_m")[: 3 + spring]
    values = dict(zip(names, map(float, found), strict=False))
    # The regressor with the largest share of the force has the sign of the device.
    asks = {name: value * motion.rms_of(index) for index, (name, value) in enumerate(values.items())}
    # A controller is a spring against the position too, but without a mass.
    against = asks[max(asks, key=lambda name: abs(asks[name]))] < 0 and values["mass_kg"] < 0
    if spring and not against and float(rigid[3][0]) > 0:
        # Above its resonance a device on a spring starts as a free one, and the evidence adds the spring.
        delay, left, whole, found = rigid
        names = names[:3]
        values = dict(zip(names, map(float, found), strict=False))
    little = float(np.sqrt(whole / len(motion.added_n))) * _LITTLE / motion.rms_of(0)
    if abs(values["mass_kg"]) < little or (values["mass_kg"] < 0 and not against):
        # Below a resonance, or in friction, inertia is a small share of the force, of uncertain sign: the fit finds it.
        values["mass_kg"] = little
    offsets = {offset_of(log): -float(force) for log, force in enumerate(found[len(names) :])}
    return Guess({**values, **offsets, "delay_samples": float(delay)}, 1 - left / whole, against)


# Motion that a rigid device explains so little of tells nothing of the ticks.
_UNLIKE = 0.5


def in_ticks(records: Sequence[Record]) -> tuple[list[Record], list[str]]:
    """Take the forces of clocks that scatter as acting so many ticks late as explains the motion best.

    A loop that computes a force in one tick and gives it in the next delays it by the step that happens to be between
    them. Taken as the mean step, the delay shifts every force by what its step is off, and a force that is divided by
    its own step, as a damper's is, adds to the damping by the square of the scatter.

    Args:
        records: of one device.

    Returns:
        The records, and notes for the user.
    """
    most = max(0 if record.later_n is None else len(record.later_n) for record in records)
    left = {}
    for late in range(most):
        found = first_guess([_acting(record, late) for record in records], pushed=False)
        left[late] = 1 - found.explained
    best = min(left, key=lambda late: left[late], default=0)
    if best == 0 or left[best] > _UNLIKE:
        return list(records), []
    ticks = "tick" if best == 1 else "ticks"
    note = f"its clock scatters, and the forces act {best} {ticks} after they are logged, however long these take"
    return [_acting(record, best) for record in records], [note]


def _acting(record: Record, late: int) -> Record:
    return record if record.later_n is None else replace(record, force_n=record.later_n[late])


def saturated_force_n(records: Sequence[Record], delay_samples: float) -> float | None:
    """Return the level at which the acting force saturates below the logged one; None where it does not.

    Inverse dynamics with the force clipped at the device's limit then explain the motion, and much less so with the
    force as logged.
    """
    motion = _Motion.of(records)
    largest = max(float(np.abs(record.force_n).max()) for record in records)
    near = [max(0.0, delay_samples + step) for step in (-1.0, 0.0, 1.0)]

    def left(share: float) -> float:
        explained = (motion.explains(delay, share * largest) for delay in near)
        return min(left / whole for left, whole, _ in explained)

    uncut, cut = left(1.0), {share: left(share) for share in _CUT_AT}
    share = min(cut, key=lambda one: cut[one])
    return share * largest if cut[share] < min(_CUT_LEAVES * uncut, _EXPLAINED) else None


def play_guess_m(records: Sequence[Record], last_went: Sequence[FloatArray], delay_samples: float) -> float:
    """Return the backlash before the encoder by inverse dynamics; below 0 where there is none.

    Args:
        records: of one device.
        last_went: direction of the last motion of each, from -1 to 1.
        delay_samples: of the force.
    """
    motion, period = _Motion.of(records), records[0].sample_time_s
    smooth = [_filtered(way, period, motion.cutoff_hz) for way in last_went]
    bent = np.concatenate([np.gradient(np.gradient(way, period), period)[_EDGE:-_EDGE] for way in smooth])[:, None]
    more = replace(
        motion,
        regressors=np.concatenate([motion.regressors, bent], axis=1),
        instruments=np.concatenate([motion.instruments, bent], axis=1),
    )
    found = more.explains(delay_samples)[2]
    return 2 * float(found[-1] / found[0])


@dataclass(frozen=True)
class _Motion:
    """Inverse dynamics of a rigid device as a regression.

    Attributes:
        records: of it.
        regressors: acceleration, velocity, direction, position, and the constant force of each log.
        instruments: the same from the samples between.
        added_n: inertial force of known added masses.
        cutoff_hz: of the low-pass applied to all of it.
    """

    records: Sequence[Record]
    regressors: FloatArray
    instruments: FloatArray
    added_n: FloatArray
    cutoff_hz: float

    @classmethod
    def of(cls, records: Sequence[Record]) -> _Motion:
        """Differentiate the positions."""
        period = records[0].sample_time_s
        cutoff = min(_CUTOFF_HZ, _SHARE_OF_RATE / period)
        logs = list(dict.fromkeys(record.whole for record in records))
        parts = [_parts(record, period, cutoff, np.arange(len(logs)) == logs.index(record.whole)) for record in records]
        regressors, instruments, added = (np.concatenate(part) for part in zip(*parts, strict=True))
        return cls(records, regressors, instruments, added, cutoff)

    def rms_of(self, column: int) -> float:
        """Return the root mean square of a regressor about its mean."""
        return float(np.std(self.regressors[:, column]))

    def explains(self, delay: float, limit_n: float = np.inf, *, held: bool = False) -> tuple[float, float, FloatArray]:
        """Return the squared residual, the squared force, and the parameters, with a delay and a limit."""
        regressors, instruments = (
            one if held else np.delete(one, _POSITION, axis=1) for one in (self.regressors, self.instruments)
        )
        period = self.records[0].sample_time_s
        forces = [
            _filtered(_delayed(np.clip(record.force_n, -limit_n, limit_n), delay), period, self.cutoff_hz)[_EDGE:-_EDGE]
            for record in self.records
        ]
        wanted = np.concatenate(forces) - self.added_n
        found = np.linalg.lstsq(instruments.T @ regressors, instruments.T @ wanted, rcond=None)[0]
        left = float(np.sum((wanted - regressors @ found) ** 2))
        return left, max(float(np.sum((wanted - wanted.mean()) ** 2)), 1e-300), np.asarray(found, dtype=np.float64)


def _parts(record: Record, period: float, cutoff: float, log: BoolArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return regressors, instruments and the inertial force of the added mass, without the edges."""
    time = np.arange(record.position_m.size)
    both = []
    for first in (0, 1):
        some = np.interp(time, time[first::2], record.position_m[first::2])
        smooth = _filtered(some, period, cutoff)
        velocity = np.gradient(smooth, period)
        acceleration = np.gradient(velocity, period)
        speed = float(np.sqrt(np.mean(velocity**2)))
        # The force of a zero-order hold acts half a sample after the position on average.
        direction = _filtered(np.tanh(velocity / (0.05 * speed + 1e-12)), period, cutoff)
        columns = (acceleration, velocity, direction, smooth - smooth.mean())
        constant = np.tile(log.astype(np.float64), (velocity.size, 1))
        both.append(np.concatenate([np.stack(columns, axis=1), constant], axis=1)[_EDGE:-_EDGE])
    return both[0], both[1], record.added_mass_kg * both[0][:, 0]


def _filtered(values: FloatArray, period: float, cutoff: float) -> FloatArray:
    sections = signal.butter(4, cutoff, fs=1 / period, output="sos")
    return np.asarray(signal.sosfiltfilt(sections, values), dtype=np.float64)


def _delayed(force: FloatArray, delay: float) -> FloatArray:
    """Return the force as it acts at each sample, half a sample after its command on average."""
    time = np.arange(force.size)
    return np.asarray(np.interp(time - delay - 0.5, time, force), dtype=np.float64)


_MOST_STARTS = 2


def starts_of(
    simple: Fit,
    rich: Structure,
    term: str,
    guess: Mapping[str, float],
    response: Response,
    predictor: Predictor,
    sides: Sequence[str],
) -> list[tuple[Structure, dict[str, float]]]:
    """Return the initial guesses of the search for a term."""
    values, period = simple.values, predictor.sample_time_s
    force = rich.units["coulomb_friction_n"]
    if term == "coulomb":
        likely = max(guess["coulomb_friction_n"], 0.02 * force)
        # In a log dominated by friction a model without it is far off: the first guess is nearer.
        near = {key: guess[key] for key in values if key in guess}
        return [(rich, {**values, **near_or_not, "coulomb_friction_n": likely}) for near_or_not in ({}, near)]
    if term == "stribeck":
        speed = rich.units["speed_m_per_s"]
        return [
            (rich, {**values, "breakaway_excess_n": 0.0, "stribeck_speed_m_per_s": share * speed})
            for share in (0.05, 0.2)
        ]
    if term == "amplifier":
        return _lags(rich, values, period)
    if term == "resonance":
        found = []
        if simple.observer.rate_per_s > 2 * FIRST_RATE_PER_S:
            values = roughly(predictor, simple.structure, values, FIRST_RATE_PER_S).values
        for side in sides:
            with_side = replace(rich, encoder_at="handle" if side == "handle" else "motor")
            for left, one in likely_resonances(response, values, with_side, period):
                found.append((left, with_side, {**values, **one}))
        found.sort(key=lambda one: one[0])
        return [(with_side, start) for left, with_side, start in found[:_MOST_STARTS] if left < 3 * found[0][0]]
    absent = {**values, **{one.name: 0.0 for one in TERMS[term].parameters}}
    starts = [absent]
    if term == "play":
        starts = [{**absent, PLAY: likely} for likely in _likely_play(simple, rich, predictor)]
    elif term == "stiffness" and (held := held_guess(response, values["delay_samples"] * period)) is not None:
        # A free mass is a distant initial guess for a device on a spring: the search may end in another minimum.
        starts.append({**values, "delay_samples": guess["delay_samples"], **held})
    return [(rich, start) for start in starts]


def _lags(rich: Structure, values: Mapping[str, float], period: float) -> list[tuple[Structure, dict[str, float]]]:
    """Return lags and current loops of several bandwidths, each replacing the equal delay."""
    found = []
    for order in (1, 2):
        kind = replace(rich, amplifier_order=1 if order == 1 else 2)
        for rate in (0.8 / period, 0.3 / period, 0.1 / period):
            late = lag_of(order, rich.loop_damping_ratio) / (2 * np.pi * rate * period)
            delay = max(values["delay_samples"] - late, 0.0)
            if rate > 1.0:
                found.append((kind, {**values, "amplifier_bandwidth_hz": rate, "delay_samples": delay}))
    return found


def _likely_play(simple: Fit, rich: Structure, predictor: Predictor) -> list[float]:
    """Return the initial guesses of the backlash; none in a log with hardly any reversals."""
    if predictor.last_went is None:
        return []
    guess = play_guess_m(predictor.records, predictor.last_went, simple.values["delay_samples"])
    return [0.0, guess] if guess > rich.units[PLAY] else [0.0]
