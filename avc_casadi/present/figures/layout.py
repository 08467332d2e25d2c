"""Layout of the panels of a figure: in a figure of their own, or in given axes."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from avc_casadi._errors import InputError
from avc_casadi._util.files import write_file
from avc_casadi.present.figures.style import WIDTH_INCHES, in_style, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes


NARROW_INCHES = 4.0
_TITLE_AND_LABEL_INCHES = 0.55
_LEGEND_LINE_INCHES = 0.2


class Drawing(Protocol):
    """A drawing function of this room."""

    def __call__(self, result: Any, /, *, axes: Any = None) -> Figure:
        """Draw a result into a figure of its own, or into axes."""


@styled
def stacked(draw: Drawing | Callable[..., Figure], result: Any) -> Figure:
    """Draw a result with its panels in one column."""
    wide = draw(result)
    panels = [axes for axes in wide.axes if axes.get_title(loc="left")]
    heights = [_height_inches(axes, wide.get_figheight()) for axes in panels]
    figure = Figure(layout="constrained")
    axes = list(figure.subplots(len(panels), 1, squeeze=False, height_ratios=heights)[:, 0])
    draw(result, axes=axes)
    for one, panel in zip(axes, panels, strict=True):
        one.set_title(panel.get_title(loc="left"), wrap=True)
    legend = axes[0].get_legend() if wide.legends else None
    lines = 0
    if legend is not None:
        handles, labels = legend.legend_handles, [text.get_text() for text in legend.get_texts()]
        legend.remove()
        figure.legend([one for one in handles if one is not None], labels, loc="outside lower center", ncols=1)
        lines = len(labels)
    tall = sum(heights) + len(axes) * _TITLE_AND_LABEL_INCHES + lines * _LEGEND_LINE_INCHES
    figure.set_size_inches(NARROW_INCHES, tall)
    return figure


def _height_inches(axes: Axes, whole_inches: float) -> float:
    """Return the height of a panel, limited in a narrow figure."""
    return min(axes.get_position().height * whole_inches, 0.62 * NARROW_INCHES)


# Without dates and version numbers equal figures are equal files.
_METADATA: dict[str, dict[str, str | None]] = {
    ".png": {"Software": None},
    ".svg": {"Date": None, "Creator": None},
    ".pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}


@contextmanager
def _laid_out(figure: Figure) -> Iterator[None]:
    """Lay a figure out once for all files written of it; Matplotlib would draw it once more for each."""
    engine = figure.get_layout_engine()
    if engine is None:
        yield
        return
    engine.execute(figure)
    with mpl.rc_context({"figure.autolayout": False, "figure.constrained_layout.use": False}):
        figure.set_layout_engine(None)
    try:
        yield
    finally:
        figure.set_layout_engine(engine)


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure; the ending of ``path`` chooses PNG, SVG or PDF."""
    ending = path.suffix.lower()
    content = io.BytesIO()
    with in_style(), _laid_out(figure):
        figure.savefig(content, format=ending[1:], metadata=_METADATA[ending])
    write_file(path, content.getvalue())


def figure_png_svg(figure: Figure) -> tuple[bytes, str]:
    """Return a figure as the content of a PNG file and as by `figure_svg`, laid out once."""
    content = io.BytesIO()
    with in_style(), _laid_out(figure):
        figure.savefig(content, format="png", metadata=_METADATA[".png"])
        return content.getvalue(), _svg(figure)


def figure_svg(figure: Figure) -> str:
    """Return a figure as an SVG element that can stand inside an HTML page."""
    with in_style(), _laid_out(figure):
        return _svg(figure)


def _svg(figure: Figure) -> str:
    text = io.StringIO()
    figure.savefig(text, format="svg", metadata=_METADATA[".svg"])
    return re.sub(r"^.*?(?=<svg)", "", text.getvalue(), count=1, flags=re.DOTALL)


GivenAxes = Axes | Sequence[Axes] | NDArray[np.object_] | None
"""One Axes, or one for each panel in the order of their letters (row by row); None makes a figure."""

_LINE_INCHES = 0.67
_LETTER_INCHES = 0.058


@dataclass(frozen=True)
class Panels:
    """The panels of one drawing.

    Given axes get lines, scales, limits and labels; their titles, figure and neighbours stay as they are, and the
    legend stands in the first panel.
    """

    figure: Figure
    axes: Sequence[Axes]
    own: bool

    @classmethod
    def of(
        cls, given: GivenAxes, titles: Sequence[str], height_inches: float, make: Callable[[Figure], Iterable[Axes]]
    ) -> Panels:
        """Use the given axes, or make a figure."""
        if given is None:
            figure = Figure(figsize=(WIDTH_INCHES, height_inches), layout="constrained")
            axes = list(make(figure))
            for one, title in zip(axes, titles, strict=True):
                one.set_title(title)
            return cls(figure, axes, own=True)
        found = [given] if isinstance(given, Axes) else list(np.ravel(np.asarray(given, dtype=object)))
        wrong = [type(one).__name__ for one in found if not isinstance(one, Axes)]
        if wrong:
            raise InputError.of(
                f"holds {', '.join(dict.fromkeys(wrong))}; allowed: matplotlib Axes, as plt.subplots() gives",
                key="axes",
            )
        if len(found) != len(titles):
            panels = "; ".join(title.replace("\n", " ") for title in titles)
            raise InputError.of(
                f"are {len(found)}; allowed: {len(titles)}, one a panel, row by row: {panels}", key="axes"
            )
        holder: Any = found[0].get_figure()
        while not isinstance(holder, Figure):  # a part of a figure
            holder = holder.figure
        return cls(holder, found, own=False)

    def legend(self, handles: Iterable[Any], labels: Iterable[str], columns: int, title: str | None = None) -> None:
        """Put a legend below an own figure, or into the first of the given axes."""
        if self.own:
            texts = list(labels)
            while columns > 1 and _legend_inches(texts, columns) > self.figure.get_figwidth():
                columns -= 1
            self.figure.legend(list(handles), texts, loc="outside lower center", ncols=columns, title=title)
        else:
            self.axes[0].legend(list(handles), list(labels), title=title)


def _legend_inches(labels: Sequence[str], columns: int) -> float:
    """Return the approximate width of a legend."""
    longest = [max(map(len, part), default=0) for part in np.array_split(np.array(labels, dtype=object), columns)]
    return sum(_LINE_INCHES + _LETTER_INCHES * length for length in longest)
