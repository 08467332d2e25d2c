"""Second-order sections on the measured position."""

from __future__ import annotations

from collections.abc import Sequence

from avc_casadi.scene.loop import Tick


def dc_gain(section: Sequence[float]) -> float:
    """Return the gain of a section at rest."""
    b0, b1, b2, a1, a2 = section
    return (b0 + b1 + b2) / (1 + a1 + a2)


def filter_position(tick: Tick, name: str, section: Sequence[float]) -> None:
    """Pass the position through y(k) = b0 u(k) + b1 u(k-1) + b2 u(k-2) - a1 y(k-1) - a2 y(k-2), at rest at first.

    Args:
        tick: the sample; where the filter's gain is not 1, what follows begins elsewhere.
        name: of its two states.
        section: b0, b1, b2, a1, a2.
    """
    b0, b1, b2, a1, a2 = section
    begin, end = tick.start_m, tick.start_m * dc_gain(section)
    first = tick.state(f"{name}_first_m", end - b0 * begin)
    second = tick.state(f"{name}_second_m", b2 * begin - a2 * end)
    coming = tick.position
    tick.position = b0 * coming + first
    tick.follow(f"{name}_first_m", b1 * coming - a1 * tick.position + second)
    tick.follow(f"{name}_second_m", b2 * coming - a2 * tick.position)
    tick.start_m = end
