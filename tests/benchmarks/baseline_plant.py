"""A device, a hand and a wall in plain numpy, many lanes at once: what the baselines are simulated on.

    motor    m1 x1'' = -b x1' - friction - F + s,   s = k (x2 - x1) + c (x2' - x1')
    handle   (m2 + m) x2'' = -s + K (xt - x2) + B (xt' - x2')
    force    F' = a (u - F): the amplifier; u is the command of a sample, held, a delay late

Without a structure motor, handle and hand are one body. The encoder sees the motor, rounds, and counts from anywhere
within a step. Nothing of the package is used but the numbers of a device; `tests/oracle/whole_device.c` is another one.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from avc_casadi.model.device import Device

Floats = NDArray[np.float64]
Law = Callable[[Floats], Floats]
"""From what the encoders read, m, above 0 in the wall, to the forces out of the wall, N; called once a sample."""

STEPS = 8
TAIL_S = 0.5
# Where everything starts, where a press ends, and how far a tap goes back, m.
OUTSIDE_M, INSIDE_M, FAR_M = -0.01, 0.01, -0.02


@dataclass(frozen=True)
class Deeds:
    """What the hands do, each of shape (lanes,).

    The target goes from 10 mm before the wall to 10 mm behind its face; where a hand taps, first to and fro twice a
    second, 20 mm outside and 10 mm inside, three times. The velocity is the device's at the beginning.
    """

    mass_kg: Floats
    damping_ns_per_m: Floats
    stiffness_n_per_m: Floats
    speed_m_per_s: Floats
    taps: NDArray[np.bool_]
    friction_n: Floats
    velocity_m_per_s: Floats

    def target(self, time_s: float) -> tuple[Floats, Floats]:
        """Place and velocity of the targets."""
        arrives = (INSIDE_M - OUTSIDE_M) / self.speed_m_per_s
        going = time_s < arrives
        place = np.where(going, OUTSIDE_M + self.speed_m_per_s * time_s, INSIDE_M)
        velocity = np.where(going, self.speed_m_per_s, 0.0)
        middle, swing, omega, until = (FAR_M + INSIDE_M) / 2, (INSIDE_M - FAR_M) / 2, 4 * math.pi, 1.125
        if time_s < until:
            place = np.where(self.taps, middle + swing * math.sin(omega * time_s), place)
            velocity = np.where(self.taps, swing * omega * math.cos(omega * time_s), velocity)
        return place, velocity


@dataclass(frozen=True)
class Found:
    """What happened, of each lane, over the last half second: largest speed of motor and handle, means at the motor.

    The ripple is the force's deviation; `outside_n` the largest command ever where the encoder reads no wall, `given_j`
    the most energy that the motor has given at any moment.
    """

    speed_m_per_s: Floats
    force_n: Floats
    depth_m: Floats
    ripple_n: Floats
    outside_n: Floats
    given_j: Floats


def simulated(device: Device, law: Law, deeds: Deeds, phase: Floats, seconds: float) -> Found:
    """Run all lanes."""
    t, h = device.sample_time_s, device.sample_time_s / STEPS
    limit, step = device.max_force_n or math.inf, device.encoder_resolution_m
    mode, late = device.resonance, round(device.delay_samples)
    lag = (
        1.0 if device.amplifier_bandwidth_hz is None else -math.expm1(-2 * math.pi * device.amplifier_bandwidth_hz * h)
    )
    handle = 0.0 if mode is None else mode.mass_ratio * device.mass_kg
    motor = device.mass_kg - handle if mode else device.mass_kg + deeds.mass_kg
    omega = 0.0 if mode is None else 2 * math.pi * mode.frequency_hz
    spring = handle * (device.mass_kg - handle) / device.mass_kg * omega**2
    damper = 2 * mode.damping_ratio * spring / omega if mode else 0.0
    lanes = len(phase)
    x1, v1 = np.full(lanes, OUTSIDE_M), deeds.velocity_m_per_s.copy()
    x2, v2, force, given = x1.copy(), v1.copy(), np.zeros(lanes), np.zeros(lanes)
    line = [np.zeros(lanes) for _ in range(late + 1)]
    most, outside, fastest = np.zeros(lanes), np.zeros(lanes), np.zeros(lanes)
    samples, tail = round(seconds / t), round(TAIL_S / t)
    forces, depths = [], []
    loss = h * deeds.friction_n / motor
    for n in range(samples):
        seen = step * np.floor(x1 / step + phase + 0.5) if step else x1
        asked = np.clip(law(seen), -limit, limit)
        outside = np.where(seen < 0, np.maximum(outside, np.abs(asked)), outside)
        line = [asked, *line[:late]]
        for i in range(STEPS):
            place, velocity = deeds.target((n + i / STEPS) * t)
            force = force + lag * (line[late] - force)
            hand = deeds.stiffness_n_per_m * (place - x2) + deeds.damping_ns_per_m * (velocity - v2)
            inner = spring * (x2 - x1) + damper * (v2 - v1) if mode else hand
            before = v1
            v1 = v1 + h / motor * (inner - device.damping_ns_per_m * v1 - force)
            v1 = np.sign(v1) * np.maximum(np.abs(v1) - loss, 0.0)
            v2 = v2 + h / (handle + deeds.mass_kg) * (hand - inner) if mode else v1
            given = given - force * (h / 2) * (before + v1)
            x1, x2 = x1 + h * v1, x2 + h * v2 if mode else x1 + h * v1
        most = np.maximum(most, given)
        if n >= samples - tail:
            fastest = np.maximum(fastest, np.maximum(np.abs(v1), np.abs(v2)))
            forces.append(force)
            depths.append(x1)
    held = np.array(forces)
    return Found(fastest, held.mean(axis=0), np.array(depths).mean(axis=0), held.std(axis=0), outside, most)


def frequency_sweep(device: Device, law: Law, depth_m: float, hz: Floats, phase: Floats) -> NDArray[np.complex128]:
    """Lead the motor along depth (1 + sin(2 pi f t)/2), from outside, and return force over position at f, N/m.

    Hold and delay are counted, and of the force its part at the frequency of the motion.
    """
    t, step, ramp_s, settled_s, end_s = device.sample_time_s, device.encoder_resolution_m, 0.25, 1.25, 3.25
    time = t * np.arange(round(end_s / t))[:, None]
    swing = 0.5 * np.sin(2 * np.pi * hz * np.maximum(time - ramp_s, 0.0))
    x = depth_m * (2 * np.minimum(time / ramp_s, 1.0) - 1 + swing)
    seen = step * np.floor(x / step + phase + 0.5) if step else x
    limit = device.max_force_n or math.inf
    force = np.array([np.clip(law(row), -limit, limit) for row in seen])
    last = slice(round(settled_s / t), None)
    wave = np.exp(-2j * np.pi * hz * time[last])
    ratio = ((force[last] - force[last].mean(axis=0)) * wave).sum(axis=0)
    ratio /= ((x[last] - x[last].mean(axis=0)) * wave).sum(axis=0)
    s = 2j * np.pi * hz
    held: NDArray[np.complex128] = ratio * (1 - np.exp(-s * t)) / (s * t) * np.exp(-s * t * device.delay_samples)
    return held
