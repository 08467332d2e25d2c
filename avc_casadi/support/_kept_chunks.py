"""A folder that keeps the chunks of one study, whoever writes into it: other jobs, other machines, at the same time.

Each file says of which study and which chunk it is, and what its content adds up to: one that is cut off, copied,
changed or of another study is worked out again.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any
from uuid import uuid4

from avc_casadi._errors import InputError
from avc_casadi.support._json import json_text

_ABOUT = "study.json"


@dataclass(frozen=True)
class KeptChunks:
    """The chunks of a study in a folder.

    Attributes:
        folder: where they are.
        about: what the results depend on, JSON values.
        chunks: how many there are.
    """

    folder: Path
    about: Mapping[str, Any]
    chunks: int

    def begin(self) -> None:
        """Say in the folder what it holds, unless somebody has.

        Raises:
            InputError: it holds another study, or cannot be written.
        """
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
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
        """Return the results that stand there, by chunk from 0."""
        read = ((index, self._result(index)) for index in range(self.chunks))
        return {index: result[0] for index, result in read if result}

    def keep(self, index: int, result: Any) -> None:
        """Write what a chunk gave.

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
        """Return the result of a chunk, in a tuple; None where there is none of this study."""
        held = _read(self._path(index))
        if not (isinstance(held, dict) and "result" in held):
            return None
        whole = self._heading(index, held["result"]).items() <= held.items()
        return (held["result"],) if whole else None

    def _write(self, path: Path, value: Any, *, new: bool = False) -> None:
        """Write a file that is there whole or not at all; a new one only where nobody else has."""
        partial = path.with_suffix(f".{uuid4().hex}.partial")
        try:
            partial.write_text(json_text(value), encoding="utf-8")
            if new:
                _link(partial, path)
            else:
                partial.replace(path)
        except OSError as error:
            raise self._refused(path, error) from None
        finally:
            _discard(partial)

    def _refused(self, path: Path, error: OSError) -> InputError:
        why = error.strerror or str(error)
        message = f"{path} cannot be written ({why}); what was done before stands: mend that, and take the folder again"
        return InputError.of(message, key="resume")


def _link(partial: Path, path: Path) -> None:
    """Give a file its name, unless another has it."""
    try:
        os.link(partial, path)
    except FileExistsError:
        return
    except OSError:  # a file system without links
        if not path.exists():
            partial.replace(path)


def _discard(path: Path) -> None:
    try:
        path.unlink(missing_ok=True)
    except OSError:
        return


def _digest(value: Any) -> str:
    return hashlib.sha256(json.dumps(json.loads(json_text(value)), sort_keys=True).encode()).hexdigest()


def _apart(held: Any, about: dict[str, Any]) -> str:
    """Say in what two studies differ."""
    if not (isinstance(held, dict) and isinstance(held.get("about"), dict)):
        return "it says nothing of its study"
    its, here = (
        {**one["about"], "chunks": one.get("chunks"), "release": one.get("avc_casadi")} for one in (held, about)
    )
    names = [name for name in {**its, **here} if its.get(name) != here.get(name)]
    return "; ".join(f"its {name} is {its.get(name)}, of this one {here.get(name)}" for name in names)


def _read(path: Path) -> Any:
    """Return what a file holds; None where it is not there or is cut off."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
