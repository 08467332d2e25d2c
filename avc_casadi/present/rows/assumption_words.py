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
        "simulated hands feel no detents: the claims cover their slopes, and avc simulate includes them"
    ),
    Simplification.TOOL_FREE_OR_HELD: (
        "the engine's contacts are rigid: the tool moves freely or stands still; for springs state a range of stiffness"
    ),
    Simplification.STEADY_STEPS_OF_RANGE: (
        "the engine's step is steady: a range of step_s is judged at each steady step in it"
    ),
    Simplification.STEADY_STEP_OF_LIST: (
        "the engine's step is steady, any of step_s: steps that vary are in the trial alone"
    ),
    Simplification.ENGINE_CLOCK_OF_ITS_OWN: (
        "the engine has a clock of its own: every phase of its steps against the samples is judged; state "
        'simulation.clock = "device" if the device\'s loop starts each step'
    ),
    Simplification.ENGINE_STEPS_OF_DEVICE: (
        "the device's loop starts each step of the engine, at a sample: on a clock of its own less is stable"
    ),
    Simplification.NO_FRICTION_IN_TRIAL: "simulated hands: neither device has dry friction",
    Simplification.ANY_CONTACT: "the follower touches anything from nothing to a rigid object",
    Simplification.CONTACT_DAMPING: "what the follower touches is damped by a tenth of the critical damping",
    Simplification.EVEN_LINK: "the link is even: no jitter and no lost messages are declared",
}
_MISSING = {
    UndeclaredValue.AMPLIFIER_BANDWIDTH: "no amplifier bandwidth is declared: an ideal amplifier is assumed",
    UndeclaredValue.RESONANCE: "no resonance is declared: a rigid structure is assumed",
    UndeclaredValue.DRY_FRICTION: "no dry friction is declared: 0 is assumed, the cautious value",
    UndeclaredValue.ENCODER_RESOLUTION: (
        "no encoder resolution is declared: an exact position is assumed, the ideal value"
    ),
    UndeclaredValue.FORCE_LIMIT: "no force limit is declared: an unlimited force is assumed",
}
_WHY_UNUSED = {
    WhyUnused.OF_SOLVE: "of avc solve",
    WhyUnused.ENCODER_AT_HANDLE: "not seen by an encoder at the handle",
    WhyUnused.LAW: "avc certify judges it, avc trial, simulate and export run it",
    WhyUnused.SIMULATED_ALONE: "simulated by avc simulate alone",
    WhyUnused.SIMULATED_AND_RENDERED_ALONE: "known to avc simulate and avc zwidth alone",
    WhyUnused.OF_WALL: "of a wall in the device's own loop: leave [{end}] out for it",
    WhyUnused.OF_SCENE: "of avc simulate alone",
    WhyUnused.OF_SCENE_WITHOUT_END: "of avc simulate, which knows no [{end}]",
    WhyUnused.NO_SPRING_TOUCHED: "of a contact spring, and there is no such spring",
    WhyUnused.NO_TOOL: "of a tool, and tool_mass_kg is missing",
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
    tried = "trial at nominal"
    if assumption.devices > 1:
        tried = f"trial at nominal, and by others at {assumption.devices} devices of the ranges"
    if assumption.linear:
        return (f"{assumption.key}: linear stability at its corners, {tried}",)
    return f"{assumption.key}: {tried}", "no part of linear stability"


@assumption_clauses.register
def _slip(assumption: Slip, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    return (f"what may be a slip: {assumption.text}",)


def why_unused(unused: Unused) -> str:
    """Return why a declared key is not used."""
    return _WHY_UNUSED[unused.why].format(end=unused.end)


def unused_clauses(unused: Unused, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    """Return a declared key that is not used, and why."""
    return (f"{unused.key} ({why_unused(unused)})",)
