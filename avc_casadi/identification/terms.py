"""Parameters of a device model, the rungs that add them, and the coordinates of the search."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.model.device import CURRENT_LOOP_DAMPING_RATIO

QuantityName = Literal["mass", "damping", "stiffness", "force", "length", "frequency", "samples", "number"]

OFFSET = "offset_n"
"""Key of the constant force."""
FRICTION = "coulomb_friction_n"
LOOP_RATIO = "amplifier_damping_ratio"
"""Key of the damping ratio of a current loop."""
MASS_RATIO = "resonance.mass_ratio"
FORCES = (FRICTION, OFFSET)
"""Parameters that are forces on the motor, in the order in which a sample takes them."""
HIGHEST_RESONANCE = 0.45
"""Share of the sample rate up to which a resonance is identifiable."""
_LARGEST_EXPONENT = 500.0
"""Exponents of a search that strays are clipped here: exp(500) is finite."""


@dataclass(frozen=True)
class Parameter:
    """A parameter: its key, what it measures, the coordinate of its search, and its bounds in SI units.

    The search coordinate q of a value v is ln(v) of a "log", v over a unit of the log of a "linear", and
    ln(v/(1 - v)) of a "share".
    """

    name: str
    quantity: QuantityName
    kind: Literal["log", "linear", "share"]
    lowest: float
    highest: float


PARAMETERS: Mapping[str, Parameter] = {
    parameter.name: parameter
    for parameter in (
        Parameter("mass_kg", "mass", "log", 1e-9, 1e6),
        Parameter("damping_ns_per_m", "damping", "linear", 0.0, 1e7),
        Parameter("delay_samples", "samples", "linear", 0.0, 24.0),
        Parameter(OFFSET, "force", "linear", -math.inf, math.inf),
        Parameter(FRICTION, "force", "linear", 0.0, 1e6),
        Parameter("amplifier_bandwidth_hz", "frequency", "log", 1.0, 1e5),
        Parameter(LOOP_RATIO, "number", "log", 0.2, 5.0),
        Parameter("resonance.frequency_hz", "frequency", "log", 1.0, 1e5),
        Parameter("resonance.damping_ratio", "number", "log", 1e-4, 2.0),
        Parameter(MASS_RATIO, "number", "share", 1e-3, 0.999),
        Parameter("stiffness_n_per_m", "stiffness", "linear", 0.0, 1e7),
    )
}
RUNGS: Mapping[str, tuple[str, ...]] = {
    "rigid": ("mass_kg", "damping_ns_per_m", "delay_samples", OFFSET),
    "friction": (FRICTION,),
    "lag": ("amplifier_bandwidth_hz",),
    "loop": ("amplifier_bandwidth_hz", LOOP_RATIO),
    "resonance": ("resonance.frequency_hz", "resonance.damping_ratio", MASS_RATIO),
    "spring": ("stiffness_n_per_m",),
}
"""What each rung adds; an amplifier is a lag, or a current loop of the second order."""


def offset_of(log: int) -> str:
    """Return the key of the constant force of a log, counted from 0."""
    return OFFSET if log == 0 else f"log_{log + 1}.{OFFSET}"


def is_force(name: str) -> bool:
    """Return whether a parameter is dry friction or a constant force, which the linear part does not hold."""
    return name == FRICTION or name.endswith(OFFSET)


@dataclass(frozen=True)
class ModelStructure:
    """The rungs of a model, and parameters that are fixed.

    `units` are the units of "linear" coordinates by key, in SI units; 1 where none is given. `offsets` is the number
    of constant forces, one for each log, or 1 for all.
    """

    rungs: tuple[str, ...]
    units: Mapping[str, float]
    encoder_at: Literal["motor", "handle"] = "motor"
    fixed: Mapping[str, float] = field(default_factory=dict)
    offsets: int = 1

    @property
    def free(self) -> tuple[Parameter, ...]:
        """Free parameters, in the order of the search coordinates."""
        of_rungs = [PARAMETERS[name] for rung in self.rungs for name in RUNGS[rung] if name not in self.fixed]
        offset_count = 1 if OFFSET in self.fixed else self.offsets
        of_later_logs = [replace(PARAMETERS[OFFSET], name=offset_of(log)) for log in range(1, offset_count)]
        return (*of_rungs, *of_later_logs)

    @property
    def names(self) -> list[str]:
        """Names of the free parameters."""
        return [parameter.name for parameter in self.free]

    @property
    def order(self) -> Literal[1, 2]:
        """Order of the amplifier."""
        return 2 if "loop" in self.rungs else 1

    def present(self, name: str) -> bool:
        """Whether a parameter belongs to the rungs, fixed or free."""
        return any(name in RUNGS[rung] for rung in self.rungs)

    def values(self, search: FloatArray) -> dict[str, float]:
        """Return every parameter at given coordinates, shape (free,); absent ones have no effect."""
        values = dict.fromkeys(PARAMETERS, 0.0)
        values |= dict.fromkeys(("amplifier_bandwidth_hz", *RUNGS["resonance"]), math.nan)
        values |= {"mass_kg": 1.0, LOOP_RATIO: CURRENT_LOOP_DAMPING_RATIO}
        values |= {name: value for name, value in self.fixed.items() if self.present(name)}
        for parameter, q in zip(self.free, search, strict=True):
            values[parameter.name] = self.outward(parameter, float(q))
        return values

    def _unit(self, parameter: Parameter) -> float:
        """Return the unit of a linear coordinate; the constant forces of all logs share theirs."""
        key = OFFSET if parameter.name.endswith(OFFSET) else parameter.name
        return self.units.get(key, 1.0)

    def outward(self, parameter: Parameter, q: float) -> float:
        """Return the value at a search coordinate, in SI units."""
        if parameter.kind == "log":
            return math.exp(_clipped_exponent(q))
        if parameter.kind == "share":
            return 1 / (1 + math.exp(_clipped_exponent(-q)))
        return q * self._unit(parameter)

    def inward(self, parameter: Parameter, value: float) -> float:
        """Return the search coordinate of a value, clipped to its bounds."""
        value = min(max(value, parameter.lowest), parameter.highest)
        if parameter.kind == "log":
            return math.log(value)
        if parameter.kind == "share":
            return math.log(value / (1 - value))
        return value / self._unit(parameter)

    def start(self, values: Mapping[str, float]) -> FloatArray:
        """Return the search coordinates of given values, shape (free,)."""
        return np.array([self.inward(parameter, values[parameter.name]) for parameter in self.free])

    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Return the lower and upper bounds of the search, each of shape (free,)."""
        low = np.array([self.inward(parameter, parameter.lowest) for parameter in self.free])
        high = np.array([self.inward(parameter, parameter.highest) for parameter in self.free])
        return low, high

    def with_rung(self, rung: str) -> ModelStructure:
        """Return the structure with one more rung."""
        rungs = {*self.rungs, rung}
        return replace(self, rungs=tuple(name for name in RUNGS if name in rungs))

    def without(self, rung: str) -> ModelStructure:
        """Return the structure without a rung."""
        return replace(self, rungs=tuple(name for name in self.rungs if name != rung))


def _clipped_exponent(exponent: float) -> float:
    return min(max(exponent, -_LARGEST_EXPONENT), _LARGEST_EXPONENT)
