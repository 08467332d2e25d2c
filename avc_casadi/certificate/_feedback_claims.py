"""The claims of a coupling with state feedback, on its own loop and with any share of the innovation passing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi.certificate._certificate import Certificate, Level, LevelResult
from avc_casadi.certificate._levels import Rows, level_result, not_judged
from avc_casadi.loop import LINEAR_KEYS, Hand, device_set, hand_set, no_hand, sampled_plant
from avc_casadi.passivity import passive_limit_n_per_m
from avc_casadi.stability import (
    MAX_DELAY_SAMPLES,
    RADIUS_TOLERANCE,
    fraction_rendering,
    frozen_parts,
    largest_radius,
    plants_with_forces,
    state_feedback_loop,
)

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling
    from avc_casadi.problem import Device
    from avc_casadi.stability import Rendering
    from avc_casadi.support import FloatArray

DRAWS = 24
# From all of the innovation to next to nothing, where the hand alone decides.
SHARES = (1.0, 0.7, 0.5, 0.35, 0.25, 0.16, 0.12, 0.09, 0.06, 0.04, 0.025, 0.01)


@dataclass(frozen=True)
class FeedbackRadius:
    """Spectral radii of the loop of a coupling with state feedback.

    Attributes:
        corners: the devices at the corners of the declared ranges, then some drawn within them.
        hands: every corner of the hands and draws.
        held: radius at each share with each hand at each corner, shape (shares, corners, hands).
        free: radius at each corner, let go, all of the innovation passing, shape (corners,).
    """

    corners: list[Device]
    hands: Hand
    held: FloatArray
    free: FloatArray

    @property
    def worst(self) -> tuple[int, int, int]:
        """Share, corner and hand of the largest radius."""
        share, corner, hand = np.unravel_index(int(np.argmax(self.held)), self.held.shape)
        return int(share), int(corner), int(hand)


def feedback_radius(coupling: Coupling, draws: int = DRAWS, seed: int = 0) -> FeedbackRadius:
    """Judge the loop of a coupling with state feedback at every corner of its device and at some within.

    Args:
        coupling: with constant gains and state feedback.
        draws: hands drawn beside the corners of their ranges.
        seed: of the draws, of hands and devices.

    Raises:
        UnsupportedError: gains that vary, or too long a delay.
    """
    law, problem = coupling.runtime.state_feedback, coupling.problem
    if law is None:
        raise ValueError("the coupling has no state feedback")
    if not coupling.table.constant:
        raise UnsupportedError("state feedback is judged before constant gains only; make the gains constant")
    corners = device_set(problem.device, LINEAR_KEYS, seed=seed)
    if max(corner.delay_samples for corner in corners) > MAX_DELAY_SAMPLES:
        raise UnsupportedError(f"linear stability is computed up to {MAX_DELAY_SAMPLES} samples of delay")
    hands = hand_set(problem.hands, draws=draws, seed=seed)
    rendering = rendering_of(coupling)
    held = state_feedback_loop(plants_with_forces(sampled_plant(corners, hands)), law, rendering, SHARES)
    free = state_feedback_loop(plants_with_forces(sampled_plant(corners, no_hand())), law, rendering)
    radius = largest_radius(held).reshape(len(SHARES), len(corners), len(hands))
    return FeedbackRadius(corners, hands, radius, largest_radius(free)[0])


def rendering_of(coupling: Coupling) -> Rendering:
    """Return coupling and wall as they are rendered behind the feedback."""
    gains = coupling.table.at_rest
    b, k, contact = (np.array([value]) for value in vars(gains).values())
    return fraction_rendering(frozen_parts(coupling.problem, b, k), contact, coupling.sample_time_s)


def certify_feedback(coupling: Coupling, draws: int = DRAWS, seed: int = 0) -> Certificate:
    """Certify a coupling with state feedback: L5 on its own loop; L0 to L4 know gains alone and are not judged."""
    gains, problem = coupling.schedule, coupling.problem
    b, k, contact = gains.damping_ns_per_m, gains.stiffness_n_per_m, gains.contact_damping_ns_per_m
    present = np.isfinite(b) & np.isfinite(k) & np.isfinite(contact)
    rows = Rows(problem, gains.frequency_hz, present, b[present], k[present], contact[present])
    model = problem.stability.model
    why = "the level knows gains alone, and these run behind an observer with state feedback"
    first: tuple[Level, ...] = ("L0", "L1", "L2", "L3", "L4")
    levels: dict[Level, LevelResult] = {level: not_judged(rows, level, model, why) for level in first}
    levels["L5"] = _hands(feedback_radius(coupling, draws, seed), rows)
    device = problem.device
    stiffness = frozen_parts(problem, rows.b, rows.k).integral / device.sample_time_s
    missing = int(np.count_nonzero(~present))
    return Certificate(
        problem=problem.name,
        requested=False,
        frequency_hz=gains.frequency_hz,
        rows_without_gains=missing,
        levels=levels,
        passive_limit_n_per_m=passive_limit_n_per_m(device),
        dc_stiffness_n_per_m=rows.spread(stiffness),
    )


def _hands(found: FeedbackRadius, rows: Rows) -> LevelResult:
    share, _, hand = found.worst
    radius, one = float(found.held.max()), np.ones(len(rows.b))
    held = found.hands.values(hand)
    who = f"{held['mass_kg']:.4g} kg, {held['damping_ns_per_m']:.4g} N.s/m, {held['stiffness_n_per_m']:.4g} N/m"
    claim = (
        f"the loop with observer and state feedback is linearly stable, with no friction, with {len(found.hands)} "
        f"hands of [hands], whatever share of the innovation passes the dead zone"
    )
    if radius >= 1 - RADIUS_TOLERANCE:
        claim = f"Not met: spectral radius {radius:.6g} with a hand of {who} and {SHARES[share]:g} of the innovation"
    passed = np.full(len(rows.b), radius < 1 - RADIUS_TOLERANCE)
    result = level_result(
        rows, "L5", "sampled-data", claim, passed, (1 - radius) * one, 0 * one, RADIUS_TOLERANCE * one
    )
    free = float(found.free.max())
    detail = {
        "spectral_radius": radius,
        "released_spectral_radius": free,
        "released_pass": free < 1 - RADIUS_TOLERANCE,
        "common_lyapunov": None,
        "hands": len(found.hands),
        "worst_hand": held,
        "worst_share": SHARES[share],
    }
    return LevelResult(**{**vars(result), "claim": claim, "margin_ns_per_m": float("nan"), "detail": detail})
