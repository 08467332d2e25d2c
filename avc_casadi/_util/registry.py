"""A registry: objects of one kind by name, each declared in one module, or in the files of one folder."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping
from importlib import import_module
from pkgutil import iter_modules
from typing import Generic, TypeVar

from avc_casadi._errors import InputError

Thing = TypeVar("Thing")


class Registry(Mapping[str, Thing], Generic[Thing]):
    """Objects of one kind by name, in the order of their ranks.

    `kind` names the kind in faults, and `place` is the module or package in which its objects declare themselves.
    """

    def __init__(self, kind: str, place: str) -> None:
        self.kind = kind
        self.place = place
        self._things: dict[str, tuple[float, Thing]] = {}
        self._scanned = False

    def add(self, name: str, thing: Thing, rank: float) -> None:
        """Declare one object."""
        self._things[name] = rank, thing

    def named(self, name: str, key: str | None = None, also: tuple[str, ...] = ()) -> Thing:
        """Return the object of a name; `also` are names that the caller knows besides, for the fault of another."""
        if isinstance(name, str) and name in self:
            return self[name]
        near = difflib.get_close_matches(name, (*also, *self), n=1) if isinstance(name, str) else []
        hint = f", did you mean {near[0]}?" if near else ""
        message = f"{name!r} is not a known {self.kind}{hint}; allowed: {', '.join((*also, *self))}"
        raise InputError.of(message, key=self.kind if key is None else key)

    def __getitem__(self, name: str) -> Thing:
        self._scan()
        return self._things[name][1]

    def __iter__(self) -> Iterator[str]:
        self._scan()
        return iter(sorted(self._things, key=lambda name: self._things[name][0]))

    def __len__(self) -> int:
        self._scan()
        return len(self._things)

    def _scan(self) -> None:
        """Import the modules in which objects declare themselves, once."""
        if not self._scanned:
            for module in iter_modules(getattr(import_module(self.place), "__path__", ()), f"{self.place}."):
                import_module(module.name)
            self._scanned = True
