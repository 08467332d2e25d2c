"""Writing a problem as the text of a problem file."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

from avc_casadi.problem._model import Problem


def dump_problem(problem: Problem) -> str:
    """Write a problem as TOML with every value in it, also those that were defaults.

    The name is not written: it is that of the file.

    Args:
        problem: any problem.

    Returns:
        Text from which `parse_problem` makes an equal problem.
    """
    tables = problem.model_dump(exclude={"name"}, exclude_none=True)
    if "values_hz" in tables["frequency"]:
        tables["frequency"] = {"values_hz": tables["frequency"]["values_hz"]}
    return "\n".join(_table((), tables)).lstrip("\n") + "\n"


def _table(path: tuple[str, ...], table: Mapping[str, Any]) -> Iterator[str]:
    """Write the plain keys of a table, then the tables in it."""
    for key, value in table.items():
        if not _is_inner(value):
            yield f"{key} = {_value(value)}"
    for key, value in table.items():
        inner, header = (*path, key), ".".join((*path, key))
        if isinstance(value, Mapping):
            if value:
                yield f"\n[{header}]"
            yield from _table(inner, value)
        elif _is_inner(value):
            for item in value:
                yield f"\n[[{header}]]"
                yield from _table(inner, item)


def _is_inner(value: object) -> bool:
    return isinstance(value, Mapping) or (
        isinstance(value, tuple) and any(isinstance(i, Mapping) for i in value)
    )


def _value(value: object) -> str:
    if isinstance(value, tuple):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, str):
        # A JSON string is a TOML string, but that JSON lets the delete character stand.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(value)
