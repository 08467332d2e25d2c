"""The impedance at the handle of a device with a force sensor, and whether it is passive there.

A hand that pushes the handle sinusoidally at f meets Z(f), force over velocity at f, of the exact sampled loop; what
aliases into other frequencies is left out. With A, B_u and B_F of the continuous plant, the handle released (B_F: of a
force on it), y = C x what the law reads, L the law, P the sampled plant, T the sample time, d the delay, s = 2 pi j f:

    x = (s - A)^-1 (B_F F + B_u h u),   u = L C (s - A)^-1 B_F F/(1 - L P),   h = (1 - exp(-s T))/(s T) exp(-s d T)

Z = F/v of the handle. Passive is Re Z >= 0 up to half the sample rate, and a released device that is stable: then it
feeds no passive hand at the frequency of its push. Few admittance devices are. With k_s and b_s of the sensor and tau
the lag of law and drive, Re 1/Z is about B/(w M)^2 + b_s w^2/k_s^2 - tau/M between B/M and the bandwidths: whatever
the mass, that needs a damping of about B >= (k_s tau)^2/(4 b_s).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi.loops.handle import plants_of
from avc_casadi.loops.margins import OpenLoop
from avc_casadi.model.driven import driven_plant, handle_pull, held_command, position_row, sensor_row
from avc_casadi.model.hands import Hand
from avc_casadi.model.law import Law
from avc_casadi.model.sensed import SensorDevice

_ROUNDING = 1e-9
"""Re Z above minus this share of |Z| is none: rounding."""
_EVEN_TURNS = 400
_LOWEST_TURN = 1e-5
_BISECTIONS = 40


@dataclass(frozen=True)
class HandlePassivity:
    """Whether a device is passive at its handle.

    Attributes:
        released_stable: whether the released device is stable, without which nothing is passive.
        from_hz: the lowest frequency at which the device can feed a hand; infinite where there is none up to half the
            sample rate.
    """

    released_stable: bool
    from_hz: float

    @property
    def passive(self) -> bool:
        """Whether it is passive."""
        return self.released_stable and math.isinf(self.from_hz)


class HandleLoop:
    """The released loop of a law on a device without ranges, as a hand at the handle meets it."""

    def __init__(self, device: SensorDevice, law: Law) -> None:
        nothing = Hand(*(np.zeros(1) for _ in range(3)))
        self.device = device
        self.law = law
        self.plant = driven_plant(device, nothing)
        self.loop = OpenLoop.around(plants_of([(device, nothing)]), law)

    def impedance(self, turns: FloatArray) -> ComplexArray:
        """Return Z at the handle, force over velocity of a push, N.s/m, at angles omega T, rad a sample.

        The push moves the device as it is between samples; the law answers the sampled position and force, held for a
        sample.
        """
        device = self.device
        names = self.plant.names
        size = self.plant.states
        pull = handle_pull(device, names)
        inputs = np.stack([pull, self.plant.force.reshape(size)], axis=-1)
        pencil = (1j * turns / device.sample_time_s)[:, None, None] * np.eye(size) - self.plant.matrix.reshape(size, -1)
        states = np.linalg.solve(pencil, np.broadcast_to(inputs, (*pencil.shape[:-1], 2)).astype(np.complex128))
        pushed, commanded = states[..., 0], states[..., 1]
        z = np.exp(1j * turns)
        measured = self.law.transfer(z) * (pushed @ position_row(device, names))
        measured = measured + self.law.transfer(z, 1) * (pushed @ sensor_row(device, names))
        command = measured / (1 + self.loop.gain(turns)[0])
        speed = (pushed + commanded * (held_command(device, turns) * command)[:, None]) @ (pull > 0)
        return np.asarray(1 / speed)

    def passivity(self) -> HandlePassivity:
        """Return whether Re Z >= 0 at the handle, and from which frequency, Hz, it is not, by a scan and bisection."""
        turns = np.union1d(np.geomspace(_LOWEST_TURN, math.pi, _EVEN_TURNS), self.loop.turns())
        feeds = np.flatnonzero(self._feeds(turns))
        stable = float(self.loop.closed.radius.max()) < 1
        if not feeds.size:
            return HandlePassivity(stable, math.inf)
        first = int(feeds[0])
        low, high = turns[max(first - 1, 0)], turns[first]
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if self._feeds(np.array([middle]))[0] else (middle, high)
        return HandlePassivity(stable, float(high) / (2 * math.pi * self.device.sample_time_s))

    def _feeds(self, turns: FloatArray) -> FloatArray:
        impedance = self.impedance(turns)
        return np.asarray(impedance.real < -_ROUNDING * np.abs(impedance))


def passivity(devices: Iterable[SensorDevice], law: Law) -> HandlePassivity:
    """Return the least passive of devices at the corners of their ranges."""
    judged = [HandleLoop(device, law).passivity() for device in devices]
    return HandlePassivity(all(port.released_stable for port in judged), min(port.from_hz for port in judged))
