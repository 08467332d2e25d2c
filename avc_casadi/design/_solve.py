"""One entry for all design methods."""

from __future__ import annotations

import difflib
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from avc_casadi._errors import InputError
from avc_casadi.design._methods import METHODS, Method, MethodName
from avc_casadi.problem import Problem, as_problem
from avc_casadi.support import SILENT, Progress

if TYPE_CHECKING:
    from avc_casadi.coupling import GainSchedule


def solve(
    problem: Problem | str | Path,
    method: MethodName = "direct",
    *,
    solver: str | None = None,
    tolerance: float | None = None,
    as_printed: bool = False,
    progress: Progress = SILENT,
) -> GainSchedule:
    """Solve a problem at all its frequencies.

    Args:
        problem: the problem; or a problem file, or a name of the catalogue.
        method: one of `METHODS`: closed-form, direct, exact, schedule, static, static-tuned, robust.
        solver: solver of ``direct``; None is its default.
        tolerance: requested relative tolerance of a CasADi solver, 1e-14 to 1; None is its default.
        as_printed: closed form only, the equations as the paper prints them.
        progress: told of the frequencies, starts or trials that are done.

    Raises:
        InputError: unknown method or solver, or an option that the method does not have.

    Example:
        >>> gains = avc.solve("figure5", "direct")
        >>> gains.counts()
        {'active-bound': 105, 'solved': 95}
    """
    chosen = METHODS[method_named(method)]
    given = {"solver": solver, "tolerance": tolerance, "as_printed": as_printed or None}
    options = {name: value for name, value in given.items() if value is not None}
    foreign = [name for name in options if name not in chosen.options]
    if foreign:
        takers = {name: [other for other, one in METHODS.items() if name in one.options] for name in foreign}
        raise InputError.of(
            "; ".join(f"{name} is no option of {method}, but of {', '.join(takers[name])}" for name in foreign),
            key=foreign[0],
        )
    if tolerance is not None and not 1e-14 <= tolerance <= 1:
        raise InputError.of(f"is {tolerance:g}; allowed: 1e-14 to 1", key="tolerance")
    stated = as_problem(problem)
    told = {"progress": progress} if chosen.reports else {}
    return _noted(stated, chosen, chosen.solver(stated, **options, **told))


def method_named(name: str) -> MethodName:
    """Return the name of a method that the registry knows.

    Raises:
        InputError: there is none of that name; says which is near and lists all.
    """
    for known in METHODS:
        if known == name:
            return known
    near = difflib.get_close_matches(name, METHODS, n=1)
    hint = f", did you mean {near[0]}?" if near else ""
    raise InputError.of(f"{name!r} is no method{hint}; allowed: {', '.join(METHODS)}", key="method")


def _noted(problem: Problem, method: Method, gains: GainSchedule) -> GainSchedule:
    """Say of a method that keeps no realism that the problem's requirement is not met by design."""
    require = problem.realism.require
    if require == "none" or method.keeps_realism:
        return gains
    keepers = ", ".join(name for name, one in METHODS.items() if one.keeps_realism)
    note = f'{gains.method} does not know realism.require = "{require}"; methods that keep it: {keepers}'
    return replace(gains, notes=(*gains.notes, note))
