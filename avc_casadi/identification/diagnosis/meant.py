"""The law that ran beside the one that was meant to run."""

from __future__ import annotations

import math

import numpy as np

from avc_casadi._util.text import number
from avc_casadi.claims.stability.frozen_loop import Rendering, joint_rendering
from avc_casadi.coupling import Coupling
from avc_casadi.identification.diagnosis.law import Law
from avc_casadi.identification.diagnosis.log import Log
from avc_casadi.identification.diagnosis.oscillation import Oscillation

# Gains that differ by more than this share are others.
_OTHER = 0.05


def law_differs(
    law: Law,
    found: Oscillation,
    log: Log,
    coupling: Coupling | None,
    stiffness_n_per_m: float | None,
    damping_ns_per_m: float | None,
) -> list[str]:
    """Say where the force that was commanded is not that of the gains that were meant.

    Args:
        law: what the log shows.
        found: the oscillation, at whose frequency springs and dampers are compared.
        log: on its grid.
        coupling: what was meant, or None.
        stiffness_n_per_m: k that was meant, or None.
        damping_ns_per_m: b that was meant, or None.
    """
    if not law.told:
        return []
    period = log.ticks.period_s
    meant: dict[str, float] = {}
    if coupling is not None and coupling.runtime.state_feedback is not None:
        return ["the coupling feeds a state back, which is not compared with the log's spring and damper"]
    if coupling is not None:
        at = coupling.table.at_rest
        gains = (
            np.array([value]) for value in (at.damping_ns_per_m, at.stiffness_n_per_m, at.contact_damping_ns_per_m)
        )
        rendering = joint_rendering(coupling.problem, *gains)
        hertz = found.frequency_hz if math.isfinite(found.frequency_hz) else 10.0
        angle = 2 * math.pi * hertz * period
        asked, ran = _dynamic(rendering, angle), _dynamic(law.rendering(period), angle)
        for what, key, unit in (("spring", "real", "N/m"), ("damper", "imag", "N.s/m")):
            scale = 1.0 if key == "real" else 1 / (2 * math.pi * hertz)
            one, other = float(getattr(asked, key)) * scale, float(getattr(ran, key)) * scale
            if abs(other - one) > _OTHER * max(abs(one), abs(other)):
                meant[f"{what} at {number(hertz, 3)} Hz, {unit}: {number(other, 4)} ran, {number(one, 4)}"] = one
        return [f"the log does not run the coupling that was given: {each} was meant" for each in meant]
    notes = []
    for name, told, wanted, unit in (
        ("k", law.stiffness_n_per_m, stiffness_n_per_m, "N/m"),
        ("b", law.damping_ns_per_m, damping_ns_per_m, "N.s/m"),
    ):
        if wanted is not None and abs(told - wanted) > _OTHER * max(abs(told), abs(wanted)):
            notes.append(
                f"the log does not run the gains that were given: {name} = {number(told, 4)} {unit} ran, "
                f"{number(wanted, 4)} was meant"
            )
    return notes


def _dynamic(rendering: Rendering, angle: float) -> complex:
    """Return force over position at an angle per sample."""
    z = complex(math.cos(angle), math.sin(angle))
    force, state = rendering.force[0], rendering.state[0]
    # The state after a sample enters with the next one.
    own = (state[0] + state[1] / z) / (z - state[2])
    return complex(force[0] + force[1] / z + force[2] * own)
