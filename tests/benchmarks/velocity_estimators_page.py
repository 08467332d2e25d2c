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


def beside() -> dict[str, float]:
    """What recommended couplings render on these devices, by the results of other studies, N/m."""
    found = json.loads((_RESULTS / "recommended.json").read_text(encoding="utf-8"))["cells"]
    filed = json.loads((_RESULTS / "catalogue_walls.json").read_text(encoding="utf-8"))["cells"]
    walls = {"figure5": found["figure5"]["felt"]["stiffness_n_per_m"]}
    walls |= {
        name: found[f"{name} | stiffest"]["stiffest_wall_n_per_m"]
        for name in ("reference-r1", "reference-r2", "reference-r3")
    }
    return walls | {
        name: filed[f"{name} | default | as filed"]["recommended_n_per_m"]
        for name in ("novint-falcon", "teaching-one-axis")
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
            line.append(f"{told(row)}{said}; {rounded(row['noise_n'])} N" if row["stiffness_n_per_m"] else "-")
        lines.append([*line, rounded(walls[device])])
    heads = ["B = 0" if name == "none" else name for name in names(devices, "estimator")]
    return table(["device", *heads, "recommended"], lines)


def every(devices: list[Row]) -> str:
    """Stiffest wall and noise by damping."""
    lines = []
    for device in names(devices, "device"):
        dampings = sorted({row["damping_ns_per_m"] for row in devices if row["device"] == device} - {0.0})
        for estimator in names(devices, "estimator")[1:]:
            found = [best(devices, device, estimator, b) for b in dampings]
            texts = [
                f"{rounded(b)}: {told(row)}, {rounded(row['noise_n'])} N"
                for b, row in zip(dampings, found, strict=True)
            ]
            lines.append([device, estimator, *texts])
    return table(["device", "estimator", "half", "one", "two"], lines)


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


_HEAD = _SUMMARY = _LEARNT = _EVERY = _PADDLE = _COLUMNS = _PARTS = ""
