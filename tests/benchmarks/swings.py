"""Swings of loops drawn at random: share of causes named right, confident wrong answers, remedies that bring rest.

nice python tests/benchmarks/swings.py --count 100 --write

Each log is of a loop that rests in the simulator below, which shares no code with the project: mass 0.05 to 0.3 kg, 400
to 4 000 N/m, 0.5 to 2 ms, delay 0.2 to 2 samples, one- or two-sided, a hand. Then one thing is changed and it swings: 2
to 6 samples of delay, half or a third of the rate, k or b times 2 to 6, a hand that lets go, a relay with and without
dead band, a spring or damper of every 8th to 24th tick, k times 2 to 6 between travel stops, and noise through a damper
with which the loop rests without that noise. One kind is left as it is. A game has its own clock of 30 to 400 Hz, no
multiple of the log's, reads at its ticks and acts one late; half of them have a dead zone. What comes to rest has dry
friction and little damping, half with a dead zone: frequency and time of rest have to be told within 5 % and 20
samples. Friction is compensated by 1.2 to 1.8 times as much behind 2 to 8 ms. A motor is reversed, with no hand on the
device. A handle of 0.2 to 0.7 of the mass resonates at 40 to 250 Hz behind the motor, with the encoder on either side.
A force from outside of 0.2 to 3 N shakes the device at 8 to 60 Hz: *cannot tell* and *not the loop* are right. A remedy
that is told is made in the simulator; it has to leave less than a fifth of the swing, or two and a half encoder steps,
and less than half of the force that noise makes: with the hand of the log, and with no hand on the device, where it is
not told that the remedy rests while held.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from itertools import repeat
from pathlib import Path

import numpy as np
from studied import about, made_by

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent / "oracle")]

from avc_casadi._util.arrays import BoolArray, FloatArray  # noqa: E402 - the package of this tree
from avc_casadi.diagnose.causes import Diagnosis, diagnose  # noqa: E402
from avc_casadi.identification.log import Columns  # noqa: E402
from avc_casadi.model.device import Device  # noqa: E402

KINDS = (
    *("delay", "rate", "stiffness", "damping", "let-go", "relay", "dead band", "rates", "noise", "stops", "none"),
    *("game", "rest", "compensation", "reversed", "resonance", "shaken"),
)
TRUTH = {"game": "rate", "rest": "nothing wrong", "compensation": "relay", "reversed": "sign"} | {
    "dead band": "relay",
    "noise": "encoder",
    "stops": "stiffness",
    "none": "nothing wrong",
    "shaken": "cannot tell",
}
TICKS, PARTS = 1800, 10


@dataclass(frozen=True)
class Loop:
    """A loop in SI units; `hand` is mass, damping, stiffness, up to a tick; `stops` travel, stiffness, damping."""

    mass: float
    damping: float
    friction: float
    period: float
    delay: float
    step: float
    limit: float
    k: float
    b: float
    hand: tuple[float, float, float]
    one_sided: bool
    relay: float = 0.0
    band: float = 0.0
    width: float = 0.0
    slow: str = ""
    every: int = 1
    noise: float = 0.0
    keep: float = 0.0
    stops: tuple[float, float, float] = (math.inf, 0.0, 0.0)
    released: float = math.inf
    clock: float = 1.0
    phase: float = 0.0
    dead: float = 0.0
    compensated: float = 0.0
    filter_s: float = 0.0
    motor: float = 1.0
    resonance: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Frequency, Hz, damping ratio, and share of the mass that is a handle behind a spring; no mass none."""
    encoder_at_handle: bool = False
    notch_hz: float = 0.0
    """Centre of a filter of the command, Hz, by Tustin's rule; 0 none."""
    shake: tuple[float, float] = (0.0, 0.0)
    """Frequency, Hz, and size, N, of a force from outside, which is not in the log."""


@dataclass(frozen=True, eq=False)
class Handle:
    """The handles of n loops, each a mass behind spring and damper, shape (n,); a rigid one has a mass of 1 kg."""

    flexible: BoolArray
    mass: FloatArray
    stiffness: FloatArray
    damping: FloatArray

    @classmethod
    def of(cls, values: Mapping[str, FloatArray], mass: FloatArray) -> Handle:
        """Return the handles of loops; motor and handle swing freely against each other at the resonance."""
        hertz, ratio, share = values["resonance"].T
        reduced = share * (1 - share) * mass
        rate = 2 * math.pi * hertz
        flexible = share > 0
        handle_mass = np.where(flexible, share * mass, 1.0)
        return cls(flexible, handle_mass, reduced * rate**2, 2 * ratio * reduced * rate)


class Notch:
    """N(z)/D(z) of (s^2 + 0.1 w s + w^2)/(s^2 + w s + w^2), with s = w/tan(w T/2) (z - 1)/(z + 1), on n commands."""

    def __init__(self, hertz: FloatArray, period: FloatArray) -> None:
        on = hertz > 0
        turn = np.tan(np.where(on, math.pi * hertz * period, 0.1))
        least, most = 0.1 * turn, 1.0 * turn
        middle = 2 * (turn**2 - 1)
        self._above = [np.where(on, part, 1.0) for part in (1 + least + turn**2, middle, 1 - least + turn**2)]
        self._below = [np.where(on, part, 1.0) for part in (1 + most + turn**2, middle, 1 - most + turn**2)]
        self._on = on
        self._before = np.zeros((4, len(hertz)))

    def passed(self, command: FloatArray) -> FloatArray:
        """Return the next value of each command behind its notch."""
        if not self._on.any():
            return command
        b0, b1, b2 = self._above
        a0, a1, a2 = self._below
        in1, in2, out1, out2 = self._before
        out = np.where(self._on, (b0 * command + b1 * in1 + b2 * in2 - a1 * out1 - a2 * out2) / a0, command)
        self._before = np.array([command, in1, out, out1])
        return out


def played(loops: Sequence[Loop], seed: int = 0) -> tuple[FloatArray, FloatArray]:
    """Return measured position and commanded force along +position of some loops, in small steps of Newton's law."""
    one = {key: np.array([getattr(loop, key) for loop in loops]) for key in Loop.__dataclass_fields__}
    mass, damping, friction, period, step, limit, k, b, width, keep, every = (
        one[key]
        for key in ("mass", "damping", "friction", "period", "step", "limit", "k", "b", "width", "keep", "every")
    )
    travel, stop_k, stop_b = one["stops"].T
    clock, dead, filter_s, motor = (one[key] for key in ("clock", "dead", "filter_s", "motor"))
    behind = np.where(filter_s > 0, np.exp(-period / np.maximum(filter_s, 1e-9)), 0.0)
    sided, spring_slow, damper_slow = one["one_sided"], one["slow"] == "spring", one["slow"] == "damper"
    shake_hz, shake_n = one["shake"].T
    handle, notch = Handle.of(one, mass), Notch(one["notch_hz"], period)
    flexes, parts = bool(handle.flexible.any()), np.arange(PARTS)[:, None]
    h, late, rows = period / PARTS, np.round(one["delay"] * PARTS).astype(int), np.arange(len(loops))
    noise = one["noise"] * np.random.default_rng(seed).standard_normal((TICKS, len(loops)))
    x, v = np.where(sided, -0.002, 0.004), np.zeros(len(loops))
    y, w = x.copy(), v.copy()
    seen, force = np.zeros((TICKS, len(loops))), np.zeros((TICKS, len(loops)))
    rate, slow_at, slow_rate, before = np.zeros((4, len(loops)))
    due, told, waiting, quick, frame_at = one["phase"].copy(), *np.zeros((4, len(loops)))
    for tick in range(TICKS):
        at = step * np.floor((np.where(one["encoder_at_handle"], y, x) + noise[tick]) / step + 0.5)
        rate = keep * rate + (1 - keep) * ((at - before) if tick else 0.0) / period
        quick = behind * quick + (1 - behind) * ((at - before) if tick else 0.0) / period
        frame, own = tick >= due - 1e-9, clock != 1
        rate = np.where(own & frame, (at - frame_at) / (clock * period) if tick else 0.0, rate)
        frame_at, due = np.where(frame, at, frame_at), np.where(frame, due + clock, due)
        new = tick % every == 0
        slow_rate = np.where(new, (at - slow_at) / (every * period) if tick else 0.0, slow_rate)
        slow_at, before = np.where(new, at, slow_at), at
        place = np.where(spring_slow, slow_at, at)
        asked = k * (place - np.clip(place, -dead, dead)) + b * np.where(damper_slow, slow_rate, rate)
        beyond = np.maximum(np.abs(at) - one["band"], 0.0)
        ramp = np.where(width > 0, np.minimum(beyond / np.maximum(width, 1e-12), 1.0), beyond > 0)
        asked = asked + one["relay"] * np.sign(at) * ramp
        asked = np.where(sided, np.where(at > 0, np.maximum(asked, 0.0), 0.0), asked)
        asked = notch.passed(asked - one["compensated"] * np.tanh(quick / 0.01))
        asked = np.clip(asked, -limit, limit)
        told = np.where(own, np.where(frame, waiting, told), asked)
        waiting = np.where(frame, asked, waiting)
        seen[tick], force[tick] = at, told
        target = np.where(sided, np.minimum(0.06 * tick * period - 0.002, 0.006), 0.002 * (one["released"] < TICKS))
        hand_mass, hand_damping, hand_spring = one["hand"].T * (tick < one["released"])
        moved = np.where(handle.flexible, mass - handle.mass, mass + hand_mass)
        shaken = shake_n * np.sin(2 * math.pi * shake_hz * (tick + parts / PARTS) * period)
        for part in range(PARTS):
            past = tick * PARTS + part - late
            push = -motor * np.where(past >= 0, force[np.maximum(past, 0) // PARTS, rows], 0.0) - damping * v
            by_hand = hand_spring * (target - y) - hand_damping * w + shaken[part]
            link = handle.stiffness * (y - x) + handle.damping * (w - v) if flexes else 0.0
            push += np.where(handle.flexible, link, by_hand) if flexes else by_hand
            push -= (np.abs(x) > travel) * (stop_k * (x - np.clip(x, -travel, travel)) + stop_b * v)
            v = v + h * push / moved
            rub = h * friction / moved
            v = np.where(np.abs(v) <= rub, 0.0, v - np.sign(v) * rub)
            x = np.clip(x + h * v, -1.0, 1.0)
            w = np.where(handle.flexible, w + h * (by_hand - link) / (handle.mass + hand_mass), v) if flexes else v
            y = np.where(handle.flexible, np.clip(y + h * w, -1.0, 1.0), x) if flexes else x
    return seen, -force


def sizes(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return what each loop swings by in the second and in the last third."""
    middle, late = (np.ptp(part, axis=0) for part in np.array_split(values, 3)[1:])
    return middle, late


def between(random: np.random.Generator, low: float, high: float) -> float:
    """Draw log-uniformly."""
    return float(np.exp(random.uniform(math.log(low), math.log(high))))


def healthy(random: np.random.Generator) -> Loop:
    """Draw a loop."""
    return Loop(
        mass=between(random, 0.05, 0.3),
        damping=between(random, 0.3, 2.0),
        friction=float(random.uniform(0.0, 0.04)) if random.random() < 0.4 else 0.0,
        period=float(random.choice([5e-4, 1e-3, 2e-3])),
        delay=float(random.uniform(0.2, 2.0)),
        step=between(random, 1e-6, 1e-5),
        limit=float(random.choice([8.0, 20.0, 40.0])),
        k=between(random, 400.0, 4000.0),
        b=between(random, 1.0, 20.0),
        hand=(float(random.uniform(0.05, 0.3)), float(random.uniform(3, 15)), float(random.uniform(200, 800))),
        one_sided=bool(random.random() < 0.5),
    )


def changed(random: np.random.Generator, loop: Loop, kind: str) -> Loop:
    """Change one thing."""
    more = between(random, 2.0, 6.0)
    size_n = float(random.uniform(0.5, 3.0))
    every = int(random.integers(8, 25))
    hertz = float(random.choice([60.0, 72.0, 90.0, 144.0, between(random, 30.0, 400.0)]))
    own = 1 / (hertz * loop.period)
    filter_s = between(random, 2e-3, 8e-3)
    return {
        "delay": lambda: replace(loop, delay=loop.delay + more),
        "rate": lambda: replace(loop, period=loop.period * int(random.integers(2, 4))),
        "stiffness": lambda: replace(loop, k=more * loop.k),
        "damping": lambda: replace(loop, b=more * loop.b),
        "let-go": lambda: replace(loop, released=TICKS / 4, one_sided=False),
        "relay": lambda: replace(loop, relay=size_n, one_sided=False),
        "dead band": lambda: replace(loop, relay=size_n, band=between(random, 5e-5, 8e-4), one_sided=False),
        "rates": lambda: replace(loop, slow=str(random.choice(["spring", "damper"])), every=every, one_sided=False),
        "noise": lambda: replace(loop, noise=loop.step * between(random, 0.7, 3.0), b=more * loop.b),
        "stops": lambda: replace(loop, k=more * loop.k, stops=(between(random, 3e-3, 8e-3), 3e4, 30.0)),
        "none": lambda: loop,
        "game": lambda: replace(loop, clock=own, phase=own * float(random.random()), one_sided=False),
        "rest": lambda: loop,
        "compensation": lambda: replace(loop, compensated=loop.friction * (0.8 + more / 6), filter_s=filter_s),
        "reversed": lambda: replace(loop, motor=-1.0, one_sided=False),
        "resonance": lambda: resonating(random, loop),
        "shaken": lambda: replace(loop, shake=(between(random, 8.0, 60.0), between(random, 0.2, 3.0))),
    }[kind]()


def resonating(random: np.random.Generator, loop: Loop) -> Loop:
    """Return a loop with a handle that resonates, and with the encoder on either side of its spring."""
    mode = (between(random, 40.0, 250.0), between(random, 0.005, 0.08), float(random.uniform(0.2, 0.7)))
    return replace(loop, resonance=mode, encoder_at_handle=bool(random.random() < 0.5))


def prepared(random: np.random.Generator, loop: Loop, kind: str) -> Loop:
    """Return a loop as a kind needs it: two-sided, with a dead zone, or with dry friction."""
    two_sided = {"let-go", "relay", "dead band", "rates", "game", "rest", "compensation", "reversed"}
    loop = replace(loop, one_sided=loop.one_sided and kind not in two_sided)
    dead = float(random.uniform(1e-4, 1e-3)) if random.random() < 0.5 else 0.0
    if kind == "rest":
        friction = loop.k * 0.004 / (2 * random.uniform(3, 15))
        return replace(loop, b=0.0, hand=(0.0, 0.0, 0.0), friction=float(friction), dead=dead, limit=40.0)
    if kind == "compensation":
        gains = {"k": between(random, 400.0, 1500.0), "b": between(random, 4.0, 12.0), "delay": 0.5 * loop.delay}
        return replace(loop, friction=float(random.uniform(0.2, 0.8)), hand=(0.0, 0.0, 0.0), **gains)
    if kind == "reversed":
        return replace(loop, hand=(0.0, 0.0, 0.0))
    return replace(loop, dead=dead) if kind == "game" else loop


def resting(loop: Loop, wrong: Loop, kind: str) -> Loop:
    """Return the loop that has to rest: as meant, what is compensated without friction, what is noisy without noise."""
    if kind == "compensation":
        return replace(loop, friction=0.0)
    return replace(wrong, noise=0.0) if kind == "noise" else loop


def case(kind: str, seed: int, number: int) -> tuple[Loop, Loop, Columns]:
    """Draw until a loop rests and the changed one swings; returns both, and the log."""
    random = np.random.default_rng([seed, number])
    while True:
        loops = [healthy(random) for _ in range(24)]
        loops = [prepared(random, loop, kind) for loop in loops]
        wrongs = [changed(random, loop, kind) for loop in loops]
        meant = [resting(loop, wrong, kind) for loop, wrong in zip(loops, wrongs, strict=True)]
        seen, force = played([*meant, *wrongs])
        (_, rest), (middle, late), (_, ripple) = sizes(seen[:, :24]), sizes(seen[:, 24:]), sizes(force[:, 24:])
        for i, (loop, wrong) in enumerate(zip(loops, wrongs, strict=True)):
            swings = 8 * loop.step < late[i] < 0.5 and late[i] > 0.8 * middle[i]
            if kind == "stops":
                swings = swings and np.abs(seen[:, 24 + i]).max() > 1.02 * wrong.stops[0]
            if kind == "noise":
                swings = bool(ripple[i] > max(0.4, 0.02 * loop.limit))
            if kind == "rest":
                swings = rested(seen[:, 24 + i], wrong)[0] > 3
            if kind == "reversed":
                swings = True
            if rest[i] < 1.5 * loop.step and (swings or kind == "none"):
                time_s = np.arange(TICKS) * wrong.period
                return loop, wrong, Columns(f"{kind}-{number}", time_s, seen[:, 24 + i], force[:, 24 + i])


def rested(position: FloatArray, loop: Loop) -> tuple[float, float, float]:
    """Return the half swings about the rest, their mean frequency, Hz, and the time from which it stands still, s."""
    away = position - position[-1]
    turns = np.flatnonzero(np.diff(np.sign(np.diff(away[np.append(True, np.diff(away) != 0)]))))
    moves = np.flatnonzero(np.abs(away) > 1.5 * loop.step)
    moving = np.flatnonzero(np.append(True, np.diff(away) != 0))
    ticks = moving[turns + 1] if turns.size > 1 else np.array([0, 1])
    hertz = (ticks.size - 1) / 2 / max(float(ticks[-1] - ticks[0]), 1.0) / loop.period
    return float(turns.size), hertz, loop.period * float(moves[-1] + 1 if moves.size else 0)


def rest_is_told(found: Diagnosis, log: Columns, loop: Loop) -> bool:
    """Return whether a diagnosis tells the frequency and the time of rest."""
    _, hertz, rest_s = rested(log.position_m, loop)
    told_s = found.swing.rest_from_s(found.log)
    if told_s is None:
        return False
    return abs(told_s - rest_s) < 20 * loop.period and abs(found.swing.frequency_hz / hertz - 1) < 0.05


def declared(loop: Loop, wrong: Loop) -> Device:
    """Return the file of the device: what was meant."""
    return Device.model_validate(
        {
            "mass_kg": loop.mass,
            "damping_ns_per_m": loop.damping,
            "coulomb_friction_n": loop.friction,
            "sample_time_s": loop.period,
            "delay_samples": round(loop.delay, 3),
            "encoder_resolution_m": loop.step,
            "position_noise_rms_m": wrong.noise,
            "max_force_n": loop.limit,
        }
    )


def mended(wrong: Loop, key: str, value: float) -> Loop:
    """Return a loop with a remedy."""
    frames = replace(wrong, every=1, slow="")
    period = frames if wrong.slow else replace(wrong, period=value)
    period = replace(wrong, clock=value / wrong.period) if wrong.clock != 1 else period
    return {
        "delay_samples": lambda: replace(wrong, delay=value),
        "sample_time_s": lambda: period,
        "stiffness_n_per_m": lambda: replace(wrong, k=value),
        "damping_ns_per_m": lambda: replace(wrong, b=value),
        "notch_hz": lambda: replace(wrong, notch_hz=value),
        "velocity_filter_hz": lambda: replace(wrong, keep=math.exp(-2 * math.pi * value * wrong.period)),
        "encoder_resolution_m": lambda: replace(wrong, step=value),
        "switch_width": lambda: replace(wrong, width=value),
        "switched_n": lambda: replace(wrong, compensated=value),
        "force_sign": lambda: replace(wrong, motor=1.0),
    }[key]()


def settled(found: Diagnosis, wrong: Loop, kind: str) -> list[tuple[str, bool, bool]]:
    """Return each remedy that was told, whether it brings rest, and whether it does released too, or says so."""
    which = 1 if kind == "noise" else 0
    ratio = found.design.device.sample_time_s / wrong.period  # delays are counted by the samples of the file
    values = [one.value * (ratio if one.key == "delay_samples" else 1.0) for one in found.remedies]
    held = [mended(wrong, one.key, each) for one, each in zip(found.remedies, values, strict=True)]
    free = [replace(one, hand=(0.0, 0.0, 0.0), one_sided=False, released=math.inf) for one in held]
    now, *left = sizes(played([wrong, *held, *free])[which])[1].tolist()
    least = 0.45 * now if kind == "noise" else max(0.2 * now, 2.5 * wrong.step)
    both = zip(found.remedies, left[: len(held)], left[len(held) :], strict=True)
    return [(one.key, with_hand < least, one.while_held or alone < least) for one, with_hand, alone in both]


def page(
    rows: Sequence[tuple[str, str]],
    cures: Sequence[tuple[str, bool, bool]],
    covered: Sequence[bool],
    seed: int,
    count: int,
) -> str:
    """Return the results as text."""
    counts, rest, swing = Counter(rows), sum(held for _, held, _ in cures), sum(not free for *_, free in cures)
    outcomes = ("right", "cannot tell", "wrong")
    lines = [f"| {kind} | {' | '.join(str(counts[kind, one]) for one in outcomes)} |" for kind in KINDS]
    total = [sum(counts[kind, one] for kind in KINDS) for one in outcomes]
    made = made_by(about(f"python tests/benchmarks/swings.py --count {count} --seed {seed} --write", seed))
    parts = [
        "# Swings of loops drawn at random",
        f"{made} {len(rows)} logs.",
        " ".join((__doc__ or "").split("\n\n")[2].split()),
        "\n".join(["| what is wrong | right | cannot tell | confident and wrong |", "|---|--:|--:|--:|", *lines])
        + f"\n| all | {' | '.join(map(str, total))} |",
        f"{rest} of {len(cures)} remedies bring rest; {swing} swing when let go and do not say so.",
        f"{sum(covered)} of {len(covered)} intervals of a named resonance contain its frequency.",
    ]
    return "\n\n".join(parts) + "\n"


@dataclass(frozen=True)
class Judged:
    """What a diagnosis said of a log: whether that is right, its remedies, and lines to print."""

    kind: str
    outcome: str
    cures: list[tuple[str, bool, bool]]
    lines: tuple[str, ...]
    covers: bool | None
    """Whether the interval of a named resonance contains its frequency; None of another answer."""


def judged(kind: str, seed: int, number: int) -> Judged:
    """Draw a log, diagnose it, and make its remedies in the simulator."""
    loop, wrong, log = case(kind, seed, number)
    begun = time.process_time()
    found = diagnose(log, device=declared(loop, wrong))
    spent = time.process_time() - begun
    answer = found.cause or found.verdict
    rights = {TRUTH.get(kind, kind)} | ({"not the loop"} if kind == "shaken" else set())
    outcome = "right" if answer in rights else answer if answer == "cannot tell" else "wrong"
    if kind == "rest" and outcome == "right" and not rest_is_told(found, log, wrong):
        outcome = "wrong"
    cures = settled(found, wrong, kind)
    lines = (f"{number}: {kind} -> {answer} ({spent:.1f} s) {cures}",)
    if outcome != "right" or not all(held and free for _, held, free in cures):
        lines += (f"    {found.conclusion}; {wrong}",)
    covers = None
    if kind == answer == "resonance" and found.fit is not None and found.fit.resonance_hz is not None:
        low_hz, high_hz = found.fit.resonance_hz
        covers = low_hz <= wrong.resonance[0] <= high_hz
        lines += (f"    {wrong.resonance[0]:.1f} Hz is within {low_hz:.1f} to {high_hz:.1f} Hz: {covers}",)
    return Judged(kind, outcome, cures, lines, covers)


def main() -> None:
    """Run the study; the page is written after each log."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=11, help="logs")
    parser.add_argument("--seed", type=int, default=612)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS, help="what is wrong, in turn")
    parser.add_argument("--workers", type=int, default=1, help="processes")
    parser.add_argument("--write", action="store_true", help="make RESULTS_swings.md; overwrites it")
    args = parser.parse_args()
    rows: list[tuple[str, str]] = []
    cures: list[tuple[str, bool, bool]] = []
    covered: list[bool] = []
    kinds = [args.kinds[number % len(args.kinds)] for number in range(args.count)]
    with ProcessPoolExecutor(args.workers) as pool:
        for found in pool.map(judged, kinds, repeat(args.seed), range(args.count)):
            rows.append((found.kind, found.outcome))
            cures += found.cures
            covered += [] if found.covers is None else [found.covers]
            print(*found.lines, sep="\n", flush=True)
            if args.write:
                (HERE / "RESULTS_swings.md").write_text(
                    page(rows, cures, covered, args.seed, args.count), encoding="utf-8"
                )


if __name__ == "__main__":
    main()
