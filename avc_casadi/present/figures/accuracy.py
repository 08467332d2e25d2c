"""What accuracy costs in time: time a frequency against the error beyond the optimum."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib import colormaps
from matplotlib.lines import Line2D

from avc_casadi.design.comparison.accuracy import fastest
from avc_casadi.present.figures.style import METHODS, PERCEIVED, GivenAxes, Panels, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from avc_casadi.design.comparison.accuracy import SolverCost

_MARKERS = "ov<>DPXsh^"
_FLOOR = 1e-16


@styled
def draw_accuracy(costs: Sequence[SolverCost], axes: GivenAxes = None) -> Figure:
    """Draw time against error; open markers where some frequency is not at the optimum."""
    panels = Panels.of(axes, ("",), 4.2, lambda figure: [figure.subplots()])
    (work,) = panels.axes
    work.set_xscale("log")
    work.set_yscale("log")
    handles = []
    for name in ("closed-form", "exact"):
        line = METHODS[name]
        handles += _drawn(work, [one for one in costs if one.method == name], line.label, line.colour, line.marker)
    solvers = list(dict.fromkeys(one.solver for one in costs if one.solver is not None))
    for place, name in enumerate(solvers):
        some = sorted((one for one in costs if one.solver == name), key=lambda one: -(one.tolerance or 0.0))
        colour = colormaps["tab10"](place % 10)
        handles += _drawn(work, some, f"direct, {name}", colour, _MARKERS[place % len(_MARKERS)])
    front = [one for one, best in zip(costs, fastest(costs), strict=True) if best]
    x, y = _points(sorted(front, key=lambda one: one.seconds_per_frequency))
    handles += work.plot(x, y, color="0.2", linestyle=(0, (2, 2)), linewidth=0.9, label="nearest to the optimum")
    handles.append(Line2D([], [], color="0.2", marker="o", markerfacecolor="white", ls="none", label="not everywhere"))
    work.set_xlabel(f"largest error of {PERCEIVED} beyond the optimum's, relative")
    work.set_ylabel("time a frequency (µs)")
    work.legend(handles=handles, loc="center left", bbox_to_anchor=(1.01, 0.5))
    return panels.figure


def _drawn(axes: Axes, costs: Sequence[SolverCost], label: str, colour: object, marker: object) -> list[Line2D]:
    known = [one for one in costs if one.largest_excess_error is not None]
    if not known:
        return []
    x, y = _points(known)
    (line,) = axes.plot(x, y, color=colour, marker=marker, linewidth=1.0, markersize=5.0, label=label)
    missed = np.array([one.optimal_share < 1 for one in known])
    axes.plot(
        np.array(x)[missed], np.array(y)[missed], color=colour, marker=marker, markerfacecolor="white", linestyle="none"
    )
    return [line]


def _points(costs: Sequence[SolverCost]) -> tuple[list[float], list[float]]:
    errors = [max(one.largest_excess_error or 0.0, _FLOOR) for one in costs]
    return errors, [1e6 * one.seconds_per_frequency for one in costs]
