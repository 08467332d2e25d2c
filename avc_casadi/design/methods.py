"""Solve a problem by one of the methods of the registry."""

from __future__ import annotations

from dataclasses import replace

from avc_casadi._errors import InputError
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.design.registry import METHODS, Method, MethodName
from avc_casadi.files.problem_file import AnyProblem, accepts_problem, require_wall
from avc_casadi.model.corners import LINEAR_KEYS
from avc_casadi.model.declared import declared
from avc_casadi.model.gains import GainSchedule
from avc_casadi.model.problem import Problem
from avc_casadi.model.quantity import Quantity, refuse_quantities
from avc_casadi.model.table import shown

_UNUSED_RANGES = {f"device.range.{key}" for key in LINEAR_KEYS} - {
    "device.range.mass_kg",
    "device.range.damping_ns_per_m",
}
"""Ranges of the linear loop's parameters, of which most methods use the nominal value only."""

SMALLEST_TOLERANCE = 1e-14
"""Smallest relative tolerance that may be requested of a CasADi solver; the largest is 1."""


@accepts_problem
def solve(
    problem: AnyProblem,
    method: MethodName = "direct",
    *,
    solver: str | None = None,
    tolerance: float | None = None,
    as_printed: bool = False,
    progress: Progress = SILENT,
) -> GainSchedule:
    """Return the gains of a coupling at each frequency by one of the methods.

    At each frequency of interaction the pair (b, k) minimises (|Z_h_ds| - |Z_h_avc|)^2, the paper's goal (11), with
    Re Z_h_avc no less than the margin (12), within the box of [coupling].

    Args:
        problem: the problem; or a problem file, or a name of the catalogue.
        method: a name that `METHODS` knows; ``avc solve --help`` lists them.
        solver: solver of ``direct``; None is its default.
        tolerance: requested relative tolerance of a CasADi solver, 1e-14 to 1; None is its default.
        as_printed: closed form only, the equations as the paper prints them.
        progress: reports frequencies, starts or trials done.

    Returns:
        The gains, arrays of shape (n,) over ``frequency_hz``: b, N.s/m, and k, N/m, with a status for each row.

    Raises:
        InputError: unknown method or solver, or an option that the method does not have.
        UnsupportedError: what the problem declares has no place in the method; the message names one that takes it.
        KeyboardInterrupt: Ctrl-C, also while CasADi runs.

    Example:
        >>> gains = avc.solve("figure5", "direct")
        >>> gains.counts()
        {'active-bound': 105, 'solved': 95}
    """
    chosen = METHODS.named(method)
    given = {"solver": solver, "tolerance": tolerance, "as_printed": as_printed or None}
    options = {name: value for name, value in given.items() if value is not None}
    foreign = [name for name in options if name not in chosen.options]
    if foreign:
        faults = [f"{name} does not apply to {method}, only to {_methods_with_option(name)}" for name in foreign]
        raise InputError.of("; ".join(faults), key=foreign[0])
    refuse_quantities({"tolerance": (tolerance, Quantity("", SMALLEST_TOLERANCE, 1.0, zero=False))})
    if solver is not None and not isinstance(solver, str):
        raise InputError.of(f"is {shown(solver)}; allowed: the name of a solver", key="solver")
    stated = require_wall(problem)
    reports = {"progress": progress} if chosen.reports else {}
    with progress.step(f"{method}: {len(stated.frequencies_hz())} frequencies"):
        return _noted(stated, chosen, chosen.solver(stated, **options, **reports))


def _methods_with_option(option: str) -> str:
    """Return the names of the methods that take an option of `solve`, joined by commas."""
    return ", ".join(name for name, method in METHODS.items() if option in method.options)


def _noted(problem: Problem, method: Method, gains: GainSchedule) -> GainSchedule:
    """Add notes on keys that the method ignores: realism, ranges of the device, the hand's credit."""
    notes = []
    require = problem.realism.require
    if require != "none" and not method.keeps_realism:
        keepers = ", ".join(name for name, known in METHODS.items() if known.keeps_realism)
        notes.append(f'{gains.method} does not support realism.require = "{require}"; methods that do: {keepers}')
    unused = [key for key in declared(problem) if key in _UNUSED_RANGES]
    if unused and not method.keeps_ranges:
        notes.append(
            f"designed for the nominal value of {', '.join(unused)}: a design covers the ranges of mass and damping "
            "only; avc certify judges every corner of the other ranges"
        )
    notes += _credit_notes(problem, method)
    return replace(gains, notes=(*gains.notes, *notes), definition=problem)


def _credit_notes(problem: Problem, method: Method) -> list[str]:
    """Return a note on whether the hand's damping counts, where the problem credits it."""
    credit = problem.schedule.hand_damping_ns_per_m
    if not credit:
        return []
    if method.credits_hand and problem.stability.scope != "hands":
        unit = problem.units.unit("N.s/m")
        return [f"Re Z_h counts {credit:g} {unit} of the hand's damping (schedule.hand_damping_ns_per_m)"]
    crediting = ", ".join(name for name, known in METHODS.items() if known.credits_hand)
    note = (
        f"schedule.hand_damping_ns_per_m is not used: only method {crediting} adds it to Re Z_h, "
        "and not with scope hands"
    )
    return [note]
