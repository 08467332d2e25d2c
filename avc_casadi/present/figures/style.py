"""Style and panels of all figures: lines differ in dash and marker, so that they are distinguishable in grey."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullFormatter, NullLocator
from numpy.typing import ArrayLike

from avc_casadi._util.arrays import BoolArray
from avc_casadi._util.files import write_file
from avc_casadi.design import registry

P = ParamSpec("P")
PERCEIVED = "|Zₕ|"
"""The impedance that a hand perceives."""

BLUE = "#08306b"
ORANGE = "#d1600a"
OLIVE = "#5a5a00"
GREEN = "#2f7d32"
PURPLE = "#8a0f5c"
DASHED: Any = (0, (5, 1.6))
DASH_DOT: Any = (0, (4, 1.5, 1, 1.5))
DOTTED: Any = (0, (1, 1.4))
_WIDTH_INCHES = 7.2
"""Width of a figure with all its panels, as wide as the text of a page of paper."""
_PANEL_WIDTH_INCHES = 3.7
"""Width of a panel alone: on a phone of 390 pixels its letters have the size of the page's small print."""
_PANEL_HEIGHT_INCHES = 2.5
"""Height of a panel alone, without its legend."""
_LEGEND_LINE_INCHES = 0.17
"""Height of a line of a legend."""
_LETTERS_PER_INCH = 17.4
"""Letters of a legend that an inch holds."""
_HANDLE_LETTERS = 12
"""Letters that the sample of a line takes in a legend, with the gap to the next column."""
_RC: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 8.5,
    "axes.titlesize": 9,
    "axes.titlelocation": "left",
    "axes.grid": True,
    "axes.formatter.useoffset": False,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "0.88",
    "grid.linewidth": 0.6,
    "legend.fontsize": 8,
    "legend.frameon": False,
    "legend.handlelength": 3.2,
    "lines.markersize": 4.2,
    "hatch.linewidth": 0.5,
    "figure.constrained_layout.w_pad": 0.08,
    "figure.constrained_layout.h_pad": 0.06,
    "savefig.dpi": 120,
    "svg.hashsalt": "avc-casadi",
}


@dataclass(frozen=True)
class Line:
    """The line of one quantity in all figures."""

    label: str
    colour: str
    style: Any
    """Dashes, as matplotlib takes them."""
    marker: str
    width: float
    """Width, points."""
    layer: int
    """Lines of a higher layer are drawn above."""
    shift: float
    """Place of the first marker, as a share of the distance between two."""

    def draw(self, axes: Axes, x: ArrayLike, y: ArrayLike, *, markers: int = 12, **changes: Any) -> None:
        """Draw the quantity against x in ascending order; gaps where y is not a number."""
        order = np.argsort(x, kind="stable")
        rows_a_marker = max(1, order.size // markers)
        looks = {
            "label": self.label,
            "color": self.colour,
            "linestyle": self.style,
            "marker": self.marker or ("_" if order.size == 1 else ""),
            "markerfacecolor": "white",
            "linewidth": self.width,
            "zorder": self.layer,
            "markevery": (int(self.shift * rows_a_marker), rows_a_marker),
        }
        axes.plot(np.asarray(x)[order], np.asarray(y)[order], **(looks | changes))

    def draw_where(self, usable: BoolArray, axes: Axes, x: ArrayLike, y: ArrayLike, **changes: Any) -> None:
        """Draw a line where gains exist; requested values elsewhere are points, never a line."""
        values = np.asarray(y, dtype=float)
        requested = np.where(usable, np.nan, values)
        points = bool(np.isfinite(requested).any())
        if points and not usable.any():
            changes = {"label": "_"} | changes
        self.draw(axes, x, np.where(usable, values, np.nan), **changes)
        if points:
            label = f"{self.label} asks for, not realisable"
            self.draw(axes, x, requested, markers=60, label=label, linestyle="none", marker="x", markersize=3.2)


_LINES = (
    Line("", ORANGE, DASHED, "^", 1.3, 5, 0.0),
    Line("", BLUE, "-", "o", 1.1, 6, 0.5),
    Line("", OLIVE, DASH_DOT, "s", 1.1, 5, 0.25),
    Line("", GREEN, (0, (2, 1.2)), "P", 1.1, 5, 0.75),
    Line("", "#6a51a3", (0, (6, 1.5, 1, 1.5)), "v", 1.1, 5, 0.4),
)
METHODS: dict[str, Line] = {
    name: replace(line, label=name.replace("-", " "))
    for name, line in zip((name for name, method in registry.METHODS.items() if method.pointwise), _LINES, strict=False)
}
"""The lines of the compared methods."""


def styled(draw: Callable[P, Figure]) -> Callable[P, Figure]:
    """Draw in this style without changing matplotlib's settings."""

    @wraps(draw)
    def with_style(*args: P.args, **kwargs: P.kwargs) -> Figure:
        with mpl.rc_context(_RC):
            return draw(*args, **kwargs)

    return with_style


def _power(value: float, _: object) -> str:
    """Return a tick of a logarithmic axis; plain text, as matplotlib parses a formula for seconds a page."""
    if value == 0 or 1e-3 <= abs(value) < 1e5:
        return f"{value:g}"
    mantissa, _, power = f"{value:e}".partition("e")
    head = "" if float(mantissa) == 1 else f"{float(mantissa):g}·"
    raised = str(int(power)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"{head}10{raised}"


def log_ticks(axis: Axis, low: float, high: float) -> None:
    """Give a logarithmic axis ticks with plain numbers, some of them in any range."""
    axis.set_major_locator(LogLocator(subs=(1.0,) if high > 100 * low else (1.0, 2.0, 5.0)))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(_power))
    axis.set_minor_formatter(NullFormatter())


def frequency_axis(axes: Axes, frequency_hz: ArrayLike) -> None:
    """Make x a frequency axis with plain numbers, logarithmic if it spans more than a factor of 5."""
    low, high = float(np.min(frequency_hz)), float(np.max(frequency_hz))
    if high > 5 * low:
        axes.set_xscale("log")
        log_ticks(axes.xaxis, low, high)
    if high > low:
        axes.set_xlim(low, high)
    axes.set_xlabel("frequency (Hz)")


def value_axis(axes: Axes, *curves: ArrayLike, wide: float = 10.0) -> None:
    """Choose the scale of y: linear, logarithmic where all is positive, or logarithmic on both sides of 0."""
    values = np.concatenate([np.ravel(np.asarray(curve, dtype=float)) for curve in curves])
    values = values[np.isfinite(values)]
    largest = float(np.abs(values).max(initial=0.0))
    negligible = 1e-10 * largest  # what counts as 0
    sizes = np.abs(values[np.abs(values) > negligible])
    if sizes.size == 0 or largest < wide * np.quantile(sizes, 0.25):
        return
    if values.min() > negligible:
        if largest > 10 * values.min():
            axes.set_yscale("log")
            log_ticks(axes.yaxis, float(values.min()), largest)
        return
    threshold = 10.0 ** np.floor(np.log10(np.quantile(sizes, 0.25)))
    decades = np.log10(largest / threshold)
    step = max(1, int(np.ceil(decades * (2 if values.min() < -threshold else 1) / 6)))
    axes.set_yscale("symlog", linthresh=threshold, linscale=0.6 * step)
    powers = threshold * 10.0 ** np.arange(0, np.ceil(decades) + 1, step)
    axes.yaxis.set_major_locator(FixedLocator([*-powers[::-1], 0.0, *powers]))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter(FuncFormatter(_power))


def files_of(figure: Figure, *endings: str) -> list[bytes]:
    """Return a figure as the contents of files, png, svg or pdf; without dates and versions equal ones are equal."""
    dates: dict[str, dict[str, None]] = {
        "png": {"Software": None},
        "svg": {"Date": None, "Creator": None},
        "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
    }
    contents = []
    with mpl.rc_context(_RC):
        for ending in endings:
            content = io.BytesIO()
            figure.savefig(content, format=ending, metadata=dates[ending])
            contents.append(content.getvalue())
            figure.set_layout_engine("none")  # laid out once: it takes as long as drawing
    return contents


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure; the ending of ``path`` chooses PNG, SVG or PDF."""
    write_file(path, files_of(figure, path.suffix.lower()[1:])[0])


def panels(titles: Sequence[str], height_inches: float, layout: str = "a") -> Figure:
    """Return a figure with its panels, in the layout of `Figure.subplot_mosaic`; several of them get letters."""
    figure = Figure(figsize=(_WIDTH_INCHES, height_inches), layout="constrained")
    mosaic = figure.subplot_mosaic(layout)
    for (letter, axes), title in zip(mosaic.items(), titles, strict=True):
        axes.set_title(f"({letter}) {title}" if len(mosaic) > 1 else title)
    return figure


def with_legend(figure: Figure, columns: int) -> Figure:
    """Put a legend of all lines below a figure."""
    _legend(figure, columns)
    return figure


def _legend(figure: Figure, most_columns: int) -> int:
    """Put a legend of all lines below a figure, in as many columns as its width holds; return its lines."""
    entries: dict[str, Any] = {}
    for axes in figure.axes:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    widest = max(map(len, entries), default=1) + _HANDLE_LETTERS
    columns = max(1, min(most_columns, int(_LETTERS_PER_INCH * figure.get_figwidth() / widest)))
    figure.legend(list(entries.values()), list(entries), loc="outside lower center", ncols=columns)
    return math.ceil(len(entries) / columns)


@dataclass(frozen=True)
class Panel:
    """One panel of a drawing as a figure of its own, without its title, for a page that places panels itself."""

    title: str
    figure: Figure


@dataclass(frozen=True)
class Drawing:
    """Panels that are painted together, as one figure for a file or each alone for a page of any width."""

    titles: Sequence[str]
    height_inches: float
    """Height of the figure with all panels."""
    layout: str
    """Their places in it, as `Figure.subplot_mosaic` takes them."""
    legend_columns: int
    paint: Callable[[Sequence[Axes]], None]
    """Paints into the axes of the panels, in the order of their titles."""

    def figure(self) -> Figure:
        """Return all panels in one figure."""
        with mpl.rc_context(_RC):
            figure = panels(self.titles, self.height_inches, self.layout)
            self.paint(figure.axes)
            return with_legend(figure, self.legend_columns)

    def panels(self) -> list[Panel]:
        """Return each panel alone, as wide as a phone, with the legend of its own lines."""
        with mpl.rc_context(_RC):
            size = _PANEL_WIDTH_INCHES, _PANEL_HEIGHT_INCHES
            figures = [Figure(figsize=size, layout="constrained") for _ in self.titles]
            self.paint([figure.subplots() for figure in figures])
            for figure in figures:
                # Equal axes in all panels: a legend of more lines makes its figure higher.
                lines = _legend(figure, most_columns=2)
                figure.set_figheight(_PANEL_HEIGHT_INCHES + lines * _LEGEND_LINE_INCHES)
            return [Panel(title, figure) for title, figure in zip(self.titles, figures, strict=True)]
