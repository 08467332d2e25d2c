"""Noise of the position sensor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from avc_casadi.problem import Problem
from avc_casadi.scene.effects._base import SceneEffect, Station, required_number
from avc_casadi.scene.loop import Tick


@dataclass(frozen=True)
class Noise(SceneEffect):
    """White Gaussian noise on each sampled position, before an encoder.

    Attributes:
        rms_m: its standard deviation.
        seed: seed of its generator.
    """

    kind: ClassVar[str] = "noise"
    station: ClassVar[Station] = Station.SENSING

    rms_m: float
    seed: int

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        """Take what is left out from the device."""
        source, default = "device.position_noise_rms_m", problem.device.position_noise_rms_m
        rms = required_number(table.rms_m, default, key="rms_m", place=place, problem=problem, source=source)
        return cls(rms, table.seed)

    def sample(self, tick: Tick) -> None:
        """Add a drawn number to the position."""
        rms, seed = self.rms_m, self.seed
        tick.position += tick.input("noise_m", lambda samples, run: rms * _draw(seed, run, samples))


def _draw(seed: int, run: int, samples: int) -> np.ndarray:
    return np.random.default_rng((seed, run)).standard_normal(samples)
