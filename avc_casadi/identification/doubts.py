"""What throws doubt on the estimates: intervals hold chance, and what is here leans them by more."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.text import number
from avc_casadi._util.units import FORCE, MASS, METRE, N_PER_M
from avc_casadi.identification.closed_loop import coloured
from avc_casadi.identification.constancy import differences_of_thirds
from avc_casadi.identification.fit import Fit, Window
from avc_casadi.identification.log_consistency import saturation_doubts, unlike_logs
from avc_casadi.identification.model import Doubt
from avc_casadi.identification.predictor import Predictor
from avc_casadi.identification.stops import stops_of
from avc_casadi.identification.uncertainty import SURE, moves_of

# No link and no amplifier has a shorter delay, in samples.
_NO_DELAY = 5e-3


def doubts_of(
    predictor: Predictor,
    fit: Fit,
    half_width: Sequence[float],
    window: Window,
    lags: FloatArray,
    *,
    feedback: bool,
    radius_m: float,
) -> tuple[FloatArray, list[Doubt]]:
    """Return by how much intervals fall short of what parts of the logs say, and what throws doubt on the estimates.

    Args:
        predictor: of the records.
        fit: of them.
        half_width: of the interval of each coordinate, shape (free,).
        window: of the fit.
        lags: autocorrelation of its prediction error.
        feedback: whether the force follows the position.
        radius_m: travel of the handle per unit of position.

    Returns:
        Shifts down and up, in search coordinates, shape (2, free), and doubts.
    """
    beyond, changed = differences_of_thirds(predictor, fit, half_width, radius_m)
    return beyond, [
        *changed,
        *unlike_logs(fit, predictor, radius_m),
        *_of_stops(predictor, fit, window, radius_m),
        *(_of_the_error(feedback=feedback) if coloured(lags, resampled=fit.resampled) else []),
        *_without_delay(fit),
        *saturation_doubts(predictor, fit, window, radius_m),
    ]


def _of_the_error(*, feedback: bool) -> list[Doubt]:
    why = "the prediction error is not white"
    if feedback:
        note = (
            f"the {FORCE} follows the measured position (a closed loop), and {why}: what disturbs the device is not "
            "what the model takes it for, and estimates may be biased; the intervals hold what another observer would "
            f"have found. Better: an external {FORCE} (multisine) beside the controller, hands off"
        )
    else:
        note = f"{why}: something moves the device that the model does not know (a hand, a cable, an unmodelled mode)"
    return [Doubt(why, note)]


def _of_stops(predictor: Predictor, fit: Fit, window: Window, radius_m: float) -> list[Doubt]:
    told = [
        f"{'above' if one.side > 0 else 'below'} {number(one.place_m / radius_m, 3)} {METRE} something of about "
        f"{number(one.stiffness_n_per_m * radius_m**2, 2)} {N_PER_M} pushes back"
        for one in stops_of(predictor, fit, window)
    ]
    if not told:
        return []
    note = (
        f"the device runs into an end stop or a wall: {'; '.join(told)}, which is not in the log's {FORCE}, so that "
        f"{MASS}, damping, friction and a constant {FORCE} lean, and a resonance or play may be none. Better: a log "
        f"that stays clear of it (less {FORCE}, none of the slowest sines, a stiffer centring)"
    )
    return [Doubt("the device runs into a stop", note)]


def _without_delay(fit: Fit) -> list[Doubt]:
    """Return the doubt of a delay that came out at its lower bound, where the log asks for less than none."""
    known = "delay_samples" in fit.structure.known
    if known or "amplifier" in fit.structure.terms or fit.values["delay_samples"] >= _NO_DELAY:
        return []
    why = "the delay came out at 0"
    note = (
        f"{why}: does the log pair each {FORCE} with the position that it was computed from, and hold every tick? Of "
        "every second or tenth one, delay and friction lean"
    )
    moves = moves_of(fit)[:, [one.name for one in fit.structure.free].index("delay_samples")]
    pulled = -moves.sum() > SURE * np.sqrt(moves.size) * moves.std(ddof=1)
    return [Doubt(why, note, None if pulled else frozenset())]
