"""The plant of an admittance device: drive, sensor and handle, and what the handle carries, in discrete time."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.model.admittance import AdmittanceDevice
from avc_casadi.model.hands import Hand
from avc_casadi.model.plant import DEVICE, HANDLE, LinearPlant, SampledPlant, discretised

_DRIVE = (f"{DEVICE}_position_m", f"{DEVICE}_velocity_m_per_s", "drive_rate_m_per_s")
_HANDLE = (f"{HANDLE}_position_m", f"{HANDLE}_velocity_m_per_s")


def driven_plant(device: AdmittanceDevice, carried: Hand) -> LinearPlant:
    """Return drive, sensor and handle with what it carries; the input is the commanded velocity u.

    The drive follows whatever pushes, by w = 2 pi f_d: dv/dt = w (u - v), or of second order, with a rate r in m/s,

        dv/dt = w r,   dr/dt = w (u - v) - 2 zeta w r.

    The handle of mass m_s carries a hand or a contact (m, b, k) towards its target: with x_h, v_h of the handle and
    the sensor's force f = k_s (x_h - x) + b_s (v_h - v),

        (m_s + m) dv_h/dt = -f - k (x_h - x_t) - b (v_h - v_t).
    """
    sensor = device.force_sensor
    mass, damping, stiffness = (np.asarray(value, dtype=np.float64) for value in vars(carried).values())
    total = sensor.handle_mass_kg + mass
    names = (*_DRIVE[: 1 + device.drive_order], *_HANDLE)
    size = len(names)
    place, speed = size - 2, size - 1
    matrix = np.zeros((*total.shape, size, size))
    force, target = np.zeros((*total.shape, size)), np.zeros((*total.shape, size, 2))
    omega = 2 * math.pi * device.drive_bandwidth_hz
    matrix[..., 0, 1] = 1.0
    if device.drive_order == 1:
        matrix[..., 1, 1] = -omega
        force[..., 1] = omega
    else:
        matrix[..., 1, 2] = omega
        matrix[..., 2, 1] = -omega
        matrix[..., 2, 2] = -2 * device.drive_damping_ratio * omega
        force[..., 2] = omega
    matrix[..., place, speed] = 1.0
    matrix[..., speed, 0] = sensor.stiffness_n_per_m / total
    matrix[..., speed, 1] = sensor.damping_ns_per_m / total
    matrix[..., speed, place] = -(sensor.stiffness_n_per_m + stiffness) / total
    matrix[..., speed, speed] = -(sensor.damping_ns_per_m + damping) / total
    target[..., speed, 0] = stiffness / total
    target[..., speed, 1] = damping / total
    return LinearPlant(names, matrix, force, target, np.zeros_like(force))


def sensor_row(device: AdmittanceDevice) -> FloatArray:
    """Return what the sensor reads, as a row of the plant's state."""
    sensor = device.force_sensor
    row = np.zeros(3 + device.drive_order)
    row[0], row[1] = -sensor.stiffness_n_per_m, -sensor.damping_ns_per_m
    row[-2], row[-1] = sensor.stiffness_n_per_m, sensor.damping_ns_per_m
    return row


def sampled_drive(devices: Sequence[AdmittanceDevice], carried: Sequence[Hand]) -> SampledPlant:
    """Discretise devices, each with its own hands or contacts at the handle, exactly.

    The law of such a plant reads the drive's position and the sensor's force, and commands a velocity.
    """
    plants = [driven_plant(device, hand) for device, hand in zip(devices, carried, strict=True)]
    matrix, new, old = discretised(plants, devices)
    names = plants[0].names
    rows = np.array([sensor_row(device) for device in devices])[:, None]
    return SampledPlant(
        names=names,
        matrix=matrix,
        new=new,
        old=old,
        whole_delay=np.array([int(device.delay_samples) for device in devices]),
        output_row=np.array([float(name == _DRIVE[0]) for name in names]),
        held=np.array([float(name == _HANDLE[0]) for name in names]),
        sample_time_s=devices[0].sample_time_s,
        force_row=np.broadcast_to(rows, (*new.shape[:2], len(names))),
    )
