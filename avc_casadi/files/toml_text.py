"""Reading of TOML files, robust against any input."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.files import read_text
from avc_casadi.model.table import visible

MAX_BYTES = 2**20

NEXT_STEP = "give the path of a problem file or a name from `avc list`"
"""Advice on an unreadable problem file."""

# The parser's message on a duplicate key or table.
_TWICE = re.compile(r"Cannot overwrite a value|Cannot declare .* twice")

# The parser's time grows with the square of a key's length: a file of dots would hang it.
_LONG_KEY = re.compile(r"""(?<![\w-])(?:(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){32}""", re.ASCII)


def text_of(path: Path, next_step: str = NEXT_STEP) -> str:
    """Read a file of at most `MAX_BYTES`, without reading a larger one."""
    return read_text(path, MAX_BYTES, next_step)


def tables_of(text: str, file: str) -> dict[str, Any]:
    """Parse TOML; a syntax error is reported with its line."""
    if not text.strip():
        raise InputError.of("is empty; allowed: at least the tables device and environment", file=file)
    long_key = _LONG_KEY.search(text)
    if long_key is not None:
        line = text.count("\n", 0, long_key.start()) + 1
        raise InputError([Fault(file, line, "", "a key has more than 32 parts; allowed: keys as in the catalogue")])
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError([_syntax_fault(str(error), text, file)]) from error
    except RecursionError as error:
        raise InputError.of("is nested too deeply; allowed: tables as in the catalogue", file=file) from error
    except ValueError as error:  # of the integer conversion, without a line
        message = "holds an integer of thousands of digits; allowed: numbers as in the catalogue"
        raise InputError.of(message, file=file) from error


def _syntax_fault(parser_message: str, text: str, file: str) -> Fault:
    what, _, place = parser_message.partition(" (at ")
    found = re.match(r"line (\d+), column (\d+)", place)
    line = int(found[1]) if found else text.rstrip().count("\n") + 1
    where = f" at column {found[2]}" if found else " at the end of the file"
    content = text.replace("\r\n", "\n").split("\n")[line - 1].strip() or "an empty line"
    if _TWICE.match(what):
        message = f"gives a key or table a second time: {visible(content)}; allowed: each once"
        if content.startswith("[device]"):
            message += ', a device of a file with other values as [device] with from = "name" and the keys that differ'
        return Fault(file, line, "", message)
    return Fault(file, line, "", f"is not TOML{where}: {visible(what.lower())}, in: {visible(content)}")
