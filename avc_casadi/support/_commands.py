"""Commands in texts, as somebody copies them."""

from __future__ import annotations

import re

_OF_PROBLEM = re.compile(r"\b(avc [a-z][a-z0-9-]*) P\b")


def with_problem(text: str, problem: str) -> str:
    """Return a text whose commands name the problem in place of ``P``.

    Args:
        text: plain or HTML.
        problem: file, or name of the catalogue.
    """
    return _OF_PROBLEM.sub(lambda found: f"{found[1]} {problem}", text)
