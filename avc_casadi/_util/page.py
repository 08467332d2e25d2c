"""How results print themselves: presentation stands above results, so the package sets the function that shows them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

_text_of: Callable[[Any], str] = repr


def print_by(text_of: Callable[[Any], str]) -> None:
    """Set the function that returns a result as its command prints it."""
    global _text_of  # noqa: PLW0603 - set once, when the package is imported
    _text_of = text_of


def printed(result: object) -> str:
    """Return a result as its command prints it."""
    return _text_of(result)
