"""The paper's figure 3: the range of impedance that feels real."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.figures._panels import GivenAxes, Panels
from avc_casadi.figures._style import (
    DESIRED,
    IMPEDANCE_UNIT,
    LOWER,
    NO_COUPLING,
    PERCEIVED,
    UPPER,
    frequency_axis,
    styled,
    value_axis,
)
from avc_casadi.support import FloatArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from avc_casadi.study.comparison import Comparison


@styled
def draw_boundaries(comparison: Comparison, axes: GivenAxes = None) -> Figure:
    """Draw |Z_h| of the bounds U and L, the desired impedance and no coupling, in N.s/m and relative to the desired.

    Args:
        comparison: what is drawn.
        axes: 2 axes to draw in, row by row; None makes a figure.

    Raises:
        InputError: another number of axes.
    """
    frequency = comparison.frequency_hz
    titles = ("(a) perceived impedance", "(b) relative to the desired impedance")
    panels = Panels.of(axes, titles, 3.4, lambda figure: figure.subplots(1, 2))
    size, share = panels.axes
    curves = (
        (DESIRED, comparison.target),
        (NO_COUPLING, comparison.without_coupling),
        (UPPER, comparison.upper),
        (LOWER, comparison.lower),
    )
    desired = np.abs(comparison.target)
    shares: list[FloatArray] = []
    sizes: list[FloatArray] = []
    for line, impedance in curves:
        sizes.append(np.abs(impedance))
        line.draw(size, frequency, sizes[-1])
        with np.errstate(divide="ignore", invalid="ignore"):
            shares.append(100 * np.abs(impedance) / desired)
        line.draw(share, frequency, shares[-1])
    with np.errstate(divide="ignore", invalid="ignore"):
        share.fill_between(
            frequency,
            100 * np.abs(comparison.lower) / desired,
            100 * np.abs(comparison.upper) / desired,
            color="0.93",
            zorder=1,
            label="feels real",
        )
    value_axis(share, *shares)
    value_axis(size, *sizes)
    size.set_ylabel(f"{PERCEIVED} ({IMPEDANCE_UNIT})")
    share.set_ylabel(f"{PERCEIVED} / desired (%)")
    for panel in (size, share):
        frequency_axis(panel, frequency)
    handles, labels = share.get_legend_handles_labels()
    panels.legend(handles, labels, len(labels))
    return panels.figure
