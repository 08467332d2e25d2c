"""The region of two numbers of a stated law."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from avc_casadi.claims.law_region import LawRegion
from avc_casadi.model.unit_text import unit_of_key
from avc_casadi.present.figures import style

_VIEW = 2.0
"""How far the axis of the second number reaches beyond what is shown, as a factor."""


@style.styled
def draw_law_region(region: LawRegion) -> Figure:
    """Draw the stable values of one number of a law over those of another, and the law as it is."""
    figure = style.panels(("stable with every hand and released",), 4.4)
    (plane,) = figure.axes
    units = region.problem.units
    own_over, own_of = region.own
    edges = np.abs(np.concatenate([region.least, region.largest, [own_of]]))
    shown = edges[np.isfinite(edges) & (edges > 0)]
    low, high = float(shown.min()) / _VIEW, float(shown.max()) * _VIEW
    over, sign = np.abs(region.values), np.sign(own_of)
    bottom, top = np.clip(sign * region.least, low, high), np.clip(sign * region.largest, low, high)
    inside = np.isfinite(region.least)
    plane.fill_between(over, bottom, top, where=inside, color=style.BLUE, alpha=0.25, linewidth=0, label="stable")
    plane.plot(over, bottom, color=style.BLUE, linewidth=1.6)
    plane.plot(over, top, color=style.BLUE, linewidth=1.6)
    look: dict[str, Any] = {"markersize": 11, "color": "#b2182b", "markeredgecolor": "white"}
    plane.plot(abs(own_over), abs(own_of), "*", label="the law as it is", **look)
    plane.set(xscale="log", yscale="log", xlim=(float(over.min()), float(over.max())), ylim=(low, high))

    def label(key: str) -> str:
        unit = unit_of_key(units.key(key), units)
        return f"{units.key(key)} ({unit})" if unit else units.key(key)

    plane.set(xlabel=label(region.over), ylabel=label(region.of))
    return style.with_legend(figure, 2)
