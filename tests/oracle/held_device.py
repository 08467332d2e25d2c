"""Logs of a mass with a damper, dry friction and a spring to ground under any law, in plain steps.

Each part of a tick is a step of the trapezoidal rule, exact to the second order: with Euler's the position would lead
the force by half a part, which is a negative delay.
"""

import math

import numpy as np

from avc_casadi.identification.log import Columns


def held_log(law, *, mass, damping, friction, spring=0.0, period=1e-3, ticks=4000, step=2e-5, delay=0,
             start=0.0, limit=8.0, parts=20, rotary=False, scatter=0.0, late=0.0, noise=0.0, given_by=None,
             outside=None):  # fmt: skip
    """Return the log of a law(tick, seen, speed) -> force; ticks scatter (s), or each is late (mean, s).
    An amplifier turns the force by `given_by(force)`; `outside(tick, position, velocity)` is not logged.
    """
    random = np.random.default_rng(0)
    time = np.arange(ticks) * period + scatter * random.uniform(-1.0, 1.0, ticks)
    if scatter:
        time = np.maximum.accumulate(time) + 1e-6 * np.arange(ticks) - time[0]
    time += np.cumsum(random.exponential(late, ticks)) if late else 0.0
    velocity, position, before = 0.0, start, start
    noisy = noise * random.standard_normal(ticks)
    waiting, rows = [0.0] * delay, []
    for tick in range(ticks):
        seen = round((position + noisy[tick]) / step) * step
        force = min(max(float(law(tick, seen, (seen - before) / period)), -limit), limit)
        before = seen
        rows.append((seen, force))
        waiting.append(given_by(force) if given_by else force)
        acts = waiting.pop(0)
        part = float(time[tick + 1] - time[tick] if tick + 1 < ticks else period) / parts
        drag = part * (damping + spring * part / 2) / (2 * mass)
        holds = part / mass / (1 + drag) * friction
        for _ in range(parts):
            push = acts - spring * position + (outside(tick, position, velocity) if outside else 0.0)
            free = (velocity * (1 - drag) + part * push / mass) / (1 + drag)
            after = 0.0 if abs(free) <= holds else free - math.copysign(holds, free)
            position += part * (velocity + after) / 2
            velocity = after
    seen, force = np.array(rows).T
    return Columns("held", time, seen, force, motion="rotary" if rotary else "linear")
