"""Output of a command: its answer, its messages, its progress and its files; what writes to the terminal."""

from __future__ import annotations

import json
import os
import platform
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from avc_casadi import AvcError, InputError, __version__, fault_document
from avc_casadi._util.interrupt import HeldInterrupt
from avc_casadi._util.progress import Progress
from avc_casadi.present.row import Answer, Page

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# A line of progress is written at most five times a second; where it stays, every ten seconds.
_BETWEEN_S, _BETWEEN_LINES_S = 0.2, 10.0
# The remaining time is shown after so long.
_RATE_AFTER_S = 1.0


@dataclass
class _Piece:
    """A step of several parts."""

    total: int = -1
    first: int = 0
    done: int = 0
    began: float = 0.0

    def pace(self, now: float) -> str:
        """Return the remaining time; empty while that is a guess."""
        seconds, made = now - self.began, self.done - self.first
        if seconds < _RATE_AFTER_S or made <= 0:
            return ""
        return f"; {(self.total - self.done) * seconds / made:.0f} s left"


class Console(Progress):
    """Standard output carries the answer alone, standard error everything else.

    C libraries write to file descriptor 1 behind Python's back, some of them only when the process ends. The
    descriptor is therefore led to standard error for the rest of the process, and the answer is written to a copy of
    the original. A replaced ``sys.stdout`` (in a test, in a notebook) is written to directly.
    """

    def __init__(self, *, as_json: bool) -> None:
        self.as_json = as_json
        self.page = Page.of(sys.stdout)
        self._answered = threading.Event()
        self._terminal = sys.stderr is not None and sys.stderr.isatty()
        self._descriptor: int | None = None
        self._step: str | None = None
        self._repeated: threading.Thread | None = None
        self._shown, self._line = 0.0, ""
        self._piece = _Piece()
        if _is_descriptor(sys.stdout, 1):
            sys.stdout.flush()
            self._descriptor = os.dup(1)
            try:
                os.dup2(2, 1)
            except OSError:
                silence(1)

    def answer(self, answer: Answer, *, verbose: bool = False) -> None:
        """Print the answer, with rows of lower rank if verbose; Ctrl-C does not cut it short."""
        with HeldInterrupt():
            self._answered.set()
            if self.as_json:
                self._write(json.dumps(answer.document(), indent=1, allow_nan=False) + "\n")
            elif text := self.page.rendered(answer, verbose=verbose):
                self._write(text.rstrip("\n") + "\n")
            if answer.complaint:
                self.complain(answer.complaint)

    def say(self, line: str) -> None:
        """Print a line of a live display; silent with ``--json``, whose document comes at the end."""
        if not self.as_json:
            self._write(line + "\n")

    def refuse(self, error: InputError, text: str) -> None:
        """Print why there is no answer: as a document with ``--json``, on standard error otherwise."""
        with HeldInterrupt():
            self._answered.set()
            if self.as_json:
                self._write(json.dumps(fault_document(error), indent=1) + "\n")
            else:
                self.complain(text)

    def interrupted(self) -> None:
        """Report the interruption by Ctrl-C, where nothing has been answered yet."""
        if not self._answered.is_set():
            self.refuse(InputError.of("interrupted"), "avc: interrupted")

    def complain(self, text: str) -> None:
        """Print to standard error; control characters of files, which a terminal would obey, are spelled out."""
        plain = "".join(mark if mark.isprintable() or mark in "\n\t" else ascii(mark)[1:-1] for mark in text)
        if sys.stderr is not None:
            with suppress(OSError):
                sys.stderr.write(plain.rstrip("\n") + "\n")
                sys.stderr.flush()

    def begin(self, line: str) -> None:
        """Tell at once what long work was begun, where its steps are not shown."""
        if not self._terminal:
            self.complain(line)

    def notice(self, line: str) -> None:
        """Print to standard error during a step, above its line."""
        if self._step is None or not self._terminal:
            self.complain(line)
            return
        self._show(f"{line}\n")
        self._show(f"{self._step} ...")

    @contextmanager
    def step(self, what: str) -> Iterator[None]:
        """Show a step and its duration on a terminal; elsewhere the present step every ten seconds."""
        started, around = time.perf_counter(), self._step
        self._step, self._shown, self._piece, self._line = what, started, _Piece(), f"{what} ..."
        self._show(self._line)
        if not self._terminal and self._repeated is None:
            self._repeated = threading.Thread(target=self._repeat, daemon=True)
            self._repeated.start()
        outcome = "stopped"
        try:
            yield
            outcome = f"{time.perf_counter() - started:.2f} s"
        finally:
            self._show(f"{what} ... {outcome}\n")
            self._step, self._line = around, f"{around} ..." if around else ""

    def _repeat(self) -> None:
        """Print what is done at present where its line cannot be overwritten."""
        while not self._answered.wait(_BETWEEN_LINES_S):
            if line := self._line:
                self.complain(line)

    def advance(self, done: int, total: int, what: str = "") -> None:
        """Show the progress of the present step, and its remaining time."""
        if self._step is None:
            return
        now = time.perf_counter()
        if total != self._piece.total or done < self._piece.done:
            self._piece = _Piece(total, done, began=now)
        self._piece.done = done
        if now - self._shown >= _BETWEEN_S:
            self._shown = now
            self._line = f"{self._step} ... {done} of {total} {what}".rstrip() + self._piece.pace(now)
            self._show(self._line)

    def _show(self, line: str) -> None:
        """Overwrite the line of the present step on a terminal; Ctrl-C may have cut it anywhere."""
        if self._terminal:
            with suppress(OSError):
                sys.stderr.write(f"\r\x1b[K{line}")
                sys.stderr.flush()

    def _write(self, text: str) -> None:
        if self._descriptor is None:
            sys.stdout.write(text)
            sys.stdout.flush()
            return
        data = text.encode(sys.stdout.encoding or "utf-8", errors="replace")
        while data:
            data = data[os.write(self._descriptor, data) :]


def _is_descriptor(stream: TextIO, number: int) -> bool:
    try:
        return stream.fileno() == number
    except (OSError, ValueError, AttributeError):
        return False


def silence(descriptor: int) -> None:
    """Lead a descriptor to nowhere."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, descriptor)
    os.close(nowhere)


@contextmanager
def output_folder(text: str, key: str) -> Iterator[Path]:
    """Collect results in a folder that is yielded; at the end all of them move into the requested one, or none.

    An unwritable folder is found before the long work. Without a result it is removed again.
    """
    from avc_casadi._util.files import gathered_folder

    try:
        with gathered_folder(Path(text)) as gathered:
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


def write_text(path: Path, text: str, key: str = "--out") -> None:
    """Write a file atomically; one in a folder of results by `write_file`, whose fault `output_folder` tells."""
    from avc_casadi._util.files import write_file

    with writing(path, key):
        write_file(path, text)


def write_figure(path: Path, figure: Figure, key: str = "--plot") -> None:
    """Write a picture atomically."""
    from avc_casadi.present.figures.style import save_figure

    with writing(path, key):
        save_figure(figure, path)


_PACKAGES = ("casadi", "numpy", "matplotlib", "pydantic", "pyserial", "unicorn")


def package_versions() -> dict[str, str]:
    """Return the version of this package, of Python and of every dependency; "absent" where not installed."""
    return {"avc-casadi": __version__, "Python": platform.python_version()} | {
        name: _version(name) for name in _PACKAGES
    }


def _version(package: str) -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version(package)
    except PackageNotFoundError:
        return "absent"
