"""What the ablations share: functions and constants of the package are replaced for a while, and calls are noted."""

from __future__ import annotations

import contextlib
import importlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import reduce
from typing import Any


def _owner(target: str) -> tuple[Any, str]:
    """Return the module or class of a name below avc_casadi, and the name in it."""
    room, module, *names = target.split(".")
    if room == "design":
        module, names = f"{module}.{names[0]}", names[1:]
    return reduce(getattr, names[:-1], importlib.import_module(f"avc_casadi.{room}.{module}")), names[-1]


@contextlib.contextmanager
def replaced(stands_in: Mapping[str, Callable[[Any], Any]]) -> Iterator[None]:
    """Put what is made of each target in its place for a while."""
    kept = []
    for target, make in stands_in.items():
        owner, name = _owner(target)
        kept.append((owner, name, getattr(owner, name)))
        setattr(owner, name, make(kept[-1][2]))
    try:
        yield
    finally:
        for owner, name, original in reversed(kept):
            setattr(owner, name, original)


def noted(targets: Iterable[str], called: set[str]) -> contextlib.AbstractContextManager[None]:
    """Note in a set which functions are called."""

    def noting(target: str) -> Callable[[Any], Any]:
        def of(original: Any) -> Any:
            def call(*args: Any, **named: Any) -> Any:
                called.add(target)
                return original(*args, **named)

            return call

        return of

    return replaced({target: noting(target) for target in targets})
