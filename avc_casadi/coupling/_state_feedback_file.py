"""Observer and state feedback in a gain or coupling file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from avc_casadi._errors import Fault, InputError
from avc_casadi.problem import STATE_FEEDBACK_KEYS, StateFeedback, StateFeedbackEffect, effect_of


def state_feedback_of(found: object, path: Path, key: str) -> StateFeedback | None:
    """Read them from JSON values, by the rules of the scene's effect.

    Args:
        found: the values; None where there are none.
        path: file that they are from.
        key: where they stand in it.

    Raises:
        InputError: with every fault.
    """
    if found is None:
        return None
    if not isinstance(found, Mapping):
        raise InputError.of("must be a table or null", file=str(path), key=key)
    values: Mapping[str, Any] = found
    table = effect_of(StateFeedbackEffect, values, file=str(path), key=key)
    try:
        return StateFeedback(**{name: getattr(table, name) for name in STATE_FEEDBACK_KEYS})
    except InputError as error:
        raise InputError([Fault(str(path), None, f"{key}.{one.key}", one.message) for one in error.faults]) from None
