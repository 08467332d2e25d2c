"""Names of release 0.2: its rooms still answer in 0.3, with a warning that names each one's present place."""

from __future__ import annotations

import warnings
from importlib import import_module, util
from importlib.abc import Loader
from pkgutil import iter_modules
from types import FunctionType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable
    from importlib.machinery import ModuleSpec
    from types import ModuleType

HOMES = {
    "certificate": ("claims",),
    "coupling": ("model", "paper", "files", "claims"),
    "design": ("design", "paper"),
    "design.joint": ("design.schedule",),
    "design.pointwise": ("paper",),
    "diagnosis": ("identification.diagnosis",),
    "excitation": ("identification.excitation",),
    "explore": ("present.explore",),
    "figures": ("present.figures",),
    "identification": ("identification",),
    "loop": ("paper", "model"),
    "passivity": ("claims.passivity",),
    "problem": ("model", "files"),
    "proof": ("claims.prove",),
    "recommendation": ("recommendation",),
    "report": ("present.report",),
    "runtime": ("simulation.runtime", "model"),
    "scene": ("simulation", "simulation.effects"),
    "stability": ("claims.stability",),
    "study": (),
    "study.comparison": ("design.comparison",),
    "support": ("_util",),
    "trial": ("simulation.population",),
}
"""The rooms of 0.2, each with the packages whose modules hold its names now."""

STUDIES = ("study.accuracy", "study.estimators", "study.reference", "study.table1")
"""The rooms of 0.2 that are no longer part of the package."""


def lookup(room: str) -> Callable[[str], Any]:
    """Return the ``__getattr__`` of a room of 0.2."""

    def find(name: str) -> Any:
        if not name.startswith("_") and not _is_module(f"{__package__}.{room}", name):
            for package in HOMES[room]:
                folder = import_module(f"{__package__}.{package}")
                for found in iter_modules(folder.__path__):
                    if found.name.startswith("_") or found.ispkg:
                        continue
                    module = import_module(f"{folder.__name__}.{found.name}")
                    value = vars(module).get(name)
                    own = isinstance(value, type | FunctionType)
                    if value is not None and (not own or value.__module__ == module.__name__):
                        warnings.warn(
                            f"{__package__}.{room}.{name} stands in {module.__name__} since 0.3; the old name goes "
                            "with 0.4",
                            DeprecationWarning,
                            stacklevel=3,
                        )
                        return value
        raise AttributeError(f"module '{__package__}.{room}' has no attribute {name!r}")

    return find


def _is_module(room: str, name: str) -> bool:
    """Return whether a room has a module of that name, which precedes: Python queries the room before importing one."""
    return hasattr(import_module(room), "__path__") and util.find_spec(f"{room}.{name}") is not None


def spec_of_old_room(fullname: str) -> ModuleSpec | None:
    """Return the spec of a room of 0.2 that is no longer a folder; None for everything else.

    Raises:
        ModuleNotFoundError: a study.
    """
    room = fullname.removeprefix(f"{__package__}.")
    if room in STUDIES:
        raise ModuleNotFoundError(
            f"{fullname} is no part of the package since 0.3: studies stand in tests/benchmarks/studies of the source "
            "distribution",
            name=fullname,
        )
    return util.spec_from_loader(fullname, _OldRoom()) if room in HOMES else None


class _OldRoom(Loader):
    def exec_module(self, module: ModuleType) -> None:
        """Let the module look up its names at their present place."""
        module.__path__ = []
        vars(module)["__getattr__"] = lookup(module.__name__.removeprefix(f"{__package__}."))
