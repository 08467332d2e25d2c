"""The loop as it was found, played again in a scene: with the encoder and without, with a cure and without."""

from __future__ import annotations

import numpy as np

from avc_casadi.files.problem_document import problem_of
from avc_casadi.identification.diagnosis.answer import Answer
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
# How far the far end of a hand's spring goes at most, and that of a weight's.
_HAND_M, _WEIGHT_M = 0.2, 1.0
# A weight presses a device that nobody holds: its force stays as it is, and it holds nothing.
_WEIGHT = Hand(1e-4, 1e-3, 10.0)
NOTHING = 1e-6
"""N/m or N.s/m at the hand that no hand feels, and what a fit leaves of nothing."""


def can_replay(law: Law) -> bool:
    """Whether a scene renders the law: a spring and a damper that do not push on their own."""
    return law.stiffness_n_per_m >= 0 and law.damping_ns_per_m >= 0


def replay(answer: Answer, law: Law, log: Log, encoder_m: float, *, filter_hz: float | None = None) -> Oscillation:
    """Press into the wall of the log once more, and find the oscillation.

    Args:
        answer: device and hand.
        law: what the computer makes of the position, which `can_replay`.
        log: whose mean force the hand presses with.
        encoder_m: step of the encoder; 0 leaves it out.
        filter_hz: cut-off of the velocity filter in place of the law's.
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


def _problem(answer: Answer, law: Law, log: Log, encoder_m: float, filter_hz: float | None) -> Problem:
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
        # A scene that misses ticks is late by whole samples.
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
    """Return 0 for what a fit leaves of nothing."""
    return fitted if fitted > NOTHING * reach_m**2 else 0.0
