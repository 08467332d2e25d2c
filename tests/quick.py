"""Which cases of a test run in the README's command; the others are marked slow, and `.ci/run` runs them too."""

from collections.abc import Iterable
from typing import Any

import pytest


def first(cases: Iterable[Any], count: int = 1) -> list[Any]:
    """Return the cases of a parameter, or of several in tuples, with all but the first `count` marked slow."""
    listed = list(cases)
    later = (case if isinstance(case, tuple) else (case,) for case in listed[count:])
    return [*listed[:count], *(pytest.param(*case, marks=pytest.mark.slow) for case in later)]
