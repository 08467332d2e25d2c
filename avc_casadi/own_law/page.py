"""Page of a law of one's own: whether it holds, by how much, its limits, and what would help."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from shlex import quote
from typing import TYPE_CHECKING

from avc_casadi._util.text import quantity
from avc_casadi.claims.stability.margins import LEAST_DISK, SOUND_DISK
from avc_casadi.present.pages.subject import Quantities, quantities
from avc_casadi.present.terminal import Mark, Page, Row

if TYPE_CHECKING:
    from collections.abc import Mapping

    from avc_casadi.own_law.certificate import LawCertificate
    from avc_casadi.own_law.loops import Case

_UNITS = {
    "stiffness_n_per_m": ("k", "N/m"),
    "damping_ns_per_m": ("b", "N.s/m"),
    "local_damping_ns_per_m": ("b_p", "N.s/m"),
    "cutoff_hz": ("cutoff", "Hz"),
    "sample_time_s": ("sample time", "s"),
    "delay_samples": ("delay", "samples"),
}
_OPTIONS = {
    "stiffness_n_per_m": "--k",
    "damping_ns_per_m": "--b",
    "local_damping_ns_per_m": "--b-p",
    "cutoff_hz": "--cutoff-hz",
}


def own_law_page(found: LawCertificate, page: Page, shown: str) -> str:
    """Return the certificate of a law as a headline, rows and what to type next."""
    device, told = found.problem.device, quantities(found.problem.units)
    late = f"{device.delay_samples:g} sample{'' if device.delay_samples == 1 else 's'} of delay"
    law = _values({key: value for key, value in vars(found.law).items() if value}, told)
    head = f"{shown}   {law} · device {told(device.mass_kg, 'kg')}, {quantity(1 / device.sample_time_s, 'Hz')}, {late}"
    return page.rendered(head, list(_rows(found, told)), list(_onwards(found, shown)))


def _values(values: Mapping[str, float], told: Quantities) -> str:
    return ", ".join(f"{_UNITS[key][0]} {told(value, _UNITS[key][1])}" for key, value in values.items())


def _rows(found: LawCertificate, told: Quantities) -> Iterator[Row]:
    sound = found.disk_margin >= SOUND_DISK and found.quiet
    mark = Mark.FAIL if not found.passed else Mark.PASS if sound else Mark.CAUTION
    yield Row("Deployable", f"{'yes' if found.passed else 'no'}: {found.reason}", mark)

    somebody = any(found.held.hand.values())
    cases = {"worst hand": found.held if somebody or found.released is None else None, "released": found.released}

    def row(label: str, text: Callable[[Case], str], mark: Mark = Mark.NONE) -> Row:
        both = [f"{text(case)} ({name})" for name, case in cases.items() if case is not None]
        return Row(label, "; ".join(both), mark)

    disk = min(case.margins.disk for case in (found.held, found.released) if case is not None)
    mark = Mark.FAIL if disk < LEAST_DISK else Mark.CAUTION if disk < SOUND_DISK else Mark.PASS
    yield row("Disk margin", _disk, mark)
    yield row("Damping ratio", lambda one: f"{one.damping_ratio:.3g}{_at(one.damping_ratio_hz)}")
    yield row("Settling time", lambda one: "never" if math.isinf(one.settling_s) else quantity(one.settling_s, "s"))
    yield row("Spectral radius", lambda one: f"{one.spectral_radius:.6g}{_at(one.frequency_hz)}")
    units = zip(found.held.hand.values(), ("kg", "N.s/m", "N/m"), strict=True)
    yield Row("Worst hand", ", ".join(told(value, unit) for value, unit in units) if somebody else "no hand: released")
    yield row("Gain margin", lambda one: f"{_limit(one.margins.gain, '')}{_at(one.margins.gain_hz)}")
    yield row("Phase margin", lambda one: f"{_limit(one.margins.phase_deg, ' deg')}{_at(one.margins.phase_hz)}")
    yield row("Delay margin", lambda one: _limit(one.margins.delay_samples, " samples"))
    if found.free is not None:
        yield Row("Outside the wall", f"disk margin {_disk(found.free)}", Mark.PASS if found.free.stable else Mark.FAIL)
    rendered = [f"{told(value, 'N/m')} at {hz:g} Hz" for hz, value in found.rendered_n_per_m.items()]
    yield Row("Rendered stiffness", "; ".join([f"{told(found.static_stiffness_n_per_m, 'N/m')} at rest", *rendered]))
    most = found.largest_stiffness_n_per_m
    yield Row("Largest k", f"{told(most, 'N/m') if most else 'none'} at this b")
    allowed = found.damping_range_ns_per_m
    span = "none" if allowed is None else " to ".join(told(end, "N.s/m") for end in allowed)
    yield Row("Stable b", f"{span} at this k")
    loud = f"{told(found.noise_n, 'N')} rms at rest; {told(found.encoder_step_n, 'N')} by one step of the encoder"
    yield Row("Force noise", loud, Mark.NONE if found.quiet else Mark.CAUTION)
    if not sound:
        helps = [f"{_values(one.changes, told)} (disk margin {one.disk_margin:.2g})" for one in found.remedies]
        yield Row("Would help", "; ".join(helps) or "no change of k, b, cutoff, sample time or delay alone")


def _disk(case: Case) -> str:
    """Return a disk margin with the gain and the phase that it leaves."""
    alpha = case.margins.disk
    gain = "any gain" if alpha >= 2 else f"{20 * math.log10((2 + alpha) / (2 - alpha)):.1f} dB"
    phase = math.degrees(2 * math.atan(alpha / 2))
    return f"{alpha:.2g}, {gain} or {phase:.0f} deg{_at(case.margins.disk_hz)}" if alpha else "0"


def _at(hz: float) -> str:
    return f" at {hz:.3g} Hz" if hz else ""


def _limit(value: float, unit: str) -> str:
    return "unbounded" if math.isinf(value) else f"{value:.3g}{unit}"


def _onwards(found: LawCertificate, shown: str) -> Iterator[str]:
    """Yield the commands of what would help, and that of a recommendation where the file has a wall."""
    for one in found.remedies:
        if set(one.changes) <= set(_OPTIONS):
            law = {key: value for key, value in {**vars(found.law), **one.changes}.items() if value}
            options = " ".join(f"{_OPTIONS[key]} {value:g}" for key, value in law.items())
            yield f"avc certify {quote(shown)} {options}"
            break
    if found.problem.environment.stiffness_n_per_m:
        yield f"avc recommend {quote(shown)} --out coupling.json"
