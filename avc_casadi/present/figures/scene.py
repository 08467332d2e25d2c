"""Simulated runs of a scene: position and force over time, force against penetration, energy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi.present.figures.style import GivenAxes, Panels, entries_of, styled

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
# An unstable run would flatten all others: axes follow it no further than this multiple of the target's travel.
_SHOWN_TRAVEL = 2.0
# Room above the settled runs, in which one that does not settle is seen to leave.
_VEIL_ROOM = 1.6


@styled
def draw_scene(runs: Sequence[Run], names: Sequence[str] | None = None, axes: GivenAxes = None) -> Figure:
    """Draw up to four runs of scenes with one motion in the same four panels."""
    units = runs[0].units
    force_word, mm, newton = units.key("force"), units.unit("mm"), units.unit("N")
    titles = (
        "(a) position; the wall begins at 0",
        f"(b) {force_word} on the device",
        f"(c) {force_word} against penetration",
        "(d) energy taken in by the virtual side",
    )
    panels = Panels.of(axes, titles, 5.6, lambda figure: figure.subplots(2, 2).ravel())
    position, force, loop, energy = panels.axes
    target = runs[0]
    aim = f"target of the hand, up to {1e3 * target.target_m.max():.3g} {mm}"
    position.plot(target.time_s, 1e3 * target.target_m, color="0.65", linewidth=2.4, label=aim, zorder=1)
    labels = [run.coupling for run in runs] if names is None else list(names)
    some_rest = any(run.stable for run in runs)
    for index, (run, name) in enumerate(zip(runs, labels, strict=True)):
        colour, style, width = _LINES[index % len(_LINES)]
        line: dict[str, Any] = {"color": colour, "linestyle": style, "linewidth": width, "zorder": 6 - index}
        if not run.stable:
            # Thousands of cycles: a thin line, and a grey veil behind the runs that settle.
            line |= {"linestyle": "-", "linewidth": 0.35} | ({"color": "0.55", "zorder": 2} if some_rest else {})
        label = f"{name}: {_OUTCOMES[run.claim]}{', buzzes' if run.buzzing else ''}"
        kept = slice(0, run.samples_in_reach)
        time, x = run.time_s[kept], 1e3 * run.position_m[kept]
        position.plot(time, x, label=label, **line)
        force.plot(time, run.force_n[kept], **line)
        loop.plot(x, run.force_n[kept], **line)
        energy.plot(time, 1e3 * run.ledger.absorbed_j[kept], **line)
    _limits(position, force, loop, energy, runs)
    for panel, x_label, y_label in (
        (position, "time (s)", f"position ({mm})"),
        (force, "time (s)", f"{force_word} ({newton})"),
        (loop, f"penetration ({mm})", f"{force_word} ({newton})"),
        (energy, "time (s)", "energy (mJ)"),
    ):
        panel.set_xlabel(x_label)
        panel.set_ylabel(y_label)
    for panel in (position, energy):
        panel.axhline(0, color="0.4", linewidth=0.7, zorder=0)
    loop.axvline(0, color="0.4", linewidth=0.7, zorder=0)
    loop.locator_params(axis="x", nbins=5)
    panels.legend(entries_of(position), 2)
    return panels.figure


def _limits(position: Axes, force: Axes, loop: Axes, energy: Axes, runs: Sequence[Run]) -> None:
    """Keep a run that does not settle from flattening the others."""
    calm = [run for run in runs if run.stable] or list(runs)
    above = _VEIL_ROOM if any(run not in calm for run in runs) else 1.0
    aim = runs[0].target_m
    travel = _SHOWN_TRAVEL * max(float(np.ptp(aim)), 1e-6)
    depth = np.concatenate([run.position_m[: run.samples_in_reach] for run in runs] + [aim])
    shown = depth[np.abs(depth - np.clip(depth, aim.min(), aim.max())) <= travel]
    contact = np.concatenate([_contact(run) for run in calm])
    deepest = float(contact.max(initial=0.0))
    if 0 < deepest < shown.max():  # the wall's surface and its inside, not the target of the hand
        _span(position, 1e3 * max(-deepest, min(run.position_m.min() for run in runs)), 1.3e3 * deepest)
    else:
        _span(position, 1e3 * shown.min(), 1e3 * shown.max())
    pushing = np.concatenate([run.force_n[: run.samples_in_reach] for run in calm])
    lowest, largest = min(above * pushing.min(), 0.0), max(above * pushing.max(), 0.0)
    for axes in (force, loop):
        _span(axes, lowest, largest)
    if contact.size:
        room = max(float(np.ptp(contact)), 1e-9)
        loop.set_xlim(1e3 * (contact.min() - 0.3 * room), 1e3 * (contact.max() + 0.2 * room))
    taken = np.concatenate([run.ledger.absorbed_j[: run.samples_in_reach] for run in calm])
    least = min(taken.min(), -0.3 * taken.max()) if above > 1 else taken.min()
    _span(energy, 1e3 * least, 1e3 * above * taken.max())


def _contact(run: Run) -> Any:
    reached = slice(0, run.samples_in_reach)
    return run.position_m[reached][run.force_n[reached] != 0]


def _span(axes: Axes, low: float, high: float) -> None:
    """Show a range with some room; an axis without any range keeps matplotlib's."""
    if high > low:
        room = 0.05 * (high - low)
        axes.set_ylim(low - room, high + room)
