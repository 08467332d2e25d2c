"""Charts of the page as JSON values: lines, bands and points; the page draws what it is given."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem
    from avc_casadi.simulation.run import Run

# Points of a trace: a lowest and a highest in each of half as many stretches.
_TRACE_POINTS = 1200
HZ = {"label": "frequency, Hz", "kind": "log"}


def chart(
    name: str,
    title: str,
    x: Mapping[str, Any],
    y: tuple[str, str],
    series: Sequence[Mapping[str, Any]],
    **more: Any,
) -> dict[str, Any]:
    """Return a chart: lines of values over x, with bands and points."""
    return {"id": name, "title": title, "x": x, "y": {"label": y[0], "kind": y[1]}, "series": series, **more}


def line(name: str, cls: str, x: Any, y: Any) -> dict[str, Any]:
    """Return a line of a chart; null where there is no value."""
    return {"name": name, "cls": cls, "x": short(x), "y": short(y)}


def short(values: Any) -> list[float | None]:
    """Return numbers to six significant digits; None where there is none."""
    flat = np.atleast_1d(np.asarray(values, dtype=np.float64)).tolist()
    return [float(f"{value:.6g}") if math.isfinite(value) else None for value in flat]


def region(
    problem: Problem, title: str, of: str, lines: Sequence[Mapping[str, Any]], pairs: Mapping[tuple[str, str], Any]
) -> dict[str, Any]:
    """Return a chart of stiffness over damping, with pairs of stiffness and damping by name and class."""
    b, k = problem.units.unit("N.s/m"), problem.units.unit("N/m")
    least = min(x for one in lines for x in one["x"])
    points = [
        {"name": name, "cls": cls, "x": max(damping, least), "y": stiffness}
        for (name, cls), (stiffness, damping) in pairs.items()
        if stiffness
    ]
    x, y = {"label": f"{of} damping, {b}", "kind": "log"}, (f"{of} stiffness, {k}", "log")
    return chart("region", title, x, y, lines, points=points, wide=True)


def touches(runs: Mapping[str, Run], problem: Problem, begins: str) -> list[dict[str, Any]]:
    """Return position and force of simulated touches over time, with their peaks kept."""
    names, time = {"own": "your k and b", "method": "coupling"}, {"label": "time, s", "kind": "linear"}
    position, force = [], []
    for cls, run in runs.items():
        kept = slice(0, run.samples_in_reach)
        rows = _peaks(run.force_n[kept], run.position_m[kept])
        name = f"{names[cls]}: {'settles' if run.claim == 'asymptotic' and not run.buzzing else 'does not settle'}"
        position.append(line(name, cls, run.time_s[kept][rows], 1e3 * run.position_m[kept][rows]))
        force.append(line(name, cls, run.time_s[kept][rows], run.force_n[kept][rows]))
    deepest = max((value for one in position for value in one["y"] if value is not None), default=0.0)
    span = [-deepest, 1.3 * deepest] if deepest > 0 else None
    if runs:
        first = next(iter(runs.values()))
        position.insert(0, line("target of the hand", "desired", first.time_s[::10], 1e3 * first.target_m[::10]))
    mm, newton, turns = problem.units.unit("mm"), problem.units.unit("N"), problem.units.key("force").capitalize()
    found = [
        chart("position", f"Simulated touch: position, {begins}", time, (mm, "linear"), position),
        chart("force", f"Simulated touch: {turns.lower()}", time, (newton, "linear"), force),
    ]
    found[0]["y"]["span"] = span
    return found


def _peaks(*traces: Any) -> Any:
    """Return the rows of each trace's lowest and highest value in every stretch; all rows of a short one."""
    samples = len(traces[0])
    if samples <= _TRACE_POINTS:
        return np.arange(samples)
    edges = np.linspace(0, samples, _TRACE_POINTS // (2 * len(traces)) + 1).astype(int)
    found = {0, samples - 1}
    for first, last in pairwise(edges.tolist()):
        for trace in traces:
            found |= {first + int(np.argmin(trace[first:last])), first + int(np.argmax(trace[first:last]))}
    return np.array(sorted(found))
