"""Device and hand as they answered the commanded force: delay, hand and resonance, with their uncertainty."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.identification.diagnosis.declared import Declared
from avc_casadi.identification.diagnosis.level import Level, rms_of
from avc_casadi.identification.diagnosis.log import Log
from avc_casadi.identification.diagnosis.oscillation import Swing
from avc_casadi.identification.diagnosis.search import Fit, Search
from avc_casadi.identification.diagnosis.windows import windows_of

# No device is a mass, a spring and a damper more closely than this share of its motion.
_NEVER_BETTER = 5e-3
# A resonance is looked for where rigid mechanics leave so many times what encoder and noise do.
_UNEXPLAINED = 2.0


def fit_plants(log: Log, swing: Swing, declared: Declared, lag: int, draws: int, seed: int) -> list[Fit]:
    """Fit device and hand, held and let go, with and without a resonance, likeliest first.

    Args:
        log: on its grid.
        swing: its oscillation.
        declared: what is known before.
        lag: samples of the declared delay that lie between position and logged force.
        draws: others to draw of each.
        seed: of the draws.
    """
    windows = windows_of(log, swing)
    swings = float(np.std(swing.fast_m[swing.first : swing.last]))
    noise = math.hypot(log.encoder_m / math.sqrt(12), declared.device.position_noise_rms_m, _NEVER_BETTER * swings)
    mode = "declared" if declared.device.resonance else "none"
    hertz = swing.found.frequency_hz
    # What may be wrong: the delay, a hand that is not there, both, or a resonance that nobody declared.
    structures = [(True, mode, True), (True, mode, False)]
    if declared.known:
        structures += [(False, mode, False), (False, mode, True)]
    searches = [Search(windows, log, declared, lag, *structure, hertz) for structure in structures]
    if declared.known:
        searches.append(Search(windows, log, declared, lag, True, mode, False, hertz, grip=True))
    points = [search.begin(noise) for search in searches]
    left = [search.left(point) for search, point in zip(searches, points, strict=True)]
    # What a grip explains a resonance may explain better.
    plain = [_most(one) for search, one in zip(searches, left, strict=True) if not search.grip]
    if mode == "none" and min(plain) > _UNEXPLAINED * noise:
        searches.append(Search(windows, log, declared, lag, True, "found", False, hertz))
        points.append(searches[-1].begin(noise))
        left.append(searches[-1].left(points[-1]))
    best = {index: min((one[index] for one in left if index in one), key=rms_of) for index in range(len(windows))}
    level = Level.of(best, len(windows), noise, log.encoder_m)
    fits = [search.finish(point, level, noise, draws, seed) for search, point in zip(searches, points, strict=True)]
    # Whoever let go held the device before: that part of the log is as well explained as by the best hand.
    hands = [(search, fit) for search, fit in zip(searches, fits, strict=True) if fit.held]
    before = min(search.cost_before(fit.point, level) for search, fit in hands)
    if any(window.before for window in windows):
        # Then that hand is part of the explanation, with its own unknowns.
        before += min(fit.volume for _, fit in hands)
    fits = [fit if fit.held else replace(fit, cost=fit.cost + before) for fit in fits]
    return sorted(fits, key=lambda fit: fit.cost)


def _most(left: Mapping[int, FloatArray]) -> float:
    return max(rms_of(one) for one in left.values())
