"""Writing figures to files: the same bytes for the same figure."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.text import Text

from avc_casadi.figures._style import in_style
from avc_casadi.support import spoken

# Without dates and version numbers equal figures are equal files.
_METADATA: dict[str, dict[str, str | None]] = {
    ".png": {"Software": None},
    ".svg": {"Date": None, "Creator": None},
    ".pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}


@contextmanager
def _in_words(figure: Figure) -> Iterator[None]:
    """Put every text of a figure into the words that are spoken, as long as it is written."""
    units = spoken()
    before = [] if units.linear else [(one, one.get_text()) for one in figure.findobj(Text)]
    for one, text in before:
        one.set_text(units.text(text))
    try:
        yield
    finally:
        for one, text in before:
            one.set_text(text)


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure; the ending of ``path`` chooses PNG, SVG or PDF."""
    ending = path.suffix.lower()
    with in_style(), _in_words(figure):
        figure.savefig(path, format=ending[1:], metadata=_METADATA[ending])


def figure_png(figure: Figure) -> bytes:
    """Return a figure as the content of a PNG file."""
    content = io.BytesIO()
    with in_style(), _in_words(figure):
        figure.savefig(content, format="png", metadata=_METADATA[".png"])
    return content.getvalue()


def figure_svg(figure: Figure) -> str:
    """Return a figure as an SVG element that can stand inside an HTML page."""
    text = io.StringIO()
    with in_style(), _in_words(figure):
        figure.savefig(text, format="svg", metadata=_METADATA[".svg"])
    return re.sub(r"^.*?(?=<svg)", "", text.getvalue(), count=1, flags=re.DOTALL)
