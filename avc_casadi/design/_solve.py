"""One entry for all design methods."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, get_args

from avc_casadi._errors import InputError

if TYPE_CHECKING:
    from avc_casadi.design._gains import GainSchedule
    from avc_casadi.problem import Problem

Method = Literal["closed-form", "direct", "exact", "schedule", "static"]
METHODS: tuple[Method, ...] = get_args(Method)


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
    # Each method is imported on demand: only direct needs CasADi, which takes a while to load.
    if method == "closed-form":
        from avc_casadi.design._closed_form import solve_closed_form  # noqa: PLC0415

        return solve_closed_form(problem, as_printed=as_printed)
    if method == "exact":
        from avc_casadi.design._exact import solve_exact  # noqa: PLC0415

        return solve_exact(problem)
    if method == "static":
        from avc_casadi.design._static import solve_static  # noqa: PLC0415

        return solve_static(problem)
    if method == "schedule":
        from avc_casadi.design.schedule import solve_schedule  # noqa: PLC0415

        return solve_schedule(problem)
    if problem.stability.scope != "pointwise":
        from avc_casadi.design._scoped import solve_scoped  # noqa: PLC0415

        return solve_scoped(problem, solver=solver)
    from avc_casadi.design._direct import solve_direct  # noqa: PLC0415

    return solve_direct(problem, solver=solver, tolerance=tolerance)
