"""The comparison of the methods: errors against frequency and a strip of verdicts."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.patches import Patch

from avc_casadi._util.arrays import FloatArray
from avc_casadi.present.figures.style import (
    MINE,
    PERCEIVED,
    GivenAxes,
    Panels,
    entries_of,
    frequency_axis,
    log_ticks,
    method_lines,
    styled,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from avc_casadi.design.comparison.comparison import Comparison


# Smaller errors, in per cent, are drawn on this line: they are rounding, imperceptible to a hand.
_ROUNDING = 1e-9
_UNNOTICED = 1e-2

_VERDICTS = {
    "agree": ("methods agree", "0.97", ""),
    "direct-better": ("optimiser better", "0.82", "...."),
    "closed-form-not-realisable": ("closed form not realisable", "0.66", "////"),
    "bound-active": ("bound active", "0.9", "||||"),
    "infeasible": ("infeasible", "0.25", "xxxx"),
}


@styled
def draw_comparison(comparison: Comparison, axes: GivenAxes = None) -> Figure:
    """Draw the magnitude error, the impedance error and the verdict at each frequency."""
    titles = (
        "(a) the goal (11); 1e-9 % and less is rounding",
        f"(b) magnitude and phase; {_UNNOTICED:g} % and less drawn as such",
        "(c) verdict, pointwise",
    )
    panels = Panels.of(axes, titles, 6.2, lambda figure: figure.subplots(3, 1, height_ratios=[3, 3, 0.5]))
    magnitude, complex_, strip = panels.axes
    size = np.abs(comparison.target)
    errors: list[tuple[str, FloatArray, FloatArray]] = [
        (name, gains.magnitude_error, gains.complex_error) for name, gains in comparison.methods.items()
    ]
    lines = method_lines(comparison)
    if comparison.mine is not None:
        errors.append(("mine", comparison.mine.magnitude_error, comparison.mine.complex_error))
        lines["mine"] = MINE
    for name, magnitude_error, complex_error in errors:
        with np.errstate(divide="ignore", invalid="ignore"):
            share = 100 * magnitude_error / size
        given = comparison.methods.get(name)
        usable = np.ones(len(share), dtype=bool) if given is None else given.usable
        for panel, error, floor in ((magnitude, share, _ROUNDING), (complex_, 100 * complex_error, _UNNOTICED)):
            shown = np.maximum(error, floor)
            lines[name].draw_where(usable, panel, comparison.frequency_hz, shown)
    for panel, floor, label in (
        (magnitude, _ROUNDING, f"error of {PERCEIVED} (%)"),
        (complex_, _UNNOTICED, "impedance error (%)"),
    ):
        panel.set_yscale("log")
        panel.set_ylim(floor / 3, max(panel.get_ylim()[1], 1.0))
        log_ticks(panel.yaxis, *panel.get_ylim())
        frequency_axis(panel, comparison.frequency_hz, label=False)
        panel.set_ylabel(label)
    patches = _verdicts(strip, comparison, magnitude.get_xlim())
    panels.legend(entries_of(magnitude) | {str(patch.get_label()): patch for patch in patches}, 3)
    return panels.figure


def _verdicts(axes: Axes, comparison: Comparison, ends: tuple[float, float]) -> list[Patch]:
    """Draw one band for each run of equal verdicts, from end to end of the axis."""
    frequency = comparison.frequency_hz
    verdicts = [verdict.value for verdict in comparison.verdict]
    middle = np.sqrt(frequency[1:] * frequency[:-1])
    edges = np.concatenate([ends[:1], middle, ends[1:]])
    start = 0
    for row in range(1, len(verdicts) + 1):
        if row == len(verdicts) or verdicts[row] != verdicts[start]:
            _, colour, hatch = _VERDICTS[verdicts[start]]
            axes.axvspan(edges[start], edges[row], facecolor=colour, edgecolor="0.3", hatch=hatch, linewidth=0.6)
            start = row
    frequency_axis(axes, frequency)
    axes.set_xlim(*ends)
    axes.set_yticks([])
    axes.grid(visible=False)
    counts = comparison.counts()
    return [
        Patch(facecolor=colour, edgecolor="0.3", hatch=hatch, linewidth=0.6, label=f"{label} ({counts[verdict]})")
        for verdict, (label, colour, hatch) in _VERDICTS.items()
        if counts[verdict]
    ]
