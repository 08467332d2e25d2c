"""Logs that buzz for one known reason: a loop that rests, drawn at random, with one thing of it changed."""

import itertools
from dataclasses import dataclass, replace

import numpy as np
from buzzing_device import Buzzing, logged, played

from avc_casadi.identification.log import Columns
from avc_casadi.model.device import Device
from avc_casadi.model.problem import Hands
from avc_casadi.simulation.judge import QUIET, felt_vibration

CAUSES = ("delay", "damping", "encoder", "resonance", "stiffness", "let-go", "ticks", "rate")
_SECONDS = 1.6
_TRIES = 4000


@dataclass(frozen=True)
class Case:
    """A log, what was declared of its device, and what is wrong with it."""

    cause: str
    columns: Columns
    declared: Device
    loop: Buzzing


def log_between(random, low, high):
    return float(np.exp(random.uniform(np.log(low), np.log(high))))


def healthy_loop(random):
    """Draw a device, a hand and a wall."""
    return Buzzing(
        mass=log_between(random, 0.03, 0.3),
        damping=log_between(random, 0.3, 3.0),
        friction=float(random.uniform(0.0, 0.05)) if random.random() < 0.3 else 0.0,
        delay=float(random.uniform(0.0, 2.0)),
        encoder=log_between(random, 1e-6, 3e-5),
        period=float(random.choice([5e-4, 1e-3, 1e-3])),
        limit=float(random.choice([8.0, 20.0, 50.0])),
        stiffness=log_between(random, 300.0, 8000.0),
        damper=log_between(random, 1.0, 40.0),
        keep=float(random.uniform(0.2, 0.7)) if random.random() < 0.25 else 0.0,
        two_sided=float(random.random() < 0.3),
        hand_mass=float(random.uniform(0.05, 0.3)),
        hand_damping=float(random.uniform(3.0, 20.0)),
        hand_stiffness=float(random.uniform(200.0, 800.0)),
        end=float(random.uniform(0.003, 0.012)),
    )


def _later(random, loop):
    more = float(random.uniform(1.0, 6.0))
    lag = min(int(random.integers(0, 3)), int(more))
    return {"delay": loop.delay + more - lag, "lag": float(lag)}


def _resonant(random, _):
    return {
        "resonance": log_between(random, 60.0, 250.0),
        "ratio": log_between(random, 0.01, 0.05),
        "share": float(random.uniform(0.2, 0.6)),
    }


_CHANGES = {
    "delay": _later,
    "damping": lambda random, loop: {"damper": loop.damper * log_between(random, 1.5, 6.0)},
    "stiffness": lambda random, loop: {"stiffness": loop.stiffness * log_between(random, 1.5, 8.0)},
    "encoder": lambda random, loop: {"encoder": max(4 * loop.encoder, log_between(random, 2e-5, 1e-4))},
    "resonance": _resonant,
    "let-go": lambda random, _: {
        "release": float(random.uniform(0.4, 0.8)),
        "weight": float(random.uniform(0.3, 1.5)),
    },
    "ticks": lambda _, __: {},
    "rate": lambda random, loop: {"period": loop.period * int(random.integers(2, 4))},
}


def changed_loop(random, loop, cause):
    """Change one thing; returns the loop, and the ticks that are missed, or None."""
    wrong = replace(loop, **_CHANGES[cause](random, loop))
    if cause != "ticks":
        return wrong, None
    samples = round(_SECONDS / loop.period)
    return wrong, (random.random(samples) < random.uniform(0.2, 0.7)).astype(float)


def healthy_case(seed, index):
    """A loop with nothing wrong with it: it rests at the end, or toggles by one step that no hand of the box feels."""
    random = np.random.default_rng([seed, index, len(CAUSES)])
    while True:
        loop = healthy_loop(random)
        time, position, force = logged(loop, _SECONDS)
        if rests(position, loop.period, loop.encoder) and unfelt(loop, position):
            columns = Columns(f"nothing-{index}", time, position, force)
            return Case("nothing wrong", columns, declared_of(loop), loop)


def swings(time, position, step, cause):
    """Whether every tenth of the last 0.6 s moves by steps, those at the end as much as those before."""
    ends = time[-1] - np.arange(7)[::-1] * 0.1
    parts = [position[(time >= low) & (time <= high)] for low, high in itertools.pairwise(ends)]
    moves = np.array([np.ptp(part) / step for part in parts])
    turns = min(np.count_nonzero(np.diff(part)) for part in parts)
    return moves.min() > (1.5 if cause == "encoder" else 5.0) and turns > 3 and moves[3:].max() > 0.85 * moves[:3].max()


def rests(position, period, step):
    return np.ptp(position[-round(0.3 / period) :]) < 1.5 * step


def unfelt(loop, position):
    """Whether a loop stands still, or no hand of the usual box feels how it moves, the one that holds it among them."""
    if not np.ptp(position[-round(0.3 / loop.period) :]):
        return True
    box = Hands()
    hands = [(loop.hand_mass, loop.hand_damping, loop.hand_stiffness)]
    hands += itertools.product(box.mass_kg, box.damping_ns_per_m, box.stiffness_n_per_m)
    loops = [replace(loop, hand_mass=m, hand_damping=b, hand_stiffness=k) for m, b, k in hands]
    return all(felt_vibration(played(each, _SECONDS)[3], each.period) < QUIET for each in loops)


def declared_of(loop):
    """What the file of the device says: the healthy loop."""
    numbers = {
        "mass_kg": loop.mass,
        "damping_ns_per_m": loop.damping,
        "sample_time_s": loop.period,
        "delay_samples": round(loop.delay, 3),
        "coulomb_friction_n": loop.friction,
        "encoder_resolution_m": loop.encoder,
        "max_force_n": loop.limit,
    }
    return Device.model_validate(numbers)


def case_of(cause, seed, index):
    """Draw until a healthy loop rests and the changed one swings."""
    random = np.random.default_rng([seed, index, CAUSES.index(cause)])
    for _ in range(_TRIES):
        loop = healthy_loop(random)
        if cause in {"resonance", "encoder"}:
            loop = replace(loop, friction=0.0)
        _, position, _ = logged(loop, _SECONDS)
        if not rests(position, loop.period, loop.encoder):
            continue
        wrong, missed = changed_loop(random, loop, cause)
        time, position, force = logged(wrong, _SECONDS, missed)
        if np.abs(position).max() > 0.5 or not swings(time, position, wrong.encoder, cause):
            continue
        if cause == "encoder":
            # The finer encoder rests; the coarser one alone is what is wrong.
            loop = replace(loop, encoder=wrong.encoder)
        elif random.random() < 0.5:
            wrong = replace(wrong, sway=float(random.uniform(0.0, 1e-3)))
            time, position, force = logged(wrong, _SECONDS, missed)
        columns = Columns(f"{cause}-{index}", time, position, force)
        return Case(cause, columns, declared_of(loop), wrong)
    raise AssertionError(f"no case of {cause} at {index}")
