"""The registry of design methods; each is one file in `avc_casadi.design.method`.

A solver takes the problem (and its options, where it has any) and returns a `GainSchedule`. It is named by module and
function, so that naming the methods loads neither numpy nor CasADi.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING

from avc_casadi.model import registries

if TYPE_CHECKING:
    from collections.abc import Callable

    from avc_casadi._util.registry import Registry
    from avc_casadi.model.problem import Model, Structure
    from avc_casadi.model.schedule import GainSchedule

MethodName = str
"""A name that `METHODS` knows."""


@dataclass(frozen=True)
class Candidate:
    """One coupling of a method that studies compare with the same hands.

    Attributes:
        name: its name in tables.
        help: description, one line.
        rank: its order among those of all methods.
        tuned: structure in which it is tuned for the training hands; None designs the problem as it is stated.
        model: model of the stability condition; None is the problem's.
        constant: whether its gains are constant over frequency.
        meets_others: whether it is tried with hands outside the design set too.
    """

    name: str
    help: str
    rank: float
    tuned: Structure | None = None
    model: Model | None = None
    constant: bool = False
    meets_others: bool = False


@dataclass(frozen=True)
class Method:
    """One method from a problem to gains.

    Attributes:
        place: ``package:function`` of its solver.
        help: printed line.
        options: names of `solve`'s options that it takes.
        keeps_realism: whether it keeps ``realism.require``.
        credits_hand: whether it credits ``schedule.hand_damping_ns_per_m`` to the device.
        keeps_ranges: whether it keeps its claim over the parameters of the linear loop in ``[device.range]``.
        reports: whether it takes long enough to report progress.
        answers_paper: whether it solves the paper's problem, (11)-(12).
        pointwise: whether it does so at each frequency alone; these are compared.
        optimises: whether it minimises (11), so that the others are judged against it.
        live: whether it is fast enough for interactive use.
        candidates: the couplings by it that studies compare.
    """

    place: str
    help: str
    options: tuple[str, ...] = ()
    keeps_realism: bool = False
    credits_hand: bool = False
    keeps_ranges: bool = False
    reports: bool = False
    answers_paper: bool = False
    pointwise: bool = False
    optimises: bool = False
    live: bool = False
    candidates: tuple[Candidate, ...] = ()

    @property
    def solver(self) -> Callable[..., GainSchedule]:
        """The solver function, imported on access."""
        package, _, name = self.place.partition(":")
        found: Callable[..., GainSchedule] = getattr(import_module(package), name)
        return found


METHODS: Registry[Method] = registries.METHODS


def methods_help() -> str:
    """Return the names of the methods for a help text."""
    *names, last = METHODS
    return f"{', '.join(names)} or {last}"
