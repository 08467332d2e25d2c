"""Results as JSON values: finite numbers, lists and texts; others are null. One walk makes every document.

The keys of a dataclass are the names of its fields. A result whose document has other keys is a `Document` and lists
them. A key that is a number, such as a frequency, has six digits.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from operator import attrgetter
from typing import Any, ClassVar

from avc_casadi._util.units import LINEAR, Units


def plain(value: Any) -> Any:
    """Turn arrays, tuples, mappings, dataclasses and enumerations into JSON values; what is not finite becomes null."""
    if isinstance(value, Document):
        return value.document()
    if isinstance(value, Sentence):
        return str(value)
    if isinstance(value, Enum):
        return plain(value.value)
    if is_dataclass(value):
        value = {field.name: getattr(value, field.name) for field in fields(value)}
    if hasattr(value, "tolist"):  # an array, or a number of one
        value = value.tolist()
    if isinstance(value, dict):
        value = plain_table(value)
    elif isinstance(value, list | tuple):
        value = [plain(item) for item in value]
    elif isinstance(value, float) and not math.isfinite(value):
        value = None
    return value


class Sentence:
    """Base of facts that a document holds as a sentence, their text."""


class Document:
    """Base of results whose document has other keys than the names of their fields.

    Attributes:
        JSON_KEYS: the keys in the order of the document; a pair (key, attribute) where their names differ. An
            attribute of an attribute is written with a dot.
        JSON_LEFT_OUT: those of them that are left out where their value is None.
    """

    JSON_KEYS: ClassVar[tuple[str | tuple[str, str], ...]] = ()
    JSON_LEFT_OUT: ClassVar[frozenset[str]] = frozenset()

    def document(self) -> dict[str, Any]:
        """Return the JSON document: JSON values only."""
        pairs = [entry if isinstance(entry, tuple) else (entry, entry) for entry in self.JSON_KEYS]
        values = {key: attrgetter(attribute)(self) for key, attribute in pairs}
        kept = {key: value for key, value in values.items() if value is not None or key not in self.JSON_LEFT_OUT}
        return plain_table(kept)


def plain_table(table: Mapping[Any, Any]) -> dict[str, Any]:
    """Turn a mapping into JSON values."""
    return {f"{key:g}" if isinstance(key, float) else str(key): plain(item) for key, item in table.items()}


def json_text(document: Mapping[str, Any], units: Units = LINEAR) -> str:
    """Return the text of a JSON file or answer, with the keys of a motion."""
    return json.dumps(units.document(document), indent=1, allow_nan=False) + "\n"
