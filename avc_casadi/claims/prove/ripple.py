"""Ripple: bounds on the motion by sensor errors and dry friction in sustained contact, by l1 norms.

In contact the loop is linear: x+ = A x + g n, with n the error of the measured position. For any n within its bound,
the response is at most that bound times the sum of the absolute impulse response. Over a box of hands the loops differ
from that of the middle by a matrix within E, elementwise: with N the sum of |A^j|,

    s <= sum |A^j g| + N E s      bounds the sum of the states' absolute impulse responses,

and the output follows. Boxes for which this bound is infinite or too large are bisected. Rounding counts as part of E.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi._util.units import MASS
from avc_casadi.claims.prove.held_device import HAND
from avc_casadi.claims.prove.switching import SwitchingLoop
from avc_casadi.model.corners import LINEAR_KEYS, device_corners
from avc_casadi.model.hands import Hand
from avc_casadi.model.plant import expm, time_scale
from avc_casadi.model.sampled_plant import device_plant

if TYPE_CHECKING:
    from collections.abc import Mapping

    from avc_casadi.claims.prove.law import ContactLaw
    from avc_casadi.model.device import Device

# Gaussian noise is taken as bounded by so many times its rms.
NOISE_BOUND = 4.0
_SAMPLES = 40_000
_DIES_TO = 1e-7
_BOXES_AT_ONCE = 64
_MOST_BOXES = 4096
# Boxes times samples until the slowest loop has decayed: some seconds.
_BUDGET = 1_500_000
# A box is bisected until its enclosure is within this factor of its middle.
_LOOSE = 1.3
_UP = 1 + 1e-9


@dataclass(frozen=True)
class Ripple:
    """Bounds in sustained contact, with every hand of a box.

    Attributes:
        error_m: bound of the error of the measured position: half an encoder step, a dead zone, noise.
        friction_n: bound of the dry friction.
        position_m: largest displacement by both.
        force_n: largest force ripple by both.
        position_per_error: metres a metre of error, at most.
        force_per_error_n_per_m: newtons a metre of error.
        position_per_friction_m_per_n: metres a newton of friction.
        force_per_friction: newtons a newton of friction.
        corners_position_m: the same bound at the corners of the hands alone, a lower estimate.
        corners_force_n: of the force.
        boxes: boxes that were enclosed.
        press_n: presses that stay in contact and within the force limit, [lowest, highest]; highest None without a
            limit.
    """

    error_m: float
    friction_n: float
    position_m: float
    force_n: float
    position_per_error: float
    force_per_error_n_per_m: float
    position_per_friction_m_per_n: float
    force_per_friction: float
    corners_position_m: float
    corners_force_n: float
    boxes: int
    press_n: tuple[float, float | None]


def bound_ripple(
    law: ContactLaw, device: Device, hand: Mapping[str, tuple[float, float]], progress: Progress = SILENT
) -> Ripple:
    """Bound the ripple of a coupling in sustained contact, over every hand of a box.

    Args:
        law: the law; the dead zone of its observer counts as error.
        device: known exactly but for its friction, sensor and force; a rigid one, with whole samples of delay.
        hand: the box of hands.
        progress: reported over the boxes.

    Raises:
        UnsupportedError: a device or hand that is not covered, or a loop that is not stable in contact.
    """
    devices = device_corners(device, LINEAR_KEYS)
    if len(devices) > 1:
        raise UnsupportedError("ripple is bounded for a device whose linear values are known exactly")
    if tuple(hand) != HAND or device.delay_samples != int(device.delay_samples):
        raise UnsupportedError(f"ripple is bounded for hands of {MASS}, spring and damper and whole samples of delay")
    ends = np.array([hand[name] for name in HAND])
    corners = np.stack([grid.ravel() for grid in np.meshgrid(*ends, indexing="ij")], axis=1)
    exact = _norms(law, device, corners, corners)
    if not np.isfinite(exact).all():
        raise UnsupportedError("the loop is not stable in contact")
    worst, boxes = _over_box(law, device, ends, exact.max(axis=0), progress)
    observer = law.state_feedback
    error = 0.5 * _highest(device, "encoder_resolution_m") + NOISE_BOUND * _highest(device, "position_noise_rms_m")
    error += 0.0 if observer is None else observer.dead_zone_m
    friction = _highest(device, "coulomb_friction_n")
    sizes = np.array([error, friction])
    position, force = worst[:2] @ sizes, worst[2:] @ sizes
    at_corners = exact.max(axis=0)
    return Ripple(
        error_m=error,
        friction_n=friction,
        position_m=float(position),
        force_n=float(force),
        position_per_error=float(worst[0]),
        force_per_error_n_per_m=float(worst[2]),
        position_per_friction_m_per_n=float(worst[1]),
        force_per_friction=float(worst[3]),
        corners_position_m=float(at_corners[:2] @ sizes),
        corners_force_n=float(at_corners[2:] @ sizes),
        boxes=boxes,
        press_n=(float(force), None if device.max_force_n is None else float(_lowest_limit(device) - force)),
    )


def _highest(device: Device, key: str) -> float:
    ends = getattr(device.range, key)
    return float(getattr(device, key) if ends is None else ends[1])


def _lowest_limit(device: Device) -> float:
    ends = device.range.max_force_n
    return float(device.max_force_n or 0.0 if ends is None else ends[0])


def _over_box(
    law: ContactLaw, device: Device, ends: FloatArray, known: FloatArray, progress: Progress
) -> tuple[FloatArray, int]:
    """Return the norms over the box, and the boxes of its partition."""
    low, high = ends[None, :, 0], ends[None, :, 1]
    worst, done = known.copy(), 0
    corners = Hand(*np.stack([grid.ravel() for grid in np.meshgrid(*ends, indexing="ij")]))
    radius = min(float(_closed(law, device, corners)[0].contact_radius().max()), 1 - 1e-6)
    most = int(np.clip(_BUDGET * np.log(radius) / np.log(_DIES_TO), 1, _MOST_BOXES))
    share, whole = 0.0, float(np.prod((high - low)[high > low]))
    while len(low):
        now, later = slice(0, _BOXES_AT_ONCE), slice(_BOXES_AT_ONCE, None)
        some_low, some_high = low[now], high[now]
        norms = _norms(law, device, some_low, some_high)
        good = (norms <= _LOOSE * known).all(axis=1)
        if done + len(low) > most:
            good = np.isfinite(norms).all(axis=1)
            if not good.all():
                raise UnsupportedError(f"ripple was not enclosed in {most} boxes of hands")
        worst = np.maximum(worst, norms[good].max(axis=0, initial=0.0))
        done += int(good.sum())
        width = some_high - some_low
        share += float(np.prod(np.where(width > 0, width, 1.0)[good], axis=1).sum())
        progress.advance(round(1000 * share / whole), 1000, "ripple")
        cut_low, cut_high = _halves(law, device, some_low[~good], some_high[~good])
        low, high = np.concatenate([low[later], cut_low]), np.concatenate([high[later], cut_high])
    return worst, done


def _halves(law: ContactLaw, device: Device, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Bisect boxes across the number that changes the loop most."""
    if not len(low):
        return low, high
    middle = _middle(low, high)
    moved = np.zeros_like(low)
    for number in range(low.shape[1]):
        ends = [middle.copy(), middle.copy()]
        ends[0][:, number], ends[1][:, number] = low[:, number], high[:, number]
        one, other = (_closed(law, device, Hand(*end.T))[1][:, :, :-1] for end in ends)
        moved[:, number] = np.abs(one - other).sum(axis=(1, 2))
    number = np.argmax(moved, axis=1)
    rows = np.arange(len(low))
    upper, lower = low.copy(), high.copy()
    upper[rows, number] = lower[rows, number] = middle[rows, number]
    return np.concatenate([low, upper]), np.concatenate([lower, high])


def _middle(low: FloatArray, high: FloatArray) -> FloatArray:
    """Return the geometric mean, or the arithmetic one where a range begins at 0."""
    return np.where(low > 0, np.sqrt(low * high), 0.5 * (low + high))


def _closed(law: ContactLaw, device: Device, hands: Hand) -> tuple[SwitchingLoop, FloatArray, FloatArray]:
    """Return the loop in contact, its map over (state, error of the position), and the row of its force."""
    loop = SwitchingLoop.of(law, "clip-last", device, hands, np.ones(len(hands)))
    rows, force, _ = loop.piece(np.zeros((len(hands), loop.states)), always=True)
    return loop, rows, force


def _norms(law: ContactLaw, device: Device, low: FloatArray, high: FloatArray) -> FloatArray:
    """Bound the l1 norms over boxes of hands, shape (h, 4): position over error and friction, force over both.

    Not finite where a box is too large, or its loop unstable.
    """
    hands = Hand(*_middle(low, high).T)
    h = len(hands)
    loop, rows, force = _closed(law, device, hands)
    n = loop.states
    matrix, s = rows[:, :, :n], len(loop.measured)
    spread, kick, kick_spread = _plant_spread(device, hands, low, high, n)
    # Deviation of the plants of the box from that of the middle, and its effect on the force.
    off = np.zeros_like(matrix)
    off[:, :, :n] = spread[:, :, :n]
    through = spread[:, :, n]
    off += through[:, :, None] * np.abs(force[:, None, :n]) + n * 2.0**-50 * np.abs(matrix)
    inputs = np.stack([rows[:, :, n], kick], axis=2)
    inputs_off = np.stack([through * np.abs(force[:, n:]), kick_spread], axis=2) + 2.0**-50 * np.abs(inputs)
    outputs = np.zeros((h, 2, n))
    outputs[:, 0, :s], outputs[:, 1] = loop.measured, force[:, :n]
    direct = np.zeros((h, 2, 2))
    direct[:, 1, 0] = np.abs(force[:, n])
    with np.errstate(all="ignore"):
        return _enclosed(matrix, off, inputs, inputs_off, outputs, direct)


def _plant_spread(
    device: Device, hands: Hand, low: FloatArray, high: FloatArray, states: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the deviation of the plant's map over each box, the effect of friction in a sample, and its deviation.

    Every entry of the continuous matrix is monotone in each number of the hand, so that the corners of a box bound it;
    |exp(M + D) - exp(M)| <= exp(|M| + |D|) - exp(|M|), elementwise.
    """
    h = len(low)
    t = device.sample_time_s
    middle = _continuous(device, hands, t)
    wide = np.zeros_like(middle)
    for corner in range(8):
        pick = np.array([corner >> place & 1 for place in range(3)], dtype=bool)
        wide = np.maximum(wide, np.abs(_continuous(device, Hand(*np.where(pick, high, low).T), t) - middle))
    wide += 2.0**-48 * np.abs(middle)
    size = middle.shape[-1]
    both = np.zeros((h, 2 * size, 2 * size))
    both[:, :size, :size] = np.abs(middle) + wide
    both[:, size:, size:] = np.abs(middle)
    both[:, :size, size:] = wide
    grown = expm(both)[:, :size, size:] * _UP + 1e-14 * np.abs(expm(np.abs(middle)))
    s = size - 2
    spread = np.zeros((h, states, states + 1))
    spread[:, :s, :s] = grown[:, :s, :s]
    delay = int(device.delay_samples)
    # With a delay of n samples the oldest of the delayed forces acts.
    place = states if delay == 0 else s + delay - 1
    spread[:, :s, place] = grown[:, :s, s]
    kick, kick_spread = np.zeros((h, states)), np.zeros((h, states))
    # The effect of a bounded force is at most the integral of the absolute impulse response.
    kick[:, :s] = expm(np.abs(middle))[:, :s, s + 1]
    kick_spread[:, :s] = grown[:, :s, s + 1]
    return spread, kick, kick_spread


def _continuous(device: Device, hands: Hand, t: float) -> FloatArray:
    """Return the matrix over a sample of the plant's states, the force and the friction, (h, s + 2, s + 2)."""
    plant = device_plant(device, hands).linear()
    scale = time_scale(plant, t)
    s = plant.states
    h = len(hands)
    whole = np.zeros((h, s + 2, s + 2))
    whole[:, :s, :s] = plant.matrix * t * scale[:, None] / scale
    whole[:, :s, s] = plant.force * t * scale
    whole[:, :s, s + 1] = plant.friction * t * scale
    return whole


def _enclosed(
    matrix: FloatArray,
    off: FloatArray,
    inputs: FloatArray,
    inputs_off: FloatArray,
    outputs: FloatArray,
    direct: FloatArray,
) -> FloatArray:
    h, n, _ = matrix.shape
    eye = np.eye(n)
    power, passing, column = np.tile(eye, (h, 1, 1)), np.zeros((h, n, n)), np.zeros((h, 2, 2))
    carried = np.zeros((h, 2, n))
    for _ in range(_SAMPLES):
        passing += np.abs(power)
        row = outputs @ power
        carried += np.abs(row)
        column += np.abs(row @ inputs)
        power = matrix @ power
        size = np.abs(power).sum(axis=2).max(axis=1)
        if not (size[np.isfinite(size)] > _DIES_TO).any():
            break
    later = np.abs(power)
    dies = later.sum(axis=2).max(axis=1) <= _DIES_TO
    # Remainder after the summed samples: at most the same sum times |A^J|, |A^J|^2, ...
    again = np.linalg.inv(eye - np.where(dies[:, None, None], later, 0.0))
    passing, carried = passing @ again * _UP, carried @ again * _UP
    column = (column + carried @ later @ np.abs(inputs)) * _UP
    response = passing @ (np.abs(inputs) + inputs_off)
    loop = passing @ off
    small = np.abs(np.linalg.eigvals(np.where(np.isfinite(loop), loop, 2.0))).max(axis=1) < 0.9
    usable = dies & small
    states = np.linalg.solve(np.where(usable[:, None, None], eye - loop, eye), response) * _UP
    usable &= (states >= 0).all(axis=(1, 2))
    found = direct + column + carried @ inputs_off + carried @ off @ states
    return np.where(usable[:, None], found.reshape(h, 4), np.inf)
