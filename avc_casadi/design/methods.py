"""The registry of design methods: a method is one file that says how, and one line here.

A solver takes the problem (and its options, where it has any) and returns a `GainSchedule`. It is named by module and
function, so that asking for one method does not load what the others need.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Literal, get_args

from avc_casadi._errors import InputError
from avc_casadi._util.interrupt import undisguised_interrupts
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.files.problem_file import as_problem
from avc_casadi.model.corners import LINEAR_KEYS
from avc_casadi.model.declared import declared
from avc_casadi.model.problem import Problem

if TYPE_CHECKING:
    from collections.abc import Callable

    from avc_casadi.model.schedule import GainSchedule


MethodName = Literal["closed-form", "direct", "exact", "schedule", "static", "static-tuned", "robust"]


@dataclass(frozen=True)
class Method:
    """One way from a problem to gains.

    Attributes:
        place: ``package:function`` of its solver.
        help: one line for people.
        options: names of `solve`'s options that it takes.
        keeps_realism: whether it keeps ``realism.require``.
        credits_hand: whether it credits ``schedule.hand_damping_ns_per_m`` to the device.
        keeps_ranges: whether it keeps its claim over all of ``[device.range]`` that the linear loop has.
        reports: whether it takes long enough to tell of its progress.
    """

    place: str
    help: str
    options: tuple[str, ...] = ()
    keeps_realism: bool = False
    credits_hand: bool = False
    keeps_ranges: bool = False
    reports: bool = False

    @property
    def solver(self) -> Callable[..., GainSchedule]:
        """Its function, imported now."""
        package, _, name = self.place.partition(":")
        found: Callable[..., GainSchedule] = getattr(import_module(package), name)
        return found


METHODS: Mapping[MethodName, Method] = {
    "closed-form": Method(
        "avc_casadi.paper.closed_form:solve_closed_form",
        "the paper's projection onto Re Z_h >= 0, then back to b and k; for comparison",
        options=("as_printed",),
    ),
    "direct": Method(
        "avc_casadi.design.schedule.scoped:solve_direct_in_scope",
        "the paper's NLP (11)-(12), solved directly at every frequency",
        options=("solver", "tolerance"),
        keeps_realism=True,
        reports=True,
    ),
    "exact": Method(
        "avc_casadi.paper.exact:solve_exact", "the global optimum of (11)-(12) from arc geometry", reports=True
    ),
    "schedule": Method(
        "avc_casadi.design.schedule.solver:solve_schedule",
        "all frequencies as one optimal-control problem: smooth gains that meet the problem's scope",
        keeps_realism=True,
        credits_hand=True,
        reports=True,
    ),
    "static": Method(
        "avc_casadi.design.constant.static:solve_static", "the best constant gains under Llewellyn's condition (6)"
    ),
    "static-tuned": Method(
        "avc_casadi.design.constant.static_tuned:solve_static_tuned",
        "the best constant gains, stable with every hand of [hands] and at rest in the scene",
        reports=True,
    ),
    "robust": Method(
        "avc_casadi.design.robust.solve:solve_robust",
        "the wall behind an observer with state feedback, for every hand and a device not quite as declared",
        keeps_ranges=True,
        reports=True,
    ),
}
assert tuple(METHODS) == get_args(MethodName)  # noqa: S101 - the type and the registry name the same methods


_UNUSED_RANGES = {f"device.range.{key}" for key in LINEAR_KEYS} - {
    "device.range.mass_kg",
    "device.range.damping_ns_per_m",
}
"""Ranges of what the linear loop has, of which most methods know no more than the nominal value."""


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
        KeyboardInterrupt: Ctrl-C, whatever CasADi made of it.

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
    with undisguised_interrupts():
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
    """Say what the problem asks for and the method does not know: realism, ranges of the device, the hand's credit."""
    notes = []
    require = problem.realism.require
    if require != "none" and not method.keeps_realism:
        keepers = ", ".join(name for name, one in METHODS.items() if one.keeps_realism)
        notes.append(f'{gains.method} does not know realism.require = "{require}"; methods that keep it: {keepers}')
    unused = [key for key in declared(problem) if key in _UNUSED_RANGES]
    if unused and not method.keeps_ranges:
        notes.append(
            f"designed for the nominal value of {', '.join(unused)}: a design keeps its claim over the ranges of mass"
            " and damping; certify judges every corner of the others"
        )
    credit = problem.schedule.hand_damping_ns_per_m
    if credit and method.credits_hand and problem.stability.scope != "hands":
        notes.append(f"Re Z_h counts {credit:g} N.s/m of the hand's damping (schedule.hand_damping_ns_per_m)")
    elif credit:
        takers = ", ".join(name for name, one in METHODS.items() if one.credits_hand)
        notes.append(
            "schedule.hand_damping_ns_per_m is not credited: it counts in Re Z_h of method"
            f" {takers}, and not with scope hands"
        )
    return replace(gains, notes=(*gains.notes, *notes))
