"""Rows of the region of two numbers of a stated law."""

from __future__ import annotations

import numpy as np

from avc_casadi.claims.law_region import LawRegion
from avc_casadi.present.row import Answer, Value, row
from avc_casadi.present.rows import subject
from avc_casadi.present.rows.pieces import number_limits

_SHOWN = 7
"""Values that are printed; JSON and plot have all."""


def law_region(result: LawRegion, shown: str = "") -> Answer:
    """Return the answer of `zwidth --over`: at some values of a number the stable values of another."""
    problem = result.problem
    rows = []
    for place in dict.fromkeys(np.linspace(0, len(result.values) - 1, _SHOWN).astype(int).tolist()):
        least, largest = float(result.least[place]), float(result.largest[place])
        (stable,) = number_limits({result.of: None if np.isnan(least) else (least, largest)})
        over_value = Value.of(result.over, float(result.values[place])).text(problem.units)
        rows.append(row(f"At {over_value}", stable.label.lower(), stable.values))
    over = problem.units.key(result.over)
    rows.insert(0, row("Over", over, "with the other numbers of the law unchanged"))
    return subject.answer("law-region", result.document(), problem, shown, rows, "certify {}")
