"""Shared parts of the two exports of couplings to another end: checks, verdict, and names of files."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

from avc_casadi import InputError, NotDeployableError
from avc_hardware.codegen.export import NAME, renamed
from avc_hardware.codegen.operations import PRECISIONS, Precision
from avc_hardware.codegen.packages import checked_name

if TYPE_CHECKING:
    from collections.abc import Mapping

    from avc_casadi.model.lifted_loop import ToolGains
    from avc_casadi.model.problem import Problem

FADE_S = 0.05
"""Fade time of a force, down and up: long for a sample, short for a hand."""


class Loops(Protocol):
    """All loops of a problem."""

    def __len__(self) -> int:
        """Number of loops."""

    def stable(self, gains: ToolGains) -> bool:
        """Whether every loop is stable."""

    def radius(self, gains: ToolGains) -> tuple[float, Any]:
        """Return the largest spectral radius and its loop."""


def checked(precision: str, name: str) -> Precision:
    """Return a precision by name.

    Raises:
        InputError: no such precision, or a name invalid in C.
    """
    if precision not in PRECISIONS:
        raise InputError.of(f"is {precision!r}; allowed: {', '.join(PRECISIONS)}", key="precision")
    checked_name(name)
    return PRECISIONS[precision]


def verdict(problem: Problem, loops: Loops, gains: ToolGains, *, unsafe: bool, also: str = "") -> str:
    """Judge gains on the loops of their own problem, independent of any certificate; return a sentence.

    Args:
        problem: for the message.
        loops: of the problem.
        gains: K, N/m, and dampers, N.s/m, at the device.
        unsafe: whether gains that are not stable are written too.
        also: further validity of the loops.

    Raises:
        NotDeployableError: a loop is not stable.
    """
    if loops.stable(gains):
        return f"deployable: all {len(loops)} loops are linearly stable, with every hand of [hands] and released{also}"
    radius, case = loops.radius(gains)
    who = "with a hand" if any(case.hand.values()) else "released"
    why = f"not deployable: linearly unstable {who}, spectral radius {radius:.6g}"
    if not unsafe:
        raise NotDeployableError(f"{problem.name}: {why}. Make it again: avc recommend P --out FILE")
    return f"UNSAFE, written by request: {why}"


def named(problem: Problem, files: Mapping[str, str], name: str) -> dict[str, str]:
    """Return files in the units of a device, under a given name."""
    made = {file: problem.units.code(text) for file, text in files.items()}
    return made if name == NAME else {renamed(file, name): renamed(text, name) for file, text in made.items()}
