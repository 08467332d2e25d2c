"""How results print and word themselves: presentation stands above results, so the package sets who shows them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from avc_casadi._util.json_values import Sentence
from avc_casadi._util.units import LINEAR, Units

_present: Callable[[], Any]
"""Returns the module with `text_of` of a result and `sentence` of a fact; set once, when the package is imported."""


def print_by(present: Callable[[], Any]) -> None:
    """Set the function that returns the module by which results print and facts are worded."""
    global _present  # noqa: PLW0603 - set once, when the package is imported
    _present = present


def printed(result: object) -> str:
    """Return a result as its command prints it."""
    text: str = _present().text_of(result)
    return text


class Worded(Sentence):
    """Base of facts that presentation words."""

    def __str__(self) -> str:
        return worded(self)


def worded(fact: object, units: Units = LINEAR) -> str:
    """Return a fact as a sentence, its values in the units of a device."""
    sentence: str = _present().sentence(fact, units)
    return sentence
