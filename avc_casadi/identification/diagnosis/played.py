"""What swings a loop over few steps of the encoder, told by playing it in the scene as it is and as it was meant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from avc_casadi._util.text import number
from avc_casadi.identification.diagnosis.answer import Answer
from avc_casadi.identification.diagnosis.causes import CAUSES, Asked, shares_of, shorter, timing
from avc_casadi.identification.diagnosis.declared import Declared
from avc_casadi.identification.diagnosis.law import Law
from avc_casadi.identification.diagnosis.log import Log
from avc_casadi.identification.diagnosis.oscillation import Oscillation
from avc_casadi.identification.diagnosis.replay import can_replay, replay

# Answers that are played until one swings.
_PLAYED = 5
# Share of a swing that is still the same swing.
_STILL = 0.3
# Over so few steps what a loop does without them says little.
_HARDLY_ANY = 3.0
# Shares below this are not worth a scene.
_WORTH = 0.1


def settled(
    asked: Sequence[Asked], law: Law, log: Log, swings: Oscillation, declared: Declared, evidence: list[str]
) -> tuple[Asked, ...]:
    """Ask the scene where the encoder may swing a loop alone, or only because something else is not as declared.

    With that as it was meant, a loop that the encoder swings alone swings still. That it then rests tells of a
    resonance, which no few steps feign; a delay or a hand may be read wrong by as much as decides. Over hardly any
    steps a loop without a hand is asked too that would grow: with one it may swing as far as the log does.

    Args:
        asked: every answer that the log bears out.
        law: what the computer makes of the position.
        log: on its grid.
        swings: its oscillation.
        declared: the loop as it was meant.
        evidence: to which is added what was played.
    """
    told = list(asked)
    if not can_replay(law):
        return tuple(told)
    for cause in ("delay", "let-go", "resonance"):
        alone = cause == "let-go" and swings.steps < _HARDLY_ANY
        both = [one for one in told if ({cause} if alone else {"encoder", cause}) <= one.causes.keys()]
        if not both or shares_of(told).get(cause, 0.0) < _WORTH:
            continue
        likeliest = max(both, key=lambda one: one.weight).answer
        found = swings if alone else replay(likeliest, law, log, log.encoder_m)
        if not found.sustained:
            continue
        meant, its_law = _as_meant(cause, likeliest, law, log, declared)
        still = _still(replay(meant, its_law, log, log.encoder_m), found)
        evidence.append(f"played in the scene without the {CAUSES[cause]}: {'swings still' if still else 'rests'}")
        if still or cause == "resonance":
            from_, to = (cause, "encoder") if still else ("encoder", cause)
            told = [replace(one, causes=_moved(one.causes, from_, to)) if one in both else one for one in told]
    return tuple(told)


def doubts_of_encoder(answers: Sequence[Answer], law: Law, log: Log, evidence: list[str]) -> list[str]:
    """Play the scene with and without the encoder until it swings; return the doubts that are left.

    Args:
        answers: with the encoder as their cause, likeliest first.
        law: what the computer makes of the position.
        log: on its grid.
        evidence: to which is added what was played.
    """
    if not can_replay(law):
        return ["the law pushes on its own, which no scene renders"]
    for answer in answers[:_PLAYED]:
        stepped = replay(answer, law, log, log.encoder_m)
        if stepped.sustained:
            break
    else:
        evidence.append("played in the scene with the encoder: rests")
        return ["played in the scene with its encoder the loop rests"]
    smooth = replay(answer, law, log, 0.0)
    evidence.append(f"played in the scene with the encoder: {_told(stepped)}; without it: {_told(smooth)}")
    return ["played in the scene without the encoder it swings too"] if _still(smooth, stepped) else []


def _as_meant(cause: str, answer: Answer, law: Law, log: Log, declared: Declared) -> tuple[Answer, Law]:
    """Return an answer and its law with one thing as it was meant."""
    if cause == "delay":
        meant = timing(answer, law, log, declared)[1]
        return answer.delayed(meant - law.lag), shorter(law, meant)
    if cause == "let-go":
        box = declared.box()
        return Answer(answer.device, box.pick(slice(len(box) - 1, None))), law
    return answer.without_mode(), law


def _moved(causes: Mapping[str, float], from_: str, to: str) -> Mapping[str, float]:
    """Return causes with the share of one given to another."""
    left = {cause: share for cause, share in causes.items() if cause != from_}
    return {**left, to: left.get(to, 0.0) + causes.get(from_, 0.0)}


def _still(played: Oscillation, as_found: Oscillation) -> bool:
    """Whether a loop swings as it did."""
    return played.sustained and played.peak_to_peak_m > _STILL * as_found.peak_to_peak_m


def _told(played: Oscillation) -> str:
    if not played.sustained:
        return "rests"
    return f"{number(1e6 * played.peak_to_peak_m, 3)} um at {number(played.frequency_hz, 3)} Hz"
