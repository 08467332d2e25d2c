"""Reading a problem file: from a path or a catalogue name to a validated `Problem`."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

from avc_casadi._errors import Fault, InputError
from avc_casadi.problem._catalogue import catalogue_names, catalogue_path
from avc_casadi.problem._findings import validated
from avc_casadi.problem._lines import KeyLines
from avc_casadi.problem._model import Problem
from avc_casadi.problem._quantity import visible
from avc_casadi.problem._values import dotted

MAX_BYTES = 2**20

_NEXT_STEP = "give the path of a problem file or a name from `avc list`"

# The parser's time grows with the square of a key's length: a file of dots would hang it.
_LONG_KEY = re.compile(r"""(?<![\w-])(?:(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){32}""", re.ASCII)


def load_problem(source: str | Path) -> Problem:
    """Load a problem file, or a problem of the catalogue by name.

    Args:
        source: a path, or a name as `catalogue` lists them, for example ``figure5``. A text is a path if it
            ends in ``.toml`` or if no problem has that name.

    Returns:
        The validated problem.

    Raises:
        InputError: with every fault of the file at once, each with its line and key.

    Example:
        >>> avc.load_problem("figure5").environment.stiffness_n_per_m
        100000.0
    """
    path = _path_of(source)
    names = {file: name for name, file in catalogue_names().items()}
    return parse_problem(_text_of(path), file=str(source), name=names.get(path.resolve(), path.stem))


def as_problem(problem: Problem | str | Path) -> Problem:
    """Return a problem as it is, or load the file or the name of the catalogue.

    Raises:
        InputError: with every fault of the file, or no problem has that name.
    """
    return problem if isinstance(problem, Problem) else load_problem(problem)


def _path_of(source: str | Path) -> Path:
    if isinstance(source, Path) or source.endswith(".toml"):
        return Path(source)
    names = catalogue_names()
    if source in names:
        return names[source]
    try:
        exists = bool(source) and Path(source).exists()
    except (OSError, ValueError):  # too long for a path, or with a NUL in it
        exists = False
    return Path(source) if exists else catalogue_path(source)


def _text_of(path: Path) -> str:
    """Read a file of at most `MAX_BYTES`, without reading a larger one."""
    file = str(path)
    try:
        size = path.stat().st_size
        regular = path.is_file()
        content = path.read_bytes() if regular and size <= MAX_BYTES else b""
    except FileNotFoundError as error:
        raise InputError.of(f"does not exist; {_NEXT_STEP}", file=file) from error
    except OSError as error:
        raise InputError.of(f"cannot be read: {error.strerror}; {_NEXT_STEP}", file=file) from error
    except ValueError as error:  # a NUL in the path
        raise InputError.of(f"is no path: {error}; {_NEXT_STEP}", file=repr(file)) from error
    if not regular:
        kind = "a directory" if path.is_dir() else "no regular file"
        raise InputError.of(f"is {kind}; {_NEXT_STEP}", file=file)
    if size > MAX_BYTES:
        raise InputError.of(f"has {size} bytes; allowed: at most {MAX_BYTES}", file=file)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        message = f"byte 0x{content[error.start]:02x} is not UTF-8; save the file as UTF-8 text"
        raise InputError([Fault(file, line, "", message)]) from error


def parse_problem(text: str, *, file: str = "problem.toml", name: str = "") -> Problem:
    r"""Validate the text of a problem file.

    Args:
        text: TOML.
        file: what the faults call the file.
        name: name of the problem.

    Returns:
        The validated problem.

    Raises:
        InputError: with every fault of the text at once, each with its line and key.

    Example:
        >>> wall = "[environment]\ndamping_ns_per_m = 10\nstiffness_n_per_m = 1e5"
        >>> avc.parse_problem("[device]\nmass_kg = 0.1\ndamping_ns_per_m = 2\n" + wall).device.mass_kg
        0.1
    """
    try:
        result = validated(_tables(text, file), name)
        if isinstance(result, Problem):
            return result
        lines = KeyLines(text.replace("\r\n", "\n"))
        faults = [Fault(file, lines[path], dotted(path), message) for path, message in result]
    except RecursionError as error:
        raise InputError.of("is nested too deeply; allowed: tables as in the catalogue", file=file) from error
    raise InputError(sorted(faults, key=lambda fault: (fault.line is None, fault.line or 0)))


def _tables(text: str, file: str) -> dict[str, Any]:
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
    except ValueError as error:  # of the integer conversion, which has no place
        message = "holds an integer of thousands of digits; allowed: numbers as in the catalogue"
        raise InputError.of(message, file=file) from error


def _syntax_fault(parser_message: str, text: str, file: str) -> Fault:
    what, _, place = parser_message.partition(" (at ")
    found = re.match(r"line (\d+), column (\d+)", place)
    line = int(found[1]) if found else text.rstrip().count("\n") + 1
    where = f" at column {found[2]}" if found else " at the end of the file"
    content = text.replace("\r\n", "\n").split("\n")[line - 1].strip() or "an empty line"
    return Fault(file, line, "", f"is not TOML{where}: {visible(what.lower())}, in: {visible(content)}")
