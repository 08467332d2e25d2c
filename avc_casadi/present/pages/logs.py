"""What logs tell of a device, and why a loop buzzes, at a glance."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING

from avc_casadi._util.text import number
from avc_casadi.identification.diagnosis.causes import CAUSES
from avc_casadi.identification.diagnosis.told import cure_text
from avc_casadi.present.pages.subject import plural
from avc_casadi.present.terminal import Mark, Page, Row, percent, quantity

if TYPE_CHECKING:
    from avc_casadi._util.units import Units
    from avc_casadi.identification.diagnosis.model import Diagnosis
    from avc_casadi.identification.model import Estimate, Identification

# Rows of a diagnosis: a few of what is known, best first.
_MOST_REMEDIES, _MOST_EVIDENCE, _MOST_LOGS = 3, 4, 10
# Values of a device that have a row of their own, and letters that fit beside the longest of their names.
_MOST_VALUES, _LINE = 7, 76
# What stands for itself, without a prefix.
_PLAIN = ("", "-", "samples")


def identification_page(
    found: Identification, units: Units, page: Page, logs: Sequence[str], written: Sequence[str]
) -> str:
    """Return an identification as a headline and rows, a value of the device each.

    Args:
        found: what the logs tell.
        units: of the device's motion.
        page: where it is printed.
        logs: as the user names them.
        written: files that were written.
    """
    records = plural(found.records, "record")
    headline = (
        f"{', '.join(logs)}   {quantity(found.seconds, 's')} in {records} at {quantity(1 / found.sample_time_s, 'Hz')}"
    )
    rows = _estimates(found, units)
    if len(rows) > _MOST_VALUES:
        rest = "; ".join(f"{row.label} {row.text}" for row in rows[_MOST_VALUES:])
        rows = [*rows[:_MOST_VALUES], Row("and", textwrap.shorten(rest, 2 * _LINE, placeholder=" ... (-v)"))]
    if found.refused:
        keys = ", ".join(units.key(one.key) for one in found.refused)
        rows.append(Row("Not told", textwrap.shorten(keys, _LINE, placeholder=" ... (-v)"), Mark.CAUTION))
    if found.notes:
        rows.append(Row("Notes", f"{plural(len(found.notes), 'note')} on what this is worth: -v", Mark.CAUTION))
    if written:
        rows.append(Row("Written", ", ".join(written), Mark.PASS))
    commands = [f"avc check {written[0]}"] if written and found.device is not None else []
    return page.rendered(headline, rows, [*commands, f"avc identify {' '.join(logs)} -v"])


def _estimates(found: Identification, units: Units) -> list[Row]:
    """Tell each value with its interval; those of a resonance in one row."""
    grouped: dict[str, list[str]] = {}
    for key, one in found.estimates.items():
        group, _, name = units.key(key).partition(".")
        grouped.setdefault(group, []).append(f"{name.replace('_hz', '').replace('_', ' ')} {_told(one, units)}".strip())
    return [Row(group, textwrap.shorten(", ".join(told), 2 * _LINE)) for group, told in grouped.items()]


def _told(one: Estimate, units: Units) -> str:
    digits = one.digits(1, 3)

    def shown(value: float) -> str:
        if one.unit in _PLAIN:
            return f"{number(value, digits)} {one.unit.strip('-')}".strip()
        return quantity(value, units.unit(one.unit), digits)

    if one.low == one.high:
        return shown(one.value)
    low, high = shown(one.low), shown(one.high)
    if low.partition(" ")[2] == high.partition(" ")[2]:
        low = low.partition(" ")[0]
    return f"{shown(one.value)} ({low} to {high})"


def diagnosis_page(found: Sequence[Diagnosis], units: Units, page: Page, command: str, written: Sequence[str]) -> str:
    """Return the diagnosis of one log as a headline and rows; of several a row each.

    Args:
        found: one a log.
        units: of the device's motion.
        page: where it is printed.
        command: what tells all of it.
        written: files that were written.
    """
    beside = [Row("Written", ", ".join(written))] if written else []
    if len(found) > 1:
        rows = [Row(one.source, units.text(one.conclusion), _verdict(one)) for one in found[:_MOST_LOGS]]
        rows += [Row("Others", plural(len(found) - _MOST_LOGS, "log"))] if len(found) > _MOST_LOGS else []
        return page.rendered(f"{len(found)} logs", rows + beside, [command])
    (one,) = found
    rows = [Row("Verdict", units.text(one.conclusion), _verdict(one))]
    if len(one.shares) > 1:
        told = (
            f"{CAUSES.get(cause, 'none of them')} {percent(share)}"
            for cause, share in one.shares.items()
            if share > 0.005
        )
        rows.append(Row("Borne out", ", ".join(told)))
    rows += [
        Row("Remedy", units.text(cure_text(cure.change, cure.growth_per_s))) for cure in one.cures[:_MOST_REMEDIES]
    ]
    rows += [Row("Would decide", units.text(one.decides))] if one.decides else []
    rows += [Row("Evidence", units.text(line)) for line in one.evidence[:_MOST_EVIDENCE]]
    return page.rendered(f"{one.source}   {quantity(one.seconds, 's')}", rows + beside, [command])


def _verdict(one: Diagnosis) -> Mark:
    return Mark.PASS if one.verdict == "nothing wrong" else Mark.FAIL if one.cause else Mark.CAUTION
