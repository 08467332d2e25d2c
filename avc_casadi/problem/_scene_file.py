"""The scene of a problem file: motion of the hand's target, coupling and the effects to simulate.

A value that is None is taken from the device, the environment or the hands when the scene is built.
"""

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from avc_casadi.problem._quantity import (
    Damping,
    DampingRatio,
    DelaySamples,
    Entries,
    EntryRows,
    Force,
    ForceLimit,
    Hertz,
    Length,
    Mass,
    MassRatio,
    Place,
    Places,
    Position,
    Rate,
    Sections,
    Seed,
    Share,
    Span,
    Speed,
    Stiffness,
    Substeps,
    Threshold,
    Wait,
    refusal,
    shown,
)
from avc_casadi.problem._table import Table

CouplingChoice = Literal["none", "static", "static-tuned", "closed-form", "direct", "schedule"]
Integrator = Literal["exact", "projected", "rk4"]


class _Motion(Table):
    """Motion of the hand's target along the axis of the device; the wall begins at 0 and lies at x > 0."""

    start_m: Position = -0.01
    end_m: Position = 0.01
    speed_m_per_s: Speed = 0.07


class Press(_Motion):
    """From start to end at constant speed, then stay."""

    kind: Literal["press"] = "press"


class Tap(_Motion):
    """To and fro between start and end."""

    kind: Literal["tap"] = "tap"
    frequency_hz: Hertz = 2.0


class Hold(_Motion):
    """Rest at the end from the beginning on."""

    kind: Literal["hold"] = "hold"


class Stroke(_Motion):
    """From start to end at constant speed, then oscillate about the end."""

    kind: Literal["stroke"] = "stroke"
    frequency_hz: Hertz = 1.0
    amplitude_m: Length = 0.005


class Free(_Motion):
    """Oscillate about the start."""

    kind: Literal["free"] = "free"
    frequency_hz: Hertz = 1.0
    amplitude_m: Length = 0.005


class HandEffect(Table):
    """A hand between its moving target and the device: mass, damper and spring."""

    kind: Literal["hand"] = "hand"
    mass_kg: Mass | None = None
    damping_ns_per_m: Damping | None = None
    stiffness_n_per_m: Stiffness | None = None


class StylusHandEffect(Table):
    """A hand on a stylus: tip, grip (k1, b1), mass, arm (k2, b2), ground.

    The defaults are the means of 15 subjects (Fu & Cavusoglu 2012).
    """

    kind: Literal["stylus-hand"] = "stylus-hand"
    mass_kg: Mass = 0.21
    grip_damping_ns_per_m: Damping = 1.3
    grip_stiffness_n_per_m: Stiffness = 575.0
    arm_damping_ns_per_m: Damping = 11.0
    arm_stiffness_n_per_m: Stiffness = 170.0


class WallEffect(Table):
    """The environment on one side only: no force at x < 0."""

    kind: Literal["wall"] = "wall"
    damping_ns_per_m: Damping | None = None
    stiffness_n_per_m: Stiffness | None = None


class EnvironmentEffect(Table):
    """The environment on both sides."""

    kind: Literal["environment"] = "environment"
    damping_ns_per_m: Damping | None = None
    stiffness_n_per_m: Stiffness | None = None


class CoulombFrictionEffect(Table):
    """Dry friction of the device, with true sticking."""

    kind: Literal["coulomb-friction"] = "coulomb-friction"
    force_n: Force | None = None


class ViscousFrictionEffect(Table):
    """Viscous friction of the device."""

    kind: Literal["viscous-friction"] = "viscous-friction"
    damping_ns_per_m: Damping | None = None


class ResonanceEffect(Table):
    """A structural resonance of the device."""

    kind: Literal["resonance"] = "resonance"
    frequency_hz: Hertz | None = None
    damping_ratio: DampingRatio | None = None
    mass_ratio: MassRatio | None = None


class BacklashEffect(Table):
    """Play between the handle and the motor, on which the encoder sits."""

    kind: Literal["backlash"] = "backlash"
    gap_m: Length | None = None


class EncoderEffect(Table):
    """Quantised position, at the motor or at the handle beyond the resonance."""

    kind: Literal["encoder"] = "encoder"
    resolution_m: Length | None = None
    at: Literal["motor", "handle"] | None = None


class NoiseEffect(Table):
    """White noise on the sampled position."""

    kind: Literal["noise"] = "noise"
    rms_m: Length | None = None
    seed: Seed = 0


class VelocityFilterEffect(Table):
    """First-order low pass on the velocity."""

    kind: Literal["velocity-filter"] = "velocity-filter"
    cutoff_hz: Hertz


class NotchEffect(Table):
    """A notch on the measured position: gain `depth` at its frequency, `width` its band as a share of that."""

    kind: Literal["notch"] = "notch"
    frequency_hz: Hertz
    depth: Share = 0.0
    width: Threshold = 0.5


class CompensatorEffect(Table):
    """A linear discrete filter on the measured position, in second-order sections [b0, b1, b2, a1, a2]."""

    kind: Literal["compensator"] = "compensator"
    sections: Sections


class ObserverEffect(Table):
    """An observer of the position between encoder steps; the mass is that of device and hand together.

    The steps that it looks between and the samples that it looks ahead are those of encoder and delay, if left out.
    """

    kind: Literal["observer"] = "observer"
    mass_kg: Mass | None = None
    resolution_m: Length | None = None
    ahead_samples: DelaySamples | None = None


class StateFeedbackEffect(Table):
    """An observer with a dead zone and state feedback, as a robust design makes it; its states are lengths."""

    kind: Literal["state-feedback"] = "state-feedback"
    state: EntryRows
    force_m_per_n: Entries
    innovation: Entries
    feedback: Entries
    positions: Places
    measures: Place = 0
    dead_zone_m: Length = 0.0
    face_m: Length = 0.0


class DelayEffect(Table):
    """Samples between measurement and force, whole or not."""

    kind: Literal["delay"] = "delay"
    samples: DelaySamples | None = None


class JitterEffect(Table):
    """Irregular sampling and lost samples."""

    kind: Literal["jitter"] = "jitter"
    rms_s: Wait
    seed: Seed = 0
    dropped_share: Share = 0.0


class AmplifierEffect(Table):
    """Bandwidth of the actuator: a lag of order 1, or a current loop of order 2."""

    kind: Literal["amplifier"] = "amplifier"
    bandwidth_hz: Hertz | None = None
    order: Literal[1, 2] | None = None


class SaturationEffect(Table):
    """Largest force of the actuator."""

    kind: Literal["saturation"] = "saturation"
    force_n: ForceLimit | None = None


class EstimatorEffect(Table):
    """Estimate of the interaction frequency that selects the gains."""

    kind: Literal["estimator"] = "estimator"
    method: Literal["zero-crossing", "spectral-peak", "adaptive-notch", "fused"] = "fused"


class AdaptationEffect(Table):
    """How the gains follow the estimate: wait, limited slew (None: no limit), without creating energy."""

    kind: Literal["adaptation"] = "adaptation"
    hold_s: Wait = 0.0
    slew_per_s: Rate | None = None
    passive: bool = True


class GuardEffect(Table):
    """A guard in the time domain that dissipates what the loop generates."""

    kind: Literal["guard"] = "guard"
    method: Literal["passivity-controller", "energy-tank"] = "passivity-controller"


Motion = Annotated[Press | Tap | Hold | Stroke | Free, Field(discriminator="kind")]
Effect = Annotated[
    HandEffect
    | StylusHandEffect
    | WallEffect
    | EnvironmentEffect
    | CoulombFrictionEffect
    | ViscousFrictionEffect
    | ResonanceEffect
    | BacklashEffect
    | EncoderEffect
    | NoiseEffect
    | VelocityFilterEffect
    | ObserverEffect
    | StateFeedbackEffect
    | NotchEffect
    | CompensatorEffect
    | DelayEffect
    | JitterEffect
    | AmplifierEffect
    | SaturationEffect
    | EstimatorEffect
    | AdaptationEffect
    | GuardEffect,
    Field(discriminator="kind"),
]


def _tables(value: Any) -> Any:
    if not isinstance(value, list | tuple):
        raise refusal(f"is {shown(value)}; allowed: one [[scene.effects]] for each effect")
    return tuple(value)


class Scene(Table):
    """What is simulated: the motion of the hand's target, the coupling and the effects.

    With effects listed these and nothing else; without any, a hand, a wall and all that the device declares.

    A gain table is read at the interaction frequency, None being its lowest.
    """

    duration_s: Span = 3.0
    coupling: CouplingChoice = "static"
    interaction_hz: Hertz | None = None
    integrator: Integrator = "exact"
    substeps: Substeps = 1
    motion: Motion = Press()
    effects: Annotated[tuple[Effect, ...], BeforeValidator(_tables)] = ()
