"""What a recommendation assumes, and declared keys that it does not use, as data. `present` words them."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto
from typing import Literal

from avc_casadi._errors import Fault
from avc_casadi._util.page import Worded


class Assumption(Worded):
    """Base of what a recommendation assumes."""

    @property
    def text(self) -> str:
        """The assumption in words."""
        return str(self)


class Simplification(Assumption, Enum):
    """What every recommendation of a kind assumes."""

    LINEAR_HANDS = auto()
    """Hands are linear, on one axis, and do not change while they hold the device."""
    NO_DETENTS_IN_TRIAL = auto()
    """The trial has no detents; the claims judge their slopes."""
    TOOL_FREE_OR_HELD = auto()
    """The engine's contacts are constraints, and none has an end."""
    STEADY_STEPS_OF_RANGE = auto()
    """The engine's step is steady: each steady step of its range is judged."""
    STEADY_STEP_OF_LIST = auto()
    """The engine's step is steady, any of several; steps that vary are in the trial alone."""
    ENGINE_CLOCK_OF_ITS_OWN = auto()
    """The engine's clock is its own: every phase of its steps in the device's samples is judged."""
    ENGINE_STEPS_OF_DEVICE = auto()
    """The loop of the device starts each step of the engine, at a sample."""
    NO_FRICTION_IN_TRIAL = auto()
    """The trial of a teleoperator has no dry friction, at neither end."""
    ANY_CONTACT = auto()
    """The follower touches anything from nothing to a rigid object."""
    CONTACT_DAMPING = auto()
    """What the follower touches is damped by a tenth of the critical damping."""
    EVEN_LINK = auto()
    """The link is even: no jitter and no lost messages are declared."""


class UndeclaredValue(Enum):
    """What a device does not declare, each with a value that is assumed."""

    AMPLIFIER_BANDWIDTH = auto()
    RESONANCE = auto()
    DRY_FRICTION = auto()
    ENCODER_RESOLUTION = auto()
    FORCE_LIMIT = auto()


@dataclass(frozen=True)
class Undeclared(Assumption):
    """A value that a device does not declare.

    Attributes:
        missing: which value.
        device: which of two devices; empty where there is one.
    """

    missing: UndeclaredValue
    device: Literal["", "leader", "follower"] = ""


@dataclass(frozen=True)
class RangeTried(Assumption):
    """How a range of the device is judged.

    Attributes:
        key: of the range, in the names of the device's motion.
        linear: whether linear stability is judged at its corners.
        devices: number of devices of the ranges that other hands try; 1 where only the nominal one is tried.
    """

    key: str
    linear: bool
    devices: int


@dataclass(frozen=True)
class Slip(Assumption):
    """A value that was perhaps not meant.

    Attributes:
        doubt: the key, in the names of the device's motion, and what is unusual.
    """

    doubt: Fault

    @property
    def text(self) -> str:
        """The key, and what is unusual."""
        return f"{self.doubt.key} {self.doubt.message}"


class WhyUnused(Enum):
    """Why a declared key has no part in a recommendation."""

    OF_SOLVE = auto()
    """It asks something of the other methods, which weakens no verdict."""
    ENCODER_AT_HANDLE = auto()
    """An encoder at the handle does not see it."""
    LAW = auto()
    """It is a law of one's own, for other verbs."""
    SIMULATED_ALONE = auto()
    """It is an effect of a scene."""
    SIMULATED_AND_RENDERED_ALONE = auto()
    """It is an effect of a scene and of the region of walls."""
    OF_WALL = auto()
    """It belongs to a wall in the device's own loop."""
    OF_SCENE = auto()
    """It belongs to a scene with this end."""
    OF_SCENE_WITHOUT_END = auto()
    """It belongs to a scene, and scenes do not have this end."""
    NO_SPRING_TOUCHED = auto()
    """It belongs to a contact with a spring, and the tool touches none."""
    NO_TOOL = auto()
    """It belongs to a tool, and no tool_mass_kg is given."""
    NOT_OF_TELEOPERATORS = auto()
    """The trial of a teleoperator has none."""


@dataclass(frozen=True)
class Unused(Worded):
    """A declared key that no candidate, certificate or trial uses.

    Attributes:
        key: the key, in the names of the device's motion, or the name of its table.
        why: why it is not used.
        end: kind of the end, where that is why.
    """

    key: str
    why: WhyUnused
    end: str = ""

    @property
    def asked_of_solve(self) -> bool:
        """Whether it asks something of other methods, which weakens no verdict."""
        return self.why is WhyUnused.OF_SOLVE
