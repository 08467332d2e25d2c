"""The fitted plant in time, with stops, friction, relay, encoder and noise; a remedy is one that settles there."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi.diagnose.law import Frames, Law, Switch
from avc_casadi.diagnose.oscillation import Log, Oscillation, force_limit
from avc_casadi.diagnose.plant import Declared, Hypothesis, stable
from avc_casadi.model.hands import Hand
from avc_casadi.model.plant import LinearPlant, transition
from avc_casadi.model.sampled_plant import device_plant, sampled_plant

# Over fewer encoder steps a swing is compared by its force; a remedy leaves this share of a swing, or a step and a
# half; a simulation that swings keeps at least a third.
_FEW_STEPS, _RESTS, _SWINGS, _MOST_TICKS = 6.0, 0.15, 0.35, 5000


@dataclass(frozen=True, eq=False)
class Scene:
    """What a simulation takes from a log beside the plant and the law."""

    swing: Oscillation
    centre_m: float
    rest_m: float
    force_n: float
    one_sided: bool
    encoder_m: float
    noise_m: float
    limit_n: float
    ran: BoolArray
    width: float = 0.0  # over which a switched force grows, 0 at once

    @classmethod
    def of(cls, log: Log, swing: Oscillation, law: Law, declared: Declared) -> Scene:
        """Return the scene of a log."""
        inside = slice(swing.first, swing.last)
        force = log.force_n[inside] - log.outside_n
        touching = log.touching[inside]
        edges = law.switch.edges_m if law.switch is not None else (0.0, 0.0)
        centre = law.wall_m if law.stiffness_n_per_m > 0 else sum(edges) / 2
        return cls(
            swing=swing,
            centre_m=centre,
            rest_m=float(log.position_m[inside].mean()) - centre,
            force_n=float(force.mean()),
            one_sided=bool(np.mean(force < 0) < 0.01 and (np.mean(~touching) > 0.01 or (force > 0).all())),
            encoder_m=log.encoder_m,
            noise_m=declared.device.position_noise_rms_m,
            limit_n=force_limit(log, declared.device.max_force_n) or declared.device.max_force_n or math.inf,
            ran=log.ran if log.ticks.missed_share else np.ones(1, dtype=bool),
        )

    def play(self, one: Hypothesis, law: Law, seed: int = 0) -> tuple[FloatArray, FloatArray]:
        """Return position and commanded force at every tick, from the amplitude of the log on."""
        period = one.device.sample_time_s
        cycles = 25 / max(self.swing.frequency_hz, 0.1)
        n = int(np.clip(max(1.5, cycles) / period, 200, _MOST_TICKS))
        plant = device_plant(one.device, one.hand).linear()
        rubbing = LinearPlant(plant.names, plant.matrix, plant.friction, plant.target, plant.friction)
        row = sampled_plant(one.device, one.hand).measured
        late = one.delay + law.lag
        whole, part = int(late), late - int(late)
        rubs = one.device.coulomb_friction_n
        # Friction is constant over a part of a sample, a stop over a part of its own period.
        most_s = period / 4 if rubs else period
        if one.stops is not None:
            most_s = min(most_s, 0.15 * math.sqrt(one.device.mass_kg / max(one.stops[2], 1e-9)))
        groups = [(length, back) for length, back in ((part, whole + 1), (1 - part, whole)) if length > 1e-9]
        moves = []
        for length, back in groups:
            count = math.ceil(length * period / most_s - 1e-9)
            seconds = length * period / count
            step, rub = transition(plant, seconds), transition(rubbing, seconds)
            moves.append((step.matrix, step.force, rub.force, back, count))
        # In the mean, what holds the device balances the force of the log.
        spring = float(np.atleast_1d(one.hand.stiffness_n_per_m)[0]) if isinstance(one.hand, Hand) else 0.0
        push = self.force_n + spring * self.rest_m
        state = np.zeros(len(plant.names))
        state[[name.endswith("_position_m") for name in plant.names]] = self.rest_m + self.swing.peak_to_peak_m / 2
        noise = self.noise_m * np.random.default_rng(seed).standard_normal(n)
        control = _Control(self, law, period)
        position, force = np.zeros(n), np.zeros(n)
        for tick in range(n):
            position[tick] = row @ state
            if self.ran[tick % self.ran.size]:
                force[tick] = control(tick, position[tick] + noise[tick])
            elif tick:
                force[tick] = force[tick - 1]
            for matrix, by_force, beside, back, count in moves:
                given = force[tick - back] if tick >= back else 0.0
                driven = by_force * given
                for _ in range(count):
                    other = -push
                    if one.stops is not None:
                        other += self._stop(one.stops, float(row @ state), state[1])
                    state = matrix @ state + driven + beside * other
                    if rubs:
                        state = state + beside * min(max(-state[1] / beside[1], -rubs), rubs)
            if not abs(position[tick]) < 1e6:
                position[tick:] = np.linspace(1, 2, n - tick) * 1e6 * np.cos(np.arange(n - tick))
                break
        return position, force

    def _stop(self, stops: tuple[float, float, float, float], at: float, speed: float) -> float:
        """Return the force of the stops against +position."""
        low, high, stiffness, damping = stops
        beyond = min(at + self.centre_m - low, 0.0) + max(at + self.centre_m - high, 0.0)
        return stiffness * beyond + damping * speed if beyond else 0.0

    def left(self, one: Hypothesis, law: Law) -> float:
        """Return what is left of the swing at the end of a simulation, as a share of that of the log."""
        position, force = self.play(one, law)
        late = slice(3 * position.size // 4, None)
        if self.swing.steps < _FEW_STEPS:
            size = float(np.ptp(np.quantile(force[late], (0.01, 0.99))))
            return size / max(self.swing.force_peak_to_peak_n, 1e-12)
        size = float(np.ptp(position[late]))
        return 0.0 if size < 1.5 * self.encoder_m else size / self.swing.peak_to_peak_m

    def settles(self, one: Hypothesis, law: Law) -> bool:
        """Return whether a simulation comes to rest."""
        return self.left(one, law) < (0.35 if self.swing.steps < _FEW_STEPS else _RESTS)

    def swings(self, one: Hypothesis, law: Law) -> bool:
        """Return whether a simulation goes on about as the log does; missed ticks and growth have no own size."""
        left = self.left(one, law)
        bounded = self.swing.kind != "growing" and self.ran.all()
        return left > _SWINGS and (left < 5.0 or not bounded)


class _Control:
    """The computer of the loop: it quantises, filters, switches, holds frames and limits."""

    def __init__(self, scene: Scene, law: Law, period_s: float) -> None:
        self._scene, self._law, self._period = scene, law, period_s
        self._offset = law.offset_n + law.stiffness_n_per_m * scene.centre_m
        self._before: float | None = None
        self._rate = 0.0
        self._frames: list[tuple[float, float]] = []

    def __call__(self, tick: int, position: float) -> float:
        scene, law, period = self._scene, self._law, self._period
        step, centre = scene.encoder_m, scene.centre_m
        x = step * math.floor((position + centre) / step + 0.5) - centre if step else position
        change = 0.0 if self._before is None else x - self._before
        self._rate = law.keep * self._rate + (1 - law.keep) * change / period
        self._before = x
        spring, rate = x, self._rate
        if law.frames is not None:
            if tick % law.frames.ticks == 0:
                last = self._frames[-1][0] if self._frames else x
                self._frames.append((x, (x - last) / (law.frames.ticks * period)))
            old = self._frames[max(len(self._frames) - 1 - law.frames.late, 0)]
            spring, rate = (old[0], rate) if law.frames.slow == "spring" else (x, old[1])
        force = law.stiffness_n_per_m * spring + law.damping_ns_per_m * rate + self._offset
        switch = law.switch
        if switch is not None and switch.by != "contact":
            low, high = (edge - centre for edge in switch.edges_m)
            if switch.by == "position":
                force += switch.force_n * (self._sign(x - low, upper=False) + self._sign(x - high, upper=True)) / 2
            else:
                force += switch.force_n * self._sign(rate if switch.by == "speed" else force, upper=None)
        if scene.one_sided:
            if switch is not None and switch.by == "contact":
                edge = switch.edges_m[0] - centre
                grown = min(max((x - edge) / scene.width, 0.0), 1.0) if scene.width else 1.0
                force = max(force - switch.force_n * (1 - grown), 0.0) if x > edge - 1e-12 else 0.0
            else:
                force = max(force, 0.0) if x > 0 or law.stiffness_n_per_m <= 0 else 0.0
        return min(max(force, -scene.limit_n), scene.limit_n)

    def _sign(self, value: float, *, upper: bool | None) -> float:
        """Return the sign, or its ramp; beyond a dead band the ramp begins at the edge."""
        width = self._scene.width
        if not width:
            return float(np.sign(value))
        switch = self._law.switch
        if upper is not None and switch is not None and switch.edges_m[0] != switch.edges_m[1]:
            return 2 * min(max(value / width, 0.0), 1.0) - 1 if upper else 1 - 2 * min(max(-value / width, 0.0), 1.0)
        return min(max(value / width, -1.0), 1.0)


Gain = Literal["stiffness", "damping"]
Measure = Literal["stiffness", "damping", "samples", "time", "frequency", "length", "force", "speed", "share"]


@dataclass(frozen=True)
class Remedy:
    """A change with which the simulation of the fitted plant settles.

    Attributes:
        key: what is changed.
        value, before: its new value and that of the log.
        quantity: what it measures.
    """

    key: str
    value: float
    before: float
    quantity: Measure


def intended(one: Hypothesis, law: Law, log: Log, declared: Declared) -> tuple[Hypothesis, Law]:
    """Return the loop at the rate that was intended: gains, filter in seconds and delay in samples stay."""
    period = log.ticks.period_s
    slower = declared.known and period > 1.3 * declared.device.sample_time_s
    fast = declared.device.sample_time_s if slower else log.ticks.sample_time_s
    return one.changed(sample_time_s=fast), replace(law, keep=law.keep ** (fast / period) if law.keep else 0.0)


def meant_delay(log: Log, declared: Declared) -> float:
    """Return the longest delay that was intended, in samples of the log."""
    longer = declared.known and log.ticks.period_s > 1.3 * declared.device.sample_time_s
    return declared.delay_samples[1] * (declared.device.sample_time_s / log.ticks.period_s if longer else 1.0)


def limit_of(one: Hypothesis, law: Law, gain: str) -> float | None:
    """Return the largest factor, at most 1, of stiffness or damping at which the loop is stable, or None."""
    factors = np.geomspace(1.0, 0.01, 25)
    rests = [stable(one, law, **{gain: float(factor)}) for factor in factors]
    if not any(rests):
        return None
    first = rests.index(True)
    if first == 0:
        return 1.0
    low, high = float(factors[first]), float(factors[first - 1])
    for _ in range(6):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if stable(one, law, **{gain: middle}) else (low, middle)
    return low


_Change = tuple[Remedy, Hypothesis, Law, Scene]


def remedies_of(
    cause: str, answers: Sequence[Hypothesis], law: Law, scene: Scene, log: Log, declared: Declared
) -> tuple[Remedy, ...]:
    """Return the changes that settle a simulation of the fitted plant, one of each kind, those of the cause first.

    Args:
        cause: by key.
        answers: device and hand, the first simulated; the loop of one rate has to be stable with all.
        law: from position to force.
        scene: of the log.
        log: on its grid.
        declared: the intended loop.
    """
    found: dict[str, Remedy] = {}
    nonlinear = law.switch is not None or law.frames is not None or scene.swing.steps < _FEW_STEPS
    others = [_changes(cause, one, answers, law, scene, log, declared) for one in answers]
    for same in zip(*others, strict=True):
        remedy, changed, its_law, its_scene = same[0]
        if remedy.key in found or not (nonlinear or all(stable(other, its) for _, other, its, _ in same)):
            continue
        if its_scene.settles(changed, its_law):
            found[remedy.key] = remedy
    return tuple(found.values())


def _changes(
    cause: str, one: Hypothesis, answers: Sequence[Hypothesis], law: Law, scene: Scene, log: Log, declared: Declared
) -> Iterator[_Change]:
    """Yield what may help, the largest change that may do of each kind first."""
    k, b, period = law.stiffness_n_per_m, law.damping_ns_per_m, log.ticks.period_s
    if cause == "relay" and law.switch is not None:
        yield from _widths(one, law, law.switch, scene, declared)
        return
    if cause == "rates" and law.frames is not None:
        yield from _frames(one, law, law.frames, scene, period)
        return
    if cause == "rate":
        faster, its_law = intended(one, law, log, declared)
        yield Remedy("sample_time_s", faster.device.sample_time_s, period, "time"), faster, its_law, scene
    if cause == "ticks":
        yield (
            Remedy("dropped_share", 0.0, log.ticks.missed_share, "share"),
            one,
            law,
            replace(scene, ran=np.ones(1, bool)),
        )
    if cause in {"delay", "stiffness", "damping"}:
        late, meant = answers[0].delay + law.lag, meant_delay(log, declared)
        punctual = replace(law, lag=0)
        for delay in (meant, 0.7 * late, 0.5 * late, 0.3 * late):
            if delay < 0.9 * late:
                yield Remedy("delay_samples", delay, late, "samples"), one.changed(delay_samples=delay), punctual, scene
    gains: tuple[Gain, ...] = ("damping", "stiffness") if cause in {"damping", "encoder"} else ("stiffness", "damping")
    for gain in gains:
        key, now = ("stiffness_n_per_m", k) if gain == "stiffness" else ("damping_ns_per_m", b)
        limit = limit_of(answers[0], law, gain) if now > 0 else None
        for factor in (0.8, 0.6, 0.4, 0.25, 0.12) if limit else ():
            value = (limit or 1.0) * factor * now
            yield Remedy(key, value, now, gain), one, law.with_gain(key, value), scene
    yield from _of_damper(cause, one, law, scene, period)


def _of_damper(cause: str, one: Hypothesis, law: Law, scene: Scene, period: float) -> Iterator[_Change]:
    """Yield the damper with its sign turned, filters of the velocity, and finer encoders."""
    b = law.damping_ns_per_m
    if b < 0:
        yield Remedy("damping_ns_per_m", -b, b, "damping"), one, replace(law, damping_ns_per_m=-b), scene
        yield Remedy("damping_ns_per_m", 0.0, b, "damping"), one, replace(law, damping_ns_per_m=0.0), scene
    cut = law.filter_hz(period)
    for hertz in (150.0, 60.0, 25.0) if cut is None and cause == "encoder" else ():
        filtered = replace(law, keep=math.exp(-2 * math.pi * hertz * period))
        yield Remedy("velocity_filter_hz", hertz, 0.5 / period, "frequency"), one, filtered, scene
    for times in (2.0, 4.0, 8.0, 16.0) if cut is not None and cause != "encoder" else ():
        quicker = replace(law, keep=law.keep**times)
        if times * (cut or 0.0) < 0.45 / period:
            yield Remedy("velocity_filter_hz", times * (cut or 0.0), cut or 0.0, "frequency"), one, quicker, scene
    for finer in (2.0, 4.0, 8.0) if cause == "encoder" and scene.encoder_m else ():
        step = scene.encoder_m / finer
        smooth = replace(scene, encoder_m=step, noise_m=scene.noise_m / finer)
        yield Remedy("encoder_resolution_m", step, scene.encoder_m, "length"), one, law, smooth


def _frames(one: Hypothesis, law: Law, frames: Frames, scene: Scene, period: float) -> Iterator[_Change]:
    """Yield one rate for both parts, or less of the slow one."""
    yield Remedy("sample_time_s", period, frames.ticks * period, "time"), one, replace(law, frames=None), scene
    slow: Gain = "stiffness" if frames.slow == "spring" else "damping"
    key = "stiffness_n_per_m" if slow == "stiffness" else "damping_ns_per_m"
    now = float(getattr(law, key))
    for factor in (0.7, 0.5, 0.35, 0.25, 0.15, 0.08, 0.04):
        yield Remedy(key, factor * now, now, slow), one, law.with_gain(key, factor * now), scene


def _widths(one: Hypothesis, law: Law, switch: Switch, scene: Scene, declared: Declared) -> Iterator[_Change]:
    """Yield widths over which a switched force grows, or a force below the friction that it compensates."""
    c = switch.force_n
    if switch.by == "speed" and c < 0:
        less = -0.8 * declared.device.coulomb_friction_n
        smaller = replace(law, switch=replace(switch, force_n=less))
        yield Remedy("switched_n", -less, -c, "force"), one, smaller, scene
        return
    swing = scene.swing
    omega = 2 * math.pi * swing.frequency_hz
    sizes: dict[str, tuple[float, Measure]] = {
        "speed": (swing.peak_to_peak_m * omega, "speed"),
        "force": (swing.force_peak_to_peak_n, "force"),
    }
    size, quantity = sizes.get(switch.by, (swing.peak_to_peak_m, "length"))
    for factor in np.geomspace(0.02, 8.0, 12).tolist():
        # A wider one is softer: it is played with a fifth less.
        yield Remedy("switch_width", factor * size, 0.0, quantity), one, law, replace(scene, width=0.8 * factor * size)
