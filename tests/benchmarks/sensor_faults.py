"""Bad samples of a position sensor that nearly agree, and hands that strike: what exported C makes of them.

python tests/benchmarks/sensor_faults.py [RUNS] [--write]

Twelve couplings, RUNS runs of each (100 000 by default, ten minutes of processor): a device rests from 1 um to 0.5 m
outside of the wall and its sensor tells, up to three times, up to six bad samples in a row. They begin with a jump of
20 mm to 0.5 m and then agree, exactly or to four counts, drift by a millimetre a sample, change sides, or are no
numbers. A fiftieth of the runs again under sanitizers; RUNS/50 strikes at 0.1 to 2 m/s and at 2 to 3. gcc and clang are
needed.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "oracle"))

from bad_samples import SANITIZED, BadSensor, laws_of_each_kind
from script_arguments import script_arguments
from studied import about, made_by

from avc_casadi.coupling import Coupling

HERE = Path(__file__).resolve().parent
PAGE = HERE / "RESULTS_sensor_faults.md"
SEED = 2026
_HEAD = """\
# Bad samples that nearly agree

{made_by}

Exported C in single precision, {runs} runs a coupling: a device rests from 1 um to 0.5 m outside, its sensor reports up
to six bad samples in a row, the first of them 20 mm to 0.5 m away, which agree, drift or change sides. *Largest force*
is what the device gets beyond the most that a sound sensor gives it in the same run, on both ends of the coupling.
*Refused* are samples of hands that strike the wall, which no guard should refuse.

| coupling | bad samples | largest force, N | runs with one | with sanitizers, N | refused, 0.1 to 2 m/s | 2 to 3 m/s |
|---|---|---|---|---|---|---|
"""
_TAIL = """
Address and undefined-behaviour sanitizers had no report. A run that begins where an encoder reads 0 has the force that
the law gives there without a fault too: an observer law may look half a step ahead.
"""


def row(name: str, coupling: Coupling, runs: int) -> str:
    """Return a row of the table; an error where a sanitizer reports."""
    sensor = BadSensor(coupling)
    found = sensor.bad_samples(runs, SEED)
    sanitized = BadSensor(coupling, SANITIZED).bad_samples(runs // 50, SEED + 1)
    slow, fast = (sensor.strikes(runs // 50, speeds, SEED) for speeds in ((0.1, 2.0), (2.0, 3.0)))
    cells = (f"{found.bad}", f"{found.largest_n:.2g}", f"{found.forces}", f"{sanitized.largest_n:.2g}")
    refused = (f"{one.refused} of {one.samples}" for one in (slow, fast))
    return f"| {' | '.join((name, *cells, *refused))} |"


def main() -> int:
    """Print the table, and write the page where it is asked for."""
    arguments = script_arguments(__doc__, people=100_000, results=PAGE)
    lines = []
    for name, coupling in laws_of_each_kind().items():
        lines.append(row(name, coupling, arguments.people))
        print(lines[-1], flush=True)
    if arguments.write:
        command = f"python tests/benchmarks/sensor_faults.py {arguments.people} --write"
        head = _HEAD.format(made_by=made_by(about(command, SEED)), runs=arguments.people)
        arguments.write.write_text(head + "\n".join(lines) + "\n" + _TAIL, encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
