"""The registry of design methods: a method is one file that says how, and one line here.

A solver takes the problem (and its options, where it has any) and returns a `GainSchedule`. It is named by module and
function, so that asking for one method does not load what the others need.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Literal, get_args

if TYPE_CHECKING:
    from collections.abc import Callable

    from avc_casadi.coupling import GainSchedule

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
        "avc_casadi.design.pointwise:solve_closed_form",
        "the paper's projection onto Re Z_h >= 0, then back to b and k; for comparison",
        options=("as_printed",),
    ),
    "direct": Method(
        "avc_casadi.design.joint:solve_direct_in_scope",
        "the paper's NLP (11)-(12), solved directly at every frequency",
        options=("solver", "tolerance"),
        keeps_realism=True,
        reports=True,
    ),
    "exact": Method(
        "avc_casadi.design.pointwise:solve_exact", "the global optimum of (11)-(12) from arc geometry", reports=True
    ),
    "schedule": Method(
        "avc_casadi.design.joint:solve_schedule",
        "all frequencies as one optimal-control problem: smooth gains that meet the problem's scope",
        keeps_realism=True,
        credits_hand=True,
        reports=True,
    ),
    "static": Method(
        "avc_casadi.design.constant:solve_static", "the best constant gains under Llewellyn's condition (6)"
    ),
    "static-tuned": Method(
        "avc_casadi.design.constant:solve_static_tuned",
        "the best constant gains, stable with every hand of [hands] and at rest in the scene",
        reports=True,
    ),
    "robust": Method(
        "avc_casadi.design.robust:solve_robust",
        "the wall behind an observer with state feedback, for every hand and a device not quite as declared",
        keeps_ranges=True,
        reports=True,
    ),
}
assert tuple(METHODS) == get_args(MethodName)  # noqa: S101 - the type and the registry name the same methods
