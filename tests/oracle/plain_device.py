"""A mass with damper, dry friction, encoder and delay in a hand, in small steps: shares no code with the package."""

import math

import numpy as np
from stated_law import StatedLaw

_PARTS = 20
"""Steps of a sample."""


def moved(problem, motion, hand=(0.0, 0.0, 0.0), *, friction_n=None, start=-0.01, speed=0.0):
    """Positions of the device at the samples of a motion of the target, an array, with the law of a problem.

    hand: mass, damper and spring between target and device.
    """
    device, period = problem.device, problem.device.sample_time_s
    friction = device.coulomb_friction_n if friction_n is None else friction_n
    mass, step = device.mass_kg + hand[0], period / _PARTS
    late = round(device.delay_samples * _PARTS)
    law = StatedLaw(problem.law, period, problem.law_in_wall, quantised(start, device))
    limit = device.max_force_n or math.inf
    forces = [0.0] * (late + 1)
    x, v, places = start, speed, np.empty(len(motion))
    velocity = np.append(np.diff(motion) / period, 0.0)
    for sample, target in enumerate(motion):
        places[sample] = x
        command = min(max(law.force(quantised(x, device)), -limit), limit)
        for part in range(_PARTS):
            forces.append(command)
            aim = target + velocity[sample] * part * step
            pull = hand[2] * (aim - x) + hand[1] * (velocity[sample] - v)
            moving = v + step * (pull - forces[-1 - late] - device.damping_ns_per_m * v) / mass
            stop = step * friction / mass
            v = 0.0 if abs(moving) <= stop else moving - math.copysign(stop, moving)
            x += step * v
        del forces[: -late - 1]
    return places


def quantised(x, device):
    """What an encoder counts."""
    step = device.encoder_resolution_m
    return step * math.floor(x / step + 0.5) if step else x


def pressed(seconds, period, start=-0.01, end=0.01, speed=0.07):
    """The target of a press."""
    time = np.arange(round(seconds / period)) * period
    return np.minimum(start + speed * time, end)


def turns(positions):
    """How often positions pass their middle by a quarter of their size, and that size."""
    middle, size = 0.5 * (positions.max() + positions.min()), np.ptp(positions)
    side, count = 0, 0
    for x in positions:
        here = 0 if abs(x - middle) < 0.25 * size else math.copysign(1, x - middle)
        count += side * here < 0
        side = here or side
    return count, size
