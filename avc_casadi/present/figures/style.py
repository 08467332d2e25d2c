"""The style of all figures: lines differ in dash and marker, so that they are distinguishable in grey."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import wraps
from itertools import cycle
from typing import TYPE_CHECKING, Any, ParamSpec

import matplotlib as mpl
import numpy as np
from matplotlib.ticker import FixedLocator, FuncFormatter

from avc_casadi.design import registry

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike

    from avc_casadi._util.arrays import BoolArray
    from avc_casadi.design.comparison.comparison import Comparison

P = ParamSpec("P")

WIDTH_INCHES = 7.2
FREQUENCY = "Interaction frequency (Hz)"
PERCEIVED = r"$|Z_\mathrm{h}|$"
GRID = "0.88"

# Values below this share of the largest count as 0 when an axis chooses its scale.
_NEGLIGIBLE = 1e-10
_DECADE = 10.0
# Up to so many points are read one by one: the first and the last stand clear of the ends of the axis.
_FEW_POINTS = 25
_ROOM = 0.03
_DASH_POINTS = 22.0
_MOST_ASKED = 60

_RC: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 8.5,
    "axes.titlesize": 9,
    "axes.titlelocation": "left",
    "axes.labelsize": 8.5,
    "axes.grid": True,
    "axes.formatter.useoffset": False,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "legend.fontsize": 8,
    "legend.frameon": False,
    "legend.handlelength": 3.2,
    "lines.linewidth": 1.4,
    "lines.markersize": 4.2,
    "hatch.linewidth": 0.5,
    "figure.constrained_layout.w_pad": 0.08,
    "figure.constrained_layout.h_pad": 0.06,
    "savefig.dpi": 200,
    "svg.fonttype": "path",
    "svg.hashsalt": "avc-casadi",
}


@dataclass(frozen=True)
class Line:
    """The line of one quantity in all figures."""

    label: str
    colour: str
    style: Any
    marker: str
    width: float
    layer: int
    shift: float

    def draw(self, axes: Axes, x: ArrayLike, y: ArrayLike, *, markers: int = 12, **changes: Any) -> None:
        """Draw the quantity against x in ascending order; gaps where y is not a number."""
        order = np.argsort(x, kind="stable")
        every = max(1, order.size // markers)
        values = np.asarray(y)[order]
        dash = order.size == 1 and not self.marker
        axes.plot(
            np.asarray(x)[order],
            values,
            **{
                "label": self.label,
                "color": self.colour,
                "linestyle": self.style,
                "marker": "_" if dash else self.marker,
                "markerfacecolor": "white",
                "markeredgecolor": self.colour,
                "linewidth": self.width,
                **({"markersize": _DASH_POINTS, "markeredgewidth": self.width} if dash else {}),
                "zorder": self.layer,
                "markevery": (int(self.shift * every), every),
            }
            | changes,
        )

    def draw_where(self, usable: BoolArray, axes: Axes, x: ArrayLike, y: ArrayLike, **changes: Any) -> None:
        """Draw a line where gains exist; wanted values elsewhere are points, never a line."""
        values = np.asarray(y, dtype=float)
        asked = np.where(usable, np.nan, values)
        points = bool(np.isfinite(asked).any())
        if points and not usable.any():
            changes = {"label": "_"} | changes
        self.draw(axes, x, np.where(usable, values, np.nan), **changes)
        if points:
            self.draw(
                axes,
                x,
                asked,
                label=f"{self.label} asks for, not realisable",
                linestyle="none",
                marker="x",
                markersize=3.2,
                markevery=max(1, values.size // _MOST_ASKED),
            )


DESIRED = Line("desired", "0.78", "-", "", 4.5, 2, 0.0)
NO_COUPLING = Line("no coupling", "0.35", (0, (1, 1.4)), "", 1.4, 3, 0.0)
UPPER = Line("upper bound U", "#7a3b00", (0, (6, 2)), "^", 1.2, 4, 0.0)
LOWER = Line("lower bound L", "#00517a", (0, (6, 2)), "v", 1.2, 4, 0.5)
_LINES = (
    Line("", "#d1600a", (0, (5, 1.6)), "^", 1.3, 5, 0.0),
    Line("", "#08306b", "-", "o", 1.1, 6, 0.5),
    Line("", "#5a5a00", (0, (4, 1.5, 1, 1.5)), "s", 1.1, 5, 0.25),
    Line("", "#2f7d32", (0, (2, 1.2)), "P", 1.1, 5, 0.75),
    Line("", "#6a51a3", (0, (6, 1.5, 1, 1.5)), "v", 1.1, 5, 0.4),
)
METHODS: dict[str, Line] = {
    name: replace(line, label=name.replace("-", " "))
    for name, line in zip(
        (name for name, one in registry.METHODS.items() if one.pointwise), cycle(_LINES), strict=False
    )
}
"""The lines of the compared methods."""
POINTWISE = Line("direct, pointwise, for reference", "#6f94c4", (0, (2, 1.2)), "x", 1.1, 5, 0.5)
MINE = Line("mine", "#8a0f5c", (0, (3, 1, 1, 1)), "D", 1.2, 5, 0.75)


def method_lines(comparison: Comparison) -> dict[str, Line]:
    """Return the line of each method; gains of the problem's own scope are drawn as the chosen ones."""
    if comparison.delivered == comparison.optimum:
        return dict(METHODS)
    delivered = replace(METHODS["direct"], label=comparison.delivered)
    beside = {
        name: replace(METHODS[name], label=f"{name}, pointwise, for reference")
        for name, one in registry.METHODS.items()
        if one.optimises
    }
    return METHODS | beside | {"direct": POINTWISE, comparison.delivered: delivered}


def impedance_unit(result: Any) -> str:
    """Return the unit of impedance and damping of a result's device."""
    unit: str = result.units.unit("N·s/m")
    return unit


def styled(draw: Callable[P, Figure]) -> Callable[P, Figure]:
    """Draw in this style without changing matplotlib's settings."""

    @wraps(draw)
    def with_style(*args: P.args, **kwargs: P.kwargs) -> Figure:
        with mpl.rc_context(_RC):
            return draw(*args, **kwargs)

    return with_style


def in_style() -> Any:
    """Return the style as a context, for saving."""
    return mpl.rc_context(_RC)


def frequency_axis(axes: Axes, frequency_hz: ArrayLike, *, label: bool = True) -> None:
    """Make x a frequency axis with plain numbers, logarithmic if it spans more than a factor of 5."""
    low, high = float(np.min(frequency_hz)), float(np.max(frequency_hz))
    if high > 5 * low:
        axes.set_xscale("log")
    if high > low:
        scale = axes.xaxis.get_transform()
        ends = np.asarray(scale.transform([low, high]))
        room = _ROOM * np.ptp(ends) if np.size(frequency_hz) <= _FEW_POINTS else 0.0
        axes.set_xlim(*scale.inverted().transform(ends + room * np.array([-1.0, 1.0])))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(FuncFormatter(lambda _value, _position: ""))
    if label:
        axes.set_xlabel(FREQUENCY)
    else:
        axes.tick_params(labelbottom=False)


def value_axis(axes: Axes, *curves: ArrayLike, wide: float = 10.0, most_ticks: int = 6) -> None:
    """Choose the scale of y: linear, logarithmic where all is positive, or logarithmic on both sides of 0."""
    values = np.concatenate([np.ravel(np.asarray(curve, dtype=float)) for curve in curves])
    values = values[np.isfinite(values)]
    largest = float(np.abs(values).max(initial=0.0))
    sizes = np.abs(values[np.abs(values) > _NEGLIGIBLE * largest])
    if sizes.size == 0 or largest < wide * np.quantile(sizes, 0.25):
        return
    if values.min() > _NEGLIGIBLE * largest:
        if largest > _DECADE * values.min():
            axes.set_yscale("log")
        return
    threshold = 10.0 ** np.floor(np.log10(np.quantile(sizes, 0.25)))
    decades = np.log10(largest / threshold) * (2 if values.min() < -threshold else 1)
    step = max(1, int(np.ceil(decades / most_ticks)))
    axes.set_yscale("symlog", linthresh=threshold, linscale=0.6 * step)
    powers = threshold * 10.0 ** np.arange(0, np.ceil(np.log10(largest / threshold)) + 1, step)
    axes.yaxis.set_major_locator(FixedLocator([*-powers[::-1], 0.0, *powers]))
    scale = axes.yaxis.get_transform()
    low, high = scale.transform([min(values.min(), 0.0), max(values.max(), 0.0)])
    room = 0.06 * (high - low)
    axes.set_ylim(*scale.inverted().transform([low - room, high + room]))
