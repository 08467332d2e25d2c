"""The stiffest wall over the workspace of a device of several axes, in a plane through its middle."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import BoundaryNorm
from matplotlib.patches import Patch

from avc_casadi.figures._panels import GivenAxes, Panels
from avc_casadi.figures._style import styled

if TYPE_CHECKING:
    from collections.abc import Mapping

    from matplotlib.figure import Figure

    from avc_casadi.arm import WorkspaceMap
    from avc_casadi.support import FloatArray

_AXES = ("x", "y", "z")
_COLOURS = 12


@styled
def draw_workspace(maps: Mapping[str, WorkspaceMap], axes: GivenAxes = None) -> Figure:
    """Draw maps of the stiffest wall, a row each, a panel for each normal; grey is out of the mechanism's reach.

    Of a device in space a plane is drawn through the middle of the shortest side of the workspace; its place is told.

    Args:
        maps: by what tells them apart, for the titles.
        axes: one axes a panel to draw in; None makes a figure.

    Raises:
        InputError: another number of axes.
    """
    labels = next(iter(maps.values())).labels
    names = [f"normal {label}" if label in _AXES else "any direction" for label in labels]
    titles = [f"{name}\n{normal}" if name else normal for name in maps for normal in names]
    panels = Panels.of(
        axes,
        titles,
        1.5 + 1.7 * len(maps),
        lambda figure: figure.subplots(len(maps), len(labels), sharex=True, sharey=True, squeeze=False).ravel(),
    )
    planes = [_plane(found) for found in maps.values()]
    whole = np.concatenate([part.ravel() for _, _, parts, _ in planes for part in parts])
    colours, levels = _levels(whole[np.isfinite(whole)] / 1e3)
    for row, (sides, grid, parts, section) in enumerate(planes):
        for column, (one, part) in enumerate(
            zip(panels.axes[row * len(labels) : (row + 1) * len(labels)], parts, strict=True)
        ):
            one.set_facecolor("0.85")
            one.pcolormesh(1e3 * grid[0], 1e3 * grid[1], part.T / 1e3, norm=levels, cmap=colours)
            one.grid(visible=False)
            if panels.own:
                one.set_aspect("equal")
            # A colour stands for a place of the grid; nothing is said of what lies beyond the workspace.
            one.set_xlim(1e3 * grid[0][0], 1e3 * grid[0][-1])
            one.set_ylim(1e3 * grid[1][0], 1e3 * grid[1][-1])
            if row == len(maps) - 1:
                one.set_xlabel(f"{sides[0]} (mm){section}")
            if column == 0:
                one.set_ylabel(f"{sides[1]} (mm)")
    ends = levels.boundaries
    handles = [Patch(color=colours(index)) for index in range(len(ends) - 1)]
    spans = [f"{low:.3g} to {high:.3g} kN/m" for low, high in pairwise(ends)]
    panels.legend(handles, spans, 4, "stiffest wall of a spring and damper, every hand and let go, along the normal")
    return panels.figure


def _levels(stiffness_kn_per_m: FloatArray) -> tuple[Any, BoundaryNorm]:
    """Return colours of even ratios from the softest wall to the stiffest."""
    low, high = float(stiffness_kn_per_m.min()), float(stiffness_kn_per_m.max())
    ends = np.geomspace(0.999 * low, 1.001 * high, _COLOURS + 1)
    return colormaps["viridis"].resampled(_COLOURS), BoundaryNorm(ends, _COLOURS)


def _plane(found: WorkspaceMap) -> tuple[tuple[str, str], tuple[FloatArray, FloatArray], list[FloatArray], str]:
    """Return the names of two sides, the grid along them (m), the stiffness of each normal, and where the plane is."""
    d = len(found.counts)
    whole = found.stiffness_n_per_m.reshape(*found.counts, len(found.labels))
    places = found.points_m.reshape(*found.counts, d)
    across = int(np.argmin(np.ptp(found.points_m, axis=0))) if d == 3 else None
    left = [axis for axis in range(d) if axis != across]
    section = ""
    if across is not None:
        middle = found.counts[across] // 2
        whole, places = np.take(whole, middle, axis=across), np.take(places, middle, axis=across)
        section = f", at {_AXES[across]} = {1e3 * float(places[0, 0, across]) + 0.0:.3g} mm"
    grid = places[:, 0, left[0]], places[0, :, left[1]]
    sides = _AXES[left[0]], _AXES[left[1]]
    return sides, grid, [whole[..., column] for column in range(len(found.labels))], section
