"""Keys and units of a device that turns: one for each of a linear device, whose names the package uses inside.

A rotary value stands unchanged in them: kg.m2 in ``mass_kg``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

MotionKind = Literal["linear", "rotary"]
Quantity = Literal[
    "damping",
    "stiffness",
    "integral",
    "speed",
    "mass",
    "frequency",
    "force",
    "length",
    "time",
    "energy",
    "phase",
    "gain",
    "samples",
    "steps",
    "share",
    "number",
]
"""What a value measures."""

# Endings of keys; the longest first.
_ENDINGS = {
    "_ns2_per_m2": "_nms2_per_rad2",
    "_ns_per_m": "_nms_per_rad",
    "_n_per_m_s": "_nm_per_rad_s",
    "_m_per_s": "_rad_per_s",
    "_m_per_n": "_rad_per_nm",
    "_m_per_s2": "_rad_per_s2",
    "_n_per_m": "_nm_per_rad",
    "_n_per_s": "_nm_per_s",
    "_kg": "_kgm2",
    "_mm": "_mrad",
    "_um": "_urad",
    "_n": "_nm",
    "_m": "_rad",
}
# A unit in the middle of a key.
_WORDS = {"metres_per_count": "radians_per_count"}
_NOUNS = {"mass": "inertia", "masses": "inertias", "force": "torque", "forces": "torques"}
_UNITS = {
    "N.s/m": "N.m.s/rad",
    "N·s/m": "N·m·s/rad",
    "N/m": "N.m/rad",
    "N/m/s": "N.m/rad/s",
    "m/s": "rad/s",
    "N": "N.m",
    "kg": "kg.m2",
    "m": "rad",
    "mm": "mrad",
    "um": "urad",
    "\N{MICRO SIGN}m": "\N{MICRO SIGN}rad",
}
# The same tables from a rotary device to a linear one.
_LINEAR_WORDS = {rotary: linear for linear, rotary in _WORDS.items()}
_LINEAR_NOUNS = {rotary: linear for linear, rotary in _NOUNS.items()}
_LINEAR_ENDINGS = {rotary: linear for linear, rotary in _ENDINGS.items()}
RADII = ("handle_radius_m", "capstan_radius_m")
"""Keys that are lengths of a rotary device as well."""


@dataclass(frozen=True)
class Units:
    """Names and units of one kind of motion."""

    motion: MotionKind

    @property
    def linear(self) -> bool:
        """Whether names are the internal ones."""
        return self.motion == "linear"

    def key(self, key: str) -> str:
        """Return the key of this motion for a linear one, dotted or not: ``mass_kg`` as ``inertia_kgm2``."""
        if self.linear or key in RADII:
            return key
        if "." in key:
            return ".".join(map(self.key, key.split(".")))
        return _exchanged(key, _WORDS, _NOUNS, _ENDINGS)

    def inner(self, key: str) -> str:
        """Return the internal key: the inverse of `key`."""
        return key if self.linear else _exchanged(key, _LINEAR_WORDS, _LINEAR_NOUNS, _LINEAR_ENDINGS)

    def unit(self, unit: str) -> str:
        """Return the unit of this motion for a linear one: ``N/m`` as ``N.m/rad``."""
        return unit if self.linear else _UNITS.get(unit, unit)

    def words(self, text: str) -> str:
        """Return a message with its keys in this motion; what is quoted stays as it is."""
        return text if self.linear else _KEY.sub(lambda match: self.key(match[0]), text)

    def document(self, document: Mapping[str, Any]) -> dict[str, Any]:
        """Return JSON values with the names of this motion; a rotary document declares its motion and units."""
        if self.linear:
            return dict(document)
        return {"motion": self.motion, "units": UNIT_BLOCK} | dict(self.keyed(document))

    def keyed(self, value: Any) -> Any:
        """Return tables with the keys of this motion; their values stay unchanged."""
        return value if self.linear else _renamed(value, self.key)

    def read(self, value: Any) -> Any:
        """Return JSON values with the internal keys; texts stay unchanged."""
        return value if self.linear else _renamed(value, self.inner)


def _exchanged(key: str, words: Mapping[str, str], nouns: Mapping[str, str], endings: Mapping[str, str]) -> str:
    """Return a key with its word, its nouns and its ending exchanged."""
    if key in words:
        return words[key]
    parts = "_".join(nouns.get(part, part) for part in key.split("_"))
    ending = next((ending for ending in endings if parts.endswith(ending)), "")
    return parts.removesuffix(ending) + endings.get(ending, "")


def _renamed(value: Any, name: Callable[[str], str]) -> Any:
    """Return JSON values with every key renamed."""
    if isinstance(value, Mapping):
        return {name(str(key)): _renamed(item, name) for key, item in value.items()}
    if isinstance(value, list):
        return [_renamed(item, name) for item in value]
    if isinstance(value, tuple):
        return tuple(_renamed(item, name) for item in value)
    return value


_KEY = re.compile(r'(?<!["\w.])[a-z0-9]+(?:[_.][a-z0-9]+)*_[a-z0-9_.]*[a-z0-9]\b(?!")')
LINEAR = Units("linear")
ROTARY = Units("rotary")
UNIT_BLOCK = {
    "position": "rad",
    "velocity": "rad/s",
    "torque": "N.m",
    "inertia": "kg.m2",
    "damping": "N.m.s/rad",
    "stiffness": "N.m/rad",
    "impedance": "N.m.s/rad",
    "time": "s",
    "frequency": "Hz",
    "energy": "J",
}
"""Units of a rotary device, as in documents."""


def units_for(motion: MotionKind) -> Units:
    """Return the units of a kind of motion."""
    return LINEAR if motion == "linear" else ROTARY
