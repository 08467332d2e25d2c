"""Writing figures to files: the same bytes for the same figure."""

from __future__ import annotations

import io
import re
from pathlib import Path

from matplotlib.figure import Figure

from avc_casadi.figures._style import in_style

# Without dates and version numbers equal figures are equal files.
_METADATA: dict[str, dict[str, str | None]] = {
    ".png": {"Software": None},
    ".svg": {"Date": None, "Creator": None},
    ".pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure; the ending of ``path`` chooses PNG, SVG or PDF."""
    ending = path.suffix.lower()
    with in_style():
        figure.savefig(path, format=ending[1:], metadata=_METADATA[ending])


def figure_png(figure: Figure) -> bytes:
    """Return a figure as the content of a PNG file."""
    content = io.BytesIO()
    with in_style():
        figure.savefig(content, format="png", metadata=_METADATA[".png"])
    return content.getvalue()


def figure_svg(figure: Figure) -> str:
    """Return a figure as an SVG element that can stand inside an HTML page."""
    text = io.StringIO()
    with in_style():
        figure.savefig(text, format="svg", metadata=_METADATA[".svg"])
    return re.sub(r"^.*?(?=<svg)", "", text.getvalue(), count=1, flags=re.DOTALL)
