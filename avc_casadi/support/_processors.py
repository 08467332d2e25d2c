"""How many processors there are for the threads of this process."""

from __future__ import annotations

import os

_AT_MOST: list[int] = []


def processors() -> int:
    """Return how many processors this process may use, 1 or more: a worker beside others has its share of them."""
    there = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min([there, *_AT_MOST])


def use_at_most(count: int) -> None:
    """Leave the other processors to others."""
    _AT_MOST[:] = [count]
