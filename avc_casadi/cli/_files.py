"""Files that a command writes: faults are found before the long work, and told as faults of the argument."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from avc_casadi import InputError


def output_file(text: str, key: str, endings: Sequence[str]) -> Path:
    """Check where a file is to be written.

    Args:
        text: the argument.
        key: its option, for the message.
        endings: allowed file endings, with the dot.

    Raises:
        InputError: wrong ending, a folder, no such folder, or no permission.
    """
    path = Path(text)
    if path.suffix.lower() not in endings:
        raise InputError.of(f"{text!r} ends in {path.suffix!r}; allowed: {', '.join(endings)}", key=key)
    if path.is_dir():
        raise InputError.of(f"{text!r} is a folder; give a file name", key=key)
    if not path.parent.is_dir():
        raise InputError.of(f"{text!r}: there is no folder {str(path.parent)!r}; make it first", key=key)
    if not os.access(path if path.exists() else path.parent, os.W_OK):
        raise InputError.of(f"{text!r} may not be written by this user; choose another place", key=key)
    return path


def output_folder(text: str, key: str) -> Path:
    """Make a folder for results, or take the one that is there.

    Raises:
        InputError: it cannot be made or written to.
    """
    path = Path(text)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError.of(f"{text!r} cannot be made ({error.strerror}); choose another folder", key=key) from error
    if not os.access(path, os.W_OK):
        raise InputError.of(f"{text!r} may not be written by this user; choose another folder", key=key)
    return path


def write_text(path: Path, text: str, key: str) -> None:
    """Write a file whole.

    Raises:
        InputError: the file cannot be written.
    """
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError.of(f"{str(path)!r} cannot be written ({error.strerror})", key=key) from error
