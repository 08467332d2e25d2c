"""Where the panels of a figure are drawn: in a figure of their own, or in axes of somebody else's."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from avc_casadi._errors import InputError
from avc_casadi.figures._style import WIDTH_INCHES

GivenAxes = Axes | Sequence[Axes] | NDArray[np.object_] | None
"""One Axes, or as many as the figure has panels in the order of their letters (row by row); None makes a figure."""

_LINE_INCHES = 0.67
_LETTER_INCHES = 0.058


@dataclass(frozen=True)
class Panels:
    """The panels of one drawing.

    Somebody else's axes get lines, scales, limits and labels; their titles, figure and neighbours stay as they are, and
    the legend stands in the first panel.

    Attributes:
        figure: the figure that holds them.
        axes: the panels.
        own: whether the figure was made for them.
    """

    figure: Figure
    axes: Sequence[Axes]
    own: bool

    @classmethod
    def of(
        cls, given: GivenAxes, titles: Sequence[str], height_inches: float, make: Callable[[Figure], Iterable[Axes]]
    ) -> Panels:
        """Take the axes that were given, or make a figure.

        Args:
            given: what the caller of a drawing function gave as `axes`.
            titles: of the panels.
            height_inches: of an own figure.
            make: makes the axes of an own figure.

        Raises:
            InputError: other things than axes, or another number of them than there are panels.
        """
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
        """Put a legend below an own figure, or into the first of somebody else's axes."""
        if self.own:
            texts = list(labels)
            while columns > 1 and _legend_inches(texts, columns) > self.figure.get_figwidth():
                columns -= 1
            self.figure.legend(list(handles), texts, loc="outside lower center", ncols=columns, title=title)
        else:
            self.axes[0].legend(list(handles), list(labels), title=title)


def _legend_inches(labels: Sequence[str], columns: int) -> float:
    """Return about how wide a legend is."""
    longest = [max(map(len, part), default=0) for part in np.array_split(np.array(labels, dtype=object), columns)]
    return sum(_LINE_INCHES + _LETTER_INCHES * length for length in longest)
