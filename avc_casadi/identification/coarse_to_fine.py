"""Fits from afar, from coarse to fine: roughly at first, then closely where that is worth it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from avc_casadi.identification.fit import Fit, Window, best_observer, fit, slowest_observer
from avc_casadi.identification.predictor import Observer, Predictor
from avc_casadi.identification.record import shortened
from avc_casadi.identification.terms import Structure

FIRST_RATE_PER_S = 60.0
"""Of the observer of a search from afar."""
# Of so many samples a close fit may start.
_ROUGH_SAMPLES = 10_000


def richer(structure: Structure, *terms: str) -> Structure:
    """Return a model with more terms."""
    assumed = {} if "resonance" in terms else structure.assumed
    return replace(structure, terms=structure.ordered((*structure.terms, *terms)), assumed=assumed)


def roughly(predictor: Predictor, structure: Structure, start: Mapping[str, float], rate_per_s: float) -> Fit:
    """Fit with a slow observer, from which a close fit may start: to pieces of long records.

    Args:
        predictor: of the records.
        structure: terms.
        start: values to start from.
        rate_per_s: of the observer.
    """
    records, _ = shortened(predictor.records, _ROUGH_SAMPLES)
    pieces = predictor.of(records) if len(records) > len(predictor.records) else predictor
    window = Window.of([record.position_m.size for record in pieces.records], pieces.sample_time_s)
    observer = Observer(max(rate_per_s, slowest_observer(pieces)))
    return fit(pieces, structure, start, observer, window, steps=12, tolerance=1e-4)


def closely(predictor: Predictor, found: Fit, window: Window) -> Fit:
    """Fit on, to all records, under the observer that the model asks for."""
    observer = best_observer(predictor, found, window)
    return fit(predictor, found.structure, found.values, observer, window, steps=10, tolerance=1e-5)


def rms_m_of(found: Fit) -> float:
    """Return the root mean square of the prediction error."""
    return found.rms_m


def ringing_behind_a_lag(predictor: Predictor, simple: Fit, ringing: Fit, lagging: Fit, window: Window) -> Fit:
    """Fit both at once, from where each alone came out."""
    late = {key: lagging.values[key] for key in ("delay_samples", "amplifier_bandwidth_hz")}
    both = richer(simple.structure, "resonance", "amplifier")
    structure = replace(
        both, encoder_at=ringing.structure.encoder_at, amplifier_order=lagging.structure.amplifier_order
    )
    start = {**ringing.values, **late}
    found = roughly(predictor, structure, start, min(simple.observer.rate_per_s, FIRST_RATE_PER_S))
    return closely(predictor, found, window)
