"""English of the verdict on your own law: what is not sound of a stable one, what is beyond a limit of another."""

from __future__ import annotations

from avc_casadi._util.page import worded
from avc_casadi._util.units import Units
from avc_casadi.claims.law_analysis import SpringDamper
from avc_casadi.claims.law_limits import BeyondLimit, LimitSide
from avc_casadi.claims.own_law import LawCertificate
from avc_casadi.loops.margins import LEAST_DISK, SOUND_DISK
from avc_casadi.loops.plant_family import PlantFamily
from avc_casadi.model.control_law import ControlLaw
from avc_casadi.model.device import Device
from avc_casadi.present.row import beyond_limit, quantity_of
from avc_casadi.present.rows.pieces import GAINS


def law_clauses(certificate: LawCertificate, units: Units) -> tuple[str, ...]:
    """Return what decides on a law."""
    if certificate.leans:
        return ("comes to rest by dry friction alone",)
    if certificate.stable:
        return (_doubts(certificate),)
    if certificate.detent is not None and not certificate.detent.passed:
        return (worded(certificate.detent, units),)
    plain_law = isinstance(certificate.law, SpringDamper)
    unstable = _unstable(certificate)
    if not certificate.limited:
        return (unstable,)
    return (f"{unstable}: {_plain_cause(certificate, units) if plain_law else _cause(certificate, units)}",)


def _unstable(certificate: LawCertificate) -> str:
    """Return that a law is unstable, and which loop is where the other one is stable: with a hand, or released."""
    held, released, free = certificate.held, certificate.released, certificate.free
    if released is None or held.stable == released.stable or (free is not None and not free.stable):
        return "unstable"
    return "unstable when released, stable with every hand" if held.stable else "unstable with a hand"


def _doubts(certificate: LawCertificate) -> str:
    """Return what is not sound of a stable law."""
    doubts = []
    if certificate.disk_margin < SOUND_DISK:
        how = "thin" if certificate.passed else f"below {LEAST_DISK}"
        doubts.append(f"a disk margin of {certificate.disk_margin:.2g} is {how}")
    if not certificate.quiet:
        through = "b" if isinstance(certificate.law, SpringDamper) else "the law"
        doubts.append(f"noise of the position vibrates the handle through {through}")
    if doubts:
        return f"stable, but {', and '.join(doubts)}"
    held = any(certificate.held.hand.values())
    return f"stable {'with every hand and released' if held else 'released; no hand holds the device'}"


def _plain_cause(certificate: LawCertificate, units: Units) -> str:
    """Return which number of an unstable spring and damper is beyond which limit."""
    beyond = certificate.beyond
    ranges = ", over [device.range]" if PlantFamily.of(certificate.problem).device_ranges else ""
    late = f"{_late(certificate.problem.device)}{ranges}"
    if beyond.side is LimitSide.NONE_STABLE:
        return f"no damper b stabilises this k {late}"
    name, value, limit = _value_and_limit(beyond, units)
    if beyond.side is LimitSide.BELOW:
        needing = "b" if name == "k" else "k"
        return f"{name} {value} is below the {limit} that this {needing} needs {late}"
    outside = " outside the wall" if beyond.side is LimitSide.ABOVE_OUTSIDE else ""
    return f"{name} {value} is above its largest{outside}, {limit}, {late}"


def _late(device: Device) -> str:
    """Return the delay and the rate of a device."""
    plural = "" if device.delay_samples == 1 else "s"
    return f"with {device.delay_samples:g} sample{plural} of delay at {1 / device.sample_time_s:g} Hz"


def _cause(certificate: LawCertificate, units: Units) -> str:
    """Return which number of an unstable law of several pieces is beyond which limit."""
    beyond, late = certificate.beyond, _late(certificate.problem.device)
    if isinstance(certificate.law, ControlLaw) and certificate.law.friction_compensation is not None:
        late += ", without friction"
    if beyond.side is LimitSide.NONE_STABLE:
        return f"no change of a single number makes the law stable {late}"
    return f"{_beyond(beyond, units)}, {late}"


def beyond_clauses(beyond: BeyondLimit, units: Units) -> tuple[str, ...]:
    """Return which number of an unstable law is beyond which limit."""
    if beyond.side is LimitSide.NONE_STABLE:
        return ("no change of a single number of the law stabilises the loop",)
    return (_beyond(beyond, units),)


def _beyond(beyond: BeyondLimit, units: Units) -> str:
    """Return a number and the limit that it is beyond."""
    side = "below its lowest" if beyond.side is LimitSide.BELOW else "above its largest"
    name, value, limit = _value_and_limit(beyond, units)
    return f"{name} {value} is {side}, {limit}"


def _value_and_limit(beyond: BeyondLimit, units: Units) -> tuple[str, str, str]:
    """Return name, value and limit of a number as texts."""
    is_lower = beyond.side is LimitSide.BELOW
    value, limit = beyond_limit(beyond.value, beyond.limit, quantity_of(beyond.key), is_lower=is_lower)
    name = GAINS.get(beyond.key, units.key(beyond.key))
    return name if units.linear else name.replace("mass", "inertia"), value.text(units), limit.text(units)
