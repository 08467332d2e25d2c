"""Reading of regular files of bounded size, and atomic writing."""

from __future__ import annotations

import ctypes
import os
import re
import shutil
import stat
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from itertools import islice
from pathlib import Path
from typing import BinaryIO
from uuid import uuid4

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.interrupt import uninterrupted

if sys.platform != "win32":
    import fcntl

# Folder of a run in progress, which holds a lock on it that ends with its process, however that ends.
_UNFINISHED = re.compile(r"\.avc-[0-9a-f]{32}")
# A folder with more files is no folder of results: it is not exchanged, its files are replaced one by one.
_MOST_ENTRIES = 1000
_AT_FDCWD, _RENAME_EXCHANGE = -100, 2


@contextmanager
def opened(path: str | Path, most_bytes: int, next_step: str = "") -> Iterator[BinaryIO]:
    """Open a regular file given by a user, of bounded size; a pipe or a device is not opened.

    Args:
        path: as given by the user.
        most_bytes: maximum size.
        next_step: advice where it cannot be read.

    Raises:
        InputError: it is something else, or cannot be read.
    """
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
    """Return the bytes of a file.

    Raises:
        InputError: as `opened`; a file may also turn out larger than its stated size.
    """
    with opened(path, most_bytes, next_step) as file:
        content = file.read(most_bytes + 1)
    if len(content) > most_bytes:
        raise InputError.of(_too_large(len(content), most_bytes), file=_printable(path))
    return content


def read_text(path: str | Path, most_bytes: int, next_step: str = "") -> str:
    """Return the text of a file in UTF-8, without a byte order mark.

    Raises:
        InputError: as `read_bytes`, or it is not text.
    """
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


def write_file(path: str | Path, content: str | bytes, *, new: bool = False) -> None:
    """Write a file atomically, whatever ends the process: to a temporary one, synchronised, renamed.

    Args:
        path: the file; the target of a link.
        content: text is written as UTF-8.
        new: whether an existing file is kept.

    Raises:
        OSError: it cannot be written; the old content is kept.
    """
    place = Path(os.path.realpath(path))
    data = content.encode() if isinstance(content, str) else content
    if place.exists() and not place.is_file():  # a pipe or a device, or a folder, which is refused
        place.write_bytes(data)
        return
    if place.exists() and not os.access(place, os.W_OK):
        raise PermissionError(13, os.strerror(13), str(path))
    part, descriptor = _held(place.parent, lambda name: os.open(name, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
            if place.exists():
                shutil.copymode(place, part)
            if new:
                _link(part, place)
            else:
                part.replace(place)
        _synchronise(place.parent)
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)


def _link(part: Path, place: Path) -> None:
    """Link a file to its name, unless it is taken."""
    try:
        os.link(part, place)
    except FileExistsError:
        return
    except OSError:  # a file system without links
        if not place.exists():
            part.replace(place)


@contextmanager
def atomic_folder(path: Path) -> Iterator[Path]:
    """Collect results in a folder that is yielded; at the end it replaces the requested one atomically.

    Other files of that one are kept. Files are replaced one by one where the folder is the working directory or above
    it, a mount, or no folder of results by the number of its files. Whatever ends the process before leaves the old
    content, and an unfinished folder that the next run clears.

    Args:
        path: the requested folder.

    Raises:
        OSError: it cannot be made or written to, which is found at once, or cannot be exchanged.
    """
    place = Path(os.path.realpath(path))
    missing = [folder for folder in (place, *place.parents) if not folder.exists()]
    exchanged = _exchangeable(place)
    try:
        (place.parent if exchanged else place).mkdir(parents=True, exist_ok=True)
        if place.exists() and not (place.is_dir() and os.access(place, os.W_OK | os.X_OK)):
            code = 13 if place.is_dir() else 20
            raise OSError(code, os.strerror(code), str(path))
        for folder in (place.parent, place):
            clear_unfinished(folder)
        gathered, descriptor = _held(place.parent if exchanged else place, _made)
        try:
            yield gathered
            with uninterrupted():
                if exchanged:
                    _exchange(gathered, place)
                else:
                    _move(gathered, place)
        finally:
            shutil.rmtree(gathered, ignore_errors=True)
            if descriptor >= 0:
                os.close(descriptor)
    finally:
        with suppress(OSError):  # not empty: it has results
            for folder in missing:
                if folder.exists():
                    folder.rmdir()


def clear_unfinished(folder: Path) -> None:
    """Remove unfinished folders of killed runs; that of a run in progress stays."""
    with suppress(OSError):
        for entry in [one for one in os.scandir(folder) if _UNFINISHED.fullmatch(one.name)]:
            with suppress(OSError):
                descriptor = os.open(entry.path, os.O_RDONLY)
                try:
                    if _lock(descriptor):
                        (shutil.rmtree if entry.is_dir(follow_symlinks=False) else os.unlink)(entry.path)
                finally:
                    os.close(descriptor)


def _held(folder: Path, make: Callable[[Path], int]) -> tuple[Path, int]:
    """Create a temporary file or folder; return it with the descriptor whose lock marks it as in use."""
    while True:
        path = folder / f".avc-{uuid4().hex}"
        descriptor = make(path)
        if descriptor < 0 or (_lock(descriptor) and path.exists()):  # not removed meanwhile as left over
            return path, descriptor
        os.close(descriptor)


def _made(folder: Path) -> int:
    folder.mkdir()
    return -1 if sys.platform == "win32" else os.open(folder, os.O_RDONLY)


def _lock(descriptor: int) -> bool:
    """Lock a file; without such locks nothing counts as left over."""
    if sys.platform == "win32":
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def _exchangeable(place: Path) -> bool:
    parents = [folder for folder in place.parents if folder.exists()]
    if place == Path.cwd() or place in Path.cwd().parents or not os.access(parents[0], os.W_OK | os.X_OK):
        return False
    return not place.is_mount() and len(list(islice(place.rglob("*"), _MOST_ENTRIES + 1))) <= _MOST_ENTRIES


def _exchange(gathered: Path, place: Path) -> None:
    """Exchange a folder for another, whose other files it takes along."""
    if not place.exists():
        gathered.rename(place)
    else:
        shutil.copytree(
            place,
            gathered,
            symlinks=True,
            ignore=lambda inside, names: [
                name for name in names if (gathered / Path(inside).relative_to(place) / name).is_file()
            ],
            copy_function=_linked,
            dirs_exist_ok=True,
        )
        if not _exchanged_at_once(gathered, place):
            before = place.with_name(f"{place.name}.before-{uuid4().hex[:8]}")  # named, should this end here
            place.rename(before)
            gathered.rename(place)
            shutil.rmtree(before, ignore_errors=True)
    _synchronise(place.parent)


def _linked(source: str, copy: str) -> str:
    try:
        os.link(source, copy, follow_symlinks=False)
    except OSError:  # a file system without links
        shutil.copy2(source, copy, follow_symlinks=False)
    return copy


def _exchanged_at_once(one: Path, other: Path) -> bool:
    """Exchange two folders in one system call, where available."""
    exchange = getattr(ctypes.CDLL(None), "renameat2", None) if sys.platform == "linux" else None
    names = [os.fsencode(path) for path in (one, other)]
    return exchange is not None and exchange(_AT_FDCWD, names[0], _AT_FDCWD, names[1], _RENAME_EXCHANGE) == 0


def _move(gathered: Path, place: Path) -> None:
    for file in sorted(file for file in gathered.rglob("*") if file.is_file()):
        to = place / file.relative_to(gathered)
        to.parent.mkdir(parents=True, exist_ok=True)
        file.replace(to)


def _synchronise(folder: Path) -> None:
    with suppress(OSError):  # folders cannot be synchronised everywhere
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
