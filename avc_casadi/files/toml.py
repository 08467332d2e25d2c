"""TOML: read robustly against any input, the lines of its keys, and written."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.files import read_text
from avc_casadi.model.table import Path as KeyPath
from avc_casadi.model.table import visible

MAX_BYTES = 2**20
"""Largest problem file that is read, bytes."""
NEXT_STEP = "give the path of a problem file or a name from `avc list`"
"""Advice on an unreadable problem file."""


def text_of(path: Path, next_step: str = NEXT_STEP) -> str:
    """Read a file of at most `MAX_BYTES`, without reading a larger one."""
    return read_text(path, MAX_BYTES, next_step)


def tables_of(text: str, file: str) -> dict[str, Any]:
    """Parse TOML; a syntax error is reported with its line."""
    if not text.strip():
        raise InputError.of("is empty; allowed: at least the table [device]", file=file)
    # The parser's time grows with the square of a key's length: a file of dots would hang it.
    dots = r"""(?<![\w-])(?:(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){32}"""
    long_key = re.search(dots, text, re.ASCII)
    if long_key is not None:
        line = text.count("\n", 0, long_key.start()) + 1
        raise InputError([Fault(file, line, "", "a key has more than 32 parts; allowed: keys of a problem file")])
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError([_syntax_fault(str(error), text, file)]) from error
    except RecursionError as error:
        raise InputError.of("is nested too deeply; allowed: tables as in the built-in problems", file=file) from error
    except ValueError as error:  # of the integer conversion, without a line
        message = "has an integer of thousands of digits; allowed: numbers as in the built-in problems"
        raise InputError.of(message, file=file) from error


def _syntax_fault(parser_message: str, text: str, file: str) -> Fault:
    """Return the parser's message as a fault with its line."""
    reason, _, parser_place = parser_message.partition(" (at ")
    place = re.match(r"line (\d+), column (\d+)", parser_place)
    line = int(place[1]) if place else text.rstrip().count("\n") + 1
    where = f" at column {place[2]}" if place else " at the end of the file"
    content = text.split("\n")[line - 1].strip() or "an empty line"
    if re.match("Cannot overwrite a value|Cannot declare .* twice", reason):
        message = f"repeats a key or table: {visible(content)}; allowed: each key or table once"
        if content.startswith("[device]"):
            message += (
                '; to change values of a named device, write [device] with from = "name" and the keys that differ'
            )
        return Fault(file, line, "", message)
    advice = _advice_on(content)
    return Fault(file, line, "", f"is not TOML{where}: {visible(reason.lower())}, in: {visible(content)}{advice}")


def _advice_on(content: str) -> str:
    """Return what to write in place of a number with a decimal comma or without a digit before its point.

    Or of a value with a unit and no quotation marks; empty where a line is none of these.
    """
    comma = re.fullmatch(r"([\w.-]{1,60}\s*=\s*[-+]?\d{1,20}),(\d{1,20})\s*(?:#.*)?", content, re.ASCII)
    if comma:
        return f"; a decimal point is a dot: {comma[1]}.{comma[2]}"
    dot = re.fullmatch(r"([\w.-]{1,60}\s*=\s*[-+]?)(\.\d{1,20})\s*(?:#.*)?", content, re.ASCII)
    if dot:
        return f"; a digit stands before the decimal point: {dot[1]}0{dot[2]}"
    number = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
    unit = re.fullmatch(rf"([\w.-]{{1,60}}\s*=\s*)({number}\s*[^\W\d_][^\"'#=]{{0,40}}?)\s*(?:#.*)?", content)
    return f'; a value with a unit needs quotation marks: {unit[1]}"{unit[2]}"' if unit else ""


_PART = r"""[ \t]*(?:[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*"""
# A line may end with a carriage return.
_STATEMENT = re.compile(rf"(?P<open>[ \t]*\[\[?)?(?P<key>{_PART}(?:\.{_PART})*)(?(open)\]\]?[ \t]*(?:#|\r?$)|=)")


class KeyLines:
    """The line of every key of a valid TOML text that begins a line."""

    def __init__(self, text: str) -> None:
        """Read in which line of a TOML text each key stands, those of tables and of lists of tables too."""
        self._lines: dict[KeyPath, int] = {}
        # The index of the last table of each list of tables.
        last_index: dict[KeyPath, int] = {}
        table: KeyPath = ()
        for number, line in enumerate(text.split("\n"), start=1):
            statement = _STATEMENT.match(line)
            if statement is None:
                continue
            parts = [part.strip(" \t\"'") for part in re.findall(_PART, statement["key"])]
            opens_table = bool(statement["open"])
            opens_list_item = str(statement["open"]).endswith("[[")
            path: KeyPath = () if opens_table else table
            for index, part in enumerate(parts):
                path = (*path, part)
                if index == len(parts) - 1 and opens_list_item:
                    last_index[path] = last_index.get(path, -1) + 1
                path = (*path, last_index[path]) if path in last_index else path
                self._lines.setdefault(path, number)
            table = path if opens_table else table

    def __getitem__(self, path: KeyPath) -> int | None:
        """Return the line of a key, or of the table that lacks it; None where there is neither."""
        known = (self._lines[path[:length]] for length in range(len(path), 0, -1) if path[:length] in self._lines)
        return next(known, None)


def toml_lines(path: tuple[str, ...], table: Mapping[str, Any]) -> Iterator[str]:
    """Write the plain keys of a table, its kind first, then the tables in it."""
    for key in sorted(table, key=lambda key: key != "kind"):
        if not _holds_tables(table[key]):
            yield f"{key} = {toml_value(table[key])}"
    for key, value in table.items():
        if not _holds_tables(value):
            continue
        inner, header = (*path, key), ".".join((*path, key))
        for item in (value,) if isinstance(value, Mapping) else value:
            if not isinstance(value, Mapping):
                yield f"\n[[{header}]]"
            elif not all(map(_holds_tables, item.values())):
                yield f"\n[{header}]"
            yield from toml_lines(inner, item)


def _holds_tables(value: object) -> bool:
    """Return whether a value is a table or a list of tables; no plain list of a problem is empty."""
    return isinstance(value, Mapping) or (isinstance(value, tuple) and all(isinstance(item, Mapping) for item in value))


def toml_value(value: object) -> str:
    """Return a value as TOML."""
    if isinstance(value, tuple):
        return f"[{', '.join(map(toml_value, value))}]"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)  # a TOML string too: control characters were refused
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(value)
