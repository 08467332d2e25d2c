"""The observer laws of the program: beside release 0.3.0 on drawn devices, and beside many random starts.

`python tests/benchmarks/laws.py --release FOLDER` writes RESULTS_laws.md; FOLDER is a checkout of 26f62a77, 0.3.0,
which needs `pip install clarabel`. Both programs answer for the same devices and walls (`drawn_devices.drawn`), with
the same goals and guesses, each in processes of its own. Random starts draw the model and the feedback anew, 100 times
for a device.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before anything loads NumPy: the matrices are small

import numpy as np
from drawn_devices import drawn
from studied import about, computed, made_by, percent, table

from avc_casadi.design.program import program_answers

HERE = Path(__file__).parent
OUT, PAGE = HERE / "results" / "laws.json", HERE / "RESULTS_laws.md"
SEED, RANDOM_STARTS = 777, 100
SPREAD = 1.0
"""Standard deviation of the natural logarithm of a random guess about one of the three."""
ALIKE = 0.01


def answer(index: int) -> dict[str, Any]:
    """Return error and processor time of the program's best answer."""
    problem = drawn(index, SEED)
    begun = time.process_time()
    answers = program_answers(problem)
    seconds = time.process_time() - begun
    best = next((one for one in answers if one.meets_goals), None)
    return {
        "seconds": seconds,
        "error": None if best is None else best.performance.error,
        "disk_margin": None if best is None else best.performance.disk_margin,
    }


def of_tree(folder: str, index: int) -> dict[str, Any]:
    """Return the answer of the package in a folder."""
    paths = [folder, f"{folder}/hardware", str(HERE), str(HERE.parent), str(HERE.parent / "oracle")]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(paths)}
    command = [sys.executable, str(HERE / "laws.py"), f"--answer={index}"]
    run = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)  # noqa: S603 - ours
    if run.returncode:
        sys.exit(f"the package of {folder} does not answer: {run.stderr}")
    return dict(json.loads(run.stdout))


def random_starts(index: int) -> dict[str, Any]:
    """Return the errors of laws whose model and feedback are drawn about the three guesses."""
    from avc_casadi.design.law_family import LawFamily  # noqa: PLC0415 - release 0.3.0 has none
    from avc_casadi.design.observer_law import GUESSES, Guess, Structure  # noqa: PLC0415
    from avc_casadi.design.program import Program, usual_goals  # noqa: PLC0415

    problem, random = drawn(index, SEED), np.random.default_rng([SEED, index])
    goals = usual_goals(problem, problem.environment.stiffness_n_per_m)
    errors = []
    for number in range(RANDOM_STARTS):
        base = GUESSES[number % len(GUESSES)]
        factors = np.exp(SPREAD * random.standard_normal(len(fields(Guess))))
        guess = Guess(*(getattr(base, part.name) * factor for part, factor in zip(fields(Guess), factors, strict=True)))
        try:
            program = Program(LawFamily(problem, Structure.of(problem, guess, 4)), goals)
        except np.linalg.LinAlgError:
            continue
        best = program.best()
        if best is not None and program.meets_goals(best):
            errors.append(best.performance.error)
    return {"errors": sorted(errors), "own": answer(index)["error"]}


_PAGE = """\
# The observer laws of the program

{made}

Largest error of the impedance at the handle from 1 to 30 Hz of the best law that meets all goals, from the three
guesses, and processor time of the whole search. Release 0.3.0 solved convex steps.

{summary}

{rows}

Random starts: {starts} guesses of model and feedback for a device, drawn about the three (standard deviation of the
logarithm {spread:g}), each with the best of its starting laws. *Best*: the least error of all these.

{random}
"""


def page(document: dict[str, Any]) -> None:
    """Write the page of the results."""
    pairs = [cell for name, cell in document["cells"].items() if name.startswith("device") and "now" in cell]
    rows = [_row(name, cell) for name, cell in document["cells"].items() if name.startswith("device") and "now" in cell]
    starts = [[name, *_of_starts(cell)] for name, cell in document["cells"].items() if "own" in cell]
    known = [cell for cell in pairs if cell["now"]["error"] is not None and cell["release"]["error"] is not None]
    ratios = np.array([cell["now"]["error"] / cell["release"]["error"] for cell in known] or [np.nan])
    seconds = np.array([cell["now"]["seconds"] / cell["release"]["seconds"] for cell in pairs] or [np.nan])
    only_now = sum(cell["release"]["error"] is None and cell["now"]["error"] is not None for cell in pairs)
    only_before = sum(cell["now"]["error"] is None and cell["release"]["error"] is not None for cell in pairs)
    summary = (
        f"Of {len(pairs)} devices {len(known)} have a law of both, {only_now} of this program alone and {only_before} "
        f"of 0.3.0 alone. The error is nearer or within 1 % on {(ratios < 1 + ALIKE).sum()}; over that of 0.3.0 it is "
        f"{np.median(ratios):.3f} in the median, {ratios.min():.2f} at least and {ratios.max():.2f} at most, and "
        f"{np.exp(np.log(ratios).mean()):.3f} in the geometric mean. Processor time is {np.median(seconds):.2f} times "
        f"that of 0.3.0 in the median, {np.median([cell['now']['seconds'] for cell in pairs]):.2g} s."
    )
    text = _PAGE.format(
        made=made_by(document["about"]),
        summary=summary,
        rows=table(("device", "0.3.0: error, %", "s", "error, %", "s", "disk margin"), rows),
        starts=RANDOM_STARTS,
        spread=SPREAD,
        random=table(("device", "laws that meet all goals", "best, %", "median, %", "the program's, %"), starts),
    )
    PAGE.write_text(text, encoding="utf-8")


def _row(name: str, cell: dict[str, Any]) -> list[str]:
    before, now = cell["release"], cell["now"]
    errors = ["none" if one["error"] is None else percent(one["error"]) for one in (before, now)]
    margin = "-" if now["disk_margin"] is None else f"{now['disk_margin']:.3f}"
    return [name, errors[0], f"{before['seconds']:.1f}", errors[1], f"{now['seconds']:.1f}", margin]


def _of_starts(cell: dict[str, Any]) -> list[str]:
    errors, own = cell["errors"], cell["own"]
    found = [percent(min(errors)), percent(float(np.median(errors)))] if errors else ["-", "-"]
    return [str(len(errors)), *found, "none" if own is None else percent(own)]


def main() -> None:
    """Compute what is missing, and write results and page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--release", metavar="FOLDER", help="a checkout of 0.3.0")
    parser.add_argument("--count", type=int, default=50, help="devices drawn, default 50")
    parser.add_argument("--answer", type=int, metavar="INDEX", help="print one answer of the package that is imported")
    given = parser.parse_args()
    if given.answer is not None:
        sys.stdout.write(json.dumps(answer(given.answer)))
        return
    cells: dict[str, Any] = {}
    for index in range(given.count):
        cells[f"device {index}"] = partial(_both, given.release, index)
        if index % 5 == 0 and index < 50:
            cells[f"starts {index}"] = partial(random_starts, index)
    computed(cells, OUT, about("python tests/benchmarks/laws.py --release FOLDER", SEED), page)


def _both(release: str, index: int) -> dict[str, Any]:
    return {"now": of_tree(str(HERE.parents[1]), index), "release": of_tree(release, index)}


if __name__ == "__main__":
    main()
