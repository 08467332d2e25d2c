"""What the page asks of each other end: its fields, its gains, and the methods by which these come about."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from avc_casadi.design.registry import METHODS
from avc_casadi.present.explore.fields import FIELDS, GAINS, OWN, Field
from avc_casadi.present.explore.tool_fields import TOOL_FIELDS, TOOL_GAINS

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem


@dataclass(frozen=True)
class Form:
    """What is asked of one other end."""

    end: str
    fields: tuple[Field, ...]
    gains: tuple[Field, ...]
    live: tuple[str, ...]
    slow: tuple[str, ...]
    own: tuple[Field, ...] = ()

    @cached_property
    def keys(self) -> frozenset[str]:
        """Dotted keys of the fields of the problem file."""
        return frozenset(field.key for field in self.fields)

    @cached_property
    def gain_names(self) -> tuple[str, ...]:
        """Names of the gains."""
        return tuple(field.key.removeprefix("gains.") for field in self.gains)

    @cached_property
    def own_names(self) -> tuple[str, ...]:
        """Names of the values of the law of one's own."""
        return tuple(field.key.removeprefix("own.") for field in self.own)


WALL = Form(
    "wall",
    FIELDS,
    GAINS,
    (*(name for name, one in METHODS.items() if one.live), "constant"),
    ("recommend", *(name for name, one in METHODS.items() if not one.live)),
    OWN,
)
TOOL = Form("simulation", TOOL_FIELDS, TOOL_GAINS, ("constant",), ("recommend",))


def form_of(problem: Problem) -> Form:
    """Return what the page asks about a problem."""
    return WALL if problem.simulation is None else TOOL
