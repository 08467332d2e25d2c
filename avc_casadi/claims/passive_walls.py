"""Walls K + B (1 - 1/z)/T that are passive: at each frequency a quadratic in K, solved without a search.

On a rigid device with an ideal amplifier and whole samples of delay the condition b_d + Re(z^-d W) >= 0 is linear in K
and B; at the port of any other (`handle_port`) |1 + W X|^2 >= |W|^2 U^2 is quadratic, W = B W_b + K W_k.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi.claims.passivity.handle_port import handle_port
from avc_casadi.claims.passivity.worst_frequency import quadratic_stretch, refine_minima
from avc_casadi.claims.passivity.worst_port import frequencies_hz, passive_hand, wave
from avc_casadi.loops.sampled_loop import Fractions
from avc_casadi.loops.walls import Stretches, stable_walls
from avc_casadi.model.velocity import PLAIN, Poles, low_pass

if TYPE_CHECKING:
    from avc_casadi.model.device import Device
    from avc_casadi.model.problem import Model


_LOWEST_TURNS, _A_HALF_WAVE = 1e-8, 24


def passive_walls(
    corners: Sequence[Device],
    damping_ns_per_m: FloatArray,
    model: Model,
    *,
    ideal: bool,
    poles: Poles = PLAIN,
    more_delay: int = 0,
) -> Stretches:
    """Return the softest interval of stiffnesses with which a wall is passive at every corner of a device."""
    low, high = np.zeros(len(damping_ns_per_m)), np.full(len(damping_ns_per_m), np.inf)
    for corner in corners:
        if ideal:

            def ends(hz: FloatArray, corner: Device = corner) -> tuple[FloatArray, FloatArray]:
                turns = hz * corner.sample_time_s
                late = np.exp(-2j * np.pi * turns * (corner.delay_samples + more_delay))
                damper, spring = (late * one for one in _waves(turns, corner.sample_time_s, model, poles))
                free = corner.damping_ns_per_m + damping_ns_per_m[:, None] * damper.real
                return quadratic_stretch(np.zeros_like(free), spring.real + 0 * free, free)

            order = int(corner.delay_samples) + more_delay + 2
            seeds = np.linspace(_LOWEST_TURNS, 0.5, _A_HALF_WAVE * order + 1) / corner.sample_time_s
            every = np.broadcast_to(seeds, (len(low), len(seeds)))
            softest, stiffest = ends(every)
            if softest.any():
                softest = ends(refine_minima(lambda hz, ends=ends: -ends(hz)[0], every, order))[0]  # type: ignore[misc]
            stiffest = ends(refine_minima(lambda hz, ends=ends: ends(hz)[1], every, order))[1]  # type: ignore[misc]
        else:
            port = handle_port(corner, frequencies_hz(corner))
            damper, spring = _waves(port.turns, corner.sample_time_s, model, poles)
            wall = damping_ns_per_m[:, None] * damper
            bend = -port.excess * np.abs(spring) ** 2 + 0 * wall.real
            slope = 2 * (spring * port.centre).real - 2 * port.excess * (wall * spring.conj()).real
            free = 1 + 2 * (wall * port.centre).real - port.excess * np.abs(wall) ** 2
            softest, stiffest = quadratic_stretch(*(np.where(port.damped, one, -1.0) for one in (bend, slope, free)))
            held = stable_walls([corner], passive_hand(corner), damping_ns_per_m, poles)
            low, high = np.maximum(low, held.lowest_n_per_m[:, 0]), np.minimum(high, held.first_n_per_m)
        low, high = np.maximum(low, softest.max(axis=1)), np.minimum(high, stiffest.min(axis=1))
    none = ~(high > low)
    return Stretches(np.where(none, np.nan, low)[:, None], np.where(none, np.nan, high)[:, None])


def _waves(turns: FloatArray, period: float, model: Model, poles: Poles) -> tuple[ComplexArray, ComplexArray]:
    """Return W of a wall of 1 N.s/m and of one of 1 N/m."""
    nothing, one = np.zeros(1), np.ones(1)
    damper = Fractions(one, nothing, nothing, nothing, one, one > 0)
    direct = period / 2 if model == "paper" else period
    spring = replace(damper, direct=one * direct, integral=one * period)
    back = 2 * np.sin(np.pi * turns) * np.exp(1j * np.pi * (0.5 - turns))
    filtered = wave(damper, nothing, turns, model) * low_pass(back, poles)
    return filtered, wave(spring, nothing, turns, model)
