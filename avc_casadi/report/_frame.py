"""One self-contained HTML page: one head and one foot for whatever it tells."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping
from html import escape
from pathlib import Path
from string import Template

from avc_casadi.support import Table

_HERE = Path(__file__).parent


def page_html(title: str, source: str, body: str, versions: Mapping[str, str]) -> str:
    """Return a self-contained page.

    Args:
        title: of the page, a text.
        source: what it is about, a text.
        body: HTML.
        versions: versions by package.
    """
    told = Table(("package", "version"), tuple(versions.items()), (0, 1)).html()
    return filled("frame", title=escape(title), source=escape(source), body=body, versions=told)


def filled(name: str, **parts: str) -> str:
    """Return a template beside this file with its parts, HTML, filled in."""
    return Template((_HERE / f"{name}.html").read_text(encoding="utf-8")).substitute(parts)


def items_html(texts: Iterable[str]) -> str:
    """Return the items of a list."""
    return "\n".join(f"<li>{escape(text)}</li>" for text in texts)


def figure_html(caption: str, svg: str) -> str:
    """Return a figure with its picture inside."""
    data = base64.b64encode(svg.encode()).decode()
    text = escape(caption)
    return f'<figure><img src="data:image/svg+xml;base64,{data}" alt="{text}"><figcaption>{text}</figcaption></figure>'
