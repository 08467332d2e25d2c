"""Leader, follower and link over one period of both clocks, by scipy's matrix exponential: shares nothing else.

A device is (mass, damping, T, delay in whole samples); a hand (mass, damping, stiffness); contacts are arrays of
springs and dampers of the follower, inf for a rigid one. The architecture is "position-position", or the force that a
position-force pair sends, "commanded" or "measured".
"""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
from scipy.linalg import expm

POSITION, VELOCITY = 0, 1
# Instants within this share of a sample are the same.
SAME_INSTANT = 1e-9


def held_force_step(mass, damping, stiffness, period_s):
    """Return x(T) of n masses with spring and damper from position, velocity and a held force, (n, 2, 3)."""
    mass, damping, stiffness = np.broadcast_arrays(*np.atleast_1d(mass, damping, stiffness))
    rate = np.zeros((len(mass), 3, 3))
    rate[:, 0, 1] = 1.0
    rate[:, 1] = np.stack([-stiffness / mass, -damping / mass, 1 / mass], axis=1)
    # Velocity is counted in lengths per radian of the spring, or per sample: else its rows dominate those of position.
    unit = np.maximum(np.sqrt(stiffness / mass), 1 / period_s)
    scale = np.stack([np.ones_like(unit), 1 / unit, np.ones_like(unit)], axis=1)
    step = np.array([expm(one * period_s) for one in rate * scale[:, :, None] / scale[:, None, :]])
    return (step / scale[:, :, None] * scale[:, None, :])[:, :2]


class Side:
    """Places of a device's quantities in the state: body, forces under way, positions sent, newest first."""

    def __init__(self, start, delay, remembered):
        self.body = start
        self.queue = list(range(start + 2, start + 2 + delay))
        self.sent = list(range(start + 2 + delay, start + 2 + delay + remembered))
        self.end = start + 2 + delay + remembered


def period_maps(leader, follower, gains, there_s, back_s, *, hand, contacts, architecture, phase=0.0):
    """Return the maps over a period for n contacts, (n, size, size), and the period in s; phase: a share of its T."""
    k, b = gains
    times = leader[2], follower[2]
    ratio = Fraction(times[1] / times[0]).limit_denominator(64)
    counts = ratio.numerator, ratio.denominator
    springs, dampers = (np.atleast_1d(np.asarray(values, dtype=float)) for values in contacts)
    rigid = np.isinf(springs)
    soft, damper = np.where(rigid, 0.0, springs), np.where(rigid, 0.0, dampers)
    bodies = [
        held_force_step(leader[0] + hand[0], leader[1] + hand[1], hand[2], times[0]),
        held_force_step(follower[0], follower[1] + damper, soft, times[1]),
    ]
    remembered = [math.ceil(delay_s / period_s) + 3 for delay_s, period_s in zip((there_s, back_s), times, strict=True)]
    sides = [Side(0, leader[3], remembered[0])]
    sides.append(Side(sides[0].end, follower[3], remembered[1]))
    sends_force = architecture != "position-position"
    forces = list(range(sides[1].end, sides[1].end + remembered[1] * sends_force))
    size = sides[1].end + len(forces)
    state = np.tile(np.eye(size), (len(springs), 1, 1))
    instants = sorted(
        (float(number * (1, ratio)[side] + side * phase * ratio), side)
        for side in (0, 1)
        for number in range(counts[side])
    )
    offset = (0.0, float(phase * ratio))
    step = (1.0, float(ratio))

    def arrived(side, now, delay):
        """Return the number of the newest sample of a side that has arrived after a delay, in the leader's samples."""
        return math.floor((now - delay - offset[side]) / step[side] + SAME_INSTANT)

    def now_of(side, now):
        return math.floor((now - offset[side]) / step[side] + SAME_INSTANT)

    for now in sorted({round(time, 12) for time, _ in instants}):
        acting = [side for time, side in instants if round(time, 12) == now]
        for side in acting:
            position = state[:, sides[side].body].copy()
            for place in reversed(range(1, len(sides[side].sent))):
                state[:, sides[side].sent[place]] = state[:, sides[side].sent[place - 1]]
            state[:, sides[side].sent[0]] = position
        before, new_force = state.copy(), None
        for side in acting:
            other, delay = 1 - side, (back_s, there_s)[side] / times[0]
            age = now_of(other, now) - arrived(other, now, delay)
            own, far = sides[side].sent, sides[other].sent
            pull = k * (before[:, far[age]] - before[:, own[0]])
            pull = pull + b / times[other] * (before[:, far[age]] - before[:, far[age + 1]])
            pull = pull - b / times[side] * (before[:, own[0]] - before[:, own[1]])
            if side == 0 and sends_force:
                # A force is sent after the sample that it is of: one of this very instant has not arrived.
                late = age - (1 in acting)
                pull = -before[:, forces[max(late, 0)]]
            if side == 1 and sends_force:
                felt = soft[:, None] * before[:, sides[1].body] + damper[:, None] * before[:, sides[1].body + 1]
                measured = (architecture == "measured") & ~rigid
                new_force = np.where(measured[:, None], felt, pull)
            queue = sides[side].queue
            acts = before[:, queue[0]] if queue else pull
            for place in range(len(queue) - 1):
                state[:, queue[place]] = before[:, queue[place + 1]]
            if queue:
                state[:, queue[-1]] = pull
            body = sides[side].body
            moved = bodies[side][:, :, :2] @ before[:, body : body + 2] + bodies[side][:, :, 2:] * acts[:, None, :]
            if side == 1:
                moved = np.where(rigid[:, None, None], 0.0, moved)
            state[:, body : body + 2] = moved
        if new_force is not None:
            for place in reversed(range(1, len(forces))):
                state[:, forces[place]] = before[:, forces[place - 1]]
            state[:, forces[0]] = new_force
    return state, counts[0] * times[0]


def growth(leader, follower, gains, there_s, back_s, **how):
    """Return the spectral radius of each contact by the leader's sample, without what rests anywhere."""
    maps, period_s = period_maps(leader, follower, gains, there_s, back_s, **how)
    values = np.linalg.eigvals(maps)
    hand, springs = how["hand"], np.atleast_1d(np.asarray(how["contacts"][0], dtype=float))
    # Nothing drives the pair back where hand and contact have no spring; of a position-force pair not the leader.
    floats = (hand[2] == 0) & ((springs == 0) | (how["architecture"] != "position-position"))
    nearest = np.abs(values - 1).argmin(axis=1)
    rows = np.flatnonzero(floats & (np.abs(values - 1).min(axis=1) < 1e-6))
    values[rows, nearest[rows]] = 0.0
    return np.abs(values).max(axis=1) ** (leader[2] / period_s)


def worst_growth(leader, follower, gains, there_s, back_s, *, hands, contacts, architecture, phases=None):
    """Return the fastest growth over hands, contacts and phases of the clocks, and where it is."""
    ratio = Fraction(follower[2] / leader[2]).limit_denominator(64)
    # Between two instants at which a message meets a sample every phase is alike: three within each are enough.
    turns = np.linspace(0.0, 1.0, 13)[:-1] / ratio.numerator if phases is None else phases
    found = (-1.0, None)
    for phase in turns:
        for hand in hands:
            how = {"hand": hand, "contacts": contacts, "architecture": architecture, "phase": float(phase)}
            values = growth(leader, follower, gains, there_s, back_s, **how)
            place = int(values.argmax())
            if values[place] > found[0]:
                found = float(values[place]), (phase, hand, float(np.atleast_1d(contacts[0])[place]))
    return found
