"""Units and nouns of a rotary device: one for every key, unit and noun of a linear device.

The equations are the same in SI units, so that the inside of the package knows one set of names, those of a linear
device; a rotary value stands in them unchanged (kg.m2 in ``mass_kg``). Each unit has the same prefixes in both, so that
a text is converted without a look at its numbers: 3 mm is 3 mrad there.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from avc_casadi._errors import InputError, UnsupportedError

MotionKind = Literal["linear", "rotary"]

# Units of a key, as its ending; the longest first.
_ENDINGS = {
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
_NOUNS = {"mass": "inertia", "masses": "inertias", "force": "torque", "forces": "torques"}
# A unit in the middle of a key.
_WORDS = {"metres_per_count": "radians_per_count"}
# Lengths of a rotary device as well.
_LENGTHS = ("handle_radius_m", "capstan_radius_m")
# Keys whose value is a user's own text, or a file.
_OWN_WORDS = {
    "title",
    "source",
    "name",
    "problem",
    "device",
    "file",
    "path",
    "schema",
    "id",
    "written",
    "units",
    "trace",
    "folder",
    "files",
}

# Unit, and its rotary counterpart; N.s/m before N, kN before N.
_UNITS = {
    "N.s/m": "N.m.s/rad",
    "N·s/m": "N·m·s/rad",
    "N s/m": "N.m.s/rad",
    "N/mm": "N.m/mrad",
    "kN/m": "kN.m/rad",
    "MN/m": "MN.m/rad",
    "N/m": "N.m/rad",
    "m/s/N": "rad/s/(N.m)",
    "mm/s": "mrad/s",
    "um/s": "urad/s",
    "m/s": "rad/s",
    "m/N": "rad/(N.m)",
    "kN": "kN.m",
    "mN": "mN.m",
    "N": "N.m",
    "kg": "kg.m2",
    "g": "g.m2",
    "mm": "mrad",
    "um": "urad",
    "\N{MICRO SIGN}m": "\N{MICRO SIGN}rad",
    "m": "rad",
}
# A letter alone is a unit after a number, and in a heading or bracket.
_LETTER = (
    r"(?:(?:(?<=\d )|(?<=\d\] )|(?<=\bin )|(?<=orce ))(?:N|g|m)(?![\w/=·]| =|\.\w)"
    r"|(?:(?<=[(\n])|(?<=, ))(?:N|g|m)(?=\)|,|;|\n|$| [a-z]{2,} of\b))"
)
_TOKEN = re.compile(
    r"(?P<key>(?<![\w/\\])(?<!--)(?:[A-Za-z_]\w*(?:\[\w+\])?\.)*[A-Za-z]\w*?(?:"
    + "|".join(_ENDINGS)
    + r")\b(?!\.(?:toml|json|csv|html|png|svg|pdf|txt|c|h)\b|[/-]))"
    + r"|(?P<option>(?<![\w-])--[a-z]+(?:-[a-z]+)*-(?:m|n|kg|m-per-s)\b(?!-))"
    + r"|(?P<stem>(?<![\w/\\.-])[A-Za-z_]\w*(?:\.[a-z_]\w*)*\.(?:mass|force)_ratio\b|\bmass_ratio\b)"
    + r"|(?P<unit>(?<![\w/.·\\])(?:"
    + "|".join(re.escape(unit) for unit in _UNITS if len(unit) > 2 or unit in {"kN", "mN", "kg", "mm", "um"})
    + r")(?![\w/]|[.·]\w))"
    + rf"|(?P<letter>{_LETTER})"
    + r"|(?P<noun>(?<![\w/\\.-])(?:[Aa] mass|[Mm]ass(?:es)?|[Ff]orces?)\b(?![/\\-]|\.\w|\())"
)


@dataclass(frozen=True)
class Units:
    """Names and units of one kind of motion.

    Attributes:
        motion: linear or rotary.
        own: texts of the user, which stay unchanged.
    """

    motion: MotionKind
    own: tuple[str, ...] = field(default=(), compare=False)

    def beside(self, *own: str) -> Units:
        """Return the same units, with texts of the user, such as the title of a problem, unchanged."""
        return self if self.linear else replace(self, own=(*self.own, *filter(None, own)))

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
        if key in _WORDS:
            return _WORDS[key]
        parts = "_".join(_NOUNS.get(part, part) for part in key.split("_"))
        for ending, other in _ENDINGS.items():
            if parts.endswith(ending):
                return parts.removesuffix(ending) + other
        return parts

    def inner(self, key: str) -> str:
        """Return the internal key: the inverse of `key`."""
        if self.linear:
            return key
        if key in _WORDS.values():
            return next(inner for inner, outer in _WORDS.items() if outer == key)
        parts = "_".join(_SINGLE.get(part, part) for part in key.split("_"))
        for ending, other in _ENDINGS.items():
            if parts.endswith(other):
                return parts.removesuffix(other) + ending
        return parts

    def unit(self, unit: str) -> str:
        """Return the unit of this motion for a linear one: ``N/m`` as ``N.m/rad``."""
        return unit if self.linear else _UNITS.get(unit, unit)

    def text(self, text: str) -> str:
        """Return a text with linear keys, units and nouns in those of this motion."""
        if self.linear or not text:
            return text
        if not self.own:
            return "".join(map(self._line, text.splitlines(keepends=True))) if "   " in text else self._tokens(text)
        names = "|".join(map(re.escape, sorted(self.own, key=len, reverse=True)))
        parts = re.split(rf"(?<!\w)({names})(?!\w)", text)
        return "".join(part if place % 2 else replace(self, own=()).text(part) for place, part in enumerate(parts))

    def page(self, html: str) -> str:
        """Return an HTML page with converted texts; pictures, scripts and styles in it stay unchanged."""
        if self.linear:
            return html
        return "".join(part if kept else self.text(part) for part, kept in _parts(html))

    def code(self, source: str) -> str:
        """Return C or C++ with names and comments of this motion."""
        if self.linear:
            return source
        told = self.text(source)
        for name, other in _MACROS.items():
            told = told.replace(name, other)
        return told

    def document(self, document: Mapping[str, Any]) -> dict[str, Any]:
        """Return JSON values with the names of this motion; a rotary document declares its motion and units."""
        if self.linear:
            return dict(document)
        head = {"motion": self.motion, "units": UNIT_BLOCK}
        return {**{key: value for key, value in head.items() if key not in document}, **self.named(document)}

    def named(self, value: Any) -> Any:
        """Return JSON values with keys and texts of this motion."""
        if self.linear:
            return value
        if isinstance(value, Mapping):
            return {
                self.key(str(key)): item if key in _OWN_WORDS and isinstance(item, str) else self.named(item)
                for key, item in value.items()
            }
        if isinstance(value, list | tuple):
            return [self.named(item) for item in value]
        return self.text(value) if isinstance(value, str) else value

    def keyed(self, value: Any) -> Any:
        """Return tables with the keys of this motion; their values stay unchanged."""
        if self.linear:
            return value
        if isinstance(value, Mapping):
            return {self.key(str(key)): self.keyed(item) for key, item in value.items()}
        return type(value)(map(self.keyed, value)) if isinstance(value, list | tuple) else value

    def read(self, value: Any) -> Any:
        """Return JSON values with the internal keys; texts stay unchanged."""
        if self.linear:
            return value
        if isinstance(value, Mapping):
            return {self.inner(str(key)): self.read(item) for key, item in value.items()}
        return [self.read(item) for item in value] if isinstance(value, list) else value

    def _tokens(self, text: str) -> str:
        return _TOKEN.sub(self._token, text)

    def _line(self, line: str) -> str:
        """Convert a line; values in columns behind their names keep their place."""
        found = _BEHIND.fullmatch(line)
        if found is None:
            return self._tokens(line)
        name, gap, value = found.groups()
        told = self._tokens(name)
        return told + " " * max(2, len(gap) + len(name) - len(told)) + self._tokens(value)

    def _token(self, found: re.Match[str]) -> str:
        word = found[0]
        if found["option"]:
            return "--" + self.key(word[2:].replace("-", "_")).replace("_", "-")
        if found["key"] or found["stem"]:
            return self.key(word)
        if found["noun"]:
            article = "n " if " " in word else ""
            other = _NOUNS[word.split()[-1].lower()]
            return f"{word[0]}{article}{other}" if article else other.capitalize() if word[0].isupper() else other
        return _UNITS[word]


def _parts(html: str) -> Iterator[tuple[str, bool]]:
    last = 0
    for found in _NO_TEXT.finditer(html):
        yield html[last : found.start()], False
        yield found[0], True
        last = found.end()
    yield html[last:], False


_NO_TEXT = re.compile(r"<svg\b.*?</svg>|<script\b.*?</script>|<style\b.*?</style>|data:[^\"'\s]*", re.DOTALL)
# A name, a gap, and one value with its unit.
_BEHIND = re.compile(r"(\s*\S(?:.*?\S)?)( {3,})(\S(?:(?!   ).)*\n?)", re.DOTALL)
_MACROS = {
    "MAX_FORCE_N": "MAX_TORQUE_NM",
    "METRES_PER_COUNT": "RADIANS_PER_COUNT",
    "NEWTONS_AT_FULL_DUTY": "NEWTON_METRES_AT_FULL_DUTY",
    "along the handle's way": "of the handle's angle",
}
_SINGLE = {other: noun for noun, other in _NOUNS.items()}
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
def told_in(units: Units) -> Iterator[None]:
    """Convert errors raised inside to these units."""
    try:
        yield
    except InputError as error:
        if units.linear:
            raise
        raise InputError(
            [replace(one, key=units.text(one.key), message=units.text(one.message)) for one in error.faults]
        ) from error
    except UnsupportedError as error:
        if units.linear:
            raise
        raise UnsupportedError(units.text(str(error)), key=units.text(error.key)) from error


@contextmanager
def speaking(units: Units) -> Iterator[None]:
    """Use these units of output inside."""
    token = _SPOKEN.set(units)
    try:
        yield
    finally:
        _SPOKEN.reset(token)
