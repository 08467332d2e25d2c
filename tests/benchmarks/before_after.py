"""`avc recommend` of two releases on the same devices drawn at random, and of this one on neighbours of them.

    OPENBLAS_NUM_THREADS=1 python tests/benchmarks/before_after.py --before CHECKOUT --count 200 --neighbours 20

CHECKOUT is a working tree of the other release (`git worktree add CHECKOUT 94998ba`); both run with this Python, one
after the other on each device, into c.json of a temporary folder. Overwrites results/before_after.json and
RESULTS_before_after.md after every device and goes on where it stopped; half a minute of processor a device, and a
minute more for one with neighbours. With --known FILE, a results file of the same seed and other release, that release
runs again only where this one is softer, and the plant only where this one renders otherwise.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from random_devices import drawn
from studied import about, computed, cpu_seconds, made_by, rounded, table

sys.path.insert(0, str(Path(__file__).parents[1]))

from goldens.exported_c import exported
from goldens.recommendations import HANDS, SECONDS, on_the_plant

import avc_casadi as avc
from avc_casadi.loops.margins import transients
from avc_casadi.model.problem import Problem
from avc_casadi.recommendation.generate import static_stiffness_n_per_m
from avc_casadi.recommendation.rank import Judged
from avc_casadi.recommendation.shaken import shaken
from avc_casadi.simulation.population.coupling_trial import try_coupling
from avc_casadi.simulation.population.motions import course_of
from avc_casadi.simulation.population.operators import draw_hands, people_of

SEED = 7706
OUT = Path(__file__).parent / "results" / "before_after.json"
PAGE = Path(__file__).parent / "RESULTS_before_after.md"
HERE = Path(__file__).parents[2]
TOLD_HZ = (1.0, 10.0)
# Hands of the trial of a recommendation, and those outside its selection.
TRIED, OTHERS = 100, 200
RENDERS = ("method", "at_rest_n_per_m", "in_motion_n_per_m", "error")
PLANTS = ("plant", "plant_without_friction")
KNOWN = (
    "Figures of the other release, and counts on the plant of couplings that render the same, are those of an earlier",
    "run of this study; the other release ran again where this one is softer.",
)
# Where some hands do not settle, they are judged once more, when what slowly dies away has done so.
SLOWEST_S = 5.0
# A share of the stiffness at rest that needs a reason.
SOFTER = 0.95
# Who is near a device: table, key, factor and summand.
NEIGHBOURS = {
    "1 % more wall": ("environment", "stiffness_n_per_m", 1.01, 0.0),
    "0.1 sample more delay": ("device", "delay_samples", 1.0, 0.1),
    "1 % less mass": ("device", "mass_kg", 0.99, 0.0),
}


def _file(problem: Problem) -> dict[str, dict[str, Any]]:
    """Return the tables of a problem file that both releases read."""
    return {
        "device": problem.device.model_dump(exclude_unset=True),
        "environment": problem.environment.model_dump(exclude_unset=True),
        "coupling": problem.coupling.model_dump(exclude_unset=True),
        "stability": {"model": "sampled-data", "scope": "hands"},
        "frequency": {"stop_hz": problem.frequency.stop_hz},
    }


def _toml(tables: Mapping[str, Mapping[str, Any]]) -> str:
    def value(one: Any) -> str:
        if isinstance(one, Mapping):
            return "{ " + ", ".join(f"{key} = {value(item)}" for key, item in one.items()) + " }"
        return json.dumps(list(one) if isinstance(one, tuple) else one)

    return "\n".join(
        f"[{name}]\n" + "".join(f"{key} = {value(one)}\n" for key, one in keys.items() if one is not None)
        for name, keys in tables.items()
    )


def recommended(
    checkout: Path,
    tables: Mapping[str, Mapping[str, Any]],
    *,
    tried: bool,
    known: Mapping[str, Any] = MappingProxyType({}),
) -> dict[str, Any]:
    """Return what a release recommends for a problem file, what it costs, and how it does on the plant of the tests.

    Args:
        checkout: working tree of the release.
        tables: of the file.
        tried: whether it runs on the plant.
        known: figures of an earlier run; those on the plant are taken where the coupling renders the same.
    """
    paths = os.pathsep.join([str(checkout), str(checkout / "hardware")])
    environment = os.environ | {"PYTHONPATH": paths, "OPENBLAS_NUM_THREADS": "1"}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "p.toml").write_text(_toml(tables), encoding="ascii")
        wall, cpu = time.perf_counter(), cpu_seconds()
        done = subprocess.run(
            [sys.executable, "-m", "avc_casadi", "recommend", "p.toml", "--out", "c.json", "--json"],
            cwd=folder,
            env=environment,
            capture_output=True,
            check=False,
        )
        wall, cpu = time.perf_counter() - wall, cpu_seconds() - cpu
        told = json.loads(done.stdout)
        found: dict[str, Any] = {"wall_s": round(wall, 1), "cpu_s": round(cpu, 1), "reason": told.get("reason")}
        if not (folder / "c.json").exists():
            return found | {"method": None}
        coupling = avc.read_coupling(str(folder / "c.json"))
        at_rest = static_stiffness_n_per_m(coupling)
        moved = shaken(coupling, at_rest, TOLD_HZ)
        found |= {
            "method": told["coupling"]["method"],
            "at_rest_n_per_m": float(f"{at_rest:.5g}"),
            "in_motion_n_per_m": [float(f"{one:.5g}") for one in moved.stiffness_n_per_m],
            "error": [float(f"{one:.4g}") for one in moved.error],
            "mismatch": [float(f"{one:.4g}") for one in moved.mismatch],
        }
        if tried:
            found |= ranked(coupling)
            exported(folder / "c.json", folder)
            problem, told_s = told["coupling"]["problem_file"], course_of(coupling.problem).longest_s
            same = all(
                known.get(key) == found[key] for key in ("method", "at_rest_n_per_m", "in_motion_n_per_m", "error")
            )
            counted = {key: known[key] for key in PLANTS} if same else settled_on(problem, folder, SECONDS)
            later = counted if told_s == SECONDS else settled_on(problem, folder, told_s)
            found |= counted | {key.replace("plant", "plant_as_told"): settled for key, settled in later.items()}
            slow = counted if min(counted.values()) == HANDS else settled_on(problem, folder, SLOWEST_S)
            found |= {key.replace("plant", "plant_in_the_end"): settled for key, settled in slow.items()}
        return found


def settled_on(problem: dict[str, Any], folder: Path, seconds: float) -> dict[str, int]:
    return {key: settled for key, (settled, _) in on_the_plant(problem, folder, seconds).items()}


def ranked(coupling: avc.Coupling) -> dict[str, Any]:
    """Return what this release ranks a coupling by: hands that settle, distance from the wall, time when released."""
    hands = coupling.problem.hands
    some = (people_of(hands, TRIED, 0), draw_hands(hands, OTHERS, 0, "training", first=0))
    trials = [try_coupling(coupling, people, 0) for people in some]
    return {
        "trial": sum(int(one.stable.sum()) for one in trials),
        "trial_without_friction": sum(int(one.stable_without_friction.sum()) for one in trials),
        "distance": round(Judged(coupling, trials[0], 0).distance, 3),
        "released_s": float(f"{transients(coupling)[0].settling_s:.3g}"),
    }


def cell(index: int, before: Path, neighbours: bool, known: Mapping[str, Any]) -> dict[str, Any]:
    """Return what both releases recommend for a device, and this one for its neighbours."""
    tables = _file(drawn(index, SEED))
    of_this = known.get(str(index), {})
    after = recommended(HERE, tables, tried=True, known=of_this.get("after", {}))
    of_before = of_this.get("before") or recommended(before, tables, tried=True)
    if "distance" not in of_before and _softer(of_before, after):
        of_before = recommended(before, tables, tried=True)
    found: dict[str, Any] = {
        "device": tables["device"],
        "wall_n_per_m": tables["environment"]["stiffness_n_per_m"],
        "before": of_before,
        "after": after,
        "load": round(os.getloadavg()[0], 1),
    }
    if neighbours and found["after"]["method"] is not None:
        found["neighbours"] = {name: recommended(HERE, near, tried=False) for name, near in _neighbours(tables)}
    return found


def _softer(before: Mapping[str, Any], after: Mapping[str, Any]) -> bool:
    if not (before["method"] and after["method"]):
        return False
    return bool(after["at_rest_n_per_m"] < SOFTER * before["at_rest_n_per_m"])


def _neighbours(tables: Mapping[str, Mapping[str, Any]]) -> Iterator[tuple[str, dict[str, dict[str, Any]]]]:
    for name, (where, key, factor, more) in NEIGHBOURS.items():
        near = {one: dict(keys) for one, keys in tables.items()}
        near[where][key] = near[where][key] * factor + more
        yield name, near


def write_page(document: dict[str, Any]) -> None:
    """Write the page from the results file."""
    cells = {name: one for name, one in document["cells"].items() if "error" not in one}
    both = [one for one in cells.values() if one["before"]["method"] and one["after"]["method"]]
    without = [name for name, one in cells.items() if not (one["before"]["method"] and one["after"]["method"])]
    head = ["", f"{document['about']['before']}", f"{document['about']['commit']}"]
    lines = [
        "# `avc recommend` before and after, on devices drawn at random",
        "",
        f"{made_by(document['about'])} CHECKOUT was a working tree of {document['about']['before']} (release 0.2.0).",
        "",
        "Devices and walls are those of [RESULTS_random_devices.md](RESULTS_random_devices.md) with another seed.",
        "Both releases run one after the other as `avc recommend` with what it does by default. Impedance errors and",
        "stiffness in motion of both are those of a handle shaken in the scene of this release, stiffness at rest that",
        "of coupling and wall in series. Who settles is counted on the plant of the tests (`whole_device.c`), which",
        f"runs the exported C of each, {HANDS} hands, and judges them a second after their last strike; and, where",
        "device and hand without a coupling would still swing then, when `avc recommend` judges them too (*as told*);",
        f"and where some do not settle once more after {SLOWEST_S:g} s.",
        *(KNOWN if "--known" in document["about"]["command"] else ()),
        "",
        f"{len(cells)} devices; {len(both)} on which both recommend something"
        + (f", without: {', '.join(without)}." if without else "."),
        "",
        "## All devices",
        "",
        table(head, _rows(both)),
        "",
        "## Device by device",
        "",
        *_one_by_one(both),
        "",
        *_near(cells),
    ]
    PAGE.write_text("\n".join(lines).rstrip() + "\n", encoding="utf-8")


def _rows(both: list[dict[str, Any]]) -> Iterator[list[str]]:
    def row(name: str, value: Any, told: Any) -> list[str]:
        return [name, *(told(np.array([value(one[when], one) for one in both])) for when in ("before", "after"))]

    def spread(values: Any) -> str:
        return " / ".join(rounded(float(np.percentile(values, one))) for one in (50, 95, 100))

    def middle(values: Any) -> str:
        return " / ".join(f"{100 * float(np.percentile(values, one)):.1f}" for one in (50, 75, 95))

    def of(values: Any) -> str:
        return f"{int(values.sum())} of {HANDS * len(values)}, all on {int(np.sum(values == HANDS))} devices"

    yield row("processor, s: median / 95 % / worst", lambda one, _: one["cpu_s"], spread)
    yield row("wall time, s: median / 95 % / worst", lambda one, _: one["wall_s"], spread)
    yield row("settle", lambda one, _: one["plant"], of)
    yield row("settle without friction", lambda one, _: one["plant_without_friction"], of)
    as_told = of(np.array([one["after"]["plant_as_told_without_friction"] for one in both]))
    yield ["the same, as told", "-", as_told]
    for key, name in zip(PLANTS, ("settle", "settle without friction"), strict=True):
        in_the_end = np.array([one["after"][key.replace("plant", "plant_in_the_end")] for one in both])
        yield [f"{name} after {SLOWEST_S:g} s", "-", of(in_the_end)]
    at_rest = ("stiffness at rest, % of the wall: 50 / 75 / 95 % of devices", "at_rest_n_per_m")
    yield row(at_rest[0], lambda one, cell: one[at_rest[1]] / cell["wall_n_per_m"], middle)
    for place, hz in enumerate(TOLD_HZ):
        name = f"impedance error at {hz:g} Hz, %: 50 / 75 / 95 % of devices"
        yield row(name, lambda one, _, place=place: one["error"][place], middle)


def _one_by_one(both: list[dict[str, Any]]) -> Iterator[str]:
    stiffer = np.array([one["after"]["at_rest_n_per_m"] / one["before"]["at_rest_n_per_m"] for one in both])
    faster = np.array([one["after"]["cpu_s"] / one["before"]["cpu_s"] for one in both])
    softer = sorted(f"{100 * (1 - one):.0f} %" for one in stiffer if one < 0.95)
    yield (
        f"- at rest: median of after / before {np.median(stiffer):.3f}; stiffer by more than 5 % on "
        f"{int(np.sum(stiffer > 1.05))}, softer by more than 5 % on {len(softer)}"
        + (f" ({', '.join(softer)})." if softer else ".")
    )
    yield from _reasons(both)
    for place, hz in enumerate(TOLD_HZ):
        change = np.array([one["after"]["mismatch"][place] - one["before"]["mismatch"][place] for one in both])
        yield (
            f"- abs(ln(rendered/wall)) at {hz:g} Hz: smaller by more than 0.05 on {int(np.sum(change < -0.05))}, "
            f"larger by more than 0.05 on {int(np.sum(change > 0.05))}, else as before."
        )
    yield f"- processor time: median of after / before {np.median(faster):.2f}, less on {int(np.sum(faster < 1))}."


def _reasons(both: list[dict[str, Any]]) -> Iterator[str]:
    """Tell why this release takes the softer ones, by what it ranks by."""
    nearer, restless, lost = [], [], []
    for one in both:
        before, after = one["before"], one["after"]
        if not _softer(before, after):
            continue
        swings = f"{before['released_s']:g} s ({after['released_s']:g} s)"
        if before["trial_without_friction"] < TRIED + OTHERS:
            restless.append(f"{TRIED + OTHERS - before['trial_without_friction']}")
        elif after["distance"] <= before["distance"]:
            nearer.append(swings)
        else:
            lost.append(f"{after['distance'] - before['distance']:.2f}")
    yield (
        f"- why softer: on {len(nearer)} the other is farther from the wall, by mismatch from 1 to 30 Hz and time to "
        f"settle when released: {', '.join(nearer)}; on {len(restless)} some of {TRIED + OTHERS} hands do not settle "
        f"with it without friction: {', '.join(restless)}; on {len(lost)} the search found less, by a distance of: "
        f"{', '.join(lost)}."
    )


def _near(cells: Mapping[str, dict[str, Any]]) -> Iterator[str]:
    asked = {name: one for name, one in cells.items() if "neighbours" in one}
    if not asked:
        return
    change_of = "Change of the rendered stiffness, %, at rest / at 1 Hz / at 10 Hz, against the device itself."
    yield from ("## Neighbours", "", change_of, "")
    jumps, rows = [], []
    for name, one in asked.items():
        row = [name, one["after"]["method"]]
        for near in one["neighbours"].values():
            if near["method"] is None:
                row.append("none")
                continue
            pairs = zip(_rendered(near), _rendered(one["after"]), strict=True)
            change = [near_by / own - 1 for near_by, own in pairs]
            jumps.append(max(map(abs, change)))
            row.append(" / ".join(f"{100 * each:+.1f}" for each in change))
        rows.append(row)
    yield table(["device", "by", *NEIGHBOURS], rows)
    yield ""
    yield (
        f"{int(np.sum(np.array(jumps) <= 0.03))} of {len(jumps)} neighbours render within 3 % at rest, 1 and 10 Hz; "
        f"median {100 * np.median(jumps):.1f} %, worst {100 * max(jumps):.0f} %."
    )


def _rendered(one: Mapping[str, Any]) -> list[float]:
    return [one["at_rest_n_per_m"], *one["in_motion_n_per_m"]]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--before", type=Path, required=True, help="working tree of the other release")
    parser.add_argument("--count", type=int, default=200, help="devices (default: %(default)s)")
    parser.add_argument("--neighbours", type=int, default=20, help="of the first so many (default: %(default)s)")
    parser.add_argument("--known", type=Path, help="results of which those of the other release are taken")
    args = parser.parse_args()
    command = f"python tests/benchmarks/before_after.py --before CHECKOUT --count N --neighbours {args.neighbours}"
    command += "" if args.known is None else " --known FILE"
    head = ["git", "-C", str(args.before), "rev-parse", "--short", "HEAD"]
    commit = subprocess.run(head, capture_output=True, text=True, check=True).stdout.strip()  # noqa: S603
    known = {} if args.known is None else json.loads(args.known.read_text(encoding="utf-8"))
    if known and (known["about"]["before"], known["about"]["seed"]) != (commit, SEED):
        raise SystemExit(f"{args.known} is of {known['about']['before']}, seed {known['about']['seed']}")
    cells = {
        str(one): partial(cell, one, args.before.resolve(), one < args.neighbours, known.get("cells", {}))
        for one in range(args.count)
    }
    computed(cells, OUT, about(command, SEED) | {"before": commit}, write_page)


if __name__ == "__main__":
    main()
