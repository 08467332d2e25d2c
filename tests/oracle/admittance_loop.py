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

    size = 5
    """Entries of a motion: position, velocity and acceleration of the drive, position and velocity of the handle."""
    remembers = 2
    """What the law remembers: the filtered force, and its command."""

    @property
    def fastest_hz(self):
        """The fastest lag, which the steps of a simulation follow."""
        return self.drive_hz

    @property
    def kept(self):
        """The entries that are states: the acceleration of a drive of first order is none."""
        return [0, 1, 3, 4] if self.order == 1 else [0, 1, 2, 3, 4]

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


@dataclass(frozen=True)
class PlainPositionDevice(PlainDevice):
    """The same with a drive that follows a position, the sum of the velocities that the law gives."""

    remembers = 3

    @property
    def kept(self):
        """The entries that are states."""
        return [0, 1, 3, 4]

    def rates(self, motion, command):
        """Return the time derivatives; the command is a position."""
        w = 2 * math.pi * self.drive_hz
        x, v = motion[:2]
        rates = super().rates(motion, command)
        rates[1], rates[2] = w * w * (command - x) - 2 * self.drive_ratio * w * v, 0.0
        return rates

    def command(self, memory, motion):
        """Return filtered force, commanded position and velocity, from those of the sample before."""
        filtered, velocity = super().command((memory[0], memory[2]), motion)
        return filtered, memory[1] + self.sample_s * velocity, velocity


@dataclass(frozen=True)
class PlainForceDevice:
    """Numbers of a device that is commanded a force, with a sensor before its handle, and of a law with force feedback.

    A motion is position and velocity of the motor, its force behind the amplifier, position and velocity of what lies
    beyond a transmission, and of the handle.
    """

    sample_s: float
    device_kg: float
    device_damping: float
    sensor_n_per_m: float
    sensor_ratio: float
    handle_kg: float
    late_samples: float
    gain: float
    cutoff_hz: float | None = None
    spring_n_per_m: float = 0.0
    damper: float = 0.0
    amplifier_hz: float | None = None
    mode_hz: float | None = None
    mode_ratio: float = 0.0
    mode_share: float = 0.0
    hand_kg: float = 0.0
    hand_damping: float = 0.0
    hand_n_per_m: float = 0.0

    size = 7
    remembers = 3

    @classmethod
    def of(cls, problem, hand_kg=0.0, hand_damping=0.0, hand_n_per_m=0.0):
        """Return the numbers of a problem of a law of spring, damper and force, with what its handle carries."""
        device, sensor, law = problem.device, problem.device.force_sensor, problem.law
        mode = device.resonance
        return cls(
            sample_s=device.sample_time_s,
            device_kg=device.mass_kg,
            device_damping=device.damping_ns_per_m,
            sensor_n_per_m=sensor.stiffness_n_per_m,
            sensor_ratio=sensor.damping_ratio,
            handle_kg=sensor.handle_mass_kg,
            late_samples=device.delay_samples,
            gain=law.force_feedback.gain,
            cutoff_hz=law.force_feedback.cutoff_hz,
            spring_n_per_m=law.stiffness_n_per_m,
            damper=law.damping_ns_per_m + law.local_damping_ns_per_m,
            amplifier_hz=device.amplifier_bandwidth_hz,
            mode_hz=mode and mode.frequency_hz,
            mode_ratio=mode.damping_ratio if mode else 0.0,
            mode_share=mode.mass_ratio if mode else 0.0,
            hand_kg=hand_kg,
            hand_damping=hand_damping,
            hand_n_per_m=hand_n_per_m,
        )

    @property
    def fastest_hz(self):
        """The fastest lag, which the steps of a simulation follow."""
        return max(self.amplifier_hz or 0.0, self.mode_hz or 0.0)

    @property
    def kept(self):
        """The entries that are states."""
        amplifier, mode = [2] if self.amplifier_hz else [], [3, 4] if self.mode_hz else []
        return [0, 1, *amplifier, *mode, 5, 6]

    def _carrier(self, motion):
        return motion[3:5] if self.mode_hz else motion[:2]

    def force(self, motion):
        """Return the force of the sensor."""
        x, v = self._carrier(motion)
        damper = 2 * self.sensor_ratio * math.sqrt(self.sensor_n_per_m * self.handle_kg)
        return self.sensor_n_per_m * (motion[5] - x) + damper * (motion[6] - v)

    def rates(self, motion, command):
        """Return the time derivatives; a command pushes against +x."""
        pull = self.force(motion)
        force, dforce = -command, 0.0 * command
        if self.amplifier_hz:
            force, dforce = motion[2], 2 * math.pi * self.amplifier_hz * (-command - motion[2])
        moved = self.handle_kg + self.hand_kg
        dhandle = (-pull - self.hand_n_per_m * motion[5] - self.hand_damping * motion[6]) / moved
        losses = self.device_damping * motion[1]
        if not self.mode_hz:
            dv, dlink = (force + pull - losses) / self.device_kg, 0.0 * pull
        else:
            link = self.mode_share * self.device_kg
            motor = self.device_kg - link
            reduced = motor * link / self.device_kg
            w = 2 * math.pi * self.mode_hz
            stretch = reduced * w**2 * (motion[3] - motion[0])
            stretch = stretch + 2 * self.mode_ratio * w * reduced * (motion[4] - motion[1])
            dv, dlink = (force + stretch - losses) / motor, (pull - stretch) / link
        return np.array([motion[1], dv, dforce, motion[4], dlink, motion[6], dhandle])

    def command(self, memory, motion):
        """Return filtered force, commanded force and position, from those of the sample before."""
        filtered, _, before = memory
        share = 1.0 if self.cutoff_hz is None else 1 - math.exp(-2 * math.pi * self.cutoff_hz * self.sample_s)
        filtered = filtered + share * (self.force(motion) - filtered)
        spring = self.spring_n_per_m * motion[0] + self.damper * (motion[0] - before) / self.sample_s
        return filtered, spring - self.gain * filtered, motion[0]


def largest_pole(device):
    """Return the spectral radius of the sampled loop; of one that rests anywhere without that pole at 1."""
    poles = np.linalg.eigvals(_sampled(device, 0.0)[0])
    if not device.hand_n_per_m and not device.spring_n_per_m:
        poles = np.delete(poles, np.argmin(np.abs(poles - 1)))
    return float(np.abs(poles).max())


def swings(device):
    """Return damping ratio and frequency of each pole that swings below half the sample rate."""
    poles = np.linalg.eigvals(_sampled(device, 0.0)[0])
    poles = poles[(np.abs(np.imag(poles)) > 1e-6) & (np.abs(poles) > 1e-6)]
    rates = np.log(poles) / device.sample_s
    return -rates.real / np.abs(rates), np.abs(rates.imag) / (2 * math.pi)


def disk_margin(device):
    """Return 2/max |2 S - 1| of a stable loop, S from a push on the command to the command, on a very fine grid."""
    loop, _, pushed = (np.real(part) for part in _sampled(device, 0.0))
    command = loop[len(device.kept) + 1]
    poles = np.linalg.eigvals(loop)
    about = np.abs(np.angle(poles))[:, None] + np.abs(1 - np.abs(poles))[:, None] * np.linspace(-8.0, 8.0, 801)
    turns = np.append(np.geomspace(1e-4, math.pi, 3000), np.clip(about, 1e-4, math.pi))
    z = np.exp(1j * turns)
    states = np.linalg.solve(z[:, None, None] * np.eye(len(loop)) - loop, pushed[:, None].astype(complex))[..., 0]
    return float(2 / np.abs(1 + 2 * states @ command).max())


def handle_impedance(device, hz):
    """Return force over velocity of a handle that a hand pushes by exp(s t): at that frequency alone, without aliases.

    With z = exp(s T) each sample is z times the one before, which is a linear system of drive, handle, law and past
    commands; the held commands and the push then move the handle.
    """
    s = 2j * math.pi * hz
    loop, pushed, _ = _sampled(device, s)
    size = len(device.kept)
    z = np.exp(s * device.sample_s)
    state = np.linalg.solve(z * np.eye(len(loop)) - loop, pushed)
    command = z * state[size + 1]  # of this sample: what the law remembers after it
    held = (1 - 1 / z) / (s * device.sample_s) * np.exp(-s * device.late_samples * device.sample_s)
    motion, push, pull = _moving(device)
    return 1 / np.linalg.solve(s * np.eye(size) - motion, pull + push * held * command)[-1]


def _moving(device):
    """Return the rates of the states by each of them, by the command, and by a push on the handle."""
    kept = device.kept
    motion = np.array([device.rates(unit, 0.0) for unit in np.eye(device.size)]).T[np.ix_(kept, kept)]
    push = device.rates(np.zeros(device.size), 1.0)[kept]
    return motion, push, np.eye(len(kept))[-1] / (device.handle_kg + device.hand_kg)


def _sampled(device, s):
    """Return the loop over a sample, and what a push exp(s t) on the handle, and one on the command, add to it.

    State: those of the motion, what the law remembers, past commands with the newest first. The push is a further state
    of the motion, which grows by s.
    """
    kept, late = device.kept, int(device.late_samples)
    part, queue, size = device.late_samples - late, int(device.late_samples) + 1, len(device.kept)
    motion, push, pull = _moving(device)
    whole = np.zeros((size + 2, size + 2), dtype=complex)
    whole[:size] = np.column_stack([motion, push, pull])
    whole[-1, -1] = s
    first, second = expm(whole * part * device.sample_s), expm(whole * (1 - part) * device.sample_s)
    laws = slice(size, size + device.remembers)

    def sample(state, pushed, added=0.0):
        body = np.zeros(device.size, dtype=complex)
        body[kept] = state[:size]
        memory = device.command(state[laws], body)
        commands = [memory[1] + added, *state[laws.stop :]]
        moved = first @ [*state[:size], commands[late + 1 if part else late], pushed]
        moved = second @ [*moved[:size], commands[late], moved[-1]]
        return np.array([*moved[:size], *memory, *commands[:queue]])

    units = np.eye(size + device.remembers + queue)
    loop = np.array([sample(unit, 0.0) for unit in units]).T
    return loop, sample(0 * units[0], 1.0), sample(0 * units[0], 0.0, 1.0)


def after_wrong_readings(device, wrong_n, samples, replaced=False):
    """Return command, position and speed of the drive and speed of the handle, (samples, 4), from rest.

    The first readings are wrong by some newtons, or are these newtons whatever the true force.
    """
    kept, late, size = device.kept, int(device.late_samples), len(device.kept)
    part = device.late_samples - late
    motion, push, _ = _moving(device)
    whole = np.zeros((size + 1, size + 1))
    whole[:size] = np.column_stack([motion, push])
    first, second = expm(whole * part * device.sample_s), expm(whole * (1 - part) * device.sample_s)
    body, memory, past, rows = np.zeros(device.size), (0.0,) * device.remembers, [0.0] * (late + 2), []
    for sample in range(samples):
        read = body.copy()
        if sample < len(wrong_n):
            # The stretch of the sensor says what it reads; position and speeds of the drive stay.
            read[4] = body[1] if replaced else body[4]
            read[3] = (body[0] if replaced else body[3]) + wrong_n[sample] / device.sensor_n_per_m
        memory = device.command(memory, read)
        past = [memory[1], *past[:-1]]
        rows.append((memory[1], body[0], body[1], body[4]))
        moved = first @ [*body[kept], past[late + 1] if part else past[late]]
        body[kept] = (second @ [*moved[:size], past[late]])[:size]
    return np.array(rows)


def growth(device, samples=30_000, fine=None):
    """Return by how much a motion grows in a sample, from a simulation of some samples after a knock of the handle."""
    stiff = math.sqrt((device.sensor_n_per_m + device.hand_n_per_m) / device.handle_kg)
    steps = fine or max(20, math.ceil(12 * device.sample_s * max(stiff, 2 * math.pi * device.fastest_hz)))
    late = int(device.late_samples)
    part = device.late_samples - late
    # Substeps before and after a new command arrives within a sample.
    before = round(part * steps) and max(1, round(part * steps))
    advance = (
        _runge_kutta(device, part * device.sample_s, before),
        _runge_kutta(device, (1 - part) * device.sample_s, steps),
    )
    motion, memory, past = np.eye(device.size)[-1], (0.0,) * device.remembers, [0.0] * (late + 1)
    logarithms, at = [], 0.0
    for _ in range(samples):
        memory = device.command(memory, motion)
        past = [memory[1], *past][: late + 2]
        if part:
            motion = advance[0][0] @ motion + advance[0][1] * past[late + 1]
        motion = advance[1][0] @ motion + advance[1][1] * past[late]
        size = max(abs(motion[1]), abs(motion[-1]), abs(motion[-1] - motion[1]), 1e-300)
        logarithms.append(at + math.log(size))
        if not 1e-100 < size < 1e100:
            motion, memory, past = motion / size, tuple(kept / size for kept in memory), [u / size for u in past]
            at += math.log(size)
    third = samples // 3
    window = samples // 6
    first = max(logarithms[third : third + window])
    last = max(logarithms[-window:])
    return math.exp((last - first) / (samples - third - window))


def _runge_kutta(device, time_s, steps):
    """Return how a motion and a held command move over a time, by small steps of Runge and Kutta."""
    if not steps:
        return np.eye(device.size), np.zeros(device.size)
    step = time_s / steps

    def moved(motion, command):
        for _ in range(steps):
            k1 = device.rates(motion, command)
            k2 = device.rates(motion + step / 2 * k1, command)
            k3 = device.rates(motion + step / 2 * k2, command)
            k4 = device.rates(motion + step * k3, command)
            motion = motion + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        return motion

    return np.array([moved(unit, 0.0) for unit in np.eye(device.size)]).T, moved(np.zeros(device.size), 1.0)
