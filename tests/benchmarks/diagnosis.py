"""Diagnosis of logs that buzz for one known reason: share named right, share of "cannot tell", confident wrong answers.

nice -n 10 python tests/benchmarks/diagnosis.py --count 200 --write

Each log is of a loop drawn at random (mass 0.03 to 0.3 kg, wall 300 to 8000 N/m, encoder 1 to 30 um, delay 0 to 2
samples, one- or two-sided, three in ten with friction, a hand of the usual box) that rests in simulation; then one
thing of it is changed, as much as makes it swing: 1 to 6 samples of delay, 1.5 to 6 times the damping, 1.5 to 8 times
the stiffness, an encoder of 20 um and more, a resonance of 60 to 250 Hz that the device's file does not know, the
hand taken away and a weight left, 20 to 70 % of the ticks missed, a half or a third of the rate. The logs are made by
`tests/buzzing_device.c`, which shares no code with the project, and of delay, damping, stiffness, encoder and
resonance half of them by the project's own scenes. `avc diagnose` gets the log and the device's file. After each eight
stands a log with nothing wrong: it stands still at the end, or toggles by one step of the encoder that neither its own
hand nor a corner of the usual box would feel. With --write it overwrites results/diagnosis.json and
RESULTS_diagnosis.md after every log and goes on where it stopped; without it the results are printed only.
"""

from __future__ import annotations

import argparse
import resource
import sys
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from studied import about, kept_rows, made_by, write_rows

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent), str(HERE.parent.parent / "hardware")]

from buzzing_cases import CAUSES, case_of, healthy_case  # noqa: E402 - found beside the tests

from avc_casadi.identification.diagnosis.causes import CAUSES as WORDS  # noqa: E402
from avc_casadi.identification.diagnosis.diagnose import diagnose  # noqa: E402

OUT = HERE / "results" / "diagnosis.json"
PAGE = HERE / "RESULTS_diagnosis.md"
SEED = 15
HEALTHY, UNDECIDED = "nothing wrong", "cannot tell"


def one(number: int, seed: int, *, healthy: bool = False) -> dict[str, Any]:
    """Draw a log and diagnose it."""
    index, which = divmod(number, len(CAUSES))
    case = healthy_case(seed, index) if healthy else case_of(CAUSES[which], seed, index)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_utime
    found = diagnose(case.columns, device=case.declared)
    return {
        "number": number,
        "truth": case.cause,
        "source": case.source,
        "answer": found.cause or found.verdict,
        "candidates": list(found.candidates),
        "shares": dict(found.shares),
        "kind": found.oscillation.kind,
        "frequency_hz": found.oscillation.frequency_hz if found.oscillation.sustained else None,
        "cures": len(found.cures),
        "cpu_s": resource.getrusage(resource.RUSAGE_SELF).ru_utime - before,
    }


def page(rows: list[dict[str, Any]], made: Mapping[str, Any]) -> str:
    """Return the results as text."""
    logs = [row for row in rows if row["truth"] != HEALTHY]
    quiet = [row for row in rows if row["truth"] == HEALTHY]
    right = [row for row in logs if row["answer"] == row["truth"]]
    undecided = [row for row in logs if row["answer"] == UNDECIDED]
    among = [row for row in undecided if row["truth"] in row["candidates"]]
    unseen = [row for row in logs if row["answer"] in {HEALTHY, "not the loop"}]
    wrong = [row for row in logs if row["answer"] in WORDS and row["answer"] != row["truth"]]
    answers = [*CAUSES, UNDECIDED, HEALTHY]
    share = 100 / max(len(logs), 1)
    summary = (
        f"{len(logs)} logs: **{len(right)} named right ({share * len(right):.1f} %), {len(undecided)} "
        f'"cannot tell" ({share * len(undecided):.1f} %; the truth among its candidates in {len(among)}), '
        f"{len(unseen)} taken for healthy ({share * len(unseen):.1f} %), {len(wrong)} confident and wrong "
        f"({share * len(wrong):.1f} %)**. Of {len(quiet)} logs with nothing wrong "
        f"{sum(row['answer'] == HEALTHY for row in quiet)} were called so."
    )
    lines = [
        "# Diagnosis of logs that buzz for one known reason",
        "",
        made_by(made),
        "",
        " ".join((__doc__ or "").split("\n\n")[2].partition(" With --write")[0].split()),
        "",
        summary,
        "",
        "Rows: what was changed; columns: what was said.",
        "",
        f"| | {' | '.join(answers)} |",
        f"|---|{'--:|' * len(answers)}",
    ]
    for truth in (*CAUSES, HEALTHY):
        counts = Counter(row["answer"] for row in rows if row["truth"] == truth)
        lines.append(f"| {truth} | {' | '.join(str(counts.get(answer, 0) or '') for answer in answers)} |")
    lines += ["", "| made by | logs | right | cannot tell | wrong |", "|---|--:|--:|--:|--:|"]
    for source in ("simulator", "scene"):
        of = [row for row in logs if row["source"] == source]
        counted = [sum(row in some for row in of) for some in (right, undecided, wrong)]
        lines.append(f"| {source} | {len(of)} | {' | '.join(map(str, counted))} |")
    time = [row["cpu_s"] for row in rows]
    cured = sum(row["cures"] > 0 for row in right)
    closing = (
        f"A change that cures the loop, checked, stands beside {cured} of the {len(right)} causes named right. "
        f"Processor time a log: median {np.median(time):.1f} s, 95 % below {np.quantile(time, 0.95):.1f} s."
    )
    lines += ["", closing, ""]
    return "\n".join(lines)


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=16, help="logs with a cause")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--write", action="store_true", help="overwrite results/diagnosis.json and the page")
    args = parser.parse_args()
    made = about(f"python tests/benchmarks/diagnosis.py --count {args.count} --write", args.seed)
    rows = kept_rows(OUT, made) if args.write else []
    done = {(row["number"], row["truth"] == HEALTHY) for row in rows}
    for number in range(args.count):
        last = number % len(CAUSES) == len(CAUSES) - 1
        for healthy in (False, True) if last else (False,):
            if (number, healthy) in done:
                continue
            row = one(number, args.seed, healthy=healthy)
            rows.append(row)
            print(f"{number}: {row['truth']} -> {row['answer']} ({row['source']}, {row['cpu_s']:.1f} s)", flush=True)
            if args.write:
                write_rows(OUT, made, rows)
                PAGE.write_text(page(rows, made), encoding="utf-8")
    print(page(rows, made))


if __name__ == "__main__":
    main()
