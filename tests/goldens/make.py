"""What a release answered, to guard a redesign: `python tests/goldens/make.py [--only PART] [--check]`.

Without --check every part is computed and written beside this file, a line a case; with --check it is compared with
what is written, differences are printed, and the exit code is 1 if one counts. Only what users have is used: names of
`avc_casadi.__all__`, `python -m avc_casadi VERB ... --json`, files that verbs write, and the exported C.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before anything loads NumPy: two processes work already

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
sys.path.insert(0, str(ROOT))
sys.path.insert(0, str(ROOT / "hardware"))
sys.path[:0] = [str(HERE.parent), str(HERE.parent / "oracle")]

from goldens.compared import Difference, differences
from goldens.errors import ERRORS, error
from goldens.exported_c import COUPLINGS, exported_c
from goldens.gains import gain_cases, gains
from goldens.recommendations import RECOMMENDATIONS, recommendation

PROCESSES = 2


class Part(NamedTuple):
    """One golden file: names of its cases, in its order, and what today's code answers in one."""

    cases: tuple[str, ...]
    compute: Callable[[str], Mapping[str, Any]]


PARTS = {
    "gains": Part(gain_cases(), gains),
    "recommendations": Part(tuple(RECOMMENDATIONS), recommendation),
    "exported_c": Part(tuple(COUPLINGS), exported_c),
    "errors": Part(tuple(ERRORS), error),
}


def rounded(value: Any) -> Any:
    """Return a value as it stands in a golden file: numbers to 9 significant digits, None for what is no number."""
    if isinstance(value, Mapping):
        return {str(key): rounded(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [rounded(one) for one in value]
    if isinstance(value, float):
        short = float(f"{value:.9g}") if math.isfinite(value) else None
        return int(short) if short is not None and short.is_integer() and abs(short) < 1e9 else short
    return value


def answered(part: str, case: str) -> Any:
    """Return what today's code answers in a case, as it would stand in the file."""
    return rounded(PARTS[part].compute(case))


def committed(part: str) -> dict[str, Any]:
    """Return the golden cases of a part."""
    found: dict[str, Any] = json.loads((HERE / f"{part}.json").read_text(encoding="ascii"))
    return found


def changes(part: str, case: str) -> list[Difference]:
    """Return where today's answer in a case is not the golden one."""
    return differences(part, case, committed(part)[case], answered(part, case))


def written(part: str, found: Mapping[str, Any]) -> None:
    """Write a golden file, one line a case so that a change of one is one line of a commit."""
    lines = (
        f"{json.dumps(case)}: {json.dumps(found[case], separators=(',', ':'))}"
        for case in PARTS[part].cases
        if case in found
    )
    (HERE / f"{part}.json").write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="ascii")


def _in_order(part: str, cases: Sequence[str]) -> Iterator[tuple[str, Any]]:
    with ProcessPoolExecutor(PROCESSES) as workers:
        yield from zip(cases, workers.map(answered, [part] * len(cases), cases), strict=True)


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 44 else f"{text[:20]} .. {text[-20:]}"


def main() -> int:
    """Write the goldens, or compare with them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", metavar="PART", choices=PARTS, help=", ".join(PARTS))
    parser.add_argument("--check", action="store_true", help="compare with what is committed; 1 if anything differs")
    asked = parser.parse_args()
    failed = 0
    for part in [asked.only] if asked.only else PARTS:
        begun = time.perf_counter()
        cases, found = PARTS[part].cases, dict[str, Any]()
        for case, one in _in_order(part, cases):
            found[case] = one
            if not asked.check:
                written(part, found)
        took = f"{len(cases)} cases in {time.perf_counter() - begun:.0f} s"
        if not asked.check:
            print(f"{part}: {took}")
            continue
        golden = committed(part)
        lost = [Difference(case, "(a case)", "(absent)") for case in golden if case not in found]
        new = [Difference(case, "(absent)", "(a case)") for case in found if case not in golden]
        both = [one for case in found if case in golden for one in differences(part, case, golden[case], found[case])]
        table = [*lost, *new, *both]
        counting = sum(one.counts for one in table)
        failed += counting
        print(f"{part}: {took}, {counting} differences, {len(table) - counting} more that do not count")
        for one in table:
            mark = "!" if one.counts else " "
            print(f" {mark} {one.place:60} {_short(one.golden):>44} -> {_short(one.found)}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
