"""Counterfactual simulations of the identified loop in a scene: with and without encoder, as found and as intended."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from avc_casadi._util.text import number
from avc_casadi.files.problem_document import problem_of
from avc_casadi.identification.diagnosis.causes import CAUSES, Asked, shares_of, shorter, timing
from avc_casadi.identification.diagnosis.hypothesis import Hypothesis
from avc_casadi.identification.diagnosis.intended import Declared
from avc_casadi.identification.diagnosis.law import Law
from avc_casadi.identification.diagnosis.log import Log, log_of
from avc_casadi.identification.diagnosis.oscillation import Oscillation, find_oscillation
from avc_casadi.identification.record import Columns
from avc_casadi.model.gains import NO_COUPLING
from avc_casadi.model.hands import Hand
from avc_casadi.model.problem import Problem
from avc_casadi.simulation.scene import simulate

_SECONDS = 1.5
_SPEED_M_PER_S = 0.07
_BEFORE_M = 0.004
_PRESSED_S = 0.5
# Largest travel of the far end of a hand's spring, and of a weight's.
_HAND_M, _WEIGHT_M = 0.2, 1.0
# A weight presses a released device: a constant force without stiffness or damping.
_WEIGHT = Hand(1e-4, 1e-3, 10.0)
NOTHING = 1e-6
"""Stiffness or damping at the hand, N/m or N.s/m, that is 0 up to the tolerance of a fit."""


def can_replay(law: Law) -> bool:
    """Return whether a scene renders the law: a passive spring and damper."""
    return law.stiffness_n_per_m >= 0 and law.damping_ns_per_m >= 0


def replay(answer: Hypothesis, law: Law, log: Log, encoder_m: float, *, filter_hz: float | None = None) -> Oscillation:
    """Simulate a press into the wall of the log, and find the oscillation.

    Args:
        answer: device and hand.
        law: from position to force, which `can_replay`.
        log: it gives the mean force of the hand.
        encoder_m: encoder resolution; 0 leaves it out.
        filter_hz: cut-off of the velocity filter replacing the law's.
    """
    problem = _problem(answer, law, log, encoder_m, filter_hz)
    run = simulate(problem, NO_COUPLING)
    seen = run.position_m
    if encoder_m:
        seen = encoder_m * np.floor(seen / encoder_m + 0.5)
    if not np.isfinite(seen).all():
        return Oscillation("growing")
    played, _ = log_of(Columns("replay", run.time_s, np.asarray(seen), -run.force_n), reach_m=log.reach_m)
    return find_oscillation(played).found


def _problem(answer: Hypothesis, law: Law, log: Log, encoder_m: float, filter_hz: float | None) -> Problem:
    device, hand = answer.device, answer.hand
    two_sided = np.count_nonzero(log.force_n < 0) > 0.01 * log.force_n.size
    pressed = float(np.mean(log.force_n[-max(1, log.force_n.size // 3) :]))
    effects: list[dict[str, object]] = []
    holds = (_WEIGHT.at_handle(log.reach_m) if hand is None else hand).values(0)
    effects.append({"kind": "hand", **holds})
    depth = pressed / law.stiffness_n_per_m if law.stiffness_n_per_m > 0 else 0.0
    end = depth + pressed / holds["stiffness_n_per_m"]
    end = float(np.clip(end, 1e-4 / log.reach_m, (_WEIGHT_M if hand is None else _HAND_M) / log.reach_m))
    effects.append({"kind": "environment" if two_sided else "wall"})
    if device.resonance is not None:
        effects.append({"kind": "resonance"})
    if device.coulomb_friction_n > 0:
        effects.append({"kind": "coulomb-friction"})
    if encoder_m > 0:
        effects.append({"kind": "encoder", "resolution_m": encoder_m})
    cut = law.filter_hz(device.sample_time_s) if filter_hz is None else filter_hz
    if cut is not None:
        effects.append({"kind": "velocity-filter", "cutoff_hz": cut})
    if device.max_force_n is not None:
        effects.append({"kind": "saturation"})
    delay = float(device.delay_samples) + law.lag
    if log.ticks.missed_share > 0:
        # A scene with missed ticks is late by whole samples.
        delay = round(delay)
    if delay > 0:
        effects.append({"kind": "delay", "samples": delay})
    if log.ticks.missed_share > 0:
        effects.append({"kind": "jitter", "rms_s": 0.0, "dropped_share": log.ticks.missed_share})
    if device.amplifier_bandwidth_hz is not None:
        effects.append({"kind": "amplifier"})
    return problem_of(
        {
            "name": "replay",
            "title": "the loop of a log",
            "device": device.model_dump(mode="json", exclude={"range"}, exclude_none=True),
            "environment": {
                "damping_ns_per_m": _or_none(law.damping_ns_per_m, log.reach_m),
                "stiffness_n_per_m": _or_none(law.stiffness_n_per_m, log.reach_m),
            },
            "frequency": {"values_hz": [1.0]},
            "scene": {
                "duration_s": _SECONDS,
                "coupling": "none",
                "motion": {
                    "kind": "press",
                    "start_m": -_BEFORE_M / log.reach_m,
                    "end_m": end,
                    "speed_m_per_s": max(_SPEED_M_PER_S / log.reach_m, end / _PRESSED_S),
                },
                "effects": effects,
            },
        }
    )


def _or_none(fitted: float, reach_m: float) -> float:
    """Return 0 for a value below the tolerance of a fit."""
    return fitted if fitted > NOTHING * reach_m**2 else 0.0


# Hypotheses that are simulated until one oscillates.
_PLAYED = 5
# Relative amplitude above which an oscillation counts as the same.
_STILL = 0.3
# Over so few steps a loop without quantisation is little evidence.
_HARDLY_ANY = 3.0
# Causes of a smaller share are not simulated.
_WORTH = 0.1


def settled(
    asked: Sequence[Asked], law: Law, log: Log, swings: Oscillation, declared: Declared, evidence: list[str]
) -> tuple[Asked, ...]:
    """Decide by simulation between the encoder alone and a deviation from the intended loop as the cause.

    An oscillation sustained by the encoder alone persists in the intended loop. If it stops, a resonance is the cause,
    which no few steps mimic; the estimate of a delay or a hand may be too inaccurate to decide. Over hardly any steps
    an unstable loop without a hand is tested too: with a hand it may oscillate as far as the log does.

    Args:
        asked: the weighted hypotheses.
        law: from position to force.
        log: on its tick grid.
        swings: the oscillation.
        declared: the intended loop.
        evidence: extended by the simulations.
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
        evidence.append(f"simulated in the scene without the {CAUSES[cause]}: {'still swings' if still else 'settles'}")
        if still or cause == "resonance":
            from_, to = (cause, "encoder") if still else ("encoder", cause)
            told = [replace(one, causes=_moved(one.causes, from_, to)) if one in both else one for one in told]
    return tuple(told)


def doubts_of_encoder(answers: Sequence[Hypothesis], law: Law, log: Log, evidence: list[str]) -> list[str]:
    """Simulate with and without the encoder until one hypothesis oscillates; return the remaining doubts.

    Args:
        answers: hypotheses caused by the encoder, likeliest first.
        law: from position to force.
        log: on its tick grid.
        evidence: extended by the simulations.
    """
    if not can_replay(law):
        return ["the law pushes on its own, which no scene renders"]
    for answer in answers[:_PLAYED]:
        stepped = replay(answer, law, log, log.encoder_m)
        if stepped.sustained:
            break
    else:
        evidence.append("simulated in the scene with the encoder: settles")
        return ["simulated in the scene with its encoder the loop settles"]
    smooth = replay(answer, law, log, 0.0)
    evidence.append(f"simulated in the scene with the encoder: {_told(stepped)}; without it: {_told(smooth)}")
    return ["simulated in the scene without the encoder it swings too"] if _still(smooth, stepped) else []


def _as_meant(cause: str, answer: Hypothesis, law: Law, log: Log, declared: Declared) -> tuple[Hypothesis, Law]:
    """Return a hypothesis and its law with one property as intended."""
    if cause == "delay":
        meant = timing(answer, law, log, declared)[1]
        return answer.delayed(meant - law.lag), shorter(law, meant)
    if cause == "let-go":
        box = declared.box()
        return Hypothesis(answer.device, box.pick(slice(len(box) - 1, None))), law
    return answer.without_mode(), law


def _moved(causes: Mapping[str, float], from_: str, to: str) -> Mapping[str, float]:
    """Return causes with the share of one moved to another."""
    left = {cause: share for cause, share in causes.items() if cause != from_}
    return {**left, to: left.get(to, 0.0) + causes.get(from_, 0.0)}


def _still(played: Oscillation, as_found: Oscillation) -> bool:
    """Return whether an oscillation has about the amplitude of the one found."""
    return played.sustained and played.peak_to_peak_m > _STILL * as_found.peak_to_peak_m


def _told(played: Oscillation) -> str:
    if not played.sustained:
        return "rests"
    return f"{number(1e6 * played.peak_to_peak_m, 3)} at {number(played.frequency_hz, 3)} Hz"
