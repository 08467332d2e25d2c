"""The exported C of what is recommended, on a plant that shares no code with the project: do as many hands rest?

python tests/benchmarks/exported_rest.py [PEOPLE] [OUT]

`avc recommend`, then `avc export --c`; the files drive `tests/whole_device.c`: mass, dry friction, encoder, delay,
amplifier and resonance by their equations. The same people do what the trial lets them do: press, tap and hold; first
on the device as declared, then on others, with the same C, until some hands do not rest any more. The first hundred are
the trial's own. Overwrites OUT (default tests/benchmarks/results/exported_rest.json) and RESULTS_exported_rest.md
beside this file after every cell; what OUT holds already is not computed again.
"""

from __future__ import annotations

import contextlib
import io
import json
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from script_arguments import script_arguments
from studied import about, computed, made_by, table

sys.path.insert(0, str(Path(__file__).parent.parent))
from whole_device import WholeDevice, rests_as_tried

from avc_casadi.cli import main as avc_command
from avc_casadi.files.coupling_file import read_coupling
from avc_casadi.simulation.population.coupling_trial import try_coupling
from avc_casadi.simulation.population.operators import people_of
from avc_casadi.simulation.population.settled import exact_interval

HERE = Path(__file__).parent
RESULTS = HERE / "results" / "exported_rest.json"
PAGE = HERE / "RESULTS_exported_rest.md"
NAMES = ("reference-r1", "reference-r2", "reference-r3")
# The seed with which `avc recommend` draws its people.
SEED = 0
# What the device is in truth; the exported C is that for the device as declared.
OTHERS: Mapping[str, Mapping[str, float]] = {
    "as declared": {},
    "1 sample of untold delay": {"delay_samples": 2.0},
    "2.5 samples of untold delay": {"delay_samples": 3.5},
    "half the mass": {"mass_kg": 0.05},
    "resonance at 195 Hz": {"frequency_hz": 195.0},
    "resonance at 105 Hz": {"frequency_hz": 105.0},
    "encoder of 100 um": {"encoder_resolution_m": 1e-4},
}


def commanded(*words: str) -> None:
    with contextlib.redirect_stdout(io.StringIO()):
        code = avc_command(list(words))
    if code:
        raise RuntimeError(f"avc {' '.join(words)} ended with {code}")


def cell(name: str, count: int) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as folder:
        made, c = Path(folder) / f"{name}.json", Path(folder) / "c"
        commanded("recommend", name, "--out", str(made))
        commanded("export", str(made), "--c", str(c))
        files = {path.name: path.read_text(encoding="ascii") for path in c.iterdir()}
        claimed = json.loads(made.read_text(encoding="utf-8"))["trial"]
        coupling = read_coupling(made)
    bench = WholeDevice(coupling.problem.device, files)
    people = people_of(coupling.problem.hands, count, SEED)
    hands = list(zip(people.mass_kg, people.damping_ns_per_m, people.stiffness_n_per_m, strict=True))
    told = ("hands", "at_rest", "at_rest_without_friction")
    return {
        "coupling": coupling.id,
        "claimed": {key: claimed[key] for key in told},
        "devices": {other: compared(bench, coupling, people, hands, changed) for other, changed in OTHERS.items()},
    }


def compared(bench: WholeDevice, coupling: Any, people: Any, hands: list[Any], changed: Mapping[str, float]) -> Any:
    """Who rests in the trial, who on the plant, and for how many both say the same."""
    device = dict(changed)
    mode = device.pop("frequency_hz", None)
    if mode is not None:
        device["resonance"] = coupling.problem.device.resonance.model_copy(update={"frequency_hz": mode})
    met = replace(coupling, problem=coupling.problem.changed(device=device))
    tried = try_coupling(met, people, SEED)
    found = {}
    for key, friction, trial in (
        ("friction", None, tried.stable),
        ("no_friction", 0.0, tried.stable_without_friction),
    ):
        plant = rests_as_tried(bench, met.problem.device, hands, friction)
        found[key] = {
            "trial": int(trial.sum()),
            "plant": int(plant.sum()),
            "agree": int((trial == plant).sum()),
            "people": len(hands),
        }
    return found


TEXT = """# As many hands at rest as the trial says

{made_by}

`avc recommend NAME --out coupling.json`, then `avc export coupling.json --c DIR`. The two files drive a plant of its
own, `tests/whole_device.c`: two masses and the spring between them, viscous and dry friction, amplifier, delay, encoder
and force limit, 64 steps a sample. It shares no code with the project. {people} people, the {own} of the trial first,
press, tap and hold as in the trial; at rest is who stays below 5 mm/s at motor and handle during the last half second
of every motion. Then device and scene are made another than the one that was declared, with the same C, until hands do
not rest any more: the count has to be the same there too.

{tables}

In all {runs} cases trial and plant say the same of a hand in {agree} ({share} %). Of the {differ} others {free} are
without friction, where a hand may rest or go on in a limit cycle as its last digits will have it.
"""
_HEAD = (
    "device",
    "at rest with the declared friction: trial",
    "exported C on the plant",
    "same hand by hand",
    "without friction: trial",
    "exported C on the plant",
    "same hand by hand",
)


def _share(count: int, people: int) -> str:
    low, high = (100 * end for end in exact_interval(count, people))
    return f"{count} ({low:.1f}-{high:.1f} %)"


def write_page(document: dict[str, Any]) -> None:
    tables, every = [], []
    for name, one in document["cells"].items():
        rows = []
        for other, found in one["devices"].items():
            row = [other]
            for kind in ("friction", "no_friction"):
                counts = found[kind]
                every.append(counts)
                row += [_share(counts[key], counts["people"]) for key in ("trial", "plant")] + [counts["agree"]]
            rows.append(row)
        claim = one["claimed"]
        tables.append(
            f"## {name}\n\nCoupling {one['coupling']}; its file claims {claim['at_rest']} of {claim['hands']} hands at "
            f"rest, {claim['at_rest_without_friction']} without friction. Exact 95 % intervals in brackets.\n\n"
            + table(_HEAD, rows)
        )
    runs, agree = (sum(one[key] for one in every) for key in ("people", "agree"))
    free = sum(one["people"] - one["agree"] for one in every[1::2])
    PAGE.write_text(
        TEXT.format(
            made_by=made_by(document["about"]),
            people=every[0]["people"],
            own=next(iter(document["cells"].values()))["claimed"]["hands"],
            tables="\n\n".join(tables),
            runs=runs,
            agree=agree,
            differ=runs - agree,
            free=free,
            share=f"{100 * np.float64(agree) / runs:.1f}",
        ),
        encoding="utf-8",
    )


def main() -> None:
    arguments = script_arguments(__doc__, people=200, out=RESULTS)
    told = about(f"python tests/benchmarks/exported_rest.py {arguments.people}", SEED)
    computed({name: partial(cell, name, arguments.people) for name in NAMES}, arguments.out, told, write_page)


if __name__ == "__main__":
    main()
