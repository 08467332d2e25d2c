"""Break the code in small ways, one at a time, and see whether the tests that should notice do.

The edits stand in mutations/*.toml: file, old text, new text, tests to run (quick ones before those marked slow) and
why it matters. They are made in a copy of the tree below a temporary folder. An edit is killed when a listed test fails
or takes far too long; it survived when all pass; it is stale when its old text does not stand exactly once in its file.
An edit that no test can notice says why in its table. The run ends with 1 where an edit is stale, survived unexplained
or is explained and killed, or where fewer than 90 % are killed.

All tables together took 2 h 20 min on two cores that ten other processes used as well; --only runs one table.
"""

from __future__ import annotations

import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from mutation_list import ROOT, Edit, areas, edits
from script_arguments import script_arguments

COPIED = ("avc_casadi", "hardware", "problems", "tests", "pyproject.toml")
# Processor time, so that others on the machine do not make an edit look killed; wall time for what hangs.
LONGEST_S, HANGING_S, NO_TESTS = 120, 1800, 5
GOAL = 0.9


def copied(folder: Path) -> Path:
    """Copy the tree, byte code that knows its source by content beside it."""
    root = folder / "tree"
    root.mkdir()
    for name in COPIED:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, root / name, ignore=shutil.ignore_patterns("__pycache__", ".*"))
        else:
            shutil.copy(ROOT / name, root / name)
    # Two edits of the same length within a second have the same size and time: byte code must not go by those.
    hashed = ["-m", "compileall", "-q", "--invalidation-mode", "checked-hash", "avc_casadi", "hardware"]
    subprocess.run([sys.executable, *hashed], cwd=root, check=True)  # noqa: S603 - ours
    return root


def passes(root: Path, tests: Iterable[str], longest_s: int | None = LONGEST_S) -> tuple[bool, str]:
    """Run tests in a copy, quick ones before slow ones, until one fails; return whether all pass, and what failed."""
    path = os.pathsep.join((str(root), str(root / "hardware")))
    environment = {**os.environ, "PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1"}
    for marked in ("not slow", "slow"):
        command = [
            sys.executable,
            "-m",
            "pytest",
            "-x",
            "-q",
            "-p",
            "no:cacheprovider",
            "--tb=no",
            "-m",
            marked,
            *tests,
        ]
        with subprocess.Popen(  # noqa: S603 - ours
            [*command, *tests],
            cwd=root,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        ) as running:
            try:
                if longest_s is not None:
                    resource.prlimit(running.pid, resource.RLIMIT_CPU, (longest_s, longest_s))
                said = running.communicate(timeout=HANGING_S)[0].decode(errors="replace")
            except subprocess.TimeoutExpired:
                os.killpg(running.pid, signal.SIGKILL)
                return False, f"no end within {HANGING_S} s"
            except BaseException:
                os.killpg(running.pid, signal.SIGKILL)
                raise
        if running.returncode < 0:
            return False, f"no end within {longest_s} s of processor time"
        if running.returncode not in (0, NO_TESTS):
            failed = [line for line in said.splitlines() if line.startswith(("FAILED", "ERROR"))]
            return False, failed[0].split(" - ")[0] if failed else said.strip()[-200:]
    return True, ""


def tried(root: Path, edit: Edit) -> dict[str, Any]:
    """Make one edit, run its tests, undo it."""
    broken, whole = edit.applied(root), (root / edit.path)
    record = {"file": edit.path, "why": edit.why, "old": edit.old, "explained": edit.survives}
    if broken is None:
        return {**record, "outcome": "stale"}
    before = whole.read_text(encoding="utf-8")
    try:
        whole.write_text(broken, encoding="utf-8")
        passed, _ = passes(root, edit.tests)
    finally:
        whole.write_text(before, encoding="utf-8")
    return {**record, "outcome": "survived" if passed else "killed"}


def faults(records: list[dict[str, Any]]) -> list[str]:
    """Say what is wrong with the list or the tests."""
    killed = sum(record["outcome"] == "killed" for record in records)
    found = [f"{killed} of {len(records)} are killed; the goal is {GOAL:.0%}"] if killed < GOAL * len(records) else []
    for record in records:
        place = f"{record['file']}: {record['why']} ({record['old']})"
        if record["outcome"] == "stale":
            found.append(f"stale: {place}")
        elif record["outcome"] == "survived" and not record["explained"]:
            found.append(f"survived: {place}")
        elif record["outcome"] == "killed" and record["explained"]:
            found.append(f"explained and yet killed: {place}")
    return found


def run(area: str) -> list[dict[str, Any]]:
    """Try every edit of a table."""
    listed, records = edits(area), []
    with tempfile.TemporaryDirectory(prefix="avc-mutation-") as folder:
        root = copied(Path(folder))
        passed, by = passes(root, sorted({test for edit in listed for test in edit.tests}), None)
        if not passed:
            sys.exit(f"the tests of {area} fail without any edit: {by}")
        for number, edit in enumerate(listed, start=1):
            records.append(tried(root, edit))
            print(f"{area} {number}/{len(listed)} {records[-1]['outcome']} {edit.path}: {edit.why}", flush=True)
    return records


def main() -> int:
    """Run what the command line asks for."""
    only = script_arguments(__doc__, only=areas()).only
    records = [record for area in ((only,) if only else areas()) for record in run(area)]
    print(", ".join(f"{count} {outcome}" for outcome, count in Counter(one["outcome"] for one in records).items()))
    found = faults(records)
    for fault in found:
        print(fault, file=sys.stderr)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
