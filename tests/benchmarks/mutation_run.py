"""Break the code in small ways, one at a time, and see whether the tests that should notice do.

The edits stand in mutations/*.toml: file, old text, new text, tests to run and why it matters. They are made in a copy
of the tree below a temporary folder. An edit is killed when a listed test fails or takes far too long; it survived when
all pass; it is stale when its old text does not stand exactly once in its file. An edit that no test can notice says
why in its table. The run ends with 1 where an edit is stale, survived unexplained or is explained and killed, or where
fewer than 90 % are killed.

A whole run takes about a quarter of an hour in one process and overwrites results/mutation.json and
RESULTS_mutation.md beside this file; --only runs one table and writes nothing.
"""

from __future__ import annotations

import json
import os
import platform
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from mutation_list import ROOT, Edit, areas, edits
from script_arguments import script_arguments

HERE = Path(__file__).parent
RESULTS, TABLE = HERE / "results" / "mutation.json", HERE / "RESULTS_mutation.md"
COPIED = ("avc_casadi", "hardware", "problems", "tests", "pyproject.toml")
# Processor time, so that others on the machine do not make an edit look killed; wall time for what hangs.
LONGEST_S, HANGING_S = 120, 1800
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
    """Run tests in a copy until the first fails; return whether all pass, and what failed."""
    path = os.pathsep.join((str(root), str(root / "hardware")))
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "--tb=no", *tests]
    environment = {**os.environ, "PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1"}
    with subprocess.Popen(  # noqa: S603 - ours
        command, cwd=root, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True
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
    failed = [line for line in said.splitlines() if line.startswith(("FAILED", "ERROR"))]
    return running.returncode == 0, failed[0].split(" - ")[0] if failed else said.strip()[-200:]


def tried(root: Path, edit: Edit) -> dict[str, Any]:
    """Make one edit, run its tests, undo it."""
    broken, whole = edit.applied(root), (root / edit.path)
    record = {"area": edit.area, "file": edit.path, "why": edit.why, "old": edit.old, "new": edit.new}
    if broken is None:
        return {**record, "outcome": "stale", "by": "", "seconds": 0.0, "explained": edit.survives}
    before, started = whole.read_text(encoding="utf-8"), time.perf_counter()
    try:
        whole.write_text(broken, encoding="utf-8")
        passed, by = passes(root, edit.tests)
    finally:
        whole.write_text(before, encoding="utf-8")
    seconds = round(time.perf_counter() - started, 2)
    outcome = {"outcome": "survived" if passed else "killed", "by": "" if passed else by}
    return {**record, **outcome, "seconds": seconds, "explained": edit.survives}


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


def table(records: list[dict[str, Any]]) -> str:
    """Counts by area, then what survived and why, as Markdown."""
    lines = ["| area | edits | killed | survived | stale | seconds |", "|---|---|---|---|---|---|"]
    for area in (*dict.fromkeys(record["area"] for record in records), "all"):
        some = [record for record in records if area in {record["area"], "all"}]
        count = Counter(record["outcome"] for record in some)
        seconds = sum(record["seconds"] for record in some)
        counts = f"{count['killed']} | {count['survived']} | {count['stale']}"
        lines.append(f"| {area} | {len(some)} | {counts} | {seconds:.0f} |")
    rest = [record for record in records if record["outcome"] != "killed"]
    if rest:
        lines += ["", "| file | edit | outcome | explanation |", "|---|---|---|---|"]
        for record in rest:
            change = f"`{record['old']}` -> `{record['new']}`".replace("|", "\\|")
            lines.append(f"| {record['file']} | {change} | {record['outcome']} | {record['explained'] or '**none**'} |")
    return "\n".join(lines)


def about(seconds: float) -> dict[str, Any]:
    """Say of which commit and on what the run was made."""
    git = shutil.which("git")
    asked = [git, "describe", "--always", "--dirty", "--exclude=*"] if git else []
    commit = subprocess.run(asked, cwd=ROOT, capture_output=True, text=True, check=False) if asked else None  # noqa: S603
    packages = ("casadi", "numpy", "scipy", "pytest", "hypothesis")
    return {
        "command": "python tests/benchmarks/mutation_run.py",
        "commit": commit.stdout.strip() if commit else "",
        "date": f"{datetime.now(tz=UTC):%Y-%m-%d}",
        "machine": f"{platform.machine()}, {os.cpu_count()} shared cores",
        "versions": {"python": platform.python_version()} | {name: version(name) for name in packages},
        "seconds": round(seconds),
    }


def main() -> int:
    """Run what the command line asks for."""
    only = script_arguments(__doc__, only=areas()).only
    listed, started = edits(only), time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="avc-mutation-") as folder:
        root = copied(Path(folder))
        passed, by = passes(root, sorted({test for edit in listed for test in edit.tests}), None)
        if not passed:
            print(f"the tests fail without any edit: {by}", file=sys.stderr)
            return 1
        records = []
        for number, edit in enumerate(listed, start=1):
            records.append(tried(root, edit))
            last = records[-1]
            print(
                f"{number}/{len(listed)} {last['outcome']} {last['seconds']:.1f} s {edit.path}: {edit.why}", flush=True
            )
    facts, found = about(time.perf_counter() - started), faults(records)
    print("\n" + table(records))
    if only is None:
        RESULTS.write_text(json.dumps({"about": facts, "edits": records}, indent=1) + "\n", encoding="utf-8")
        versions = ", ".join(f"{name} {number}" for name, number in facts["versions"].items())
        head = [
            "# Small breakages that the tests must notice",
            f"{facts['date']}, commit {facts['commit']}; {facts['machine']}; {versions}; {facts['seconds']} s.",
            f"    {facts['command']}",
            "Each edit of mutations/*.toml alone, against the tests listed beside it.",
        ]
        TABLE.write_text("\n\n".join([*head, table(records)]) + "\n", encoding="utf-8")
    for fault in found:
        print(fault, file=sys.stderr)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
