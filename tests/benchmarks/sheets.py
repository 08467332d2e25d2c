"""Ten devices from their sheets through `avc new` and `avc recommend`, with and without the proposed damper.

OPENBLAS_NUM_THREADS=1 nice -n 10 python tests/benchmarks/sheets.py

Overwrites results/sheets.json and RESULTS_sheets.md after every device, and goes on where it stopped; some 20 seconds
of processor time each.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import shlex
import tempfile
from functools import partial
from pathlib import Path
from typing import Any

from studied import about, computed, made_by, table

from avc_casadi.cli import main as avc

_HERE = Path(__file__).parent
_OUT = _HERE / "results" / "sheets.json"
_PAGE = _HERE / "RESULTS_sheets.md"
_WITHOUT = ("--wall-damping", "0")
_RINGS_BELOW = 0.2
_SETTLED_S = 0.3

SHEETS = {
    "stylus": "--held stylus --mass 159g --damping 0.2N.s/m --friction 0.2N --encoder 23um --max-force 8.5N"
    " --wall 1kN/m",
    "wheel": "--held wheel --radius 150mm --inertia 0.045kg.m2 --damping 0.03N.m.s/rad --friction 0.15N.m"
    " --encoder 65536counts --max-torque 12N.m --wall 60N.m/rad",
    "leg joint": "--radius 200mm --inertia 0.0049kg.m2 --damping 0.01N.m.s/rad --friction 0.1N.m"
    " --encoder 16384counts --max-torque 17N.m --wall 60N.m/rad",
    "light stylus": "--held stylus --mass 75g --friction 0.04N --encoder 30um --max-force 8.5N --wall 1kN/m",
    "delta device": "--mass 220g --encoder 63um --max-force 9N --wall 1kN/m",
    "knob": "--held fingertip --radius 20mm --inertia 30kg.mm2 --encoder 4096counts --max-torque 200mN.m --rate 2kHz"
    " --wall 1N.m/rad",
    "pedal": "--held other --hand-mass '0.5 to 2 kg' --hand-damping '10 to 40 N.s/m' --hand-stiffness '200 to 2000 N/m'"
    " --mass 1.5kg --friction 5N --encoder 20um --max-force 200N --wall 10kN/m",
    "voice coil": "--mass 120g --damping 0.5N.s/m --encoder 5um --max-force 20N --rate 5kHz --wall 3kN/m",
    "paddle": "--mass 60g --friction 0.3N --encoder 25um --max-force 5N --wall 0.5kN/m",
    "exoskeleton": "--held other --hand-mass '1 to 3 kg' --hand-damping '10 to 60 N.s/m'"
    " --hand-stiffness '100 to 1000 N/m' --mass 1.8kg --friction 3N --encoder 50um --max-force 60N --rate 500Hz"
    " --wall 3kN/m",
}
"""Options of `avc new`; each wall is one that a spring and damper renders."""


def _said(*words: str) -> dict[str, Any]:
    text = io.StringIO()
    with contextlib.redirect_stdout(text), contextlib.redirect_stderr(io.StringIO()):
        avc([*words, "--json"])
    return dict(json.loads(text.getvalue()))


def _cell(sheet: str, more: tuple[str, ...]) -> dict[str, Any]:
    """Return what `recommend` says of the file that `new` wrote."""
    with tempfile.TemporaryDirectory() as folder:
        file = f"{folder}/device.toml"
        made = _said("new", file, *shlex.split(sheet), *more)
        found = _said("recommend", file)
    transients = found["transient"].values()
    return {
        "damper": made["proposed_damper"],
        "deployable": found["deployable"],
        "method": found["coupling"]["method"],
        "damping_ratio": min(of["damping_ratio"] for of in transients),
        "settling_s": max(of["settling_s"] for of in transients),
        "error_at_10_hz": found["felt"]["complex_error"]["10"],
        "disk_margin": min(of["disk"] for of in found["margins"].values()),
        "remedy": found["damped_wall"],
    }


_TEXT = """# Ten sheets of devices: do the recommended couplings ring?

{made_by}

Each device is typed as its sheet has it, and `avc new` writes the file: once with the damper of the wall that it
proposes, and once with `--wall-damping 0`. The damping ratio is the smallest and the settling time the longest of the
released device and all extreme hands of the range; the error is that of a sine at 10 Hz against the wall of the file.

{summary}

{rows}
"""


def _write_page(document: dict[str, Any]) -> None:
    cells = document["cells"]
    damped = {name: cells[name] for name in SHEETS if name in cells}
    bare = {name: cells[f"{name}, no damper"] for name in SHEETS if f"{name}, no damper" in cells}
    quick = sum(cell["settling_s"] < _SETTLED_S for cell in damped.values())
    sound = sum(cell["damping_ratio"] >= _RINGS_BELOW for cell in damped.values())
    ringing = [cell for cell in bare.values() if cell["damping_ratio"] < _RINGS_BELOW]
    helped = sum(cell["remedy"] is not None and cell["remedy"]["damping_ratio"] >= _RINGS_BELOW for cell in ringing)
    summary = (
        f"With the proposed damper {quick} of {len(damped)} settle within {1e3 * _SETTLED_S:.0f} ms, and {sound} have "
        f"a damping ratio of {_RINGS_BELOW} or more. Without one {len(ringing)} of {len(bare)} are below it; the row "
        f"*Damping ratio* is a caution on all of them and names a damper with which {helped} do not ring."
    )
    rows = []
    for name, cell in damped.items():
        rows.append([name, cell["damper"], *_figures(cell), *(_figures(bare[name]) if name in bare else ("-",) * 4)])
    head = ("device", "proposed damper")
    columns = ("damping ratio", "settles in, ms", "error at 10 Hz, %", "disk margin")
    _PAGE.write_text(
        _TEXT.format(
            made_by=made_by(document["about"]),
            summary=summary,
            rows=table((*head, *columns, *(f"without: {column}" for column in columns)), rows),
        ),
        encoding="utf-8",
    )


def _figures(cell: dict[str, Any]) -> tuple[str, ...]:
    return (
        f"{cell['damping_ratio']:.2f}",
        f"{1e3 * cell['settling_s']:.0f}",
        f"{100 * cell['error_at_10_hz']:.2g}",
        f"{cell['disk_margin']:.2f}",
    )


def main() -> None:
    """Run the study."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    cells = {name: partial(_cell, sheet, ()) for name, sheet in SHEETS.items()}
    cells |= {f"{name}, no damper": partial(_cell, sheet, _WITHOUT) for name, sheet in SHEETS.items()}
    computed(cells, _OUT, about("OPENBLAS_NUM_THREADS=1 python tests/benchmarks/sheets.py", 0), _write_page)


if __name__ == "__main__":
    main()
