"""Output of a command: its answer, its messages, its progress and its files; what writes to the terminal."""

from __future__ import annotations

import json
import os
import platform
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from avc_casadi import AvcError, InputError, __version__, fault_document
from avc_casadi._util.interrupt import DeferredInterrupt
from avc_casadi._util.progress import Progress
from avc_casadi.present.row import Answer, Page

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_ADVANCE_S = 0.2
"""Shortest time, s, between two prints of the progress of a step."""

_ESTIMATED_AFTER_S = 1
"""Time, s, after which it is estimated what time is left."""

_REPEAT_S = 10.0
"""Time, s, after which the progress is printed anew where no line can be overwritten."""

_REFRESH_S = 1.0
"""Time, s, after which it is printed anew on a terminal: no wait looks as if it stood still."""


class Console(Progress):
    """Standard output carries the answer alone, standard error everything else.

    C libraries write to file descriptor 1 behind Python's back, some of them only when the process ends. The
    descriptor is therefore led to standard error for the rest of the process, and the answer is written to a copy of
    the original. A replaced ``sys.stdout`` (in a test, in a notebook) is written to directly.
    """

    def __init__(self, *, as_json: bool, work: str = "") -> None:
        self.as_json, self._work = as_json, work
        self.page = Page.of(sys.stdout)
        self.written: list[str] = []
        self._answered = threading.Event()
        self._terminal = sys.stderr is not None and sys.stderr.isatty()
        self._step: str | None = None
        self._line = ""
        self._shown = 0.0  # when the line was printed last
        # Parts of the present step.
        self._total = -1
        self._done = 0
        self._part = ""
        self._first = 0  # done when the count began
        self._began = 0.0  # when it began
        self._reached = 0.0  # when the last part that is done was
        descriptor = -1
        with suppress(OSError, ValueError, AttributeError):
            descriptor = sys.stdout.fileno()
        self._descriptor: int | None = None
        if descriptor == 1:
            sys.stdout.flush()
            self._descriptor = os.dup(1)
            try:
                os.dup2(2, 1)
            except OSError:
                silence(1)
        if work:
            threading.Thread(target=self._repeat, daemon=True).start()

    def answer(self, answer: Answer, *, verbose: bool = False) -> None:
        """Print the answer, with rows of lower rank if verbose; Ctrl-C does not cut it short."""
        with DeferredInterrupt():
            self._answered.set()
            if self.as_json:
                self._write(json.dumps(answer.document(), indent=1, allow_nan=False) + "\n")
            else:
                text = self.page.rendered(answer, verbose=verbose)
                if text:
                    self._write(text.rstrip("\n") + "\n")
            if answer.complaint:
                self.complain(answer.complaint)

    def say(self, line: str) -> None:
        """Print a line of a live display; silent with ``--json``, whose document comes at the end."""
        self._work = ""
        if not self.as_json:
            self._write(line + "\n")

    def write(self, path: Path, text: str) -> None:
        """Write a file atomically, of which the answer tells."""
        from avc_casadi._util.files import write_file

        write_file(path, text)
        self.written.append(str(path))

    def refuse(self, error: InputError, text: str) -> None:
        """Print why there is no answer: as a document with ``--json``, on standard error otherwise."""
        with DeferredInterrupt():
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

    def notice(self, line: str) -> None:
        """Print to standard error during a step, above its line."""
        if self._step is None or not self._terminal:
            self.complain(line)
            return
        self._show(f"{line}\n")
        self._show(f"{self._step} ...")

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        """Show a step and its duration on a terminal."""
        started, outer_step = time.perf_counter(), self._step
        self._step = name
        self._shown = started
        self._total = -1
        self._line = f"{name} ..."
        self._show(self._line)
        outcome = "stopped"
        try:
            yield
            outcome = f"{time.perf_counter() - started:.2f} s"
        finally:
            self._show(f"{name} ... {outcome}\n")
            self._step = outer_step
            self._line = f"{outer_step} ..." if outer_step else ""

    def _repeat(self) -> None:
        """Print what is done at present, the verb at least: on a terminal every second, elsewhere every ten."""
        while not self._answered.wait(_REFRESH_S if self._terminal else _REPEAT_S):
            line = self._line or (self._work and f"{self._work} ...")
            if self._total >= 0:
                line = self._counted(time.perf_counter())
            if line and not self._terminal:
                self.complain(line)
            elif line and self._step is not None:
                self._show(line)

    def advance(self, done: int, total: int, part: str = "") -> None:
        """Show the progress of the present step, at most five times a second, and after a second what time is left."""
        now = time.perf_counter()
        # A count that turns out to be longer goes on.
        longer = total == self._total + 1 and done >= self._done
        if done < self._done or not (total == self._total or longer):
            self._first = done
            self._began = self._reached = now
        if done > self._done:
            self._reached = now
        self._total = total
        self._done = done
        self._part = part
        if now - self._shown < _ADVANCE_S:
            return
        self._shown, self._line = now, self._counted(now)
        if self._step is not None:
            self._show(self._line)

    def _counted(self, now: float) -> str:
        """Return what is done of the present step, and how long the rest takes at the same pace, if one is known."""
        seconds = now - self._began
        pace = ""
        if seconds >= _ESTIMATED_AFTER_S:
            left_s = self._left_s(now)
            pace = f"; {seconds:.0f} s so far" if left_s is None else f"; about {left_s:.0f} s left"
        of_total = f" of {self._total}" if self._total else ""
        return f"{self._step or self._work} ... {self._done}{of_total} {self._part}".rstrip() + pace

    def _left_s(self, now: float) -> float | None:
        """Return how long the rest of the present step takes, s; None where no pace is known.

        Each part takes as long as the mean of those that are done, and the present one has begun. Where it takes longer
        than that, it is nearly done and counts for the mean; of the last part nothing is known then.
        """
        made = self._done - self._first
        if not self._total or made <= 0:
            return None
        mean_s = (self._reached - self._began) / made
        present_s = now - self._reached
        others = self._total - self._done - 1
        if present_s <= mean_s:
            return (others + 1) * mean_s - present_s
        return others * (now - self._began) / (made + 1) if others > 0 else None

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


def silence(descriptor: int) -> None:
    """Lead a descriptor to nowhere."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, descriptor)
    os.close(nowhere)


@contextmanager
def output_folder(text: str, key: str) -> Iterator[Path]:
    """Collect results in a folder that is yielded; at the end all of them move into the requested one, or none."""
    from avc_casadi._util.files import staging_folder

    try:
        with staging_folder(Path(text)) as gathered:
            yield gathered
    except OSError as error:
        if isinstance(error, AvcError | BrokenPipeError):
            raise
        why = error.strerror or str(error)
        raise InputError.of(f"{text!r} cannot be written ({why}); choose another place", key=key) from error


def write_figure(console: Console, path: Path | None, draw: Callable[[], Figure]) -> None:
    """Draw the picture of --plot, if it was given, and write it atomically."""
    if path is None:
        return
    with console.step("figure"):
        from avc_casadi.present.figures.style import save_figure

        save_figure(draw(), path)
        console.written.append(str(path))


def package_versions() -> dict[str, str]:
    """Return the version of this package, of Python and of every dependency; "absent" where not installed."""
    from importlib.metadata import PackageNotFoundError, version

    versions = {"avc-casadi": __version__, "Python": platform.python_version()}
    for name in ("casadi", "numpy", "matplotlib", "pydantic", "pyserial", "unicorn"):
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            versions[name] = "absent"
    return versions
