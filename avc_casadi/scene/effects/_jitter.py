"""Irregular timing of the computer: forces that come late and samples that are missed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from avc_casadi._errors import Fault, InputError
from avc_casadi.problem import Problem
from avc_casadi.scene.effects._base import SceneEffect, Station
from avc_casadi.scene.loop import Tick
from avc_casadi.support import FloatArray


@dataclass(frozen=True)
class Jitter(SceneEffect):
    """The position is sampled in time; the new force comes |e| late, e Gaussian, at most one sample.

    In a dropped sample the computer does nothing: the force stays, and the next velocity is taken over two samples.

    Attributes:
        rms_s: standard deviation of e; 0 for forces in time.
        seed: seed of the generator.
        dropped_share: share of the samples that are dropped.
    """

    kind: ClassVar[str] = "jitter"
    station: ClassVar[Station] = Station.ACTUATION

    rms_s: float
    seed: int
    dropped_share: float

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        """Take the table; one of lateness and drops must be there."""
        if table.rms_s == 0 and table.dropped_share == 0:
            message = "rms_s and dropped_share are both 0; allowed: one above 0, or leave the effect out"
            raise InputError([Fault(problem.name, None, place, message)])
        return cls(table.rms_s, table.seed, table.dropped_share)

    def sample(self, tick: Tick) -> None:
        """Draw lateness and drops, and keep the last force."""
        import casadi as ca  # noqa: PLC0415

        if tick.command is None:
            return
        before = tick.state("force_before_n", computed=False)
        if self.dropped_share > 0:
            tick.dropped = tick.input("dropped", self._drops)
            tick.command = ca.if_else(tick.dropped, before, tick.command)
        if self.rms_s > 0:
            tick.command_before = before
            sample_time_s = tick.sample_time_s
            tick.late = tick.input("late_share", lambda samples, run: self._lateness(samples, run, sample_time_s))
        tick.follow("force_before_n", tick.command)

    def _drops(self, samples: int, run: int) -> FloatArray:
        draws = np.random.default_rng((self.seed, run, 1)).random(samples)
        return (draws < self.dropped_share).astype(np.float64)

    def _lateness(self, samples: int, run: int, sample_time_s: float) -> FloatArray:
        draws = np.random.default_rng((self.seed, run, 2)).standard_normal(samples)
        return np.minimum(np.abs(draws) * self.rms_s / sample_time_s, 1.0)
