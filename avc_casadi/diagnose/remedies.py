"""The fitted plant in time, with stops, friction, relay, encoder and noise; a remedy is one that settles there."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize

from avc_casadi._util.arrays import FloatArray
from avc_casadi.diagnose.law import Law, Switch
from avc_casadi.diagnose.oscillation import Log, Oscillation
from avc_casadi.diagnose.plant import Design, Hypothesis, growth, stable
from avc_casadi.loops.margins import SETTLING_BAND
from avc_casadi.model.hands import Hand
from avc_casadi.model.plant import device_plant, sampled_plant, transition

# Over fewer encoder steps a swing is compared by its force; a remedy leaves this share of a swing, or a step and a
# half; a simulation that swings keeps at least a third. Shares of the amplitude of the log from which it has to rest.
_FEW_STEPS, _RESTS, _SWINGS, _MOST_TICKS, _STARTS = 6.0, 0.15, 0.35, 5000, (1.0, 0.87, 0.7)


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
    start: float = 1.0  # share of the amplitude of the log

    @classmethod
    def of(cls, log: Log, swing: Oscillation, law: Law, design: Design, scatter_m: float) -> Scene:
        """Return the scene of a log."""
        inside = slice(swing.first, swing.last)
        force = log.force_n[inside]
        edges = law.switch.edges_m if law.switch is not None else (0.0, 0.0)
        centre = -law.offset_n / law.stiffness_n_per_m if law.stiffness_n_per_m > 0 else sum(edges) / 2
        sided = np.mean(force < 0) < 0.01 and (np.mean(log.touching[inside]) < 0.99 or (force > 0).all())
        noise = math.sqrt(max(scatter_m**2 - log.encoder_m**2 / 12, 0.0))
        limit = design.device.max_force_n or float(np.abs(log.force_n).max())
        rest = float(log.position_m[inside].mean()) - centre
        return cls(swing, centre, rest, float(force.mean()), bool(sided), log.encoder_m, noise, limit)

    def play(self, one: Hypothesis, law: Law) -> tuple[FloatArray, FloatArray]:
        """Return position and commanded force at every tick, from the amplitude of the log on."""
        period, step, centre = one.device.sample_time_s, self.encoder_m, self.centre_m
        keep, frames = law.keep, law.frames
        n = int(np.clip(max(1.5, 25 / max(self.swing.frequency_hz, 0.1)) / period, 200, _MOST_TICKS))
        plant = device_plant(one.device, one.hand).linear()
        rubbing = replace(plant, force=plant.friction)
        row, rubs = sampled_plant(one.device, one.hand).output_row, one.device.coulomb_friction_n
        # Stops are stiff and lossy beside the swing; they act over a part of their period, friction over a quarter.
        stop_rate = 12 * math.pi * self.swing.frequency_hz
        most_s = min(period / 4 if rubs else period, math.inf if one.stops is None else 0.15 / stop_rate)
        whole, part = int(one.delay + law.lag), (one.delay + law.lag) % 1.0
        moves = []
        for length, back in ((part, whole + 1), (1 - part, whole)):
            if length > 1e-9:
                count = math.ceil(length * period / most_s - 1e-9)
                move, rub = (transition(each, length * period / count) for each in (plant, rubbing))
                moves.append((move.matrix, move.force, rub.force, back, count))
        # In the mean, what holds the device balances the force of the log.
        spring = float(np.atleast_1d(one.hand.stiffness_n_per_m)[0]) if isinstance(one.hand, Hand) else 0.0
        push, state = self.force_n + spring * self.rest_m, np.zeros(len(plant.names))
        # A device that bounces off a wall on one side comes from outside.
        away = self.start * self.swing.peak_to_peak_m / (-2 if self.one_sided else 2)
        state[[name.endswith("_position_m") for name in plant.names]] = self.rest_m + away
        noise = self.noise_m * np.random.default_rng(0).standard_normal(n)
        rate, (position, reading, force) = 0.0, np.zeros((3, n))
        for tick in range(n):
            position[tick] = at = float(row @ state)
            if not abs(at) < 1e6:
                position[tick:] = np.linspace(1, 2, n - tick) * 1e6 * np.cos(np.arange(n - tick))
                break
            x = at + noise[tick]
            reading[tick] = x = step * math.floor((x + centre) / step + 0.5) - centre if step else x
            rate = keep * rate + (1 - keep) * (x - reading[max(tick - 1, 0)]) / period
            read = x, rate
            if frames is not None:
                new = max(tick - tick % frames.ticks - round(frames.late * frames.ticks), 0)
                slow = (reading[new] - reading[max(new - frames.ticks, 0)]) / (frames.ticks * period)
                read = (reading[new], rate) if frames.slow == "spring" else (x, slow)
            plain = law.stiffness_n_per_m * (read[0] + centre) + law.damping_ns_per_m * read[1] + law.offset_n
            force[tick] = self._command(law, plain, x, rate)
            for matrix, by_force, beside, back, count in moves:
                drive = by_force * (force[tick - back] if tick >= back else 0.0)
                for _ in range(count):
                    other = -push
                    if one.stops is not None:
                        low, high = (stop - centre for stop in one.stops)
                        beyond = float(row @ state) - min(max(float(row @ state), low), high)
                        stiff = stop_rate * beyond + 0.2 * state[1] if beyond else 0.0
                        other += one.device.mass_kg * stop_rate * stiff
                    state = matrix @ state + drive + beside * other
                    state = state + beside * min(max(-state[1] / beside[1], -rubs), rubs) if rubs else state
        return position, force

    def _command(self, law: Law, force: float, x: float, rate: float) -> float:
        """Return a force with its switched part, one-sided and limited."""
        switch, width = law.switch, self.width
        if switch is not None:
            low, high = (edge - self.centre_m if switch.by == "position" else 0.0 for edge in switch.edges_m)
            value = {"position": x, "speed": rate, "force": force}[switch.by]
            sign = float(np.sign(value - low) + np.sign(value - high)) / 2
            if width:
                sign = min(max((value - high) / width, 0.0), 1.0) - min(max((low - value) / width, 0.0), 1.0)
            force += switch.force_n * sign
        if self.one_sided:
            force = max(force, 0.0) if x > 0 or law.stiffness_n_per_m <= 0 else 0.0
        return min(max(force, -self.limit_n), self.limit_n)

    def residual_swing(self, one: Hypothesis, law: Law, quarter: int = 3) -> float:
        """Return the swing in the last or another quarter of a simulation, as a share of that of the log."""
        position, force = (np.array_split(each, 4)[quarter] for each in self.play(one, law))
        shakes = float(np.ptp(np.quantile(force, (0.01, 0.99)))) / max(self.swing.force_peak_to_peak_n, 1e-12)
        size = float(np.ptp(position))
        moves = 0.0 if size < 1.5 * self.encoder_m else size / self.swing.peak_to_peak_m
        # At rest an encoder step may shake with half of the force of the log.
        return shakes if self.swing.steps < _FEW_STEPS else max(moves, 2 * _RESTS * shakes)

    def settles(self, one: Hypothesis, law: Law) -> bool:
        """Return whether simulations come to rest: over few encoder steps one may by chance."""
        most = 0.3 if self.swing.steps < _FEW_STEPS else _RESTS
        return all(replace(self, start=share).residual_swing(one, law) < most for share in _STARTS)

    def rests(self, every: Sequence[Hypothesis], law: Law) -> tuple[bool, bool]:
        """Return whether a loop comes to rest as soon as a user expects, and without dry friction too."""
        # Settled within a second, a slow swing within five cycles.
        slowest = math.log(SETTLING_BAND) / max(1.0, 5 / self.swing.frequency_hz)
        # A sign of the position that grows over a width is a spring there.
        ramp = law.switch.force_n / self.width if law.switch and law.switch.by == "position" and self.width else 0.0
        steep = replace(law, stiffness_n_per_m=law.stiffness_n_per_m + ramp)
        rates = [growth(one, steep) for one in every] if law.frames is None else []
        sound = all(rate < 0 for rate in rates) and all(rate < slowest for rate in rates[:1])
        cases = [every[0], max(every, key=lambda one: one.delay)] if law.switch else every[:1]
        settles = (sound or law.switch is not None) and all(self.settles(one, law) for one in cases)
        free = [one.vary(coulomb_friction_n=0.0) for one in cases if law.switch]
        return settles, settles and sound and all(self.decays(one, law) for one in free)

    def decays(self, one: Hypothesis, law: Law) -> bool:
        """Return whether a simulation is on the way to rest."""
        return self.settles(one, law) or self.residual_swing(one, law) < 0.8 * self.residual_swing(one, law, 1)

    def swings(self, one: Hypothesis, law: Law) -> bool:
        """Return whether a simulation goes on about as the log does; growth has no size of its own."""
        residual = self.residual_swing(one, law)
        return residual > _SWINGS and (residual < 5.0 or self.swing.kind == "growing")


@dataclass(frozen=True)
class Remedy:
    """A change with which the simulation of the fitted plant settles; by dry friction, or while this hand holds it."""

    key: str
    value: float
    before: float
    quantity: str
    by_friction: bool = False
    while_held: bool = False


def without(cause: str, one: Hypothesis, law: Law, log: Log, design: Design) -> tuple[Hypothesis, Law]:
    """Return the loop without what was not intended; a frame that comes late is late by its rate."""
    if cause == "delay":
        return one.vary(delay_samples=design.latest(log)), replace(law, lag=0)
    if cause == "rate":
        slower = design.known and design.samples_a_tick(log) > 1
        fast = design.device.sample_time_s if slower else log.sample_time_s
        keep, lag = law.keep ** (fast / log.period_s) if law.keep else 0.0, 0 if log.hold > 1 else law.lag
        return one.vary(sample_time_s=fast), replace(law, keep=keep, lag=lag)
    return (one.vary(resonance=None), law) if cause == "resonance" else (one, replace(law, switch=None, frames=None))


def limit_of(one: Hypothesis, law: Law, gain: str) -> float:
    """Return the largest factor, at most 1, of stiffness or damping at which the loop is stable; 0 for none."""
    factors = np.geomspace(1.0, 0.01, 25).tolist()
    first = next((at for at, factor in enumerate(factors) if stable(one, law, **{gain: factor})), None)
    if not first:
        return 0.0 if first is None else 1.0
    ends = factors[first], factors[first - 1]
    return float(optimize.brentq(lambda factor: growth(one, law, **{gain: factor}), *ends, rtol=3e-3))


def remedies_of(
    cause: str, answers: Sequence[Hypothesis], law: Law, scene: Scene, log: Log, design: Design
) -> tuple[Remedy, ...]:
    """Return the changes that settle a simulation of the fitted plant, one of each kind, those of the cause first."""
    found: dict[str, Remedy] = {}
    for remedy, values, its, its_scene in _changes(cause, answers[0], law, scene, log, design):
        first = found.get(remedy.key)
        if first and not (first.by_friction or first.while_held):
            continue
        every = [one.vary(**values) for one in answers]
        if (held := its_scene.rests(every, its))[0]:
            released = its_scene.rests([replace(one, hand=None) for one in every], its)
            candidate = replace(remedy, by_friction=not held[1], while_held=released < held)
            found[remedy.key] = min(first or candidate, candidate, key=lambda one: one.by_friction + one.while_held)
    return tuple(found.values())


_Change = tuple[Remedy, dict[str, object], Law, Scene]


def _changes(cause: str, one: Hypothesis, law: Law, scene: Scene, log: Log, design: Design) -> Iterator[_Change]:
    """Yield what may help, values of the device, law and scene, the largest change that may do of each kind first."""
    period, frames, switch = log.period_s, law.frames, law.switch
    if cause == "relay" and switch is not None:
        return (yield from _of_switch(law, switch, scene, design))
    if cause == "rates" and frames is not None:
        yield Remedy("sample_time_s", period, frames.ticks * period, "time"), {}, replace(law, frames=None), scene
        spring = frames.slow == "spring"
        now = law.stiffness_n_per_m if spring else law.damping_ns_per_m
        return (yield from _of_gain(law, scene, spring, [part * now for part in (0.7, 0.5, 0.35, 0.2, 0.1, 0.05)]))
    if cause == "rate":
        faster, its_law = without("rate", one, law, log, design)
        fast, its_law = faster.device.sample_time_s, replace(its_law, lag=law.lag)
        yield Remedy("sample_time_s", fast, period, "time"), {"sample_time_s": fast}, its_law, scene
    late, each = one.delay + law.lag, design.samples_a_tick(log)
    for delay in (design.latest(log), 0.7 * late, 0.5 * late, 0.3 * late):
        # Further than a log may be off.
        if cause in {"delay", "stiffness", "damping"} and delay < min(0.9 * late, late - 0.35):
            remedy = Remedy("delay_samples", each * delay, each * late, "samples")
            yield remedy, {"delay_samples": delay}, replace(law, lag=0), scene
    for spring in (False, True) if cause in {"damping", "encoder"} else (True, False):
        now = law.stiffness_n_per_m if spring else law.damping_ns_per_m
        limit = now * limit_of(one, law, "stiffness" if spring else "damping")
        yield from _of_gain(law, scene, spring, [limit * part for part in (0.8, 0.6, 0.4, 0.25, 0.12) if limit > 0])
    # A spring that acts so late takes k times that of damping.
    loss = law.stiffness_n_per_m * (late + 0.5) * period
    yield from _of_gain(law, scene, False, [law.damping_ns_per_m + part * loss for part in (0.25, 0.5, 1.0, 2.0, 4.0)])
    cut = law.filter_hz(period)
    # A filter where noise shakes the force; a quicker one where its lag may.
    quicker = [cut * times for times in (2.0, 4.0, 8.0, 16.0) if cut * times < 0.45 / period] if cut else []
    for hertz in quicker if cause != "encoder" else () if cut else (150.0, 60.0, 25.0):
        filter_law = replace(law, keep=math.exp(-2 * math.pi * hertz * period))
        yield Remedy("velocity_filter_hz", hertz, cut or 0.5 / period, "frequency"), {}, filter_law, scene
    for finer in (2.0, 4.0, 8.0) if cause == "encoder" and scene.encoder_m else ():
        smooth = replace(scene, encoder_m=scene.encoder_m / finer, noise_m=scene.noise_m / finer)
        yield Remedy("encoder_resolution_m", smooth.encoder_m, scene.encoder_m, "length"), {}, law, smooth


def _of_gain(law: Law, scene: Scene, spring: bool, values: Sequence[float]) -> Iterator[_Change]:
    """Yield the law with other values of stiffness or damping."""
    key, quantity = ("stiffness_n_per_m", "stiffness") if spring else ("damping_ns_per_m", "damping")
    for value in values:
        other = replace(law, stiffness_n_per_m=value) if spring else replace(law, damping_ns_per_m=value)
        yield Remedy(key, value, getattr(law, key), quantity), {}, other, scene


def _of_switch(law: Law, switch: Switch, scene: Scene, design: Design) -> Iterator[_Change]:
    """Yield widths over which a switched force grows, or a force below the friction that it compensates."""
    if switch.by == "speed" and switch.force_n < 0:
        less = 0.8 * design.device.coulomb_friction_n
        smaller = replace(law, switch=replace(switch, force_n=-less))
        return (yield Remedy("switched_n", less, -switch.force_n, "force"), {}, smaller, scene)
    size, quantity, swing = scene.swing.peak_to_peak_m, "length", scene.swing
    if switch.by != "position":
        speed = size * 2 * math.pi * swing.frequency_hz
        size, quantity = (speed, "speed") if switch.by == "speed" else (swing.force_peak_to_peak_n, "force")
    # Of a switch at the force limit the size is not seen. A wider ramp is softer: it is played with a fifth less.
    visible = abs(switch.force_n) < 0.999 * (design.device.max_force_n or math.inf)
    for width in (size * np.geomspace(0.02, 8.0, 12)).tolist() if visible else ():
        yield Remedy("switch_width", width, 0.0, quantity), {}, law, replace(scene, width=0.8 * width)
