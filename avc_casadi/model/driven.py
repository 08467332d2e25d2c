"""The plant of a device with a force sensor: drive, sensor and handle, and what that carries, in discrete time."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi.model.admittance import AdmittanceDevice
from avc_casadi.model.hands import Hand
from avc_casadi.model.plant import DEVICE, HANDLE, LinearPlant, SampledPlant, device_plant, discretised
from avc_casadi.model.sensed import SensedDevice, SensorDevice

_DRIVE = (f"{DEVICE}_position_m", f"{DEVICE}_velocity_m_per_s", "drive_rate_m_per_s")
_HANDLE = (f"{HANDLE}_position_m", f"{HANDLE}_velocity_m_per_s")
COMMANDED = "commanded_position_m"
"""The commanded position that arrived last at a drive that follows one."""
LINK = "link"
"""What carries the sensor of a device beyond a transmission that gives way."""


def driven_plant(device: SensorDevice, carried: Hand) -> LinearPlant:
    """Return drive, sensor and handle with what it carries; the input is what is commanded."""
    return sensed_plant(device, carried) if isinstance(device, SensedDevice) else servo_plant(device, carried)


def sensed_plant(device: SensedDevice, carried: Hand) -> LinearPlant:
    """Return device, sensor and handle with what it carries; the input is the commanded force u, against +x.

    Without a resonance and an amplifier, with x of the device's mass m and x_h of the handle:

        m dv/dt = -u - b_d v + f,   f = k_s (x_h - x) + b_s (v_h - v).
    """
    sensor = device.force_sensor
    plant = device_plant(device, beyond=LINK)
    plant.add_mass(HANDLE, sensor.handle_mass_kg)
    plant.join(plant.grip, HANDLE, sensor.stiffness_n_per_m, sensor.damping_ns_per_m)
    plant.grip = HANDLE
    carried.mechanics(plant)
    return plant.linear()


def servo_plant(device: AdmittanceDevice, carried: Hand) -> LinearPlant:
    """Return drive, sensor and handle with what it carries; the input is the commanded velocity u.

    The drive follows whatever pushes, by w = 2 pi f_d: dv/dt = w (u - v), or of second order, with a rate r in m/s,

        dv/dt = w r,   dr/dt = w (u - v) - 2 zeta w r.

    A drive that follows a commanded position x_c has dv/dt = w^2 (x_c - x) - 2 zeta w v; the input is then x_c.

    The handle of mass m_s carries a hand or a contact (m, b, k) towards its target: with x_h, v_h of the handle and
    the sensor's force f = k_s (x_h - x) + b_s (v_h - v),

        (m_s + m) dv_h/dt = -f - k (x_h - x_t) - b (v_h - v_t).
    """
    sensor = device.force_sensor
    mass, damping, stiffness = (np.asarray(value, dtype=np.float64) for value in vars(carried).values())
    total = sensor.handle_mass_kg + mass
    follows_position = device.drive == "position"
    names = (*_DRIVE[: 2 if follows_position else 1 + device.drive_order], *_HANDLE)
    size = len(names)
    place, speed = size - 2, size - 1
    matrix = np.zeros((*total.shape, size, size))
    force, target = np.zeros((*total.shape, size)), np.zeros((*total.shape, size, 2))
    omega = 2 * math.pi * device.drive_bandwidth_hz
    matrix[..., 0, 1] = 1.0
    if follows_position:
        matrix[..., 1, 0] = -(omega**2)
        matrix[..., 1, 1] = -2 * device.drive_damping_ratio * omega
        force[..., 1] = omega**2
    elif device.drive_order == 1:
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


def position_row(device: SensorDevice, names: Sequence[str]) -> FloatArray:
    """Return the position that the law reads, as a row of the plant's state."""
    at_handle = isinstance(device, SensedDevice) and device.encoder_at == "handle" and device.resonance is not None
    return _row(names, f"{LINK if at_handle else DEVICE}_position_m")


def sensor_row(device: SensorDevice, names: Sequence[str]) -> FloatArray:
    """Return what the sensor reads, as a row of the plant's state."""
    sensor = device.force_sensor
    carrier = LINK if isinstance(device, SensedDevice) and device.resonance is not None else DEVICE
    stretch = _row(names, _HANDLE[0]) - _row(names, f"{carrier}_position_m")
    rate = _row(names, _HANDLE[1]) - _row(names, f"{carrier}_velocity_m_per_s")
    return sensor.stiffness_n_per_m * stretch + sensor.damping_ns_per_m * rate


def handle_pull(device: SensorDevice, names: Sequence[str]) -> FloatArray:
    """Return the rates of the plant's state by a force on the released handle."""
    return _row(names, _HANDLE[1]) / device.force_sensor.handle_mass_kg


def _row(names: Sequence[str], state: str) -> FloatArray:
    return np.array([float(name == state) for name in names])


def sampled_drive(devices: Sequence[SensorDevice], carried: Sequence[Hand]) -> SampledPlant:
    """Discretise devices, each with its own hands or contacts at the handle, exactly.

    The law of such a plant reads the drive's position and the sensor's force, and commands a velocity or a force.
    """
    plants = [driven_plant(device, hand) for device, hand in zip(devices, carried, strict=True)]
    matrix, new, old = discretised(plants, devices)
    names = plants[0].names
    if devices[0].drive == "position":
        matrix, new, old = _summing(matrix, new, old, devices[0].sample_time_s)
        names = (*names, COMMANDED)
    rows = np.array([sensor_row(device, names) for device in devices])[:, None]
    return SampledPlant(
        names=names,
        matrix=matrix,
        new=new,
        old=old,
        whole_delay=np.array([int(device.delay_samples) for device in devices]),
        output_row=position_row(devices[0], names),
        held=_row(names, _HANDLE[0]),
        sample_time_s=devices[0].sample_time_s,
        force_row=np.broadcast_to(rows, (*new.shape[:2], len(names))),
    )


def _summing(
    matrix: FloatArray, new: FloatArray, old: FloatArray, sample_time_s: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return A, B_new and B_old of a drive of positions for commanded velocities, the last position a further state.

    With n whole samples of delay, c of this state and the position c + T u(k-n) that arrives now:

        x+ = A x + B_new (c + T u(k-n)) + B_old c,   c+ = c + T u(k-n).
    """
    size = new.shape[-1]
    summed = np.zeros((*new.shape[:-1], size + 1, size + 1))
    summed[..., :size, :size] = matrix
    summed[..., :size, size] = new + old
    summed[..., size, size] = 1.0
    one = np.ones((*new.shape[:-1], 1))
    of_velocity = np.concatenate([new, one], axis=-1) * sample_time_s
    return summed, of_velocity, np.zeros_like(of_velocity)


def held_command(device: SensorDevice, turns: FloatArray) -> ComplexArray:
    """Return how a command of the law acts at its own frequency, held and late: of a drive of positions, summed."""
    held = -np.expm1(-1j * turns) / (1j * turns) * np.exp(-1j * turns * device.delay_samples)
    if device.drive == "position":
        held = held * device.sample_time_s / -np.expm1(-1j * turns)
    return np.asarray(held)
