"""Reading of regular files of bounded size, and atomic writing."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import BinaryIO
from uuid import uuid4

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.interrupt import DeferredInterrupt


@contextmanager
def open_bounded(path: str | Path, most_bytes: int, next_step: str = "") -> Iterator[BinaryIO]:
    """Open a regular file given by a user, of bounded size; a pipe or a device is not opened."""
    place = Path(path)
    advice = next_step and f"; {next_step}"
    if "\0" in str(path):
        raise InputError.of(f"has a NUL character in its name{advice}", file=str(path).replace("\0", "?"))
    try:
        size = place.stat().st_size
        if not place.is_file():
            kind = "a directory" if place.is_dir() else "not a regular file"
            raise InputError.of(f"is {kind}{advice}", file=str(path))
        if size > most_bytes:
            raise InputError.of(f"has {size} bytes; allowed: at most {most_bytes}", file=str(path))
        with place.open("rb") as file:
            yield file
    except FileNotFoundError as error:
        raise InputError.of(f"does not exist{advice}", file=str(path)) from error
    except OSError as error:
        raise InputError.of(f"cannot be read: {error.strerror or error}{advice}", file=str(path)) from error


def read_text(path: str | Path, most_bytes: int, next_step: str = "") -> str:
    """Return the text of a file in UTF-8, without a byte order mark."""
    with open_bounded(path, most_bytes, next_step) as file:
        content = file.read()
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        message = f"byte 0x{content[error.start]:02x} is not UTF-8; save the file as UTF-8 text"
        raise InputError([Fault(str(path), line, "", message)]) from error


def write_file(path: str | Path, content: str | bytes) -> None:
    """Write a file atomically: to a temporary name beside it, renamed."""
    place = Path(os.path.realpath(path))
    data = content.encode() if isinstance(content, str) else content
    if place.exists() and not os.access(place, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
    part = place.with_name(f".avc-{uuid4().hex}")
    try:
        part.write_bytes(data)
        if place.exists():
            shutil.copymode(place, part)
        part.replace(place)
    finally:
        part.unlink(missing_ok=True)


@contextmanager
def staging_folder(path: Path) -> Iterator[Path]:
    """Collect results in a temporary folder that is yielded; at the end its files move into the requested one."""
    place = Path(os.path.realpath(path))
    missing = [folder for folder in (place, *place.parents) if not folder.exists()]
    place.mkdir(parents=True, exist_ok=True)
    try:
        with TemporaryDirectory(prefix=".avc-", dir=place) as name:
            staging = Path(name)
            yield staging
            with DeferredInterrupt():
                for file in sorted(file for file in staging.rglob("*") if file.is_file()):
                    target = place / file.relative_to(staging)
                    target.parent.mkdir(parents=True, exist_ok=True)
                    file.replace(target)
    finally:
        with suppress(OSError):  # not empty: it has results
            for folder in missing:
                folder.rmdir()
