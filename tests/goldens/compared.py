"""What a golden and today's answer have to have in common: the tolerances, each with its reason."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Any

from scipy.stats import binomtest

# The optimum of a row is found to 1e-9 and better by every method; another route to it may stop a little elsewhere.
GAIN_RTOL = 1e-6
# A gain at its lower bound of 0 is met to rounding. N.s/m and N/m, both far below what a hand can tell.
GAIN_ATOL = 1e-9
# Sums over the rows of a schedule: each row to GAIN_RTOL, errors that vanish to rounding.
SUM_RTOL, SUM_ATOL = 1e-5, 1e-7
# Margins of levels are searched over frequency to this accuracy, in N.s/m where they vanish at an active bound.
MARGIN_RTOL, MARGIN_ATOL = 1e-5, 1e-7
# A minimum over frequency is flat: its place is known to the root of the accuracy of its value.
PLACE_RTOL = 1e-2
# Below this frequency, Hz, it is the limit of zero frequency.
PLACE_ATOL = 1e-3
# Single precision has 6e-8 a step; sums of another order over a hundred samples stay below this share of the peak.
FORCE_SHARE = 1e-5
# The median stiffness of a hundred hands: one that settles an encoder step elsewhere moves it by one or two percent.
RENDERED_RTOL = 0.03
# Impedance errors may be lower; higher by this share of theirs, or by this much of |Z|, nobody feels: the JND is 0.1.
ERROR_RTOL, ERROR_ATOL = 0.05, 0.005


@dataclass(frozen=True)
class Difference:
    """One value that is not the golden one, at a dotted path; it does not count where another is as good."""

    place: str
    golden: Any
    found: Any
    counts: bool = True


def _close(golden: float, found: float, rtol: float, atol: float) -> bool:
    return math.isclose(golden, found, rel_tol=rtol, abs_tol=atol)


def _as_many_settle(golden: list[int], found: list[int]) -> bool:
    """[settled, of how many]: not below the exact 95 % interval of the golden count."""
    if not found[1]:
        return not golden[1]
    low = binomtest(golden[0], golden[1]).proportion_ci(0.95, "exact").low
    return found[0] / found[1] >= low


def _levels_kept(golden: bool | None, found: bool | None) -> bool:
    return found is True or golden is not True


# (path, whether the golden value admits another); the first that matches judges, and the whole value below it.
# None: told, does not count. Paths that match nothing must be equal.
_RULES = {
    "gains": [
        (r"\.(b|k|b_p)\[\d+\]$", lambda old, new: _close(old, new, GAIN_RTOL, GAIN_ATOL)),
        (r"_error_sum$", lambda old, new: _close(old, new, SUM_RTOL, SUM_ATOL)),
        (r"\.margin$", lambda old, new: _close(old, new, MARGIN_RTOL, MARGIN_ATOL)),
        (r"\.frequency_hz$", lambda old, new: _close(old, new, PLACE_RTOL, PLACE_ATOL)),
    ],
    "recommendations": [
        (r"\.(structure|runtime|gains|what_runs)\b", None),  # another coupling that feels and settles alike is as good
        (r"\.levels\.\w+\.(margin|frequency_hz)$", None),
        (r"\.levels\.\w+\.passed$", _levels_kept),
        (r"\.(settled|settled_without_friction|quiet|plant|plant_without_friction)$", _as_many_settle),
        (r"\.rendered$", lambda old, new: new >= (1 - RENDERED_RTOL) * old),  # stiffer is as good
        (r"\.impedance_error\.\d+$", lambda old, new: new <= old + max(ERROR_RTOL * old, ERROR_ATOL)),
    ],
    "exported_c": [],
    "errors": [],
}


def differences(part: str, place: str, golden: Any, found: Any) -> list[Difference]:
    """Return where an answer is not the golden one, with the tolerances of its part."""
    if golden == found:
        return []
    if part == "exported_c" and place.endswith(".force"):
        return _forces(place, golden, found)
    for pattern, admits in _RULES[part]:
        if re.search(pattern, place):
            told = [Difference(place, golden, found, counts=admits is not None)]
            comparable = not isinstance(found, str | None) and golden is not None
            return [] if admits is not None and comparable and admits(golden, found) else told
    if isinstance(golden, dict) and isinstance(found, dict):
        keys, absent = [*golden, *(key for key in found if key not in golden)], "(absent)"
        pairs = [(f"{place}.{key}", golden.get(key, absent), found.get(key, absent)) for key in keys]
    elif isinstance(golden, list) and isinstance(found, list) and len(golden) == len(found):
        pairs = [(f"{place}[{row}]", old, new) for row, (old, new) in enumerate(zip(golden, found, strict=True))]
    else:
        return [Difference(place, golden, found)]
    return [one for where, old, new in pairs for one in differences(part, where, old, new)]


def _forces(place: str, golden: list[float], found: list[float]) -> list[Difference]:
    if len(golden) != len(found):
        return [Difference(place, f"{len(golden)} forces", f"{len(found)} forces")]
    peak = max(map(abs, golden))
    return [
        Difference(f"{place}[{row}]", old, new)
        for row, (old, new) in enumerate(zip(golden, found, strict=True))
        if not abs(old - new) <= FORCE_SHARE * peak
    ]
