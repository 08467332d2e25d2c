"""Which key is meant by one that its table has not: a key of that table, or the same key in another table."""

from __future__ import annotations

import difflib
import typing
from collections.abc import Iterator, Mapping
from functools import lru_cache
from typing import Any, Literal

from pydantic import BaseModel

from avc_casadi._util.units import ROTARY
from avc_casadi.model.annotation import inside, tables_of

Kind = Literal["table", "list", "value"]

_SYMBOLS = {
    "k": "stiffness_n_per_m",
    "kp": "stiffness_n_per_m",
    "b": "damping_ns_per_m",
    "d": "damping_ns_per_m",
    "kd": "damping_ns_per_m",
    "ki": "integral_n_per_m_s",
    "m": "mass_kg",
    "dt": "sample_time_s",
    "ts": "sample_time_s",
}
"""Symbols that control engineers write, and the key of the same meaning; in a rotary file it has its rotary name."""

_ALIKE = 0.6
"""Likeness of two keys (`difflib`, 0 to 1) from which on one may be mistyped for the other."""

_MUCH_ALIKE = 0.8
"""The same where more speaks against it: the key stands in another table, or a table is meant and a value typed."""

_MOST_TABLES = 3
"""Tables with the same key up to which they are named: of more the hint would choose none."""

_MOST_CHARACTERS = 60
"""Characters of a key that are compared."""


def hint_of(table: type[BaseModel], file: type[BaseModel] | None, key: str, value: Any) -> str:
    """Return the key that is meant by one with a value that a table of a file has not; empty where none is near.

    It is a name of the same key in this table, the same key in another table, or a key that is much alike: of this
    table, then of another one.
    """
    known = [name for name in table.model_fields if name != "name"]
    meant = _SYMBOLS.get(key.lower(), ROTARY.inner(key))
    if meant in known:
        return meant
    kind = _kind_of(value)
    of_kind = [name for name in known if (_kind_of_key(table, name) == "table") == (kind == "table")]
    near = _near(key, of_kind, _ALIKE)
    near += [name for name in _near(key, known, _MUCH_ALIKE) if name not in near]
    # Of a key in several tables, those are meant in which it has such a value.
    elsewhere = {} if file is None else _tables_with(file, None) | _tables_with(file, kind)
    if meant in elsewhere:
        return _in_tables(meant, elsewhere[meant])
    if near:
        return near[0]
    others = _near(meant, list(elsewhere), _MUCH_ALIKE)
    return _in_tables(others[0], elsewhere[others[0]]) if others else ""


def _near(key: str, known: list[str], alike: float) -> list[str]:
    """Return the keys that are alike, those that begin with the same word first."""
    near = difflib.get_close_matches(key[:_MOST_CHARACTERS], known, n=5, cutoff=alike)
    return sorted(near, key=lambda known_key: known_key.split("_")[0] != key.split("_", maxsplit=1)[0])


def _kind_of(value: Any) -> Kind:
    """Return what a value of a file is; a list of tables is a table."""
    if not isinstance(value, list | tuple):
        return "table" if isinstance(value, Mapping) else "value"
    return "table" if any(isinstance(entry, Mapping) for entry in value) else "list"


def _kind_of_key(table: type[BaseModel], key: str) -> Kind:
    """Return what the value of a key is."""
    annotation = table.model_fields[key].annotation
    if tables_of(annotation, BaseModel):
        return "table"
    return "list" if any(typing.get_origin(part) in {list, tuple} for part in inside(annotation)) else "value"


def _in_tables(key: str, tables: tuple[str, ...]) -> str:
    """Return a key and the tables of a file that have it; empty where that is no choice."""
    if len(tables) > _MOST_TABLES or not tables:
        return ""
    *before, last = tables
    return f"{key} in {', '.join(before)} or {last}" if before else f"{key} in {last}"


@lru_cache
def _tables_with(file: type[BaseModel], kind: Kind | None) -> dict[str, tuple[str, ...]]:
    """Return each key of a kind, or of any, in the tables of a file, and the headers of the tables that have it."""
    places: dict[str, list[str]] = {}
    for header, table in _headers(file, ""):
        for key in table.model_fields:
            if kind in {None, _kind_of_key(table, key)} and header not in places.setdefault(key, []):
                places[key].append(header)
    return {key: tuple(headers) for key, headers in places.items()}


def _headers(table: type[BaseModel], path: str) -> Iterator[tuple[str, type[BaseModel]]]:
    """Yield each table in a table, with its header."""
    for key, field in table.model_fields.items():
        place = f"{path}.{key}" if path else key
        is_list = typing.get_origin(field.annotation) in {list, tuple}
        for inner in tables_of(field.annotation, BaseModel):
            yield f"[[{place}]]" if is_list else f"[{place}]", inner
            yield from _headers(inner, place)
