"""Whole numbers that a call is given: hands, seeds, draws and processes, each within its range."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Integral

from avc_casadi._errors import Fault, InputError

IN_MEMORY = 100_000
"""Most hands of a call that keeps the simulation of each in memory, some 50 kB."""
IN_BLOCKS = 100_000_000
"""Most hands of a call that keeps of each no more than whether it rests."""


@dataclass(frozen=True)
class Count:
    """An option that counts, with the least and the largest value that it may have."""

    key: str
    value: object
    least: int
    most: int

    @property
    def allowed(self) -> bool:
        """Whether the value is a whole number of the range; True and False are none."""
        if isinstance(self.value, bool) or not isinstance(self.value, Integral):
            return False
        return self.least <= int(self.value) <= self.most


def hands_count(value: object, most: int = IN_MEMORY) -> Count:
    """Return a number of simulated hands."""
    return Count("hands", value, 1, most)


def seed_count(value: object) -> Count:
    """Return a seed of random numbers, of 32 bits as the compiled simulation takes it."""
    return Count("seed", value, 0, 2**32 - 1)


def workers_count(value: object) -> Count:
    """Return a number of processes; an operating system refuses far more than a thousand."""
    return Count("workers", value, 1, 1000)


def refuse_counts(*counts: Count) -> None:
    """Refuse every count that is no whole number of its range.

    Raises:
        InputError: with all of them.
    """
    faults = [
        Fault("", None, count.key, f"is {count.value!r}; allowed: a whole number from {count.least} to {count.most}")
        for count in counts
        if not count.allowed
    ]
    if faults:
        raise InputError(faults)
