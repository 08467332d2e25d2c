"""What accuracy costs in time: time a frequency against the error beyond the optimum."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from matplotlib import colormaps

from avc_casadi.design.comparison.accuracy import fastest
from avc_casadi.present.figures.style import METHODS, PERCEIVED, GivenAxes, Panels, log_ticks, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from avc_casadi.design.comparison.accuracy import SolverCost

_MARKERS = "ov<>DPXsh"
_FLOOR = 1e-16


@styled
def draw_accuracy(costs: Sequence[SolverCost], axes: GivenAxes = None) -> Figure:
    """Draw time against error; open markers where some frequency is not at the optimum."""
    panels = Panels.of(axes, ("",), 4.8)
    (work,) = panels.axes
    looks: dict[str, tuple[Any, str]] = {one: (METHODS[one].colour, METHODS[one].marker) for one in METHODS}
    groups: dict[str, list[SolverCost]] = {"closed-form": [], "exact": []}
    for one in costs:
        groups.setdefault(one.method if one.solver is None else f"direct, {one.solver}", []).append(one)
    for place, (label, group) in enumerate(groups.items()):
        colour, marker = looks.get(label, (colormaps["tab10"](place % 10), _MARKERS[place % len(_MARKERS)]))
        known = sorted(group, key=lambda one: -(one.tolerance or 0.0))
        for name, some, look in (
            (label, known, {"linewidth": 1.0}),
            ("_", [one for one in known if one.optimal_share < 1], {"linestyle": "none", "markerfacecolor": "white"}),
        ):
            work.plot(*_points(some), color=colour, marker=marker, label=name, **look)
    front = [one for one, best in zip(costs, fastest(costs), strict=True) if best]
    front.sort(key=lambda one: one.seconds_per_frequency)
    work.plot(*_points(front), color="0.2", linestyle=(0, (2, 2)), linewidth=0.9, label="nearest to the optimum")
    work.plot([], [], "o", color="0.2", markerfacecolor="white", label="not everywhere")
    work.set(xscale="log", yscale="log", ylabel="time a frequency (µs)")
    work.set_xlabel(f"largest error of {PERCEIVED} beyond the optimum's, relative")
    for axis, ends in ((work.xaxis, work.get_xlim()), (work.yaxis, work.get_ylim())):
        log_ticks(axis, *ends)
    panels.legend(3)
    return panels.figure


def _points(costs: Sequence[SolverCost]) -> tuple[list[float], list[float]]:
    known = [one for one in costs if one.largest_excess_error is not None]
    errors = [max(one.largest_excess_error or 0.0, _FLOOR) for one in known]
    return errors, [1e6 * one.seconds_per_frequency for one in known]
