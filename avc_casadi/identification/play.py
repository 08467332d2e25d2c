"""Play: a position that stands still where the device turns, and goes on at speed.

An encoder behind a play of g follows only when g is taken up: the position that it measures is that of the mass less
g/2 in the direction in which it last went. Where it turned stands in the log, and of the mass taking up the play it is
known that it sets out slowly: what the play hides is then g/2 times a number between -1 and 1 for each sample, and g is
one number more. Dry friction holds a device as well where it turns, but lets it go from rest.
"""

from __future__ import annotations

import numpy as np

from avc_casadi._util.arrays import FloatArray

# A turn goes back by more than these shares of the encoder's step, or of what noise does; it begins by more than those.
_BACK_STEPS, _BACK_NOISE = 1.5, 6.0
_OFF_STEPS, _OFF_NOISE = 0.5, 3.0
# Of what the mass has gone through the play, this power of the time: it sets out slowly.
SLOWLY, EVENLY = 2.0, 1.0
# The encoder follows within the sample in which it is first seen to.
_WITHIN = 0.5
# Fewer turns say little of what is alike in all of them.
_FEWEST = 8
# Share of the spectrum, its upper end, in which no device moves.
_NOISE_ONLY = 0.2


def last_went(position_m: FloatArray, step_m: float, power: float = SLOWLY) -> FloatArray | None:
    """Return which way a position last went, from -1 to 1 while it turns; None where it hardly ever turns.

    Args:
        position_m: measured, shape (samples,).
        step_m: of the encoder; 0 without one.
        power: of the time, by which the play is taken up.
    """
    noise = _noise_m(position_m)
    off = max(_OFF_STEPS * step_m, _OFF_NOISE * noise)
    turns = _turns(position_m, max(_BACK_STEPS * step_m, _BACK_NOISE * noise))
    if len(turns) < _FEWEST:
        return None
    way = np.empty(position_m.size)
    way[:] = turns[0][2]
    for turn, back, was in turns:
        goes = back
        while goes > turn and abs(position_m[goes - 1] - position_m[turn]) > off:
            goes -= 1
        share = np.minimum(np.arange(goes - turn + 1) / max(goes - turn - _WITHIN, _WITHIN), 1.0)
        way[turn : goes + 1] = was * (1 - 2 * share**power)
        way[goes:] = -was
    return way


def _turns(position: FloatArray, least: float) -> list[tuple[int, int, int]]:
    """Return where a position turned, seen once it is back by more than the least, and the way before."""
    found = []
    way, at, low, high = 0, 0, 0, 0
    values = position.tolist()
    for index, value in enumerate(values):
        if way == 0:
            low, high = (index if value < values[low] else low), (index if value > values[high] else high)
            if max(value - values[low], values[high] - value) > least:
                way, at = (1 if value - values[low] > least else -1), index
        elif way * (value - values[at]) > 0:
            at = index
        elif way * (values[at] - value) > least:
            found.append((at, index, way))
            way, at = -way, index
    return found


def _noise_m(position: FloatArray) -> float:
    """Return the noise of the readings, rounding included, root mean square."""
    window = np.hanning(position.size)
    power = np.abs(np.fft.rfft((position - position.mean()) * window)) ** 2
    top = power[-max(1, int(_NOISE_ONLY * power.size)) :]
    return float(np.sqrt(np.mean(top) / np.sum(window**2)))
