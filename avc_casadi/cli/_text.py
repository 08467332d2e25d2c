"""Numbers and tables as text for people."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

ROWS_SHOWN = 20


def number(value: float | None, digits: int = 4) -> str:
    """Return a number to so many significant digits; a dash where it is undefined."""
    return "-" if value is None or math.isnan(value) else f"{value + 0.0:.{digits}g}"  # -0 is 0


def passive_limit(limit_n_per_m: float | None) -> str:
    """Return what is known of passive renderings at DC as a clause; None stands for a fractional delay."""
    if limit_n_per_m is None or math.isnan(limit_n_per_m):
        return "a limit of passive rendering is known for whole samples of delay only"
    return f"no passive linear rendering on this device exceeds {number(limit_n_per_m)} N/m at DC (sampled-data)"


def counts(found: dict[str, int]) -> str:
    """Return counts as "187 solved, 13 infeasible", leaving out what does not occur."""
    return ", ".join(f"{count} {name}" for name, count in found.items() if count) or "none"


def sample_rows(rows: int, most: int = ROWS_SHOWN) -> list[int]:
    """Return at most so many row numbers, evenly spread, first and last among them."""
    if rows <= most:
        return list(range(rows))
    return sorted({round(i * (rows - 1) / (most - 1)) for i in range(most)})


def table(header: Sequence[str], rows: Iterable[Sequence[str]], *, left: Sequence[int] = ()) -> str:
    """Align cells in columns; a header cell may hold several lines.

    Args:
        header: one cell a column.
        rows: cells.
        left: columns aligned to the left; all others to the right.
    """
    heads = [cell.split("\n") for cell in header]
    height = max(len(lines) for lines in heads)
    head_rows = [[lines[i] if i < len(lines) else "" for lines in heads] for i in range(height)]
    body = [list(row) for row in rows]
    widths = [max(len(row[column]) for row in [*head_rows, *body]) for column in range(len(header))]

    def line(row: Sequence[str]) -> str:
        cells = zip(row, widths, range(len(widths)), strict=True)
        return "  ".join(c.ljust(w) if i in left else c.rjust(w) for c, w, i in cells).rstrip()

    return "\n".join([*map(line, head_rows), line(["-" * width for width in widths]), *map(line, body)])
