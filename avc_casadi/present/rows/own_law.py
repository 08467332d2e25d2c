"""Rows of a law of one's own: whether it holds, by how much, its limits, and what would help."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from shlex import quote
from typing import TYPE_CHECKING

from avc_casadi.loops.margins import LEAST_DISK, SOUND_DISK
from avc_casadi.present.row import Answer, Mark, Part, Quantity, Row, Value, listed, marked, parts, row, span
from avc_casadi.present.rows.subject import HAND, name_of

if TYPE_CHECKING:
    from avc_casadi.own_law.certificate import LawCertificate
    from avc_casadi.own_law.loops import Case

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
    return Answer(
        "certify-law",
        found.document(),
        title,
        tuple(_rows(found)),
        tuple(_onwards(found, shown)),
        problem.units,
        code=1 if complaint else 0,
        complaint=complaint,
    )


def _values(values: Mapping[str, float]) -> tuple[Part, ...]:
    return listed((_NAMES[key][0], Value(value, _NAMES[key][1])) for key, value in values.items())


def _rows(found: LawCertificate) -> list[Row]:
    sound = found.disk_margin >= SOUND_DISK and found.quiet
    somebody = any(found.held.hand.values())
    cases = {"worst hand": found.held if somebody or found.released is None else None, "released": found.released}

    def both(label: str, text: Callable[[Case], tuple[Part, ...]], mark: Mark = Mark.NONE) -> Row:
        each = (parts(text(case), f"({name})") for name, case in cases.items() if case is not None)
        return row(label, listed(each, ";"), mark=mark)

    disk = min(case.margins.disk for case in (found.held, found.released) if case is not None)
    most, allowed = found.largest_stiffness_n_per_m, found.damping_range_ns_per_m
    rendered = [(Value(value, "stiffness"), f"at {hz:g} Hz") for hz, value in found.rendered_n_per_m.items()]
    loud = (Value(found.noise_n, "force"), "rms at rest;", Value(found.encoder_step_n, "force"), "by one encoder step")
    mark = Mark.FAIL if not found.passed else marked(sound, Mark.CAUTION)
    rows = [
        row("Deployable", f"{'yes' if found.passed else 'no'}: {found.reason}", mark=mark),
        both("Disk margin", _disk, Mark.FAIL if disk < LEAST_DISK else marked(disk >= SOUND_DISK, Mark.CAUTION)),
        both("Damping ratio", lambda one: (Value(one.damping_ratio, "number"), *_at(one.damping_ratio_hz))),
        both("Settling time", lambda one: ("never" if math.isinf(one.settling_s) else Value(one.settling_s, "time"),)),
        both("Spectral radius", lambda one: (Value(one.spectral_radius, "number", 6), *_at(one.frequency_hz))),
        row("Worst hand", listed(Value(found.held.hand[key], of) for key, of in HAND) if somebody else "released"),
        both("Gain margin", lambda one: (Value(one.margins.gain, "gain"), *_at(one.margins.gain_hz))),
        both("Phase margin", lambda one: (Value(one.margins.phase_deg, "phase"), *_at(one.margins.phase_hz))),
        both("Delay margin", lambda one: (Value(one.margins.delay_samples, "samples"),)),
    ]
    if found.free is not None:
        rows.append(row("Outside the wall", "disk margin", _disk(found.free), mark=marked(found.free.stable)))
    at_rest = (Value(found.static_stiffness_n_per_m, "stiffness"), "at rest")
    rows += [
        row("Rendered", listed([at_rest, *rendered])),
        row("Largest k", Value(most, "stiffness") if most else "none", "at this b"),
        row("Stable b", "none" if allowed is None else span(allowed, "damping"), "at this k"),
        row("Force noise", loud, mark=Mark.NONE if found.quiet else Mark.CAUTION),
    ]
    if not sound:
        helps = [
            (_values(one.changes), "(disk margin", Value(one.disk_margin, "number", 2), ")") for one in found.remedies
        ]
        none = "no change of k, b, cutoff, sample time or delay alone"
        rows.append(row("Would help", listed(helps, ";") or none))
    return rows


def _disk(case: Case) -> tuple[Part, ...]:
    """Return a disk margin with the gain and the phase that it leaves."""
    alpha = case.margins.disk
    gain = "any gain" if alpha >= 2 else f"{20 * math.log10((2 + alpha) / (2 - alpha)):.1f} dB"
    left = f", {gain} or {math.degrees(2 * math.atan(alpha / 2)):.0f} deg" if alpha else ""
    return parts(Value(alpha, "number", 2), left, _at(case.margins.disk_hz) if alpha else None)


def _at(hz: float) -> tuple[Part, ...]:
    return ("at", Value(hz, "frequency")) if hz else ()


def _onwards(found: LawCertificate, shown: str) -> list[str]:
    """Return the commands of what would help, and that of a recommendation where the file has a wall."""
    commands = []
    options = {key for key, (_, _, option) in _NAMES.items() if option}
    if one := next((one for one in found.remedies if set(one.changes) <= options), None):
        law = {key: value for key, value in {**vars(found.law), **one.changes}.items() if value}
        typed = " ".join(f"{_NAMES[key][2]} {value:g}" for key, value in law.items())
        commands.append(f"avc certify {quote(shown)} {typed}")
    if found.problem.environment.stiffness_n_per_m:
        commands.append(f"avc recommend {quote(shown)} --out coupling.json")
    return commands
