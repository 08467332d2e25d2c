"""Summaries of an identification and of a diagnosis."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from shlex import quote
from typing import TYPE_CHECKING

from avc_casadi._util.text import number, percent, quantity
from avc_casadi.identification.diagnosis.causes import CAUSES
from avc_casadi.identification.diagnosis.told import remedy_text
from avc_casadi.present.pages.subject import plural, quantities
from avc_casadi.present.terminal import Mark, Page, Row

if TYPE_CHECKING:
    from avc_casadi._util.units import Units
    from avc_casadi.identification.diagnosis.model import Diagnosis, Remedy
    from avc_casadi.identification.model import Estimate, Identification

# Rows of a diagnosis: remedies, best first, and logs.
_MOST_REMEDIES, _MOST_LOGS = 3, 10
# Share of an oscillation from which the force limit bounds it; a misfit that is not significant.
_CUT, _LEAST_MISFIT = 0.02, 1e-3
# Values of a device that have a row of their own, and letters that fit beside the longest of their names.
_MOST_VALUES, _LINE = 7, 76
# Text without a prefix.
_PLAIN = ("", "-", "samples")


def identification_page(
    found: Identification, units: Units, page: Page, logs: Sequence[str], written: Sequence[str]
) -> str:
    """Return an identification as a headline and rows, a value of the device each.

    Args:
        found: the identification.
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
    doubtful = [one for one in found.estimates.values() if one.doubt]
    if doubtful:
        why = "; ".join(dict.fromkeys(one.doubt for one in doubtful))
        keys = ", ".join(units.key(one.key) for one in doubtful)
        rows.append(
            Row("In doubt", textwrap.shorten(f"{why}: {keys}", 2 * _LINE, placeholder=" ... (-v)"), Mark.CAUTION)
        )
    if found.refused:
        keys = ", ".join(units.key(one.key) for one in found.refused)
        rows.append(Row("Not identified", textwrap.shorten(keys, _LINE, placeholder=" ... (-v)"), Mark.CAUTION))
    if found.notes:
        rows.append(Row("Notes", f"{plural(len(found.notes), 'note')} on what this is worth: -v", Mark.CAUTION))
    if written:
        rows.append(Row("Written", ", ".join(written), Mark.PASS))
    commands = [f"avc check {quote(written[0])}"] if written and found.device is not None else []
    return page.rendered(headline, rows, [*commands, f"avc identify {' '.join(logs)} -v"])


def _estimates(found: Identification, units: Units) -> list[Row]:
    """Describe each value with its interval; those of a resonance in one row."""
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
        command: that prints all of it.
        written: files that were written.
    """
    beside = [Row("Written", ", ".join(written))] if written else []
    if len(found) > 1:
        rows = [Row(one.source, _conclusion(one, units), _verdict(one)) for one in found[:_MOST_LOGS]]
        rows += [Row("Others", plural(len(found) - _MOST_LOGS, "log"))] if len(found) > _MOST_LOGS else []
        return page.rendered(f"{len(found)} logs", rows + beside, [command])
    (one,) = found
    rows = [Row("Verdict", _conclusion(one, units), _verdict(one))]
    if len(one.shares) > 1:
        told = (
            f"{CAUSES.get(cause, 'none of them')} {percent(share)}"
            for cause, share in one.shares.items()
            if share > 0.005
        )
        rows.append(Row("Borne out", ", ".join(told)))
    rows += [Row("Remedy", _remedy(cure, one, units)) for cure in one.cures[:_MOST_REMEDIES]]
    rows += [Row("Would decide", one.decides)] if one.decides else []
    rows += [*_swings(one, units), *_ticks(one), *_law(one, units), *_measured(one, units)]
    return page.rendered(f"{one.source}   {quantity(one.seconds, 's')}", rows + beside, [command])


def _conclusion(one: Diagnosis, units: Units) -> str:
    """Describe the cause with its number in the units of the motion; one without a number as concluded."""
    told, law, measured = quantities(units), one.law, one.measured
    if one.cause == "delay" and measured is not None:
        late, meant = number(measured.delay_samples, 3), number(measured.declared_delay_samples, 3)
        return f"{CAUSES['delay']}: {late} samples in place of {meant}, with which the loop settles"
    if one.cause == "stiffness" and law is not None:
        return f"{CAUSES['stiffness']}: k {told(law.stiffness_n_per_m, 'N/m')}; less of it is the smallest remedy"
    if one.cause == "damping" and law is not None and law.damping_ns_per_m > 0:
        return f"{CAUSES['damping']}: b {told(law.damping_ns_per_m, 'N.s/m')}; less of it is the smallest remedy"
    return one.conclusion


def _remedy(cure: Remedy, one: Diagnosis, units: Units) -> str:
    """Describe a remedy with its number in the units of the motion, and its effect on the loop."""
    told, law, measured = quantities(units), one.law, one.measured
    change = cure.change
    if cure.key == "stiffness_n_per_m" and law is not None:
        change = f"k {told(cure.value, 'N/m')} in place of {told(law.stiffness_n_per_m, 'N/m')}"
    elif cure.key == "damping_ns_per_m" and law is not None:
        change = f"b {told(cure.value, 'N.s/m')} in place of {told(law.damping_ns_per_m, 'N.s/m')}"
    elif cure.key == "delay_samples" and measured is not None:
        change = f"a delay of {number(cure.value, 2)} in place of {number(measured.delay_samples, 3)} samples"
    return remedy_text(change, cure.growth_per_s)


def _swings(one: Diagnosis, units: Units) -> list[Row]:
    told, found = quantities(units), one.oscillation
    if not math.isfinite(found.frequency_hz):
        return [Row("Oscillation", f"none; above 4 Hz the position moves by {told(found.at_rest_m, 'm')} rms")]
    size = f"{told(found.peak_to_peak_m, 'm')}, {told(found.force_peak_to_peak_n, 'N')} peak to peak"
    where = f"in contact {percent(found.contact_share)} of the time"
    cut = f", at the {units.key('force')} limit {percent(found.at_force_limit_share)}"
    return [
        Row(
            "Oscillation",
            f"{found.looks} at {quantity(found.frequency_hz, 'Hz')}: {size}, {where}"
            f"{cut if found.at_force_limit_share > _CUT else ''}",
        )
    ]


def _ticks(one: Diagnosis) -> list[Row]:
    """Describe the faults of the ticks."""
    ticks = one.ticks
    parts = [f"{percent(ticks.missed_share)} missing, at most {ticks.longest_gap} in a row"] * (ticks.missed_share > 0)
    parts += [f"a new value every {ticks.held} samples only"] * (ticks.held > 1)
    return [Row("Ticks", "; ".join(parts), Mark.CAUTION)] if parts else []


def _law(one: Diagnosis, units: Units) -> list[Row]:
    law, told = one.law, quantities(units)
    if law is None:
        return []
    if not law.told:
        return [Row("Law", f"no spring and damper: {percent(law.misfit)} of the {units.key('force')} is left")]
    k, b = told(law.stiffness_n_per_m, "N/m"), told(law.damping_ns_per_m, "N.s/m")
    return [Row("Law", f"k {k}, b {b}: the {units.key('force')} to {percent(max(law.misfit, _LEAST_MISFIT))}")]


def _measured(one: Diagnosis, units: Units) -> list[Row]:
    found, told = one.measured, quantities(units)
    if found is None:
        return []
    late = f"{number(found.delay_samples, 3)} ± {number(found.delay_error_samples, 1)} samples"
    ends = dict.fromkeys((number(found.least_declared_delay_samples, 3), number(found.declared_delay_samples, 3)))
    rows = [Row("Delay", f"{late}; declared or assumed {' to '.join(ends)}")]
    if found.hand is None:
        return [*rows, Row("Hand", "none: the device is released")]
    parts = zip(found.hand.values(), ("kg", "N.s/m", "N/m"), strict=True)
    return [*rows, Row("Hand", ", ".join(told(value, unit) for value, unit in parts))]


def _verdict(one: Diagnosis) -> Mark:
    return Mark.PASS if one.verdict == "nothing wrong" else Mark.FAIL if one.cause else Mark.CAUTION
