"""Terms of a device model, their parameters, and the coordinates of the search."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.units import FORCE, KG, M_PER_S, MASS, METRE, N_PER_M, NEWTON, NS2_PER_M2, NS_PER_M, Wording
from avc_casadi.model.device import CURRENT_LOOP_DAMPING_RATIO

Kind = Literal["log", "linear", "share"]
Part = Literal["drive", "loop", "friction", "sensing"]

LONGEST_DELAY = 24.0


@dataclass(frozen=True)
class Parameter:
    """One parameter that a log may identify.

    Attributes:
        name: with its unit, as in a device file where it stands there.
        unit: as printed.
        kind: search coordinate: the logarithm, the value itself, or the logit of a share.
        lowest, highest: bounds.
        part: of the model that it belongs to: what the amplifier makes of the command, the linear loop, friction and
            constant force, or the measurement.
    """

    name: str
    unit: str | Wording
    kind: Kind
    lowest: float
    highest: float
    part: Part = "loop"


@dataclass(frozen=True)
class Term:
    """Parameters that are added and removed together.

    Attributes:
        name: of the term.
        words: name in a sentence.
        parameters: its parameters.
        needs: terms that it depends on.
    """

    name: str
    words: str | Wording
    parameters: tuple[Parameter, ...]
    needs: tuple[str, ...] = ()


LOOP_DAMPING, LOOP_RATIO = "loop-damping", "amplifier_damping_ratio"
"""The damping ratio of a second-order amplifier: term and parameter."""

_INF = math.inf
_FAR = 500.0
TERMS: Mapping[str, Term] = {
    term.name: term
    for term in (
        Term(
            "base",
            Wording.of(lambda: f"{MASS}, viscous damping, delay and a constant {FORCE}"),
            (
                Parameter("mass_kg", KG, "log", 1e-5, 1e5),
                Parameter("damping_ns_per_m", NS_PER_M, "linear", 0.0, 1e7),
                Parameter("delay_samples", "samples", "linear", 0.0, LONGEST_DELAY),
                Parameter("offset_n", NEWTON, "linear", -_INF, _INF, part="friction"),
            ),
        ),
        Term(
            "coulomb",
            "Coulomb friction",
            (Parameter("coulomb_friction_n", NEWTON, "linear", 0.0, 1e5, part="friction"),),
        ),
        Term(
            "asymmetry",
            "damping that depends on the direction",
            (Parameter("damping_asymmetry_ns_per_m", NS_PER_M, "linear", -1e7, 1e7, part="friction"),),
        ),
        Term(
            "stribeck",
            "Stribeck friction",
            (
                Parameter("breakaway_excess_n", NEWTON, "linear", 0.0, 1e5, part="friction"),
                Parameter("stribeck_speed_m_per_s", M_PER_S, "log", 1e-5, 10.0, part="friction"),
            ),
            ("coulomb",),
        ),
        Term(
            "dead-zone",
            "a dead zone of the amplifier",
            (Parameter("dead_zone_n", NEWTON, "linear", 0.0, 1e5, part="drive"),),
        ),
        Term(
            "drag",
            "drag that grows with the square of the speed",
            (Parameter("drag_ns2_per_m2", NS2_PER_M2, "linear", 0.0, 1e7, part="friction"),),
        ),
        Term(
            "resonance",
            "a resonance between motor and handle",
            (
                Parameter("resonance.frequency_hz", "Hz", "log", 1.0, 1e5),
                Parameter("resonance.damping_ratio", "", "log", 1e-4, 2.0),
                Parameter("resonance.mass_ratio", "", "share", 1e-3, 0.999),
            ),
        ),
        Term("amplifier", "an amplifier's bandwidth", (Parameter("amplifier_bandwidth_hz", "Hz", "log", 1.0, 1e5),)),
        Term(
            LOOP_DAMPING,
            "the damping ratio of the current loop",
            (Parameter(LOOP_RATIO, "", "log", 0.2, 5.0),),
            ("amplifier",),
        ),
        Term(
            "stiffness",
            "a spring to ground (a hand, a cable, gravity along an arc)",
            (Parameter("stiffness_n_per_m", N_PER_M, "linear", 0.0, 1e6),),
        ),
        Term(
            "drift",
            Wording.of(lambda: f"a constant {FORCE} that drifts"),
            (Parameter("offset_drift_n_per_s", "N/s", "linear", -_INF, _INF, part="friction"),),
        ),
        Term(
            "play",
            "play that the encoder stands behind",
            (Parameter("backlash_m", METRE, "linear", 0.0, 1.0, part="sensing"),),
        ),
        Term("scale", Wording.of(lambda: f"a scale of the {FORCE}"), (Parameter("force_scale", "", "log", 1e-3, 1e3),)),
    )
}

# Values at which an absent term has no effect.
_ABSENT = {
    "mass_kg": 1.0,
    "resonance.frequency_hz": math.nan,
    "resonance.damping_ratio": math.nan,
    "resonance.mass_ratio": math.nan,
    "amplifier_bandwidth_hz": math.nan,
    "stribeck_speed_m_per_s": 1.0,
    "force_scale": 1.0,
}
FRICTION = tuple(one.name for term in TERMS.values() for one in term.parameters if one.part == "friction")
LINEAR = tuple(one.name for term in TERMS.values() for one in term.parameters if one.part == "loop")
PARAMETERS = {one.name: one for term in TERMS.values() for one in term.parameters}


def words_of(terms: Sequence[str], amplifier_order: int) -> str:
    """Return the terms of a model as a phrase.

    Args:
        terms: names of TERMS.
        amplifier_order: of the amplifier, if there is one.
    """
    order = " (a current loop of the second order)" if amplifier_order != 1 else ""
    return ", ".join(f"{TERMS[term].words}{order if term == 'amplifier' else ''}" for term in terms)


OFFSET, PLAY, DEAD_ZONE, DRAG = "offset_n", "backlash_m", "dead_zone_n", "drag_ns2_per_m2"
SIZE_OF = {
    "stribeck": "breakaway_excess_n",
    "stiffness": "stiffness_n_per_m",
    "coulomb": "coulomb_friction_n",
    "play": PLAY,
    "dead-zone": DEAD_ZONE,
    "drag": DRAG,
}
"""The parameter that is 0 where a term is absent."""
HIGHEST_SEEN = 0.45
"""Share of the sample rate up to which a resonance is identifiable."""


def offset_of(log: int) -> str:
    """Return the key of the constant force of a log, counted from 0."""
    return OFFSET if log == 0 else f"log_{log + 1}.{OFFSET}"


def lag_of(order: int, damping_ratio: float) -> float:
    """Return the lag of an amplifier at low frequencies, in radians at its bandwidth.

    Args:
        order: 1, or 2 for a current loop.
        damping_ratio: of a current loop.
    """
    return 1.0 if order == 1 else 2 * damping_ratio


@dataclass(frozen=True)
class Structure:
    """Model structure: the terms, and what is known beforehand.

    Attributes:
        terms: names of TERMS, base first.
        known: fixed values.
        units: scale of each linear parameter in the search.
        encoder_at: the side of the resonance on which the position is measured.
        assumed: values that the log does not identify and the model needs.
        amplifier_order: 1, a lag; 2, a current loop.
        loop_damping_ratio: of a current loop where it is not a term.
        logs: number of logs; each has a constant force of its own, which depends on pose and amplifier.
    """

    terms: tuple[str, ...]
    known: Mapping[str, float]
    units: Mapping[str, float]
    encoder_at: Literal["motor", "handle"] = "motor"
    assumed: Mapping[str, float] = field(default_factory=dict)
    amplifier_order: Literal[1, 2] = 1
    loop_damping_ratio: float = CURRENT_LOOP_DAMPING_RATIO
    logs: int = 1

    @property
    def free(self) -> tuple[Parameter, ...]:
        """Free parameters."""
        held = {*self.known, *self.assumed}
        found = tuple(one for term in self.terms for one in TERMS[term].parameters if one.name not in held)
        if OFFSET in held:
            return found
        return (*found, *(replace(PARAMETERS[OFFSET], name=offset_of(log)) for log in range(1, self.logs)))

    def present(self, name: str) -> bool:
        """Whether a parameter belongs to the terms, fixed or free."""
        return any(one.name == name for term in self.terms for one in TERMS[term].parameters)

    def values(self, search: FloatArray) -> dict[str, float]:
        """Return every parameter of all terms at given coordinates; absent terms have no effect."""
        found = {name: _ABSENT.get(name, 0.0) for name in PARAMETERS} | dict(self.known)
        found[LOOP_RATIO] = self.loop_damping_ratio
        found |= {name: value for name, value in self.assumed.items() if self.present(name)}
        for one, q in zip(self.free, search, strict=True):
            found[one.name] = self.outward(one, float(q))
        return found

    def outward(self, one: Parameter, q: float) -> float:
        """Return the value at a search coordinate."""
        if one.kind == "log":
            return math.exp(min(max(q, -_FAR), _FAR))
        if one.kind == "share":
            return 1 / (1 + math.exp(min(max(-q, -_FAR), _FAR)))
        return q * self._unit(one)

    def _unit(self, one: Parameter) -> float:
        return self.units.get(OFFSET if one.name.endswith(OFFSET) else one.name, 1.0)

    def inward(self, one: Parameter, value: float) -> float:
        """Return the search coordinate of a value, clipped to its bounds."""
        value = min(max(value, one.lowest), one.highest)
        if one.kind == "log":
            return math.log(value)
        if one.kind == "share":
            return math.log(value / (1 - value))
        return value / self._unit(one)

    def start(self, values: Mapping[str, float]) -> FloatArray:
        """Return the search coordinates of given values."""
        return np.array([self.inward(one, values[one.name]) for one in self.free])

    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Return the bounds of the search."""
        ends = [(self.inward(one, one.lowest), self.inward(one, one.highest)) for one in self.free]
        low, high = np.array(ends).T
        return low, high

    def slopes(self, search: FloatArray) -> FloatArray:
        """Return d value / d coordinate, shape (free,)."""
        slopes = []
        for one, q in zip(self.free, search, strict=True):
            value = self.outward(one, float(q))
            slope = {"log": value, "share": value * (1 - value), "linear": self._unit(one)}[one.kind]
            slopes.append(slope)
        return np.array(slopes)

    def admits(self, term: str) -> bool:
        """Whether a term is new and its dependencies are present."""
        return term not in self.terms and all(need in self.terms for need in TERMS[term].needs)

    def less(self, term: str) -> Structure:
        """Return the structure without a term and those that depend on it."""
        gone = {term, *(one for one in self.terms if term in TERMS[one].needs)}
        return replace(self, terms=tuple(one for one in self.terms if one not in gone))

    def ordered(self, terms: Sequence[str]) -> tuple[str, ...]:
        """Return terms in the order of TERMS."""
        return tuple(name for name in TERMS if name in terms)
