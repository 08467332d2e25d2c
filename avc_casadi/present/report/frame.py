"""Frame of a self-contained HTML page: common head and foot."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from html import escape
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, Any

from avc_casadi._util.text import Cell, Table, number
from avc_casadi._util.units import spoken_key
from avc_casadi.present.figures.layout import figure_png_svg, figure_svg, stacked

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from avc_casadi.present.terminal import Row

_HERE = Path(__file__).parent
_VERDICTS = {"pass": "pass", "proved": "pass", "fail": "fail", "FAIL": "fail", "refuted": "fail"}


def page_html(title: str, source: str, body: str, versions: Mapping[str, str]) -> str:
    """Return a self-contained page: title and source are texts, the body is HTML."""
    told = table_html(Table(("package", "version"), tuple(versions.items()), (0, 1)), "versions")
    return filled("frame", title=escape(title), source=escape(source), body=body, versions=told)


def filled(name: str, **parts: str) -> str:
    """Return a template beside this file with its parts, HTML, filled in."""
    return Template((_HERE / f"{name}.html").read_text(encoding="utf-8")).substitute(parts)


def items_html(texts: Iterable[str]) -> str:
    """Return the items of a list."""
    return "\n".join(f"<li>{escape(text)}</li>" for text in texts)


@dataclass(frozen=True)
class Picture:
    """A figure for a page.

    Attributes:
        caption: of the figure.
        words: its content in numbers, as alternative text.
        wide: SVG text.
        narrow: the same with its panels in one column, for a phone.
    """

    caption: str
    words: str
    wide: str
    narrow: str

    @classmethod
    def of(cls, draw: Callable[..., Figure], result: Any, caption: str, words: str) -> Picture:
        """Draw a result wide and narrow."""
        return cls(caption, words, figure_svg(draw(result)), figure_svg(stacked(draw, result)))

    @classmethod
    def with_png(cls, draw: Callable[..., Figure], result: Any, caption: str, words: str) -> tuple[bytes, Picture]:
        """Draw a result wide and narrow, and return the wide one as the content of a PNG file too."""
        png, wide = figure_png_svg(draw(result))
        return png, cls(caption, words, wide, figure_svg(stacked(draw, result)))

    def html(self) -> str:
        """Return the figure with its pictures inside."""
        wide, narrow = (
            f"data:image/svg+xml;base64,{base64.b64encode(svg.encode()).decode()}" for svg in (self.wide, self.narrow)
        )
        return (
            f'<figure><picture><source media="(max-width: 700px)" srcset="{narrow}"><img src="{wide}" '
            f'alt="{escape(self.words)}"></picture><figcaption>{escape(self.caption)}</figcaption></figure>'
        )


def table_html(table: Table, what: str = "") -> str:
    """Return a table that scrolls by itself, its title above and its notes below; ``what`` is its label."""

    def row(cells: Iterable[str], tag: str, more: str = "") -> str:
        inner = []
        for column, cell in enumerate(cells):
            classes = f"{'' if column in table.left else 'n'} {_VERDICTS.get(cell, '')}".strip()
            inner.append(f'<{tag}{more} class="{classes}">{escape(cell)}</{tag}>')
        return f"<tr>{''.join(inner)}</tr>"

    head = row((cell.strip().replace("\n", ", ") for cell in table.header), "th", ' scope="col"')
    body = "\n".join(row(cells, "td") for cells in table.cells())
    told = f"<p>{escape(table.title)}</p>\n" if table.title else ""
    below = f"\n<ul>\n{items_html(table.notes)}\n</ul>" if table.notes else ""
    name = escape(what or table.title or ", ".join(" ".join(cell.split()) for cell in table.header))
    return (
        f'{told}<div class="wide" tabindex="0" role="region" aria-label="{name}">\n'
        f"<table>\n<thead>{head}</thead>\n<tbody>\n{body}\n</tbody>\n</table>\n</div>{below}"
    )


def rows_html(rows: Iterable[Row]) -> str:
    """Return the rows of a page of the terminal as a table, their marks as those of verdicts."""
    lines = (
        f'<tr><td class="{row.mark.name.lower()}">{escape(row.label)}</td><td>{escape(row.text)}</td></tr>'
        for row in rows
    )
    return (
        f'<div class="wide" tabindex="0" role="region" aria-label="at a glance">\n<table>{"".join(lines)}</table></div>'
    )


def columns_html(header: tuple[str, ...], rows: Iterable[tuple[Cell, ...]], left: tuple[int, ...] | None = None) -> str:
    """Return an HTML table; columns are texts where ``left`` is None."""
    return table_html(Table(header, tuple(rows), tuple(range(len(header))) if left is None else left))


def value_text(value: Any) -> str:
    """Return a value of a file as text."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list | tuple):
        return ", ".join(map(value_text, value)) or "none"
    return number(value) if isinstance(value, float) else str(value)


def settings(table: Mapping[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    """Return every value of nested tables beside its dotted key, without those not given."""
    rows = []
    for key, value in table.items():
        if isinstance(value, Mapping):
            rows += settings(value, f"{prefix}{key}.")
        elif value is not None:
            rows.append((spoken_key(f"{prefix}{key}"), value_text(value)))
    return rows
