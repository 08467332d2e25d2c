"""The device along a normal: one axis whose mass is the effective one, from its free to its held end."""

from __future__ import annotations

from typing import TYPE_CHECKING

from avc_casadi._errors import InputError
from avc_casadi.files.device_file import DeviceFile, Sources
from avc_casadi.model.device import Device

if TYPE_CHECKING:
    from avc_casadi.arm.arm import Arm

_DIGITS = 5
# Heavier than any tip; a pose that cannot move is not designed for.
_HEAVIEST_KG = 1e3


def tip_device(arm: Arm, lightest_kg: float, heaviest_kg: float) -> Device:
    """Return the device of one axis, its mass between two ends; nominal is the middle of the ratios.

    Args:
        arm: the arm.
        lightest_kg: tangent free.
        heaviest_kg: tangent held.

    Raises:
        InputError: an end is not finite, which a singular pose has.
    """
    if not 0 < lightest_kg <= heaviest_kg < _HEAVIEST_KG:
        raise InputError.of(
            f"weighs {lightest_kg:.4g} to {heaviest_kg:.4g} kg, a singular pose; take another or a smaller workspace",
            key="workspace",
        )
    ends = tuple(float(f"{end:.{_DIGITS}g}") for end in (lightest_kg, heaviest_kg))
    tables = arm.file.device.model_dump(exclude_unset=True, exclude={"mass_kg"})
    nominal = float(f"{(lightest_kg * heaviest_kg) ** 0.5:.{_DIGITS}g}")
    ranges = {**tables.pop("range", {}), "mass_kg": (ends[0], ends[1])}
    return Device.model_validate({"mass_kg": min(max(nominal, ends[0]), ends[1]), **tables, "range": ranges})


def tip_device_file(arm: Arm, lightest_kg: float, heaviest_kg: float, where: str) -> DeviceFile:
    """Return that device as a device file, which a problem file names.

    Args:
        arm: the arm.
        lightest_kg: tangent free.
        heaviest_kg: tangent held.
        where: poses and normals that the ends stand for, for title and source.
    """
    device, name = tip_device(arm, lightest_kg, heaviest_kg), arm.file.name or "the arm"
    stated = device.model_fields_set | device.range.model_fields_set
    told = {"grade": "assumed", "source": f"as the arm file of {name} states it"}
    weighed = {
        "grade": "computed",
        "source": f"effective mass of {name}, {where}: 1/(n' L^-1 n) with the tangent free to n' L n with it held",
    }
    keys = list(Sources.model_fields)
    return DeviceFile.model_validate(
        {
            "name": "device",
            "title": f"{arm.file.title or name}: {where}",
            "device": device,
            "gaps": [key for key in keys if key not in stated],
            "sources": {key: weighed if key == "mass_kg" else told for key in keys if key in stated},
        }
    )
