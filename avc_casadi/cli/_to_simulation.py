"""Input of a command with a simulation at the other end: a problem with [simulation], or its coupling."""

from __future__ import annotations

import argparse
from shlex import quote
from typing import TYPE_CHECKING

import avc_casadi as avc
from avc_casadi.cli._console import Console
from avc_casadi.cli._subject import is_coupling, load_problem

if TYPE_CHECKING:
    from avc_casadi.model.lifted_loop import ToolGains
    from avc_casadi.other_end_coupling import ToolCoupling


def couples_to_simulation(source: str) -> bool:
    """Return whether a source is a coupling to a simulation, or a problem with one; False if unreadable.

    Args:
        source: as typed.
    """
    if is_coupling(source):
        from avc_casadi.files.other_end_coupling_file import is_tool_coupling

        return is_tool_coupling(source)
    try:
        return avc.load_problem(source).simulation is not None
    except avc.AvcError:  # reported where it is loaded
        return False


def read_tool(file: str) -> ToolCoupling:
    """Read a coupling to a simulation, and set the units of output to those of its device."""
    from avc_casadi._util.units import speak
    from avc_casadi.files.other_end_coupling_file import read_tool_coupling

    found = read_tool_coupling(file)
    speak(found.problem.units)
    return found


def problem_and_gains(
    source: str, gains: str | None, console: Console | None = None
) -> tuple[avc.Problem, ToolGains | None]:
    """Return the problem, and the gains; None where a problem came alone and none are asked for.

    Args:
        source: problem, or coupling to a simulation.
        gains: file of the gains, for a problem.
        console: shows the search of the recommended ones; without one none are searched.

    Raises:
        InputError: gains with a coupling, of another kind, or none is deployable.
    """
    from avc_casadi.files.other_end_coupling_file import is_tool_coupling

    if is_coupling(source):
        if gains is not None:
            raise avc.InputError.of("is given beside a coupling; give the problem, or leave it out", file=gains)
        coupling = read_tool(source)
        return coupling.problem, coupling.gains
    problem = load_problem(source)
    if gains is not None:
        if not is_tool_coupling(gains):
            make = f"avc recommend {quote(source)} --out c.json"
            raise avc.InputError.of(f"is no coupling to a simulation; make one: {make}", file=gains)
        return problem, read_tool(gains).gains
    return problem, None if console is None else _recommended(problem, source, console)


def _recommended(problem: avc.Problem, source: str, console: Console) -> ToolGains:
    """Return the recommended coupling."""
    from avc_casadi.design.virtual_tool import ToolSearch
    from avc_casadi.recommendation.tried_tool import tried_coupling
    from avc_casadi.recommendation.virtual_tool import why_infeasible

    search = ToolSearch(problem)
    with console.step("recommended coupling"):
        why = why_infeasible(problem, search)
        found = None if why else tried_coupling(problem, search, progress=console)[0]
    if found is None:
        told = f"no coupling is deployable, which avc recommend {quote(source)} explains; give one: --gains c.json"
        raise avc.InputError.of(told, file=source)
    return found


def refuse(args: argparse.Namespace, options: tuple[str, ...]) -> None:
    """Refuse options that need a wall.

    Raises:
        InputError: names the first one.
    """
    given = [one for one in options if getattr(args, one) not in (None, False, 0)]
    if given:
        key = f"--{given[0].replace('_', '-')}"
        raise avc.InputError.of("is asked of walls, and the other end is a [simulation]; leave it out", key=key)
