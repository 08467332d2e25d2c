"""Table 1 of the paper: counts of 10 people before six walls."""

from __future__ import annotations

from dataclasses import dataclass

PEOPLE = 10


@dataclass(frozen=True)
class PaperRow:
    """What the paper counted before one wall, of 10 people.

    Attributes:
        stable_without_coupling: stable without coupling; static and adaptive coupling were stable for all 10.
        matched_static: found the static coupling nearer to the reference.
        matched_adaptive: found the adaptive coupling nearer.
        unable: could not tell.
    """

    stable_without_coupling: int
    matched_static: int
    matched_adaptive: int
    unable: int


PAPER: dict[str, PaperRow] = {
    "VE2": PaperRow(10, 3, 3, 4),
    "VE3": PaperRow(10, 3, 5, 2),
    "VE4": PaperRow(10, 6, 4, 0),
    "VE5": PaperRow(4, 1, 9, 0),
    "VE6": PaperRow(0, 1, 9, 0),
    "VE7": PaperRow(0, 2, 8, 0),
}
