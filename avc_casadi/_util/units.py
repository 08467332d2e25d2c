"""The words of a device that turns: every key, unit and noun of a linear device has one for it.

The equations are the same in SI units, so that everything below the edges of the package knows one set of names, those
of a linear device; a value of a device that turns stands in them unchanged (kg.m2 in ``mass_kg``). Each unit has the
same prefixes in both, so that a text is put into the other words without a look at its numbers: 3 mm is 3 mrad there.
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
# A word in the middle of a key that is a unit.
_WORDS = {"metres_per_count": "radians_per_count"}
# Lengths of a device that turns as well.
_LENGTHS = ("handle_radius_m", "capstan_radius_m")
# Keys whose value is a user's own word, or a file.
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

# Unit, and what it is for a device that turns; N.s/m before N, kN before N.
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
# A letter alone is a unit after a number, and where a heading or bracket holds it.
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
        own: words of the user, which stay as they are in every text.
    """

    motion: MotionKind
    own: tuple[str, ...] = field(default=(), compare=False)

    def beside(self, *own: str) -> Units:
        """Return the same words beside those of the user, such as the title of a problem."""
        return self if self.linear else replace(self, own=(*self.own, *filter(None, own)))

    @property
    def linear(self) -> bool:
        """Whether everything is named as it is inside."""
        return self.motion == "linear"

    def key(self, key: str) -> str:
        """Return what a key of a linear device is called, dotted or not: ``mass_kg`` as ``inertia_kgm2``."""
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
        """Return what a key is called inside: the inverse of `key`."""
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
        """Return what stands for a unit of a linear device: ``N/m`` as ``N.m/rad``."""
        return unit if self.linear else _UNITS.get(unit, unit)

    def text(self, text: str) -> str:
        """Return a text for people, in the words of a linear device, with keys, units and nouns of this motion."""
        if self.linear or not text:
            return text
        if not self.own:
            return "".join(map(self._line, text.splitlines(keepends=True))) if "   " in text else self._tokens(text)
        names = "|".join(map(re.escape, sorted(self.own, key=len, reverse=True)))
        parts = re.split(rf"(?<!\w)({names})(?!\w)", text)
        return "".join(part if place % 2 else replace(self, own=()).text(part) for place, part in enumerate(parts))

    def page(self, html: str) -> str:
        """Return an HTML page with its texts so; pictures, scripts and styles in it stay as they are."""
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
        """Return JSON values with the names of this motion; one of a device that turns says so, and its units."""
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
        """Return tables with the keys of this motion; their values stay as they are."""
        if self.linear:
            return value
        if isinstance(value, Mapping):
            return {self.key(str(key)): self.keyed(item) for key, item in value.items()}
        return type(value)(map(self.keyed, value)) if isinstance(value, list | tuple) else value

    def read(self, value: Any) -> Any:
        """Return JSON values with the keys that are used inside; texts stay as they are."""
        if self.linear:
            return value
        if isinstance(value, Mapping):
            return {self.inner(str(key)): self.read(item) for key, item in value.items()}
        return [self.read(item) for item in value] if isinstance(value, list) else value

    def _tokens(self, text: str) -> str:
        return _TOKEN.sub(self._token, text)

    def _line(self, line: str) -> str:
        """Put a line into words; values that stand below each other behind their names stay there."""
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
"""Units of a device that turns, as a document tells them."""

_SPOKEN: ContextVar[Units] = ContextVar("units", default=LINEAR)


def units_for(motion: MotionKind) -> Units:
    """Return the words of a kind of motion."""
    return LINEAR if motion == "linear" else ROTARY


def spoken() -> Units:
    """Return the words in which the command at work answers; those of a linear device where none said otherwise."""
    return _SPOKEN.get()


def speak(units: Units) -> None:
    """Let the command at work, or what else runs in this context, answer in other words from here on."""
    _SPOKEN.set(units)


@contextmanager
def told_in(units: Units) -> Iterator[None]:
    """Put the errors that are raised inside into these words."""
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
    """Answer in these words inside."""
    token = _SPOKEN.set(units)
    try:
        yield
    finally:
        _SPOKEN.reset(token)
