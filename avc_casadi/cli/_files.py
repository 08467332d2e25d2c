"""Output files of a command: faults are found before the long work, and reported as faults of the argument."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import TYPE_CHECKING

from avc_casadi import AvcError, InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PICTURES = (".png", ".svg", ".pdf")
"""Endings of pictures."""
# A folder with such a name was meant to be a file.
_FILE_ENDINGS = {".json", ".csv", ".toml", ".html", ".png", ".svg", ".c", ".h", ".txt"}


_given: ContextVar[tuple[tuple[str, str], ...]] = ContextVar("given", default=())


def remember_given(args: Mapping[str, object]) -> None:
    """Record the arguments of a command, by option: its inputs are not overwritten."""
    words = [
        (f"--{key.replace('_', '-')}", one)
        for key, value in args.items()
        for one in (value if isinstance(value, list) else [value])
        if isinstance(one, str) and "\0" not in one
    ]
    _given.set(tuple(words))


def output_file(text: str, key: str, endings: Sequence[str]) -> Path:
    """Check the path of an output file."""
    path, own = Path(text), f"--{key.removeprefix('--').lower()}"
    if path.suffix.lower() not in endings:
        raise InputError.of(f"{text!r} ends in {path.suffix!r}; allowed: {', '.join(endings)}", key=key)
    if path.is_dir():
        raise InputError.of(f"{text!r} is a folder; give a file name", key=key)
    if not path.parent.is_dir():
        raise InputError.of(f"{text!r}: there is no folder {str(path.parent)!r}; make it first", key=key)
    if not all(os.access(one, os.W_OK) for one in (path, path.parent) if one.exists()):
        raise InputError.of(f"{text!r} may not be written by this user; choose another place", key=key)
    if path.exists() and any(_same(path, word) for option, word in _given.get() if option != own):
        raise InputError.of(f"{text!r} is a file that this command was given; choose another name", key=key)
    return path


def _same(path: Path, word: str) -> bool:
    try:
        return path.samefile(word)
    except OSError:  # the argument is no file name
        return False


@contextmanager
def output_folder(text: str, key: str) -> Iterator[Path]:
    """Collect results in a folder that is yielded; at the end all of them move into the requested one, or none.

    An unwritable folder is found before the long work. Without a result it is removed again.
    """
    if not text or "\0" in text:
        raise InputError.of(f"{text!r} is no name; give the name of a folder", key=key)
    path = Path(text)
    if path.suffix.lower() in _FILE_ENDINGS and not path.is_dir():
        raise InputError.of(f"{text!r} is the name of a file; choose another folder", key=key)
    from avc_casadi._util.files import gathered_folder

    try:
        with gathered_folder(path) as gathered:
            yield gathered
    except OSError as error:
        if isinstance(error, AvcError | BrokenPipeError):
            raise
        why = error.strerror or str(error)
        raise InputError.of(f"{text!r} cannot be written ({why}); choose another folder", key=key) from error


@contextmanager
def writing(path: Path, key: str) -> Iterator[None]:
    """Name the option and the file, as typed, where it cannot be written."""
    try:
        yield
    except OSError as error:
        why = error.strerror or str(error)
        raise InputError.of(f"{str(path)!r} cannot be written ({why}); choose another place", key=key) from error


def write_text(path: Path, text: str, key: str) -> None:
    """Write a file atomically; one in a folder of results by `write_file`, whose fault `output_folder` tells."""
    from avc_casadi._util.files import write_file

    with writing(path, key):
        write_file(path, text)


def write_figure(path: Path, figure: Figure, key: str = "--plot") -> None:
    """Write a picture atomically."""
    from avc_casadi.present.figures.layout import save_figure

    with writing(path, key):
        save_figure(figure, path)
