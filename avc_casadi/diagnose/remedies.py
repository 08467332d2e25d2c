"""The fitted plant in time, with stops, friction, relay, encoder and noise; a remedy is one that settles there."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.diagnose.law import Law, Switch
from avc_casadi.diagnose.oscillation import Log, Oscillation
from avc_casadi.diagnose.plant import Declared, Hypothesis, stable
from avc_casadi.model.hands import Hand
from avc_casadi.model.plant import device_plant, sampled_plant, transition

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
    width: float = 0.0  # over which a switched force grows, 0 at once

    @classmethod
    def of(cls, log: Log, swing: Oscillation, law: Law, declared: Declared, scatter_m: float) -> Scene:
        """Return the scene of a log."""
        inside = slice(swing.first, swing.last)
        force = log.force_n[inside]
        edges = law.switch.edges_m if law.switch is not None else (0.0, 0.0)
        centre = -law.offset_n / law.stiffness_n_per_m if law.stiffness_n_per_m > 0 else sum(edges) / 2
        return cls(
            swing=swing,
            centre_m=centre,
            rest_m=float(log.position_m[inside].mean()) - centre,
            force_n=float(force.mean()),
            one_sided=bool(np.mean(force < 0) < 0.01 and (np.mean(log.touching[inside]) < 0.99 or (force > 0).all())),
            encoder_m=log.encoder_m,
            noise_m=math.sqrt(max(scatter_m**2 - log.encoder_m**2 / 12, 0.0)),
            limit_n=declared.device.max_force_n or float(np.abs(log.force_n).max()),
        )

    def play(self, one: Hypothesis, law: Law, seed: int = 0) -> tuple[FloatArray, FloatArray]:
        """Return position and commanded force at every tick, from the amplitude of the log on."""
        period, step, centre = one.device.sample_time_s, self.encoder_m, self.centre_m
        keep, frames = law.keep, law.frames
        n = int(np.clip(max(1.5, 25 / max(self.swing.frequency_hz, 0.1)) / period, 200, _MOST_TICKS))
        plant = device_plant(one.device, one.hand).linear()
        rubbing = replace(plant, force=plant.friction)
        row, rubs = sampled_plant(one.device, one.hand).measured, one.device.coulomb_friction_n
        # Stops are stiff and lossy beside the swing; they act over a part of their period, friction over a quarter.
        stop_rate = 12 * math.pi * self.swing.frequency_hz
        most_s = min(period / 4 if rubs else period, math.inf if one.stops is None else 0.15 / stop_rate)
        whole, part = int(one.delay + law.lag), (one.delay + law.lag) % 1.0
        moves = []
        for length, back in ((part, whole + 1), (1 - part, whole)):
            if length > 1e-9:
                count = math.ceil(length * period / most_s - 1e-9)
                moved, rubbed = (transition(each, length * period / count) for each in (plant, rubbing))
                moves.append((moved.matrix, moved.force, rubbed.force, back, count))
        # In the mean, what holds the device balances the force of the log.
        spring = float(np.atleast_1d(one.hand.stiffness_n_per_m)[0]) if isinstance(one.hand, Hand) else 0.0
        push = self.force_n + spring * self.rest_m
        state = np.zeros(len(plant.names))
        # A device that bounces off a wall on one side comes from outside.
        away = self.swing.peak_to_peak_m / (-2 if self.one_sided else 2)
        state[[name.endswith("_position_m") for name in plant.names]] = self.rest_m + away
        noise = self.noise_m * np.random.default_rng(seed).standard_normal(n)
        position, seen, force = np.zeros((3, n))
        rate = 0.0
        for tick in range(n):
            position[tick] = at = float(row @ state)
            if not abs(at) < 1e6:
                position[tick:] = np.linspace(1, 2, n - tick) * 1e6 * np.cos(np.arange(n - tick))
                break
            x = at + noise[tick]
            seen[tick] = x = step * math.floor((x + centre) / step + 0.5) - centre if step else x
            rate = keep * rate + (1 - keep) * (x - seen[max(tick - 1, 0)]) / period
            read = x, rate
            if frames is not None:
                new = max(tick - tick % frames.ticks - frames.late * frames.ticks, 0)
                slow = (seen[new] - seen[max(new - frames.ticks, 0)]) / (frames.ticks * period)
                read = (seen[new], rate) if frames.slow == "spring" else (x, slow)
            plain = law.stiffness_n_per_m * (read[0] + centre) + law.damping_ns_per_m * read[1] + law.offset_n
            force[tick] = self._command(law, plain, x, rate)
            for matrix, by_force, beside, back, count in moves:
                driven = by_force * (force[tick - back] if tick >= back else 0.0)
                for _ in range(count):
                    other = -push
                    if one.stops is not None:
                        low, high = (stop - centre for stop in one.stops)
                        beyond = float(row @ state) - min(max(float(row @ state), low), high)
                        stiff = stop_rate * beyond + 0.2 * state[1] if beyond else 0.0
                        other += one.device.mass_kg * stop_rate * stiff
                    state = matrix @ state + driven + beside * other
                    state = state + beside * min(max(-state[1] / beside[1], -rubs), rubs) if rubs else state
        return position, force

    def _command(self, law: Law, force: float, x: float, rate: float) -> float:
        """Return a force with its switched part, one-sided and limited."""
        switch, width = law.switch, self.width
        if switch is not None:
            value, low, high = {
                "position": (x, switch.edges_m[0] - self.centre_m, switch.edges_m[1] - self.centre_m),
                "speed": (rate, 0.0, 0.0),
                "force": (force, 0.0, 0.0),
            }[switch.by]
            sign = (np.sign(value - low) + np.sign(value - high)) / 2
            if width:
                sign = min(max((value - high) / width, 0.0), 1.0) - min(max((low - value) / width, 0.0), 1.0)
            force += switch.force_n * float(sign)
        if self.one_sided:
            force = max(force, 0.0) if x > 0 or law.stiffness_n_per_m <= 0 else 0.0
        return min(max(force, -self.limit_n), self.limit_n)

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
        return self.left(one, law) < (0.3 if self.swing.steps < _FEW_STEPS else _RESTS)

    def swings(self, one: Hypothesis, law: Law) -> bool:
        """Return whether a simulation goes on about as the log does; growth has no size of its own."""
        left = self.left(one, law)
        return left > _SWINGS and (left < 5.0 or self.swing.kind == "growing")


Measure = Literal["stiffness", "damping", "samples", "time", "frequency", "length", "force", "speed"]


@dataclass(frozen=True)
class Remedy:
    """A change with which the simulation of the fitted plant settles: its key, value, that of the log, and quantity."""

    key: str
    value: float
    before: float
    quantity: Measure


def intended(one: Hypothesis, law: Law, log: Log, declared: Declared) -> tuple[Hypothesis, Law]:
    """Return the loop at the rate that was intended: gains, filter in seconds and delay in samples stay."""
    slower = declared.known and log.period_s > 1.3 * declared.device.sample_time_s
    fast = declared.device.sample_time_s if slower else log.sample_time_s
    keep = law.keep ** (fast / log.period_s) if law.keep else 0.0
    return one.changed(sample_time_s=fast), replace(law, keep=keep)


def without(cause: str, one: Hypothesis, law: Law, log: Log, declared: Declared) -> tuple[Hypothesis, Law]:
    """Return the loop without a delay, rate, resonance, switched part or second rate that was not intended."""
    if cause == "delay":
        return one.changed(delay_samples=declared.delays_in(log)[1]), replace(law, lag=0)
    if cause == "rate":
        return intended(one, law, log, declared)
    return (one.changed(resonance=None), law) if cause == "resonance" else (one, replace(law, switch=None, frames=None))


def limit_of(one: Hypothesis, law: Law, gain: str) -> float | None:
    """Return the largest factor, at most 1, of stiffness or damping at which the loop is stable, or None."""
    factors = np.geomspace(1.0, 0.01, 25).tolist()
    first = next((at for at, factor in enumerate(factors) if stable(one, law, **{gain: factor})), None)
    if not first:
        return first if first is None else 1.0
    low, high = factors[first], factors[first - 1]
    for _ in range(6):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if stable(one, law, **{gain: middle}) else (low, middle)
    return float(low)


_Change = tuple[Remedy, Hypothesis, Law, Scene]


def remedies_of(
    cause: str, answers: Sequence[Hypothesis], law: Law, scene: Scene, log: Log, declared: Declared
) -> tuple[Remedy, ...]:
    """Return the changes that settle a simulation of the fitted plant, one of each kind, those of the cause first."""
    found: dict[str, Remedy] = {}
    nonlinear = law.switch is not None or law.frames is not None
    others = [_changes(cause, one, answers, law, scene, log, declared) for one in answers]
    for same in zip(*others, strict=True):
        remedy, changed, its_law, its_scene = same[0]
        sound = nonlinear or all(stable(other, its) for _, other, its, _ in same)
        if remedy.key not in found and sound and its_scene.settles(changed, its_law):
            found[remedy.key] = remedy
    return tuple(found.values())


def _changes(
    cause: str, one: Hypothesis, answers: Sequence[Hypothesis], law: Law, scene: Scene, log: Log, declared: Declared
) -> Iterator[_Change]:
    """Yield what may help, the largest change that may do of each kind first."""
    period, frames = log.period_s, law.frames
    if cause == "relay" and law.switch is not None:
        yield from _of_switch(one, law, law.switch, scene, declared)
        return
    if cause == "rates" and frames is not None:
        yield Remedy("sample_time_s", period, frames.ticks * period, "time"), one, replace(law, frames=None), scene
        yield from _of_gain(one, law, scene, frames.slow == "spring", (0.7, 0.5, 0.35, 0.25, 0.15, 0.08, 0.04))
        return
    if cause == "rate":
        faster, its_law = intended(one, law, log, declared)
        yield Remedy("sample_time_s", faster.device.sample_time_s, period, "time"), faster, its_law, scene
    if cause in {"delay", "stiffness", "damping"}:
        late, meant = answers[0].delay + law.lag, declared.delays_in(log)[1]
        punctual = replace(law, lag=0)
        for delay in (meant, 0.7 * late, 0.5 * late, 0.3 * late):
            if delay < min(0.9 * late, late - 0.35):  # further than a log may be off
                yield Remedy("delay_samples", delay, late, "samples"), one.changed(delay_samples=delay), punctual, scene
    for spring in (False, True) if cause in {"damping", "encoder"} else (True, False):
        positive = (law.stiffness_n_per_m if spring else law.damping_ns_per_m) > 0
        limit = limit_of(answers[0], law, "stiffness" if spring else "damping") if positive else None
        if limit:
            yield from _of_gain(one, law, scene, spring, [limit * factor for factor in (0.8, 0.6, 0.4, 0.25, 0.12)])
    yield from _of_damper(cause, one, law, scene, period)


def _of_damper(cause: str, one: Hypothesis, law: Law, scene: Scene, period: float) -> Iterator[_Change]:
    """Yield the damper with its sign turned, filters of the velocity, and finer encoders."""
    b, cut = law.damping_ns_per_m, law.filter_hz(period)
    if b < 0:
        yield from _of_gain(one, law, scene, False, (-1.0, 0.0))
    for hertz in (150.0, 60.0, 25.0) if cut is None and cause == "encoder" else ():
        filtered = replace(law, keep=math.exp(-2 * math.pi * hertz * period))
        yield Remedy("velocity_filter_hz", hertz, 0.5 / period, "frequency"), one, filtered, scene
    for times in (2.0, 4.0, 8.0, 16.0) if cut is not None and cause != "encoder" else ():
        quicker, hertz = replace(law, keep=law.keep**times), times * (cut or 0.0)
        if hertz < 0.45 / period:
            yield Remedy("velocity_filter_hz", hertz, cut or 0.0, "frequency"), one, quicker, scene
    for finer in (2.0, 4.0, 8.0) if cause == "encoder" and scene.encoder_m else ():
        smooth = replace(scene, encoder_m=scene.encoder_m / finer, noise_m=scene.noise_m / finer)
        yield Remedy("encoder_resolution_m", smooth.encoder_m, scene.encoder_m, "length"), one, law, smooth


def _of_gain(one: Hypothesis, law: Law, scene: Scene, spring: bool, factors: Sequence[float]) -> Iterator[_Change]:
    """Yield the law with less stiffness or damping."""
    key = "stiffness_n_per_m" if spring else "damping_ns_per_m"
    now = law.stiffness_n_per_m if spring else law.damping_ns_per_m
    for factor in factors:
        less = Remedy(key, factor * now, now, "stiffness" if spring else "damping")
        softer = replace(law, stiffness_n_per_m=less.value) if spring else replace(law, damping_ns_per_m=less.value)
        yield less, one, softer, scene


def _of_switch(one: Hypothesis, law: Law, switch: Switch, scene: Scene, declared: Declared) -> Iterator[_Change]:
    """Yield widths over which a switched force grows, or a force below the friction that it compensates."""
    if switch.by == "speed" and switch.force_n < 0:
        less = 0.8 * declared.device.coulomb_friction_n
        smaller = replace(law, switch=replace(switch, force_n=-less))
        yield Remedy("switched_n", less, -switch.force_n, "force"), one, smaller, scene
        return
    swing = scene.swing
    sizes: dict[str, tuple[float, Measure]] = {
        "position": (swing.peak_to_peak_m, "length"),
        "speed": (swing.peak_to_peak_m * 2 * math.pi * swing.frequency_hz, "speed"),
        "force": (swing.force_peak_to_peak_n, "force"),
    }
    size, quantity = sizes[switch.by]
    for width in (size * np.geomspace(0.02, 8.0, 12)).tolist():
        # A wider one is softer: it is played with a fifth less.
        yield Remedy("switch_width", width, 0.0, quantity), one, law, replace(scene, width=0.8 * width)
