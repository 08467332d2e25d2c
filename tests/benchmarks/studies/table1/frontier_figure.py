"""The frontier: how stiff and real a wall feels against how many hands it leaves at rest, and what sets the limit."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.ticker import FixedLocator, NullLocator

from avc_casadi.present.figures.layout import GivenAxes, Panels
from avc_casadi.present.figures.style import IMPEDANCE_UNIT, METHODS, NO_COUPLING, Line, frequency_axis, styled

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TOLERANCE = 0.10
_STIFFNESS_LEFT, _HANDS_LEFT = 1.0, 2.0

# Couplings of the study, each with the names of its cells in the order of growing margin.
_TUNED: dict[str, Line] = {
    "schedule, damped": Line("schedule, contact damper", "#08306b", "-", "o", 1.6, 7, 0.0),
    "static-tuned, damped": Line("constant, contact damper", "#d1600a", (0, (5, 1.6)), "s", 1.4, 6, 0.3),
    "schedule, series": Line("schedule, series", "#2f7d32", (0, (4, 1.2, 1, 1.2)), "D", 1.3, 5, 0.6),
    "static-tuned, series": Line("constant, series", "#8a0f5c", (0, (1, 1.2)), "v", 1.3, 4, 0.8),
}
_UNTUNED: dict[str, tuple[str, str, str]] = {
    "none": ("no coupling", NO_COUPLING.colour, "x"),
    "static": ("Llewellyn, printed hold", "#5a5a00", "P"),
    "static-sampled": ("Llewellyn, sampled", "#00517a", "*"),
    "direct": ("direct, pointwise", METHODS["direct"].colour, "+"),
    "closed-form": ("closed form as damper", METHODS["closed-form"].colour, "^"),
}
_SHOWN_MARGIN = "margin 6"


@styled
def draw_frontier(document: dict[str, Any], axes: GivenAxes = None) -> Figure:
    """Draw the frontier study.

    Args:
        document: {about, cells} of tests/benchmarks/frontier.py.
        axes: 4 axes to draw in, row by row; None makes a figure.

    Raises:
        InputError: another number of axes.
    """
    titles = (
        "(a) hands at rest against stiffness",
        "(b) realism against frequency",
        "(c) every hand is stable between the lines",
        "(d) schedule, one thing changed;\norange: not every hand at rest",
    )
    panels = Panels.of(axes, titles, 6.4, _own_axes)
    shares, errors, region, prices = panels.axes
    cells = document["cells"]
    _shares(shares, cells)
    _errors(errors, cells, document["about"]["frequency_hz"])
    _region(region, cells)
    _prices(prices, cells)
    return panels.figure


def _own_axes(figure: Figure) -> list[Axes]:
    # Rows of their own, so that the long labels of one do not squeeze the other.
    upper, lower = figure.subfigures(2, 1, squeeze=False)[:, 0]
    return [*upper.subplots(1, 2), *lower.subplots(1, 2)]


def _shares(axes: Axes, cells: dict[str, Any]) -> None:
    for start, line in _TUNED.items():
        found = [cell for name, cell in cells.items() if name.startswith(f"{start}, margin") and "stable" in cell]
        at = np.array([(_stiffness(cell), 100 * cell["stable"] / cell["people"]) for cell in found]).T
        if at.size:
            axes.plot(
                *at,
                color=line.colour,
                linestyle=line.style,
                marker=line.marker,
                label=line.label,
                markersize=3.6,
                markerfacecolor="white",
                zorder=line.layer,
                clip_on=False,
            )
    for name, (label, colour, marker) in _UNTUNED.items():
        cell = cells.get(name)
        if cell is not None and "stable" in cell:
            x = _stiffness(cell)
            axes.plot(
                0.0 if np.isnan(x) else x,
                100 * cell["stable"] / cell["people"],
                marker=marker,
                color=colour,
                linestyle="none",
                label=label,
                markersize=6,
                zorder=8,
                clip_on=False,
            )
    axes.set_xscale("function", functions=_towards_100(_STIFFNESS_LEFT))
    axes.set_yscale("function", functions=_towards_100(_HANDS_LEFT))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(FixedLocator([0, 50, 80, 90, 95, 98, 100]))
        axis.set_minor_locator(NullLocator())
        axis.set_major_formatter("{x:g}")
    axes.set_xlim(0, 100)
    axes.set_ylim(0, 100)
    axes.set_xlabel("stiffness felt (% of the wall's 100 kN/m)")
    axes.set_ylabel("hands settle without friction (%)")
    axes.legend(loc="center", bbox_to_anchor=(0.5, 0.56), fontsize=6.6, handlelength=2.4)


def _towards_100(left: float) -> tuple[Callable[[Any], Any], Callable[[Any], Any]]:
    """Return a scale of 0 to 100, and its inverse, that counts what is missing in decades: winners stand apart.

    Args:
        left: added to what is missing, so that 100 has a place.
    """

    def there(values: Any) -> Any:
        return -np.log10(np.maximum(100 + left - values, 1e-9))

    def back(places: Any) -> Any:
        return 100 + left - 10.0**-places

    return there, back


def _stiffness(cell: dict[str, Any]) -> float:
    median = cell["stiffness_share"]["median"]
    return float("nan") if median is None else 100 * median


def _errors(axes: Axes, cells: dict[str, Any], frequency_hz: list[float]) -> None:
    for start, line in _TUNED.items():
        cell = cells.get(f"{start}, {_SHOWN_MARGIN}")
        if cell is not None and "physical_error" in cell:
            line.draw(axes, frequency_hz, 100 * np.array(cell["physical_error"]), markers=8)
    axes.axhline(100 * TOLERANCE, color="0.4", linewidth=0.9, linestyle=(0, (2, 1.5)))
    axes.text(frequency_hz[0], 100 * TOLERANCE * 1.06, "noticed above (Weber 0.10)", fontsize=6.6)
    axes.set_yscale("log")
    axes.margins(y=0.08)
    frequency_axis(axes, frequency_hz)
    axes.set_ylabel("error from the physical wall (%)")


def _region(axes: Axes, cells: dict[str, Any]) -> None:
    for name, colour, label, at in (
        ("A", "#08306b", "set A", (84, 125)),
        ("B", "#d1600a", "set B (stylus)", (31, 85)),
    ):
        cell = cells.get(f"limit, set {name}")
        if cell is None:
            continue
        wall = np.array(cell["stiffness_n_per_m"]) / 1e3
        low, high = (
            np.array(cell[key], dtype=float) for key in ("lowest_damping_ns_per_m", "highest_damping_ns_per_m")
        )
        axes.fill_between(wall, low, high, color=colour, alpha=0.16, linewidth=0)
        axes.plot(wall, low, color=colour)
        axes.plot(wall, high, color=colour, linestyle=(0, (5, 1.6)))
        axes.text(*at, label, color=colour, ha="center")
    axes.axvline(100, color="0.35", linewidth=0.9, linestyle=(0, (2, 1.5)))
    axes.text(99, 285, "wall of figure 5 ", ha="right", fontsize=6.6)
    axes.set_xlim(0, 120)
    axes.set_ylim(0, 320)
    axes.set_xlabel("stiffness of the wall (kN/m), 1 ms")
    axes.set_ylabel(f"damping of wall and contact ({IMPEDANCE_UNIT})")


def _prices(axes: Axes, cells: dict[str, Any]) -> None:
    """Frequency up to which the error stays unnoticed, for each ingredient taken away."""
    names = [name for name, cell in cells.items() if name.startswith("ablation") and "stable" in cell]
    for row, name in enumerate(reversed(names)):
        cell = cells[name]
        share = cell["stable"] / cell["people"]
        reach_hz = cell["error_within_hz"]["physical"]
        axes.barh(row, reach_hz, color="#08306b" if share == 1 else "#d1600a", height=0.66)
        if share < 1:
            axes.text(reach_hz + 1, row, f"{100 * share:.4g} % at rest", va="center", fontsize=6.2)
        elif reach_hz == 0:
            axes.text(1, row, "above 10 % at every frequency", va="center", fontsize=6.2)
    axes.set_yticks(range(len(names)), [name.removeprefix("ablation, ") for name in reversed(names)], fontsize=6.4)
    axes.grid(visible=False, axis="y")
    axes.set_xlabel("error below 10 % up to (Hz)")
