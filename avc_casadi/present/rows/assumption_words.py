"""English of what a recommendation assumes, and of declared keys that it does not use."""

from __future__ import annotations

from functools import singledispatch

from avc_casadi._util.units import Units
from avc_casadi.recommendation.assumptions import (
    Assumption,
    RangeTried,
    Simplification,
    Slip,
    Undeclared,
    UndeclaredValue,
    Unused,
    WhyUnused,
)

_SIMPLIFICATIONS = {
    Simplification.LINEAR_HANDS: "hands are linear, on one axis, and do not change while they hold the device",
    Simplification.NO_DETENTS_IN_TRIAL: (
        "simulated hands feel no detents; the claims cover the slopes of detents, and avc simulate includes detents"
    ),
    Simplification.TOOL_FREE_OR_HELD: (
        "the engine's contacts are rigid: the tool moves freely or stands still; for springs state a range of stiffness"
    ),
    Simplification.STEADY_STEPS_OF_RANGE: (
        "the engine's step is steady: every steady step within the range of step_s is judged"
    ),
    Simplification.STEADY_STEP_OF_LIST: (
        "the engine's step is steady, any of step_s; only simulated hands try steps of varying length"
    ),
    Simplification.ENGINE_CLOCK_OF_ITS_OWN: (
        "the engine has a clock of its own: every phase of its steps against the samples is judged; state "
        'simulation.clock = "device" if the device\'s loop starts each step'
    ),
    Simplification.ENGINE_STEPS_OF_DEVICE: (
        "the device's loop starts each step of the engine, at a sample: on a clock of its own less is stable"
    ),
    Simplification.NO_FRICTION_IN_TRIAL: "neither device has dry friction in the simulation of hands",
    Simplification.ANY_CONTACT: "the follower may touch anything, from nothing to a rigid object",
    Simplification.CONTACT_DAMPING: "the object that the follower touches has a tenth of the critical damping",
    Simplification.EVEN_LINK: "the link has no jitter and no lost messages, as none are declared",
}
_MISSING = {
    UndeclaredValue.AMPLIFIER_BANDWIDTH: "no amplifier bandwidth is declared: an ideal amplifier is assumed",
    UndeclaredValue.RESONANCE: "no resonance is declared: a rigid structure is assumed",
    UndeclaredValue.DRY_FRICTION: "no dry friction is declared: no friction is assumed, the cautious value",
    UndeclaredValue.ENCODER_RESOLUTION: (
        "no encoder resolution is declared: an exact position is assumed, the ideal value"
    ),
    UndeclaredValue.FORCE_LIMIT: "no force limit is declared: an unlimited force is assumed",
}
_WHY_UNUSED = {
    WhyUnused.OF_SOLVE: "used by avc solve alone",
    WhyUnused.ENCODER_AT_HANDLE: "an encoder at the handle does not see it",
    WhyUnused.LAW: "avc certify judges this law; avc trial, simulate and export run it",
    WhyUnused.SIMULATED_ALONE: "simulated by avc simulate alone",
    WhyUnused.SIMULATED_AND_RENDERED_ALONE: "used by avc simulate and avc zwidth alone",
    WhyUnused.OF_WALL: "used for a wall in the device's own loop; leave [{end}] out to use it",
    WhyUnused.OF_SCENE: "used by avc simulate alone",
    WhyUnused.OF_SCENE_WITHOUT_END: "used by avc simulate, which does not support [{end}]",
    WhyUnused.NO_SPRING_TOUCHED: "used for a contact spring, and the file declares none",
    WhyUnused.NO_TOOL: "used for a tool, and tool_mass_kg is missing",
    WhyUnused.NOT_OF_TELEOPERATORS: "not simulated with a follower",
}


@singledispatch
def assumption_clauses(assumption: Assumption, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    """Return what is assumed."""
    raise TypeError(f"no words for {type(assumption).__name__}")


@assumption_clauses.register
def _simplification(assumption: Simplification, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    return (_SIMPLIFICATIONS[assumption],)


@assumption_clauses.register
def _undeclared(assumption: Undeclared, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    gap = _MISSING[assumption.missing]
    return (f"{assumption.device}: {gap}" if assumption.device else gap,)


@assumption_clauses.register
def _range_tried(assumption: RangeTried, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    tried = "simulated hands at the nominal value"
    if assumption.devices > 1:
        tried = f"simulated hands at the nominal value, and others on {assumption.devices} devices of the ranges"
    if assumption.linear:
        return (f"{assumption.key}: linear stability at the ends of the range, {tried}",)
    return f"{assumption.key}: {tried}", "not used for linear stability"


@assumption_clauses.register
def _slip(assumption: Slip, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    return (f"a value that may be wrong: {assumption.text}",)


def why_unused(unused: Unused) -> str:
    """Return why a declared key is not used."""
    return _WHY_UNUSED[unused.why].format(end=unused.end)


def unused_clauses(unused: Unused, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    """Return a declared key that is not used, and why."""
    return (f"{unused.key} ({why_unused(unused)})",)
