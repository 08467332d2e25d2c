"""RuntimeFigures: what the generated parts of the control tick are made for."""

from __future__ import annotations

from dataclasses import dataclass

# In the order of the numbers that HELLO gives them.
ESTIMATOR_NUMBERS = ("zero-crossing", "spectral-peak", "adaptive-notch", "fused")


@dataclass(frozen=True)
class RuntimeFigures:
    """What a firmware is generated for.

    Attributes:
        sample_time_s: T.
        metres_per_count: of the encoder; sets the estimator's floor.
        estimator: method.
        hold_s: how long a lost estimate is kept.
        slew_per_s: largest relative change of a gain, a second; None for no limit.
        passive: whether gains change without creating energy, with anchor and tank.
        guard_damping_ns_per_m: most that the guard adds: the device's own damping.
        hand_m_per_unit: how far the hand moves for a unit of the position: 1, or the radius of a handle that turns;
            what the estimator takes for motion is told there.
    """

    sample_time_s: float = 1e-3
    metres_per_count: float = 2e-6
    estimator: str = "fused"
    hold_s: float = 0.2
    slew_per_s: float | None = 20.0
    passive: bool = True
    guard_damping_ns_per_m: float = 2.0
    hand_m_per_unit: float = 1.0
