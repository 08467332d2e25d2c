"""Many teleoperators side by side, sample by sample in plain numpy: shares nothing with the project, nor with the
scalar simulator beside it.

Both devices of a lane have one sample time; the follower's clock may be late by a share of it. Each is exact under a
held force. What couples them is a law, an object that is told positions and hands out forces.
"""

import numpy as np
from scipy.linalg import expm


def held(mass, damping, stiffness, hand_damping, period):
    """Maps over a sample of each lane from (x, v, force, aim, aim speed), shape (lanes, 2, 5)."""
    maps = np.empty((len(mass), 2, 5))
    for lane in range(len(mass)):
        m, k = mass[lane], stiffness[lane]
        rate = np.zeros((5, 5))
        rate[0, 1] = rate[3, 4] = 1
        rate[1] = [-k / m, -damping[lane] / m, 1 / m, k / m, hand_damping[lane] / m]
        maps[lane] = expm(rate * period[lane])[:2]
    return maps


def newest_messages(delay, samples, phase_sender, phase_receiver, jitter, lost, rng):
    """The newest message that has arrived at each sample, (samples, lanes), -1 is none; delays are in samples."""
    lanes = len(delay)
    sent = np.arange(samples)[:, None] + phase_sender
    arrives = sent + delay * (1 + jitter * rng.uniform(-1, 1, (samples, lanes))) - phase_receiver
    seen = np.ceil(arrives - 1e-9).astype(int)
    seen[rng.random((samples, lanes)) < lost] = samples
    found = np.full((samples + 1, lanes), -1)
    numbers = np.broadcast_to(np.arange(samples)[:, None], seen.shape)
    inside = np.minimum(np.maximum(seen, 0), samples)
    np.maximum.at(found, (inside, np.broadcast_to(np.arange(lanes), seen.shape)), numbers)
    return np.maximum.accumulate(found[:samples], axis=0)


class SpringAndDampers:
    """K, B and a damper of each loop, each an array of shape (lanes,)."""

    def __init__(self, stiffness, damping, local):
        self.k, self.b, self.local = stiffness, damping, local

    def force(self, side, run, k):
        x, v = run.seen(side, k)
        far_x, far_v = run.arrived(side, k)
        return self.k * (far_x - x) + self.b * (far_v - v) - self.local * v


class Lanes:
    """Leaders with hands and followers in contact, a lane each; `computing` is the samples from measurement to force.

    Devices are mass and damping, a hand mass, damping and stiffness, a contact stiffness (infinite is rigid) and
    damping, beyond x = 0 or on both sides; delays are samples, `jitter` a share of them, `lost` one of messages.
    """

    def __init__(
        self, leader, follower, period, computing, hand, contact, *, one_sided, delay, phase=0, jitter=0, lost=0, seed=0
    ):
        lanes = len(period)
        self.period, self.lanes, self.one_sided = period, lanes, one_sided
        self.rigid = np.isinf(contact[0])
        k_c, b_c = np.where(self.rigid, 0.0, contact[0]), contact[1]
        nothing = np.zeros(lanes)
        self.maps = held(leader[0] + hand[0], leader[1] + hand[1], hand[2], hand[1], period)
        self.free = held(follower[0], follower[1], nothing, nothing, period)
        self.touching = held(follower[0], follower[1] + b_c, k_c, nothing, period)
        self.computing, self.delay, self.jitter, self.lost, self.seed = computing, delay, jitter, lost, seed
        self.phase = np.broadcast_to(phase, (lanes,))

    def seen(self, side, k):
        """Position and velocity that a side has just measured."""
        x = self.x[side]
        return x[k], (x[k] - x[max(k - 1, 0)]) / self.period

    def newest(self, side, k):
        """Number of the newest message at a side, not below 0."""
        return np.maximum(self.arrivals[side][k], 0)

    def arrived(self, side, k):
        """Position and velocity of the other side in the newest message."""
        place, far = self.newest(side, k), self.x[1 - side]
        each = np.arange(self.lanes)
        return far[place, each], (far[place, each] - far[np.maximum(place - 1, 0), each]) / self.period

    def run(self, law, samples, target, *, kick=0.0, ceiling=1e3):
        """Move; leaves positions x of both, (2, samples, lanes), and force f on the leader, (samples, lanes).

        A lane that goes farther than `ceiling` is held where it is, and has grown.
        """
        rng, still = np.random.default_rng(self.seed), np.zeros(self.lanes)
        self.arrivals = [
            newest_messages(self.delay[1], samples, self.phase, still, self.jitter, self.lost, rng),
            newest_messages(self.delay[0], samples, still, self.phase, self.jitter, self.lost, rng),
        ]
        self.x = np.zeros((2, samples, self.lanes))
        self.f = np.zeros((samples, self.lanes))
        state = np.zeros((2, self.lanes, 2))
        state[..., 0] = target[0]
        state[0, :, 1] = kick
        queue = [[still] * self.computing, [still] * self.computing]
        for k in range(samples):
            self.x[:, k] = state[..., 0]
            forces = [law.force(0, self, k), law.force(1, self, k)]
            self.f[k] = forces[0]
            after = target[min(k + 1, samples - 1)]
            aim = np.stack([target[k], (after - target[k]) / self.period], axis=1)
            for side in (0, 1):
                queue[side].append(forces[side])
            now = [queue[side].pop(0) for side in (0, 1)]
            given = np.concatenate([state[0], now[0][:, None], aim], axis=1)
            state[0] = np.einsum("lij,lj->li", self.maps, given)
            given = np.concatenate([state[1], now[1][:, None], np.zeros((self.lanes, 2))], axis=1)
            touching = state[1, :, 0] > 0 if self.one_sided else np.ones(self.lanes, dtype=bool)
            maps = np.where(touching[:, None, None], self.touching, self.free)
            state[1] = np.einsum("lij,lj->li", maps, given)
            into = self.rigid & (state[1, :, 0] > 0) if self.one_sided else self.rigid
            state[1, into, 1] = np.minimum(state[1, into, 1], 0.0) if self.one_sided else 0.0
            state[1, into, 0] = 0.0
            state = np.clip(state, -ceiling, ceiling)
        return self
