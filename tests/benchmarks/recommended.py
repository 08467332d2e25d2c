"""What `avc recommend` and `avc recommend --stiffest` say of figure 5 and of the reference devices.

python tests/benchmarks/recommended.py

Overwrites results/recommended.json beside this file after every cell; what it holds already is not computed again.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

from script_arguments import script_arguments
from studied import about, computed

import avc_casadi as avc
from avc_casadi.recommendation.stiffest import stiffest

RESULTS = Path(__file__).parent / "results" / "recommended.json"
PROBLEMS = ("figure5", "reference-r1", "reference-r2", "reference-r3")


def recommended(name: str) -> dict[str, Any]:
    document = avc.recommend(name).data()
    trial = document["trial"] or {}
    return {
        "deployable": document["deployable"],
        "wall_n_per_m": avc.load_problem(name).environment.stiffness_n_per_m,
        "plain_n_per_m": document["plain_wall_n_per_m"],
        "felt": document["felt"],
        "trial": {key: value for key, value in trial.items() if isinstance(value, int | float | str)},
    }


def main() -> None:
    script_arguments(__doc__)
    cells = {name: partial(recommended, name) for name in PROBLEMS}
    cells |= {f"{name} | stiffest": partial(stiffest, avc.load_problem(name)) for name in PROBLEMS[1:]}
    computed(cells, RESULTS, about("python tests/benchmarks/recommended.py", 0), lambda _: None)


if __name__ == "__main__":
    main()
