"""An identification as a JSON document and as text, with remarks on its validity."""

from __future__ import annotations

from typing import Any

from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.json_values import plain
from avc_casadi._util.text import number, text_table
from avc_casadi._util.units import FORCE, KG, MASS, METRE, N_PER_M, NEWTON, NS2_PER_M2, spoken_key
from avc_casadi.identification.assumed_mass_ratio import at_the_other_side
from avc_casadi.identification.closed_loop import EXCITATION, OnlyFeedback, coloured
from avc_casadi.identification.fit import Fit
from avc_casadi.identification.model import Identification
from avc_casadi.identification.terms import DEAD_ZONE, DRAG, LOOP_DAMPING, PLAY, words_of

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
                "doubt": one.doubt,
            }
            for key, one in found.estimates.items()
        },
        "refused": [
            {"key": spoken_key(one.key), "why": one.why, "excitation": one.excitation, "bounds": one.bounds}
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
            "names": [*map(spoken_key, found.names)],
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
        "gaps": None if device is None else [*map(spoken_key, device.gaps)],
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
    """Return an identification as printed text."""
    records = f"{found.records} record{'' if found.records == 1 else 's'}"
    terms = words_of(found.terms, found.amplifier_order)
    lines = [
        f"{number(found.seconds, 3)} s in {records} at {number(1 / found.sample_time_s)} Hz; fitted: {terms}",
        "",
        text_table(
            ("what", "value", "from", "to", "unit", "how"),
            [
                (
                    spoken_key(one.key),
                    *(number(each, one.digits(2, 4)) for each in (one.value, one.low, one.high)),
                    one.unit or "-",
                    one.told,
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
        lines += ["", "not identified:"]
        lines += [
            f"  {spoken_key(one.key)}: {one.why}; it would be identified by {one.excitation}" for one in found.refused
        ]
    if found.notes:
        lines += ["", *(f"note: {note}" for note in found.notes)]
    return "\n".join(lines)


# A structural mode is damped by less than this.
_PLAYS = 0.2


def remarks(
    fit: Fit,
    lags: FloatArray,
    feedback: bool,
    driven: OnlyFeedback | None,
    radius_m: float,
) -> list[str]:
    """Return remarks on what may invalidate the estimates, one sentence each.

    Args:
        fit: of the logs.
        lags: autocorrelation of its prediction error.
        feedback: whether the force follows the position.
        driven: the controller that makes the whole force, where something else moves the device.
        radius_m: travel of the handle per unit of position.
    """
    notes = []
    if "stiffness" in fit.structure.terms:
        stiffness = number(fit.values["stiffness_n_per_m"] * radius_m**2)
        notes.append(
            f"a spring of {stiffness} {N_PER_M} holds the device (its own, a hand, a cable, gravity along an arc): "
            f"{MASS} and damping are those of the device with what holds it. A device file has no key for the spring: "
            "loops are designed and judged without it, softer by it than they are; log the device released where it "
            "can be"
        )
    other = at_the_other_side(fit)
    if other:
        mass, spring = (number(other[key] * radius_m**2, 3) for key in ("mass_kg", "stiffness_n_per_m"))
        notes.append(
            "the spring may be on either side of the resonance, which this log does not tell: at the motor it has "
            f"{spring} {N_PER_M}, and the device {mass} {KG}; the intervals hold both"
        )
    if "amplifier" in fit.structure.terms:
        notes.append(
            "a filter of the position before it was logged looks like this amplifier, and then leans delay and "
            "friction; log the encoder's counts as they are"
        )
        if fit.structure.amplifier_order == 1:
            notes.append(
                "a current loop damped by 1.5 and more is this lag, with its quicker pole counted in the delay: the "
                "same device, in other numbers"
            )
        elif LOOP_DAMPING not in fit.structure.terms:
            notes.append(
                f"the current loop is taken with a damping ratio of {number(fit.structure.loop_damping_ratio, 2)} "
                "(amplifier_damping_ratio), which the log does not tell; the intervals hold others that do as well"
            )
    if "resonance" in fit.structure.terms and fit.values["resonance.damping_ratio"] > _PLAYS:
        notes.append(
            f"a resonance that is damped by {number(fit.values['resonance.damping_ratio'], 2)} is rarely one of a "
            "structure: play in the transmission looks like one; that of a structure stays where it is with half the "
            f"{FORCE}"
        )
    if "play" in fit.structure.terms:
        notes.append(
            "where the device turns, the position stands still and then goes on at speed: the encoder stands behind "
            f"play of {number(fit.values[PLAY] / radius_m, 2)} {METRE} ({spoken_key('backlash_m')}); {MASS}, damping "
            "and friction are those beside it, and what is found with this file knows of it. Better: take the play up "
            "(preload, a tighter belt or capstan)"
        )
    if "dead-zone" in fit.structure.terms:
        notes.append(
            f"the amplifier gives nothing for a {FORCE} below {number(fit.values[DEAD_ZONE] * radius_m, 2)} {NEWTON}, "
            f"and so much less of a larger one ({spoken_key(DEAD_ZONE)}: the dead zone of a bridge, a valve, a gear): "
            f"{MASS}, damping and friction are those behind it. A device file has no key for it: add it to the "
            "command, along its sign"
        )
    if "drag" in fit.structure.terms:
        drag = f"{number(fit.values[DRAG] * radius_m**3, 3)} {NS2_PER_M2}"
        notes.append(
            f"a drag of {drag} times the square of the speed ({spoken_key(DRAG)}) is beside damping and friction: the "
            "damping is that at low speed, which a device file holds"
        )
    if driven is not None:
        notes.append(
            f"{driven.sentence(radius_m)}, and the device goes on moving: a hand or something else moves it, whose "
            f"{FORCE} is not in the log, so that {MASS}, damping and friction are not identified. Better: {EXCITATION}"
        )
    elif feedback and not coloured(lags, resampled=fit.resampled):
        notes.append(
            f"the {FORCE} follows the measured position (a closed loop), and the prediction error is white: the loop "
            "by itself does not bias the estimates, which is no proof of the model"
        )
    return notes
