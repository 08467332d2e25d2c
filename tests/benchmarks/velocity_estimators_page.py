"""The page of the study of velocity estimators."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from published import MEASURED
from studied import made_by, rounded, table

Row = Mapping[str, Any]
_RESULTS = Path(__file__).parent / "results"
_MEASURED_AS = {"difference, 50 Hz": 0, "foaw": 1, "levant": 2, "kalman": 3}


def page(made: Mapping[str, Any], rows: Iterable[Row]) -> str:
    """Write the page."""
    devices = [row for row in rows if row["part"] == "device"]
    paddle = [row for row in rows if row["part"] == "paddle"]
    parts = ["# Walls by estimator of the velocity", made_by(made), _HEAD]
    parts += ["## Which one for which device", summary(devices), _SUMMARY, _LEARNT]
    parts += ["## Every damping", every(devices), _EVERY]
    parts += ["## The measured paddle", _PADDLE, measured(paddle), _COLUMNS, changed(paddle), _PARTS]
    return "\n\n".join(part.strip() for part in parts) + "\n"


def best(devices: list[Row], device: str, estimator: str, damping: float | None = None) -> Row:
    """The setting (and damping) with the stiffest wall."""
    some = [one for one in devices if (one["device"], one["estimator"]) == (device, estimator)]
    some = [one for one in some if damping is None or one["damping_ns_per_m"] == damping]
    return max(some, key=lambda one: one["stiffness_n_per_m"])


def names(devices: list[Row], key: str) -> list[str]:
    """The values of a key, in order."""
    return list(dict.fromkeys(row[key] for row in devices))


def beside() -> dict[str, float | None]:
    """What recommended couplings render on these devices, by the results of other studies, N/m."""
    found = json.loads((_RESULTS / "recommended.json").read_text(encoding="utf-8"))["cells"]
    filed = json.loads((_RESULTS / "catalogue_walls.json").read_text(encoding="utf-8"))["cells"]
    walls: dict[str, float | None] = {"figure5": found["figure5"]["felt"]["stiffness_n_per_m"]}
    walls |= {
        name: found[f"{name} | stiffest"]["stiffest_wall_n_per_m"]
        for name in ("reference-r1", "reference-r2", "reference-r3")
    }
    return walls | {
        name: filed[f"{name} | default | as filed"]["felt_n_per_m"] for name in ("novint-falcon", "teaching-one-axis")
    }


def told(row: Row) -> str:
    """A wall, and what else it does not hold."""
    if not row["stiffness_n_per_m"]:
        return "-"
    marks = ("" if row["without_friction"] else " f") + ("" if row["tapped"] else " t")
    return f"{rounded(row['stiffness_n_per_m'])}{marks}"


def settings(row: Row) -> str:
    """The setting that was best."""
    texts = {"cutoff_hz": "{:g} Hz", "acceleration_m_per_s2": "{:g} m/s²", "fit": "{}", "discretisation": ""}
    return " ".join(filter(None, (texts[key].format(value) for key, value in row["settings"].items())))


def summary(devices: list[Row]) -> str:
    """Stiffest wall, its damping and noise by device and estimator."""
    walls, lines = beside(), []
    for device in names(devices, "device"):
        line = [device, told(best(devices, device, "none"))]
        for estimator in names(devices, "estimator")[1:]:
            row = best(devices, device, estimator)
            said = f" ({settings(row)})" if settings(row) else ""
            line.append(f"{told(row)}{said}; {rounded(row['noise_n'], 2)} N" if row["stiffness_n_per_m"] else "-")
        lines.append([*line, rounded(walls[device])])
    heads = ["B = 0" if name == "none" else name for name in names(devices, "estimator")]
    return table(["device", *heads, "recommended"], lines)


def every(devices: list[Row]) -> str:
    """Stiffest wall, linear limit and noise of each setting by damping."""
    lines = []
    for device in names(devices, "device"):
        some = [row for row in devices if row["device"] == device and row["damping_ns_per_m"]]
        for case in dict.fromkeys((row["estimator"], settings(row)) for row in some):
            found = [row for row in some if (row["estimator"], settings(row)) == case]
            texts = [
                f"{rounded(row['damping_ns_per_m'])}: {told(row)} ({rounded(row['linear_n_per_m'])}); "
                f"{rounded(row['noise_n'], 2)}"
                for row in sorted(found, key=lambda row: row["damping_ns_per_m"])
            ]
            lines.append([device, " ".join(case).strip(), *texts, *["" for _ in range(3 - len(texts))]])
    return table(["device", "estimator", "first", "second", "third"], lines)


def measured(paddle: list[Row]) -> str:
    """Measured and simulated walls by damping."""
    lines = []
    for b, walls in MEASURED.items():
        line = [f"{b:g}"]
        for name in names(paddle, "estimator"):
            row = next(one for one in paddle if cell(one) == (name, b, "as above"))
            text = f"{ends(row['light'])} / {ends(row['firm'])}"
            line.append(f"**{walls[_MEASURED_AS[name]]:g}** {text}" if name in _MEASURED_AS else text)
        lines.append(line)
    return table(["B", *names(paddle, "estimator")], lines)


def cell(row: Row) -> tuple[str, float, str]:
    """What a row of the paddle is of."""
    return row["estimator"], row["damping_nms_per_deg"], row["change"]


def ends(value: float | None) -> str:
    """The stiffest wall, or a dash."""
    return "-" if value is None else rounded(value)


def changed(paddle: list[Row]) -> str:
    """Walls of a changed paddle."""
    some = [row for row in paddle if row["change"] != "as above"]
    cases = list(dict.fromkeys((row["estimator"], row["damping_nms_per_deg"]) for row in some))
    lines = []
    for change in names(paddle, "change"):
        found = [next(one for one in paddle if cell(one) == (*case, change)) for case in cases]
        lines.append([change, *(f"{ends(row['light'])} / {ends(row['firm'])}" for row in found)])
    lines.append(["**measured**", *(f"**{MEASURED[b][_MEASURED_AS[name]]:g}**" for name, b in cases)])
    return table(["changed", *(f"{name}, B = {b:g}" for name, b in cases)], lines)


_HEAD = """
A wall F = K x + B v rendered directly, v by an estimator: the backward difference, the same behind a first-order low
pass, a steady Kalman filter of a body with white acceleration, FOAW, Levant's differentiator ([keys and
sources](../../avc_casadi/simulation/README.md)). Scenes have all that the device declares. **Stiffest wall**:
doubled from a quarter of the linear limit of B = 0 until one of the 32 corners of the hands does not rest at the end
of a press (5 mm/s, last half second), then halved twice: a wall 19 % stiffer does not hold. Walls above that one are
not looked at. A press goes 10 mm into the wall, or as far as the stiffest hand reaches with 80 % of the force limit.
**f**: not without the declared dry friction; **t**: not after a tap.
"""

_SUMMARY = """
N/m, at the best of the dampings and of the settings (in brackets); then the noise in N: rms above 20 Hz of B v for a
handle moved 5 mm to and fro once a second over the encoder. *Recommended* is what `avc recommend` renders by other
studies ([catalogue](RESULTS_catalogue.md), `recommended.py`; `--stiffest` on the reference devices; on figure5 of the
100 kN/m asked for; a dash where every press of that study ends at the force limit): it must also hold without
friction, in three motions, with 100 hands. A harder test, not the same one, and made by older commits.
"""

_LEARNT = """
- **Delay and resonance (reference devices): none of them.** The best plain walls are 8.1, 3.6 and 4.0 kN/m and lean
  on dry friction; recommended couplings render 15.4, 11.5 and 8.1 without it. An estimator adds lag where lag is what
  stops.
- **No delay, fine encoder (figure5): Kalman's, and only with a simulation beside it.** Above a tracking index of 8/3
  (beta above alpha) it extrapolates to the end of the sample, which is a lead: 227 kN/m at 10 m/s² where the
  difference holds 113; the exact boundary says 215 and 109. At 100 m/s² the boundary says 254 at that damping, and
  scenes hold 2.5: 0.94 N of noise.
- **FOAW is the quiet one**: a sixth of the difference's noise on figure5, a twenty-fifth and less elsewhere, with its
  wall or a little less; on reference-r3 (55 um) more, as there noise is what stops the difference. Over the last
  steps before rest its window is at its longest and late by half of it: dry friction must end what is left. On
  teaching-one-axis, which has none and 61 um, it does not hold the softest wall that was tried, 1.9 kN/m.
- **Levant's by the implicit step is the difference** while 1.1 C T² is more than a step of the encoder, and a limit
  of its slope beyond. By the explicit step, which is what is mostly run, it chatters: no wall on figure5, none with
  more damping on the reference devices.
- **A low pass costs stiffness as its lag does** (30 Hz on figure5: a quarter is left) and pays where noise stops the
  difference: reference-r3, and teaching-one-axis at 9.6 N.s/m.

| device | take |
| --- | --- |
| fine encoder, no delay | Kalman's at a tracking index of 10 to 20, checked by `avc simulate`; else the difference |
| coarse encoder, dry friction | FOAW: as stiff or nearly, and far quieter |
| coarse encoder, no friction | the difference or a low pass at small B; not FOAW |
| delay, resonance, and stiffer than these | none: the recommended coupling, whose observer knows the forces |
"""

_EVERY = """
B in N.s/m: stiffest wall in N/m, in brackets what is linearly stable with all hands (`avc zwidth`; FOAW and Levant's
have no such boundary); noise in N. Dampings are shares of that of the stiffest wall that is linearly stable with the
difference: half, one, two (figure5); one, eight (reference devices, whose resonance makes it small); 1/32, 1/8 (the
last two, on whose encoders more damping holds nothing).
"""

_PADDLE = """
The paddle of [the published comparison](RESULTS_published.md#a-measured-region-a-haptic-paddle): K in N.m/deg, B in
N.m.s/deg, **measured** first, then scenes with the light and the firm finger, assumed as there (rest is below 0.07
rad/s; walls by steps of 1.41). The difference has the firmware's 50 Hz, FOAW a band of one step and 15 intervals.
Accelerations are not published: of some from 3 to 3000 rad/s² the nearest to the measured columns (10 for Levant's,
explicit; 500 where it gives the position; 100 for Kalman's). *Its position*: the spring acts on the estimator's
position, as in the firmware.
"""

_COLUMNS = """
What may hold the real one back, each alone:
"""

_PARTS = """
- **At B = 0** no velocity matters. Scenes hold 4 and 5.7 there; FOAW's 5.4 and Levant's 5.2 lie between, the
  difference's 1.8 does not. So the measured columns differ by something beside the velocity. Kalman's own position
  explains its 3: scenes hold 2 and 2.8, and the firm finger then goes about as that column does.
- **Levant's lasts longest** with B in both (4 at 0.016), with a bound chosen for it; by larger bounds it chatters.
- **The order is not reproduced.** Measured at B = 0.004: difference, Kalman's, FOAW, Levant's. Scenes with the firm
  finger: FOAW and Kalman's, Levant's, difference. FOAW holds 4 where 5.8 was measured, and falls earlier with B.
- **What was too kind** is the filtered difference: 8 in scenes, 2.8 measured. One sample of delay halves it, two, a
  cable that rings or no dry friction bring it to 2 to 2.8, a torque loop of 100 Hz below. None of these is known.
  FOAW falls by them too, and further below its column.
- **What counts as rest** weighs as much: with 0.35 in place of 0.07 rad/s FOAW goes from 4 to 8 and from 1 to 8. Near
  the edge the wall hunts by a few steps of the encoder; who calls that unstable is not published. Without that,
  finger and torque loop, a measured edge of quantisation is not predicted better than by a factor of two to three.
- The script's names of all four columns have "50hz": whether a low pass followed each estimator is not known. None
  does here.
"""
