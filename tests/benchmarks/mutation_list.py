"""The edits of `mutation_run.py`, read from the tables in `mutations/`, one table an area."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path

TABLES = Path(__file__).parent / "mutations"
ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Edit:
    """One change of behaviour that a test must notice.

    Attributes:
        area: name of the table.
        path: edited file, from the root.
        old: text that stands exactly once in it.
        new: text in its place.
        tests: test files (or ``file::test``) that are run against it, the one that should notice first.
        why: what is wrong with the edited code.
        survives: why no test notices, or empty where one must.
    """

    area: str
    path: str
    old: str
    new: str
    tests: tuple[str, ...]
    why: str
    survives: str = ""

    def applied(self, root: Path) -> str | None:
        """Return the edited text of the file below a root; None where the list is stale."""
        path = root / self.path
        text = path.read_text(encoding="utf-8") if path.exists() else ""
        return text.replace(self.old, self.new) if text.count(self.old) == 1 else None


def areas() -> tuple[str, ...]:
    """Names of the tables."""
    return tuple(sorted(path.stem for path in TABLES.glob("*.toml")))


def edits(area: str | None = None) -> list[Edit]:
    """Read one table, or all."""
    found = []
    for name in areas() if area is None else (area,):
        for file in tomllib.loads((TABLES / f"{name}.toml").read_text(encoding="utf-8"))["file"]:
            for item in file["edit"]:
                listed = {"tests": file["tests"], **item}
                found.append(Edit(name, file["path"], **{**listed, "tests": tuple(listed["tests"])}))
    return found
