"""Where the search for a term may begin: beside the model without it, or from what the log shows from afar."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from avc_casadi.identification.fit import Fit
from avc_casadi.identification.frequency import Response, held_guess, likely_resonances
from avc_casadi.identification.near import roughly
from avc_casadi.identification.predictor import Predictor
from avc_casadi.identification.start import play_guess_m
from avc_casadi.identification.terms import PLAY, TERMS, Structure, lag_of

FIRST_RATE_PER_S = 60.0
"""Of the observer of a search from afar."""
_MOST_STARTS = 2


def starts_of(
    simple: Fit,
    rich: Structure,
    term: str,
    guess: Mapping[str, float],
    response: Response,
    predictor: Predictor,
    sides: Sequence[str],
) -> list[tuple[Structure, dict[str, float]]]:
    """Return where the search for a term may start."""
    values, period = simple.values, predictor.sample_time_s
    force = rich.units["coulomb_friction_n"]
    if term == "coulomb":
        likely = max(guess["coulomb_friction_n"], 0.02 * force)
        return [(rich, {**values, "coulomb_friction_n": one}) for one in (likely, 0.2 * force)]
    if term == "stribeck":
        speed = rich.units["speed_m_per_s"]
        return [
            (rich, {**values, "breakaway_excess_n": 0.0, "stribeck_speed_m_per_s": share * speed})
            for share in (0.05, 0.2)
        ]
    if term == "amplifier":
        return _lags(rich, values, period)
    if term == "resonance":
        found = []
        if simple.observer.rate_per_s > 2 * FIRST_RATE_PER_S:
            values = roughly(predictor, simple.structure, values, FIRST_RATE_PER_S).values
        for side in sides:
            with_side = replace(rich, encoder_at="handle" if side == "handle" else "motor")
            for left, one in likely_resonances(response, values, with_side, period):
                found.append((left, with_side, {**values, **one}))
        found.sort(key=lambda one: one[0])
        return [(with_side, start) for left, with_side, start in found[:_MOST_STARTS] if left < 3 * found[0][0]]
    absent = {**values, **{one.name: 0.0 for one in TERMS[term].parameters}}
    starts = [absent]
    if term == "play":
        starts = [{**absent, PLAY: likely} for likely in _likely_play(simple, rich, predictor)]
    elif term == "stiffness" and (held := held_guess(response, values["delay_samples"] * period)) is not None:
        # A free mass in place of a held one is far off: the way from it may end elsewhere.
        starts.append({**values, "delay_samples": guess["delay_samples"], **held})
    return [(rich, start) for start in starts]


def _lags(rich: Structure, values: Mapping[str, float], period: float) -> list[tuple[Structure, dict[str, float]]]:
    """Return lags and current loops of several bandwidths, each in place of as much delay."""
    found = []
    for order in (1, 2):
        kind = replace(rich, amplifier_order=1 if order == 1 else 2)
        for rate in (0.8 / period, 0.3 / period, 0.1 / period):
            late = lag_of(order, rich.loop_damping_ratio) / (2 * np.pi * rate * period)
            delay = max(values["delay_samples"] - late, 0.0)
            if rate > 1.0:
                found.append((kind, {**values, "amplifier_bandwidth_hz": rate, "delay_samples": delay}))
    return found


def _likely_play(simple: Fit, rich: Structure, predictor: Predictor) -> list[float]:
    """Return where the search for play may start: nowhere in a log that hardly ever turns."""
    if predictor.last_went is None:
        return []
    guess = play_guess_m(predictor.records, predictor.last_went, simple.values["delay_samples"])
    return [0.0, guess] if guess > rich.units[PLAY] else [0.0]
