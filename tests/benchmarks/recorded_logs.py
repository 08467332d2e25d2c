"""Logs of kinds that people record: what is told right, what is left open, what is wrong, and where advice leads.

nice -n 10 python tests/benchmarks/recorded_logs.py --count 200 --write

Logs are drawn afresh and made by `tests/held_device.py`, plain steps that share no code with the project. `avc
identify` gets a servo with a load on a spring that is moved below its resonance, a load that hangs, a device that is
nearly all friction, a host's clock of 100 to 400 Hz that scatters by 2 to 4 ms or is late after each tick, and a
current in steps; beside each stands the file of a base device whose mass, damping, friction are others (log-normal, a
factor of two). `avc diagnose` gets loops that swing for a force that a sign switches (a relay wall, on and off, a
minimum force, dry friction rendered, or compensated too much) and for two rates (a spring of every frame beside a
damper of every tick, or the reverse). A number is *right* where its 95 % interval holds the truth, *wrong* where the
truth lies beyond twice the interval; a log is wrong where one of its numbers is or a base device's value stands in
the file as if found. Advice (a remedy that is told, the log that would decide, --flip-force) is judged by simulating
it on the loop that made the log: it makes worse what then swings by a tenth more. The two loops swing for one reason:
without what is switched, or at one rate, they rest. With --write it overwrites results/recorded_logs.json and
RESULTS_recorded_logs.md after every log and goes on where it stopped.
"""

from __future__ import annotations

import argparse
import math
import resource
import sys
from collections import Counter
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from studied import about, kept_rows, made_by, write_rows

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent), str(HERE.parent.parent / "hardware")]

from held_device import held_log  # noqa: E402 - found beside the tests

from avc_casadi import AvcError  # noqa: E402
from avc_casadi.files.device_file import DeviceFile  # noqa: E402
from avc_casadi.identification.device import SEARCHED  # noqa: E402
from avc_casadi.identification.diagnosis.diagnose import diagnose  # noqa: E402
from avc_casadi.identification.identify import identify  # noqa: E402
from avc_casadi.identification.record import records_of  # noqa: E402
from avc_casadi.model.device import Device  # noqa: E402

OUT = HERE / "results" / "recorded_logs.json"
PAGE = HERE / "RESULTS_recorded_logs.md"
SEED = 606
RIGHT, OPEN, WRONG = "right", "cannot tell", "wrong"
WORSE, RESTS = 1.1, 3.0
Law = Callable[[int, float, float], float]
Drawn = dict[str, Any]


def between(random: np.random.Generator, low: float, high: float) -> float:
    """Draw evenly in the logarithm."""
    return float(np.exp(random.uniform(np.log(low), np.log(high))))


def sines(
    random: np.random.Generator, rms: float, low_hz: float, high_hz: float, period: float
) -> Callable[[int], float]:
    """Draw fifteen sines of equal size."""
    turns = 2 * np.pi * period * np.sort(random.uniform(low_hz, high_hz, 15))
    phase = random.uniform(0, 2 * np.pi, 15)
    size = rms * math.sqrt(2 / 15)
    return lambda tick: float(size * np.sin(turns * tick + phase).sum())


def sensor(random: np.random.Generator, step: float) -> Drawn:
    """Draw an encoder, every other one with noise of up to a step."""
    return {
        "step": step,
        "noise": step * between(random, 0.1, 1) * int(random.integers(0, 2)),
        "seed": int(random.integers(1 << 30)),
    }


# --- devices to identify: what held_log takes, the law among it


def on_a_spring(random: np.random.Generator) -> Drawn:
    """A servo with a load on a spring, moved below its resonance."""
    mass, turns, travel = between(random, 0.02, 0.5), 2 * np.pi * between(random, 4, 20), between(random, 5e-4, 5e-3)
    spring = mass * turns**2
    push = sines(random, spring * travel, 0.2, random.uniform(0.1, 0.8) * turns / 2 / np.pi, 1e-3)
    return {
        "law": lambda tick, *_: push(tick),
        "mass": mass,
        "damping": 2 * between(random, 0.05, 0.6) * mass * turns,
        "friction": random.uniform(0, 0.15) * spring * travel,
        "spring": spring,
        **sensor(random, travel / between(random, 30, 500)),
        "ticks": 6000,
    }


def hanging(random: np.random.Generator) -> Drawn:
    """A load that hangs, on a spring or held by a weak controller that knows its weight about."""
    drawn = on_a_spring(random)
    weight = -9.81 * drawn["mass"]
    if random.random() < 0.5:
        return drawn | {"load": weight, "start": weight / drawn["spring"]}
    push, k, damper = drawn["law"], drawn["spring"], 0.3 * math.sqrt(drawn["spring"] * drawn["mass"])
    lift = random.uniform(0.8, 1.2) * -weight
    return drawn | {
        "law": lambda tick, z, u: lift + push(tick, z, u) - k * z - damper * u,
        "spring": 0.0,
        "load": weight,
        "damping": between(random, 0.05, 0.5) * damper,
        "delay": int(random.integers(0, 3)),
    }


def in_friction(random: np.random.Generator) -> Drawn:
    """A device whose force is friction, nearly all of it, on a path."""
    period = between(random, 1e-3, 2.5e-3)
    top_hz, travel, friction = between(random, 0.8, 3), between(random, 0.005, 0.03), between(random, 0.2, 2)
    speed = 2 * np.pi * top_hz * travel / 2
    mass = between(random, 1e-3, 0.15) * friction / (speed * 2 * np.pi * top_hz)
    path = sines(random, travel / 2, 0.1, top_hz, period)
    k = between(random, 4, 15) * friction / travel
    b = min(0.05 * k, 0.2 * mass / period)
    return {
        "law": lambda tick, z, u: k * (path(tick) - z) - b * u,
        "mass": mass,
        "damping": random.uniform(0.05, 0.5) * friction / speed,
        "friction": friction,
        "period": period,
        **sensor(random, travel / between(random, 200, 1000)),
        "stribeck": (
            between(random, 0.05, 0.5) * friction * int(random.integers(0, 2)),
            between(random, 0.03, 0.2) * speed,
        ),
        "ticks": round(10 / period),
        "limit": 100.0,
        "parts": 40,
    }


def hosted(random: np.random.Generator) -> Drawn:
    """A device at a host's clock of 100 to 400 Hz."""
    period, late = between(random, 2.5e-3, 1e-2), random.uniform(1e-3, 4e-3)
    mass, travel = between(random, 0.05, 0.5), between(random, 0.01, 0.05)
    top_hz = min(8.0, 0.05 / period)
    accelerates = travel * (2 * np.pi * top_hz / 3) ** 2
    push = sines(random, mass * accelerates, 0.2, top_hz, period)
    k = mass * (2 * np.pi * 0.5) ** 2
    return {
        "law": lambda tick, z, _: push(tick) - k * z,
        "mass": mass,
        "damping": random.uniform(0.02, 0.3) * mass * accelerates / (travel * 2 * np.pi),
        "friction": random.uniform(0, 0.3) * mass * accelerates,
        "period": period,
        **sensor(random, travel / between(random, 200, 2000)),
        "ticks": round(12 / period),
        "delay": int(random.integers(0, 2)),
        "limit": 100.0,
        "parts": 40,
        **[{"scatter": min(late, 0.9 * period)}, {"late": late / 2}, {"stamps": min(late, 0.5 * period)}][
            random.integers(0, 3)
        ],
    }


def in_steps(random: np.random.Generator) -> Drawn:
    """A device whose current comes in 10 to 100 steps to its largest; the log holds what was asked for or what came."""
    mass, travel = between(random, 0.03, 0.3), between(random, 0.005, 0.02)
    accelerates = travel * (2 * np.pi * 4) ** 2
    push = sines(random, mass * accelerates, 0.3, 15, 1e-3)
    k = mass * (2 * np.pi * 1.5) ** 2
    return {
        "law": lambda tick, z, _: push(tick) - k * z,
        "mass": mass,
        "damping": random.uniform(0.02, 0.3) * mass * 2 * np.pi * 4,
        "friction": random.uniform(0, 0.3) * mass * accelerates,
        **sensor(random, travel / between(random, 200, 2000)),
        "ticks": 6000,
        "delay": int(random.integers(0, 3)),
        "limit": 100.0,
        "output": 3 * mass * accelerates / between(random, 10, 100),
        "told": bool(random.random() < 0.5),
    }


# --- loops that swing: numbers of the law beside those of held_log


@dataclass(frozen=True)
class Loop:
    """The law of a loop that swings.

    Attributes:
        k, b: spring and damper.
        c, by, at: a force that the sign of the position beyond `at`, of the speed or of the force itself switches.
        width: over which it is switched, in place of at once.
        slow, every, late: the part that is new every so many ticks, and so many of its frames late.
        keep: share of the old velocity in the filter.
    """

    k: float = 0.0
    b: float = 0.0
    c: float = 0.0
    by: str = "position"
    at: float = 0.0
    width: float = 0.0
    slow: str = "spring"
    every: int = 1
    late: int = 0
    keep: float = 0.0

    def law(self) -> Law:
        """Return the law with a memory of its own."""
        frames = [(0.0, 0.0)] * (self.late + 1)
        seen, filtered = [0.0], [0.0]

        def switched(by: float) -> float:
            return self.c * (max(-1.0, min(1.0, by / self.width)) if self.width else float(np.sign(by)))

        def law(tick: int, z: float, u: float) -> float:
            filtered[0] = self.keep * filtered[0] + (1 - self.keep) * u
            speed = filtered[0]
            if tick % self.every == 0:
                # A slow damper takes the speed over its own frame.
                over = speed if self.every == 1 else u if tick == 0 else (z - seen[0]) / (self.every * self.period)
                frames.append((z, over))
                frames.pop(0)
                seen[0] = z
            at, moving = frames[0]
            spring, damper = (at, speed) if self.slow == "spring" else (z, moving)
            plain = -self.k * spring - self.b * damper
            if self.by == "force":
                return plain + switched(plain)
            return plain - switched(z - self.at if self.by == "position" else u)

        return law

    period: float = 1e-3


def switched(random: np.random.Generator) -> Drawn:
    """A force that a sign switches."""
    kind = str(random.choice(["wall", "on and off", "minimum force", "compensated", "rendered friction"]))
    period = between(random, 1e-3, 1e-2) if kind in {"on and off", "wall"} else 1e-3
    mass, friction, c = between(random, 0.05, 0.4), between(random, 0.02, 0.3), between(random, 0.5, 6)
    k, b = between(random, 50, 300), between(random, 0.3, 2)
    k, b = (min(k, 0.02 * mass / period**2), min(b, 0.1 * mass / period))
    loop = {
        "wall": Loop(k, b, c, "position", period=period),
        "on and off": Loop(0, 0, c, "position", random.uniform(-5e-3, 5e-3), period=period),
        "minimum force": Loop(k, b, c, "force", period=period),
        "compensated": Loop(k, 0, -friction * random.uniform(1.3, 2.5), "speed", period=period),
        "rendered friction": Loop(k, 0, c, "speed", period=period),
    }[kind]
    return {
        "loop": loop,
        "mass": mass,
        "damping": between(random, 0.2, 1),
        "friction": friction,
        "period": period,
        "ticks": max(800, round(4e-3 / period * 1000)),
        "delay": int(random.integers(0, 5)),
        "start": 0.01,
        "about": kind,
    }


def of_two_rates(random: np.random.Generator) -> Drawn:
    """A spring of every frame beside a damper of every tick, of a wheel or a slide; or the reverse."""
    slow = "spring" if random.random() < 0.8 else "damper"
    turns = bool(random.random() < 0.5)
    every = int(random.integers(5, 34))
    late = int(random.integers(0, 3 if every < 17 else 2))
    mass = between(random, 0.02, 0.1) if turns else between(random, 0.05, 0.5)
    lag = 1e-3 * every * (0.5 + late)
    # So stiff that its own lag makes it swing: the damping that is there falls short of k times the lag.
    k = mass * (between(random, 0.4, 0.9) / lag) ** 2
    b = random.uniform(0.2, 0.8) * k * lag
    if slow == "damper":
        k, b = mass * (2 * np.pi * between(random, 2, 6)) ** 2, between(random, 1.1, 2) * mass / lag
    return {
        "loop": Loop(k, b, slow=slow, every=every, late=late),
        "mass": mass,
        "damping": 0.2 * b,
        "friction": 1e-3 * k,
        "ticks": 5000,
        "delay": 1,
        "start": random.uniform(0.1, 0.5) if turns else random.uniform(0.003, 0.01),
        "step": between(random, 2e-5, 2e-4) if turns else between(random, 5e-6, 4e-5),
        "limit": k * (1.0 if turns else 0.03),
        "rotary": turns,
        "about": f"{slow} every {every} ms, {late} late",
    }


KINDS: Mapping[str, tuple[Callable[[np.random.Generator], Drawn], str]] = {
    "load on a spring": (on_a_spring, ""),
    "hanging load": (hanging, ""),
    "nearly all friction": (in_friction, ""),
    "host's clock": (hosted, ""),
    "current in steps": (in_steps, ""),
    "switched force": (switched, "relay"),
    "two rates": (of_two_rates, "rates"),
}


def made(drawn: Drawn, **changed: Any) -> Any:
    """Return the log of a drawn case, with some of it changed."""
    of = {**drawn, **changed}
    of.pop("about", None)
    loop = of.pop("loop", None)
    return held_log(of.pop("law") if loop is None else loop.law(), **of)


def one(number: int, seed: int) -> dict[str, Any]:
    """Draw a log and judge what is said of it."""
    kind = list(KINDS)[number % len(KINDS)]
    draw, cause = KINDS[kind]
    random = np.random.default_rng([seed, number])
    before = resource.getrusage(resource.RUSAGE_SELF).ru_utime
    row = judged_diagnosis(draw, cause, random) if cause else judged_device(draw(random), random)
    return {"number": number, "kind": kind, **row, "cpu_s": resource.getrusage(resource.RUSAGE_SELF).ru_utime - before}


NUMBERS = {
    "mass_kg": "mass",
    "damping_ns_per_m": "damping",
    "coulomb_friction_n": "friction",
    "stiffness_n_per_m": "spring",
}


def judged_device(drawn: Drawn, random: np.random.Generator) -> dict[str, Any]:
    """Identify a device beside the file of another."""
    off = dict(
        zip(("mass_kg", "damping_ns_per_m", "coulomb_friction_n"), random.lognormal(0, math.log(2), 3), strict=True)
    )
    device = {key: float(f"{drawn[NUMBERS[key]] * by:.4g}") for key, by in off.items()}
    period = float(drawn.get("period", 1e-3))
    base = DeviceFile.model_validate({"name": "base", "device": {**device, "delay_samples": 1, "max_force_n": 200.0}})
    records, faults, _ = records_of(made(drawn))
    try:
        found = identify(records if not faults else [], base=base)
    except AvcError as error:
        said = str(error)
        flips = "--flip-force" in said
        return {
            "score": WRONG if flips else OPEN,
            "said": said[:300],
            "worse": int(flips),
            "advice": int(flips),
            "off": {},
        }
    scores, ranges, off_by = {}, {}, {}
    for key, name in NUMBERS.items():
        truth, told = float(drawn.get(name, 0.0)), found.estimates.get(key)
        if told is None:
            scores[key] = OPEN
            continue
        half = max((told.high - told.low) / 2, 1e-3 * abs(truth))
        beyond = max(told.low - truth, truth - told.high, 0.0)
        scores[key] = RIGHT if beyond <= 1e-3 * abs(truth) else WRONG if beyond > half else "beside"
        off_by[key] = told.value / truth - 1 if truth else told.value
    file = found.device
    copied = []
    if file is not None:
        table = file.device.model_dump()
        copied = [key for key in SEARCHED if key in device and table[key] == device[key] and key not in file.gaps]
        limits = file.device.range.model_dump() if file.device.range else {}
        ranges = {
            key: bool(limits[key][0] <= drawn[NUMBERS[key]] <= limits[key][1])
            for key in NUMBERS
            if key in file.gaps and limits.get(key) is not None
        }
    asked = [scores[key] for key in ("mass_kg", "damping_ns_per_m", "coulomb_friction_n")]
    score = WRONG if copied or WRONG in scores.values() else RIGHT if OPEN not in asked else OPEN
    return {
        "score": score,
        "numbers": scores,
        "off": off_by,
        "copied": copied,
        "gaps": ranges,
        "terms": list(found.terms),
        "worse": 0,
        "advice": 0,
        "scatter": records[0].scatter,
        "rate_hz": 1 / period,
    }


def swing(drawn: Drawn, third: int = 2, **changed: Any) -> float:
    """Return what a third of a log of a loop swings by, the last one if not another, peak to peak."""
    return float(np.ptp(np.array_split(made(drawn, **changed).position_m, 3)[third]))


def judged_diagnosis(
    draw: Callable[[np.random.Generator], Drawn], cause: str, random: np.random.Generator
) -> dict[str, Any]:
    """Diagnose a loop that swings, and simulate what is advised."""
    while True:
        drawn = draw(random)
        now, before_now = swing(drawn), swing(drawn, 1)
        loop = drawn["loop"]
        without = swing(drawn, loop=replaced(loop, c=0.0, every=1, late=0)) if loop.k else 0.0
        # It goes on (what dies away slowly is nothing wrong), for the one reason.
        if now > max(20 * drawn.get("step", 2e-5), 0.7 * before_now, 10 * without):
            break
    rotary, radius = bool(drawn.get("rotary")), 0.1
    device = Device.model_validate(
        {
            "mass_kg": drawn["mass"],
            "damping_ns_per_m": drawn["damping"],
            "coulomb_friction_n": drawn["friction"],
            "sample_time_s": drawn.get("period", 1e-3),
            "delay_samples": drawn["delay"],
            "max_force_n": drawn.get("limit", 8.0),
            **({"motion": "rotary", "handle_radius_m": radius} if rotary else {}),
        }
    )
    try:
        found = diagnose(made(drawn), device=device)
    except AvcError as error:
        return {"score": OPEN, "said": str(error)[:300], "worse": 0, "advice": 0, "about": drawn["about"]}
    told: dict[str, float] = {}
    for cure in found.cures:
        value = cure.value
        if cure.key == "switch_width" and " N to either side" in cure.change and drawn["loop"].by == "position":
            value /= drawn["loop"].k
        changed: Drawn | None = None
        if cure.key == "damping_ns_per_m" and drawn["loop"].by == "speed" and found.law is not None:
            # Where each tick moves by one count, a sign is a damper of the speed.
            changed = {"loop": replaced(drawn["loop"], c=drawn["loop"].c * value / found.law.damping_ns_per_m)}
        else:
            changed = advised(drawn, cure.key, value)
        if changed is not None:
            told[f"{cure.key} {cure.value:.3g}"] = swing(drawn, **changed) / now
    for key, words in (("b", "with b halved"), ("k", "with k halved")):
        if words in found.decides:
            less = {"loop": replaced(loop, **{key: getattr(loop, key) / 2})}
            told[f"would decide: {key} halved"] = swing(drawn, **less) / now
    if "a quarter of both" in found.decides:
        told["would decide: a quarter of both"] = swing(drawn, loop=replaced(loop, k=loop.k / 4, b=loop.b / 4)) / now
    score = RIGHT if found.cause == cause else OPEN if found.verdict == "cannot tell" else WRONG
    return {
        "score": score,
        "answer": found.cause or found.verdict,
        "said": found.conclusion,
        "advised": told,
        "worse": sum(by > WORSE for by in told.values()),
        "advice": len(told),
        "rest": sum(by * now < max(RESTS * drawn.get("step", 2e-5), 0.05 * now) for by in told.values()),
        "about": drawn["about"],
    }


def replaced(loop: Loop, **changed: Any) -> Loop:
    """Return a loop with some of it changed."""
    return Loop(**{**loop.__dict__, **changed})


def advised(drawn: Drawn, key: str, value: float) -> Drawn | None:
    """Return what an advice changes; None of what plain steps do not know."""
    loop: Loop = drawn["loop"]
    period = float(drawn.get("period", 1e-3))
    if key == "sample_time_s" and loop.every > 1:
        return {"loop": replaced(loop, every=1, late=0)}
    if key == "velocity_filter_hz":
        return {"loop": replaced(loop, keep=math.exp(-2 * math.pi * value * period))}
    if key in {"delay_samples", "encoder_resolution_m"}:
        return {"delay": round(value)} if key == "delay_samples" else {"step": value}
    of = {"stiffness_n_per_m": "k", "damping_ns_per_m": "b", "switch_width": "width", "switched_n": "c"}.get(key)
    if of is None:
        return None
    return {"loop": replaced(loop, **{of: math.copysign(value, loop.c) if of == "c" else value})}


def page(rows: list[dict[str, Any]], about_: Mapping[str, Any]) -> str:
    """Return the results as text."""
    lines = ["# Logs of kinds that people record", "", made_by(about_), ""]
    lines += [" ".join((__doc__ or "").split("\n\n")[2].partition(" With --write")[0].split()), ""]
    lines += [
        "| kind | logs | right | cannot tell | wrong | advice | makes worse | brings rest |",
        "|---|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for kind in (*KINDS, "all"):
        of = [row for row in rows if kind in {row["kind"], "all"}]
        counts = Counter(row["score"] for row in of)
        shares = [f"{100 * counts[score] / max(len(of), 1):.0f} %" for score in (RIGHT, OPEN, WRONG)]
        sums = [sum(row.get(key, 0) for row in of) for key in ("advice", "worse", "rest")]
        lines.append(f"| {kind} | {len(of)} | {' | '.join(shares)} | {' | '.join(map(str, sums))} |")
    devices = [row for row in rows if "numbers" in row]
    lines += ["", "Of the logs of a device: numbers, and how far the told ones lie from the truth.", ""]
    lines += [
        "| what | told | in its interval | beside | wrong | error, median | error, 95 % below |",
        "|---|--:|--:|--:|--:|--:|--:|",
    ]
    for key in NUMBERS:
        counts = Counter(row["numbers"][key] for row in devices)
        told = sum(counts.values()) - counts[OPEN]
        errors = [abs(row["off"][key]) for row in devices if key in row["off"]] or [math.nan]
        quantiles = [f"{100 * np.quantile(errors, share):.2g} %" for share in (0.5, 0.95)]
        lines.append(
            f"| {key} | {told} | {counts[RIGHT]} | {counts['beside']} | {counts[WRONG]} | {' | '.join(quantiles)} |"
        )
    copied = sum(len(row["copied"]) for row in devices)
    held = [inside for row in devices for inside in row["gaps"].values()]
    cpu = [row["cpu_s"] for row in rows]
    closing = (
        f"A base device's value stood as if found in **{copied}** files. Of {len(held)} gaps with a range {sum(held)} "
        f"hold the truth. Processor time a log: median {np.median(cpu):.1f} s, {sum(cpu) / 60:.0f} minutes in all."
    )
    lines += [
        "",
        closing,
        "",
    ]
    return "\n".join(lines)


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=14, help="logs in all")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--workers", type=int, default=2, help="processes")
    parser.add_argument("--only", default="", help="one kind")
    parser.add_argument("--write", action="store_true", help="overwrite results/recorded_logs.json and the page")
    args = parser.parse_args()
    made_ = about(f"python tests/benchmarks/recorded_logs.py --count {args.count} --write", args.seed)
    rows = kept_rows(OUT, made_) if args.write else []
    done = {row["number"] for row in rows}
    numbers = [number for number in range(args.count) if number not in done]
    if args.only:
        numbers = [number for number in numbers if list(KINDS)[number % len(KINDS)] == args.only]
    with ProcessPoolExecutor(args.workers) as pool:
        for row in pool.map(partial(one, seed=args.seed), numbers):
            rows.append(row)
            print(row, flush=True)
            if args.write:
                write_rows(OUT, made_, rows)
                PAGE.write_text(page(rows, made_), encoding="utf-8")
    print(page(rows, made_))


if __name__ == "__main__":
    main()
