"""Logs of a mass with a damper, dry friction and a spring to ground under any law, in plain steps."""

import numpy as np

from avc_casadi.identification.record import Columns


def held_log(law, *, mass, damping, friction, spring=0.0, period=1e-3, ticks=4000, step=2e-5, delay=0, start=0.0,
             limit=8.0, parts=20, rotary=False, scatter=0.0, seed=0):  # fmt: skip
    """Return the log of a law(tick, seen, speed) -> force, its ticks even or scattered about even ones (seconds)."""
    random = np.random.default_rng(seed)
    time = np.arange(ticks) * period + scatter * random.uniform(-1.0, 1.0, ticks)
    time = np.maximum.accumulate(time + 1e-6 * np.arange(ticks)) - time[0]
    velocity, position, before = 0.0, start, start
    late, rows = [0.0] * delay, []
    for tick in range(ticks):
        seen = round(position / step) * step
        force = float(np.clip(law(tick, seen, (seen - before) / period), -limit, limit))
        before = seen
        rows.append((seen, force))
        late.append(force)
        acts = late.pop(0)
        part = (time[tick + 1] - time[tick] if tick + 1 < ticks else period) / parts
        for _ in range(parts):
            free = velocity + part * (acts - damping * velocity - spring * position) / mass
            holds = friction * part / mass
            velocity = 0.0 if abs(free) <= holds else free - np.sign(free) * holds
            position += part * velocity
    seen, force = np.array(rows).T
    return Columns("held", time, seen, force, motion="rotary" if rotary else "linear")
