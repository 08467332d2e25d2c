"""Monodromy matrix of two devices coupled over a link with delay: the periodic loop of a teleoperator.

Each device is exact from one of its samples to the next. At a sample it sends its position, reads the newest one
that has arrived, and holds a force. The product of the maps over one period of both clocks is the monodromy matrix.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._util.arrays import FloatArray

if TYPE_CHECKING:
    from avc_casadi.model.follower import Architecture, ForceSent
    from avc_casadi.model.lifted_loop import ToolGains
    from avc_casadi.model.sampled_plant import SampledPlant

# Largest number of samples of the slower clock until the pattern recurs.
_LONGEST_PERIOD = 8
# Delays are read to this part of a sample.
_FINEST = 10**6


@dataclass(frozen=True)
class LinkClock:
    """Samples of both devices until their pattern recurs, and the age of the data received.

    Attributes:
        events: at each instant, whether the leader and whether the follower takes a sample.
        leader_sees: for each sample of the leader in the period, how many samples of the follower lie between its
            newest one and the one that has arrived.
        follower_sees: the same the other way.
    """

    events: tuple[tuple[bool, bool], ...]
    leader_sees: tuple[int, ...]
    follower_sees: tuple[int, ...]


def link_clocks(leader_s: float, follower_s: float, there_s: float, back_s: float) -> list[LinkClock]:
    """Return the distinct patterns of two clocks, of every phase.

    Args:
        leader_s: sample time of the leader.
        follower_s: of the follower.
        there_s: delay from leader to follower.
        back_s: delay from follower to leader.
    """
    ratio = Fraction(follower_s / leader_s).limit_denominator(_LONGEST_PERIOD)
    if ratio == 0:
        ratio = Fraction(1, _LONGEST_PERIOD)
    there, back = there_s / leader_s, back_s / leader_s
    # Phases recur after one over the denominator; the pattern changes where a message arrives at a sample.
    recurs = Fraction(1, ratio.denominator)
    turns = sorted({Fraction(0), *(Fraction(late).limit_denominator(_FINEST) % recurs for late in (there, -back))})
    between = [(one + other) / 2 for one, other in itertools.pairwise([*turns, recurs])]
    return list(dict.fromkeys(_clock(ratio, phase, there, back) for phase in sorted({*turns, *between})))


def _clock(ratio: Fraction, phase: Fraction, there: float, back: float) -> LinkClock:
    """Return one pattern; times are counted in samples of the leader, `ratio` being a sample of the follower."""
    leader = [Fraction(k) for k in range(ratio.numerator)]
    follower = [k * ratio + phase for k in range(ratio.denominator)]
    times = sorted({*leader, *follower})
    return LinkClock(
        tuple((time in leader, time in follower) for time in times),
        tuple(_age(float(time - phase) / float(ratio), back / float(ratio)) for time in leader),
        tuple(_age(float(time), there) for time in follower),
    )


def _age(samples_since_first: float, delay_samples: float) -> int:
    """Return how many samples of the sender lie between its newest one at a time and the one that has arrived."""
    return math.floor(samples_since_first + 1e-9) - math.floor(samples_since_first - delay_samples + 1e-9)


class BilateralLoop:
    """Leader with hands and follower with environments, ready for the monodromy matrices of any gains.

    A force that is sent was commanded, or measured, at the follower's last sample before the leader's own. State: both
    devices with their pending forces, the positions that each has sent (the newest first), and the
    forces that the follower has sent.

    Args:
        leader: the leader with its hands: one device, or one for each hand.
        follower: the follower with its environments, in the leader's units: one device, or one for each.
        stiffness_n_per_m: of the environments; infinite where the follower is fixed.
        damping_ns_per_m: of the environments.
        clock: of both.
        architecture: position-position or position-force.
        force: force that the follower sends with the latter.
        paired: whether each hand goes with its own environment, all rigid or none, and is the only loop with it; the
            loops have the axes (hands, 1).

    Attributes:
        size: number of states.
        shift: the state with all positions one metre on, shape (size,).
        period_s: after which the pattern recurs.
    """

    def __init__(
        self,
        leader: SampledPlant,
        follower: SampledPlant,
        stiffness_n_per_m: FloatArray,
        damping_ns_per_m: FloatArray,
        clock: LinkClock,
        architecture: Architecture,
        force: ForceSent,
        *,
        paired: bool = False,
    ) -> None:
        self.clock, self._forces, self._measured_force = clock, architecture == "position-force", force == "measured"
        self._plants = (leader, follower)
        maps = [plant.with_forces_under_way() for plant in self._plants]
        # One device with many hands, or as many devices as hands, each in its own.
        self._maps = [
            (matrix.reshape(1, -1, *matrix.shape[-2:]), push.reshape(1, -1, push.shape[-1])) for matrix, push in maps
        ]
        self._paired = paired
        self._rigid = (np.isinf(stiffness_n_per_m),) if paired else (slice(None), np.isinf(stiffness_n_per_m))
        self._fixed = np.isinf(stiffness_n_per_m)
        self._touch = np.zeros((len(stiffness_n_per_m), len(follower.names)))
        body = "handle" if "handle_position_m" in follower.names else "device"
        place = follower.names.index(f"{body}_position_m")
        self._touch[:, place] = np.where(self._fixed, 0.0, stiffness_n_per_m)
        self._touch[:, follower.names.index(f"{body}_velocity_m_per_s")] = damping_ns_per_m
        sizes = [pair[0].shape[-1] for pair in self._maps]
        self._starts = (0, sizes[0])
        # Two positions more than the oldest one used, for its velocity.
        kept = [max(clock.follower_sees) + 2, max(clock.leader_sees) + 2]
        self._sent = (sum(sizes), sum(sizes) + kept[0])
        self._force_sent = sum(sizes) + sum(kept)
        forces = max(clock.leader_sees) + 1 if self._forces else 0
        self._kept, self._forces_kept = kept, forces
        self.size = self._force_sent + forces
        self.shift = np.zeros(self.size)
        for start, plant in zip(self._starts, self._plants, strict=True):
            self.shift[start : start + len(plant.names)] = [name.endswith("_position_m") for name in plant.names]
        self.shift[self._sent[0] : self._force_sent] = 1.0
        self.period_s = leader.sample_time_s * sum(event[0] for event in clock.events)

    def monodromy(self, gains: ToolGains) -> FloatArray:
        """Return the product of all maps over one period, shape (hands, environments, size, size).

        Args:
            gains: K, B and the damper that each loop adds to its own device, at the leader.
        """
        whole = np.broadcast_to(np.eye(self.size), (*self._shape, self.size, self.size))
        seen = [0, 0]
        for event in self.clock.events:
            step = self._samples(event)
            whole = step @ whole
            ages = self._ages(seen)
            whole = self._forward(gains, event, ages) @ whole
            seen = [count + here for count, here in zip(seen, event, strict=True)]
        return np.asarray(whole)

    def force_per_metre(self, gains: ToolGains, environment: int, frequency_hz: float) -> complex:
        """Return the force commanded by the leader's loop per metre of a driven leader's oscillation, N/m.

        Args:
            gains: as for `monodromy`.
            environment: index of the environment.
            frequency_hz: of the leader, whose plant is a `driven_plant`.
        """
        turn = np.exp(2j * np.pi * frequency_hz * self._plants[0].sample_time_s)
        whole, offset = np.eye(self.size, dtype=complex), np.zeros(self.size, dtype=complex)
        rows, past, count, seen = np.zeros(self.size, dtype=complex), 0.0 + 0.0j, 0, [0, 0]
        for event in self.clock.events:
            sent, ages = self._samples(event), self._ages(seen)
            whole, offset = sent @ whole, sent @ offset
            if event[0]:
                pull = self._asked(gains, ages)
                force = pull[0] + pull[2]
                rows, past = rows + turn**-count * (force @ whole), past + turn**-count * (force @ offset)
                count += 1
            moved = self._forward(gains, event, ages)[0, environment]
            whole, offset = moved @ whole, moved @ offset
            if event[0]:
                offset[0] = turn**count
            seen = [number + here for number, here in zip(seen, event, strict=True)]
        state = np.linalg.solve(turn**count * np.eye(self.size) - whole, offset)
        return complex((rows @ state + past) / count)

    @property
    def _shape(self) -> tuple[int, int]:
        hands, environments = self._maps[0][0].shape[1], self._maps[1][0].shape[1]
        return (hands, 1) if self._paired else (hands, environments)

    def _ages(self, seen: list[int]) -> list[int]:
        """Return the age of the data received on each side, after a number of samples of each."""
        both = self.clock.leader_sees, self.clock.follower_sees
        return [sees[count % len(sees)] for count, sees in zip(seen, both, strict=True)]

    def _samples(self, event: tuple[bool, bool]) -> FloatArray:
        """Return the map by which each sampling device sends its position, shape (size, size)."""
        step = np.eye(self.size)
        for side, here in enumerate(event):
            if here:
                first, count = self._sent[side], self._kept[side]
                step[first : first + count] = 0.0
                step[first + 1 : first + count, first : first + count - 1] = np.eye(count - 1)
                start = self._starts[side]
                plant = self._plants[side]
                step[first, start : start + len(plant.names)] = plant.measured
        return step

    def _forward(self, gains: ToolGains, event: tuple[bool, bool], ages: list[int]) -> FloatArray:
        """Return the map of each sampling device to its next sample, shape (hands, environments, size, size)."""
        step = np.zeros((*self._shape, self.size, self.size))
        step[...] = np.eye(self.size)
        asked = self._asked(gains, ages)
        for side, here in enumerate(event):
            if not here:
                continue
            matrix, push = (part[0] for part in self._maps[side])
            many = (slice(None), None) if side == 0 or self._paired else (None, slice(None))
            start, n = self._starts[side], matrix.shape[-1]
            step[..., start : start + n, :] = 0.0
            step[..., start : start + n, start : start + n] = matrix[many]
            step[..., start : start + n, :] += push[many][..., None] * (asked[side] + asked[2 + side])
            if side == 1:
                step[*self._rigid, start : start + n] = 0.0
                self._send_force(step, asked[1])
        return step

    def _asked(self, gains: ToolGains, ages: list[int]) -> list[FloatArray]:
        """Return the force of the coupling on each side, then that of its damper, positive against +x, as rows."""
        times = [plant.sample_time_s for plant in self._plants]
        own = [self._seen(side, 0, times[side]) for side in (0, 1)]
        far = [self._seen(1, ages[0], times[1]), self._seen(0, ages[1], times[0])]
        k, b, local = gains.stiffness_n_per_m, gains.damping_ns_per_m, gains.local_damping_ns_per_m
        pull = [k * (own[side][0] - far[side][0]) + b * (own[side][1] - far[side][1]) for side in (0, 1)]
        if self._forces:
            pull[0] = -np.eye(self.size)[self._force_sent + ages[0]]
        return [*pull, *(local * own[side][1] for side in (0, 1))]

    def _seen(self, side: int, age: int, sample_time_s: float) -> tuple[FloatArray, FloatArray]:
        """Return position and velocity that a side sent a number of its samples ago, as rows of the state."""
        unit, first = np.eye(self.size), self._sent[side] + age
        return unit[first], (unit[first] - unit[first + 1]) / sample_time_s

    def _send_force(self, step: FloatArray, asked: FloatArray) -> None:
        """Store the force that the follower sends at a sample: commanded, or of its contact."""
        if not self._forces:
            return
        first, count = self._force_sent, self._forces_kept
        step[..., first : first + count, :] = 0.0
        step[..., first + 1 : first + count, first : first + count - 1] = np.eye(count - 1)
        step[..., first, :] = asked
        if self._measured_force:
            start, plant = self._starts[1], self._plants[1]
            touch = np.zeros((len(self._touch), self.size))
            touch[:, start : start + len(plant.names)] = self._touch
            many = (slice(None), None) if self._paired else (None, slice(None))
            step[..., first, :] = np.where(self._fixed[many][..., None], asked, -touch[many])
