"""The fitted plant in time, with stops, friction, relay, encoder and noise; a remedy is one that settles there."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from scipy import optimize

from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.units import Quantity
from avc_casadi.diagnose.law import FittedLaw, Switch
from avc_casadi.diagnose.mechanics import Mechanics, Move
from avc_casadi.diagnose.oscillation import FORCE_QUANTILES, Log, Oscillation
from avc_casadi.diagnose.plant import DeviceValue, Hypothesis, IntendedLaw, growth, notch_of, stable
from avc_casadi.loops.margins import SETTLING_BAND
from avc_casadi.model.hands import Hand
from avc_casadi.model.plant import device_plant, sampled_plant, transition

_FEW_STEPS = 6.0
"""Encoder steps below which a swing is compared by its force."""

_RESTS = 0.15
"""Share of a swing that a remedy leaves at most, or a step and a half."""

_RESTS_FEW_STEPS = 0.3
"""Share of a swing over few encoder steps that a remedy leaves at most."""

_STILL_STEPS = 1.5
"""Encoder steps of a motion below which a device is at rest."""

_SWINGS = 0.35
"""Share of the swing of the log that a simulation which swings keeps at least."""

_SWINGS_MOST = 5.0
"""Size of a swing, per that of the log, up to which a simulation goes on as the log does."""

_DECAYS = 0.8
"""Ratio of the swing in the last quarter of a simulation to that in the second below which it is on the way to rest."""

_STARTS = (1.0, 0.87, 0.7)
"""Shares of the amplitude of the log from which a simulation has to rest."""

_LEAST_TICKS = 200
"""Fewest ticks of a simulation."""
_MOST_TICKS = 5000
"""Most ticks of a simulation."""

_SIMULATED_S = 1.5
"""Shortest time of a simulation, s."""
_SIMULATED_CYCLES = 25
"""Fewest cycles of a simulation."""

_DIVERGED_M = 1e6
"""Position, m, from which on a simulation has diverged."""

_ONE_SIDED_SHARE = 0.01
"""Share of ticks with a negative force below which a force is one-sided."""

_ALWAYS_TOUCHING = 0.99
"""Share of ticks in contact from which on a swing never leaves its wall."""

_STEPS_A_STOP = 0.15
"""Longest step of a simulation with stops, per time constant of a stop."""

_SETTLING_S = 1.0
"""Time in which a user expects a loop to settle, s."""

_SETTLING_CYCLES = 5
"""The same time in cycles of a slow swing."""

_LOG_ERROR_SHARE = 0.9
"""Share of a delay from which on a shorter one is within what a log may be off."""

_LOG_ERROR_TICKS = 0.35
"""The same in ticks."""

_LEAST_FACTOR = 0.01
"""Least factor of a gain that is tried."""

_FACTOR_ERROR = 3e-3
"""Relative error of the largest stable factor of a gain."""

_DELAY_PARTS = (0.7, 0.5, 0.3)
"""Parts of a delay that are tried."""

_FRAME_GAIN_PARTS = (0.7, 0.5, 0.35, 0.2, 0.1, 0.05)
"""Parts of the gain of a slow part that are tried."""

_LIMIT_PARTS = (0.8, 0.6, 0.4, 0.25, 0.12)
"""Parts of the largest stable gain that are tried."""

_LOSS_PARTS = (0.25, 0.5, 1.0, 2.0, 4.0)
"""Damping that is tried in addition, per damping that the lag of the spring takes."""

_QUICKER = (2.0, 4.0, 8.0, 16.0)
"""Factors of the cut-off of a velocity filter that are tried."""

_MOST_CUT_OFF = 0.45
"""Cut-off of a velocity filter, cycles a tick, from which on there is none."""

_FILTERS_HZ = (150.0, 60.0, 25.0)
"""Cut-offs of a velocity filter, Hz, that are tried where there is none."""

_NOTCH_PARTS = (0.0, 0.5, 1.0)
"""Places of a notch that are tried, from the frequency of the swing to that of the resonance, in octaves."""

_FINER = (2.0, 4.0, 8.0)
"""Factors of the encoder's resolution that are tried."""

_COMPENSATED = 0.8
"""Share of the friction of a device that a switched force may compensate."""

_RAMP_WIDTHS = (0.02, 8.0)
"""Narrowest and widest ramp that is tried, per size of the swing in what switches the force."""

_RAMP_COUNT = 12
"""Ramps that are tried."""

_AT_LIMIT = 0.999
"""Share of the force limit from which on the size of a switched force is not seen."""

_RAMP_MARGIN = 0.8
"""Width with which a ramp is played, per width that is told: a wider one is softer."""


@dataclass(frozen=True)
class _Rest:
    """Whether a loop comes to rest as soon as a user expects, and without dry friction too."""

    settles: bool
    without_friction: bool


@dataclass(frozen=True, eq=False)
class LoggedScene:
    """What a simulation takes from a log beside the plant and the law."""

    swing: Oscillation
    centre_m: float
    """Position at which the force of the law is none, m."""
    rest_m: float
    """Mean position in the swing, from the centre, m."""
    force_n: float
    """Mean force in the swing, N."""
    one_sided: bool
    """Whether the force only pushes out of a wall."""
    encoder_m: float
    noise_m: float
    """Noise of the position beside the encoder steps, root mean square, m."""
    limit_n: float
    width: float = 0.0
    """What switches the force grows over this width, in its unit; 0 at once."""
    start: float = 1.0
    """Share of the amplitude of the log from which a simulation begins."""

    @classmethod
    def of(cls, log: Log, swing: Oscillation, law: FittedLaw, design: IntendedLaw, scatter_m: float) -> LoggedScene:
        """Return the scene of a log whose readings scatter by so much, root mean square, m."""
        inside = slice(swing.first, swing.last)
        force = log.force_n[inside]
        low_edge, high_edge = law.switch.edges_m if law.switch is not None else (0.0, 0.0)
        centre = (low_edge + high_edge) / 2
        if law.dead_zone_m is not None:
            centre = sum(law.dead_zone_m) / 2
        elif law.stiffness_n_per_m > 0:
            centre = -law.offset_n / law.stiffness_n_per_m
        leaves_wall = np.mean(log.touching[inside]) < _ALWAYS_TOUCHING or (force > 0).all()
        return cls(
            swing=swing,
            centre_m=centre,
            rest_m=float(log.position_m[inside].mean()) - centre,
            force_n=float(force.mean()),
            one_sided=bool(np.mean(force < 0) < _ONE_SIDED_SHARE and leaves_wall),
            encoder_m=log.encoder_m,
            noise_m=math.sqrt(max(scatter_m**2 - log.encoder_m**2 / 12, 0.0)),
            limit_n=design.device.max_force_n or float(np.abs(log.force_n).max()),
        )

    def play(self, hypothesis: Hypothesis, law: FittedLaw) -> tuple[FloatArray, FloatArray]:
        """Return position, m, and commanded force, N, at each of n ticks, from the amplitude of the log on."""
        period = hypothesis.device.sample_time_s
        seconds = max(_SIMULATED_S, _SIMULATED_CYCLES / max(self.swing.frequency_hz, 0.1))
        n = int(np.clip(seconds / period, _LEAST_TICKS, _MOST_TICKS))
        mechanics = self._mechanics(hypothesis, law)
        state = self._first_state(mechanics)
        noise = self.noise_m * np.random.default_rng(0).standard_normal(n)
        velocity = switching = 0.0
        switch_keep = law.switch.keep if law.switch is not None else 0.0
        notch = None if law.notch_hz is None else notch_of(law.notch_hz, period)
        notch_state = np.zeros(0 if notch is None else notch.states)
        position, reading, force = np.zeros((3, n))
        for tick in range(n):
            now = float(mechanics.output_row @ state)
            position[tick] = now
            if not abs(now) < _DIVERGED_M:
                later = np.arange(n - tick)
                position[tick:] = np.linspace(1, 2, n - tick) * _DIVERGED_M * np.cos(later)
                break
            x = self._read(now + noise[tick])
            reading[tick] = x
            speed = (x - reading[max(tick - 1, 0)]) / period
            velocity = law.keep * velocity + (1 - law.keep) * speed
            switching = switch_keep * switching + (1 - switch_keep) * speed
            plain_n = _plain_force(law, reading, tick, velocity, period, self.centre_m)
            command_n = self._command(law, plain_n, x, switching)
            if notch is not None:
                passed_n = float(notch.c[0] @ notch_state + notch.d[0, 0] * command_n)
                notch_state = notch.a @ notch_state + notch.b[:, 0] * command_n
                command_n = passed_n
            force[tick] = min(max(command_n, -self.limit_n), self.limit_n)
            for move in mechanics.moves:
                motor_n = force[tick - move.ticks_back] if tick >= move.ticks_back else 0.0
                state = mechanics.moved(state, move, motor_n)
        return position, force

    def _mechanics(self, hypothesis: Hypothesis, law: FittedLaw) -> Mechanics:
        """Return the plant in steps of a simulation: the old force acts for a part of a tick, then the new one."""
        device, stops = hypothesis.device, hypothesis.stops
        period, friction_n = device.sample_time_s, device.coulomb_friction_n
        plant = device_plant(device, hypothesis.hand).linear()
        pushed_plant = replace(plant, force=plant.friction)
        # Stops are stiff and lossy beside the swing; they act over a part of their period, friction over a quarter.
        stop_rate = 12 * math.pi * self.swing.frequency_hz
        longest_for_friction = period / 4 if friction_n else period
        longest_for_stops = math.inf if stops is None else _STEPS_A_STOP / stop_rate
        longest_s = min(longest_for_friction, longest_for_stops)
        late = hypothesis.delay + law.lag
        whole, part = int(late), late % 1.0
        moves = []
        for length, ticks_back in ((part, whole + 1), (1 - part, whole)):
            if length > 1e-9:
                steps = math.ceil(length * period / longest_s - 1e-9)
                by_motor = transition(plant, length * period / steps)
                by_push = transition(pushed_plant, length * period / steps)
                moves.append(Move(by_motor.matrix, by_motor.force, by_push.force, ticks_back, steps))
        # In the mean, what holds the device balances the force of the log.
        hand_stiffness = 0.0
        if isinstance(hypothesis.hand, Hand):
            hand_stiffness = float(np.atleast_1d(hypothesis.hand.stiffness_n_per_m)[0])
        return Mechanics(
            names=plant.names,
            moves=tuple(moves),
            output_row=sampled_plant(device, hypothesis.hand).output_row,
            mass_kg=device.mass_kg,
            friction_n=friction_n,
            hold_n=self.force_n + hand_stiffness * self.rest_m,
            stops_m=None if stops is None else (stops[0] - self.centre_m, stops[1] - self.centre_m),
            stop_rate_per_s=stop_rate,
        )

    def _first_state(self, mechanics: Mechanics) -> FloatArray:
        """Return a state at rest, as far from the mean as the swing; a device that bounces off a wall is outside."""
        away = self.start * self.swing.peak_to_peak_m / (-2 if self.one_sided else 2)
        state = np.zeros(len(mechanics.names))
        state[[name.endswith("_position_m") for name in mechanics.names]] = self.rest_m + away
        return state

    def _read(self, position: float) -> float:
        """Return what the encoder reads of a position from the centre, m."""
        step = self.encoder_m
        if not step:
            return position
        return step * math.floor((position + self.centre_m) / step + 0.5) - self.centre_m

    def _command(self, law: FittedLaw, force: float, position: float, velocity: float) -> float:
        """Return a force, N, with its switched part, and one-sided."""
        switch = law.switch
        if switch is not None:
            low, high = (edge - self.centre_m if switch.by == "position" else 0.0 for edge in switch.edges_m)
            value = {"position": position, "speed": velocity, "force": force}[switch.by]
            sign = float(np.sign(value - low) + np.sign(value - high)) / 2
            if switch.width_m_per_s:
                sign = math.tanh(value / switch.width_m_per_s)
            if self.width:
                above = min(max((value - high) / self.width, 0.0), 1.0)
                below = min(max((low - value) / self.width, 0.0), 1.0)
                sign = above - below
            force += switch.force_n * sign
        if self.one_sided:
            inside = position > 0 or law.stiffness_n_per_m <= 0
            force = max(force, 0.0) if inside else 0.0
        return force

    def residual_swing(self, hypothesis: Hypothesis, law: FittedLaw, quarter: int = 3) -> float:
        """Return the swing in the last or another quarter of a simulation, as a share of that of the log."""
        position, force = (np.array_split(series, 4)[quarter] for series in self.play(hypothesis, law))
        force_range = float(np.ptp(np.quantile(force, FORCE_QUANTILES)))
        shakes = force_range / max(self.swing.force_peak_to_peak_n, 1e-12)
        if self.swing.steps < _FEW_STEPS:
            return shakes
        size = float(np.ptp(position))
        moves = 0.0 if size < _STILL_STEPS * self.encoder_m else size / self.swing.peak_to_peak_m
        # At rest an encoder step may shake with half of the force of the log.
        return max(moves, 2 * _RESTS * shakes)

    def settles(self, hypothesis: Hypothesis, law: FittedLaw) -> bool:
        """Return whether simulations come to rest: over few encoder steps one may by chance."""
        most = _RESTS_FEW_STEPS if self.swing.steps < _FEW_STEPS else _RESTS
        return all(replace(self, start=share).residual_swing(hypothesis, law) < most for share in _STARTS)

    def rests(self, hypotheses: Sequence[Hypothesis], law: FittedLaw) -> _Rest:
        """Return whether a loop comes to rest with every hypothesis, the first one the likeliest."""
        # Settled within a second, a slow swing within five cycles.
        settling_s = max(_SETTLING_S, _SETTLING_CYCLES / self.swing.frequency_hz)
        slowest_per_s = math.log(SETTLING_BAND) / settling_s
        # A sign of the position that grows over a width is a spring there.
        ramp = 0.0
        if law.switch and law.switch.by == "position" and self.width:
            ramp = law.switch.force_n / self.width
        steep = replace(law, stiffness_n_per_m=law.stiffness_n_per_m + ramp)
        rates = [growth(hypothesis, steep) for hypothesis in hypotheses] if law.frames is None else []
        sound = all(rate < 0 for rate in rates) and all(rate < slowest_per_s for rate in rates[:1])
        if law.switch is None:
            settles = sound and self.settles(hypotheses[0], law)
            return _Rest(settles, settles)
        latest = max(hypotheses, key=lambda hypothesis: hypothesis.delay)
        cases = [hypotheses[0], latest]
        if not all(self.settles(case, law) for case in cases):
            return _Rest(settles=False, without_friction=False)
        smooth = [case.vary(coulomb_friction_n=0.0) for case in cases]
        return _Rest(settles=True, without_friction=sound and all(self.decays(case, law) for case in smooth))

    def decays(self, hypothesis: Hypothesis, law: FittedLaw) -> bool:
        """Return whether a simulation is on the way to rest."""
        if self.settles(hypothesis, law):
            return True
        return self.residual_swing(hypothesis, law) < _DECAYS * self.residual_swing(hypothesis, law, 1)

    def swings(self, hypothesis: Hypothesis, law: FittedLaw) -> bool:
        """Return whether a simulation goes on about as the log does; growth has no size of its own."""
        residual = self.residual_swing(hypothesis, law)
        return residual > _SWINGS and (residual < _SWINGS_MOST or self.swing.kind == "growing")


def _plain_force(
    law: FittedLaw, reading: FloatArray, tick: int, velocity: float, period_s: float, centre_m: float
) -> float:
    """Return k (x + centre) + b v + offset at a tick, N; a slow part reads the tick of its frame."""
    position, frames = reading[tick], law.frames
    if frames is not None:
        frame_tick = max(tick - tick % frames.ticks - round(frames.late * frames.ticks), 0)
        if frames.slow == "spring":
            position = reading[frame_tick]
        else:
            before = reading[max(frame_tick - frames.ticks, 0)]
            velocity = (reading[frame_tick] - before) / (frames.ticks * period_s)
    place = position + centre_m
    if law.dead_zone_m is not None:
        low, high = law.dead_zone_m
        place -= min(max(place, low), high)
    return float(law.stiffness_n_per_m * place + law.damping_ns_per_m * velocity + law.offset_n)


RemedyKey = Literal[
    "force_sign",
    "damping_ns_per_m",
    "stiffness_n_per_m",
    "sample_time_s",
    "encoder_resolution_m",
    "delay_samples",
    "velocity_filter_hz",
    "notch_hz",
    "switched_n",
    "switch_width",
]
"""What a remedy changes, by its key."""


@dataclass(frozen=True)
class Remedy:
    """A change from what is, or None, with which the simulation settles; by dry friction, or while this hand holds."""

    key: RemedyKey
    value: float
    before: float | None
    quantity: Quantity
    by_friction: bool = False
    while_held: bool = False


def without(
    cause: str, hypothesis: Hypothesis, law: FittedLaw, log: Log, design: IntendedLaw
) -> tuple[Hypothesis, FittedLaw]:
    """Return the loop without what was not intended; a frame that comes late is late by its rate."""
    if cause == "delay":
        return hypothesis.vary(delay_samples=design.latest(log)), replace(law, lag=0)
    if cause == "rate":
        slower = design.known and design.samples_a_tick(log) > 1
        sample_time_s = design.device.sample_time_s if slower else log.sample_time_s
        keep = law.keep ** (sample_time_s / log.period_s) if law.keep else 0.0
        lag = 0 if log.hold > 1 else law.lag
        return hypothesis.vary(sample_time_s=sample_time_s), replace(law, keep=keep, lag=lag)
    if cause == "resonance":
        return hypothesis.vary(resonance=None), law
    return hypothesis, replace(law, switch=None, frames=None)


def limit_of(hypothesis: Hypothesis, law: FittedLaw, gain: str) -> float:
    """Return the largest factor, at most 1, of stiffness or damping at which the loop is stable; 0 for none."""
    factors = np.geomspace(1.0, _LEAST_FACTOR, 25).tolist()
    first = next((index for index, factor in enumerate(factors) if stable(hypothesis, law, **{gain: factor})), None)
    if first is None:
        return 0.0
    if first == 0:
        return 1.0

    def growth_at(factor: float) -> float:
        return growth(hypothesis, law, **{gain: factor})

    return float(optimize.brentq(growth_at, factors[first], factors[first - 1], rtol=_FACTOR_ERROR))


@dataclass(frozen=True, eq=False)
class _Change:
    """What may help: a remedy with the values of the device, the law and the scene that it makes."""

    remedy: Remedy
    law: FittedLaw
    scene: LoggedScene
    values: Mapping[str, DeviceValue] = field(default_factory=dict)


def remedies_of(
    cause: str, answers: Sequence[Hypothesis], law: FittedLaw, scene: LoggedScene, log: Log, design: IntendedLaw
) -> tuple[Remedy, ...]:
    """Return the changes that settle a simulation of the fitted plant, one of each kind, those of the cause first.

    A remedy that needs dry friction or the hand gives way to a smaller one of its kind that needs less.
    """
    remedies: dict[str, Remedy] = {}
    for change in _changes(cause, answers[0], law, scene, log, design):
        key = change.remedy.key
        earlier = remedies.get(key)
        if earlier and not _conditions(earlier):
            continue
        changed = [answer.vary(**change.values) for answer in answers]
        held = change.scene.rests(changed, change.law)
        if not held.settles:
            continue
        released = change.scene.rests([replace(answer, hand=None) for answer in changed], change.law)
        needs_hand = not released.settles or released.without_friction < held.without_friction
        remedy = replace(change.remedy, by_friction=not held.without_friction, while_held=needs_hand)
        remedies[key] = min(earlier or remedy, remedy, key=_conditions)
    return tuple(remedies.values())


def _conditions(remedy: Remedy) -> int:
    """Return how many conditions a remedy has."""
    return remedy.by_friction + remedy.while_held


def _changes(
    cause: str, hypothesis: Hypothesis, law: FittedLaw, scene: LoggedScene, log: Log, design: IntendedLaw
) -> Iterator[_Change]:
    """Yield what may help, the largest change that may do of each kind first."""
    if cause == "relay" and law.switch is not None:
        yield from _of_switch(law, law.switch, scene, design)
        return
    if cause == "rates" and law.frames is not None:
        frame_s = law.frames.ticks * log.period_s
        remedy = Remedy("sample_time_s", log.period_s, frame_s, "time")
        yield _Change(remedy, replace(law, frames=None), scene)
        gain = _gain(law, spring=law.frames.slow == "spring")
        values = [part * gain for part in _FRAME_GAIN_PARTS]
        yield from _of_gain(law, scene, values, spring=law.frames.slow == "spring")
        return
    if cause == "rate":
        faster, faster_law = without("rate", hypothesis, law, log, design)
        sample_time_s = faster.device.sample_time_s
        remedy = Remedy("sample_time_s", sample_time_s, log.period_s, "time")
        yield _Change(remedy, replace(faster_law, lag=law.lag), scene, {"sample_time_s": sample_time_s})
    if cause in {"delay", "stiffness", "damping"}:
        yield from _of_delay(hypothesis, law, scene, log, design)
    for spring in (False, True) if cause in {"damping", "encoder"} else (True, False):
        limit = _gain(law, spring=spring) * limit_of(hypothesis, law, "stiffness" if spring else "damping")
        values = [limit * part for part in _LIMIT_PARTS if limit > 0]
        yield from _of_gain(law, scene, values, spring=spring)
    # A spring that acts so late takes k times that of damping.
    loss = law.stiffness_n_per_m * (hypothesis.delay + law.lag + 0.5) * log.period_s
    dampings = [law.damping_ns_per_m + part * loss for part in _LOSS_PARTS]
    yield from _of_gain(law, scene, dampings, spring=False)
    yield from _of_filter(cause, law, scene, log.period_s)
    if cause == "resonance":
        yield from _of_notch(hypothesis, law, scene, log.period_s)
    if cause == "encoder" and scene.encoder_m:
        for factor in _FINER:
            finer = replace(scene, encoder_m=scene.encoder_m / factor)
            yield _Change(Remedy("encoder_resolution_m", finer.encoder_m, scene.encoder_m, "length"), law, finer)


def _of_delay(
    hypothesis: Hypothesis, law: FittedLaw, scene: LoggedScene, log: Log, design: IntendedLaw
) -> Iterator[_Change]:
    """Yield the declared delay and shorter ones, further from that of the log than a log may be off."""
    late, samples_a_tick = hypothesis.delay + law.lag, design.samples_a_tick(log)
    for delay in (design.latest(log), *(part * late for part in _DELAY_PARTS)):
        if delay < min(_LOG_ERROR_SHARE * late, late - _LOG_ERROR_TICKS):
            remedy = Remedy("delay_samples", samples_a_tick * delay, samples_a_tick * late, "samples")
            yield _Change(remedy, replace(law, lag=0), scene, {"delay_samples": delay})


def _of_filter(cause: str, law: FittedLaw, scene: LoggedScene, period_s: float) -> Iterator[_Change]:
    """Yield a velocity filter where noise or a resonance passes the damper and there is none; else a quicker one."""
    cut_off_hz = law.filter_hz(period_s)
    filters_hz: Sequence[float] = ()
    if cause in {"encoder", "resonance"} and not cut_off_hz:
        filters_hz = _FILTERS_HZ
    elif cause != "encoder" and cut_off_hz:
        quicker = [cut_off_hz * factor for factor in _QUICKER]
        filters_hz = [hertz for hertz in quicker if hertz < _MOST_CUT_OFF / period_s]
    for hertz in filters_hz:
        filtered = replace(law, keep=math.exp(-2 * math.pi * hertz * period_s))
        yield _Change(Remedy("velocity_filter_hz", hertz, cut_off_hz, "frequency"), filtered, scene)


def _of_notch(hypothesis: Hypothesis, law: FittedLaw, scene: LoggedScene, period_s: float) -> Iterator[_Change]:
    """Yield notches of the command at the frequency of the swing, and between it and the released resonance."""
    mode, swing_hz = hypothesis.device.resonance, scene.swing.frequency_hz
    if mode is None:
        return
    for part in _NOTCH_PARTS:
        hertz = swing_hz ** (1 - part) * mode.frequency_hz**part
        if hertz < _MOST_CUT_OFF / period_s:
            yield _Change(Remedy("notch_hz", hertz, None, "frequency"), replace(law, notch_hz=hertz), scene)


def _gain(law: FittedLaw, *, spring: bool) -> float:
    """Return the stiffness of a law, N/m, or its damping, N.s/m."""
    return law.stiffness_n_per_m if spring else law.damping_ns_per_m


def _of_gain(law: FittedLaw, scene: LoggedScene, values: Sequence[float], *, spring: bool) -> Iterator[_Change]:
    """Yield the law with other values of stiffness or damping."""
    before = _gain(law, spring=spring)
    for value in values:
        if spring:
            remedy = Remedy("stiffness_n_per_m", value, before, "stiffness")
            yield _Change(remedy, replace(law, stiffness_n_per_m=value), scene)
        else:
            remedy = Remedy("damping_ns_per_m", value, before, "damping")
            yield _Change(remedy, replace(law, damping_ns_per_m=value), scene)


def _of_switch(law: FittedLaw, switch: Switch, scene: LoggedScene, design: IntendedLaw) -> Iterator[_Change]:
    """Yield widths over which a switched force grows, or a force below the friction that it compensates."""
    if switch.by == "speed" and switch.force_n < 0:
        compensation_n = _COMPENSATED * design.device.coulomb_friction_n
        remedy = Remedy("switched_n", compensation_n, -switch.force_n, "force")
        yield _Change(remedy, replace(law, switch=replace(switch, force_n=-compensation_n)), scene)
        return
    # Of a switch at the force limit the size is not seen.
    if abs(switch.force_n) >= _AT_LIMIT * (design.device.max_force_n or math.inf):
        return
    swing = scene.swing
    sizes: dict[str, tuple[float, Quantity]] = {
        "position": (swing.peak_to_peak_m, "length"),
        "speed": (swing.peak_to_peak_m * 2 * math.pi * swing.frequency_hz, "speed"),
        "force": (swing.force_peak_to_peak_n, "force"),
    }
    size, quantity = sizes[switch.by]
    for width in (size * np.geomspace(*_RAMP_WIDTHS, _RAMP_COUNT)).tolist():
        # A wider ramp is softer: it is played with a fifth less.
        yield _Change(Remedy("switch_width", width, 0.0, quantity), law, replace(scene, width=_RAMP_MARGIN * width))
