"""A problem as the text of a problem file, and as a JSON document and back."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

from avc_casadi._errors import Fault, InputError
from avc_casadi.model.findings import checked
from avc_casadi.model.problem import Problem
from avc_casadi.model.quantity import dotted


def dump_problem(problem: Problem) -> str:
    """Write a problem as TOML with every value, defaults included.

    The name is not written: it is that of the file.

    Args:
        problem: any problem.

    Returns:
        Text from which `parse_problem` makes an equal problem.

    Example:
        >>> text = avc.dump_problem(avc.load_problem("figure5"))
        >>> avc.parse_problem(text, name="figure5") == avc.load_problem("figure5")
        True
    """
    tables = problem.model_dump(exclude={"name"}, exclude_none=True)
    if "values_hz" in tables["frequency"]:
        tables["frequency"] = {"values_hz": tables["frequency"]["values_hz"]}
    return "\n".join(_lines((), problem.units.keyed(tables))) + "\n"


def problem_document(problem: Problem) -> dict[str, Any]:
    """Return a problem as JSON values, with its name and every value, defaults included."""
    tables: dict[str, Any] = problem.model_dump(mode="json", exclude_none=True)
    if "values_hz" in tables["frequency"]:
        tables["frequency"] = {"values_hz": tables["frequency"]["values_hz"]}
    return tables


def problem_of(document: Mapping[str, Any], *, file: str = "problem", key: str = "") -> Problem:
    """Read `problem_document` back."""
    name = document.get("name", "")
    tables = {table: values for table, values in document.items() if table != "name"}
    found = checked(Problem, tables, name if isinstance(name, str) else "")
    if isinstance(found, list):
        prefix = f"{key}." if key else ""
        raise InputError([Fault(file, None, f"{prefix}{dotted(path)}", message) for path, message in found])
    return found


def _lines(path: tuple[str, ...], table: Mapping[str, Any]) -> Iterator[str]:
    """Write the plain keys of a table, its kind first, then the tables in it."""
    for key in sorted(table, key=lambda key: key != "kind"):
        if not _holds_tables(table[key]):
            yield f"{key} = {_value(table[key])}"
    for key, value in table.items():
        if not _holds_tables(value):
            continue
        inner, header = (*path, key), ".".join((*path, key))
        for item in (value,) if isinstance(value, Mapping) else value:
            if not isinstance(value, Mapping):
                yield f"\n[[{header}]]"
            elif not all(map(_holds_tables, item.values())):
                yield f"\n[{header}]"
            yield from _lines(inner, item)


def _holds_tables(value: object) -> bool:
    """Return whether a value is a table or a list of tables; no plain list of a problem is empty."""
    return isinstance(value, Mapping) or (isinstance(value, tuple) and all(isinstance(item, Mapping) for item in value))


def _value(value: object) -> str:
    if isinstance(value, tuple):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)  # a TOML string too: control characters were refused
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(value)
