"""Writing figures to files: the same bytes for the same figure."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import matplotlib as mpl
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


@contextmanager
def _laid_out(figure: Figure) -> Iterator[None]:
    """Lay a figure out once for all that is written of it; Matplotlib would draw all of it once more to do so."""
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
    with in_style(), _in_words(figure), _laid_out(figure):
        figure.savefig(path, format=ending[1:], metadata=_METADATA[ending])


def figure_png_svg(figure: Figure) -> tuple[bytes, str]:
    """Return a figure as the content of a PNG file and as `figure_svg` does, laid out once."""
    content = io.BytesIO()
    with in_style(), _in_words(figure), _laid_out(figure):
        figure.savefig(content, format="png", metadata=_METADATA[".png"])
        return content.getvalue(), _svg(figure)


def figure_svg(figure: Figure) -> str:
    """Return a figure as an SVG element that can stand inside an HTML page."""
    with in_style(), _in_words(figure), _laid_out(figure):
        return _svg(figure)


def _svg(figure: Figure) -> str:
    text = io.StringIO()
    figure.savefig(text, format="svg", metadata=_METADATA[".svg"])
    return re.sub(r"^.*?(?=<svg)", "", text.getvalue(), count=1, flags=re.DOTALL)
