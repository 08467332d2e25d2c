"""Break the code in small ways written down by hand, one at a time, and see whether the tests that should notice do.

The edits stand in mutations/*.toml: file, old text, new text, tests to run (quick ones before those marked slow) and
why it matters. An edit is killed when a listed test fails that passes without it, and survived when all pass or need
more than LIMIT_S of processor time; it is stale when its old text does not stand exactly once in its file. An edit that
no test can notice says why in its table. The run ends with 1 where an edit is stale, survived unexplained or is
explained and killed.
"""

from __future__ import annotations

import argparse
import sys
import tomllib
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from mutate import ROOT, Mutant, run

TABLES = Path(__file__).parent / "mutations"
LIMIT_S = 300


@dataclass(frozen=True)
class Edit:
    """One change of behaviour that a test must notice: the text `old`, which stands once in a file, becomes `new`.

    `survives` says why no test notices, or is empty where one must.
    """

    area: str
    path: str
    old: str
    new: str
    tests: tuple[str, ...]
    why: str
    survives: str = ""

    def mutant(self) -> Mutant | None:
        """Return the change of bytes; None where the list is stale."""
        path = ROOT / self.path
        whole, old = path.read_bytes() if path.exists() else b"", self.old.encode()
        start = whole.find(old) if whole.count(old) == 1 else -1
        end, line = start + len(old), whole.count(b"\n", 0, start) + 1
        return (
            None
            if start < 0
            else Mutant(self.area, self.path, line, "", "edit", start, end, self.new.encode(), self.tests)
        )


def areas() -> tuple[str, ...]:
    """Names of the tables."""
    return tuple(sorted(path.stem for path in TABLES.glob("*.toml")))


def edits(area: str) -> list[Edit]:
    """Read one table."""
    files = tomllib.loads((TABLES / f"{area}.toml").read_text(encoding="utf-8"))["file"]
    listed = [{"path": file["path"], "tests": file["tests"], **item} for file in files for item in file["edit"]]
    return [Edit(area, **{**item, "tests": tuple(item["tests"])}) for item in listed]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=areas(), default=areas(), help="tables; default all")
    listed = [edit for area in parser.parse_args().only for edit in edits(area)]
    outcomes, mutants = Counter[str](), {mutant: edit for edit in listed if (mutant := edit.mutant())}
    faults = [f"stale: {edit.path}: {edit.why} ({edit.old})" for edit in listed if not edit.mutant()]
    for mutant, by, cpu_s in run([*mutants], 1, LIMIT_S):
        edit, outcome = mutants[mutant], "killed" if by else "survived"
        outcomes[outcome] += 1
        print(f"{edit.area}: {outcome} {cpu_s:.0f} s {edit.path}: {edit.why} {by}", flush=True)
        if bool(by) == bool(edit.survives):
            faults.append(f"{outcome}{' though explained' if by else ''}: {edit.path}: {edit.why} ({edit.old})")
    print(dict(outcomes), *faults, sep="\n")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
