"""Numbers and tables as printed text, by the library's printer, loaded on demand."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence


def titled(name: str, title: str) -> str:
    """Return a name with its title, or alone where it has none."""
    return f"{name}: {title}" if title else name


def number(value: float | None, digits: int = 4) -> str:
    """Return a number to so many significant digits; a dash where it is undefined."""
    from avc_casadi._util import text as support

    return support.number(value, digits)


def passive_limit(limit_n_per_m: float | None) -> str:
    """Return the limit of passive renderings at DC as a clause; None where none is known."""
    if limit_n_per_m is None or math.isnan(limit_n_per_m):
        return (
            "a limit of passive rendering is known for rigid devices with an ideal amplifier and whole samples of "
            "delay only"
        )
    from avc_casadi._util.units import N_PER_M

    return f"no passive linear rendering on this device exceeds {number(limit_n_per_m)} {N_PER_M} at DC (sampled-data)"


def rows_text(rows: int) -> str:
    """Return a number of rows in words: "1 row", "3 rows"."""
    from avc_casadi._util import text as support

    return support.rows_text(rows)


def table(header: Sequence[str], rows: Iterable[Sequence[str]], *, left: Sequence[int] = ()) -> str:
    """Align cells in columns; a header cell may hold several lines."""
    from avc_casadi._util import text as support

    return support.text_table(header, rows, left=left)
