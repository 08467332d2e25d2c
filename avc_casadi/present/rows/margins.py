"""Rows of margins and decay, of a recommended coupling and of a law of one's own: each says of which loop it is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from avc_casadi.present.row import Mark, Part, Quantity, Row, Value, doubted, listed, row

WHO = {"released": "released", "worst_hand": "worst corner hand"}
# Half of the usual margins, 6 dB and 20 degrees; a longer settling time is marked.
_THIN_GAIN, _THIN_DEG, _SLOW_S = 10 ** (3 / 20), 10.0, 1.0
_MARGINS: tuple[tuple[str, str, Quantity], ...] = (
    ("gain", "gain", "gain"),
    ("phase", "phase_deg", "phase"),
    ("delay", "delay_samples", "samples"),
    ("disk", "disk", "number"),
)


def smallest_margins(found: Mapping[str, Mapping[str, Any]], mark: Mark = Mark.NONE) -> Row:
    """Return the smallest margin of each kind and its loop; a caution where gain or phase is thin."""
    each, thin = [], False
    for word, key, of in _MARGINS:
        known = [(one[key], f"({WHO[who]})") for who, one in found.items() if one[key] is not None]
        value, who = min(known, default=(None, ""))
        thin = thin or (value is not None and value < {"gain": _THIN_GAIN, "phase": _THIN_DEG}.get(word, 0.0))
        each.append((word, Value(value, of), who))
    whose = {who for _, _, who in each}
    alike = f"{whose.pop().strip('()')}:" if len(whose) == 1 else ""
    text = listed((word, value, "" if alike else who) for word, value, who in each)
    return row("Margins", alike, text, mark=doubted(thin) if mark is Mark.NONE else mark)


def margins_by_loop(found: Mapping[str, Mapping[str, Any]]) -> list[Row]:
    """Return the margins of each loop with their frequencies, of lower rank."""
    rows = []
    for who, one in found.items():
        each = []
        for word, key, of in _MARGINS:
            hz = one.get(f"{word}_hz") if one[key] is not None else None
            each.append((word, Value(one[key], of), ("at", Value(hz, "frequency")) if hz else None))
        rows.append(row(f"Margins, {WHO[who]}", listed(each), rank=1))
    return rows


def settling(seconds: float | None, who: str) -> Row:
    """Return the settling time of a loop; None where it never settles."""
    text = "never" if seconds is None else Value(seconds, "time")
    return row("Settling time", text, f"({WHO[who]})", mark=doubted(seconds is None or seconds > _SLOW_S))


def damping_ratio(ratio: float, hz: float, who: str, sample_time_s: float) -> Row:
    """Return the damping ratio of the least damped oscillation of a loop."""
    text: tuple[Part, ...] = ("no oscillation below the Nyquist frequency",)
    if 0 < hz < 0.99 * 0.5 / sample_time_s:
        text = (Value(ratio, "number", 2), "at", Value(hz, "frequency"))
    return row("Damping ratio", text, f"({WHO[who]})")
