"""One entry for all design methods."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from typing import TYPE_CHECKING, Literal, get_args

from avc_casadi._errors import InputError

if TYPE_CHECKING:
    from avc_casadi.design._gains import GainSchedule
    from avc_casadi.problem import Problem

Method = Literal["closed-form", "direct", "exact", "schedule", "static", "static-tuned"]
METHODS: tuple[Method, ...] = get_args(Method)

# Imported on demand: some need CasADi, which takes a while to load, and tuning stands above this package.
_WITHOUT_OPTIONS = {
    "exact": ("avc_casadi.design._exact", "solve_exact"),
    "schedule": ("avc_casadi.design.schedule", "solve_schedule"),
    "static": ("avc_casadi.design._static", "solve_static"),
    "static-tuned": ("avc_casadi.tuning", "solve_static_tuned"),
}


def solve(
    problem: Problem,
    method: str = "direct",
    *,
    solver: str | None = None,
    tolerance: float | None = None,
    as_printed: bool = False,
) -> GainSchedule:
    """Solve a problem at all its frequencies.

    Args:
        problem: the problem.
        method: one of `METHODS`.
        solver: solver of ``direct``; None is its default.
        tolerance: requested relative tolerance of a CasADi solver, 1e-14 to 1; None is its default.
        as_printed: closed form only, the equations as the paper prints them.

    Raises:
        InputError: unknown method or solver, or an option that the method does not have.
    """
    if method not in METHODS:
        raise InputError.of(f"{method!r} is no method; allowed: {', '.join(METHODS)}", key="--method")
    if as_printed and method != "closed-form":
        raise InputError.of(f"only closed-form has a printed form, not {method}", key="--as-printed")
    if method != "direct" and (solver is not None or tolerance is not None):
        raise InputError.of(f"{method} has no solver to choose; allowed with: direct", key="--solver")
    if tolerance is not None and not 1e-14 <= tolerance <= 1:
        raise InputError.of(f"{tolerance:g} is no tolerance; allowed: 1e-14 to 1", key="--tolerance")
    if method in _WITHOUT_OPTIONS:
        module, name = _WITHOUT_OPTIONS[method]
        found: GainSchedule = getattr(import_module(module), name)(problem)
        return found if method == "schedule" else _without_realism(problem, found)
    if method == "closed-form":
        from avc_casadi.design._closed_form import solve_closed_form  # noqa: PLC0415

        return _without_realism(problem, solve_closed_form(problem, as_printed=as_printed))
    if problem.stability.scope != "pointwise" or problem.realism.require != "none":
        from avc_casadi.design._scoped import solve_scoped  # noqa: PLC0415

        return solve_scoped(problem, solver=solver)
    from avc_casadi.design._direct import solve_direct  # noqa: PLC0415

    return solve_direct(problem, solver=solver, tolerance=tolerance)


def _without_realism(problem: Problem, gains: GainSchedule) -> GainSchedule:
    """Say of a method that keeps no realism that the problem's requirement is not met by design."""
    require = problem.realism.require
    if require == "none":
        return gains
    note = f'{gains.method} does not know realism.require = "{require}"; methods that keep it: direct, schedule'
    return replace(gains, notes=(*gains.notes, note))
