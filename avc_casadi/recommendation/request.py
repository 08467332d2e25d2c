"""What is asked of `recommend` beside its problem."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, field
from functools import singledispatch

from avc_casadi._errors import InputError
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.model.ends import End, Wall

_OF_WALLS = ("stiffest", "lean_on_friction", "prove", "with_trade_off", "workers", "executor")
"""Options that apply to a coupling to a wall alone."""


@dataclass(frozen=True)
class Request:
    """Options of `recommend`, documented there."""

    hands: int = 100
    seed: int = 0
    stiffest: bool = False
    lean_on_friction: bool = False
    prove: bool = False
    with_trade_off: bool = False
    versions: Mapping[str, str] = field(default_factory=dict)
    workers: int = 1
    progress: Progress = SILENT
    executor: Executor | None = None


@singledispatch
def request_of(end: End, request: Request) -> Request:  # noqa: ARG001
    """Return the options of `recommend` that apply to a kind of end; `_OF_WALLS` apply to walls alone.

    Raises:
        InputError: an option that does not apply.
    """
    defaults = Request()
    of_walls_alone = [name for name in _OF_WALLS if getattr(request, name) != getattr(defaults, name)]
    if of_walls_alone:
        allowed = "allowed: hands, seed, versions, progress"
        raise InputError.of(f"applies to walls only; {allowed}", key=of_walls_alone[0])
    return Request(request.hands, request.seed, versions=request.versions, progress=request.progress)


@request_of.register
def _request_of_wall(end: Wall, request: Request) -> Request:  # noqa: ARG001
    return request
