"""Is a contact, a delay or a step judged as it is declared? Followers and engines drawn at random, by another code.

OPENBLAS_NUM_THREADS=1 python tests/benchmarks/declared_ranges.py 40 --write

Of each pair the package tells the largest K at a ratio B/K that is drawn, by its gain margin, and nothing else. The
loops are those of tests/oracle/lifted_teleoperator.py and lifted_engine.py. At 0.98 of it no loop may be unstable: a
follower is tried at 82 contacts of its declared range, an engine at 200 steps and, where it has springs, at some of
24 contacts. At 1.05 a loop is unstable. Two followers of each ten run through the plain simulation of the tests too.
"""

from __future__ import annotations

import itertools
import math
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from script_arguments import script_arguments
from studied import about, kept_rows, made_by, write_rows

sys.path[:0] = [str(Path(__file__).parents[1] / "oracle")]

import lifted_engine  # noqa: E402 - oracles of the tests
import lifted_teleoperator  # noqa: E402
import teleoperator_simulator  # noqa: E402

from avc_casadi.design.virtual_tool import CouplingSearch, FollowerSearch, ToolSearch  # noqa: E402
from avc_casadi.model.ends import ToolGains  # noqa: E402
from avc_casadi.model.problem import Problem  # noqa: E402

SEED = 23
HERE = Path(__file__).parent
OUT, PAGE = HERE / "results" / "declared_ranges.json", HERE / "RESULTS_declared_ranges.md"
BELOW, ABOVE = 0.98, 1.05
# Share of K at which loops grow quickly enough for a simulation.
SIMULATED = 1.3
# Eigenvalues of these loops are right to about this.
ROUNDING = 1e-8
END_STOP_N_PER_M = 1e8
RELEASED = (0.0, 0.0, 0.0)
HANDS = {"mass_kg": (0.05, 0.3), "damping_ns_per_m": (3.0, 20.0), "stiffness_n_per_m": (200.0, 800.0)}
PHASES = 3
STEPS, ENGINE_CONTACTS = 200, 24
Row = dict[str, Any]


class Draw:
    """Tables of a problem, drawn at random."""

    def __init__(self, number: int, kind: int) -> None:
        self.random = np.random.default_rng([SEED, kind, number])

    def value(self, low: float, high: float) -> float:
        """Return a value between two, by its logarithm, of three digits."""
        return float(f"{low * (high / low) ** self.random.random():.3g}")

    def one_of(self, *choices: Any) -> Any:
        """Return one of some values."""
        return choices[int(self.random.integers(len(choices)))]

    def device(self, sample_time_s: float) -> Row:
        """Return a device."""
        return {
            "mass_kg": self.value(0.05, 0.5),
            "damping_ns_per_m": self.value(0.3, 4.0),
            "sample_time_s": sample_time_s,
            "delay_samples": int(self.random.integers(0, 3)),
        }

    def follower(self) -> Row:
        """Return a problem with a follower: contacts between 1 kN/m and 10 MN/m, rigid or with an end."""
        t = self.one_of(0.0005, 0.001, 0.002)
        delays = sorted(self.one_of(0.0, 0.5, 1.0, 2.0, 3.5, 6.0) * t for _ in range(2))
        if self.random.random() < 0.5:
            delays = [delays[1], delays[1]]
        spring = [self.one_of(0.0, self.value(1e3, 1e6)), self.one_of(math.inf, *[self.value(1e6, 1e7)] * 3)]
        damper = self.value(0.3, 30.0)
        kind = self.one_of("position-position", "commanded", "measured")
        force = {"architecture": "position-force", "force": kind} if kind != "position-position" else {}
        follower = self.device(self.one_of(t, t, t, 2 * t, 1.5 * t)) | {
            "delay_s": delays,
            "contact_stiffness_n_per_m": spring,
            "contact_damping_ns_per_m": self.one_of([damper, damper], [0.0, damper], [damper, 4 * damper]),
            **force,
        }
        return {"device": self.device(t), "follower": follower, "frequency": {"stop_hz": 100.0}}

    def engine(self) -> Row:
        """Return a problem with an engine whose step has a range; explicit contacts stay where the engine is stable."""
        t = self.one_of(0.0005, 0.001, 0.001)
        shortest = self.value(1.2 * t, 0.016)
        longest = float(f"{shortest * self.value(1.1, 3.0):.4g}")
        how, mass = self.one_of("semi-implicit", "implicit-damping", "implicit", "exact"), self.value(0.03, 1.0)
        tool: Row = {
            "tool_mass_kg": mass,
            "step_s": [shortest, longest],
            "integrator": how,
            "exchange": self.one_of("on-time", "late", "ahead", "held-force"),
        }
        if self.random.random() < 0.4:
            stiffest = 0.3 * mass / longest**2 if how != "exact" else 1e5
            tool |= {"contact_stiffness_n_per_m": [0.0, float(f"{stiffest:.3g}")], "contact_damping_ns_per_m": 1.0}
        return {"device": self.device(t), "simulation": tool}


def hands(random: np.random.Generator, device_kg: float) -> list[tuple[float, ...]]:
    """Return the corners of the ranges of hands, two inside, none, and the end stop of the device."""
    corners = list(itertools.product(*HANDS.values()))
    inside = [tuple(random.uniform(*ends) for ends in HANDS.values()) for _ in range(2)]
    stop = (0.0, 2 * math.sqrt(END_STOP_N_PER_M * device_kg), END_STOP_N_PER_M)
    return [RELEASED, *corners, *inside, stop]


EVEN_CONTACTS = 60
SOFTEST_N_PER_M = 0.1


def contacts_n_per_m(mass_kg: float, sample_time_s: float, ends: Iterable[float]) -> NDArray[np.float64]:
    """Return contacts: free, 20 by decades, 60 evenly in sqrt(k/m) T up to eight turns, rigid where it is declared."""
    lowest, highest = ends
    top = min(highest, 1e9)
    low = max(lowest, 10.0)
    angles = np.sqrt(np.array([low, top]) / mass_kg) * sample_time_s
    even = np.linspace(angles[0], min(angles[1], angles[0] + 16 * math.pi), EVEN_CONTACTS)
    springs = np.concatenate([np.geomspace(low, top, 20), mass_kg * (even / sample_time_s) ** 2])
    return np.concatenate([[0.0], np.clip(springs, low, top), [math.inf] if math.isinf(highest) else [top]])


def device_of(table: Mapping[str, Any]) -> tuple[Any, ...]:
    """Return a device as the oracles take it."""
    return tuple(table[key] for key in ("mass_kg", "damping_ns_per_m", "sample_time_s", "delay_samples"))


def worst_of_follower(tables: Row, gains: tuple[float, float], named: Any) -> tuple[float, Any]:
    """Return the fastest growth a sample of the leader, and hand, contact, damper, delay and phase of it."""
    leader, far = tables["device"], tables["follower"]
    springs = contacts_n_per_m(far["mass_kg"], far["sample_time_s"], far["contact_stiffness_n_per_m"])
    ratio = Fraction(far["sample_time_s"] / leader["sample_time_s"]).limit_denominator(64)
    springs = np.append(springs, named.environment_n_per_m)
    low, high = far["delay_s"]
    kind = far.get("force", "position-position")
    worst: tuple[float, Any] = (-1.0, None)
    people = [tuple(named.hand.values()), *hands(np.random.default_rng(5), leader["mass_kg"])]
    for delay_s, damper in itertools.product(
        np.linspace(low, high, 3 if high > low else 1), sorted(set(far["contact_damping_ns_per_m"]))
    ):
        for phase, hand in itertools.product(np.arange(PHASES) / PHASES / ratio.numerator, people):
            values = lifted_teleoperator.growth(
                device_of(leader),
                device_of(far),
                gains,
                delay_s,
                delay_s,
                hand=hand,
                architecture=kind,
                phase=phase,
                contacts=(springs, damper * (springs > 0)),
            )
            at = int(values.argmax())
            if values[at] > worst[0]:
                worst = float(values[at]), (hand, float(springs[at]), damper, float(delay_s), float(phase))
    return worst


def simulated(row: Row) -> tuple[float, float]:
    """Return the growth a sample at a row's place, at 1.3 of K: of the loop written out, and of a simulation."""
    hand, spring, damper, delay_s, phase = row["above_at"]
    leader, far = row["tables"]["device"], row["tables"]["follower"]
    k, b = (SIMULATED * gain for gain in row["told"])
    kind = far.get("force")
    ends = device_of(leader), device_of(far)
    how = {"hand": hand, "contacts": ([spring], [damper * (spring > 0)]), "architecture": kind or "position-position"}
    growth = float(lifted_teleoperator.growth(*ends, (k, b), delay_s, delay_s, phase=phase, **how)[0])
    # From a kick of a micrometre a sample up to a million times that, or 40 000 samples.
    samples = min(round(14 / math.log(growth)), 40000) if growth > 1 else 40000
    moved = teleoperator_simulator.run(
        *ends,
        (k, b, 0.0),
        samples * leader["sample_time_s"],
        delay_s,
        delay_s,
        hand=hand,
        contact="fixed" if math.isinf(spring) else (spring, damper) if spring else None,
        phase=phase,
        kick=1e-6 / leader["sample_time_s"],
        force=kind,
    )
    size = (np.diff(moved, axis=-1) ** 2).sum(axis=0)
    part = samples // 6
    first, last = size[3 * part : 4 * part].sum(), size[5 * part : 6 * part].sum()
    return growth, float((last / first) ** (1 / (4 * part)))


def largest(search: CouplingSearch, lag_s: float) -> tuple[float, float]:
    """Return the largest K that is told for B = K lag, and that B: the gain margin of a softer pair, times it."""
    k = SOFTEST_N_PER_M
    while search.gain_margin(ToolGains(4 * k, 4 * k * lag_s)) and k < 1e6:
        k *= 4
    # Known loops alone let K climb past what a search of the ranges then refutes.
    while not (margin := search.gain_margin_over_ranges(ToolGains(k, k * lag_s))):
        k /= 4
        if k < SOFTEST_N_PER_M:
            return 0.0, 0.0
    return margin * k, margin * k * lag_s


def judged(row: Row, search: CouplingSearch, lag_s: float, worst_of: Callable[..., tuple[float, Any]]) -> Row:
    """Return a row with what is told, and the fastest growth below and above it, there where the package has it too."""
    begun = time.process_time()
    k, b = largest(search, lag_s)
    row |= {"told": (k, b), "seconds": time.process_time() - begun}
    if k == 0:
        return row | {"below": 0.0, "above": 2.0}
    above = ABOVE * k, ABOVE * b
    named = search.loops.radius(ToolGains(*above))[1]
    row["below"], row["below_at"] = worst_of(row["tables"], (BELOW * k, BELOW * b), named)
    row["above"], row["above_at"] = worst_of(row["tables"], above, named)
    return row


def follower_row(number: int) -> Row:
    """Return what was told and found of one follower."""
    draw = Draw(number, 0)
    row: Row = {"number": number, "kind": "follower", "tables": draw.follower()}
    search, lag_s = FollowerSearch(Problem(**row["tables"])), 10 ** draw.random.uniform(-3.0, -1.7)
    row = judged(row, search, lag_s, worst_of_follower)
    if number % 5 == 0 and row["told"][0]:
        row["simulated"] = simulated(row)
    return row


def steps_inside(shortest: float, longest: float, random: np.random.Generator) -> Iterator[Fraction]:
    """Yield 200 steps, in samples: every whole one, and others whose pattern recurs after up to 60 steps."""
    whole = list(range(math.ceil(shortest), math.floor(longest) + 1))
    yield from (Fraction(one) for one in (whole if len(whole) < STEPS // 4 else whole[:: len(whole) // (STEPS // 4)]))
    for _ in range(STEPS - min(len(whole), STEPS // 4)):
        yield Fraction(random.uniform(shortest, longest)).limit_denominator(60)


def worst_of_engine(tables: Row, gains: tuple[float, float], named: Any) -> tuple[float, Any]:
    """Return the fastest growth a millisecond, and hand, contact, step and phase of it."""
    device, tool = tables["device"], tables["simulation"]
    _, high = tool.get("contact_stiffness_n_per_m", (0.0, 0.0))
    springs = [0.0, math.inf, *(np.geomspace(1e-3 * high, high, ENGINE_CONTACTS) if high else ())]
    touched = named.tool.contact_stiffness_n_per_m
    random, t = np.random.default_rng(6), device["sample_time_s"]
    people = [tuple(named.hand.values()), *hands(random, device["mass_kg"])]
    worst: tuple[float, Any] = (-1.0, None)
    shortest, longest = (one / t for one in tool["step_s"])
    steps = [Fraction(named.step_s / t).limit_denominator(60), *steps_inside(shortest, longest, random)]
    for ratio in steps:
        if not shortest - 1e-9 <= ratio <= longest + 1e-9:
            continue
        phases = Fraction(0), Fraction(1, 2 * ratio.denominator)
        chosen = springs if len(springs) < 5 else [0.0, math.inf, *random.choice(springs[2:], 3), touched]
        for phase, spring in itertools.product(phases, chosen):
            # A device at its end stop before a tool that stands still leaves nothing that moves.
            some = [hand for hand in people if hand[2] < END_STOP_N_PER_M] if math.isinf(spring) else people
            how = {"integrator": tool["integrator"], "exchange": tool["exchange"], "phase": phase}
            how["contact"] = spring, 1.0 if 0 < spring < math.inf else 0.0
            values = lifted_engine.growth(device_of(device), some, (tool["tool_mass_kg"], 0.0), gains, ratio, **how)
            at = int(values.argmax())
            if values[at] > worst[0]:
                worst = float(values[at]), (some[at], float(spring), float(ratio) * t, str(ratio), str(phase))
    return worst


def engine_row(number: int) -> Row:
    """Return what was told and found of one engine."""
    draw = Draw(number, 1)
    row: Row = {"number": number, "kind": "engine", "tables": draw.engine()}
    search, lag_s = ToolSearch(Problem(**row["tables"])), 10 ** draw.random.uniform(-3.0, -1.7)
    return judged(row, search, lag_s, worst_of_engine)


ROWS = {"follower": follower_row, "engine": engine_row}


def row_of(task: tuple[int, str]) -> Row:
    """Return the row of a number and a kind."""
    return ROWS[task[1]](task[0])


HEADER = (
    "| kind | number | K, N/m | B, N.s/m | growth at 0.98 | at 1.05 | worst place at 1.05 |",
    "|---|--:|--:|--:|--:|--:|---|",
)
INTRODUCTION = """Contacts, delays and steps are judged over the whole declared range. The problems are drawn at
random, and the loops that judge are of another code (`tests/oracle/lifted_teleoperator.py`, `lifted_engine.py`). The
package reports the largest K for a random ratio B/K. Where no K of that ratio is stable, there is nothing to try."""


def counted(rows: list[Row], name: str, what: str) -> str:
    """Return how many of some rows hold below the limit and fail above it."""
    held = [row for row in rows if row["told"][0] > 0]
    unstable, grow = (sum(row[share] > 1 + ROUNDING for row in held) for share in ("below", "above"))
    seconds = [row["seconds"] for row in rows]
    below = (
        f"**{name}**: {len(rows)} drawn, {len(held)} with a stable K. At {BELOW} of it, {what}: unstable {unstable}."
    )
    above = f"At {ABOVE} of it: unstable {grow}."
    return f"{below} {above} The limit takes {np.median(seconds):.1f} s of processor, {max(seconds):.0f} s at most."


def page(rows: list[Row], stated: Mapping[str, Any]) -> str:
    """Return the page of the results."""
    followers, engines = ([row for row in rows if row["kind"] == kind] for kind in ROWS)
    pairs = [row["simulated"] for row in followers if "simulated" in row]
    furthest = max((abs(told - seen) for told, seen in pairs), default=0.0)
    simulation = f"Growth a sample at {SIMULATED} of K in a plain simulation of {len(pairs)} followers"
    table = [line(row) for row in rows if row["told"][0] > 0]
    lines = [
        "# Declared ranges",
        made_by(stated),
        INTRODUCTION,
        counted(followers, "Followers", "82 contacts from the least to the largest"),
        counted(engines, "Engines", "200 steps inside the range"),
        f"{simulation}, compared with the loop written out: at most {furthest:.1g} apart.",
        "\n".join([*HEADER, *table]),
    ]
    return "\n\n".join(lines) + "\n"


def line(row: Row) -> str:
    """Return the line of a row in the table."""
    hand, contact, *where = row["above_at"]
    held = "released" if not any(hand) else "end stop" if hand[2] == END_STOP_N_PER_M else f"{hand[0]:.3g} kg"
    last = f"step {1e3 * where[0]:.4g} ms ({where[1]} T)" if row["kind"] == "engine" else f"{1e3 * where[1]:.3g} ms"
    k, b = row["told"]
    values = f"{k:.4g} | {b:.4g} | {row['below']:.6f} | {row['above']:.6f}"
    return f"| {row['kind']} | {row['number']} | {values} | {held}, contact {contact:.4g} N/m, {last} |"


def main() -> None:
    """Compute the rows that the file does not hold yet."""
    arguments = script_arguments(__doc__, people=40, results=OUT)
    stated = about("OPENBLAS_NUM_THREADS=1 python tests/benchmarks/declared_ranges.py 40 --write", SEED)
    rows = kept_rows(OUT, stated)
    known = {(row["kind"], row["number"]) for row in rows}
    tasks = [(number, kind) for number in range(arguments.people) for kind in ROWS if (kind, number) not in known]
    with ProcessPoolExecutor(2) as processes:
        for row in processes.map(row_of, tasks):
            rows.append(row)
            print({key: value for key, value in row.items() if key != "tables"}, flush=True)
            if arguments.write:
                write_rows(OUT, stated, rows)
    rows.sort(key=lambda row: (row["kind"] == "engine", row["number"]))
    if arguments.write:
        PAGE.write_text(page(rows, stated), encoding="utf-8")


if __name__ == "__main__":
    main()
