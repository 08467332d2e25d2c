"""Studies in chunks: one function of many tasks, on one core, several, or a cluster; finished chunks are kept."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, Executor, as_completed
from contextlib import ExitStack
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Generic, TypeVar

from avc_casadi._errors import InputError, WorkerLostError
from avc_casadi._util.files import clear_unfinished, read_text, write_file
from avc_casadi._util.json_values import json_text
from avc_casadi._util.parallel import Processes, require_workers
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi._util.units import speaks, spoken

_ABOUT = "study.json"
# A chunk is a table of numbers.
_MOST_BYTES = 2**28


@dataclass(frozen=True)
class StoredChunks:
    """The chunks of a study in a folder.

    Attributes:
        folder: of the chunks.
        about: inputs of the results, JSON values.
        chunks: their number.
    """

    folder: Path
    about: Mapping[str, Any]
    chunks: int

    def begin(self) -> None:
        """Write the description of the study to the folder, unless it exists.

        Raises:
            InputError: it holds another study, or cannot be written.
        """
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            clear_unfinished(self.folder)
        except OSError as error:
            raise self._refused(self.folder, error) from None
        path = self.folder / _ABOUT
        if not path.exists():
            self._write(path, self._told, new=True)
        self.check()

    def check(self) -> None:
        """Refuse a folder that does not hold this study.

        Raises:
            InputError: it holds another one, or none.
        """
        path = self.folder / _ABOUT
        if not path.exists():
            raise InputError.of(f"{self.folder} holds no study; allowed: the folder that the jobs kept", key="resume")
        held = _read(path)
        if held != self._told:
            message = f"{self.folder} holds another study: {_apart(held, self._told)}. Take another folder, or repeat "
            raise InputError.of(f"{message}that one", key="resume")

    def found(self) -> dict[int, Any]:
        """Return the stored results, by chunk from 0."""
        read = ((index, self._result(index)) for index in range(self.chunks))
        return {index: result[0] for index, result in read if result}

    def keep(self, index: int, result: Any) -> None:
        """Write the result of a chunk.

        Raises:
            InputError: it cannot be written.
        """
        self._write(self._path(index), {**self._heading(index, result), "result": result})

    @property
    def _told(self) -> Any:
        told = {"about": self.about, "chunks": self.chunks, "avc_casadi": version("avc-casadi")}
        return json.loads(json_text(told))

    def _path(self, index: int) -> Path:
        return self.folder / f"chunk-{index + 1:06d}.json"

    def _heading(self, index: int, result: Any) -> dict[str, Any]:
        return {"study": _digest(self._told), "chunk": index + 1, "sha256": _digest(result)}

    def _result(self, index: int) -> tuple[Any] | None:
        """Return the result of a chunk, in a tuple; None where this study has none."""
        held = _read(self._path(index))
        if not (isinstance(held, dict) and "result" in held):
            return None
        whole = self._heading(index, held["result"]).items() <= held.items()
        return (held["result"],) if whole else None

    def _write(self, path: Path, value: Any, *, new: bool = False) -> None:
        """Write a file atomically; a new one only where no other process has."""
        try:
            write_file(path, json_text(value), new=new)
        except OSError as error:
            raise self._refused(path, error) from None

    def _refused(self, path: Path, error: OSError) -> InputError:
        why = error.strerror or str(error)
        message = f"{path} cannot be written ({why}); what was done before stands: mend that, and take the folder again"
        return InputError.of(message, key="resume")


def _digest(value: Any) -> str:
    return hashlib.sha256(json.dumps(json.loads(json_text(value)), sort_keys=True).encode()).hexdigest()


def _apart(held: Any, about: dict[str, Any]) -> str:
    """Describe how two studies differ."""
    if not (isinstance(held, dict) and isinstance(held.get("about"), dict)):
        return "it says nothing of its study"
    its, here = (
        {**one["about"], "chunks": one.get("chunks"), "release": one.get("avc_casadi")} for one in (held, about)
    )
    names = [name for name in {**its, **here} if its.get(name) != here.get(name)]
    return "; ".join(f"its {name} is {its.get(name)}, of this one {here.get(name)}" for name in names)


def _read(path: Path) -> Any:
    """Return the content of a file; None where it is absent, cut off, or holds numbers that JSON has not."""
    try:
        found = json.loads(read_text(path, _MOST_BYTES))
        json.dumps(found, allow_nan=False)
    except (ValueError, RecursionError):  # also unreadable files
        return None
    return found


T = TypeVar("T")
R = TypeVar("R")


@dataclass(frozen=True)
class Part:
    """One of several jobs that share the chunks of a study, dealt out in turn.

    Attributes:
        number: 1 to `of`.
        of: number of jobs.
    """

    number: int
    of: int

    @classmethod
    def of_text(cls, text: str) -> Part:
        """Read ``7/100``.

        Raises:
            ValueError: it is something else.
        """
        number, _, of = text.partition("/")
        found = cls(int(number), int(of))
        if not 1 <= found.number <= found.of:
            raise ValueError(f"{text!r} is no part; allowed: 1/N to N/N")
        return found

    def __str__(self) -> str:
        return f"{self.number}/{self.of}"


@dataclass(frozen=True)
class Chunked(Generic[T, R]):
    """A study in chunks.

    The result depends on the tasks alone: not on the executor, the order, or the number of runs.

    Attributes:
        about: inputs of the results, JSON values; a folder keeps the chunks of one study.
        work: function of a module; returns JSON values for a folder.
        tasks: its arguments, one for each chunk.
        finish: combines the results of all chunks, in their order.
        sizes: number of items of each chunk, for progress; empty where each is one.
        things: name of the items.
    """

    about: Mapping[str, Any]
    work: Callable[[T], Any]
    tasks: Sequence[T]
    finish: Callable[[list[Any]], R]
    sizes: Sequence[int] = ()
    things: str = "chunks"

    def run(
        self,
        executor: Executor | None = None,
        *,
        workers: int = 1,
        folder: str | Path | None = None,
        progress: Progress = SILENT,
    ) -> R:
        """Compute the missing chunks, and return the result.

        Args:
            executor: of `concurrent.futures` or with its interface; it is not shut down.
            workers: processes without an executor; 1 stays in this one. More than one start this program anew, so that
                a script needs its guard ``if __name__ == "__main__"``.
            folder: stores each chunk as soon as it is done, and provides those of an earlier run.
            progress: of the chunks.

        Raises:
            InputError: the folder holds another study or cannot be written, or there are no workers.
            WorkerLostError: a worker died, and the executor does not repeat its chunk.
        """
        return self.finish(list(self._all(executor, workers, folder, None, progress).values()))

    def run_part(
        self,
        part: Part,
        folder: str | Path,
        executor: Executor | None = None,
        *,
        workers: int = 1,
        progress: Progress = SILENT,
    ) -> int:
        """Compute the chunks of one job among several, which share a folder; return the number of stored ones of all.

        Args:
            part: which job.
            folder: stores the chunks.
            executor: as in `run`.
            workers: as in `run`.
            progress: of the chunks.
        """
        self._all(executor, workers, folder, part, progress)
        return len(self.tasks) - len(self.missing(folder))

    def merged(self, folder: str | Path) -> R:
        """Return the result of the stored chunks; compute and write nothing.

        Raises:
            InputError: chunks are missing, or the folder holds another study or none.
        """
        self._kept(folder).check()
        kept = self._kept(folder).found()
        missing = [index + 1 for index in range(len(self.tasks)) if index not in kept]
        if missing:
            some = ", ".join(map(str, missing[:10])) + (", ..." if len(missing) > 10 else "")
            message = (
                f"{folder} holds {len(kept)} of {len(self.tasks)} chunks; missing: {some}. Run the jobs that are left, "
                "or leave the merging out and work them out here"
            )
            raise InputError.of(message, key="merge")
        return self.finish([kept[index] for index in range(len(self.tasks))])

    def missing(self, folder: str | Path) -> list[int]:
        """Return the chunks that a folder does not hold, from 0."""
        kept = self._kept(folder).found()
        return [index for index in range(len(self.tasks)) if index not in kept]

    def _all(
        self, executor: Executor | None, workers: int, folder: str | Path | None, part: Part | None, progress: Progress
    ) -> dict[int, Any]:
        """Return the results of all chunks, or of one job's, in their order."""
        require_workers(workers)
        mine = range(len(self.tasks))[slice(None) if part is None else slice(part.number - 1, None, part.of)]
        place = None if folder is None else self._kept(folder)
        if place is not None:
            place.begin()
        kept = {} if place is None else place.found()
        found = {index: kept[index] for index in mine if index in kept}
        sizes = self.sizes or [1] * len(self.tasks)
        done, total = sum(sizes[index] for index in found), sum(sizes[index] for index in mine)
        left = [index for index in mine if index not in found]
        progress.advance(done, total, self.things)
        with ExitStack() as stack:
            if executor is None and workers > 1 and len(left) > 1:
                executor = stack.enter_context(Processes(min(workers, len(left))))
            for index, result in self._results(left, executor, kept=place is not None):
                if place is not None:
                    place.keep(index, result)
                found[index] = result
                done += sizes[index]
                progress.advance(done, total, self.things)
        return {index: found[index] for index in mine}

    def _results(self, left: Iterable[int], executor: Executor | None, *, kept: bool) -> Iterator[tuple[int, Any]]:
        """Yield chunks as they are done."""
        if executor is None:
            yield from ((index, self.work(self.tasks[index])) for index in left)
            return
        futures = {executor.submit(speaks, spoken(), self.work, self.tasks[index]): index for index in left}
        try:
            for future in as_completed(futures):
                try:
                    yield futures[future], future.result()
                except (BrokenExecutor, WorkerLostError) as error:
                    again = "; chunks that are done are kept: run it again with the same folder" if kept else ""
                    raise WorkerLostError(
                        f"chunk {futures[future] + 1} of {len(self.tasks)}: {error}{again}"
                    ) from error
        finally:
            for future in futures:
                future.cancel()

    def _kept(self, folder: str | Path) -> StoredChunks:
        return StoredChunks(Path(folder), self.about, len(self.tasks))
