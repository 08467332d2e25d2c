"""How far answers of two BLAS kernels are apart: excitation plans, and recommendations of the golden cases.

nice python tests/benchmarks/kernels_apart.py

Each verb runs in a process of its own, once with OPENBLAS_CORETYPE set to an old kernel and once to a new one
(`tests/kernels.py`). A line a case says the largest relative difference of its numbers. Of a recommendation these are
the gains, the law, and the impedance errors. It takes some ten minutes of processor time, writes nothing but the lines,
and RESULTS_kernels.md holds those of one run.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent), str(HERE.parent / "oracle"), str(HERE.parent.parent / "hardware")]

import kernels  # noqa: E402 - found beside the tests
from goldens.recommendations import RECOMMENDATIONS  # noqa: E402

EXCITED = ("novint-falcon", "smartknob", "reference-r2")
LEAST = 1e-9
"""Share of the largest number of a part below which another is a residue of rounding."""


def answer(kernel: str, folder: Path, *arguments: str) -> dict[str, Any]:
    """Return the document of a verb on one kernel."""
    command = [sys.executable, "-m", "avc_casadi", *arguments, "--json"]
    done = subprocess.run(  # noqa: S603 - ours
        command, cwd=folder, env=kernels.environment(kernel), capture_output=True, check=False
    )
    document: dict[str, Any] = json.loads(done.stdout)
    return document


def recommended(document: dict[str, Any]) -> dict[str, Any]:
    """Return what a hand meets: gains, law and impedance errors; the faults where nothing is recommended."""
    if "errors" in document:
        return {"errors": document["errors"]}
    coupling = document["coupling"]
    law = coupling["runtime"].get("state_feedback")
    return {"gains": coupling["table"], "law": law, "impedance error": document["felt"]["complex_error"]}


def numbers(value: Any) -> Iterator[float]:
    """Yield the numbers of a document in their order."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list):
        for part in value:
            yield from numbers(part)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield float(value)


def apart(old: Any, new: Any) -> float | None:
    """Return the largest relative difference of the numbers of a part; None where they are not as many."""
    some, others = list(numbers(old)), list(numbers(new))
    if len(some) != len(others) or (old is None) != (new is None):
        return None
    least = LEAST * max((abs(number) for number in some), default=0.0)
    return max(
        (abs(x - y) / max(abs(x), abs(y), least) for x, y in zip(some, others, strict=True) if x != y), default=0.0
    )


def printed(case: str, old: dict[str, Any], new: dict[str, Any]) -> None:
    """Print a line of the table."""
    parts = {key: apart(value, new.get(key)) for key, value in old.items() if value is not None}
    told = ", ".join(f"{key} {'another kind' if size is None else f'{size:.1e}'}" for key, size in parts.items())
    print(f"| {case} | {told} |", flush=True)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="*", default=list(RECOMMENDATIONS), help="golden cases; default all")
    asked = parser.parse_args(arguments)
    if reason := kernels.why_none():
        sys.exit(f"skipped: {reason}")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for device in EXCITED:
            old, new = (answer(kernel, folder, "excite", device, "--plan-only") for kernel in kernels.KERNELS)
            printed(f"excite {device}", {"plan": old["plan"]}, {"plan": new["plan"]})
        for case in asked.only:
            if (text := RECOMMENDATIONS[case]) is not None:
                (folder / f"{case}.toml").write_text(text, encoding="ascii")
            problem = case if text is None else f"{case}.toml"
            old, new = (recommended(answer(kernel, folder, "recommend", problem)) for kernel in kernels.KERNELS)
            printed(f"recommend {case}", old, new)


if __name__ == "__main__":
    main()
