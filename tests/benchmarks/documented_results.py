"""The measured tables and figures of README and guide, each written from a results file that says what made it."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import baseline_page
import documented_hardware as hardware
import numpy as np
from studied import percent, rounded, table

from avc_casadi.simulation.population.settled import exact_interval

RESULTS = Path(__file__).parent / "results"
_REFERENCES = ("reference-r1", "reference-r2", "reference-r3")

Document = Mapping[str, Any]


@cache
def document(name: str) -> Document:
    """A results file; what made it stands in its key `about`."""
    found = json.loads((RESULTS / f"{name}.json").read_text(encoding="utf-8"))
    return found if "about" in found else {**found, "about": found}


@dataclass(frozen=True)
class ResultBlock:
    """A block of a page.

    Attributes:
        source: name of the results file.
        write: from the document to Markdown.
        quiet: whether the page says elsewhere what made it.
    """

    source: str
    write: Callable[[Document], str]
    quiet: bool = False

    def text(self) -> str:
        """The block, and what made it."""
        found = document(self.source)
        body = self.write(found)
        return body if self.quiet else f"{body}\n\n{made(self.source, found['about'])}"


def made(source: str, about: Document) -> str:
    """One line that says what made a result."""
    where = f"avc-casadi {about.get('avc_casadi', about.get('version'))}, commit {about['commit']}"
    return f"*`results/{source}.json`: `{about['command']}`, seed {about['seed']}, {where}, {about['machine']}.*"


def reference_walls(found: Document) -> str:
    head = (
        "wall 5 kN/m",
        "plain spring and damper, N/m",
        "recommended feels: sensor / handle, N/m",
        "at rest of 100: declared friction / none",
        "impedance error at 1 / 10 Hz, %",
    )
    rows = []
    for name in _REFERENCES:
        cell = found["cells"][name]
        felt, trial = cell["felt"], cell["trial"]
        error = felt["complex_error"]
        rows.append(
            (
                f"`{name}`",
                f"{cell['plain_n_per_m']:.0f}",
                f"{felt['stiffness_n_per_m']:.0f} / {felt['stiffness_at_handle_n_per_m']:.0f}",
                f"{trial['at_rest']} / {trial['at_rest_without_friction']}",
                f"{percent(error['1'])} / {percent(error['10'])}",
            )
        )
    return table(head, rows)


def figure5_recommended(found: Document) -> str:
    cell = found["cells"]["figure5"]
    felt, trial, error = cell["felt"], cell["trial"], cell["felt"]["complex_error"]
    return (
        f"On `figure5` `avc recommend` gives {felt['stiffness_n_per_m'] / 1e3:.1f} kN/m of the "
        f"{cell['wall_n_per_m'] / 1e3:g}, for {trial['at_rest']} of {trial['hands']} hands with and "
        f"{trial['at_rest_without_friction']} without friction, and with the device *let go* in the wall, where "
        f"no contact damper holds more than {cell['plain_n_per_m'] / 1e3:.0f} kN/m. Its impedance error is "
        f"{percent(error['1'])} % at 1 Hz and {percent(error['10'])} % at 10 Hz."
    )


def what_would_help(found: Document) -> str:
    cells = [found["cells"][f"{name} | stiffest"] for name in _REFERENCES]
    changes = [one["change"] for one in cells[0]["what_would_help"]]
    head = ("kN/m", "spring and damper, linear alone", "as it is", *changes)
    rows = []
    for name, cell in zip(_REFERENCES, cells, strict=True):
        walls = {one["change"]: one["stiffest_wall_n_per_m"] for one in cell["what_would_help"]}
        told = (cell["plain_wall_n_per_m"], cell["stiffest_wall_n_per_m"], *(walls.get(change) for change in changes))
        rows.append((f"`{name}`", *(rounded(None if value is None else value / 1e3, 2) for value in told)))
    return table(head, rows)


def random_devices(found: Document) -> str:
    cells = [cell for cell in found["cells"].values() if "fresh" in cell and "claimed" in cell]
    people = sum(cell["fresh"]["people"] for cell in cells)
    rest = sum(cell["fresh"]["at_rest"] for cell in cells)
    sure = [cell for cell in cells if cell["claimed"]["without_friction"] == cell["claimed"]["people"]]
    told, free = (sum(cell["fresh"][key] for cell in sure) for key in ("people", "without_friction"))
    took = np.array([cell["wall_s"] for cell in cells])
    plain = sum(any(cell["plain"][key] for key in ("stiffer_as_safe", "softer_safer")) for cell in cells)
    return (
        f"On {len(cells)} devices drawn at random {rest} of {people} fresh hands settle; without friction "
        f"{free} of {told}, where all of the recommendation's own did. On {plain} of the devices a plain wall is "
        f"stiffer and as safe, or softer and safer. A recommendation took {np.median(took):.1f} s in the "
        f"median (two processes on two cores), below 10 s on {int((took < 10).sum())} of the {len(cells)}, at most "
        f"{took.max():.0f} s."
    )


def recommend_time(found: Document) -> str:
    cells = [cell for cell in found["cells"].values() if "wall_s" in cell]
    beyond = np.array([cell["wall_n_per_m"] > cell["plain_n_per_m"] for cell in cells])
    took = np.array([cell["wall_s"] for cell in cells])
    return (
        f"A wall that spring and damper hold on a usual device, as here, takes a few seconds. Stiffer "
        f"walls and odd devices take longer: of {len(cells)} devices drawn at random, a recommendation took "
        f"{np.median(took[~beyond]):.1f} s in the median where spring and damper hold the wall, "
        f"{np.median(took[beyond]):.0f} s where they do not, over 10 s on {int((took > 10).sum())} and "
        f"{took.max():.0f} s at most (as of commit {found['about']['commit']}). A device whose file gives ranges, so "
        "that many devices are tried, takes up to a minute where it is known to a tenth, and some minutes where gaps "
        "of the file are wide ranges."
    )


def table1(found: Document) -> str:
    people = found["hands"]
    by_wall: dict[str, dict[str, Document]] = {}
    for row in found["rows"]:
        by_wall.setdefault(row["ve"], {})[row["coupling"]] = row
    head = (
        "wall",
        "k_e, N/m",
        "stable without coupling, %",
        "paper, of 10",
        "static (Llewellyn, printed hold): stable / stiffness felt, %",
        "constant + contact damper: stable / without friction / stiffness, %",
        "schedule + contact damper: the same",
        "schedule nearer to the wall than static / unable to tell, %",
        "paper: adaptive nearer / unable, of 10",
    )

    def share(count: int | None) -> str:
        return "-" if count is None else f"{100 * count / people:.3g}"

    def felt(row: Document) -> str:
        value = row["apparent_stiffness_n_per_m"]
        return "-" if value is None else f"{100 * value / row['stiffness_n_per_m']:.0f}"

    rows = []
    for wall, couplings in by_wall.items():
        none, static = couplings["none"], couplings["static"]
        tuned, schedule = couplings["static-tuned"], couplings["schedule"]
        ends = f" [{percent(none['stable_low'])}, {percent(none['stable_high'])}]"
        interval = "" if none["stable"] == people else ends
        paper = schedule["paper"]
        rows.append(
            (
                wall,
                f"{none['stiffness_n_per_m']:.0f}",
                share(none["stable"]) + interval,
                none["paper"]["stable"],
                f"{share(static['stable'])} / {felt(static)}",
                f"{share(tuned['stable'])} / {share(tuned['asymptotic'])} / {felt(tuned)}",
                f"{share(schedule['stable'])} / {share(schedule['asymptotic'])} / {felt(schedule)}",
                f"{share(schedule['matched'])} / {share(schedule['unable'])}",
                f"{paper['matched']} / {paper['unable']}",
            )
        )
    low = exact_interval(people, people)[0]
    proved = f"all of {people} prove at least {percent(low)} % (exact binomial, 95 %)"
    return f"{table(head, rows)}\n\nOf {people} hands of set A; {proved}."


def table1_read(found: Document) -> str:
    rows = {(row["ve"], row["coupling"]): row for row in found["rows"]}
    people, walls = found["hands"], ("VE4", "VE5", "VE6", "VE7")

    def stable(coupling: str) -> str:
        return ", ".join(f"{100 * rows[wall, coupling]['stable'] / people:.3g}" for wall in walls)

    static = rows["VE7", "static"]
    leaning = 100 * (static["stable"] - static["asymptotic"]) / people
    return (
        "What the paper calls adaptive is its pointwise solution. Simulated as it stands (`direct`: series, estimator, "
        f"adaptation) it leaves {stable('direct')} % of the hands stable at VE4 to VE7; read as what it is, damping "
        f"injection (`closed-form`), {stable('closed-form')} %. The schedule with a contact damper stands in the "
        "paper's column because it is what this package offers in its place. Llewellyn's condition with the printed "
        f"hold keeps {100 * static['stable'] / people:.3g} % of the hands at VE7 stable, {leaning:.3g} % in the press "
        "only by friction."
    )


def recorded(name: str) -> Callable[[Document], str]:
    """A finding that was measured once, with its own command and commit."""

    def write(found: Document) -> str:
        part = found["findings"][name]
        about = part["about"]
        return f"{part['text']}\n\n*`{about['command']}`, written down in commit {about['commit']}.*"

    return write


def many_workers(found: Document) -> str:
    told = found["workers"]
    head = ("workers", "s", "efficiency", "from")
    rows: list[tuple[object, ...]] = [
        (name, rounded(seconds), "", f"measured, {told['hands']} hands") for name, seconds in told["seconds"].items()
    ]
    rows[2] = (*rows[2][:2], percent(told["efficiency_of_two"]) + " %", rows[2][3])
    rows += [
        (
            workers,
            rounded(one["seconds"]),
            percent(one["efficiency"]) + " %",
            f"model, {found['million']['answer']['hands']} hands",
        )
        for workers, one in told["model"].items()
    ]
    same = "equal to the byte" if told["equal_to_the_byte"] else "NOT equal"
    cost = sum(told["chunk_seconds"]) / told["hands"] * 1e6
    return (
        f"{table(head, rows)}\n\nThe JSON of all that were measured is {same}. The model hands out the processor times "
        f"of measured chunks in their order to whoever is idle first. A million hands cost {cost:.0f} s of one "
        f"processor here, three motions each: that many core-seconds are to be booked, and one chunk of "
        f"{sum(told['chunk_seconds']) / len(told['chunk_seconds']):.1f} s is what a lost worker costs."
    )


def real_drive(found: Document) -> str:
    names = {
        "mass_kg": "mass, kg",
        "damping_ns_per_m": "damping, N.s/m",
        "coulomb_friction_n": "dry friction, N",
        "damping_asymmetry_ns_per_m": "damping more along + (and less against it), N.s/m",
    }

    def told(one: Document | None) -> str:
        return "-" if one is None else f"{one['value']:.3g} ({one['low']:.3g} to {one['high']:.3g})"

    halves, plain = found["halves"], found["least_squares"]
    rows: list[tuple[object, ...]] = []
    for key, words in names.items():
        of_halves = (told(half["identified"].get(key)) for half in halves)
        rows.append((words, told(found["identified"].get(key)), *of_halves, rounded(plain.get(key))))
    for key, words in (("velocity", "velocity"), ("position", "position")):
        shares = (f"{100 * half['other_identified'][key]:.2f} %" for half in halves)
        least = " / ".join(f"{100 * half['other_least_squares'][key]:.2f} %" for half in halves)
        rows.append((f"variance of the {words} of the other half explained", "-", *shares, least))
    missed = (f"{half['other_identified']['position_rms_mm']:.2g}" for half in halves)
    least = " / ".join(f"{half['other_least_squares']['position_rms_mm']:.2g}" for half in halves)
    rows.append((f"position missed of {1e3 * found['travel_m']:.0f} mm of travel, mm rms", "-", *missed, least))
    head = ("", "all of it", "first half", "second half", "least squares: all, or first / second half")
    return (
        f"A real drive, of another size: {found['seconds']:.0f} s at {1 / found['sample_time_s']:.0f} Hz of the EMPS "
        "benchmark (A. Janot, M. Gautier, M. Brunot, *Data set and reference models of EMPS*, Nonlinear System "
        "Identification Benchmarks 2019, nonlinearbenchmark.org), in closed loop, with pulses of force. The record is "
        "not ours to publish; `real_drive.py --help` says how its CSV is made. The other half is simulated freely from "
        "its force alone, without any measured position after the first, by a simulator that shares no code with the "
        f"fit; least squares are ordinary ones on signals filtered without phase.\n\n{table(head, rows)}"
    )


BLOCKS: Mapping[str, ResultBlock] = {
    "real-drive": ResultBlock("real_drive", real_drive),
    "reference-walls": ResultBlock("recommended", reference_walls),
    "figure5-recommended": ResultBlock("recommended", figure5_recommended, quiet=True),
    "what-would-help": ResultBlock("recommended", what_would_help),
    "baselines": ResultBlock("passivity_baselines", baseline_page.guide),
    "joss-baselines": ResultBlock("passivity_baselines", baseline_page.lessons, quiet=True),
    "joss-random-devices": ResultBlock("random_devices", random_devices, quiet=True),
    "random-devices": ResultBlock("random_devices", random_devices),
    "recommend-time": ResultBlock("random_devices", recommend_time, quiet=True),
    "table1": ResultBlock("table1", table1),
    "table1-read": ResultBlock("table1", table1_read, quiet=True),
    "device-wire": ResultBlock("hardware", hardware.wire, quiet=True),
    "device-ticks": ResultBlock("hardware", hardware.ticks, quiet=True),
    "device-observers": ResultBlock("hardware", hardware.observers, quiet=True),
    "device-boards": ResultBlock("hardware", hardware.boards),
    **{
        name: ResultBlock("recorded", recorded(name), quiet=True)
        for name in json.loads((RESULTS / "recorded.json").read_text(encoding="utf-8"))["findings"]
    },
}
