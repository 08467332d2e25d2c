"""Reading a problem file: from a path or a catalogue name to a validated `Problem`."""

from __future__ import annotations

import tomllib
from pathlib import Path

from pydantic import ValidationError

from avc_casadi._errors import Fault, InputError
from avc_casadi.problem._catalogue import catalogue_names, catalogue_path
from avc_casadi.problem._model import Problem

MAX_BYTES = 2**20


def load_problem(source: str | Path) -> Problem:
    """Load a problem file, or a problem of the catalogue by name.

    Raises:
        InputError: with every fault of the file.
    """
    path = _path_of(source)
    try:
        if path.stat().st_size > MAX_BYTES:
            raise InputError.of(f"larger than {MAX_BYTES // 2**20} MiB", file=str(source))
        text = path.read_bytes().decode("utf-8")
    except OSError as error:
        raise InputError.of(f"cannot be read ({error.strerror})", file=str(source)) from error
    except UnicodeDecodeError as error:
        raise InputError.of("is not UTF-8 text", file=str(source)) from error
    names = {file: name for name, file in catalogue_names().items()}
    return parse_problem(text, file=str(source), name=names.get(path, path.stem))


def _path_of(source: str | Path) -> Path:
    if isinstance(source, Path) or source.endswith(".toml"):
        return Path(source)
    if source not in catalogue_names() and Path(source).is_file():
        return Path(source)
    return catalogue_path(source)


def parse_problem(text: str, *, file: str = "problem", name: str = "") -> Problem:
    """Validate the text of a problem file.

    Raises:
        InputError: with every fault of the text.
    """
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError.of(f"is not valid TOML: {error}", file=file) from error
    try:
        return Problem.model_validate(table | {"name": name})
    except ValidationError as error:
        raise InputError(
            [Fault(file, None, ".".join(map(str, item["loc"])), item["msg"]) for item in error.errors()]
        ) from error
