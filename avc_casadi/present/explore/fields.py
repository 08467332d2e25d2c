"""What the page lets an engineer change: keys of a problem file with the units and ranges of their sliders.

The keys are those inside, which are those of a linear device; a device that turns has its own units and ranges.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any

from avc_casadi._errors import Fault
from avc_casadi._util.units import units_for
from avc_casadi.model.quantity import power_at_handle

if TYPE_CHECKING:
    from avc_casadi._util.units import MotionKind, Units
    from avc_casadi.model.device import Device


@dataclass(frozen=True)
class Field:
    """One value of a problem file on the page."""

    key: str
    group: str
    label: str
    unit: str = ""
    low: float = 0.0
    high: float = 1.0
    scale: str = "linear"
    factor: float = 1.0
    blank: str = ""
    choices: tuple[str, ...] = ()
    start: float | None = None
    folded: bool = False
    turns: bool = False
    whole: bool = False
    whole_of: str = ""


WALL, DETENTS, DEVICE, LOOP, STRUCTURE, KNOWN, HANDS, REAL, RENDERING = (
    "Wall",
    "Detents along the way",
    "Device",
    "Sampling, delay and encoder",
    "Amplifier and resonance",
    "How well the device is known",
    "Hands",
    "What feels real: bounds of the wall",
    "Coupling, model and frequencies",
)
HANDLE = "device.handle_radius_m"
"""Where a hand holds a device that turns."""
RANGES = "device.range."
"""Beginning of the keys of a range, which end in 0 for the lowest value and in 1 for the highest."""


def _ends(name: str, label: str, unit: str, low: float, high: float, scale: str = "linear") -> tuple[Field, Field]:
    """Return the fields of a range of the device; an empty one is the value itself."""
    return tuple(  # type: ignore[return-value]
        Field(f"{RANGES}{name}.{end}", KNOWN, f"{label}, {word}", unit, low, high, scale, 1.0, "as above", folded=True)
        for end, word in ((0, "at least"), (1, "at most"))
    )


FIELDS: tuple[Field, ...] = (
    Field("environment.stiffness_n_per_m", WALL, "stiffness", "N/m", 100, 1e6, "log"),
    Field("environment.damping_ns_per_m", WALL, "damping", "N·s/m", 0, 100),
    Field("detent.force_n", DETENTS, "largest force", "N", 0.05, 5, "log", blank="no detents", folded=True),
    Field("detent.pitch_m", DETENTS, "from one to the next", "mm", 0.5, 50, "log", 1e-3, start=5e-3, folded=True),
    Field("detent.centre_m", DETENTS, "one of them, from the wall", "mm", -10, 10, factor=1e-3, start=0.0, folded=True),
    Field("detent.damping_ns_per_m", DETENTS, "damping", "N·s/m", 0, 5, start=0.0, folded=True),
    Field(HANDLE, DEVICE, "hand holds it at", "mm", 5, 300, "log", factor=1e-3, turns=True),
    Field("device.mass_kg", DEVICE, "mass", "kg", 0.01, 2, "log"),
    Field("device.damping_ns_per_m", DEVICE, "damping", "N·s/m", 0, 20),
    Field("device.coulomb_friction_n", DEVICE, "dry friction", "N", 0, 2),
    Field("device.max_force_n", DEVICE, "largest force", "N", 1, 100, "log", blank="no limit"),
    Field("device.sample_time_s", LOOP, "sample time", "ms", 0.05, 5, "log", factor=1e-3),
    Field("device.delay_samples", LOOP, "delay", "samples", 0, 8),
    Field("device.encoder_resolution_m", LOOP, "encoder step", "µm", 0, 100, factor=1e-6),
    Field("device.amplifier_bandwidth_hz", STRUCTURE, "amplifier", "Hz", 50, 5000, "log", blank="no lag"),
    Field("device.resonance.frequency_hz", STRUCTURE, "resonance", "Hz", 20, 1000, "log", blank="rigid"),
    Field("device.resonance.damping_ratio", STRUCTURE, "its damping ratio", "", 0.005, 0.5, "log", start=0.05),
    Field("device.resonance.mass_ratio", STRUCTURE, "handle's share of mass", "", 0.05, 0.95, start=0.5),
    *_ends("mass_kg", "mass", "kg", 0.01, 2, "log"),
    *_ends("damping_ns_per_m", "damping", "N·s/m", 0, 20),
    *_ends("coulomb_friction_n", "dry friction", "N", 0, 2),
    *_ends("delay_samples", "delay", "samples", 0, 8),
    Field("hands.mass_kg.0", HANDS, "mass, lightest", "kg", 0.01, 1, "log"),
    Field("hands.mass_kg.1", HANDS, "mass, heaviest", "kg", 0.01, 1, "log"),
    Field("hands.damping_ns_per_m.0", HANDS, "damping, least", "N·s/m", 0, 50),
    Field("hands.damping_ns_per_m.1", HANDS, "damping, most", "N·s/m", 0, 50),
    Field("hands.stiffness_n_per_m.0", HANDS, "stiffness, softest", "N/m", 0, 2000),
    Field("hands.stiffness_n_per_m.1", HANDS, "stiffness, stiffest", "N/m", 0, 2000),
    Field("boundaries.upper.stiffness_n_per_m", REAL, "stiffness, at most", "N/m", 100, 1e6, "log", folded=True),
    Field("boundaries.lower.stiffness_n_per_m", REAL, "stiffness, at least", "N/m", 100, 1e6, "log", folded=True),
    Field("boundaries.upper.damping_ns_per_m", REAL, "damping, at most", "N·s/m", 0, 100, folded=True),
    Field("boundaries.lower.damping_ns_per_m", REAL, "damping, at least", "N·s/m", 0, 100, folded=True),
    Field("coupling.structure", RENDERING, "structure", scale="choice", choices=("series", "damped")),
    Field("stability.model", RENDERING, "hold model", scale="choice", choices=("paper", "sampled-data")),
    Field("frequency.start_hz", RENDERING, "lowest frequency", "Hz", 0.1, 100, "log", blank="as listed"),
    Field("frequency.stop_hz", RENDERING, "highest frequency", "Hz", 10, 5000, "log", blank="as listed"),
    Field("frequency.points", RENDERING, "how many", "", 20, 1000, "log", blank="as listed", whole=True),
)
_TYPED = "Typed gains"
GAINS: tuple[Field, ...] = (
    Field("gains.damping_ns_per_m", _TYPED, "damper b", "N·s/m", 0, 100),
    Field("gains.stiffness_n_per_m", _TYPED, "spring k", "N/m", 100, 1e6, "log"),
    Field("gains.contact_damping_ns_per_m", _TYPED, "contact damper b_p", "N·s/m", 0, 100),
)
"""b, k and b_p before a wall."""
OWN: tuple[Field, ...] = (
    Field("own.stiffness_n_per_m", "Your own k and b", "spring k", "N/m", 10, 1e5, "log"),
    Field("own.damping_ns_per_m", "Your own k and b", "damper b", "N·s/m", 0.02, 200, "log"),
    Field("own.local_damping_ns_per_m", "Your own k and b", "damper b_p, everywhere", "N·s/m", 0, 50, blank="none"),
    Field("own.cutoff_hz", "Your own k and b", "filter of the velocity", "Hz", 5, 1000, "log", blank="none"),
)
"""The law of one's own, beside the coupling."""
_PLACE = re.compile(r"\.\d$")


# What ends a key of the problem file: its unit.
_UNIT = re.compile(r"(_rms)?_(kg|ns_per_m|n_per_m|samples|hz|n|m|s)$")
_SQUARE = re.compile(r"(?<=g\Wm)2")
_DOT = re.compile(r"((?<=\bN)|(?<=\b[kMm]N))\.(?=[ms])|(?<=N[.·]m)\.(?=s)|(?<=g)\.(?=m2)")


def page_unit(unit: str, units: Units) -> str:
    """Return a unit as the page writes it: N·m·s/rad, kg·m²."""
    return dotted_units(units.unit(unit))


def dotted_units(text: str) -> str:
    """Return a text with the units in it as the page writes them."""
    return _SQUARE.sub("²", _DOT.sub("·", text))


def words_document(units: Units) -> dict[str, str]:
    """Return the units of the page."""
    return {
        "impedance": page_unit("N·s/m", units),
        "stiffness": page_unit("N/m", units),
        "force": page_unit("N", units),
        "milli": page_unit("mm", units),
    }


def labels_of(keys: Iterable[str], units: Units) -> list[str]:
    """Return keys of a device by the names of their fields, and by their own words where they have none."""
    known = {field.key.removeprefix("device."): field.label for field in FIELDS}
    return [(known.get(key) or units.key(_UNIT.sub("", key)).replace("_", " ")) for key in keys]


def fields_for(device: Device, fields: tuple[Field, ...]) -> tuple[Field, ...]:
    """Return the fields of devices of one motion; sliders of one that turns reach as far as others at its handle."""
    return _fields_for(device.units.motion, device.metres_per_unit, fields)


def fields_document(device: Device, fields: tuple[Field, ...]) -> list[dict[str, Any]]:
    """Return the fields as JSON values."""
    return [asdict(field) for field in fields_for(device, fields)]


@lru_cache
def _fields_for(motion: MotionKind, radius_m: float, fields: tuple[Field, ...]) -> tuple[Field, ...]:
    if motion == "linear":
        return tuple(field for field in fields if not field.turns)
    return tuple(field if field.turns else _turned(field, radius_m) for field in fields)


def _turned(field: Field, radius_m: float) -> Field:
    unit = page_unit(field.unit, units_for("rotary"))
    size = radius_m ** -power_at_handle(_PLACE.sub("", field.key))
    low, high = (float(f"{end * size:.2g}") for end in (field.low, field.high))
    start = None if field.start is None else float(f"{field.start * size:.3g}")
    return replace(field, unit=unit, low=low, high=high, start=start)


_NUMBER = r"[-+]?\d[-+.\de]*"
_PLACE_faults = re.compile(r"\[(\d)\]")
# What a quantity says of itself, with the span of what is allowed.
_REFUSED = re.compile(rf"is (?P<value>{_NUMBER}|\".*\", not a number|None, not a number); allowed: (?P<span>.*)")


def field_faults(
    faults: Iterable[Fault], typed: Iterable[str], device: Device, fields: tuple[Field, ...]
) -> Iterator[Fault]:
    """Yield faults with the key of their field, told in its unit."""
    known = {field.key: field for field in fields_for(device, fields)}
    found = [(_key(fault.key, known, typed), fault) for fault in faults]
    of_wall = any(key.startswith("environment.") for key, _ in found)
    for key, fault in found:
        if not (of_wall and key.startswith("boundaries.") and key not in typed):
            told = _told(fault.message, known.get(key), known)
            yield Fault("", None, key if key in known else device.units.key(key), dotted_units(told))


def _key(key: str, fields: Mapping[str, Field], typed: Iterable[str]) -> str:
    """Return the key of a field; a fault of a pair goes to the place that was typed, or to its first."""
    flat = _PLACE_faults.sub(r".\1", key)
    if flat in fields or f"{flat}.0" not in fields:
        return flat
    return f"{flat}.1" if f"{flat}.1" in typed and f"{flat}.0" not in typed else f"{flat}.0"


def _told(message: str, field: Field | None, fields: Mapping[str, Field]) -> str:
    """Return a message with numbers in the page's unit, and fields by their names there."""
    refused = _REFUSED.fullmatch(message)
    if field is not None and field.factor != 1 and refused:
        converted = partial(re.sub, _NUMBER, lambda found: _in(field, found[0]))
        value = refused["value"] if refused["value"].startswith('"') else converted(refused["value"])
        span = converted(refused["span"])
        message = f"is {value}; allowed: {span}"
    if field is not None and refused:
        message = f"{message} {field.unit}"
    ends = {key.rpartition(".")[2]: field for key, field in fields.items()}
    often = Counter(key.rpartition(".")[2] for key in fields)
    named = {name: field for name, field in ends.items() if often[name] == 1 and "_" in name}
    for name, one in {**fields, **named}.items():
        found = rf"(?<![\w.]){re.escape(name)}(?: = ({_NUMBER}))?(?![\w.]*\w)"
        message = re.sub(found, partial(_label, one), message)
    return message.replace("is None, not a number", "is missing")


def _label(field: Field, found: re.Match[str]) -> str:
    return field.label if found[1] is None else f"{field.label} = {_in(field, found[1])} {field.unit}"


def _in(field: Field, number: str) -> str:
    return f"{float(number) / field.factor:.6g}".replace("e-0", "e-").replace("e+0", "e").replace("e+", "e")
