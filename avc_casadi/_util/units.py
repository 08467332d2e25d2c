"""Keys and units of a device that turns: one for each of a linear device, whose names the package uses inside.

A rotary value stands unchanged in them: kg.m2 in ``mass_kg``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from functools import wraps
from typing import Any, Literal, TypeVar, cast

from avc_casadi._errors import InputError, UnsupportedError

MotionKind = Literal["linear", "rotary"]

# Endings of keys; the longest first.
_ENDINGS = {
    "_ns2_per_m2": "_nms2_per_rad2",
    "_ns_per_m": "_nms_per_rad",
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
# Lengths of a rotary device as well.
_LENGTHS = ("handle_radius_m", "capstan_radius_m")


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
        if self.linear or key in _LENGTHS:
            return key
        if "." in key:
            return ".".join(map(self.key, key.split(".")))
        return _exchanged(key, _WORDS, _NOUNS, _ENDINGS)

    def option(self, option: str) -> str:
        """Return the option of this motion for a linear one: ``--force-n`` as ``--torque-nm``."""
        return "--" + self.key(option.removeprefix("--").replace("-", "_")).replace("_", "-")

    def inner(self, key: str) -> str:
        """Return the internal key: the inverse of `key`."""
        return key if self.linear else _exchanged(key, *map(_inverse, (_WORDS, _NOUNS, _ENDINGS)))

    def unit(self, unit: str) -> str:
        """Return the unit of this motion for a linear one: ``N/m`` as ``N.m/rad``."""
        return unit if self.linear else _UNITS.get(unit, unit)

    def words(self, text: str) -> str:
        """Return a message with its keys in this motion; what is quoted stays as it is."""
        return text if self.linear else _KEY.sub(lambda found: self.key(found[0]), text)

    def code(self, source: str) -> str:
        """Return C or C++ whose names are of this motion; its comments are written in it already."""
        if self.linear:
            return source
        return _NAME.sub(lambda found: self.key(found[0]), source).replace("MAX_FORCE_N", "MAX_TORQUE_NM")

    def document(self, document: Mapping[str, Any]) -> dict[str, Any]:
        """Return JSON values with the names of this motion; a rotary document declares its motion and units."""
        if self.linear:
            return dict(document)
        head = {"motion": self.motion, "units": UNIT_BLOCK}
        return {**{key: value for key, value in head.items() if key not in document}, **self.keyed(document)}

    def keyed(self, value: Any) -> Any:
        """Return tables with the keys of this motion; their values stay unchanged."""
        return value if self.linear else _renamed(value, self.key)

    def read(self, value: Any) -> Any:
        """Return JSON values with the internal keys; texts stay unchanged."""
        return value if self.linear else _renamed(value, self.inner)


def _exchanged(key: str, words: Mapping[str, str], nouns: Mapping[str, str], endings: Mapping[str, str]) -> str:
    if key in words:
        return words[key]
    parts = "_".join(nouns.get(part, part) for part in key.split("_"))
    ending = next((ending for ending in endings if parts.endswith(ending)), "")
    return parts.removesuffix(ending) + endings.get(ending, "")


def _inverse(names: Mapping[str, str]) -> dict[str, str]:
    return {other: name for name, other in names.items()}


def _renamed(value: Any, name: Callable[[str], str]) -> Any:
    if isinstance(value, Mapping):
        return {name(str(key)): _renamed(item, name) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return (list if isinstance(value, list) else tuple)(_renamed(item, name) for item in value)
    return value


_KEY = re.compile(r'(?<!["\w.])[a-z0-9]+(?:[_.][a-z0-9]+)*_[a-z0-9_.]*[a-z0-9]\b(?!")')
# A name in C, by its ending; a file's name is none.
_NAME = re.compile(rf"(?<![\w/])[A-Za-z]\w*?(?:{'|'.join(_ENDINGS)})\b(?!\.[ch]\b|[/-])")
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

F = TypeVar("F", bound=Callable[..., Any])
R = TypeVar("R")
_SPOKEN: ContextVar[Units] = ContextVar("units", default=LINEAR)


def units_for(motion: MotionKind) -> Units:
    """Return the units of a kind of motion."""
    return LINEAR if motion == "linear" else ROTARY


def spoken() -> Units:
    """Return the current units of output; linear by default."""
    return _SPOKEN.get()


def speak(units: Units) -> None:
    """Set the units of output of this context from here on."""
    _SPOKEN.set(units)


@contextmanager
def speaking(units: Units) -> Iterator[None]:
    """Use these units of output inside; errors raised there name their keys so."""
    token = _SPOKEN.set(units)
    try:
        yield
    except InputError as error:
        if units.linear:
            raise
        raise InputError([replace(one, key=units.key(one.key)) for one in error.faults]) from error
    except UnsupportedError as error:
        error.key = units.key(error.key)
        raise
    finally:
        _SPOKEN.reset(token)


def speaks(units: Units, function: Callable[..., R], *args: Any, **options: Any) -> R:
    """Call a function that uses these units of output."""
    with speaking(units):
        return function(*args, **options)


def in_its_units(function: F) -> F:
    """Decorate a function of what has units, which it then speaks in."""

    @wraps(function)
    def told(*args: Any, **options: Any) -> Any:
        # What has no units is refused by the function itself.
        units = getattr(next(iter((*args, *options.values())), None), "units", spoken())
        return speaks(units, function, *args, **options)

    return cast("F", told)


@dataclass(frozen=True)
class Wording:
    """A unit, a noun or a sentence of these: printed as that of the motion that is spoken of."""

    linear: str
    rotary: str

    @classmethod
    def of(cls, sentence: Callable[[], str]) -> Wording:
        """Return a sentence in both wordings, for a constant of a module."""
        with speaking(LINEAR):
            linear = sentence()
        with speaking(ROTARY):
            return cls(linear, sentence())

    def __str__(self) -> str:
        return self.linear if spoken().linear else self.rotary

    def __format__(self, form: str) -> str:
        return format(str(self), form)


def spoken_key(key: str) -> str:
    """Return a key or an option in the names of the motion that is spoken of: ``device.mass_kg``, ``--force-n``."""
    return spoken().option(key) if key.startswith("--") else spoken().key(key)


NS_PER_M = Wording("N.s/m", "N.m.s/rad")
NS2_PER_M2 = Wording("N.s2/m2", "N.m.s2/rad2")
N_DOT_S_PER_M = Wording("N·s/m", "N·m·s/rad")
N_PER_M = Wording("N/m", "N.m/rad")
KN_PER_M = Wording("kN/m", "kN.m/rad")
M_PER_S_PER_N = Wording("m/s/N", "rad/s/(N.m)")
M_PER_S = Wording("m/s", "rad/s")
MM_PER_S = Wording("mm/s", "mrad/s")
NEWTON = Wording("N", "N.m")
KG = Wording("kg", "kg.m2")
METRE = Wording("m", "rad")
MM = Wording("mm", "mrad")
UM = Wording("um", "urad")
MICROMETRE = Wording("\N{MICRO SIGN}m", "\N{MICRO SIGN}rad")

MASS = Wording("mass", "inertia")
MASSES = Wording("masses", "inertias")
A_MASS = Wording("a mass", "an inertia")
FORCE = Wording("force", "torque")
FORCES = Wording("forces", "torques")
CAP_FORCE = Wording("Force", "Torque")

_NOUNS = {noun.linear: noun.rotary for noun in (MASS, MASSES, FORCE, FORCES)}
_UNITS = {
    unit.linear: unit.rotary
    for unit in (NS_PER_M, N_DOT_S_PER_M, N_PER_M, M_PER_S, NEWTON, KG, METRE, MM, UM, MICROMETRE)
}
