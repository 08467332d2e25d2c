"""Stable walls by boundary curves: their time against eigenvalues, and how near their edges are to radius 1.

python tests/benchmarks/stable_walls.py

Overwrites RESULTS_stable_walls.md.
"""

from __future__ import annotations

import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent))

from sampled_wall import spectral_radius
from script_arguments import script_arguments

import avc_casadi as avc
from avc_casadi.claims.zwidth import zwidth
from avc_casadi.loops.sampled_loop import SampledLoop, fractions
from avc_casadi.loops.wall import linear_stability
from avc_casadi.loops.walls import stable_walls
from avc_casadi.model.corners import LINEAR_KEYS, device_corners
from avc_casadi.model.hands import hand_set

HERE = Path(__file__).parent
RESULTS = HERE / "RESULTS_stable_walls.md"
PROBLEMS = ("figure5", "knob", "hard/long-delay", "hard/undamped-device", "reference-r1")
DAMPINGS, REPEATS, BISECTIONS, CHECKED, LAUNCHES = 61, 30, 40, 8, 5
COMMANDS = (
    ("python -c 'import numpy'", ["-c", "import numpy"]),
    ("python -c 'import matplotlib.figure'", ["-c", "import matplotlib.figure"]),
    ("avc check figure5", ["-m", "avc_casadi", "check", "figure5"]),
    ("avc zwidth figure5", ["-m", "avc_casadi", "zwidth", "figure5"]),
    ("avc zwidth figure5 --plot FILE", ["-m", "avc_casadi", "zwidth", "figure5", "--plot", "FILE"]),
)


def main() -> None:
    """Measure and write."""
    script_arguments(__doc__)
    rows = [_row(name) for name in PROBLEMS]
    taken = {told: _launch(arguments) for told, arguments in COMMANDS}
    lines = [
        "# Stable walls by boundary curves\n",
        f"Made by `python tests/benchmarks/stable_walls.py`, avc-casadi {avc.__version__}.\n",
        f"Processor time, the median of {REPEATS} calls, for the stable stiffnesses of {DAMPINGS} dampings with",
        "all hands at all corners of the device. Beside it what the eigenvalues of as many loops take, each looked at",
        "once; a scan of 60 stiffnesses with 40 bisections looks a hundred times. The distance is that of the edge",
        "from where the largest eigenvalue passes 1, of loops put together apart (`tests/sampled_wall.py`), at",
        f"{CHECKED} dampings.\n",
        "| problem | loops | curves, ms | eigenvalues once, ms | ratio to 100 times | largest relative distance |",
        "|---|--:|--:|--:|--:|--:|",
        *rows,
        "\n## The command\n",
        f"Processor time of a new process, the least of {LAUNCHES}; the machine had other work.\n",
        "| command | s |",
        "|---|--:|",
        *(f"| `{told}` | {seconds:.2f} |" for told, seconds in taken.items()),
        "\nA picture costs more than the region: Matplotlib's import alone takes what stands in the second row, and",
        "laying out and writing one the difference of the last two rows less that.\n",
    ]
    text = "\n".join(lines)
    RESULTS.write_text(text, encoding="utf-8")
    print(text)


def _row(name: str) -> str:
    problem = avc.load_problem(name)
    device, damping = problem.device, zwidth(problem).damping_ns_per_m[::4]
    corners, hands = device_corners(device, LINEAR_KEYS), hand_set(problem.hands)
    curves = _seconds(lambda: stable_walls(corners, hands, damping), REPEATS)
    edge = stable_walls(corners, hands, damping).first_n_per_m
    loop = SampledLoop(0.0, damping, np.nan_to_num(edge), device.sample_time_s, 0, "sampled-data")
    walls = fractions(loop, np.inf, 1.0)
    rigid = device.amplifier_bandwidth_hz is None and device.resonance is None
    once = _seconds(lambda: [linear_stability(one, walls, 0.0, hands) for one in corners], 3) if rigid else np.nan
    there = np.flatnonzero(np.isfinite(edge))
    held = list(zip(*vars(hands).values(), strict=True))
    distance = 0.0
    for row in there[np.linspace(0, len(there) - 1, CHECKED).astype(int)]:
        low, high = 0.99 * edge[row], 1.01 * edge[row]
        for _ in range(BISECTIONS):
            middle = (low + high) / 2
            worst = max(spectral_radius(one, hand, damping[row], middle) for one in corners for hand in held)
            low, high = (middle, high) if worst < 1 else (low, middle)
        distance = max(distance, abs(low / edge[row] - 1))
    times, ratio = ("-", "-") if np.isnan(once) else (f"{1e3 * once:.0f}", f"{100 * once / curves:.0f}")
    count = len(damping) * len(held) * len(corners)
    return f"| {name} | {count} | {1e3 * curves:.1f} | {times} | {ratio} | {distance:.0e} |"


def _seconds(call: Callable[[], object], repeats: int) -> float:
    taken = []
    for _ in range(repeats):
        started = time.process_time()
        call()
        taken.append(time.process_time() - started)
    return statistics.median(taken)


def _launch(arguments: list[str]) -> float:
    """Return the processor time of a command, children included."""
    taken = []
    for _ in range(LAUNCHES):
        with tempfile.NamedTemporaryFile(suffix=".png") as picture:
            command = [sys.executable, *(picture.name if one == "FILE" else one for one in arguments)]
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            subprocess.run(command, check=True, capture_output=True)  # noqa: S603
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
        taken.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return min(taken)


if __name__ == "__main__":
    main()
