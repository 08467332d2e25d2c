"""Runs of one scene side by side: what the hand does, what the wall answers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.figures._panels import GivenAxes, Panels
from avc_casadi.figures._style import styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from avc_casadi.scene import Run

_COLOURS = ("#d1600a", "#5a5a00", "#08306b")


@styled
def draw_traces(
    runs: Mapping[str, Run], axes: GivenAxes = None, *, from_s: float = 0.0, deepest_mm: float = 1.6
) -> Figure:
    """Draw penetration and force of each run, with its verdict, and its stiffness or the force that leaves the axis.

    Args:
        runs: at most three runs by name.
        axes: axes to draw in, two for each run: all positions, then all forces; None makes a figure.
        from_s: where the time axis begins.
        deepest_mm: extent of the axis of penetration either way; what leaves it is cut.

    Raises:
        InputError: another number of axes.
    """
    titles = [f"({'abc'[column]}) {name}\n{_verdict(run)}" for column, (name, run) in enumerate(runs.items())]
    count = len(runs)
    panels = Panels.of(
        axes,
        [*titles, *[""] * count],
        4.2,
        lambda figure: figure.subplots(2, count, sharex=True, sharey="row", squeeze=False).ravel(),
    )
    strongest = 0.0
    for column, run in enumerate(runs.values()):
        above, below = panels.axes[column], panels.axes[count + column]
        shown = run.time_s >= from_s
        time, depth, force = run.time_s[shown], 1e3 * run.position_m[shown], run.force_n[shown]
        colour = _COLOURS[column % len(_COLOURS)]
        above.axhspan(0, deepest_mm, color="0.93", zorder=0)
        above.axhline(0, color="0.5", linewidth=0.8, zorder=1)
        above.plot(time, np.clip(depth, -2 * deepest_mm, 2 * deepest_mm), color=colour, linewidth=1.0)
        below.plot(time, force, color=colour, linewidth=1.0)
        below.axhline(0, color="0.5", linewidth=0.8, zorder=1)
        below.set_xlabel("time (s)")
        if run.stable:
            strongest = max(strongest, float(np.abs(force).max()))
    for panel in panels.axes:
        panel.set_xlim(from_s, next(iter(runs.values())).time_s[-1])
    for above, below in zip(panels.axes[:count], panels.axes[count:], strict=True):
        above.set_ylim(deepest_mm, -deepest_mm)
        below.set_ylim(-0.15 * strongest, 1.6 * strongest)
    panels.axes[0].set_ylabel("position (mm),\ngrey: wall")
    panels.axes[count].set_ylabel("force (N)")
    return panels.figure


def _verdict(run: Run) -> str:
    if not run.stable:
        return f"unstable, up to {np.abs(run.force_n).max():.3g} N"
    return f"stable, {run.apparent_stiffness_n_per_m / 1e3:.1f} kN/m"
