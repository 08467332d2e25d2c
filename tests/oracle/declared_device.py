"""Devices as declared, written out here from their equations of motion: the loop in time, the port at a frequency.

In time the sampled loop is a matrix, discretised by scipy. At a frequency the hand moves at all aliases at once; the
impedance that it meets is a matrix over them, and its Hermitian part says what is passive.
"""

import numpy as np
from sampled_wall import mechanics
from scipy.linalg import expm

MODE = {"frequency_hz": 150.0, "damping_ratio": 0.05, "mass_ratio": 0.5}


def random_device(rng):
    """Draw what a device may declare of its linear part."""
    order = int(rng.integers(0, 3))
    device = {
        "mass_kg": rng.uniform(0.05, 0.5),
        "damping_ns_per_m": rng.uniform(0.2, 4.0),
        "sample_time_s": rng.uniform(5e-4, 2e-3),
        "delay_samples": float(rng.choice([0, 1, 2, round(rng.uniform(0, 2.5), 2)])),
        "encoder_at": str(rng.choice(["motor", "handle"])),
    }
    if order:
        device |= {"amplifier_bandwidth_hz": rng.uniform(150, 2000), "amplifier_order": order}
    if order == 2:
        device["amplifier_damping_ratio"] = rng.uniform(0.3, 1.5)
    if rng.random() < 0.6:
        mode = {"frequency_hz": rng.uniform(40, 300), "damping_ratio": rng.uniform(0.01, 0.2)}
        device["resonance"] = mode | {"mass_ratio": rng.uniform(0.2, 0.8)}
    return device


def loop(device, hand, gains, wall):
    """One sample of the closed loop as a matrix: the sample is split where the newer force arrives."""
    a, b, measured = mechanics(device, hand)
    n, time = len(b), device.sample_time_s
    whole, late = int(device.delay_samples), device.delay_samples % 1
    (g, k, b_p), (b_e, k_e) = gains, wall

    def step(duration):
        both = np.zeros((n + 1, n + 1))
        both[:n, :n], both[:n, n] = a * duration, b * duration
        return expm(both)[:n]

    before_arrival, after_arrival = step(late * time), step((1 - late) * time)

    def tick(state):
        x, before, joint_before, line = state[:n], state[n], state[n + 1], list(state[n + 2 :])
        y = x[measured]
        joint = (g * (y - before) / time + k * y + (g + b_e) * joint_before / time) / ((g + b_e) / time + k + k_e)
        force = b_e * (joint - joint_before) / time + k_e * joint + b_p * (y - before) / time
        forces = [force, *line]
        x = before_arrival @ [*x, forces[whole + 1]] if late else x
        x = after_arrival @ [*x, forces[whole]]
        return np.array([*x, y, joint, *forces[: len(line)]])

    # Rates count by the sample, so that the eigenvalues keep their digits.
    size = n + 2 + whole + 1
    matrix = np.stack([tick(row) for row in np.eye(size)], axis=1)
    bodies = 4 if device.resonance is not None else 2
    scale = np.ones(size)
    scale[1:bodies:2] = time
    scale[bodies:n] = scale[n + 2 :] = time**2 / device.mass_kg
    scale[bodies + 1 : n] /= time
    return matrix * scale[:, None] / scale


def growth(*args):
    return np.abs(np.linalg.eigvals(loop(*args))).max()


def port_equations(device, s):
    """Of the device at s: impedance at the handle, motor over handle velocity, the motor's admittance, amplifier."""
    b, one = device.damping_ns_per_m, np.ones_like(s)
    amplifier = one
    if device.amplifier_bandwidth_hz is not None:
        a = 2 * np.pi * device.amplifier_bandwidth_hz
        ratio = device.amplifier_damping_ratio
        amplifier = a / (s + a) if device.amplifier_order == 1 else a**2 / (s**2 + 2 * ratio * a * s + a**2)
    if device.resonance is None:
        return device.mass_kg * s + b, one, one, 0 * s, amplifier
    mode = device.resonance
    handle, motor = mode.mass_ratio * device.mass_kg, (1 - mode.mass_ratio) * device.mass_kg
    between = handle * motor / (handle + motor)
    omega = 2 * np.pi * mode.frequency_hz
    spring, own = between * (omega**2 / s + 2 * mode.damping_ratio * omega), motor * s + b
    tau = spring / (spring + own)
    seen, admittance = (one, 0 * s) if device.encoder_at == "handle" else (tau, 1 / (spring + own))
    return handle * s + spring * own / (spring + own), tau, seen, admittance, amplifier


def rendered(gains, wall, sample_time_s, z):
    """Coupling and wall in series beside the contact damper, for backward differences."""
    rate = (1 - 1 / z) / sample_time_s
    coupling, wall = gains[0] + gains[1] / rate, wall[0] + wall[1] / rate
    return coupling * wall / (coupling + wall) + gains[2]


def lowest_eigenvalue(device, impedance, turns, aliases):
    """Of the Hermitian part of the impedance at the handle, `impedance` the rendering's; and the least loss alone."""
    time = device.sample_time_s
    s = 2j * np.pi * (turns + np.arange(-aliases, aliases + 1)) / time
    z = np.exp(2j * np.pi * turns)
    alone, tau, seen, admittance, amplifier = port_equations(device, s)
    per_position = impedance * (1 - 1 / z) / time
    force = (1 - np.exp(-s * time)) / s * amplifier * np.exp(-s * device.delay_samples * time)
    closed = per_position / (1 + per_position * np.sum(force * admittance / s) / time)
    matrix = np.diag(alone) + np.outer(tau * force * closed, seen / s / time)
    return np.linalg.eigvalsh((matrix + matrix.conj().T) / 2)[0], alone.real.min()
