"""Problems for the schedule's tests: figure 5 with tables replaced, on few frequencies."""

from __future__ import annotations

from typing import Any

from avc_casadi.files.problem_file import dump_problem, load_problem, parse_problem
from avc_casadi.model.problem import Problem


def changed(problem: Problem, **tables: dict[str, Any]) -> Problem:
    """Return the problem with keys of its tables replaced, validated anew."""
    updated = problem.model_copy(
        update={name: getattr(problem, name).model_copy(update=keys) for name, keys in tables.items()}
    )
    return parse_problem(dump_problem(updated), name=problem.name)


def figure5(*, points: int = 40, **tables: dict[str, Any]) -> Problem:
    """Figure 5 on ``points`` frequencies with some keys replaced."""
    return changed(load_problem("figure5"), frequency={"points": points}, **tables)
