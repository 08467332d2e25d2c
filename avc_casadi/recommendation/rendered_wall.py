"""What a coupling renders of a wall: stiffness at rest and in motion, impedance error, contact onset, ripple."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self

from avc_casadi._util.json_values import Document
from avc_casadi.claims.impedance import stiffness_at_handle
from avc_casadi.coupling import Coupling
from avc_casadi.recommendation.rendered import (
    NOTICED_N,
    Creep,
    LeavingContact,
    Ripple,
    contact_onset_m,
    creep,
    frequency_sweep,
    leaving_contact,
    rebound,
    ripple,
)
from avc_casadi.simulation.population.trial import CouplingTrial


@dataclass(frozen=True)
class HandleSine:
    """A sine of the handle about a mean depth in the wall."""

    depth_m: float
    amplitude_m: float


@dataclass(frozen=True)
class EncoderStepForce(Document):
    """Force by which a spring and a damper answer one encoder step: k q, and b q/T."""

    JSON_KEYS: ClassVar = (("spring", "spring_n"), ("damping", "damper_n"))

    spring_n: float
    damper_n: float

    @property
    def total_n(self) -> float:
        """Force of both."""
        return self.spring_n + self.damper_n


@dataclass(frozen=True, kw_only=True)
class RenderedWall(Document):
    """What a coupling renders of a wall to hands, against the physical wall k_e + j omega b_e.

    A stiffness and what follows from it is None where the wall has no spring, or no hand ends a press in contact.

    Attributes:
        stiffness_n_per_m: at rest at the sensor, median of the simulated hands.
        stiffness_at_handle_n_per_m: at rest at the handle, with the spring of a flexible device in series.
        share_of_wall: stiffness at rest over that of the wall.
        impedance_error: of a sine of the handle, by its frequency in Hz.
        stiffness_in_motion_n_per_m: of the sine, by its frequency in Hz.
        damping_in_motion_ns_per_m: of the sine, by its frequency in Hz; empty for a wall with a spring.
        sine: the sine of the handle.
        tap_force_n: largest force of a tap.
        tap_depth_m: largest depth of a tap.
        onset_m: depth at which the force begins, by speed; None where it does not begin. Empty without a spring.
        noticed_n: force from which a hand notices it.
        leaving: force that acts after a hand has left the wall; None for a wall without a spring.
        creep: what a hand feels that creeps; None without a dead zone.
        rebound: exit speed of the released device over its approach speed, by that. Empty without a spring.
        vibration: median vibration at rest, in multiples of the detection threshold.
        friction_n: dry friction of the device.
        rest_error_m: how far dry friction holds the handle from rest.
        encoder_step: force by which the coupling answers one encoder step.
        ripple: force ripple of a handle in steady motion.
    """

    JSON_KEYS: ClassVar = (
        "stiffness_n_per_m",
        "stiffness_at_handle_n_per_m",
        "share_of_wall",
        ("complex_error", "impedance_error"),
        "stiffness_in_motion_n_per_m",
        "damping_in_motion_ns_per_m",
        ("shaken", "sine"),
        "tap_force_n",
        "tap_depth_m",
        ("edge_m", "onset_m"),
        ("edge_force_n", "noticed_n"),
        "leaving",
        "creep",
        "rebound",
        "vibration",
        "friction_n",
        "rest_error_m",
        ("encoder_step_n", "encoder_step"),
        "ripple",
    )

    stiffness_n_per_m: float | None
    stiffness_at_handle_n_per_m: float | None
    share_of_wall: float | None
    impedance_error: Mapping[float, float]
    stiffness_in_motion_n_per_m: Mapping[float, float]
    damping_in_motion_ns_per_m: Mapping[float, float]
    sine: HandleSine
    tap_force_n: float
    tap_depth_m: float
    onset_m: Mapping[float, float | None]
    noticed_n: float
    leaving: LeavingContact | None
    creep: Creep | None
    rebound: Mapping[float, float]
    vibration: float
    friction_n: float
    rest_error_m: float | None
    encoder_step: EncoderStepForce
    ripple: Ripple

    @classmethod
    def of(cls, coupling: Coupling, trial: CouplingTrial) -> Self:
        """Return what a coupling renders: simulated sines, strikes and presses, with stiffness and taps of a trial."""
        device, wall = coupling.problem.device, coupling.wall
        springy = wall.stiffness_n_per_m > 0
        sensed = trial.stiffness if springy and math.isfinite(trial.stiffness) else None
        static = coupling.static_stiffness_n_per_m
        motion = frequency_sweep(coupling, static)
        stiffness = motion.by_frequency(motion.stiffness_n_per_m)
        # A wall never pulls, so that of a sine a damper renders the half.
        damping = {} if springy else {hz: value / (math.pi * hz) for hz, value in stiffness.items()}
        damper = coupling.table.at_rest.contact_damping_ns_per_m + wall.damping_ns_per_m
        step_m = device.encoder_resolution_m
        return cls(
            stiffness_n_per_m=sensed,
            stiffness_at_handle_n_per_m=None if sensed is None else stiffness_at_handle(device, sensed),
            share_of_wall=None if sensed is None else trial.share_of_wall,
            impedance_error=motion.by_frequency(motion.error),
            stiffness_in_motion_n_per_m=stiffness,
            damping_in_motion_ns_per_m=damping,
            sine=HandleSine(motion.depth_m, motion.amplitude_m),
            tap_force_n=trial.largest_tap_force_n,
            tap_depth_m=trial.deepest_tap_m,
            onset_m=contact_onset_m(coupling) if springy else {},
            noticed_n=NOTICED_N * device.metres_per_unit,
            leaving=leaving_contact(coupling) if springy else None,
            creep=creep(coupling),
            rebound=rebound(coupling) if springy else {},
            vibration=trial.median_vibration,
            friction_n=device.coulomb_friction_n,
            rest_error_m=device.coulomb_friction_n / sensed if sensed else None,
            encoder_step=EncoderStepForce(static * step_m, damper * step_m / device.sample_time_s),
            ripple=ripple(coupling, trial.seed),
        )

    def document(self) -> dict[str, Any]:
        """Return the JSON document; a wall without a spring has an empty table where others have `leaving`."""
        document = super().document()
        return document if self.leaving is not None else document | {"leaving": {}}
