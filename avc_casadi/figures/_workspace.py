"""The stiffest wall over the workspace of a device of several axes, in a plane through its middle."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.figures._panels import GivenAxes, Panels
from avc_casadi.figures._style import styled

if TYPE_CHECKING:
    from collections.abc import Mapping

    from matplotlib.figure import Figure

    from avc_casadi.arm import WorkspaceMap
    from avc_casadi.support import FloatArray

_AXES = ("x", "y", "z")


@styled
def draw_workspace(maps: Mapping[str, WorkspaceMap], axes: GivenAxes = None) -> Figure:
    """Draw maps of the stiffest wall, a row each, a panel for each normal; grey is out of the mechanism's reach.

    Of a device in space a plane is drawn through the middle of the shortest side of the workspace.

    Args:
        maps: by what tells them apart, for the titles.
        axes: one axes a panel to draw in; None makes a figure.

    Raises:
        InputError: another number of axes.
    """
    labels = next(iter(maps.values())).labels
    names = [f"normal {label}" if label in _AXES else "any direction" for label in labels]
    titles = [f"{name}{': ' * bool(name)}{normal}" for name in maps for normal in names]
    panels = Panels.of(
        axes,
        titles,
        0.8 + 2.1 * len(maps),
        lambda figure: figure.subplots(len(maps), len(labels), sharex=True, sharey=True, squeeze=False).ravel(),
    )
    for row, found in enumerate(maps.values()):
        here = panels.axes[row * len(labels) : (row + 1) * len(labels)]
        sides, corner, slices = _plane(found)
        top = np.nanmax(found.stiffness_n_per_m) / 1e3
        for column, one in enumerate(here):
            one.set_facecolor("0.85")
            drawn = one.pcolormesh(
                1e3 * corner[0], 1e3 * corner[1], slices[column].T / 1e3, vmin=0.0, vmax=top, cmap="viridis"
            )
            one.grid(visible=False)
            if panels.own:
                one.set_aspect("equal")
            one.set_xlabel(f"{sides[0]} (mm)")
            if column == 0:
                one.set_ylabel(f"{sides[1]} (mm)")
        if panels.own:
            panels.figure.colorbar(drawn, ax=list(here), label="stiffest wall (kN/m)", shrink=0.9)
    return panels.figure


def _plane(found: WorkspaceMap) -> tuple[tuple[str, str], tuple[FloatArray, FloatArray], list[FloatArray]]:
    """Return the names of two sides, the grid along them (m), and the stiffness of each normal over them."""
    d = len(found.counts)
    whole = found.stiffness_n_per_m.reshape(*found.counts, len(found.labels))
    places = found.points_m.reshape(*found.counts, d)
    across = int(np.argmin(np.ptp(found.points_m, axis=0))) if d == 3 else None
    left = [axis for axis in range(d) if axis != across]
    if across is not None:
        middle = found.counts[across] // 2
        whole, places = np.take(whole, middle, axis=across), np.take(places, middle, axis=across)
    grid = places[:, 0, left[0]], places[0, :, left[1]]
    sides = _AXES[left[0]], _AXES[left[1]]
    return sides, grid, [whole[..., column] for column in range(len(found.labels))]
