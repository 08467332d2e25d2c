"""A figure whose panels stand one below the other, as narrow as a phone."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol

from matplotlib.figure import Figure

from avc_casadi.figures._style import styled

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
    """Draw what a drawing function draws, its panels in one column.

    Args:
        draw: the function.
        result: what it draws.
    """
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
    """Return how tall a panel is, at most as much as a narrow one should be."""
    return min(axes.get_position().height * whole_inches, 0.62 * NARROW_INCHES)
