"""Effects between plant and computer: noise, encoder and filters on the way in; limit, delay and lag on the way out."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from avc_casadi._errors import InputError
from avc_casadi._util.arrays import FloatArray
from avc_casadi.model.declared import scene_effects
from avc_casadi.model.effects import (
    AmplifierEffect,
    DelayEffect,
    EncoderEffect,
    JitterEffect,
    NoiseEffect,
    NotchEffect,
    SaturationEffect,
)
from avc_casadi.model.plant import DEVICE, HANDLE, Plant
from avc_casadi.model.problem import Problem
from avc_casadi.model.runtime import Poles, VelocityFilterEffect, velocity_poles
from avc_casadi.simulation.effects.base import SceneEffect, TableEffect, positive_number
from avc_casadi.simulation.tick import Tick, ca, delay_line


class Jitter(TableEffect, keys=JitterEffect, rank=220, scene_alone=True):
    """The new force is late by |e|, e Gaussian, at most one sample; in a dropped sample the computer does nothing."""

    def sample(self, tick: Tick) -> None:
        """Let the new force act late by a drawn share of a sample; in a dropped sample the force before goes on."""
        if tick.command is None:
            return
        before = tick.state("force_before_n", computed=False)
        if self.table.dropped_share > 0:
            tick.dropped = tick.input("dropped", self._drops)
            tick.command = ca.if_else(tick.dropped, before, tick.command)
        if self.table.rms_s > 0:
            tick.command_before = before
            sample_time_s = tick.sample_time_s
            tick.late = tick.input("late_share", lambda samples, run: self._lateness(samples, run, sample_time_s))
        tick.follow("force_before_n", tick.command)

    def _drops(self, samples: int, run: int) -> FloatArray:
        draws = np.random.default_rng((self.table.seed, run, 1)).random(samples)
        return np.asarray(draws < self.table.dropped_share, dtype=np.float64)

    def _lateness(self, samples: int, run: int, sample_time_s: float) -> FloatArray:
        draws = np.random.default_rng((self.table.seed, run, 2)).standard_normal(samples)
        return np.asarray(np.minimum(np.abs(draws) * self.table.rms_s / sample_time_s, 1.0))


class Delay(TableEffect, keys=DelayEffect, rank=210, device_keys={"samples": "delay_samples"}):
    """A delay line of commands; a fractional part lets the previous command act for a share of the sample."""

    def sample(self, tick: Tick) -> None:
        """Shift the command into the line and take the oldest, or the last two."""
        if tick.command is None:
            return
        whole = int(self.table.samples)
        late = float(self.table.samples - whole)
        tick.undelayed = tick.command
        line = delay_line(tick, "delayed", tick.command, whole + (late > 0))
        tick.command = line[whole]
        if late > 0:
            tick.late, tick.command_before = late, line[whole + 1]


class Noise(TableEffect, keys=NoiseEffect, rank=70, scene_alone=True, device_keys={"rms_m": "position_noise_rms_m"}):
    """White Gaussian noise on each sampled position, before an encoder."""

    def sample(self, tick: Tick) -> None:
        rms, seed = self.table.rms_m, self.table.seed

        def noise_m(samples: int, run: int) -> FloatArray:
            return np.asarray(rms * np.random.default_rng((seed, run)).standard_normal(samples))

        tick.position += tick.input("noise_m", noise_m)


@dataclass(frozen=True)
class Encoder(SceneEffect, keys=EncoderEffect, rank=80):
    """Rounds the position to the nearest step, of the motor or of the handle."""

    resolution_m: float
    body: str = DEVICE
    phase: FloatArray | None = None

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        """Build it at the motor or at the handle; a missing step is taken from the device."""
        default = problem.device.encoder_resolution_m
        resonant = any(effect.kind == "resonance" for effect in scene_effects(problem))
        if (table.at or problem.device.encoder_at) == "handle" and (table.at is not None or resonant):
            if not resonant:
                message = 'is "handle", but there is no resonance; add the effect resonance, or use "motor"'
                raise InputError.of(message, file=problem.name, key=f"{place}.at")
            return cls(default if table.resolution_m is None else table.resolution_m, HANDLE)
        return cls(positive_number(table.resolution_m, problem, f"{place}.resolution_m", "encoder_resolution_m"))

    @property
    def numbers(self) -> FloatArray:
        """The phase of each hand, shape (hands, 1)."""
        return np.zeros(0) if self.phase is None or self.resolution_m == 0 else self.phase[:, None]

    def sample(self, tick: Tick) -> None:
        if self.resolution_m > 0:
            phase = 0.0 if self.phase is None else tick.parameter("encoder_phase")
            tick.position = self.resolution_m * (ca.floor(tick.position / self.resolution_m - phase + 0.5) + phase)


class CommandNotch(TableEffect, keys=NotchEffect, rank=100, scene_alone=True):
    """(s^2 + d w omega s + omega^2)/(s^2 + w omega s + omega^2) by Tustin's rule, exact at its frequency; 1 at rest."""

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        nyquist = 0.5 / problem.device.sample_time_s
        if table.frequency_hz >= nyquist:
            message = f"is {table.frequency_hz:g}; allowed: below the Nyquist frequency {nyquist:g} Hz"
            raise InputError.of(message, file=problem.name, key=f"{place}.frequency_hz")
        return super().build(table, problem, place)

    def section(self, sample_time_s: float) -> tuple[float, float, float, float, float]:
        """Return b0, b1, b2, a1, a2 of the discrete notch, by Tustin's rule with the frequency prewarped."""
        half = math.tan(math.pi * self.table.frequency_hz * sample_time_s)
        wide, square = self.table.width * half, half * half
        whole = 1 + wide + square
        middle = 2 * (square - 1) / whole
        return (
            (1 + self.table.depth * wide + square) / whole,
            middle,
            (1 - self.table.depth * wide + square) / whole,
            middle,
            (1 - wide + square) / whole,
        )

    def sample(self, tick: Tick) -> None:
        """Replace the position: y(k) = b0 u(k) + b1 u(k-1) + b2 u(k-2) - a1 y(k-1) - a2 y(k-2), initially at rest."""
        b0, b1, b2, a1, a2 = self.section(tick.sample_time_s)
        first = tick.state("notch_first_m", (1 - b0) * tick.start_m)
        second = tick.state("notch_second_m", (b2 - a2) * tick.start_m)
        coming = tick.position
        tick.position = b0 * coming + first
        tick.follow("notch_first_m", b1 * coming - a1 * tick.position + second)
        tick.follow("notch_second_m", b2 * coming - a2 * tick.position)


@dataclass(frozen=True)
class VelocityFilter(SceneEffect, keys=VelocityFilterEffect, rank=130, scene_alone=True):
    """Velocity estimator of coupling, environment and contact damper."""

    poles: Poles

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        return cls(velocity_poles(problem.device, problem.scene, table, problem.name, place))

    def sample(self, tick: Tick) -> None:
        tick.poles = self.poles


class Saturation(TableEffect, keys=SaturationEffect, rank=200, device_keys={"force_n": "max_force_n"}):
    """Saturation of the commanded force."""

    def sample(self, tick: Tick) -> None:
        if tick.command is not None:
            tick.command = ca.fmin(ca.fmax(tick.command, -self.table.force_n), self.table.force_n)


class Amplifier(TableEffect, keys=AmplifierEffect, rank=230, scene_alone=True):
    """Lag between the command and the force."""

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        device, key = problem.device, "amplifier_bandwidth_hz"
        bandwidth = positive_number(table.bandwidth_hz, problem, f"{place}.bandwidth_hz", key)
        ratio = table.damping_ratio or device.amplifier_damping_ratio
        numbers = {"bandwidth_hz": bandwidth, "order": table.order or device.amplifier_order, "damping_ratio": ratio}
        return cls(table.model_copy(update=numbers))

    def mechanics(self, plant: Plant) -> None:
        plant.actuator_rate_per_s = 2 * math.pi * self.table.bandwidth_hz
        plant.actuator_order = self.table.order
        plant.actuator_damping_ratio = self.table.damping_ratio
