"""The registry of design methods."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, cast

from avc_casadi import model
from avc_casadi._util.registry import Registry

if TYPE_CHECKING:
    from avc_casadi.model.gains import GainSchedule  # loads numpy

MethodName = str  # that `METHODS` knows


@dataclass(frozen=True)
class Method:
    """One method from a problem to gains.

    Attributes:
        place: module and function of its solver, as "package.module:function".
        options: the options of `solve` that it takes.
        keeps_realism: whether its gains meet realism.require.
        credits_hand: whether it counts schedule.hand_damping_ns_per_m in Re Z_h.
        keeps_ranges: whether its claim holds over all of [device.range].
        reports: whether it takes long enough to report progress.
        pointwise: whether it solves (11)-(12) at each frequency alone, fast enough for interactive use.
        optimises: whether it minimises (11), so that the others are judged against it.
    """

    place: str
    options: tuple[str, ...] = ()
    keeps_realism: bool = False
    credits_hand: bool = False
    keeps_ranges: bool = False
    reports: bool = False
    pointwise: bool = False
    optimises: bool = False

    @property
    def solver(self) -> Callable[..., GainSchedule]:
        """The solver function, imported on access."""
        package, name = self.place.split(":")
        return cast("Callable[..., GainSchedule]", getattr(import_module(package), name))


METHODS: Registry[Method] = model.METHODS
_METHODS = {
    "closed-form": Method(
        "avc_casadi.paper.closed_form:solve_closed_form",
        options=("as_printed",),
        pointwise=True,
    ),
    "direct": Method(
        "avc_casadi.paper.direct:solve_direct",
        options=("solver", "tolerance"),
        reports=True,
        pointwise=True,
        optimises=True,
    ),
    "exact": Method(
        "avc_casadi.paper.exact:solve_exact",
        reports=True,
        pointwise=True,
        optimises=True,
    ),
    "schedule": Method(
        "avc_casadi.design.schedule:solve_schedule",
        keeps_realism=True,
        credits_hand=True,
        reports=True,
    ),
    "static": Method("avc_casadi.design.static:solve_static"),
    "static-tuned": Method(
        "avc_casadi.design.tuned:solve_static_tuned",
        reports=True,
    ),
    "robust": Method(
        "avc_casadi.design.program:solve_robust",
        keeps_ranges=True,
        reports=True,
    ),
}
for _rank, (_name, _method) in enumerate(_METHODS.items()):
    METHODS.add(_name, _method, _rank)


def methods_help() -> str:
    """Return the names of the methods for a help text."""
    *names, last = METHODS
    return f"{', '.join(names)} or {last}"
