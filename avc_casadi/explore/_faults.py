"""Faults of a problem file in the words of the page: beside their fields, in the units of these."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from functools import partial

from avc_casadi._errors import Fault
from avc_casadi.explore._fields import FIELDS, KEYS, Field

_NUMBER = r"[-+]?\d[-+.\de]*"
_PLACE = re.compile(r"\[(\d)\]")
# What a quantity says of itself, with the span of what is allowed.
_REFUSED = re.compile(rf"is (?P<value>{_NUMBER}|\".*\", not a number); allowed: (?P<span>.*) \w+")
_FIELD = {field.key: field for field in FIELDS}
# A key without its table means the one field that ends so.
_ENDS = [field.key.rpartition(".")[2] for field in FIELDS]
_NAMED = {name: field for field, name in zip(FIELDS, _ENDS, strict=True) if _ENDS.count(name) == 1 and "_" in name}


def on_page(faults: Iterable[Fault], typed: Iterable[str]) -> Iterator[Fault]:
    """Yield faults with the key of their field, told in its unit.

    Args:
        faults: of a problem.
        typed: keys that were changed on the page; bounds that only follow the wall are its fault alone.
    """
    found = [(_key(fault.key), fault) for fault in faults]
    of_wall = any(key.startswith("environment.") for key, _ in found)
    for key, fault in found:
        if not (of_wall and key.startswith("boundaries.") and key not in typed):
            yield Fault("", None, key, _told(fault.message, _FIELD.get(key)))


def _key(key: str) -> str:
    """Return the key of a field; a fault of a pair goes to its first place."""
    flat = _PLACE.sub(r".\1", key)
    return flat if flat in KEYS or f"{flat}.0" not in KEYS else f"{flat}.0"


def _told(message: str, field: Field | None) -> str:
    """Return a message with numbers in the page's unit, and fields by their names there."""
    refused = _REFUSED.fullmatch(message)
    if field is not None and field.factor != 1 and refused:
        value, span = (re.sub(_NUMBER, lambda found: _in(field, found[0]), refused[part]) for part in ("value", "span"))
        message = f"is {value}; allowed: {span} {field.unit}"
    for name, one in {**_FIELD, **_NAMED}.items():
        named = rf"(?<![\w.]){re.escape(name)}(?: = ({_NUMBER}))?(?![\w.]*\w)"
        message = re.sub(named, partial(_label, one), message)
    return message.replace("N.s/m", "N·s/m").replace("is None, not a number", "is missing")


def _label(field: Field, found: re.Match[str]) -> str:
    return field.label if found[1] is None else f"{field.label} = {_in(field, found[1])} {field.unit}"


def _in(field: Field, number: str) -> str:
    return f"{float(number) / field.factor:.6g}".replace("e-0", "e-").replace("e+0", "e").replace("e+", "e")
