"""The catalogue of problem files that comes with the package."""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import MappingProxyType

from avc_casadi._errors import InputError
from avc_casadi.model.table import shown

DEVICES = "devices/"
"""Folder of the catalogue's devices."""
ADMITTANCE = "admittance/"
"""Folder of the catalogue's admittance devices, which couplings are no question of."""
_PACKAGE = Path(__file__).resolve().parents[1]


@dataclass(frozen=True)
class CatalogueEntry:
    """One problem of the catalogue."""

    name: str
    title: str
    source: str
    path: Path


def require_source(source: object, allowed: str) -> None:
    """Refuse what is neither a text nor a path."""
    if not isinstance(source, str | Path):
        raise InputError.of(f"is {shown(source)}; allowed: {allowed}", key="source")


def problems_folder() -> Path:
    """Return the folder of the catalogue: in a wheel, a checkout or an editable install."""
    for folder in (_PACKAGE / "_problems", _PACKAGE.parent / "problems"):
        if (folder / "figure5.toml").is_file():
            return folder
    raise FileNotFoundError(f"the built-in problems are missing next to {_PACKAGE}; reinstall avc-casadi")


@cache
def catalogue_names() -> Mapping[str, Path]:
    """Return the path of every problem by name: plain problems first, then those of folders.

    The files of a package stay as they are while it runs, so the folders are read once.
    """
    folder = problems_folder()
    files = sorted(folder.rglob("*.toml"), key=lambda path: (len(path.relative_to(folder).parts), path))
    named = {path.relative_to(folder).with_suffix("").as_posix(): path for path in files}
    return MappingProxyType({name: path for name, path in named.items() if not name.startswith((DEVICES, ADMITTANCE))})


def admittance_names() -> dict[str, Path]:
    """Return the path of every admittance device of the catalogue by name."""
    folder = problems_folder() / ADMITTANCE
    return {f"{ADMITTANCE}{path.stem}": path for path in sorted(folder.glob("*.toml"))}


def device_names() -> dict[str, Path]:
    """Return the path of every device of the catalogue by name."""
    return {path.stem: path for path in sorted((problems_folder() / DEVICES).glob("*.toml"))}


def device_path(source: str | Path, folder: Path | None = None) -> Path | str:
    """Return the file of a device, or the fault of its name."""
    if isinstance(source, Path) or source.endswith(".toml"):
        return Path(folder or "", source)
    names = device_names()
    name = source.removeprefix(DEVICES)
    if name in names:
        return names[name]
    allowed = "allowed: a name that `avc list` shows, or the path of a .toml file"
    return f"is {shown(source)}, not a built-in device{_near(name, names)}; {allowed}"


def _near(name: str, names: Iterable[str]) -> str:
    """Return a hint at the names that are near to one, or nothing."""
    near = difflib.get_close_matches(name, names, n=3, cutoff=0.5)
    return f"; near: {', '.join(near)}" if near else ""


def catalogue() -> tuple[CatalogueEntry, ...]:
    """Return every problem of the catalogue: plain problems first, then those of folders, each group by name.

    Returns:
        Entries with ``name``, as every call takes it, ``title``, ``source`` of the values, and ``path`` of the file.

    Example:
        >>> [entry.name for entry in avc.catalogue()][:3]
        ['damped', 'damper', 'diverging']
    """
    return _entries(catalogue_names())


def admittance_catalogue() -> tuple[CatalogueEntry, ...]:
    """Return every admittance device of the catalogue."""
    return _entries(admittance_names())


def _entries(names: Mapping[str, Path]) -> tuple[CatalogueEntry, ...]:
    entries = []
    for name, path in names.items():
        table = tomllib.loads(path.read_text(encoding="utf-8"))
        entries.append(CatalogueEntry(name, table["title"], table["source"], path))
    return tuple(entries)


def catalogue_path(name: str) -> Path:
    """Return the file of a catalogue problem, to copy and change.

    Args:
        name: as `catalogue` lists it.

    Raises:
        InputError: no such name; lists the nearest ones.

    Example:
        >>> avc.catalogue_path("figure5").name
        'figure5.toml'
    """
    require_source(name, "the name of a problem, as `avc list` shows them")
    names = catalogue_names()
    if name in names:
        return names[name]
    device = name.removeprefix(DEVICES)
    if device in device_names():
        message = f'is a device, not a problem; write device = "{device}" in a problem file; `avc check` shows it'
        raise InputError.of(message, file=name)
    message = f"is neither a file nor a built-in problem{_near(name, names)}; `avc list` shows all problems"
    raise InputError.of(message, file=name)
