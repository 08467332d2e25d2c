"""Runs of a scene: position and force over time, force against penetration, energy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from avc_casadi.figures._style import WIDTH_INCHES, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from avc_casadi.scene import Run

_LINES: tuple[tuple[str, Any, float], ...] = (
    ("#08306b", "-", 1.6),
    ("#d1600a", (0, (5, 1.6)), 1.4),
    ("#5a5a00", (0, (4, 1.5, 1, 1.5)), 1.4),
    ("#8a0f5c", (0, (1, 1.4)), 1.6),
)
_OUTCOMES = {"asymptotic": "stable", "held-by-friction": "held by friction", "unstable": "unstable"}
# A run that flies off would flatten all others: axes follow it no further than this multiple of the target's travel.
_SHOWN_TRAVEL = 2.0


@styled
def draw_scene(runs: Sequence[Run], names: Sequence[str] | None = None) -> Figure:
    """Draw up to four runs of scenes with one motion in the same four panels.

    Args:
        runs: the runs, the one to be seen best first.
        names: what the legend calls them; None takes the coupling of each.
    """
    figure = Figure(figsize=(WIDTH_INCHES, 5.6), layout="constrained")
    (position, force), (loop, energy) = figure.subplots(2, 2)
    target = runs[0]
    position.plot(
        target.time_s, 1e3 * target.target_m, color="0.65", linewidth=2.4, label="target of the hand", zorder=1
    )
    labels = [run.coupling for run in runs] if names is None else list(names)
    for index, (run, name) in enumerate(zip(runs, labels, strict=True)):
        colour, style, width = _LINES[index % len(_LINES)]
        line: dict[str, Any] = {"color": colour, "linestyle": style, "linewidth": width, "zorder": 6 - index}
        if not run.stable:
            # Thousands of turns: a thin grey veil behind the others.
            line |= {"color": "0.55", "linestyle": "-", "linewidth": 0.35, "zorder": 2}
        label = f"{name}: {_OUTCOMES[run.claim]}{', buzzes' if run.buzzing else ''}"
        position.plot(run.time_s, 1e3 * run.position_m, label=label, **line)
        force.plot(run.time_s, run.force_n, **line)
        loop.plot(1e3 * run.position_m, run.force_n, **line)
        energy.plot(run.time_s, 1e3 * run.ledger.absorbed_j, **line)
    _limits(position, force, loop, energy, runs)
    for axes, title, x, y in (
        (position, "(a) position", "time (s)", "position (mm)"),
        (force, "(b) force on the device", "time (s)", "force (N)"),
        (loop, "(c) force against penetration", "position (mm)", "force (N)"),
        (energy, "(d) energy taken in by the virtual side", "time (s)", "energy (mJ)"),
    ):
        axes.set_title(title)
        axes.set_xlabel(x)
        axes.set_ylabel(y)
    for axes in (position, energy):
        axes.axhline(0, color="0.4", linewidth=0.7, zorder=0)
    loop.axvline(0, color="0.4", linewidth=0.7, zorder=0)
    handles, texts = position.get_legend_handles_labels()
    figure.legend(handles, texts, loc="outside lower center", ncols=2)
    return figure


def _limits(position: Axes, force: Axes, loop: Axes, energy: Axes, runs: Sequence[Run]) -> None:
    """Keep a diverging run from flattening the others."""
    calm = [run for run in runs if run.stable] or list(runs)
    travel = max(float(np.ptp(runs[0].target_m)), 1e-6)
    depth = [_finite(run.position_m) for run in runs]
    low = max(min(float(values.min()) for values in depth), runs[0].target_m.min() - _SHOWN_TRAVEL * travel)
    high = min(max(float(values.max()) for values in depth), runs[0].target_m.max() + _SHOWN_TRAVEL * travel)
    _span(position, 1e3 * low, 1e3 * max(high, float(runs[0].target_m.max())))
    pushing = [_finite(run.force_n) for run in calm]
    largest = 1.6 * max(float(np.abs(values).max(initial=0.0)) for values in pushing)
    lowest = min(float(values.min(initial=0.0)) for values in pushing)
    if largest > 0:
        _span(force, 1.6 * min(lowest, 0.0), largest)
        _span(loop, 1.6 * min(lowest, 0.0), largest)
    contact = [_finite(run.position_m[run.force_n != 0]) for run in calm]
    shown = [values for values in contact if values.size]
    if shown:
        near, far = min(float(v.min()) for v in shown), max(float(v.max()) for v in shown)
        room = max(far - near, 1e-9)
        loop.set_xlim(1e3 * (near - 0.3 * room), 1e3 * (far + 0.2 * room))
    taken = [_finite(run.ledger.absorbed_j) for run in calm]
    least, most = min(float(v.min()) for v in taken), max(float(v.max()) for v in taken)
    if most > least:
        _span(energy, 1e3 * min(least, -0.3 * most), 1e3 * 1.4 * most)


def _finite(values: Any) -> Any:
    return values[np.isfinite(values)]


def _span(axes: Axes, low: float, high: float) -> None:
    room = 0.05 * (high - low)
    axes.set_ylim(low - room, high + room)
