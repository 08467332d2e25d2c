"""The levels of a certificate as one table, for command and page."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from avc_casadi.support import Table


def levels_table(certificate: Mapping[str, Any]) -> Table:
    """Return the levels of a `certify` document, with the claim of each in words beside the table.

    Passivity and stability are different claims and stay apart.
    """
    levels = certificate["levels"]
    rows = tuple(
        (
            level,
            found["title"],
            found.get("outcome") or ("refused" if found.get("refused") else "pass" if found["pass"] else "fail"),
            found["margin_ns_per_m"],
            found["frequency_hz"],
            found["rows_failed"],
            found["model"],
        )
        for level, found in levels.items()
    )
    return Table(
        ("level", "claim", "result", "worst margin\nN.s/m", "at\nHz", "not passed\nrows", "\nmodel"),
        rows,
        left=(0, 1, 2, 6),
        digits=3,
        title=f"levels of {certificate['problem']}",
        notes=tuple(f"{level}: {found['claim']}" for level, found in levels.items()),
    )
