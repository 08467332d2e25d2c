"""Rows of trials of a user's own law, and of an admittance law: how many hands settle, and what they feel."""

from __future__ import annotations

import math
from collections.abc import Iterator
from shlex import quote

from avc_casadi._util.json_values import plain
from avc_casadi.present.row import Answer, Mark, Part, Parts, Row, Value, commas, count, grade, parts, row
from avc_casadi.present.rows import admittance, pieces, subject
from avc_casadi.simulation.population.admittance_trial import AdmittanceTrial, ContactRebound
from avc_casadi.simulation.population.law_trial import LawCase, LawTrial, LimitCycle


def law_trial(result: LawTrial, shown: str = "") -> Answer:
    """Return the answer of `trial` of a law."""
    problem, case = result.problem, result.declared
    rows = [
        *_settled(case, result),
        *_cycles(case),
        *_released(case),
        *_relay(result),
        *_with_friction("Least friction", result.least_friction, result.hands, judged=True),
        *_assumed_friction(result),
        *_with_friction("No friction", result.without_friction, result.hands, judged=False),
        *_rendered(case),
    ]
    if not case.quiet:
        rows.append(row("Vibration", f"{case.felt_vibration:.3g} times what a hand notices", mark=Mark.CAUTION))
    rows.append(row("Simulated", ", ".join(result.effects)))
    document = {key: plain(value) for key, value in vars(result).items() if key != "problem"}
    document |= {"problem": problem.name, "rests": result.rests, "at_rest_interval": list(result.at_rest_interval)}
    law = problem.law
    assert law is not None  # noqa: S101 - it was tried
    shown = shown or subject.name_of(problem)
    title = parts(shown, "· law", pieces.named(law), f"· {result.hands} hands, seed {result.seed}")
    return Answer("trial", document, title, tuple(rows), units=problem.units, code=0 if result.rests else 1)


def _settled(counts: LawCase | AdmittanceTrial, trial: LawTrial | AdmittanceTrial) -> tuple[Row, Row]:
    """Return how many hands of a trial settle, in all motions and in each."""
    low, high = (f"{100 * end:.4g}" for end in trial.at_rest_interval)
    interval = f"hands in every motion ({100 * trial.confidence:g} % interval {low} to {high} %)"
    settled = (Value(counts.at_rest, "number", 9), "of", Value(trial.hands, "number", 9), interval)
    by_motion = ", ".join(f"{name} {count}" for name, count in counts.by_motion.items())
    return row("Settle", settled, mark=grade(counts.at_rest == trial.hands)), row("By motion", by_motion)


def _numbers(moving: tuple[int, ...]) -> Iterator[Row]:
    """Yield which hands do not settle."""
    if moving:
        yield row("Do not settle", f"numbers of these hands in the draw: {', '.join(map(str, moving))}")


def _cycles(case: LawCase) -> Iterator[Row]:
    """Yield how hands that do not settle swing, and how a long press hunts."""
    if case.swings is not None:
        yield row("Swings", cycle(case.swings), mark=Mark.FAIL)
    if case.hunts is not None:
        yield row("Hunts", cycle(case.hunts), "in a long press: the integral overcomes the friction", mark=Mark.CAUTION)
    yield from _numbers(case.moving)


def _relay(result: LawTrial) -> Iterator[Row]:
    """Yield a friction compensation that is larger than the least friction."""
    law, least = result.problem.law, result.least_friction
    compensation = None if law is None else law.friction_compensation
    if compensation is None:
        return
    least_n = result.declared.friction_n if least is None else least.friction_n
    if compensation.force_n > least_n:
        larger = (
            "compensates",
            Value(compensation.force_n, "force"),
            "of friction; the device may have only",
            Value(least_n, "force"),
        )
        yield row("Relay", larger, ": the compensation moves the device by itself", mark=Mark.CAUTION)


def _released(case: LawCase) -> Iterator[Row]:
    if case.released is not None:
        ending: Parts = "comes to rest"
        if case.released_swings is not None:
            ending = ("does not come to rest:", cycle(case.released_swings))
        yield row("Released", ending, mark=grade(case.released))


def _with_friction(label: str, case: LawCase | None, hands: int, *, judged: bool) -> Iterator[Row]:
    """Yield what hands find at another friction of the device."""
    if case is None:
        return
    ends = case.swings or case.released_swings
    rests = case.at_rest == hands and case.released is not False
    groups: list[Parts] = [
        (Value(case.friction_n, "force"), ":") if case.friction_n else None,
        (Value(case.at_rest, "number", 9), "of", Value(hands, "number", 9), "hands settle"),
        "the released device does not come to rest" if case.released is False else None,
        ("swings", cycle(ends)) if ends is not None else None,
    ]
    first, *further = [group for group in groups if group is not None]
    text: Parts = (first, commas(further)) if case.friction_n else commas([first, *further])
    yield row(label, text, mark=grade(rests) if judged else Mark.NONE)


def _assumed_friction(result: LawTrial) -> Iterator[Row]:
    """Yield that the least friction is an assumption, and the key that states it."""
    problem = result.problem
    if result.least_friction is None or problem.device.range.coulomb_friction_n is not None:
        return
    key = problem.units.key("device.range.coulomb_friction_n")
    yield row("Assumed", f"half of the declared friction counts, because friction varies; state {key} if you know it")


def _rendered(case: LawCase) -> Iterator[Row]:
    if math.isfinite(case.stiffness_n_per_m):
        yield row("Rendered", Value(case.stiffness_n_per_m, "stiffness"), "at the end of a press, the median of hands")


def cycle(motion: LimitCycle) -> tuple[Part, ...]:
    """Return the frequency and the size of a motion that goes on."""
    size = Value(motion.peak_to_peak_m, "length")
    if not math.isfinite(motion.frequency_hz):
        return parts(size, "in a second, without turning back")
    return parts(Value(motion.frequency_hz, "frequency"), ",", size, "peak to peak")


def admittance_trial(result: AdmittanceTrial, shown: str = "") -> Answer:
    """Return the answer of `trial` of an admittance law."""
    problem, effort, released = result.problem, result.effort, result.released
    assert problem.law is not None  # noqa: S101 - it was tried
    way = ("at 1 Hz,", Value(effort.way_m, "length"), "to each side:")
    forces = commas([(Value(effort.peak_n, "force"), "peak"), (Value(effort.rms_n, "force"), "rms")])
    speeds = (Value(released.largest_m_per_s, "speed"), "at most after a release at")
    rows = [
        *_settled(result, result),
        *_numbers(result.moving),
        row("Effort", way, forces, ",", Value(effort.effort_ns_per_m, "damping")),
        row("Released", speeds, Value(released.at_release_m_per_s, "speed"), ", moves on by", _length(released.way_m)),
        *_rebounds(result.rebound),
        *_limits(result),
        row("Simulated", _simulated(result)),
    ]
    shown = shown or problem.typed_name
    return Answer(
        kind="trial-admittance",
        data={**plain(result), "problem": problem.name},
        title=parts(
            shown, "·", admittance.law_line(problem.law.admittance), f"· {result.hands} hands, seed {result.seed}"
        ),
        rows=tuple(rows),
        commands=(f"avc certify {quote(shown)}",),
        units=problem.units,
        code=0 if result.rests else 1,
    )


def _length(length_m: float) -> Value:
    return Value(length_m, "length")


def _rebounds(rebound: ContactRebound | None) -> Iterator[Row]:
    """Yield how a handle leaves a contact."""
    if rebound is None:
        return
    pressed = ("a pressed handle leaves the contact by", _length(rebound.pressed_m), "at most")
    pushed = (
        "; a handle released at the contact, by",
        _length(rebound.released_m),
        "at",
        Value(rebound.released_m_per_s, "speed"),
    )
    yield row("Rebound", pressed, pushed)


def _limits(result: AdmittanceTrial) -> Iterator[Row]:
    """Yield with how many hands a limit is reached, beyond which no linear claim is true."""
    device = result.problem.device
    if result.at_speed_limit:
        limit = ("hands reach the largest speed,", Value(device.max_speed_m_per_s, "speed"))
        yield row("Speed limit", count(result.at_speed_limit), limit, mark=Mark.CAUTION)
    if result.at_force_limit:
        limit = ("hands reach the end of the sensor's range,", Value(device.force_sensor.max_force_n, "force"))
        yield row("Force limit", count(result.at_force_limit), limit, mark=Mark.CAUTION)


def _simulated(result: AdmittanceTrial) -> str:
    sensor = result.problem.device.force_sensor
    noise = "sensor noise and resolution" if sensor.noise_rms_n or sensor.resolution_n else "a sensor without noise"
    contacts = f"{result.contacts} contacts for each hand" if result.contacts > 1 else "a contact for each hand"
    devices = f", on {result.devices} devices of the declared ranges" if result.devices > 1 else ""
    return f"{noise}, {contacts if result.contacts else 'no contact'}{devices}"
