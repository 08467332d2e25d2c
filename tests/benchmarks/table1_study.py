"""The paper's Table 1 with simulated hands, and what made it: python tests/benchmarks/table1_study.py [PEOPLE]

Overwrites results/table1.json beside this file: the document of `avc table1 --hands PEOPLE --json`, with commit,
machine, versions, seed and command.
"""

from __future__ import annotations

import json
from pathlib import Path

from script_arguments import PRINTED, script_arguments
from studied import about

from avc_casadi._util.parallel import processors
from avc_casadi.design.comparison.table1 import table1

RESULTS = Path(__file__).parent / "results" / "table1.json"
SEED = 2026


def main() -> None:
    people = script_arguments(__doc__, people=200).people
    made = about(f"python tests/benchmarks/table1_study.py {people}", SEED)
    document = {"about": made} | table1(people, SEED, workers=processors(), progress=PRINTED)
    RESULTS.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
