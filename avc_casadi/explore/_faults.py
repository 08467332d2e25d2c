"""Faults of a problem file in the words of the page: beside their fields, in the units of these."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING

from avc_casadi._errors import Fault
from avc_casadi.explore._fields import FIELDS, KEYS, Field, dotted_units, fields_for

if TYPE_CHECKING:
    from avc_casadi.problem import Device

_NUMBER = r"[-+]?\d[-+.\de]*"
_PLACE = re.compile(r"\[(\d)\]")
# What a quantity says of itself, with the span of what is allowed.
_REFUSED = re.compile(rf"is (?P<value>{_NUMBER}|\".*\", not a number); allowed: (?P<span>.*) \w+")
_ENDS = [field.key.rpartition(".")[2] for field in FIELDS]


def on_page(faults: Iterable[Fault], typed: Iterable[str], device: Device) -> Iterator[Fault]:
    """Yield faults with the key of their field, told in its unit.

    Args:
        faults: of a problem.
        typed: keys that were changed on the page; bounds that only follow the wall are its fault alone.
        device: one of the motion that the page speaks of.
    """
    fields, units = {field.key: field for field in fields_for(device)}, device.units
    found = [(_key(fault.key), fault) for fault in faults]
    of_wall = any(key.startswith("environment.") for key, _ in found)
    for key, fault in found:
        if not (of_wall and key.startswith("boundaries.") and key not in typed):
            told = _told(fault.message, fields.get(key), fields)
            yield Fault("", None, key if key in KEYS else units.text(key), dotted_units(units.text(told)))


def _key(key: str) -> str:
    """Return the key of a field; a fault of a pair goes to its first place."""
    flat = _PLACE.sub(r".\1", key)
    return flat if flat in KEYS or f"{flat}.0" not in KEYS else f"{flat}.0"


def _told(message: str, field: Field | None, fields: Mapping[str, Field]) -> str:
    """Return a message with numbers in the page's unit, and fields by their names there."""
    refused = _REFUSED.fullmatch(message)
    if field is not None and field.factor != 1 and refused:
        converted = partial(re.sub, _NUMBER, lambda found: _in(field, found[0]))
        # What is no number stands as it was typed.
        value = refused["value"] if refused["value"].startswith('"') else converted(refused["value"])
        span = converted(refused["span"])
        message = f"is {value}; allowed: {span} {field.unit}"
    # A key without its table means the one field that ends so.
    ends = {key.rpartition(".")[2]: field for key, field in fields.items()}
    named = {name: field for name, field in ends.items() if _ENDS.count(name) == 1 and "_" in name}
    for name, one in {**fields, **named}.items():
        found = rf"(?<![\w.]){re.escape(name)}(?: = ({_NUMBER}))?(?![\w.]*\w)"
        message = re.sub(found, partial(_label, one), message)
    return message.replace("is None, not a number", "is missing")


def _label(field: Field, found: re.Match[str]) -> str:
    return field.label if found[1] is None else f"{field.label} = {_in(field, found[1])} {field.unit}"


def _in(field: Field, number: str) -> str:
    return f"{float(number) / field.factor:.6g}".replace("e-0", "e-").replace("e+0", "e").replace("e+", "e")
