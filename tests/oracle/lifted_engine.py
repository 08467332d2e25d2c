"""Device and engine over the period of a step p/q samples long, by scipy's matrix exponential: shares nothing else.

A device is (mass, damping, T, delay in whole samples), hands are rows (mass, damping, stiffness), a tool is (mass,
damping); a contact of the tool is a spring and a damper, a stiffness of inf a tool that stands still.
"""

from __future__ import annotations

import math

import numpy as np
from lifted_teleoperator import held_force_step
from scipy.linalg import expm


class Places:
    """Places in the state: device, forces under way, last and older sample, tool, what it handed out."""

    def __init__(self, delay, outputs, width):
        self.body, self.queue = [0, 1], list(range(2, 2 + delay))
        self.last, self.older = 2 + delay, 3 + delay
        self.tool = [4 + delay, 5 + delay]
        self.out = [list(range(at, at + width)) for at in range(6 + delay, 6 + delay + outputs * width, width)]
        self.size = 6 + delay + outputs * width


def tool_moves(integrator, t, mass, drag, spring):
    """Return position and velocity after an internal step from position, velocity and a held force, (2, 3)."""
    if integrator == "exact":
        return expm(np.array([[0, 1, 0], [-spring / mass, -drag / mass, 1 / mass], [0, 0, 0]]) * t)[:2]
    solved = mass + t * drag * (integrator[:8] == "implicit") + t * t * spring * (integrator == "implicit")
    kept = mass if integrator[:8] == "implicit" else mass - t * drag
    speed = np.array([-t * spring, kept, t]) / solved
    place = np.array([1.0, 0.0, 0.0]) + t * (np.array([0.0, 1.0, 0.0]) if integrator == "explicit" else speed)
    return np.array([place, speed])


def period_maps(device, hands, tool, gains, ratio, *, integrator, exchange, late=0, contact=(0.0, 0.0), phase=0.0):
    """Return maps over q steps of p/q samples each and their time; the first step comes a share `phase` of T late."""
    k, b = gains
    period_s, delay = device[2], device[3]
    fixed = math.isinf(contact[0])
    held = exchange == "held-force"
    at = Places(delay, late + (exchange == "late") + 1, 1 if held else 2)
    eye = np.eye(at.size)

    masses, dampers, springs = np.transpose(hands)
    body = held_force_step(device[0] + masses, device[1] + dampers, springs, period_s)
    x, v = eye[0], (eye[0] - eye[at.last]) / period_s
    given = eye[at.out[-1]]
    pull = -given[0] if held else -k * (x - given[0]) - b * (v - given[1])
    sample = np.tile(eye, (len(masses), 1, 1))
    acts = eye[at.queue[0]] if delay else pull
    sample[:, at.body] = body[:, :, :2] @ eye[at.body] + body[:, :, 2:] * acts
    for place in range(delay):
        sample[:, at.queue[place]] = eye[at.queue[place + 1]] if place < delay - 1 else pull
    sample[:, at.last], sample[:, at.older] = eye[0], eye[at.last]

    def step(fresh):
        """Return the map of a step of the engine, which sees the sample of its instant or the one before."""
        seen, before = (eye[0], eye[at.last]) if fresh else (eye[at.last], eye[at.older])
        rate = (seen - before) / period_s
        place, speed = (0 * eye[0], 0 * eye[0]) if fixed else eye[at.tool]
        asked = k * (seen - place) + b * (rate - speed)
        push, spring, drag = k * seen + b * rate, contact[0], tool[1] + contact[1]
        if integrator == "implicit":
            spring = spring + k
        else:
            push = push - k * place
        if integrator[:8] == "implicit":
            drag = drag + b
        else:
            push = push - b * speed
        made = eye.copy()
        after = np.stack([place, speed])
        if not fixed:
            moves = tool_moves(integrator, float(ratio) * period_s, tool[0], drag, spring)
            after = moves[:, :2] @ after + moves[:, 2:] * push
        made[at.tool] = after
        out = {"held-force": asked[None], "ahead": after}.get(exchange, np.stack([place, speed]))
        for older, newer in zip(at.out[:0:-1], at.out[-2::-1], strict=True):
            made[older] = eye[newer]
        made[at.out[0]] = out
        return made

    counts, maps = {}, {True: step(True), False: step(False)}
    whole = np.eye(at.size)
    for number in range(ratio.denominator):
        begin, end = (phase + (number + more) * ratio for more in (0, 1))
        fresh, count = begin == math.ceil(begin), math.ceil(end) - math.ceil(begin)
        if (count, fresh) not in counts:
            counts[count, fresh] = np.linalg.matrix_power(sample, count) @ maps[fresh]
        whole = counts[count, fresh] @ whole
    return whole, ratio.numerator * period_s


def growth(device, hands, tool, gains, ratio, **how):
    """Return the growth in a millisecond with each hand, without what rests anywhere or keeps its speed."""
    whole, time_s = period_maps(device, hands, tool, gains, ratio, **how)
    values = np.linalg.eigvals(whole)
    if how.get("contact", (0.0, 0.0))[0] == 0:
        rows = np.flatnonzero(np.transpose(hands)[2] == 0)
        values[rows, np.abs(values[rows] - 1).argmin(axis=1)] = 0.0
    values = np.where(np.abs(values - 1) < 1e-9, 0.0, values)
    return np.abs(values).max(axis=1) ** (1e-3 / time_s)
