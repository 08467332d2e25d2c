"""Rows of a law of one's own: whether it holds, by how much, its limits, and what would help."""

from __future__ import annotations

import math
from collections.abc import Mapping
from shlex import quote
from typing import TYPE_CHECKING

from avc_casadi.loops.margins import LEAST_DISK, SOUND_DISK
from avc_casadi.present.row import Answer, Mark, Part, Quantity, Row, Value, doubted, listed, marked, parts, row, span
from avc_casadi.present.rows.margins import damping_ratio, margins_by_loop, settling, smallest_margins
from avc_casadi.present.rows.subject import HAND, name_of

if TYPE_CHECKING:
    from avc_casadi.claims.own_law import LawCertificate

_NAMES: dict[str, tuple[str, Quantity, str]] = {
    "stiffness_n_per_m": ("k", "stiffness", "--k"),
    "damping_ns_per_m": ("b", "damping", "--b"),
    "local_damping_ns_per_m": ("b_p", "damping", "--b-p"),
    "cutoff_hz": ("cutoff", "frequency", "--cutoff-hz"),
    "sample_time_s": ("sample time", "time", ""),
    "delay_samples": ("delay", "samples", ""),
}


def own_law(found: LawCertificate, shown: str = "") -> Answer:
    """Return the answer of `certify` of a law of one's own."""
    problem, device, shown = found.problem, found.problem.device, shown or name_of(found.problem)
    rate, late = Value(1 / device.sample_time_s, "frequency"), Value(device.delay_samples, "samples")
    law = _values({key: value for key, value in vars(found.law).items() if value})
    title = parts(shown, " ", law, "· device", Value(device.mass_kg, "mass"), ",", rate, ", delay", late)
    complaint = "" if found.passed else f"avc: {shown}: this law is not deployable"
    rows, onwards = tuple(_rows(found)), tuple(_onwards(found, shown))
    return Answer("certify-law", found.document(), title, rows, onwards, problem.units, complaint=complaint)


def _values(values: Mapping[str, float]) -> tuple[Part, ...]:
    return listed((_NAMES[key][0], Value(value, _NAMES[key][1])) for key, value in values.items())


def _rows(found: LawCertificate) -> list[Row]:
    sound, period_s = found.disk_margin >= SOUND_DISK and found.quiet, found.problem.device.sample_time_s
    somebody = any(found.held.hand.values())
    cases = {"worst_hand": found.held} if somebody or found.released is None else {}
    cases |= {} if found.released is None else {"released": found.released}
    margins = {who: vars(case.margins) for who, case in cases.items()}
    disk = min(case.margins.disk for case in cases.values())
    seconds, slowest = max((case.settling_s, who) for who, case in cases.items())
    ratio, hz, swinging = min((case.damping_ratio, case.damping_ratio_hz, who) for who, case in cases.items())
    most, allowed = found.largest_stiffness_n_per_m, found.damping_range_ns_per_m
    rendered = [(Value(value, "stiffness"), f"at {hz:g} Hz") for hz, value in found.rendered_n_per_m.items()]
    loud = (Value(found.noise_n, "force"), "rms at rest;", Value(found.encoder_step_n, "force"), "by one encoder step")
    mark = Mark.FAIL if not found.passed else marked(sound, Mark.CAUTION)
    rows = [
        row("Deployable", f"{'yes' if found.passed else 'no'}: {found.reason}", mark=mark),
        smallest_margins(margins, Mark.FAIL if disk < LEAST_DISK else marked(disk >= SOUND_DISK, Mark.CAUTION)),
        settling(None if math.isinf(seconds) else seconds, slowest),
        damping_ratio(ratio, hz, swinging, period_s),
        row("Worst hand", listed(Value(found.held.hand[key], of) for key, of in HAND) if somebody else "released"),
    ]
    if found.free is not None:
        outside = Value(found.free.margins.disk, "number", 2)
        rows.append(row("Outside the wall", "disk margin", outside, mark=marked(found.free.stable)))
    rows += [
        row("Rendered", listed([(Value(found.static_stiffness_n_per_m, "stiffness"), "at rest"), *rendered])),
        row("Largest k", Value(most, "stiffness") if most else "none", "at this b"),
        row("Stable b", "none" if allowed is None else span(allowed, "damping"), "at this k"),
        row("Force noise", loud, mark=doubted(not found.quiet)),
    ]
    if not sound:
        helps = [
            (_values(one.changes), "(disk margin", Value(one.disk_margin, "number", 2), ")") for one in found.remedies
        ]
        none = "no change of k, b, cutoff, sample time or delay alone"
        rows.append(row("Would help", listed(helps, ";") or none))
    return [*rows, *margins_by_loop(margins)]


def _onwards(found: LawCertificate, shown: str) -> list[str]:
    """Return the commands of what would help, of a recommendation where the file has a wall, and of all rows."""
    options = {key: option for key, (_, _, option) in _NAMES.items() if option}

    def command(law: Mapping[str, float]) -> str:
        typed = " ".join(f"{options[key]} {value:g}" for key, value in law.items() if value)
        return f"avc certify {quote(shown)} {typed}"

    commands = []
    if one := next((one for one in found.remedies if set(one.changes) <= set(options)), None):
        commands.append(command({**vars(found.law), **one.changes}))
    if found.problem.environment.stiffness_n_per_m:
        commands.append(f"avc recommend {quote(shown)} --out coupling.json")
    return [*commands, f"{command(vars(found.law))} -v"]
