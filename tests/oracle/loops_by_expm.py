"""Loops of a device and a wall, an engine or a follower at n points of ranges, by scipy's matrix exponential alone."""

from types import SimpleNamespace

import numpy as np
from sampled_wall import mechanics
from scipy.linalg import expm

HAND = ("mass_kg", "damping_ns_per_m", "stiffness_n_per_m")
MODE = ("frequency_hz", "damping_ratio", "mass_ratio")
ABSENT = {"resonance": None, "amplifier_bandwidth_hz": None, "amplifier_order": 1, "encoder_at": "motor"}


class Body:
    """n devices of values by key, each with something linear at its handle; delays need not be whole."""

    def __init__(self, at, held, period_s):
        points = [dict(zip(at, row, strict=True)) for row in np.transpose([*at.values()])]
        for one in points:
            if "resonance.frequency_hz" in one:
                one["resonance"] = SimpleNamespace(**{key: one[f"resonance.{key}"] for key in MODE})
        found = [mechanics(SimpleNamespace(**ABSENT | one), row) for one, row in zip(points, held, strict=True)]
        n, size = len(found), len(found[0][1])
        a, late = np.zeros((n, size + 1, size + 1)), at["delay_samples"]
        a[:, :size, :size], a[:, :size, size] = [one[0] for one in found], [-one[1] for one in found]
        whole = np.floor(late).astype(int)
        before, after = (expm(a * (part * period_s)[:, None, None]) for part in (late - whole, 1 - late + whole))
        self.size, self.queue, self.move = size, int(whole.max()) + 1, (after @ before)[:, :size, :size]
        self.force = np.zeros((n, self.queue + 1, size))
        self.force[np.arange(n), whole + 1] = (after[:, :size, :size] @ before[:, :size, size:])[..., 0]
        self.force[np.arange(n), whole] += after[:, :size, size]


class Loop:
    """Maps of a state of named parts, for n points."""

    def __init__(self, n, **sizes):
        ends = np.cumsum([*sizes.values()])
        self.at = {key: slice(end - size, end) for (key, size), end in zip(sizes.items(), ends, strict=True)}
        self.one = np.eye(ends[-1])
        self.still = np.tile(self.one, (n, 1, 1))

    def seen(self, side, age, period_s):
        """Return rows of the position, and its backward difference, that a body measured some samples ago."""
        past = [self.one[self.at["body" + side].start], *self.one[self.at["seen" + side]]]
        return past[age], (past[age] - past[age + 1]) / period_s

    def sample(self, body, force, side=""):
        """Return the maps of a sample of a body under a force, a row of the state."""
        made, state = self.still.copy(), self.at["body" + side]
        made[:, state] = body.force[:, 0, :, None] * force
        made[:, state, state] += body.move
        made[:, state, self.at["queue" + side]] += body.force[:, 1:].transpose(0, 2, 1)
        for part, new in ((self.at["queue" + side], force), (self.at["seen" + side], self.one[state.start])):
            made[:, part] = np.roll(self.still[:, part], 1, axis=1)
            made[:, part.start] = new
        return made


def growth(at, gains, *, period_s=1e-3, **end):
    """Return the growth in a millisecond of n loops, without free translation; end: samples, integrator, late; ages."""
    hand = np.transpose([at[f"hand.{key}"] for key in HAND])
    body, samples, free = Body(at, hand, period_s), end.get("samples", 1), hand[:, 2] == 0
    if end:
        made = (_engine if "samples" in end else _follower)(body, at, *gains, period_s, **end)
        free &= at["contact.stiffness_n_per_m"] == 0
    else:
        loop = Loop(len(hand), body=body.size, queue=body.queue, seen=1)
        made = loop.sample(body, -np.dot(gains, loop.seen("", 0, period_s)))
    values = np.linalg.eigvals(made)
    values[free, np.abs(values - 1).argmin(axis=1)[free]] = 0
    return np.abs(values).max(axis=1) ** (1e-3 / (samples * period_s))


def _contact(at):
    rigid = np.isinf(at["contact.stiffness_n_per_m"])
    spring = np.where(rigid, 0.0, at["contact.stiffness_n_per_m"])
    return rigid, spring, at["contact.damping_ns_per_m"] * (spring > 0)


def _engine(body, at, k, b, t, samples, integrator, late):
    loop = Loop(len(body.move), body=body.size, queue=body.queue, seen=1, tool=2, out=2, older=2)
    rigid, spring, damper = (one[:, None] for one in _contact(at))
    (x, v), mass, drag, step = loop.seen("", 0, t), at["tool.mass_kg"][:, None], b + damper, samples * t
    place, speed = (~rigid * row for row in loop.one[loop.at["tool"]])
    push = k * (x - place) + b * v - spring * place
    if integrator.startswith("implicit"):
        solved = (k + spring) * (integrator == "implicit")
        after = (mass * speed + step * push) / (mass + step * drag + step**2 * solved)
    else:
        after = speed + step / mass * (push - drag * speed)
    after, made = ~rigid * after, loop.still.copy()
    made[:, loop.at["tool"]] = np.stack([place + step * (speed if integrator == "explicit" else after), after], axis=1)
    made[:, loop.at["older"]] = np.stack([place, speed], axis=1)
    made[:, loop.at["out"]] = made[:, loop.at["older"]] if not late else loop.still[:, loop.at["older"]]
    sample = loop.sample(body, -np.dot((k, b), np.stack([x, v]) - loop.one[loop.at["out"]]))
    return np.linalg.matrix_power(sample, samples) @ made


def _follower(body, at, k, b, t, ages):
    rigid, spring, damper = _contact(at)
    own = {key.removeprefix("follower."): value for key, value in at.items() if key.startswith("follower.")}
    far = Body(own, np.transpose([0 * spring, damper, spring]), t)
    far.move[rigid], far.force[rigid] = 0, 0
    parts = {"body": body.size, "queue": body.queue, "seen": ages[1] + 1}
    loop = Loop(len(spring), **parts, body1=far.size, queue1=far.queue, seen1=ages[0] + 1)

    def pull(here, there, age):
        return -np.dot((k, b), np.subtract(loop.seen(here, 0, t), loop.seen(there, age, t)))

    # Both forces are of the state before either moves.
    return loop.sample(body, pull("", "1", ages[0])) + loop.sample(far, pull("1", "", ages[1]), "1") - loop.still
