"""Gains of a file beside a problem: refused where they mean another loop, noted where made for another problem."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import avc_casadi as avc

if TYPE_CHECKING:
    from avc_casadi.coupling import GainSchedule


def gains_for(problem: avc.Problem, file: str) -> tuple[GainSchedule, list[str]]:
    """Read a gain file, and say in notes what it was designed for other than this problem.

    Raises:
        InputError: faults of the file, or another sample time: frequencies and gains then mean another loop.
    """
    from avc_casadi.coupling import check_sample_time, read_gains

    gains = read_gains(Path(file))
    check_sample_time(gains.sample_time_s, problem, file)
    pairs: list[tuple[str, str, str]] = [("structure", gains.structure, problem.coupling.structure)]
    if gains.method != "file":  # a bare table names neither problem nor model
        pairs = [
            ("problem", gains.problem, problem.name),
            ("model", gains.model, problem.stability.model),
            *pairs,
        ]
    return gains, [
        f"the gains were designed for {what} {theirs}, not {ours}" for what, theirs, ours in pairs if theirs != ours
    ]
