"""Simulated runs of a scene: position and force over time, force against penetration, energy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi.present.figures.style import GivenAxes, Panels, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from avc_casadi.simulation.run import Run

_LINES: tuple[tuple[str, Any, float], ...] = (
    ("#08306b", "-", 1.6),
    ("#d1600a", (0, (5, 1.6)), 1.4),
    ("#5a5a00", (0, (4, 1.5, 1, 1.5)), 1.4),
    ("#8a0f5c", (0, (1, 1.4)), 1.6),
)
_OUTCOMES = {"asymptotic": "stable", "held-by-friction": "held by friction", "unstable": "unstable"}
# Axes follow an unstable run no further than this multiple of the target's travel beyond it.
_SHOWN_TRAVEL = 2.0
# Room above the settled runs, in which one that does not settle is seen to leave.
_ROOM = 1.6


@styled
def draw_scene(runs: Sequence[Run], names: Sequence[str] | None = None, axes: GivenAxes = None) -> Figure:
    """Draw up to four runs of scenes with one motion in the same four panels."""
    units, aim = runs[0].units, runs[0].target_m
    force_word, mm, newton = units.key("force"), units.unit("mm"), units.unit("N")
    titles = (
        "(a) position; the wall begins at 0",
        f"(b) {force_word} on the device",
        f"(c) {force_word} against penetration",
        "(d) energy taken in by the virtual side",
    )
    panels = Panels.of(axes, titles, 5.6, "ab;cd")
    position, force, loop, energy = panels.axes
    label = f"target of the hand, up to {1e3 * aim.max():.3g} {mm}"
    position.plot(runs[0].time_s, 1e3 * aim, color="0.65", linewidth=2.4, label=label, zorder=1)
    labels = [run.coupling for run in runs] if names is None else list(names)
    some_rest = any(run.stable for run in runs)
    for index, (run, name) in enumerate(zip(runs, labels, strict=True)):
        colour, style, width = _LINES[index % len(_LINES)]
        line: dict[str, Any] = {"color": colour, "linestyle": style, "linewidth": width, "zorder": 6 - index}
        if not run.stable:
            # Thousands of cycles: a thin line, and a grey veil behind the runs that settle.
            line |= {"linestyle": "-", "linewidth": 0.35} | ({"color": "0.55", "zorder": 2} if some_rest else {})
        label = f"{name}: {_OUTCOMES[run.claim]}{', buzzes' if run.buzzing else ''}"
        time, x, pushing, taken = (values[: run.samples_in_reach] for values in _traces(run))
        position.plot(time, x, label=label, **line)
        force.plot(time, pushing, **line)
        loop.plot(x, pushing, **line)
        energy.plot(time, taken, **line)
    _limits(panels.axes, runs)
    position.set(xlabel="time (s)", ylabel=f"position ({mm})")
    force.set(xlabel="time (s)", ylabel=f"{force_word} ({newton})")
    loop.set(xlabel=f"penetration ({mm})", ylabel=f"{force_word} ({newton})")
    energy.set(xlabel="time (s)", ylabel="energy (mJ)")
    for panel in (position, energy):
        panel.axhline(0, color="0.4", linewidth=0.7, zorder=0)
    loop.axvline(0, color="0.4", linewidth=0.7, zorder=0)
    loop.locator_params(axis="x", nbins=5)
    panels.legend(2)
    return panels.figure


def _traces(run: Run) -> tuple[Any, ...]:
    """Return time, position, force and energy of a run: s, mm, N, mJ."""
    return run.time_s, 1e3 * run.position_m, run.force_n, 1e3 * run.ledger.absorbed_j


def _limits(panels: Sequence[Axes], runs: Sequence[Run]) -> None:
    """Keep a run that does not settle from flattening the others."""
    position, force, loop, energy = panels
    calm = [run for run in runs if run.stable] or list(runs)
    room, aim = _ROOM if len(calm) < len(runs) else 1.0, 1e3 * runs[0].target_m
    traces = zip(*([values[: run.samples_in_reach] for values in _traces(run)] for run in calm), strict=True)
    _, depth, pushing, taken = (np.concatenate(each) for each in traces)
    travel = _SHOWN_TRAVEL * max(float(np.ptp(aim)), 1e-3)
    depth = np.clip(depth, aim.min() - travel, aim.max() + travel)
    contact = depth[pushing != 0]
    lowest, deepest = min(depth.min(), aim.min()), float(contact.max(initial=0.0))
    if deepest > 0:  # the wall's surface and its inside, not the target of the hand
        _span(position, max(-deepest, lowest), 1.3 * deepest)
        wide = max(float(np.ptp(contact)), 1e-6)
        loop.set_xlim(contact.min() - 0.3 * wide, contact.max() + 0.2 * wide)
    else:
        _span(position, lowest, max(depth.max(), aim.max()))
    for axes in (force, loop):
        _span(axes, room * min(pushing.min(), 0.0), room * max(pushing.max(), 0.0))
    _span(energy, min(taken.min(), -0.3 * taken.max() * (room - 1)), room * taken.max())


def _span(axes: Axes, low: float, high: float) -> None:
    """Show a range with some room; an axis without any range keeps matplotlib's."""
    if high > low:
        axes.set_ylim(low - 0.05 * (high - low), high + 0.05 * (high - low))
