"""The numbers of one sample of the loop, with which the page itself moves the device while a hand presses the wall.

The same sample as that of a scene with ``integrator = "projected"``: encoder, observer with state feedback, coupling
and contact law, detents, force limit, delay, amplifier, resonance and dry friction. Noise and backlash are left out,
and named.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from avc_casadi._util.json_values import plain
from avc_casadi.coupling import contact_law
from avc_casadi.model.hands import Hand, hand_ranges
from avc_casadi.model.plant import transition
from avc_casadi.model.sampled_plant import device_plant

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling
    from avc_casadi.model.plant import LinearPlant
    from avc_casadi.model.problem import Problem

# How far the pointer moves a handle, and the least that the trace of its force reaches to.
_REACH_M, _LEAST_N = 0.02, 1.0
SUBSTEPS = 4
"""Steps of a stretch of the sample, in each of which the dry friction is constant."""


def toy_document(problem: Problem, coupling: Coupling | None) -> dict[str, Any]:
    """Return the numbers as JSON values.

    Args:
        problem: device, wall and hands; the hand is the middle one.
        coupling: what runs; None joins device and wall without one.
    """
    device, wall = problem.device, problem.environment
    hand = Hand(*hand_ranges(problem.hands).mean(axis=1).tolist())
    plant = device_plant(device, hand).linear()
    late = device.delay_samples - int(device.delay_samples)
    shares = [late, 1 - late] if late else [1.0]
    rows = None if coupling is None else coupling.table.rows
    law = None if coupling is None else coupling.runtime.state_feedback
    at_handle = device.encoder_at == "handle" and device.resonance is not None
    asked = problem.coupling.contact
    contact = (
        contact_law(asked, wall.stiffness_n_per_m, float("inf"))
        if coupling is None
        else contact_law(asked, wall.stiffness_n_per_m, coupling.table.gains[1])
    )
    left_out = [
        name
        for name, there in (
            ("noise", device.position_noise_rms_m > 0),
            ("backlash", device.backlash_m > 0),
            ("observer between encoder steps", coupling is not None and coupling.runtime.observer_mass_kg is not None),
            ("adaptation: the gains are those of one frequency", coupling is not None and not coupling.table.constant),
        )
        if there
    ]
    found: dict[str, Any] = plain(
        {
            "sample_time_s": device.sample_time_s,
            "reach": _REACH_M / device.metres_per_unit,
            "least_force": _LEAST_N * device.metres_per_unit,
            "detent": None if problem.detent is None else vars(problem.detent),
            "measured": plant.names.index("handle_position_m" if at_handle else "device_position_m"),
            "held": plant.names.index("handle_position_m" if device.resonance is not None else "device_position_m"),
            "hand": vars(hand),
            "encoder_resolution_m": device.encoder_resolution_m,
            "max_force_n": device.max_force_n,
            "whole_delay": int(device.delay_samples),
            "stretches": [_stretch(plant, device.sample_time_s, share) for share in shares],
            "substeps": SUBSTEPS,
            "friction_n": device.coulomb_friction_n,
            "wall": wall.model_dump(),
            "clips_last": contact == "clip-last",
            "rows": rows,
            "state_feedback": None if law is None else vars(law),
            "left_out": left_out,
        }
    )
    return found


def _stretch(plant: LinearPlant, sample_time_s: float, share: float) -> dict[str, Any]:
    """Return the transition of one substep of a part of the sample: state, force, target and friction."""
    step_s = sample_time_s * share / SUBSTEPS
    moves = transition(plant, step_s)
    of_friction = transition(replace(plant, force=plant.friction), step_s).force
    return {
        "step_s": step_s,
        "matrix": moves.matrix,
        "force": moves.force,
        "target": moves.target,
        "friction": of_friction,
    }
