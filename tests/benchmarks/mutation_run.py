"""Break the code in small ways, one at a time, and see whether the tests that should notice do.

The edits stand in mutations/*.toml: file, old text, new text, tests to run (with `thorough = true` those too that are
marked so) and why it matters. They are made in a copy of the tree below a temporary folder. An edit is killed when a
listed test fails or takes far too long; it survived when all pass; it is stale when its old text does not stand exactly
once in its file. An edit that no test can notice says why in its table. The run ends with 1 where an edit is stale,
survived unexplained or is explained and killed, or where fewer than 90 % are killed.

All tables together took 2 h 20 min on two cores that ten other processes used as well. It overwrites
results/mutation.json and RESULTS_mutation.md beside this file; --only runs one table and overwrites its part of both.
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
PREAMBLE = """Each edit of mutations/*.toml alone, against the tests listed beside it; seconds with the tests run once
without any edit, on a machine that others use too."""


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


def passes(root: Path, tests: Iterable[str], longest_s: int | None = LONGEST_S, *, thorough: bool) -> tuple[bool, str]:
    """Run tests in a copy until the first fails; return whether all pass, and what failed."""
    path = os.pathsep.join((str(root), str(root / "hardware")))
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "--tb=no", *tests]
    command += ["-m", "not exhaustive"] if thorough else []
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
        passed, by = passes(root, edit.tests, thorough=edit.thorough)
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


def table(known: dict[str, Any]) -> str:
    """Counts by area, then what survived and why, as Markdown."""
    lines = ["| area | edits | killed | survived | stale | s | commit | on |", "|---|---|---|---|---|---|---|---|"]
    every: list[dict[str, Any]] = []
    for area, part in known.items():
        facts = part["about"]
        lines.append(_row(area, part["edits"], facts["seconds"], facts["commit"], _machine(facts)))
        every += part["edits"]
    lines.append(_row("all", every, sum(part["about"]["seconds"] for part in known.values()), "", ""))
    rest = [record for record in every if record["outcome"] != "killed"]
    if rest:
        lines += ["", "| file | edit | outcome | why |", "|---|---|---|---|"]
        for record in rest:
            change = f"`{record['old']}` -> `{record['new']}`".replace("|", "\\|")
            lines.append(f"| {record['file']} | {change} | {record['outcome']} | {record['explained'] or '**none**'} |")
    return "\n".join(lines)


def _row(area: str, records: list[dict[str, Any]], seconds: int, *rest: str) -> str:
    count = Counter(record["outcome"] for record in records)
    numbers = (len(records), count["killed"], count["survived"], count["stale"], seconds)
    return f"| {area} | {' | '.join(map(str, numbers))} | {' | '.join(rest)} |"


def _machine(facts: dict[str, Any]) -> str:
    versions = ", ".join(f"{name} {number}" for name, number in facts["versions"].items())
    return f"{facts['date']}; {facts['machine']}; {versions}"


def about(seconds: float) -> dict[str, Any]:
    """Say of which commit and on what a table was run."""
    packages = ("casadi", "numpy", "scipy", "pytest", "hypothesis")
    return {
        "commit": _commit(),
        "date": f"{datetime.now(tz=UTC):%Y-%m-%d}",
        "machine": f"{platform.machine()}, {os.cpu_count()} shared cores",
        "versions": {"python": platform.python_version()} | {name: version(name) for name in packages},
        "seconds": round(seconds),
    }


def _commit() -> str:
    git = shutil.which("git")
    if git is None:
        return ""

    def said(*words: str) -> str:
        return subprocess.run([git, *words], cwd=ROOT, capture_output=True, text=True, check=False).stdout.strip()  # noqa: S603

    # The results themselves change while the run goes on.
    changed = said("status", "--porcelain", "--untracked-files=no", "--", *COPIED, ":!tests/benchmarks/*mutation.*")
    return said("rev-parse", "--short", "HEAD") + ("-dirty" if changed else "")


def run(area: str) -> list[dict[str, Any]]:
    """Try every edit of a table and put what became of them into the results."""
    listed, facts, started = edits(area), about(0), time.perf_counter()
    records = []
    with tempfile.TemporaryDirectory(prefix="avc-mutation-") as folder:
        root = copied(Path(folder))
        for thorough in sorted({edit.thorough for edit in listed}):
            every = sorted({test for edit in listed if edit.thorough == thorough for test in edit.tests})
            passed, by = passes(root, every, None, thorough=thorough)
            if not passed:
                sys.exit(f"the tests of {area} fail without any edit: {by}")
        for number, edit in enumerate(listed, start=1):
            records.append(tried(root, edit))
            last = records[-1]
            place = f"{area} {number}/{len(listed)}"
            print(f"{place} {last['outcome']} {last['seconds']:.1f} s {edit.path}: {edit.why}", flush=True)
    facts["seconds"] = round(time.perf_counter() - started)
    known = json.loads(RESULTS.read_text(encoding="utf-8"))["areas"] if RESULTS.exists() else {}
    known = {name: known[name] for name in areas() if name in known} | {area: {"about": facts, "edits": records}}
    document = {"command": "python tests/benchmarks/mutation_run.py", "areas": dict(sorted(known.items()))}
    RESULTS.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    head = ["# Small breakages that the tests must notice", f"    {document['command']}", PREAMBLE]
    TABLE.write_text("\n\n".join([*head, table(document["areas"])]) + "\n", encoding="utf-8")
    return records


def main() -> int:
    """Run what the command line asks for."""
    only = script_arguments(__doc__, only=areas()).only
    found = faults([record for area in ((only,) if only else areas()) for record in run(area)])
    print(TABLE.read_text(encoding="utf-8"))
    for fault in found:
        print(fault, file=sys.stderr)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
