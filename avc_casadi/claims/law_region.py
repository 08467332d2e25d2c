"""How far a number of a stated law may go while another one changes: the region of both in which it is stable.

At each value of the first number the stable interval of the second is that of a certificate (`law_limits`), with every
hand and released, and outside the wall too. A value that a search of the ranges finds worse is kept for all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from avc_casadi._errors import InputError, UnsupportedError
from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.json_values import plain
from avc_casadi._util.printed import Columns, Tabular, short
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.claims.law_analysis import LawAnalysis
from avc_casadi.claims.law_limits import LawLimits, NumberLaws
from avc_casadi.claims.stated_law import acting_laws, at_own_rate
from avc_casadi.files.problem_file import AnyProblem, require_wall
from avc_casadi.model.control_law import ControlLaw, LawNumber
from avc_casadi.model.problem import Problem

# Values of the number that the region is over: so many, from its value down and up by this factor.
_VALUES = 21
_REACH = 10.0


@dataclass(frozen=True, eq=False, repr=False)
class LawRegion(Tabular):
    """The stable values of one number of a law, over the values of another.

    Attributes:
        problem: device, hands and law.
        over: key of the number that the region is over.
        of: key of the number of which it gives the stable values.
        own: both numbers of the law as it is.
        values: of the number that it is over, shape (n,).
        least: the least stable value of the other one, shape (n,); not a number where none is stable.
        largest: the largest; infinite without a limit.
    """

    problem: Problem
    over: str
    of: str
    own: tuple[float, float]
    values: FloatArray
    least: FloatArray
    largest: FloatArray

    def to_dict(self) -> Columns:
        """Return the columns by name, each of shape (n,)."""
        return {self.over: self.values, f"least_{self.of}": self.least, f"largest_{self.of}": self.largest}

    def _summary(self) -> str:
        return f"{self.problem.name}: {self.of} up to {short(self.largest)} over {self.over}"

    def document(self) -> dict[str, Any]:
        """Return JSON values; the keys of the numbers are those of the file."""
        key = self.problem.units.key
        numbers = {"over": key(self.over), "of": key(self.of), "own": self.own}
        columns = {"values": self.values, "least": self.least, "largest": self.largest}
        return {"schema": "avc/1", "problem": self.problem.name, **plain({**numbers, **columns})}


def law_region(problem: AnyProblem, over: str, progress: Progress = SILENT) -> LawRegion:
    """Return the stable values of the spring of a stated law, or of its next gain, over those of another number.

    Args:
        problem: with a table [law]: a problem, its file or name.
        over: key of the number, such as ``velocity.cutoff_hz``; or its last part alone, such as ``cutoff``.
        progress: reported over the values.

    Raises:
        InputError: the law has no such number, or no second one.
        UnsupportedError: the problem has no law.
    """
    declared = require_wall(problem)
    stated = at_own_rate(declared)
    law, period_s = stated.law, stated.device.sample_time_s
    if law is None:
        named = stated.name or "it"
        raise UnsupportedError(
            f"{named} has no table [law], but --over names a number of [law]; state your controller", key="law"
        )
    numbers = law.numbers(period_s, stated.lightest_kg)
    first = _named(numbers, over, stated)
    second = next((number for number in numbers if number.linear and number.path != first.path), None)
    if second is None:
        raise InputError.of(f"is {over}, the only number of the law; state a second gain in [law]", key="over")
    wall = stated.environment
    outside = bool(wall.stiffness_n_per_m or wall.damping_ns_per_m) and law.acts_outside
    acting_with = partial(acting_laws, period_s=period_s, outside=outside)
    limits = LawLimits(LawAnalysis(stated).family, acting_with(law).all)
    values = _values(first)
    ends = []
    for place, value in enumerate(values.tolist()):
        progress.advance(place, len(values), "values")
        changed: ControlLaw = law.with_number(first.path, int(value) if first.whole else value)
        of_number = NumberLaws(changed, second, lambda table: acting_with(table).all)
        ends.append(limits.interval(second, of_number) or (np.nan, np.nan))
    least, largest = np.array(ends).T
    return LawRegion(declared, first.key, second.key, (first.value, second.value), values, least, largest)


def _named(numbers: Sequence[LawNumber], name: str, problem: Problem) -> LawNumber:
    """Return the number of a key as the file or the package writes it, or of its last part with or without the unit."""
    keys = {number.path: problem.units.key(number.key) for number in numbers}
    last = {path: key.split(".")[-1] for path, key in keys.items()}
    named = [number for number in numbers if name in (keys[number.path], number.key)]
    named = named or [number for number in numbers if name in (last[number.path], number.path[-1])]
    named = named or [number for number in numbers if last[number.path].startswith(f"{name}_")]
    if len(named) != 1:
        how = "is a part of more than one key" if named else "is no number of the law"
        raise InputError.of(f"is {name!r}, which {how}; allowed: {', '.join(keys.values())}", key="over")
    return named[0]


def _values(number: LawNumber) -> FloatArray:
    """Return values about that of a number by even factors, within its bounds, its own among them."""
    values = number.value * np.geomspace(1 / _REACH, _REACH, _VALUES)
    if number.whole:
        values = np.unique(np.round(values))
    inside = values[(values >= number.lowest) & (values <= number.highest)]
    return np.unique([*inside, number.value])
