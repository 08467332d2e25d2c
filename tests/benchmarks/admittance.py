"""Admittance devices drawn at random: their loops beside a second program, and whether their limits are limits.

OPENBLAS_NUM_THREADS=1 nice -n 10 python tests/benchmarks/admittance.py --count 100

Overwrites results/admittance.json and RESULTS_admittance.md after every device and goes on where it stopped; some ten
seconds of processor time each. The second program is tests/oracle/admittance_loop.py: it shares no code with the
package, and its simulation shares no matrix with its loop.
"""

from __future__ import annotations

import argparse
import sys
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from studied import HERE, about, computed, made_by, table

sys.path.insert(0, str(HERE.parent / "oracle"))

from admittance_loop import PlainDevice, growth, largest_pole

from avc_casadi._util.arrays import Interval
from avc_casadi.claims.admittance import certify_admittance
from avc_casadi.loops.handle import HandleFamily, leading_poles, plants_of
from avc_casadi.loops.loop import Body
from avc_casadi.loops.wall import closed
from avc_casadi.model.admittance import AdmittanceProblem
from avc_casadi.model.hands import Hand

SEED = 4718
OUT = Path(__file__).parent / "results" / "admittance.json"
PAGE = Path(__file__).parent / "RESULTS_admittance.md"
SAMPLES = 20_000
"""Samples of a simulation of growth."""
DRAWN = 60
"""Hands and contacts that are drawn for each side of a limit."""
INSIDE = 8
"""Values inside a stable interval that are tried."""
REACH = 300.0
"""Largest ratio of such a value to that of the law, and of that to such a value."""

Sums = tuple[float, float, float]


def drawn(index: int) -> AdmittanceProblem:
    """Return a device, its law, hands and contact, drawn from what is sold and built."""
    random = np.random.default_rng([SEED, index])

    def even(low: float, high: float) -> float:
        return float(np.exp(random.uniform(np.log(low), np.log(high))))

    def interval(low: float, high: float) -> tuple[float, float]:
        ends = sorted((even(low, high), even(low, high)))
        return ends[0], ends[1]

    delay = float(random.choice([0.0, 1.0, 2.0, 3.0, random.uniform(0.1, 4.0), random.uniform(0.1, 4.0)]))
    drive = {"drive_order": 2, "drive_damping_ratio": random.uniform(0.4, 1.0)} if random.random() < 0.4 else {}
    law = {"mass_kg": even(0.5, 60.0), "damping_ns_per_m": even(5.0, 600.0)}
    if random.random() < 0.5:
        law["cutoff_hz"] = even(10.0, 200.0)
    if random.random() < 0.2:
        law["stiffness_n_per_m"] = even(10.0, 500.0)
    device = {
        "drive": "velocity",
        "drive_bandwidth_hz": even(5.0, 150.0),
        "sample_time_s": float(random.choice([5e-4, 1e-3, 2e-3, 4e-3])),
        "delay_samples": delay if delay % 1 else int(delay),
        **drive,
        "force_sensor": {
            "stiffness_n_per_m": even(2e4, 2e7),
            "damping_ratio": random.uniform(0.005, 0.1),
            "handle_mass_kg": even(0.05, 2.0),
        },
    }
    return AdmittanceProblem.model_validate(
        {
            "name": f"device-{index}",
            "device": device,
            "law": {"admittance": law},
            "hands": {
                "mass_kg": interval(0.05, 3.0),
                "damping_ns_per_m": interval(3.0, 60.0),
                "stiffness_n_per_m": interval(50.0, 3000.0),
            },
            "contact": {"stiffness_n_per_m": (0.0, even(300.0, 1e5)), "damping_ns_per_m": interval(0.5, 20.0)},
        }
    )


def radius(problem: AdmittanceProblem, sums: Sums) -> float:
    """Return the spectral radius by the package."""
    assert problem.law is not None
    body = Body.of(plants_of([(problem.device, Hand(*(np.array([value]) for value in sums)))])).flat()
    return float(closed(body, problem.law.admittance.law(problem.device.sample_time_s)).radius[0])


def worst_sums(problem: AdmittanceProblem) -> list[Sums]:
    """Return what the handle carries in the worst loop of each side, by the package's search."""
    assert problem.law is not None
    law = problem.law.admittance.law(problem.device.sample_time_s)
    found = [side.worst_case(leading_poles(law)).hand for side in HandleFamily.of(problem).sides]
    return [(hand["mass_kg"], hand["damping_ns_per_m"], hand["stiffness_n_per_m"]) for hand in found]


def sampled_sums(problem: AdmittanceProblem, index: int) -> list[Sums]:
    """Return what the handle may carry, without the package's search: corners, springs along edges, points drawn."""
    random = np.random.default_rng([SEED, index, 1])
    sums: list[Sums] = []
    for side in HandleFamily.of(problem).sides:
        masses, dampings, (low, high) = side.carried.values()
        springs = [low, high, *(k for k in np.geomspace(3.0, 2e5, 25).tolist() if low < k < high)]
        sums += list(product(sorted(set(masses)), sorted(set(dampings)), springs))
        if high > low:
            sums += [
                (random.uniform(*masses), random.uniform(*dampings), random.uniform(low, high)) for _ in range(DRAWN)
            ]
    return sums


def with_law(problem: AdmittanceProblem, key: str, value: float) -> AdmittanceProblem:
    """Return a problem with another value of its law."""
    return problem.changed(law={"admittance": {key: value}})


def turns(problem: AdmittanceProblem, key: str, limit: float | None, index: int, *, low: bool = True) -> str:
    """Return whether 0.98 and 1.02 times a limit are on the right sides, by the second program: ok, no limit or why."""
    if limit is None or not 0 < limit < 1e8:
        return "no limit"
    for factor in (0.98, 1.02):
        value = factor * limit
        changed = (
            problem.changed(contact={"stiffness_n_per_m": (0.0, value)})
            if key == "contact"
            else with_law(problem, key, value)
        )
        stable = (factor > 1) == low
        everywhere = worst_sums(changed) + (sampled_sums(changed, index) if stable else [])
        largest = max(largest_pole(PlainDevice.of(changed, *sums)) for sums in everywhere)
        if (largest < 1) != stable:
            return f"{factor} of {limit:.4g}: radius {largest:.8f}"
    return "ok"


def inside(problem: AdmittanceProblem, key: str, interval: Interval | None) -> str:
    """Return whether values over a stable interval are stable with every corner of hands and contacts."""
    assert problem.law is not None
    stated = getattr(problem.law.admittance, key)
    if interval is None:
        return "no limit"
    low, high = max(interval[0], stated / REACH), min(interval[1], stated * REACH)
    corners = [sums for side in HandleFamily.of(problem).sides for sums in product(*side.carried.values())]
    for value in np.geomspace(1.001 * low, 0.999 * high, INSIDE).tolist() if low < high else ():
        changed = with_law(problem, key, value)
        largest = max(largest_pole(PlainDevice.of(changed, *sums)) for sums in corners)
        if largest >= 1:
            return f"{value:.4g} inside {interval[0]:.4g} to {interval[1]:.4g}: radius {largest:.8f}"
    return "ok"


def cell(index: int) -> dict[str, Any]:
    """Judge a device, and compare."""
    problem = drawn(index)
    assert problem.law is not None
    found = certify_admittance(problem, remedies=False)
    sums = worst_sums(problem)
    worst = max(sums, key=lambda carried: radius(problem, carried))
    apart = max(abs(radius(problem, carried) - largest_pole(PlainDevice.of(problem, *carried))) for carried in sums)
    size = radius(problem, worst)
    grown = growth(PlainDevice.of(problem, *worst), SAMPLES)
    mass = found.mass_range_kg
    damping = found.damping_range_ns_per_m
    softer = found.stiffest_contact_n_per_m
    missed = max(largest_pole(PlainDevice.of(problem, *carried)) for carried in sampled_sums(problem, index))
    return {
        "stable": found.stable,
        "radius": size,
        "apart": apart,
        "growth": grown,
        "missed": found.stable and missed >= 1,
        "disk": found.disk_margin,
        "limits": {
            "least mass": turns(problem, "mass_kg", mass and mass[0], index),
            "largest mass": turns(problem, "mass_kg", mass and mass[1], index, low=False),
            "least damping": turns(problem, "damping_ns_per_m", damping and damping[0], index),
            "stiffest contact": turns(problem, "contact", softer, index, low=False),
            "masses inside": inside(problem, "mass_kg", mass),
            "dampings inside": inside(problem, "damping_ns_per_m", damping),
        },
    }


TEXT = """# Admittance devices drawn at random

{made_by}

{count} devices: drives of 5 to 150 Hz, first or second order, at 250 Hz to 2 kHz with 0 to 4 samples of delay; sensors
of 20 kN/m to 20 MN/m before handles of 50 g to 2 kg; laws, hands and contacts to match. `avc certify` judges each, and
[a second program](../oracle/admittance_loop.py) computes the loop and simulates it. It shares no code with the package.

- The largest difference of a spectral radius is {apart:.1e} (worst loops of every side, {count} devices).
- The largest difference of the growth a sample from a simulation of the worst loop is {growth:.1e}.
- {unstable} laws are unstable. Of the stable ones {missed} are unstable at a corner, on an edge or at a point that was
  drawn without the package's search.

A limit is right where the second program finds the worst loop unstable on one side, and all loops stable on the other:
worst, corners, edges and drawn ones. 0.98 and 1.02 of the limit are the two sides. *Inside*: eight values over a
stable interval, up to a ratio of 300 to that of the law, are stable at all corners.

{rows}

{wrong}
"""


def write_page(document: dict[str, Any]) -> None:
    cells = {name: one for name, one in document["cells"].items() if "error" not in one}
    failed = [f"{name}: {one['error']}" for name, one in document["cells"].items() if "error" in one]
    names = list(next(iter(cells.values()))["limits"]) if cells else []
    rows, wrong = [], failed
    for limit in names:
        outcomes = [one["limits"][limit] for one in cells.values()]
        right, none = outcomes.count("ok"), outcomes.count("no limit")
        rows.append([limit, right, len(outcomes) - right - none, none])
        wrong += [
            f"{name}, {limit}: {one['limits'][limit]}"
            for name, one in cells.items()
            if one["limits"][limit] not in ("ok", "no limit")
        ]
    PAGE.write_text(
        TEXT.format(
            made_by=made_by(document["about"]),
            count=len(cells),
            apart=max((one["apart"] for one in cells.values()), default=0.0),
            growth=max((abs(one["growth"] - one["radius"]) for one in cells.values()), default=0.0),
            unstable=sum(not one["stable"] for one in cells.values()),
            missed=sum(one["missed"] for one in cells.values()),
            rows=table(("limit", "right", "wrong", "no limit"), rows),
            wrong="\n".join(f"- {line}" for line in wrong) or "None is wrong.",
        ),
        encoding="utf-8",
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=100, help="devices, default 100")
    count = parser.parse_args().count
    command = "OPENBLAS_NUM_THREADS=1 python tests/benchmarks/admittance.py --count N"
    cells = {f"device-{index}": partial(cell, index) for index in range(count)}
    computed(cells, OUT, about(command, SEED), write_page)


if __name__ == "__main__":
    main()
