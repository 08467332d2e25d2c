"""A teleoperator tried by many hands: in free motion, making and breaking contact, pressed, over an uneven link.

Both devices are integrated exactly from sample to sample while the contact state does not change; encoders, force
limits, delayed and lost messages are simulated. Dry friction is not, so that it settles no unstable loop.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
from avc_casadi.loops.follower import contact_dampers_ns_per_m, environments, required_follower
from avc_casadi.model.hands import Hand
from avc_casadi.model.plant import transitions
from avc_casadi.model.sampled_plant import device_plant, sampled_plant
from avc_casadi.model.scene import Free, Hold, Motion, Press, Stroke
from avc_casadi.simulation.judge import AT_REST_M_PER_S
from avc_casadi.simulation.motion import target_of
from avc_casadi.simulation.population.motions import at_handle
from avc_casadi.simulation.population.other_end_trial import OtherEndTrial

if TYPE_CHECKING:
    from avc_casadi.model.device import Device
    from avc_casadi.model.problem import Problem
    from avc_casadi.model.virtual_tool import ToolGains

BILATERAL_MOTIONS: dict[str, Motion] = {
    "free": Free(frequency_hz=2.0, amplitude_m=0.008, rest_s=2.0),
    "press": Press(),
    "tap": Stroke(frequency_hz=2.0, amplitude_m=0.015, rest_s=2.0),
    "hold": Hold(),
    "strike": Press(speed_m_per_s=0.3),
}
"""Free motion; a press; taps that break contact; held in contact; struck. The follower's contact begins at x = 0."""
TRIAL_S = 5.0
"""Duration of a motion; settling is judged in the last half second."""
_JUDGED_S = 0.5


@dataclass(frozen=True, eq=False, repr=False)
class BilateralTrial(OtherEndTrial):
    """Results by simulated hand, at the leader; settled: leader and follower; the seed is of the messages too."""

    jitter: float
    lost_share: float

    def _more(self) -> dict[str, Any]:
        return {"jitter": self.jitter, "lost_share": self.lost_share}


@dataclass(frozen=True)
class Link:
    """Arrivals of messages by the receiver's samples."""

    newest: IndexArray

    @classmethod
    def drawn(
        cls, sender_s: float, receiver_s: float, delay_s: float, samples: int, jitter: float, lost: float, seed: int
    ) -> Link:
        """Draw the arrivals of a sender's messages at a receiver, which keeps the newest."""
        rng = np.random.default_rng(seed)
        count = int(np.ceil(samples * receiver_s / sender_s)) + 1
        arrival = np.arange(count) * sender_s + delay_s * (1 + jitter * rng.uniform(-1, 1, count))
        arrival[rng.random(count) < lost] = np.inf
        # A message that arrives after a newer one is discarded.
        order = np.argsort(arrival, kind="stable")
        best = np.maximum.accumulate(order)
        place = np.searchsorted(arrival[order], np.arange(samples) * receiver_s + 1e-12, side="right") - 1
        return cls(np.where(place >= 0, best[np.maximum(place, 0)], -1))


def try_bilateral(problem: Problem, gains: ToolGains, hands: Hand, seed: int = 0) -> BilateralTrial:
    """Simulate hands that move a follower, on a link with the declared delay, jitter and losses."""
    follower = required_follower(problem)
    stiffness, _ = environments(follower)
    some = sorted({float(stiffness[place]) for place in (len(stiffness) // 2, -1)})
    shape = len(BILATERAL_MOTIONS), len(some), len(hands)
    settled = np.ones(shape, dtype=bool)
    for delays_s in follower.delays_s:
        run = _Run(problem, gains, hands, some, delays_s, seed)
        settled &= run.settled.reshape(shape)
    names = list(BILATERAL_MOTIONS)
    felt = run.stiffness_n_per_m.reshape(shape)[names.index("press"), -1]
    tap = run.peak_n.reshape(shape)[names.index("tap"), -1]
    by_motion = {name: np.asarray(settled[place].all(axis=0)) for place, name in enumerate(names)}
    return BilateralTrial(seed, by_motion, felt, tap, follower.jitter, follower.lost_share)


class _Side:
    """One device in many parallel runs (lanes), advanced sample by sample."""

    def __init__(self, device: Device, hold: list[Hand], start_m: FloatArray) -> None:
        plants = [sampled_plant(device, one) for one in hold]
        self.maps = [tuple(part[0] for part in plant.with_forces_under_way()) for plant in plants]
        linear = [device_plant(device, one).linear() for one in hold]
        self.aims = [transitions([(one, device.sample_time_s)])[0].target for one in linear]
        n = self.maps[0][0].shape[-1]
        self.names = plants[0].names
        places = [name.endswith("_position_m") for name in self.names] + [False] * (n - len(self.names))
        self.state = np.where(places, start_m[:, None], 0.0)
        self.row = np.zeros(n)
        self.row[: len(self.names)] = plants[0].measured
        self.step_m = device.encoder_resolution_m
        self.limit_n = np.inf if device.max_force_n is None else device.max_force_n
        self.sent = [self.measured()]

    def send(self) -> None:
        """Store the measured positions of this sample as a message."""
        self.sent.append(self.measured())

    def measured(self) -> FloatArray:
        """Return the measured positions, shape (lanes,)."""
        seen = self.state @ self.row
        return np.asarray(np.round(seen / self.step_m) * self.step_m if self.step_m > 0 else seen)

    def move(self, which: BoolArray, force: FloatArray, target: FloatArray | None = None) -> None:
        """Advance by a sample."""
        count, nexts = len(self.names), []
        for (matrix, push), aim in zip(self.maps, self.aims, strict=True):
            moved = np.matmul(matrix, self.state[..., None])[..., 0] + push * force[:, None]
            if target is not None:
                moved[:, :count] += np.matmul(aim, target[..., None])[..., 0]
            nexts.append(moved)
        self.state = nexts[0] if len(nexts) == 1 else np.where(which[:, None], nexts[1], nexts[0])


class _Run:
    """Every motion of many hands on every contact: lanes of shape (motions, contacts, hands), flattened."""

    def __init__(
        self,
        problem: Problem,
        gains: ToolGains,
        hands: Hand,
        contacts_n_per_m: list[float],
        delays_s: tuple[float, float],
        seed: int,
    ) -> None:
        self.follower, leader, self.gains = required_follower(problem), problem.device, gains
        other = self.follower.at_leader()
        self.times = leader.sample_time_s, other.sample_time_s
        samples = round(TRIAL_S / self.times[0])
        motions = [at_handle(one, leader) for one in BILATERAL_MOTIONS.values()]
        targets = [target_of(one, samples, self.times[0]) for one in motions]
        each = len(contacts_n_per_m) * len(hands)
        self.lanes = len(motions) * each
        aims = [np.stack([one.position_m, one.velocity_m_per_s], axis=-1) for one in targets]
        self.targets = np.repeat(np.stack(aims, axis=1), each, axis=1)
        contact = np.tile(np.repeat(contacts_n_per_m, len(hands)), len(motions))
        self.rigid = np.isinf(contact)
        self.spring = np.where(self.rigid, 0.0, contact)
        scale = self.follower.scale
        self.damper = np.array([scale * max(contact_dampers_ns_per_m(self.follower, k / scale)) for k in self.spring])
        nothing = np.zeros(self.lanes)
        held = Hand(*(np.tile(np.atleast_1d(value), self.lanes // len(hands)) for value in vars(hands).values()))
        touched = Hand(nothing, self.damper, self.spring)
        start = np.repeat([min(one.device_start_m, 0.0) for one in targets], each)
        free = Hand(nothing, nothing, nothing)
        self.sides = _Side(leader, [held], start), _Side(other, [free, touched], start)
        uneven = self.follower.jitter, self.follower.lost_share
        self.links = (
            Link.drawn(self.times[1], self.times[0], delays_s[1], samples, *uneven, seed + 1),
            Link.drawn(*self.times, delays_s[0], math.ceil(samples * self.times[0] / self.times[1]) + 2, *uneven, seed),
        )
        self.forces = [np.zeros(self.lanes)]
        self.peak_n = np.zeros(self.lanes)
        judged = max(1, round(_JUDGED_S / self.times[0]))
        speed, force, depth = np.zeros(self.lanes), np.zeros(self.lanes), np.zeros(self.lanes)
        other_sample = 0
        for sample in range(samples):
            while other_sample * self.times[1] < (sample - 1e-6) * self.times[0]:
                self.sides[1].send()
                self._follow(other_sample)
                other_sample += 1
            together = other_sample * self.times[1] < (sample + 1e-6) * self.times[0]
            for side in self.sides[: 1 + together]:
                side.send()
            asked = self._lead(sample)
            if together:
                self._follow(other_sample)
                other_sample += 1
            if sample >= samples - judged:
                speed = np.maximum(speed, np.maximum(*(np.abs(side.state[:, 1]) for side in self.sides)))
                force, depth = force + asked / judged, depth + self.sides[0].state[:, 0] / judged
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            self.settled = np.asarray(speed * leader.metres_per_unit < AT_REST_M_PER_S)
            stiff = np.where(depth > 0, force / depth, np.nan)
            self.stiffness_n_per_m = np.where(np.abs(force) > 0.97 * self.sides[0].limit_n, np.nan, stiff)

    def _lead(self, sample: int) -> FloatArray:
        """Advance the leader by a sample and return the force held over it."""
        newest = int(self.links[0].newest[sample])
        felt = self.follower.architecture == "position-force"
        pull = -self.forces[max(newest, 0)] if felt else self._pull(0, newest)
        side = self.sides[0]
        asked = np.clip(pull + self._local(0), -side.limit_n, side.limit_n)
        side.move(np.zeros(self.lanes, dtype=bool), asked, self.targets[sample])
        self.peak_n = np.maximum(self.peak_n, np.abs(asked))
        return np.asarray(asked)

    def _follow(self, sample: int) -> None:
        """Advance the follower by a sample."""
        side, pull = self.sides[1], self._pull(1, int(self.links[1].newest[sample]))
        asked = np.clip(pull + self._local(1), -side.limit_n, side.limit_n)
        touching = side.state[:, 0] > 0
        speed = (side.sent[-1] - side.sent[-2]) / self.times[1]
        touch = np.where(touching, -(self.spring * side.sent[-1] + self.damper * speed), 0.0)
        measured = self.follower.force == "measured"
        self.forces.append(np.where(self.rigid, pull, touch) if measured else pull)
        side.move(touching, asked)
        into = self.rigid & (side.state[:, 0] > 0)
        side.state[into, 1] = np.minimum(side.state[into, 1], 0.0)
        side.state[into, 0] = 0.0

    def _pull(self, to: int, newest: int) -> FloatArray:
        """Return the coupling force on a side, from its own newest message and the newest received."""
        own, far = self.sides[to].sent, self.sides[1 - to].sent
        # The initial positions come first in each list.
        place = newest + 1
        speed = (own[-1] - own[-2]) / self.times[to]
        far_speed = (far[place] - far[max(place - 1, 0)]) / self.times[1 - to]
        k, b = self.gains.stiffness_n_per_m, self.gains.damping_ns_per_m
        return np.asarray(k * (own[-1] - far[place]) + b * (speed - far_speed))

    def _local(self, of: int) -> FloatArray:
        sent = self.sides[of].sent
        return np.asarray(self.gains.local_damping_ns_per_m * (sent[-1] - sent[-2]) / self.times[of])
