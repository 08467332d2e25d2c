"""The page of `passivity_baselines.py`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from studied import made_by, rounded, table

PAGE = Path(__file__).parent / "RESULTS_passivity_baselines.md"
Document = Mapping[str, Any]
# The devices that declare a structure and an amplifier.
STRUCTURED = ("reference-r1", "reference-r2", "reference-r3")

_TEXT = """# Which coupling: passivity controllers beside constant couplings and ours

{made_by}

What runs between a device and a wall in other laboratories, on the same devices, hands and walls as what is
recommended here. Each law is written from its publication (`baseline_laws.py`); where that leaves a number to be
tuned, it is the one of three or four with which most hands settle. Of the project are the exported C of the
couplings, the last three rows, and the numbers of the devices, at their nominal values. The simulation is plain numpy
(`baseline_plant.py`): motor and handle on a structure, amplifier, delay, dry friction, force limit, and an encoder
that counts from anywhere within a step; 8 steps of the equations a sample.
`tests/test_baselines_are_simulated_soundly.py` compares it with a second one.

{hands} hands, corners of the box among them, press at 0.07 m/s, strike at 0.3 m/s and tap from 20 mm before the wall,
3 s each, longer where a heavy device would still swing in the hand without a wall. *Settled*: below 5 mm/s in the
last half second of all three, with the declared friction and without. *At rest*: force over depth at the end of a
press, the median of hands that settle and do not lean on the force limit. *1 Hz, 10 Hz*: the motor led about a depth
by half of it (half of 10 N or of the force limit, over the wall's stiffness); the impedance error is |Z_h - Z|/|Z|, Z
the device with the wall that is not sampled. *Ripple*: standard deviation of the force at the end of a press without
friction, the median. *Outside*: largest command while the encoder reads a place outside. *Given*: most energy that a
released device has got, over that with which it came, thrown at 0.02 to 0.3 m/s without friction. *Held*: the wall at
which every hand settles without friction, halved from the one asked for, down to a 256th; - is none.

- **The wall itself**: k x + b v in the wall, never pulling.
- **PO/PC**: passivity observer and controller (Hannaford and Ryu, IEEE T-RA 18(1), 2002), the held force paired with
  its way (Ryu, Kim and Hannaford, IEEE T-RO 20(4), 2004). Behind an encoder the damper needs a largest value: 0.1,
  0.25 or 0.5 of the largest that is stable alone. **With reference energy**: it follows k x^2/2 (Ryu, Preusche,
  Hannaford and Hirzinger, IEEE T-CST 13(5), 2005).
- **Energy bounding** (Kim and Ryu, IJRR 29(6), 2010): the change of the force over a sample lies between bounds from
  the device's damping; they are derived anew in the code, with the delay.
- **Force augmentation** (Singh, Janetzko, Jafari, Weber, Lee and Ryu, IEEE T-IE 67(1), 2020): a soft spring, and an
  offset that grows while the hand goes in. It is successive, and these hands press once or three times; the first
  transient of full stiffness that the authors add is left out, as is the successive increment of stiffness, whose
  rule was not found.
- **Static coupling**: the best constant series coupling under Llewellyn's criterion or passivity (`static`). **Spring
  and damper**: nine tenths of the stiffest wall that a contact damper holds, linear, with every hand and released.
  **Recommended**: `avc recommend`.

Left out are wave variables (Niemeyer and Slotine 1991): they make the line between two places passive, and a wall in
the device's own loop has none. The hands are drawn anew, from the box for which what is recommended was designed, on
the devices that it was told; the other laws know the wall and, where they use them, damping and delay. No person has
felt any of this.

{tables}
## What it teaches

{lessons}
"""
_HEAD = (
    "law",
    "at rest, N/m",
    "1 Hz, N/m",
    "10 Hz, N/m",
    "impedance error, 1 / 10 Hz, %",
    "settled, friction / none",
    "held, N/m",
    "ripple, N",
    "outside, N",
    "given, %",
)


def write_page(document: Document) -> None:
    """Overwrite the page with what there is so far."""
    rows = rows_of(document)
    devices = list(dict.fromkeys(row["device"] for row in rows))
    text = _TEXT.format(
        made_by=made_by(document["about"]),
        hands=document["about"]["hands"],
        tables="\n".join(_device([row for row in rows if row["device"] == name]) for name in devices),
        lessons=lessons(document),
    )
    PAGE.write_text(text, encoding="utf-8")


def rows_of(document: Document) -> list[dict[str, Any]]:
    """The cells that were computed."""
    return [cell for cell in document["cells"].values() if "settled" in cell]


def _device(rows: list[dict[str, Any]]) -> str:
    first = rows[0]
    title = (
        f"## {first['device']}: a wall of {rounded(first['wall_n_per_m'])} N/m\n\n"
        f"The stiffest passive spring without friction is {rounded(first['passive_n_per_m'])} N/m; "
        f"dry friction {first['friction_n']:g} N; led about {rounded(1e3 * first['shaken_depth_m'])} mm.\n\n"
    )
    return title + table(_HEAD, map(_row, rows)) + "\n"


def _row(row: dict[str, Any]) -> tuple[str, ...]:
    law = row["law"]
    if law == "recommended":
        law = f"**recommended** ({'state feedback' if row['method'] == 'robust' else row['method']})"
    held = rounded(row["held_n_per_m"]) if "held_n_per_m" in row else ""
    return (
        law,
        rounded(row["at_rest_n_per_m"]),
        *map(rounded, row["in_motion_n_per_m"]),
        " / ".join(rounded(100 * error, 2) for error in row["error"]),
        f"{row['settled']} / {row['settled_without_friction']}",
        held,
        rounded(row["ripple_n"], 2) if row["ripple_n"] > 5e-4 else "0",
        f"{row['outside_n']:.3g}",
        rounded(100 * row["given_share"], 2),
    )


def everybody(document: Document, law: str) -> list[dict[str, Any]]:
    """The devices on which a law lets everybody settle, with friction and without."""
    hands = document["about"]["hands"]
    rows = [row for row in rows_of(document) if row["law"] == law]
    return [row for row in rows if row["settled"] == row["settled_without_friction"] == hands]


def lessons(document: Document) -> str:
    """What the numbers say, each number from them."""
    rows = rows_of(document)
    devices = len({row["device"] for row in rows})

    def share(law: str) -> str:
        return _range([row["at_rest_n_per_m"] / row["wall_n_per_m"] for row in everybody(document, law)])

    def settled(law: str) -> str:
        return f"{len(everybody(document, law))} of {devices}"

    def error(law: str) -> str:
        return _range([row["error"][1] for row in rows if row["law"] == law])

    def structured(law: str) -> int:
        found = [row for row in rows if row["law"] == law and row["device"] in STRUCTURED]
        return sum(row["settled_without_friction"] for row in found)

    hands = document["about"]["hands"]
    return (
        f"What is recommended for device and hands lets all {hands} hands settle on {settled('recommended')} devices, "
        f"with dry friction and without, at {share('recommended')} of the wall at rest; in motion it gives way, off by "
        f"{error('recommended')} at 10 Hz.\n"
        f"A passivity controller is nearer in motion, off by {error('PO/PC')}, but all hands settle on "
        f"{settled('PO/PC')} devices, on {settled('PO/PC with reference energy')} with a reference energy: where a "
        f"structure and an amplifier's lag stand between hand and observer, it lets {structured('PO/PC')} of "
        f"{len(STRUCTURED) * hands} settle without friction, the wall alone {structured('the wall itself')}.\n"
        "Energy bounding and the passive static coupling render what the device's own damping pays for, "
        f"{share('energy bounding')} and {share('static coupling')} of the wall, and all settle on "
        f"{settled('energy bounding')} and {settled('static coupling')}.\n"
        "Force augmentation feels stiffer at rest than its loop is, "
        f"{share('force augmentation')} of the wall after a press, and all settle on {settled('force augmentation')}.\n"
        "So take what is recommended where device and hands are known, energy bounding where only the damping is, and "
        "a passivity controller for a wall that changes, beside a stable coupling and not in its place (no such pair "
        "was measured here)."
    )


def _range(shares: list[float]) -> str:
    low, high = (rounded(100 * end, 2) for end in (min(shares, default=0.0), max(shares, default=0.0)))
    return f"{low} %" if low == high else f"{low} to {high} %"
