"""Make the results anew that fit into an hour on two cores, and say which are older than the code that they measure.

python tests/benchmarks/remake_results.py --list        # only say which are older, and how long each takes
python tests/benchmarks/remake_results.py               # remake what is older and fits, then write the blocks
python tests/benchmarks/remake_results.py --only NAME   # one of them

Older is a result whose commit is followed by others that touch a file which its script imports (by git); findings of
results/recorded.json are listed too and made by hand. Two studies run at a time. Overwrites results/*.json and the
pages of the studies that it runs, and with write_documents.py the blocks of README and guide. A study that fails
leaves its results as they were.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from measured_code import ROOT, Age, age, start_of
from studied import rounded

HERE = Path(__file__).parent
RESULTS = HERE / "results"
MINUTES = 60.0
CORES = 2


@dataclass(frozen=True)
class Study:
    """One study that can be repeated.

    Attributes:
        script: its script with arguments.
        cpu_minutes: processor time that it took; None where it was not measured: such a study is only listed.
        results: names of its results files.
    """

    script: str
    cpu_minutes: float | None
    results: tuple[str, ...]

    @property
    def command(self) -> list[str]:
        name, *arguments = self.script.split()
        return [sys.executable, str(HERE / name), *arguments]


STUDIES = (
    Study("published.py", 0.3, ("published",)),
    Study("hardware_figures.py", None, ("hardware",)),
    Study("table1_study.py 200", 1.5, ("table1",)),
    Study("program.py", 3, ("program",)),
    Study("exported_rest.py", 1.6, ("exported_rest",)),
    Study("sensor_faults.py", 1.2, ("sensor_faults",)),
    Study("passivity_baselines.py", 10, ("passivity_baselines",)),
    Study("proof_contradictions.py", 2.3, ("proof_contradictions",)),
    Study("recommended.py", 12, ("recommended",)),
    Study("tampered_proofs.py", 5.4, ("tampered_proofs",)),
    Study("catalogue_walls.py", 62, ("catalogue_walls",)),
    Study("proofs_of_rest.py", 18, ("proofs_of_rest_walls", "proofs_of_rest_designs", "proofs_of_rest_references")),
    Study("random_devices.py --count 200", 37, ("random_devices",)),
    Study("engine_boundaries.py", 9, ("engine_boundaries",)),
    Study("before_after.py --before CHECKOUT --count 200", None, ("before_after",)),
    Study("identification.py", None, ("identification",)),
    Study("real_drive.py emps_pulses.csv --write", None, ("real_drive",)),
    Study("round_trip.py", None, ("round_trip",)),
    Study("reach.py 10000", None, ("reach",)),
    Study("mutation_run.py", None, ("mutation",)),
)


def made(name: str) -> str:
    """The commit that a results file was made as of; empty where it does not say."""
    found = json.loads((RESULTS / f"{name}.json").read_text(encoding="utf-8"))
    about = found.get("about", found) if isinstance(found, dict) else {}
    # A list of edits is made area by area; the first is no newer than the others.
    about = next(iter(about.get("areas", {}).values()), {"about": about})["about"]
    return str(about.get("commit", "")).removesuffix("-dirty")


def ages() -> dict[str, Age]:
    """How old each results file and each recorded finding is."""
    found = {}
    for study in STUDIES:
        for name in study.results:
            commit = made(name)
            found[name] = age(commit, HERE / study.script.split()[0]) if commit else Age("", None, "")
    recorded = json.loads((RESULTS / "recorded.json").read_text(encoding="utf-8"))["findings"]
    for name, finding in recorded.items():
        about = finding["about"]
        found[f"recorded: {name}"] = age(about["commit"], start_of(about["command"]))
    return found


def told(found: dict[str, Age]) -> Iterator[str]:
    """A line for each result, the oldest first."""
    unknown = [name for name, one in found.items() if one.changes is None]
    for name, one in sorted(found.items(), key=lambda item: -(item[1].changes or 0)):
        if one.changes:
            yield f"{name}: as of {one.commit}, {one.changes} commits since touch what it runs, the last {one.newest}"
    if unknown:
        yield f"of unknown age (no commit is told): {', '.join(unknown)}"
    current = [name for name, one in found.items() if one.changes == 0]
    yield f"as new as the code: {', '.join(current) or 'none'}"


def chosen(found: dict[str, Age], only: str | None) -> tuple[list[Study], list[Study]]:
    """What is remade, the quickest first, and what is older and does not fit."""
    stale = [study for study in STUDIES if any(found[name].changes != 0 for name in study.results)]
    if only:
        return [study for study in STUDIES if only in study.results], []
    left, take, leave = MINUTES * CORES * 0.9, [], []
    for study in sorted(stale, key=lambda study: study.cpu_minutes or float("inf")):
        fits = study.cpu_minutes is not None and study.cpu_minutes <= left
        (take if fits else leave).append(study)
        left -= study.cpu_minutes if fits and study.cpu_minutes else 0
    return take, leave


def remade(study: Study) -> bool:
    """Run a study from nothing; what it had is put back if it fails."""
    with tempfile.TemporaryDirectory() as folder:
        kept = [(RESULTS / f"{name}.json", Path(folder) / name) for name in study.results]
        for path, aside in kept:
            if path.exists():
                shutil.move(path, aside)
        places = (ROOT, ROOT / "hardware", ROOT / "tests", HERE)
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, places)), "OPENBLAS_NUM_THREADS": "1"}
        ran = subprocess.run(study.command, cwd=ROOT, env=environment, check=False)  # noqa: S603
        done = ran.returncode == 0 and all(path.exists() for path, _ in kept)
        for path, aside in kept:
            if not done and aside.exists():
                shutil.move(aside, path)
    print(f"{'made' if done else 'FAILED, left as it was'}: {study.script}", flush=True)
    return done


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--list", action="store_true", help="only say which results are older")
    parser.add_argument("--only", metavar="NAME", choices=sorted(name for study in STUDIES for name in study.results))
    args = parser.parse_args()
    found = ages()
    print("\n".join(told(found)))
    take, leave = chosen(found, args.only)
    for study in leave:
        minutes = "not timed" if study.cpu_minutes is None else f"{rounded(study.cpu_minutes)} min of processor time"
        print(f"left out, does not fit: {study.script} ({minutes})")
    print(f"to be remade: {', '.join(study.script for study in take) or 'nothing'}", flush=True)
    if args.list:
        return
    with ThreadPoolExecutor(CORES) as both:
        done = list(both.map(remade, take))
    subprocess.run(  # noqa: S603
        [sys.executable, str(HERE / "write_documents.py")], cwd=ROOT, check=True
    )
    print("\n".join(told(ages())))
    sys.exit(0 if all(done) else 1)


if __name__ == "__main__":
    main()
