"""The estimators of the interaction frequency over time: a gap is where an estimate is undefined."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi.present.figures.style import GivenAxes, Line, Panels, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from studies.estimators.study import EstimatorTraces

_TRUTH = Line("true frequency", "0.72", "-", "", 4.5, 2, 0.0)
_LINES = (
    Line("zero crossing", "#d1600a", "-", "", 1.3, 5, 0.0),
    Line("spectral peak", "#00517a", "-", "", 1.3, 5, 0.0),
    Line("adaptive notch", "#5a5a00", "-", "", 1.3, 5, 0.0),
    Line("fused", "#08306b", "-", "", 1.3, 5, 0.0),
)
_LIMITS_HZ = (0.9, 40.0)


@styled
def draw_estimators(traces: EstimatorTraces, axes: GivenAxes = None) -> Figure:
    """Draw each estimate below the other, with the truth behind it.

    Args:
        traces: what is drawn.
        axes: as many axes to draw in as there are estimates; None makes a figure.

    Raises:
        InputError: another number of axes.
    """
    titles = [line.label for line in _LINES[: len(traces.estimates_hz)]]
    panels = Panels.of(
        axes, titles, 6.4, lambda figure: figure.subplots(len(titles), 1, squeeze=False, sharex=True, sharey=True)[:, 0]
    )
    handles: list[Any] = []
    for panel, line, estimate in zip(panels.axes, _LINES, traces.estimates_hz.values(), strict=True):
        _TRUTH.draw(panel, traces.time_s, traces.truth_hz)
        line.draw(panel, traces.time_s, np.clip(estimate, *_LIMITS_HZ))
        panel.set_yscale("log")
        panel.set_xlim(traces.time_s[0], traces.time_s[-1])
        panel.set_ylim(*_LIMITS_HZ)
        panel.set_yticks([1, 3, 12, 30], ["1", "3", "12", "30"])
        panel.minorticks_off()
        panel.set_ylabel("frequency (Hz)")
        handles = panel.get_lines()[:2]
    for at, text in (
        (0.02, "rest"),
        (0.52, "3 Hz"),
        (2.02, "12 Hz"),
        (3.02, "3 Hz with 30 % third harmonic"),
        (5.52, "rest"),
    ):
        panels.axes[0].text(at, 21.0, text, fontsize=8, color="0.25")
    for panel in panels.axes:
        for at in (0.5, 2.0, 3.0, 5.5):
            panel.axvline(at, color="0.6", linewidth=0.7, zorder=1)
    panels.axes[-1].set_xlabel("time (s)")
    panels.legend(dict(zip(("true frequency", "estimate; a gap where it is undefined"), handles, strict=True)), 2)
    return panels.figure
