"""Reading of regular files of bounded size, and atomic writing."""

from __future__ import annotations

import os
import shutil
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import BinaryIO
from uuid import uuid4

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.interrupt import HeldInterrupt


@contextmanager
def opened(path: str | Path, most_bytes: int, next_step: str = "") -> Iterator[BinaryIO]:
    """Open a regular file given by a user, of bounded size; a pipe or a device is not opened."""
    told, then = _printable(path), next_step and f"; {next_step}"
    try:
        try:
            info = Path(path).stat()
        except ValueError as error:  # with a NUL, or a lone surrogate
            raise InputError.of(f"is no path: {error}{then}", file=told) from error
        if not stat.S_ISREG(info.st_mode):
            kind = "a directory" if stat.S_ISDIR(info.st_mode) else "no regular file"
            raise InputError.of(f"is {kind}{then}", file=told)
        if info.st_size > most_bytes:
            raise InputError.of(_too_large(info.st_size, most_bytes), file=told)
        with open(path, "rb", opener=_at_once) as file:
            yield file
    except FileNotFoundError as error:
        raise InputError.of(f"does not exist{then}", file=told) from error
    except OSError as error:
        raise InputError.of(f"cannot be read: {error.strerror or error}{then}", file=told) from error


def read_bytes(path: str | Path, most_bytes: int, next_step: str = "") -> bytes:
    """Return the bytes of a file."""
    with opened(path, most_bytes, next_step) as file:
        content = file.read(most_bytes + 1)
    if len(content) > most_bytes:
        raise InputError.of(_too_large(len(content), most_bytes), file=_printable(path))
    return content


def read_text(path: str | Path, most_bytes: int, next_step: str = "") -> str:
    """Return the text of a file in UTF-8, without a byte order mark."""
    content = read_bytes(path, most_bytes, next_step)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        message = f"byte 0x{content[error.start]:02x} is not UTF-8; save the file as UTF-8 text"
        raise InputError([Fault(_printable(path), line, "", message)]) from error


def _too_large(size: int, most_bytes: int) -> str:
    return f"has {size} bytes; allowed: at most {most_bytes}"


def _printable(path: str | Path) -> str:
    """Return a path for messages; one with a NUL or a lone surrogate, which no file can have, is escaped."""
    text = str(path)
    return repr(text) if "\0" in text or any("\ud800" <= mark <= "\udfff" for mark in text) else text


def _at_once(path: str, flags: int) -> int:
    """Open without blocking, in case it has become a pipe meanwhile."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def write_file(path: str | Path, content: str | bytes) -> None:
    """Write a file atomically: to a temporary name beside it, synchronised, renamed."""
    place = Path(os.path.realpath(path))
    data = content.encode() if isinstance(content, str) else content
    if place.exists() and not place.is_file():  # a pipe or a device, or a folder, which is refused
        place.write_bytes(data)
        return
    if place.exists() and not os.access(place, os.W_OK):
        raise PermissionError(13, os.strerror(13), str(path))
    part = place.with_name(f".avc-{uuid4().hex}")
    try:
        with part.open("xb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        if place.exists():
            shutil.copymode(place, part)
        part.replace(place)
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)


@contextmanager
def gathered_folder(path: Path) -> Iterator[Path]:
    """Collect results in a temporary folder that is yielded; at the end its files move into the requested one."""
    place = Path(os.path.realpath(path))
    missing = [folder for folder in (place, *place.parents) if not folder.exists()]
    place.mkdir(parents=True, exist_ok=True)
    try:
        with TemporaryDirectory(prefix=".avc-", dir=place) as name:
            gathered = Path(name)
            yield gathered
            with HeldInterrupt():
                for file in sorted(file for file in gathered.rglob("*") if file.is_file()):
                    to = place / file.relative_to(gathered)
                    to.parent.mkdir(parents=True, exist_ok=True)
                    file.replace(to)
    finally:
        with suppress(OSError):  # not empty: it has results
            for folder in missing:
                folder.rmdir()
