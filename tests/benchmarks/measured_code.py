"""Which files of the package a study runs, and what changed in them since it was made."""

from __future__ import annotations

import ast
import re
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import avc_casadi
from avc_casadi.cli.dispatch import MODULES

ROOT = Path(__file__).parents[2]
_ROOTS = (ROOT, ROOT / "hardware", ROOT / "tests", ROOT / "tests" / "benchmarks")
_PACKAGES = ("avc_casadi", "avc_hardware")


@dataclass(frozen=True)
class Age:
    """How old a result is.

    Attributes:
        commit: that it was made as of.
        changes: commits since then that touch the files it runs; None where git does not know the commit.
        newest: the latest of them.
    """

    commit: str
    changes: int | None
    newest: str


def age(commit: str, start: Path) -> Age:
    """Count what changed since a commit in the code that a script runs."""
    files = [path.relative_to(ROOT).as_posix() for path in sorted(code_of(start))]
    found = subprocess.run(  # noqa: S603
        ["git", "log", "--format=%h %s", f"{commit}..HEAD", "--", *files],  # noqa: S607
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    lines = found.stdout.splitlines()
    return Age(commit, len(lines) if found.returncode == 0 else None, lines[0] if lines else "")


@cache
def code_of(start: Path) -> frozenset[Path]:
    """Files of both packages that a script imports, directly or not, late imports and those named in strings too."""
    seen, left = {start}, [start]
    while left:
        for path in imported(left.pop()):
            if path not in seen:
                seen.add(path)
                left.append(path)
    inside = [ROOT / "avc_casadi", ROOT / "hardware" / "avc_hardware"]
    return frozenset(path for path in seen if any(path.is_relative_to(package) for package in inside))


@cache
def imported(path: Path) -> tuple[Path, ...]:
    """Files of the modules that one file names."""
    return tuple(_named(path))


def _named(path: Path) -> Iterator[Path]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    if path == ROOT / "avc_casadi" / "__init__.py":
        return  # it imports at first use: what is used is followed where it is used
    for node in ast.walk(tree):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
            if node.module == "avc_casadi":
                names += [used(alias.name) for alias in node.names]
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "avc":
            names = [used(node.attr)]
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            names = re.findall(r"\b(?:avc_casadi|avc_hardware)(?:\.\w+)+", node.value)
            for name in names:
                yield from scanned(name)
        for name in names:
            yield from files_of(name)


def used(name: str) -> str:
    """Module of a name of the package's top."""
    lazy: dict[str, str] = avc_casadi.__dict__["_LAZY"]
    return f"avc_casadi.{lazy.get(name, name)}"


def files_of(module: str) -> Iterator[Path]:
    """The file of a module in the packages or beside the tests; none of others."""
    place = Path(*module.split("."))
    for root in _ROOTS if module.split(".", maxsplit=1)[0] not in _PACKAGES else _ROOTS[:2]:
        for path in (root / place.with_suffix(".py"), root / place / "__init__.py"):
            if path.is_file():
                yield path


def scanned(package: str) -> Iterator[Path]:
    """The files of a folder that a registry scans, by the name of its package."""
    for root in _ROOTS[:2]:
        yield from sorted((root / Path(*package.split("."))).glob("*.py"))


def start_of(command: str) -> Path:
    """The file that a command runs first: a script, a module, a test, or a verb of avc."""
    if found := re.search(r"(tests/[\w/]+\.py)", command):
        return ROOT / found[1]
    if found := re.search(r"-m (tests\.benchmarks\.\w+)", command):
        return ROOT / Path(*found[1].split(".")).with_suffix(".py")
    if found := re.match(r"avc (\w+)", command):
        return ROOT / "avc_casadi" / "cli" / f"{MODULES[found[1]]}.py"
    raise ValueError(f"no file stands behind the command {command!r}")
