"""An identification as a JSON document and as text."""

from __future__ import annotations

from typing import Any

from avc_casadi._util.json_values import plain
from avc_casadi._util.text import number, text_table
from avc_casadi.identification.model import Identification
from avc_casadi.identification.terms import words_of

SCHEMA = "avc-identify/1"


def identification_document(found: Identification) -> dict[str, Any]:
    """Return the document ``avc-identify/1``."""
    device = found.device
    document = {
        "schema": SCHEMA,
        "logs": list(found.sources),
        "seconds": found.seconds,
        "records": found.records,
        "sample_time_s": found.sample_time_s,
        "terms": list(found.terms),
        "encoder_at": found.encoder_at,
        "amplifier_order": found.amplifier_order,
        "estimates": {
            key: {
                "value": one.value,
                "low": one.low,
                "high": one.high,
                "level": one.level,
                "unit": one.unit,
                "how": one.how,
            }
            for key, one in found.estimates.items()
        },
        "refused": [
            {"key": one.key, "why": one.why, "excitation": one.excitation, "bounds": one.bounds}
            for one in found.refused
        ],
        "evidence": [
            {
                "term": one.term,
                "taken": one.taken,
                "held_out_change": one.held_out_change,
                "standard_errors": one.standard_errors,
                "why": one.why,
            }
            for one in found.trials
        ],
        "correlation": {
            "names": list(found.names),
            "of_estimates": found.correlation,
            "of_sensitivities": found.sensitivity,
        },
        "collinearity": found.collinearity,
        "intervals_from": found.spread_from,
        "prediction_error_rms_m": found.error_rms_m,
        "observer_rate_per_s": found.observer_rate_per_s,
        "closed_loop": found.feedback,
        "error_autocorrelation": found.lags,
        "notes": list(found.notes),
        "device": None if device is None else device.device.model_dump(mode="json", exclude_unset=True),
        "gaps": None if device is None else list(device.gaps),
        "response": {
            "frequency_hz": found.response.frequency_hz,
            "measured_re": found.response.velocity_per_force.real,
            "measured_im": found.response.velocity_per_force.imag,
            "model_re": found.modelled.real,
            "model_im": found.modelled.imag,
            "coherence": found.response.coherence,
        },
    }
    result: dict[str, Any] = plain(document)
    return result


def identification_text(found: Identification) -> str:
    """Return the same for people."""
    records = f"{found.records} record{'' if found.records == 1 else 's'}"
    terms = words_of(found.terms, found.amplifier_order)
    lines = [
        f"{number(found.seconds, 3)} s in {records} at {number(1 / found.sample_time_s)} Hz; fitted: {terms}",
        "",
        text_table(
            ("what", "value", "from", "to", "unit", "how"),
            [
                (
                    one.key,
                    *(number(each, one.digits(2, 4)) for each in (one.value, one.low, one.high)),
                    one.unit or "-",
                    one.how,
                )
                for one in found.estimates.values()
            ],
            left=(0, 4, 5),
        ),
        f"  intervals of 95 % from {found.spread_from}",
        "",
        "evidence: change of the squared prediction error on stretches held out",
        text_table(
            ("term", "taken", "change\n%", "standard\nerrors", "why"),
            [
                (
                    one.term,
                    "yes" if one.taken else "no",
                    number(100 * one.held_out_change, 3),
                    number(one.standard_errors, 2),
                    one.why,
                )
                for one in found.trials
            ],
            left=(0, 1, 4),
        ),
    ]
    if found.refused:
        lines += ["", "not told:"]
        lines += [f"  {one.key}: {one.why}; it would be told by {one.excitation}" for one in found.refused]
    if found.notes:
        lines += ["", *(f"note: {note}" for note in found.notes)]
    return "\n".join(lines)
