"""Text in generated C: a comment and a name are made of allowed characters alone, so that no text becomes code."""

from __future__ import annotations

import re
import textwrap

from avc_casadi import InputError

# Neither * nor \ nor ?: without them no comment ends or begins, no line goes on in the next, no trigraph is either.
_FOREIGN = re.compile(r"[^A-Za-z0-9 .,:;()\[\]+=<>%_'/-]")
# In small letters, since macros have its name in capitals; a linker of C99 may tell 31 characters apart.
_NAME = re.compile(r"[a-z]([a-z0-9_]{0,18}[a-z0-9])?")
_WIDTH = 115


def comment(text: str) -> str:
    """Return any text as one line of a comment; what is not allowed there becomes a low line."""
    return _FOREIGN.sub("_", " ".join(text.split()))


def comment_lines(text: str) -> str:
    """Return any text as lines of a comment, each after the first behind a star."""
    return "\n * ".join(textwrap.wrap(comment(text), _WIDTH))


def checked_name(name: str) -> str:
    """Return what the names of an exported coupling begin with.

    Raises:
        InputError: it is no beginning of a name in C.
    """
    if not _NAME.fullmatch(name):
        told = f"is {name!r}; allowed: a small letter, then small letters and digits with low lines between, at most 20"
        raise InputError.of(told, key="name")
    return name
