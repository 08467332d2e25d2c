"""Results as JSON values: finite numbers, lists and texts; others are null."""

from __future__ import annotations

import json
import math
from enum import Enum
from typing import Any

import numpy as np

from avc_casadi._util.units import spoken


def plain(value: Any) -> Any:
    """Turn arrays, tuples, mappings and enumerations into JSON values; a number that is not finite becomes null."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, Enum):
        return plain(value.value)
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def json_text(document: Any) -> str:
    """Return the text of a JSON file or answer, in the current units."""
    if isinstance(document, dict):
        document = spoken().document(document)
    return json.dumps(document, indent=1, allow_nan=False) + "\n"
