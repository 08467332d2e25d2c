"""Rows of a trial of a user's own law: how many hands settle, how it swings or hunts, and with less friction."""

from __future__ import annotations

import math
from collections.abc import Iterator

from avc_casadi._util.json_values import plain
from avc_casadi.present.row import Answer, Mark, Part, Parts, Row, Value, commas, grade, parts, row
from avc_casadi.present.rows import pieces, subject
from avc_casadi.simulation.population.law_trial import LawCase, LawTrial, LimitCycle


def law_trial(result: LawTrial, shown: str = "") -> Answer:
    """Return the answer of `trial` of a law."""
    problem, case = result.problem, result.declared
    low, high = (f"{100 * end:.4g}" for end in result.at_rest_interval)
    interval = f"hands in every motion ({100 * result.confidence:g} % interval {low} to {high} %)"
    settled = (Value(case.at_rest, "number", 9), "of", Value(result.hands, "number", 9), interval)
    rows = [
        row("Settle", settled, mark=grade(case.at_rest == result.hands)),
        row("By motion", ", ".join(f"{name} {count}" for name, count in case.by_motion.items())),
        *_cycles(case),
        *_released(case),
        *_relay(result),
        *_with_friction("Least friction", result.least_friction, result.hands, judged=True),
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


def _cycles(case: LawCase) -> Iterator[Row]:
    """Yield how hands that do not settle swing, and how a long press hunts."""
    if case.swings is not None:
        yield row("Swings", cycle(case.swings), mark=Mark.FAIL)
    if case.hunts is not None:
        yield row("Hunts", cycle(case.hunts), "in a long press: the integral passes the friction", mark=Mark.CAUTION)
    if case.moving:
        yield row("Do not settle", f"by their number in the draw: {', '.join(map(str, case.moving))}")


def _relay(result: LawTrial) -> Iterator[Row]:
    """Yield a friction compensation that is larger than the least friction."""
    law, least = result.problem.law, result.least_friction
    own = None if law is None else law.friction_compensation
    if own is None:
        return
    least_n = result.declared.friction_n if least is None else least.friction_n
    if own.force_n > least_n:
        larger = (
            "compensates",
            Value(own.force_n, "force"),
            "of friction, of which there may be",
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
    first, *others = [group for group in groups if group is not None]
    text: Parts = (first, commas(others)) if case.friction_n else commas([first, *others])
    yield row(label, text, mark=grade(rests) if judged else Mark.NONE)


def _rendered(case: LawCase) -> Iterator[Row]:
    if math.isfinite(case.stiffness_n_per_m):
        yield row("Rendered", Value(case.stiffness_n_per_m, "stiffness"), "at the end of a press, the median of hands")


def cycle(motion: LimitCycle) -> tuple[Part, ...]:
    """Return the frequency and the size of a motion that goes on."""
    size = Value(motion.peak_to_peak_m, "length")
    if not math.isfinite(motion.frequency_hz):
        return parts(size, "in a second, without a turn")
    return parts(Value(motion.frequency_hz, "frequency"), ",", size, "peak to peak")
