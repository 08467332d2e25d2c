"""A coupling or gain file with another problem: refused where the loop differs, noted where the problem differs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import avc_casadi as avc

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling
    from avc_casadi.model.schedule import GainSchedule


def gains_for(problem: avc.Problem, file: str) -> tuple[Coupling | GainSchedule, list[str]]:
    """Read a file for a problem, with notes on how its own problem differs.

    A coupling file is checked as everywhere and put on this problem with its table and runtime; a table of gains alone
    stays one.

    Raises:
        InputError: faults of the file, or another sample time: frequencies and gains then mean another loop.
    """
    from avc_casadi.coupling import Coupling, check_sample_time
    from avc_casadi.files.coupling_file import read_file, same_problem

    found = read_file(file)
    check_sample_time(found.sample_time_s, problem, file)
    if isinstance(found, Coupling):
        if same_problem(problem, found.problem):
            return found, []
        note = f"the coupling was made for {found.problem.name} with another {_differing(problem, found.problem)}"
        return found.on(problem), [note]
    pairs: list[tuple[str, str, str]] = [("structure", found.structure, problem.coupling.structure)]
    if found.method != "file":  # a bare table names neither problem nor model
        pairs = [
            ("problem", found.problem, problem.name),
            ("model", found.model, problem.stability.model),
            *pairs,
        ]
    return found, [
        f"the gains were designed for {what} {theirs}, not {ours}" for what, theirs, ours in pairs if theirs != ours
    ]


def _differing(one: avc.Problem, other: avc.Problem) -> str:
    """Name the tables in which two problems differ."""
    mine, theirs = one.model_dump(), other.model_dump()
    return ", ".join(f"[{key}]" for key in mine if isinstance(mine[key], dict) and mine[key] != theirs[key])
