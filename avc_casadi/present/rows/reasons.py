"""English of the reasons of a recommendation."""

from __future__ import annotations

import math
from functools import singledispatch

from avc_casadi._util.text import quantity
from avc_casadi._util.units import Units
from avc_casadi.recommendation import reasons
from avc_casadi.recommendation.reasons import FlawKind, LastTried, NothingRenderedBecause, Reason
from avc_casadi.recommendation.sensitivity import Change
from avc_casadi.simulation.population.trial import Variant


def sentence(reason: object, units: Units) -> str:
    """Return a reason in a sentence, without its capital and its full stop."""
    return units.words("; ".join(clauses(reason, units)))


def headline(reason: Reason, units: Units) -> str:
    """Return the fact of a reason, without what follows from it."""
    return units.words(clauses(reason, units)[0])


@singledispatch
def clauses(reason: object, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    """Return the clauses of a reason: the fact, then what follows from it and what to do."""
    raise TypeError(f"no words for {type(reason).__name__}")


@clauses.register
def _no_mass(reason: reasons.NoMass, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    fact = "the device has no mass (device.mass_kg is 0); a released device is judged with a mass above 0 only"
    return (fact, "give the moving mass") if reason.to_wall else (fact,)


@clauses.register
def _no_force(reason: reasons.NoForce, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    return (
        "the wall gives no force, so there is nothing to couple the device to",
        "give [environment] a stiffness or a damping",
    )


@clauses.register
def _too_late(reason: reasons.TooLate, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    known = f"linear stability is computed up to {reason.most_samples} samples of delay"
    fact = f"no coupling is judged: {known}, not {reason.delay_samples:g} (device.delay_samples)"
    return fact, "shorten the delay, or state a longer sample time"


@clauses.register
def _damper_too_large(reason: reasons.DamperTooLarge, units: Units) -> tuple[str, ...]:
    unit = units.unit("N.s/m")
    largest = f"a damper above {quantity(reason.largest_ns_per_m, unit)}"
    required = f"{quantity(reason.damping_ns_per_m, unit)} are required (environment.damping_ns_per_m)"
    return f"{largest} is not linearly stable with every hand and released, and {required}", "require less damping"


@clauses.register
def _unstable_detents(reason: reasons.UnstableDetents, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    return f"with any coupling, {reason.claim.sentence}", reason.claim.advice


@clauses.register
def _unstable_engine(reason: reasons.UnstableEngine, units: Units) -> tuple[str, ...]:
    contact = quantity(reason.contact_n_per_m, units.unit("N/m"))
    step, mass = quantity(reason.step_s, "s"), quantity(reason.mass_kg, units.unit("kg"))
    unstable = f"its own contact of {contact} is unstable at a step of {step} with a mass of {mass}"
    fact = f"your engine, not the coupling: {unstable} (dt sqrt(k/m) must stay well below 2)"
    return fact, "use a shorter step, a softer or a rigid contact, a heavier tool, or an implicit integrator"


@clauses.register
def _no_joint_gains(reason: reasons.NoJointGains, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    margins = f"a damping ratio of {reason.damping_ratio:g} and a disk margin of {reason.disk_margin:g}"
    return (f"no gain kp of the joint has {margins}",)


@clauses.register
def _no_pair_stable(reason: reasons.NoPairStable, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    return ("no spring and damper is stable with every hand and released, with every tool and contact",)


@clauses.register
def _unstable_stiffness(reason: reasons.UnstableStiffness, units: Units) -> tuple[str, ...]:
    required = f"{quantity(reason.required_n_per_m, units.unit('N/m'))} are required ({reason.end}.stiffness_n_per_m)"
    return (
        f"{required}, and no damper keeps this stiffness stable with every hand and released",
        "require less stiffness",
    )


@clauses.register
def _nothing_rendered(reason: reasons.NothingRendered, units: Units) -> tuple[str, ...]:
    newton, metre = units.unit("N"), units.unit("m")
    limit = f"the force limit (device.max_force_n, {reason.limit_n:g} {newton})" if reason.limit_n is not None else ""
    weaker_than_press = reason.limit_n is not None and reason.limit_n < reason.press_n
    press = f"a press of {quantity(reason.press_n, newton)}"
    most = limit if weaker_than_press else press
    advice = "check the units of these values"
    if reason.because is NothingRenderedBecause.STEP_EXCEEDS_FORCE:
        encoder = f"the encoder (device.encoder_resolution_m, {reason.step_m:g} {metre})"
        fact = f"one step of {encoder} produces more than {most}"
    elif reason.because is NothingRenderedBecause.PRESSES_SATURATE:
        fact = f"every press ends at {limit}"
        advice = "check the unit of the force limit, or state [hands] that press less"
    elif reason.because is NothingRenderedBecause.FRICTION_HOLDS:
        friction = f"dry friction (device.coulomb_friction_n, {reason.friction_n:g} {newton})"
        fact = f"no press ends in contact, because {friction} is as large as {press} or larger"
    else:
        fact = f"no press ends in contact (device.encoder_resolution_m is {reason.step_m:g} {metre})"
    return f"the wall is not rendered: {fact}", advice


@clauses.register
def _unmet_requirements(reason: reasons.UnmetRequirements, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    first, *more = (
        f"{required.unsettled} of {required.hands} hands do not settle with {required.key} = {required.value}"
        for required in reason.requirements
    )
    return (
        f"[robustness] is not met beyond [hands]: {first}",
        *more,
        "require less of [robustness], or use a softer wall",
    )


@clauses.register
def _strike_unsettled(reason: reasons.StrikeUnsettled, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    return "an extreme hand of the range does not settle after a strike at 0.3 to 1 m/s", "use a softer wall"


@clauses.register
def _flaw(reason: reasons.Flaw, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    if reason.kind is FlawKind.BY_FRICTION_ALONE:
        return ("some simulated hands settle only because of the declared dry friction (--lean-on-friction)",)
    if reason.kind is FlawKind.UNSETTLED:
        return ("not all simulated hands settle",)
    return (f"only {reason.quiet} of {reason.hands} hands feel no vibration",)


@clauses.register
def _none_stable(reason: reasons.NoneStable, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    return (f"none of {reason.considered} couplings is linearly stable with every hand of [hands] and released",)


@clauses.register
def _none_settles(reason: reasons.NoneSettles, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    return (f"not all simulated hands settle with any of {reason.candidates} deployable candidates",)


@clauses.register
def _nearest_to_wall(reason: reasons.NearestToWall, units: Units) -> tuple[str, ...]:
    why = [f"of {reason.candidates} deployable candidates, this is closest to the wall, in motion and when released"]
    if reason.by_friction:
        why.append("some simulated hands settle only because of the declared dry friction")
    nearer = reason.nearer
    if nearer is not None:
        error, here = 100 * nearer.error, 100 * nearer.recommended_error
        errors = f"impedance error without encoder steps {error:.3g} %, of this coupling {here:.3g} %"
        flaw = "" if nearer.flaw is None else sentence(nearer.flaw, units)
        why.append(f"with a coupling closer to the wall, {nearer.method} ({errors}), {flaw}")
    return tuple(why)


@clauses.register
def _as_requested(reason: reasons.AsRequested, units: Units) -> tuple[str, ...]:
    verdict = reason.claims.sentence if reason.shortfall is None else sentence(reason.shortfall, units)
    return f"the gains of {reason.method}, as requested", verdict


@clauses.register
def _not_near(reason: reasons.NotNear, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    return (f"no stable coupling has an error within {100 * reason.within:.0f} % for a moving hand",)


@clauses.register
def _stiffer_wall(reason: reasons.StifferWall, units: Units) -> tuple[str, ...]:
    wall = quantity(reason.wall_n_per_m, units.unit("N/m"))
    fails = "a coupling that renders this wall as well fails: " if reason.tried else ""
    fact, *more = clauses(reason.why, units)
    return f"at {wall} {fails}{fact}", *more


@clauses.register
def _no_wall_rendered(reason: reasons.NoWallRendered, units: Units) -> tuple[str, ...]:
    *facts, last = clauses(reason.why, units)
    return *facts, f"{last}, from 1 % of the linear limit on"


_CIRCUMSTANCES: dict[Variant, str] = {
    "with_dropped_steps": "where the engine misses steps",
    "without_friction": "without dry friction",
}
"""How a trial repeats another one."""


@clauses.register
def _unsettled(reason: reasons.Unsettled, units: Units) -> tuple[str, ...]:
    trial = reason.trial
    motion = trial.hardest_motion
    count = trial.hands - int(trial.by_motion[motion].sum())
    where = f"in {motion}"
    for variant, circumstance in _CIRCUMSTANCES.items():
        if count == 0 and variant in trial.variants:
            count, where = int((~trial.variants[variant]).sum()), circumstance
    unsettled = f"{count} of {trial.hands} hands {'does' if count == 1 else 'do'} not settle"
    return (f"with K {quantity(reason.stiffness_n_per_m, units.unit('N/m'))} {unsettled}, {where}",)


@clauses.register
def _stiffest_settled(reason: reasons.StiffestSettled, units: Units) -> tuple[str, ...]:
    most = (
        "the requested stiffness"
        if reason.required
        else "the stiffest coupling that keeps its margin and with which all hands settle"
    )
    why = [most]
    if reason.low_gain_margin is not None:
        why.append(
            f"the loop is stable with K and B up to {math.floor(100 * reason.low_gain_margin) / 100:g} times as large"
        )
    if reason.stiffer is not None:
        why.append(sentence(reason.stiffer, units))
    *facts, last = why
    return *facts, last if reason.exchange is None else f"{last}, exchange {reason.exchange}"


@clauses.register
def _settled_with_follower(reason: reasons.SettledWithFollower, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    most = "the stiffest coupling that keeps its margin without dampers in the devices' own loops"
    return (f"{'the requested stiffness' if reason.required else most}, all hands settled",)


@clauses.register
def _no_gain_margin(reason: reasons.NoGainMargin, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    return ("with no damper the coupling keeps its gain margins",)


@clauses.register
def _stiffness_not_reached(reason: reasons.StiffnessNotReached, units: Units) -> tuple[str, ...]:
    unit = units.unit("N/m")
    required, stiffest = quantity(reason.required_n_per_m, unit), quantity(reason.stiffest_n_per_m, unit)
    if reason.required_n_per_m > reason.stiffest_n_per_m:
        return (f"{required} is required, but the stiffest stable coupling has {stiffest}",)
    no_damper = "no damper gives this stiffness the gain margins"
    return (f"{required} is required, and {no_damper}, though a stiffer coupling, {stiffest}, is stable",)


@clauses.register
def _follower_limit(reason: reasons.FollowerLimit, units: Units) -> tuple[str, ...]:
    return (f"the stiffest coupling that is stable has K {quantity(reason.stiffest_n_per_m, units.unit('N/m'))}",)


@clauses.register
def _hands_unsettled(reason: reasons.HandsUnsettled, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    trial = reason.trial
    coupling = "the last coupling" if reason.last is LastTried.ANY else "the softest coupling"
    settle = f"of {trial.hands} simulated hands {trial.settled} settle with {coupling} that was tried"
    motion = trial.hardest_motion
    hardest = f"the hardest motion is {motion}, in which {int(trial.by_motion[motion].sum())} settle"
    if reason.last is not LastTried.SOFTEST_WITHOUT_DAMPING:
        return settle, hardest
    swings = "the follower has no damping of its own, and oscillates for long on a soft spring"
    return settle, hardest, f"{swings}: add damping, or require a stiffer K"


@clauses.register
def _unsettled_with_dropped_steps(reason: reasons.UnsettledWithDroppedSteps, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    settle = f"of {reason.hands} simulated hands {reason.settled} settle"
    missed = f"{reason.settled_with_dropped_steps} where the engine misses steps"
    return (f"{settle} with the last coupling that was tried, {missed}",)


CHANGES: dict[Change, str] = {
    Change.HALF_SAMPLE_TIME: "with half the sample time",
    Change.TWICE_DAMPING: "with twice the damping",
    Change.TWICE_MASS: "with twice the mass",
    Change.NO_DELAY: "without delay",
    Change.AMPLIFIER_WITHOUT_LAG: "with an amplifier without lag",
    Change.NO_RESONANCE: "without resonance",
    Change.ENGINE_TWICE_AS_FAST: "with an engine twice as fast",
    Change.FORCE_IN_EACH_SUBSTEP: "with a new force in each substep",
    Change.STATE_ON_TIME: "with exchange on-time",
    Change.TOOL_TWICE_AS_HEAVY: "with a tool twice as heavy",
    Change.IMPLICIT_INTEGRATOR: "with an implicit integrator",
    Change.LOCAL_DAMPER: "with a damper in the device's own loop",
}
"""Changes that would help, as rows name them."""


@clauses.register
def _change(change: Change, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    of_device = change in {Change.TWICE_DAMPING, Change.TWICE_MASS}
    return (f"{CHANGES[change]}{' of the device' if of_device else ''}",)
