"""The numbers of the generated tick that depend on its figures: an array a part, so that an image can be given others.

The same expressions are built for two sets of figures without any round number, and compared: where the constants
differ they depend on the figures and go into the array, in place of the literal.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi import UnsupportedError
from avc_hardware._figures import RuntimeFigures
from avc_hardware._runtime_program import RuntimeProgram, runtime_programs

if TYPE_CHECKING:
    from avc_casadi._util.arrays import Float32Array

SAMPLE_TIMES_S = (5e-5, 1 / 300)
"""Sample times that one program serves: below, a tick has too few cycles; above, the estimator has fewer resonators."""

# No two numbers of the tick are equal by chance at these: T, encoder step, hold, slew, guard, reach of the handle.
_GENERIC = (
    (1.03719e-3, 5.3713e-5, 0.21371, 19.3717, 2.17137, 0.87731),
    (0.71933e-3, 8.1371e-5, 0.17933, 23.1733, 3.31973, 1.13937),
)


@dataclass(frozen=True)
class Template:
    """A part of the tick without its figures.

    Attributes:
        part: the program, with figures that stand for any.
        constants: place in the program of each number of the array.
        starts: index of the state whose start is each number that follows in the array.
    """

    part: RuntimeProgram
    constants: tuple[int, ...]
    starts: tuple[int, ...]

    @property
    def size(self) -> int:
        """How many numbers the array has."""
        return len(self.constants) + len(self.starts)

    def numbers(self, part: RuntimeProgram) -> Float32Array | None:
        """Return the array of a program for certain figures, shape (size,); None where its form is another."""
        found = self.part.program.constants_of(part.program)
        if found is None or part.states != self.part.states:
            return None
        fixed = self.part.program.constants_of(self.part.program) or {}
        if any(found[place] != value for place, value in fixed.items() if place not in self.constants):
            return None
        starts = [part.initial[index][0] for index in self.starts]
        return np.array([*(found[place] for place in self.constants), *starts], dtype=np.float32)


def templates(figures: RuntimeFigures) -> tuple[Template, ...]:
    """Return the parts that a processor runs, whatever the numbers of the figures."""
    return _templates(figures.estimator, figures.slew_per_s is not None, figures.passive)


def _run(figures: RuntimeFigures) -> list[RuntimeProgram]:
    return [part for part in runtime_programs(figures) if part.name != "couple"]


@functools.lru_cache(maxsize=8)
def _templates(estimator: str, slews: bool, passive: bool) -> tuple[Template, ...]:
    parts = [
        _run(RuntimeFigures(time, step, estimator, hold, slew if slews else None, passive, guard, reach))
        for time, step, hold, slew, guard, reach in _GENERIC
    ]
    made = []
    for one, other in zip(*parts, strict=True):
        own, its = one.program.constants_of(one.program), one.program.constants_of(other.program)
        if own is None or its is None:
            raise UnsupportedError(f"the figures change the form of {one.name}, not its numbers alone")
        constants = tuple(sorted(place for place in own if own[place] != its[place]))
        pairs = enumerate(zip(one.initial, other.initial, strict=True))
        starts = tuple(index for index, (first, second) in pairs if first[0] != second[0])
        made.append(Template(one, constants, starts))
    return tuple(made)


def constants(figures: RuntimeFigures) -> dict[str, Float32Array]:
    """Return the array of each part by its symbol in an image.

    Raises:
        UnsupportedError: a sample time, or other figures, that would need another program.
    """
    low, high = SAMPLE_TIMES_S
    time_s = figures.sample_time_s
    if not low * (1 - 1e-9) <= time_s <= high * (1 + 1e-9):
        raise UnsupportedError(
            f"the packaged firmware has no program for a sample time of {time_s:g} s; allowed: {low:g} to {high:.6g} "
            "s; for others export the coupling as C: avc export",
            key="device.sample_time_s",
        )
    found = {}
    for template, part in zip(templates(figures), _run(figures), strict=True):
        numbers = template.numbers(part)
        if numbers is None:
            raise UnsupportedError(
                f"{figures} change the form of the tick's part {part.name}; change one of them by a thousandth, or "
                "export the coupling as C: avc export"
            )
        found[f"avc_{part.name}_constants"] = numbers
    return found
