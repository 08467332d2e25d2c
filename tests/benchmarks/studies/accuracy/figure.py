"""What accuracy costs: work against precision, error of gain tables, what grids of frequencies miss."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.lines import Line2D

from avc_casadi.present.figures.layout import GivenAxes, Panels
from avc_casadi.present.figures.style import IMPEDANCE_UNIT, METHODS, PERCEIVED, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from studies.accuracy.solvers import SolverCost
    from studies.accuracy.study import Accuracy

_OWN = {name: (line.label, line.colour, line.marker) for name, line in METHODS.items() if name != "direct"}
_DEFAULT = ("direct, default", "#08306b", "*")
_SOLVERS: dict[str, tuple[str, str, Any]] = {
    "ipopt": ("#08519c", "o", "-"),
    "sqpmethod": ("#a50f15", "v", "-"),
    "sqpmethod-qrqp": ("#de2d26", "<", (0, (4, 1.5))),
}
_FLOOR = 1e-16
_TABLES = {"linear": ("#08306b", "o"), "pchip": ("#a50f15", "v"), "nearest": ("0.5", "s")}


@styled
def draw_accuracy(study: Accuracy, axes: GivenAxes = None) -> Figure:
    """Draw the three studies; open markers where some frequency is not at the optimum.

    Args:
        study: what is drawn.
        axes: 3 axes to draw in, row by row; None makes a figure.

    Raises:
        InputError: another number of axes.
    """
    titles = (
        f"(a) work and precision; the optimum by {study.reference}",
        "(b) gain tables",
        "(c) all frequencies judged by a grid",
    )
    panels = Panels.of(axes, titles, 7.6, _own_axes)
    work, tables, grids = panels.axes
    _work_precision(work, study)
    _tables(tables, study)
    _grids(grids, study)
    return panels.figure


def _own_axes(figure: Figure) -> list[Axes]:
    halves = figure.subfigures(2, 1, squeeze=False, height_ratios=[1.35, 1]).ravel()
    return [halves[0].subplots(), *halves[1].subplots(1, 2)]


def _work_precision(axes: Axes, study: Accuracy) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    for name, (colour, marker, style) in _SOLVERS.items():
        costs = [cost for cost in study.solvers if cost.solver == name and cost.largest_excess_error is not None]
        if costs:
            x, y = _points(costs)
            axes.plot(x, y, color=colour, linestyle=style, linewidth=1.0, zorder=2)
            for cost, one, other in zip(costs, x, y, strict=True):
                _mark(axes, cost, one, other, colour, marker, 5.0)
    for cost in study.solvers:
        if cost.tolerance is None and cost.largest_excess_error is not None:
            _, colour, marker = _DEFAULT if cost.default else _OWN[cost.method]
            _mark(axes, cost, *_points([cost]), colour, marker, 12.0 if cost.default else 7.0)
    front = [cost for cost, best in zip(study.solvers, study.pareto(), strict=True) if best]
    x, y = _points(sorted(front, key=lambda cost: cost.seconds_per_frequency))
    axes.plot(x, y, color="0.2", linestyle=(0, (2, 2)), linewidth=0.9, zorder=1)
    axes.set_xlabel(f"largest error of {PERCEIVED} beyond the optimum's, relative")
    axes.set_ylabel("time a frequency (µs)")
    axes.legend(handles=_legend(study), loc="center left", bbox_to_anchor=(1.01, 0.5))


def _points(costs: list[SolverCost]) -> tuple[list[float], list[float]]:
    errors = [max(cost.largest_excess_error or 0.0, _FLOOR) for cost in costs]
    return errors, [1e6 * cost.seconds_per_frequency for cost in costs]


def _mark(axes: Axes, cost: SolverCost, x: object, y: object, colour: str, marker: str, size: float) -> None:
    full = cost.optimal_share == 1
    axes.plot(
        np.atleast_1d(np.asarray(x, dtype=float)),
        np.atleast_1d(np.asarray(y, dtype=float)),
        marker=marker,
        markersize=size,
        color=colour,
        markerfacecolor=colour if full else "white",
        linestyle="none",
        zorder=5 if cost.default else 4,
    )


def _legend(study: Accuracy) -> list[Line2D]:
    handles = [
        Line2D([], [], color=colour, marker=marker, linestyle="none", label=label)
        for label, colour, marker in (*_OWN.values(), _DEFAULT)
    ]
    present = {cost.solver for cost in study.solvers}
    handles += [
        Line2D([], [], color=colour, marker=marker, linestyle=style, linewidth=1.0, label=f"direct, {name}")
        for name, (colour, marker, style) in _SOLVERS.items()
        if name in present
    ]
    return [
        *handles,
        Line2D([], [], linestyle="none", label="(tolerances 1e-2 to 1e-12)"),
        Line2D([], [], color="0.2", linestyle=(0, (2, 2)), linewidth=0.9, label="Pareto front"),
        Line2D([], [], color="0.2", marker="o", linestyle="none", label="optimal everywhere"),
        Line2D([], [], color="0.2", marker="o", markerfacecolor="white", linestyle="none", label="not everywhere"),
    ]


def _tables(axes: Axes, study: Accuracy) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    for name, (colour, marker) in _TABLES.items():
        for precision, style in (("float64", "-"), ("float32", "none")):
            chosen = [t for t in study.tables if t.interpolation == name and t.precision == precision]
            rows = [t.rows for t in chosen]
            for values, face, width in (
                ([t.median_error for t in chosen], colour, 1.2),
                ([t.max_error for t in chosen], "white", 0.7),
            ):
                if precision == "float32" and face == "white":
                    continue
                axes.plot(
                    rows,
                    [max(100 * value, 1e-14) for value in values],
                    color=colour if precision == "float64" else "0.1",
                    linestyle=style,
                    linewidth=width,
                    marker=marker if precision == "float64" else "x",
                    markersize=4.5,
                    markerfacecolor=face,
                    zorder=3 if precision == "float64" else 4,
                )
    handles = [Line2D([], [], color=c, marker=m, label=name) for name, (c, m) in _TABLES.items()]
    handles += [
        Line2D([], [], color="0.1", marker="x", linestyle="none", label="float32"),
        Line2D([], [], color="0.3", marker="o", linestyle="none", label="median"),
        Line2D([], [], color="0.3", marker="o", markerfacecolor="white", linestyle="none", label="largest"),
    ]
    axes.legend(handles=handles, loc="lower left", ncols=2, handlelength=1.8, columnspacing=1.0)
    axes.set_xlabel("rows of the gain table")
    axes.set_ylabel(f"error of {PERCEIVED} between rows (%)")


def _grids(axes: Axes, study: Accuracy) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    seen = [grid for grid in study.grids if grid.missed_violation > 0]
    axes.plot([g.points for g in seen], [g.missed_violation for g in seen], color="#08306b", linewidth=1.2, zorder=2)
    for grid in seen:
        axes.plot(
            [grid.points],
            [grid.missed_violation],
            marker="o",
            color="#08306b",
            markerfacecolor="white" if grid.missed_rows else "#08306b",
            linestyle="none",
            zorder=3,
        )
    if seen:
        handles = [
            Line2D([], [], color="#08306b", marker="o", label="every violation noticed"),
            Line2D([], [], color="#08306b", marker="o", markerfacecolor="white", label="some gains called passive"),
        ]
        axes.legend(handles=handles, loc="lower left")
    else:
        axes.text(0.5, 0.5, "no frozen gains violate the margin", ha="center", transform=axes.transAxes)
    axes.set_xlabel("frequencies of the grid")
    axes.set_ylabel(f"violation not seen ({IMPEDANCE_UNIT})")
