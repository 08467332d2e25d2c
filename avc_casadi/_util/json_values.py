"""Results as JSON values: finite numbers, lists and texts; others are null."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import is_dataclass
from enum import Enum
from typing import Any

from avc_casadi._util.units import LINEAR, Units


def plain(value: Any) -> Any:
    """Turn arrays, tuples, mappings, dataclasses and enumerations into JSON values; what is not finite becomes null."""
    if is_dataclass(value):
        value = vars(value)
    if hasattr(value, "tolist"):  # an array, or a number of one
        value = value.tolist()
    if isinstance(value, dict):
        return plain_table(value)
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, Enum):
        return plain(value.value)
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def plain_table(table: Mapping[Any, Any]) -> dict[str, Any]:
    """Turn a mapping into JSON values."""
    return {str(key): plain(item) for key, item in table.items()}


def json_text(document: Mapping[str, Any], units: Units = LINEAR) -> str:
    """Return the text of a JSON file or answer, with the keys of a motion."""
    return json.dumps(units.document(document), indent=1, allow_nan=False) + "\n"
