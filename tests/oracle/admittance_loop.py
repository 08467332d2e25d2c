"""An admittance device written out a second time: a loop built state by state, and a simulation that shares no matrix.

Both take plain numbers and know nothing of the package. The loop moves unit states over one sample by SciPy's matrix
exponential. The simulation integrates the equations of motion by Runge and Kutta's fourth order in many small steps and
runs the law sample by sample.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm


@dataclass(frozen=True)
class PlainDevice:
    """Numbers of a device, of what its handle carries, and of its law."""

    sample_s: float
    drive_hz: float
    sensor_n_per_m: float
    sensor_ratio: float
    handle_kg: float
    late_samples: float
    mass_kg: float
    damping: float
    spring_n_per_m: float = 0.0
    cutoff_hz: float | None = None
    order: int = 1
    drive_ratio: float = 0.7
    hand_kg: float = 0.0
    hand_damping: float = 0.0
    hand_n_per_m: float = 0.0

    @classmethod
    def of(cls, problem, hand_kg=0.0, hand_damping=0.0, hand_n_per_m=0.0):
        """Return the numbers of a problem, with what its handle carries."""
        device, sensor, law = problem.device, problem.device.force_sensor, problem.law.admittance
        return cls(
            sample_s=device.sample_time_s,
            drive_hz=device.drive_bandwidth_hz,
            sensor_n_per_m=sensor.stiffness_n_per_m,
            sensor_ratio=sensor.damping_ratio,
            handle_kg=sensor.handle_mass_kg,
            late_samples=device.delay_samples,
            mass_kg=law.mass_kg,
            damping=law.damping_ns_per_m,
            spring_n_per_m=law.stiffness_n_per_m,
            cutoff_hz=law.cutoff_hz,
            order=device.drive_order,
            drive_ratio=device.drive_damping_ratio,
            hand_kg=hand_kg,
            hand_damping=hand_damping,
            hand_n_per_m=hand_n_per_m,
        )

    def rates(self, motion, command):
        """Return the time derivatives of (x, v, a, x_h, v_h): drive, its acceleration if of second order, handle."""
        _, v, a, handle, handle_v = motion
        pull = self.force(motion)
        w = 2 * math.pi * self.drive_hz
        if self.order == 1:
            dv, da = w * (command - v), 0.0 * v
        else:
            dv, da = a, w * w * (command - v) - 2 * self.drive_ratio * w * a
        moved = self.handle_kg + self.hand_kg
        dhandle = (-pull - self.hand_n_per_m * handle - self.hand_damping * handle_v) / moved
        return np.array([v, dv, da, handle_v, dhandle])

    def force(self, motion):
        """Return the force of the sensor."""
        x, v, _, handle, handle_v = motion
        damper = 2 * self.sensor_ratio * math.sqrt(self.sensor_n_per_m * self.handle_kg)
        return self.sensor_n_per_m * (handle - x) + damper * (handle_v - v)

    def command(self, memory, motion):
        """Return the filtered force and the velocity that the law commands, from those of the sample before."""
        filtered, velocity = memory
        share = 1.0 if self.cutoff_hz is None else 1 - math.exp(-2 * math.pi * self.cutoff_hz * self.sample_s)
        filtered = filtered + share * (self.force(motion) - filtered)
        push = filtered - self.spring_n_per_m * motion[0]
        velocity = (self.mass_kg * velocity + self.sample_s * push) / (self.mass_kg + self.damping * self.sample_s)
        return filtered, velocity


def largest_pole(device):
    """Return the spectral radius of the sampled loop; of one that rests anywhere without that pole at 1."""
    motion = np.array([device.rates(unit, 0.0) for unit in np.eye(5)]).T
    push = device.rates(np.zeros(5), 1.0)

    def moved(time_s):
        whole = expm(np.block([[motion, push[:, None]], [np.zeros((1, 6))]]) * time_s)
        return whole[:5, :5], whole[:5, 5]

    late = int(device.late_samples)
    part = device.late_samples - late
    queue = late + 1
    first, second = moved(part * device.sample_s), moved((1 - part) * device.sample_s)

    def sample(state):
        """State: five of the motion, two of the law, past commands with the newest first."""
        body, memory, past = state[:5], state[5:7], state[7:]
        memory = device.command(memory, body)
        commands = [memory[1], *past]
        body = first[0] @ body + first[1] * commands[late + 1 if part else late]
        body = second[0] @ body + second[1] * commands[late]
        return np.array([*body, *memory, *commands[:queue]])

    loop = np.array([sample(unit) for unit in np.eye(7 + queue)]).T
    if device.order == 1:  # its acceleration is no state
        loop = np.delete(np.delete(loop, 2, axis=0), 2, axis=1)
    poles = np.linalg.eigvals(loop)
    if not device.hand_n_per_m and not device.spring_n_per_m:
        poles = np.delete(poles, np.argmin(np.abs(poles - 1)))
    return float(np.abs(poles).max())


def handle_impedance(device, hz):
    """Return force over velocity of a handle that a hand pushes by exp(s t): at that frequency alone, without aliases.

    The push is a state that grows by s. With z = exp(s T) each sample is z times the one before, which is a linear
    system of drive, handle, law and past commands; the held commands and the push then move the handle.
    """
    s, late = 2j * math.pi * hz, int(device.late_samples)
    part, queue = device.late_samples - late, late + 1
    kept = [0, 1, 3, 4] if device.order == 1 else [0, 1, 2, 3, 4]  # the acceleration is no state of a first order
    size = len(kept)
    motion = np.array([device.rates(unit, 0.0) for unit in np.eye(5)]).T[np.ix_(kept, kept)]
    push = device.rates(np.zeros(5), 1.0)[kept]
    pull = np.eye(size)[-1] / device.handle_kg
    inputs = np.stack([push, pull], axis=1)
    whole = np.block([[motion, inputs], [np.zeros((1, size + 2))], [np.zeros((1, size + 1)), np.array([[s]])]])
    first, second = expm(whole * part * device.sample_s), expm(whole * (1 - part) * device.sample_s)

    def sample(state, pushed):
        """State: drive and handle, two of the law, past commands; pushed: the hand's force."""
        body = np.zeros(5, dtype=complex)
        body[kept] = state[:size]
        memory = device.command(state[size : size + 2], body)
        commands = [memory[1], *state[size + 2 :]]
        moved = first @ [*state[:size], commands[late + 1 if part else late], pushed]
        moved = second @ [*moved[:size], commands[late], moved[-1]]
        return np.array([*moved[:size], *memory, *commands[:queue]])

    units = np.eye(size + 2 + queue)
    loop = np.array([sample(unit, 0.0) for unit in units]).T
    z = np.exp(s * device.sample_s)
    state = np.linalg.solve(z * units - loop, sample(0 * units[0], 1.0))
    command = z * state[size + 1]  # of this sample: what the law remembers after it
    held = (1 - 1 / z) / (s * device.sample_s) * np.exp(-s * device.late_samples * device.sample_s)
    return 1 / np.linalg.solve(s * np.eye(size) - motion, pull + push * held * command)[-1]


def growth(device, samples=30_000, fine=None):
    """Return by how much a motion grows in a sample, from a simulation of some samples after a knock of the handle."""
    stiff = math.sqrt((device.sensor_n_per_m + device.hand_n_per_m) / device.handle_kg)
    steps = fine or max(20, math.ceil(12 * device.sample_s * max(stiff, 2 * math.pi * device.drive_hz)))
    late = int(device.late_samples)
    part = device.late_samples - late
    # Substeps before and after a new command arrives within a sample.
    before = round(part * steps) and max(1, round(part * steps))
    advance = (
        _runge_kutta(device, part * device.sample_s, before),
        _runge_kutta(device, (1 - part) * device.sample_s, steps),
    )
    motion, memory, past = np.array([0.0, 0.0, 0.0, 0.0, 1.0]), (0.0, 0.0), [0.0] * (late + 1)
    logarithms, at = [], 0.0
    for _ in range(samples):
        memory = device.command(memory, motion)
        past = [memory[1], *past][: late + 2]
        if part:
            motion = advance[0][0] @ motion + advance[0][1] * past[late + 1]
        motion = advance[1][0] @ motion + advance[1][1] * past[late]
        size = max(abs(motion[1]), abs(motion[4]), abs(motion[4] - motion[1]), 1e-300)
        logarithms.append(at + math.log(size))
        if not 1e-100 < size < 1e100:
            motion, memory, past = motion / size, (memory[0] / size, memory[1] / size), [u / size for u in past]
            at += math.log(size)
    third = samples // 3
    window = samples // 6
    first = max(logarithms[third : third + window])
    last = max(logarithms[-window:])
    return math.exp((last - first) / (samples - third - window))


def _runge_kutta(device, time_s, steps):
    """Return how a motion and a held command move over a time, by small steps of Runge and Kutta."""
    if not steps:
        return np.eye(5), np.zeros(5)
    step = time_s / steps

    def moved(motion, command):
        for _ in range(steps):
            k1 = device.rates(motion, command)
            k2 = device.rates(motion + step / 2 * k1, command)
            k3 = device.rates(motion + step / 2 * k2, command)
            k4 = device.rates(motion + step * k3, command)
            motion = motion + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        return motion

    return np.array([moved(unit, 0.0) for unit in np.eye(5)]).T, moved(np.zeros(5), 1.0)
