"""Read access to the values of a problem by path, whether they come from a model or from a file with faults."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from typing import Any

from pydantic import BaseModel

from avc_casadi.problem._quantity import shown

Path = tuple[str | int, ...]
UNKNOWN = "is not a known key; allowed: "
"""How the finding of a mistyped key begins."""
BELONGS_IN = "; it belongs in "
"""How it goes on where other tables have that key."""

_BARE_KEY = re.compile(r"[A-Za-z0-9_-]{1,60}")


def dotted(path: Path) -> str:
    """Write a path as a user does: ``scene.effects[0].mass_kg``."""
    text = ""
    for part in path:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            text += f".{part}" if _BARE_KEY.fullmatch(part) else f".{shown(part)}"
    return text.removeprefix(".")


class UnsoundError(LookupError):
    """A rule asked for a value that is faulty or missing; its own fault is told elsewhere."""


class Values:
    """Read access to a problem, whether a model or the tables of a file with faults in it."""

    def __init__(self, problem: Mapping[str, Any] | BaseModel, model: type[BaseModel], faulty: Collection[Path] = ()):
        self._problem = problem
        self._model = model
        self._faulty = faulty

    def given(self, *path: str) -> bool:
        """Whether the value was written down, rather than a default."""
        node: Any = self._problem
        for key in path:
            keys = node.model_fields_set if isinstance(node, BaseModel) else node
            if not isinstance(keys, Mapping | set) or key not in keys:
                return False
            node = getattr(node, key) if isinstance(node, BaseModel) else node[key]
        return True

    def __getitem__(self, path: str) -> Any:
        """Return the value at a dotted path, a default where it is left out.

        Raises:
            UnsoundError: the value is faulty, or missing and without a default.
        """
        keys = tuple(path.split("."))
        if any(keys[: len(bad)] == bad[: len(keys)] for bad in self._faulty):
            raise UnsoundError(path)
        node: Any = self._problem
        model: Any = self._model
        for key in keys:
            field = model.model_fields[key]
            if isinstance(node, Mapping) and key not in node:
                if field.is_required() or field.default_factory is not None:
                    raise UnsoundError(path)
                node = field.default
            else:
                node = getattr(node, key) if isinstance(node, BaseModel) else node[key]
            model = field.annotation
        return node

    def get(self, path: str, default: Any) -> Any:
        """Return the value at a dotted path, `default` where it is unsound."""
        try:
            return self[path]
        except UnsoundError:
            return default
