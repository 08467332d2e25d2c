"""A device that turns is identified as the linear one that is felt at its handle; what was found is that of the turn.

All that tells a small number from a large one is then the same for a knob, a wheel and a slide: it is judged where the
hand is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from avc_casadi._errors import InputError
from avc_casadi._util.units import MotionKind, units_for
from avc_casadi.files.device_file import DeviceFile
from avc_casadi.files.rotary_keys import power_at_handle
from avc_casadi.identification.model import Estimate, Identification, Refusal, Shown
from avc_casadi.identification.record import Record

_ALLOWED = "0.002 to 10 m"


def radius_of(records: Sequence[Record], base: DeviceFile | None, handle_radius_m: float | None) -> float | None:
    """Return how far the handle goes for each radian of the logs; None of a device that does not turn.

    Args:
        records: of one device.
        base: what is known of it.
        handle_radius_m: as the user says, else that of the base.

    Raises:
        InputError: it turns and nothing says where the hand holds it, or logs and base move in different ways.
    """
    motion: MotionKind = records[0].motion
    if any(one.motion != motion for one in records):
        raise InputError.of("are of a device that turns and of one that does not; allowed: one kind", key="logs")
    if base is not None and base.device.motion != motion:
        logs, device = ("rad and N.m", "a length") if motion == "rotary" else ("metres and newtons", "an angle")
        raise InputError.of(
            f"are in {logs}, and the position of {base.name} is {device}; allowed: a base of the logs' motion"
            + ("; behind a capstan of radius r log x = r theta and F = tau/r" if motion == "rotary" else ""),
            key="logs",
        )
    if motion == "linear":
        if handle_radius_m is not None:
            raise InputError.of("says nothing of logs in metres; allowed: beside logs in rad", key="handle_radius_m")
        return None
    radius = handle_radius_m or (None if base is None else base.device.handle_radius_m)
    if radius is None:
        raise InputError.of(
            f"are of a device that turns, and nothing says where the hand holds it; allowed: --handle-radius-m R "
            f"({_ALLOWED}), or a base with handle_radius_m",
            key="logs",
        )
    if not 2e-3 <= radius <= 10:
        raise InputError.of(f"is {radius:g}; allowed: {_ALLOWED}", key="handle_radius_m")
    return radius


def known_at_handle(known: Mapping[str, float], radius_m: float) -> dict[str, float]:
    """Return values of the turn, by key, as those at its handle."""
    return {key: value * radius_m ** power_at_handle(key) for key, value in known.items()}


def of_the_turn(found: Identification, radius_m: float) -> Identification:
    """Return what was found at a handle as that of the device that turns.

    Args:
        found: in metres and newtons at the handle.
        radius_m: how far it goes for each radian.
    """
    units = units_for("rotary")
    return replace(
        found,
        motion="rotary",
        handle_radius_m=radius_m,
        estimates={key: _estimate(one, radius_m) for key, one in found.estimates.items()},
        refused=tuple(_refusal(one, radius_m) for one in found.refused),
        error_rms_m=found.error_rms_m / radius_m,
        error_m=found.error_m / radius_m,
        notes=tuple(map(units.text, found.notes)),
        response=replace(found.response, velocity_per_force=found.response.velocity_per_force / radius_m**2),
        modelled=found.modelled / radius_m**2,
        shown=tuple(_shown(one, radius_m) for one in found.shown),
    )


def _estimate(one: Estimate, radius_m: float) -> Estimate:
    by = radius_m ** -power_at_handle(one.key)
    unit = units_for("rotary").unit(one.unit)
    return replace(one, unit=unit, value=one.value * by, low=one.low * by, high=one.high * by)


def _refusal(one: Refusal, radius_m: float) -> Refusal:
    if one.bounds is None:
        return one
    value, low, high = (each * radius_m ** -power_at_handle(one.key) for each in one.bounds)
    return replace(one, bounds=(value, low, high))


def _shown(one: Shown, radius_m: float) -> Shown:
    return replace(
        one,
        measured_m=one.measured_m / radius_m,
        simulated_m=one.simulated_m / radius_m,
        force_n=one.force_n * radius_m,
    )
