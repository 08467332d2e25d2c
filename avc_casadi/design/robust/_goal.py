"""What a robust law is searched for: a wall that feels stiff, damped whatever share of the innovation passes."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.stability import force_over_innovation, largest_radius, state_feedback_loop, stiffness_at_rest

if TYPE_CHECKING:
    from avc_casadi.design.robust._loops import Loops
    from avc_casadi.runtime import StateFeedback
    from avc_casadi.stability import Rendering

# Share of the innovation that passes -> decay, 1/s, that oscillations above `_SLOW_HZ` must have.
_DECAY_PER_S = {1.0: 20.2, 0.5: 15.1, 0.25: 11.1, 0.16: 8.0, 0.09: 4.8, 0.05: 3.6, 0.025: 3.4, 0.01: 0.0}
_SLOW_HZ = 2.0
# The same of slower ones, times the share.
_SLOW_DECAY_PER_S = 5.0
VARIED_DECAY_PER_S = {1.0: 10.0, 0.5: 5.0}
"""The same with every hand at every device: a structure stiffer than believed buzzes at half the share first."""
# Decay of the device let go.
_FREE_DECAY_PER_S = 1.0
# Decay with hands on a stylus and fingertips, which are no part of what is promised.
_BESIDE_DECAY_PER_S = 2.0
# Cost of a loop that decays so much slower, for each 1/s.
_PER_DECAY = 1.0
# Beyond it a law is not looked at any further.
_HOPELESS_SOFTNESS, _HOPELESS_RADIUS = 0.6, 1.03
_BUZZ_HZ = 40.0


# Bounds of |C/K - 1|, C the force over the position that is measured: at 3 Hz, and at 10 Hz beside 6 N.s/m of damping.
_SOFTNESS_3HZ, _SOFTNESS_10HZ = 0.30, 0.25
_DAMPING_NS_PER_M = 6.0
# Cost of softness beyond, of the largest |1/(1 + H)|, H the loop cut at the innovation, and of the largest |C|/K.
_PER_SOFTNESS, _PER_SENSITIVITY, _PER_GAIN = 40.0, 2.0, 2.0
_USUAL_SENSITIVITY = 3.0


@dataclass(frozen=True)
class Cost:
    """What a law costs, and what it is.

    Attributes:
        total: to be minimised.
        radius: largest spectral radius with every hand at every device that was looked at; infinite if it was not.
        radius_any_share: the same of the nominal device over all shares of the innovation.
        facts: sensitivity, gain and softness.
    """

    total: float
    radius: float = math.inf
    radius_any_share: float = math.inf
    facts: dict[str, float] = field(default_factory=dict)

    @property
    def holds(self) -> bool:
        """Whether all loops that were looked at are damped."""
        return self.radius < 1 and self.radius_any_share < 1


def cost_of(law: StateFeedback, rendering: Rendering, loops: Loops) -> Cost:
    """Weigh a law.

    Args:
        law: observer and feedback.
        rendering: coupling and wall behind it.
        loops: what it must hold.
    """
    t, stiffness = loops.sample_time_s, stiffness_at_rest(rendering)
    force, believed = force_over_innovation(law, rendering, loops.frequency_hz, t)
    cut = believed - loops.response * force
    rendered = force / (1 + believed) / stiffness
    softness = np.abs(rendered - 1)
    share = np.clip(-cut.real / np.maximum(np.abs(cut) ** 2, 1e-30), 0, 1)
    buzz = loops.frequency_hz > min(_BUZZ_HZ, float(loops.frequency_hz[-2]))
    facts = {
        "sensitivity": float(1 / np.abs(1 + cut).min()),
        "sensitivity_any_share": float(1 / np.abs(1 + share * cut)[:, buzz].min()),
        "gain": float(np.abs(rendered).max()),
        "softness_3hz": float(np.interp(3, loops.frequency_hz, softness)),
        "softness_10hz": float(np.interp(10, loops.frequency_hz, softness)),
    }
    bound = _SOFTNESS_10HZ + 2 * math.pi * 10 * _DAMPING_NS_PER_M / stiffness
    over = max(0.0, facts["softness_3hz"] - _SOFTNESS_3HZ) + max(0.0, facts["softness_10hz"] - bound)
    if over > _HOPELESS_SOFTNESS:
        return Cost(2000 + 1000 * over, facts=facts)
    every = state_feedback_loop(loops.nominal, law, rendering, tuple(_DECAY_PER_S))
    held = largest_radius(state_feedback_loop(loops.varied, law, rendering, tuple(VARIED_DECAY_PER_S)))
    free = largest_radius(state_feedback_loop(loops.free, law, rendering))
    beside = max(float(largest_radius(state_feedback_loop(part, law, rendering)).max()) for part in loops.beside)
    worst_held, asked = held.max(axis=-1), VARIED_DECAY_PER_S.values()
    radius = float(max(worst_held[0], free.max()))
    if radius > _HOPELESS_RADIUS:
        return Cost(1000 + 1000 * (radius - 1), radius, facts=facts)
    total = (
        _PER_SOFTNESS * over
        + _PER_SENSITIVITY * facts["sensitivity"]
        + _PER_SENSITIVITY * max(0.0, facts["sensitivity_any_share"] - _USUAL_SENSITIVITY)
        + _PER_GAIN * facts["gain"]
        + _PER_DECAY * sum(_missing(one, decay, t) for one, decay in zip(worst_held, asked, strict=True))
        + _PER_DECAY * _missing(float(free.max()), _FREE_DECAY_PER_S, t)
        + _PER_DECAY * _missing(beside, _BESIDE_DECAY_PER_S, t)
    )
    worst = 0.0
    for part, (passed, decay) in zip(every, _DECAY_PER_S.items(), strict=True):
        poles = np.linalg.eigvals(part)
        size, quick = np.abs(poles), np.abs(np.angle(poles)) > 2 * math.pi * _SLOW_HZ * t
        worst = max(worst, float(size.max()))
        total += _PER_DECAY * _missing(size[quick].max(initial=0), decay, t)
        total += _PER_DECAY * _missing(size[~quick].max(initial=0), _SLOW_DECAY_PER_S * passed, t)
    return Cost(total, radius, worst, facts)


def _missing(radius: float, decay_per_s: float, sample_time_s: float) -> float:
    """Return by how much a loop decays too slowly, 1/s."""
    return max(0.0, math.log(max(radius, 1e-9)) / sample_time_s + decay_per_s)
