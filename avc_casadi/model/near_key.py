"""Which key is meant by one that its table has not: a key of that table, or the same key in another table."""

from __future__ import annotations

import difflib
import re
import typing
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

from pydantic import BaseModel

from avc_casadi._util.units import LINEAR, ROTARY, Units
from avc_casadi.model.annotation import inside, tables_of
from avc_casadi.model.unit_text import UNIT_WORDS, ending_of, unit_named, unit_of_key

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

_LARGEST_SHOWN = 1e30
"""Numbers below this are repeated in a hint."""

_MOST_CHARACTERS = 60
"""Characters of a key that are compared."""


@dataclass(frozen=True)
class KeysOf:
    """The keys that a file may have: its outermost table, and the units of its keys."""

    table: type[BaseModel]
    units: tuple[Units, ...] = (LINEAR,)


@dataclass(frozen=True)
class Hint:
    """What is meant by an unknown key: the text of the hint, and the key of the same table that it stands for."""

    text: str = ""
    key: str = ""


def hint_of(table: type[BaseModel], file: KeysOf | None, key: str, value: Any) -> Hint:
    """Return what is meant by a key with a value that a table of a file has not; without text where none is near.

    It is a name of the same key in this table, that key with a value in another unit, the same key in another table,
    or a key that is much alike: of this table, then of another one.
    """
    known = [name for name in table.model_fields if name != "name"]
    meant = _meant(key)
    if meant in known:
        turns = meant == ROTARY.inner(key) and file is not None and file.units == (LINEAR,)
        return Hint(f'motion = "rotary" in [device], or {meant}' if turns else meant, meant)
    in_unit = _in_another_unit(known, file, key, value)
    if in_unit is not None:
        return in_unit
    near = _near_of(table, file, key, value)
    return Hint(near, near if near in known else "")


def _meant(key: str) -> str:
    """Return the key that a symbol stands for, with a unit behind it or without; else the linear name of the key."""
    inner = ROTARY.inner(key)
    return _SYMBOLS.get(inner.lower().removesuffix(ending_of(inner.lower())), inner)


def _in_another_unit(known: list[str], file: KeysOf | None, key: str, value: Any) -> Hint | None:
    """Return the known key that a key with another unit at its end stands for, with its value as it is to be written.

    `mass_g = 120` is `mass_kg = "120 g"`: without the unit the value would be 1000 times as large.
    """
    words = key[:_MOST_CHARACTERS].split("_")
    for begin in range(1, len(words)):
        stems: dict[str, tuple[str, str]] = {}
        for units in (LINEAR,) if file is None else file.units:
            ending = "_".join(units.key(key).split("_")[begin:]).lower()
            for name in known:
                unit = unit_of_key(units.key(name), units)
                named = unit_named(ending, unit) if unit else ""
                if named:
                    stems[name.removesuffix(ending_of(name))] = name, named
        for near in difflib.get_close_matches("_".join(words[:begin]), stems, n=1, cutoff=_ALIKE):
            name, named = stems[near]
            return Hint(f"{name} = {_with_unit(value, named)}", name)
    return None


def _with_unit(value: Any, unit: str) -> str:
    """Return a value as text with a unit, as in a file; of a value that is none an example, 1."""
    if isinstance(value, list | tuple):
        return f"[{', '.join(_with_unit(entry, unit) for entry in value[:2])}]"
    if isinstance(value, str):
        return (
            f'"{value[:_MOST_CHARACTERS]}"' if re.search(r"[^\W\d_]", value) else f'"{value[:_MOST_CHARACTERS]} {unit}"'
        )
    is_number = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < _LARGEST_SHOWN
    number = str(value).removesuffix(".0") if is_number else "1"
    return f'"{number} {unit}"'


def _near_of(table: type[BaseModel], file: KeysOf | None, key: str, value: Any) -> str:
    """Return the same key in another table, or a key that is much alike; empty where none is near."""
    known = [name for name in table.model_fields if name != "name"]
    meant = _meant(key)
    kind = _kind_of(value)
    of_kind = [name for name in known if (_kind_of_key(table, name) == "table") == (kind == "table")]
    near = _near(key, of_kind, _ALIKE)
    near += [name for name in _near(key, known, _MUCH_ALIKE) if name not in near]
    # Of a key in several tables, those are meant in which it has such a value.
    elsewhere = {} if file is None else _elsewhere(file.table, table, kind)
    if meant in elsewhere:
        return _in_tables(meant, elsewhere[meant])
    if near:
        return near[0]
    others = _near(meant, list(elsewhere), _MUCH_ALIKE)
    return _in_tables(others[0], elsewhere[others[0]]) if others else ""


def _near(key: str, known: list[str], alike: float) -> list[str]:
    """Return the keys that are alike and have no other unit, those that begin with the same word first."""
    same_unit = [name for name in known if not _has_another_unit(key, name)]
    near = difflib.get_close_matches(key[:_MOST_CHARACTERS], same_unit, n=5, cutoff=alike)
    return sorted(near, key=lambda known_key: known_key.split("_")[0] != key.split("_", maxsplit=1)[0])


def _has_another_unit(key: str, name: str) -> bool:
    """Return whether a key ends in a unit that is not the end of a known one: its value is not meant for that."""
    end = key.rpartition("_")[2].lower()
    return end in UNIT_WORDS and bool(ending_of(name)) and not name.endswith(f"_{end}")


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


@lru_cache
def _elsewhere(file: type[BaseModel], table: type[BaseModel], kind: Kind) -> dict[str, tuple[str, ...]]:
    """Return the keys of other tables of a file with their headers: with values of a kind, else with any.

    A table of another kind under the same header is no other table.
    """
    here = {header for header, inner in _headers(file, "") if inner is table}
    places = _tables_with(file, None) | _tables_with(file, kind)
    others = {key: tuple(header for header in headers if header not in here) for key, headers in places.items()}
    return {key: headers for key, headers in others.items() if headers}


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
