"""A wall on a device with a hand, from sample to sample, as a matrix put together by hand."""

import math

import numpy as np
from scipy.linalg import expm


def mechanics(device, hand):
    """Return A and the column of the commanded force, amplifier included, and the state that is measured."""
    mass, damping, stiffness = hand
    mode = device.resonance
    if mode is None:
        m, measured = device.mass_kg + mass, 0
        a = np.array([[0.0, 1.0], [-stiffness / m, -(device.damping_ns_per_m + damping) / m]])
        push = np.array([0.0, -1 / m])
    else:
        handle = device.mass_kg * mode.mass_ratio
        motor, reduced, omega = device.mass_kg - handle, handle * (1 - mode.mass_ratio), 2 * math.pi * mode.frequency_hz
        k, c, m = reduced * omega**2, 2 * mode.damping_ratio * omega * reduced, handle + mass
        a = np.array(
            [
                [0.0, 1.0, 0.0, 0.0],
                [-k / motor, -(device.damping_ns_per_m + c) / motor, k / motor, c / motor],
                [0.0, 0.0, 0.0, 1.0],
                [k / m, c / m, -(k + stiffness) / m, -(c + damping) / m],
            ]
        )
        push, measured = np.array([0.0, -1 / motor, 0.0, 0.0]), 2 if device.encoder_at == "handle" else 0
    if device.amplifier_bandwidth_hz is None:
        return a, push, measured
    n, order, rate = len(a), device.amplifier_order, 2 * math.pi * device.amplifier_bandwidth_hz
    whole, drive = np.zeros((n + order, n + order)), np.zeros(n + order)
    whole[:n, :n], whole[:n, n] = a, push
    if order == 1:
        whole[n, n], drive[n] = -rate, rate
    else:
        whole[n, n + 1] = 1.0
        whole[n + 1, n:] = -(rate**2), -2 * device.amplifier_damping_ratio * rate
        drive[n + 1] = rate**2
    return whole, drive, measured


def spectral_radius(device, hand, damping, stiffness, poles=(0.0, 0.0)):
    """Return the largest eigenvalue of the loop with K x + B v held for T, v a difference behind two poles."""
    a, push, measured = mechanics(device, hand)
    n, period = len(a), device.sample_time_s
    whole = math.floor(device.delay_samples)
    late = device.delay_samples - whole

    def step(time):
        augmented = np.zeros((n + 1, n + 1))
        augmented[:n, :n], augmented[:n, n] = a, push
        moved = expm(augmented * time)
        return moved[:n, :n], moved[:n, n]

    # States: mechanics, forces asked for in the last samples, position and two velocities of those before.
    forces, before, velocity = n, n + whole + 1, n + whole + 2
    rate = np.zeros(n + whole + 4)
    rate[measured], rate[before] = (1 + sum(poles)) / period, -(1 + sum(poles)) / period
    rate[velocity : velocity + 2] = -poles[0], -poles[1]
    asked = damping * rate
    asked[measured] += stiffness
    queue = [asked, *np.eye(n + whole + 4)[forces : forces + whole + 1]]
    (first, first_push), (second, second_push) = step(late * period), step((1 - late) * period)
    loop = np.zeros((n + whole + 4, n + whole + 4))
    loop[:n, :n] = second @ first
    loop[:n] += np.outer(second_push, queue[whole]) + np.outer(second @ first_push, queue[whole + 1])
    loop[forces : forces + whole + 1] = queue[: whole + 1]
    loop[before, measured] = 1.0
    loop[velocity], loop[velocity + 1, velocity] = rate, 1.0
    return float(np.abs(np.linalg.eigvals(loop)).max())
