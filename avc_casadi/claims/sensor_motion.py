"""What the sensor alone moves at rest, with every hand and contact: its noise, its steps, and readings that are wrong.

With the plant p+ = A p + B u, y = C p, and the law s+ = a s + b y + b_f e, u = c s + d y + d_f e, of which e is an
error of the force that is read, the loop is

    x+ = M x + E e,   x = (p, s),   E = (B d_f, b_f).

A hand and a contact push back: what an error moves in this loop may be more than by the law alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.loops.handle import Pair, plants_of
from avc_casadi.loops.loop import Body
from avc_casadi.loops.spectrum import ClosedLoops
from avc_casadi.loops.wall import closed
from avc_casadi.model.admittance import AdmittanceDevice, ForceSensor, VirtualImpedance
from avc_casadi.model.law import Law
from avc_casadi.model.plant import DEVICE, HANDLE

SPEEDS = (f"{DEVICE}_velocity_m_per_s", f"{HANDLE}_velocity_m_per_s")
"""States of the plant that are at rest when the device is."""
# Peaks of noise in the half second in which a trial counts a handle as moving, in rms: normal noise exceeds 3 rms once
# in 400 samples, and 4 rms once in 16 000.
_NOISE_PEAK = 4.0
# Samples are doubled so often: 2^24 of them are hours.
_DOUBLINGS = 24
# A power of the map below this adds no digit to a covariance.
_NOTHING = 1e-12
# A motion is followed until its swings are down to this share, over so many samples at most.
_FADED = 0.05
_MOST_SAMPLES = 4000
# Counts of wrong readings in a row, from one to the most, after which the loop is followed.
_COUNTS = 9


@dataclass(frozen=True, eq=False)
class SensorLoops:
    """A law around h plants, with the error of the force that it reads as input.

    Attributes:
        body: the plants.
        law: the law.
        loops: the closed loops.
        error: E, shape (h, s).
    """

    body: Body
    law: Law
    loops: ClosedLoops
    error: FloatArray

    @classmethod
    def around(cls, pairs: Sequence[Pair], law: Law) -> Self:
        """Return the loops of a law around pairs of a device and what its handle carries."""
        body = Body.of(plants_of(pairs)).flat()
        into_plant = body.b * law.d[0, 1]
        into_law = np.broadcast_to(law.b[:, 1], (len(body.b), law.states))
        return cls(body, law, closed(body, law), np.concatenate([into_plant, into_law], axis=1))

    def speed_rms(self) -> float:
        """Return the largest rms of commanded velocity, drive and handle, for an error of white noise of rms 1.

        The covariance P = M P M' + E E' is the sum of M^k E E' M'^k, whose terms are doubled. It is infinite where a
        loop is unstable.
        """
        if self.loops.radius.max() >= 1:
            return math.inf
        power = self.loops.relative
        covariance = self.error[:, :, None] * self.error[:, None, :]
        for _ in range(_DOUBLINGS):
            covariance = covariance + power @ covariance @ np.swapaxes(power, -1, -2)
            power = power @ power
            if np.abs(power).max() < _NOTHING:
                break
        rows = np.zeros((len(power), 1 + len(SPEEDS), power.shape[-1]))
        rows[:, :1, : self.body.size] = self.law.d @ self.body.measured
        rows[:, :1, self.body.size :] = self.law.c
        for place, name in enumerate(SPEEDS, 1):
            rows[:, place, : self.body.size] = self.body.row(name)
        variance = (rows @ covariance * rows).sum(axis=-1)
        variance[:, 0] += self.law.d[0, 1] ** 2
        return math.sqrt(float(variance.max()))

    def motion_m_per_n(self, most_readings: int) -> float:
        """Return how far each of some wrong readings in a row moves the drive at most, per newton that it says.

        Readings that replace the force do not see how hands and contacts push back; the first right one does. With M_o
        the loop without the force, a reading k samples before the last wrong one gives x = M^t M_o^k E after t more.
        """
        if self.loops.radius.max() >= 1:
            return math.inf
        blind = Law(
            a=self.law.a,
            b=self.law.b * np.array([1.0, 0.0]),
            c=self.law.c,
            d=self.law.d * np.array([1.0, 0.0]),
            sample_time_s=self.law.sample_time_s,
        )
        without_force = closed(self.body, blind).maps
        counts = np.unique(np.linspace(0, most_readings, _COUNTS).astype(int))
        state, states = self.error[..., None], []
        for count in range(counts[-1] + 1):
            if count in counts:
                states.append(state)
            state = without_force @ state
        motion = np.concatenate(states, axis=-1)
        radius = max(float(self.loops.radius.max()), _FADED)
        samples = min(math.ceil(math.log(_FADED) / math.log(radius)), _MOST_SAMPLES)
        place = np.pad(self.body.row(f"{DEVICE}_position_m"), (0, self.law.states))
        farthest = 0.0
        for _ in range(samples):
            farthest = max(farthest, float(np.abs(place @ motion).max()))
            motion = self.loops.maps @ motion
        return farthest


def noise_n(sensor: ForceSensor) -> float:
    """Return the rms of noise and steps of a sensor: a step q adds q/sqrt(12)."""
    return math.hypot(sensor.noise_rms_n, sensor.resolution_n / math.sqrt(12))


def velocity_noise(law: VirtualImpedance, device: AdmittanceDevice, pairs: Sequence[Pair]) -> float:
    """Return the largest rms speed of command, drive and handle at rest around pairs, of noise and steps."""
    noise = noise_n(device.force_sensor)
    return noise * SensorLoops.around(pairs, law.law(device.sample_time_s)).speed_rms() if noise else 0.0


def drift(law: VirtualImpedance, device: AdmittanceDevice) -> float:
    """Return the velocity of a released handle whose reading is one step of the sensor off: f/B, 0 on a spring."""
    if law.stiffness_n_per_m or not device.force_sensor.resolution_n:
        return 0.0
    return device.force_sensor.resolution_n / law.damping_ns_per_m if law.damping_ns_per_m else math.inf


def speed_at_rest(noise_m_per_s: float, drift_m_per_s: float) -> float:
    """Return how fast the sensor alone moves a handle at rest: at 4 rms of its noise, or at the drift of one step."""
    return max(_NOISE_PEAK * noise_m_per_s, drift_m_per_s)
