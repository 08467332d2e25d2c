"""What a wall that is stiffer at rest costs in motion: kinds of couplings at walls from a tenth of the wanted one up.

    OPENBLAS_NUM_THREADS=1 python tests/benchmarks/trade_off.py

For figure5 and the three reference devices. Overwrites results/trade_off.json, RESULTS_trade_off.md and
figures/trade_off.png after every problem and goes on where it stopped; two to five minutes of processor a problem.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib as mpl
from script_arguments import script_arguments
from studied import about, computed, made_by, rounded, table

import avc_casadi as avc
from avc_casadi.claims.deployable import deployable
from avc_casadi.claims.stability.stiffest_wall import stiffest_wall
from avc_casadi.claims.stability.transient import transients
from avc_casadi.coupling import Coupling
from avc_casadi.design.robust.goal import BAND_HZ, distance
from avc_casadi.model.hands import hand_corners, with_released
from avc_casadi.model.problem import Problem
from avc_casadi.recommendation.generate import (
    behind_observers,
    plain_candidates,
    softened_to,
    static_stiffness_n_per_m,
)
from avc_casadi.recommendation.shaken import shaken
from avc_casadi.simulation.population.coupling_trial import try_coupling
from avc_casadi.simulation.population.operators import draw_hands, people_of

SEED, PEOPLE, FRESH = 3107, 100, 200
PROBLEMS = ("figure5", "reference-r1", "reference-r2", "reference-r3")
SHARES = (0.1, 0.2, 0.35, 0.5, 0.7, 1.0)
HERE = Path(__file__).parent
OUT, PAGE = HERE / "results" / "trade_off.json", HERE / "RESULTS_trade_off.md"
FIGURE = HERE / "figures" / "trade_off.png"
MARKERS = {"spring and damper": "s", "contact damper": "^", "adaptive schedule": "D", "recommended": "o"}
Kind = Callable[[Problem, Problem], Iterator[Coupling]]


def _springs(wanted: Problem, softer: Problem) -> Iterator[Coupling]:
    corners, felt = hand_corners(wanted.hands), softer.environment.stiffness_n_per_m
    for one in softened_to(wanted, corners, felt):
        yield from (coupling for coupling in one if coupling.runtime.observer_mass_kg is None)


def _contact_dampers(_: Problem, softer: Problem) -> Iterator[Coupling]:
    corners = hand_corners(softer.hands)
    limit = stiffest_wall(softer.device, with_released(corners))
    rigid = [one for one in plain_candidates(softer, corners, limit) if one[0].method in {"none", "contact damper"}]
    for one in (*rigid, *behind_observers(rigid)):
        yield from one


def _schedule(_: Problem, softer: Problem) -> Iterator[Coupling]:
    problem = softer.changed(stability={"model": "sampled-data", "scope": "hands"})
    yield Coupling.of(problem, avc.solve(problem, "schedule"))


def _recommended(_: Problem, softer: Problem) -> Iterator[Coupling]:
    found = avc.recommend(softer, hands=PEOPLE, seed=SEED, workers=2).coupling
    if isinstance(found, Coupling):
        yield found


KINDS: dict[str, Kind] = {
    "spring and damper": _springs,
    "contact damper": _contact_dampers,
    "adaptive schedule": _schedule,
    "recommended": _recommended,
}


def cell(name: str) -> dict[str, Any]:
    """Return what each kind renders of each wall of a problem, None where no coupling of it holds all hands."""
    wanted = avc.load_problem(name)
    wall = wanted.environment.stiffness_n_per_m
    found: dict[str, Any] = {"wall_n_per_m": wall}
    for kind, couplings in KINDS.items():
        found[kind] = {}
        for share in SHARES:
            softer = _softer(wanted, share)
            fared = [one for coupling in couplings(wanted, softer) if (one := _fared(wanted, coupling)) is not None]
            found[kind][f"{share:g}"] = min(fared, key=lambda one: one["distance"], default=None)
    return found


def _softer(wanted: Problem, share: float) -> Problem:
    """Return the problem with a share of its wall, bounds of what feels real that are declared likewise."""

    def of(one: Any) -> dict[str, float] | None:
        return None if one is None else {key: share * value for key, value in vars(one).items()}

    bounds = wanted.boundaries
    changed: dict[str, Any] = {"environment": of(wanted.environment)}
    if bounds.upper is not None:
        changed["boundaries"] = {"upper": of(bounds.upper), "lower": of(bounds.lower)}
    return wanted.changed(**changed)


def _fared(wanted: Problem, coupling: Coupling) -> dict[str, Any] | None:
    if not deployable(coupling).passed:
        return None
    people = people_of(wanted.hands, PEOPLE, SEED)
    if not try_coupling(coupling, people, SEED).stable_without_friction.all():
        return None
    others = try_coupling(coupling, draw_hands(wanted.hands, FRESH, SEED), SEED)
    at_rest = static_stiffness_n_per_m(coupling)
    band = shaken(coupling, at_rest, BAND_HZ, wanted=wanted)
    told = shaken(coupling, at_rest, wanted=wanted)
    mismatch = math.sqrt(float((band.mismatch**2).mean()))
    return {
        "method": coupling.method,
        "at_rest_n_per_m": at_rest,
        "error": told.error.tolist(),
        "stiffness_n_per_m": told.stiffness_n_per_m.tolist(),
        "distance": distance(mismatch, transients(coupling)[0].settling_s),
        "fresh_settled": int(others.stable_without_friction.sum()),
    }


def write_page(document: dict[str, Any]) -> None:
    """Write the page and its picture from the results file."""
    cells = {name: one for name, one in document["cells"].items() if "error" not in one}
    lines = [
        "# Stiff at rest or true in motion",
        "",
        made_by(document["about"]),
        "",
        "Each kind of coupling, designed for walls from a tenth of the wanted one up to it, judged against the wanted",
        "one: stiffness at rest, % of the wall, then the impedance error at 1 / 10 Hz, %, of a shaken handle. A row",
        "has the coupling nearest to the wall in motion of those that are deployable and with which",
        f"{PEOPLE} hands settle without friction; in brackets, where it is not all, how many of {FRESH} fresh ones do.",
        "A dash: there is none. **Contact damper**: the softer wall rendered directly, observers included. **Spring",
        "and damper**: before the wanted wall. **Adaptive schedule**: gains that follow the frequency, for the softer",
        "wall, of which the stiffness at rest is that at the lowest frequency. **Recommended**: what",
        "`avc recommend` answers for the softer wall.",
        "",
        "![Stiffness at rest and impedance error](figures/trade_off.png)",
        "",
    ]
    for name, one in cells.items():
        rows = [[f"{100 * share:g} %", *(_shown(one, kind, share) for kind in KINDS)] for share in SHARES]
        lines += [f"## {name}: {rounded(one['wall_n_per_m'] / 1e3)} kN/m", "", table(["wall", *KINDS], rows), ""]
    PAGE.write_text("\n".join(lines).rstrip() + "\n", encoding="utf-8")
    _draw(cells)


def _shown(one: Mapping[str, Any], kind: str, share: float) -> str:
    found = one[kind][f"{share:g}"]
    if found is None:
        return "-"
    at_rest = rounded(100 * found["at_rest_n_per_m"] / one["wall_n_per_m"], 2)
    errors = " / ".join(rounded(100 * each, 2) for each in found["error"][:2])
    fewer = "" if found["fresh_settled"] == FRESH else f" ({found['fresh_settled']})"
    by = f", {found['method']}" if kind == "recommended" else ""
    return f"{at_rest}; {errors}{fewer}{by}"


def _draw(cells: Mapping[str, Mapping[str, Any]]) -> None:
    mpl.use("Agg")
    import matplotlib.pyplot as plt  # noqa: PLC0415 - after the backend is chosen

    colours = dict(zip(KINDS, ("#3566a8", "#7a7a7a", "#e1903e", "#2a8f5c"), strict=True))
    figure, grid = plt.subplots(2, len(PROBLEMS), figsize=(11.0, 5.2), layout="constrained", sharex=True, sharey=True)
    for column, (name, one) in enumerate(cells.items()):
        for row, hz in enumerate((1, 10)):
            axes = grid[row][column]
            for kind, colour in colours.items():
                found = [each for each in one[kind].values() if each is not None]
                x = [100 * each["at_rest_n_per_m"] / one["wall_n_per_m"] for each in found]
                y = [100 * each["error"][row] for each in found]
                axes.plot(x, y, "-", marker=MARKERS[kind], color=colour, mfc="none", ms=7, lw=1.2, label=kind)
            axes.set(xlim=(0, 105), ylim=(0, 100))
            axes.grid(alpha=0.25)
            axes.spines[["top", "right"]].set_visible(False)
            axes.set_title(f"{name}, {hz} Hz", fontsize=9)
    figure.supxlabel("stiffness at rest (% of the wall)", fontsize=9)
    figure.supylabel("impedance error (%)", fontsize=9)
    grid[0][0].legend(fontsize=8)
    figure.savefig(FIGURE, dpi=110)
    plt.close(figure)


def main() -> None:
    script_arguments(__doc__)
    command = "python tests/benchmarks/trade_off.py"
    computed({name: partial(cell, name) for name in PROBLEMS}, OUT, about(command, SEED), write_page)


if __name__ == "__main__":
    main()
