"""What the annotation of a key allows: tables, and lists of choices."""

from __future__ import annotations

import typing
from collections.abc import Iterator
from typing import Any, TypeVar

from pydantic import BaseModel

M = TypeVar("M", bound=BaseModel)


def inside(annotation: Any) -> Iterator[Any]:
    """Yield an annotation and all in it: tables, validators and lists of choices."""
    yield annotation
    if typing.get_origin(annotation) is not typing.Literal:
        for inner in typing.get_args(annotation):
            yield from inside(inner)


def choices_of(annotation: Any) -> list[Any]:
    """Return the values that an annotation lists."""
    lists = (part for part in inside(annotation) if typing.get_origin(part) is typing.Literal)
    return [value for literal in lists for value in typing.get_args(literal)]


def tables_of(annotation: Any, kind: type[M]) -> list[type[M]]:
    """Return the tables of a kind that an annotation allows."""
    return [part for part in inside(annotation) if isinstance(part, type) and issubclass(part, kind)]
