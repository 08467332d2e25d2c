"""Keys of effects of `EFFECTS` that several packages use; None is taken from device, environment or hands."""

from typing import Any, Literal

from avc_casadi.model import quantity as q
from avc_casadi.model import table as t


class Effect(t.Table):
    """An effect of a scene: the keys of one [[scene.effects]]."""

    kind: Any


class HandEffect(Effect):
    """A hand between its moving target and the device: mass, damper and spring."""

    kind: Literal["hand"] = "hand"
    mass_kg: q.Mass | None = None
    damping_ns_per_m: q.Damping | None = None
    stiffness_n_per_m: q.Stiffness | None = None


class StylusHandEffect(Effect):
    """A hand on a stylus: tip, grip (k1, b1), mass, arm (k2, b2), ground."""

    # Means of 15 subjects: Fu and Cavusoglu 2012.
    kind: Literal["stylus-hand"] = "stylus-hand"
    mass_kg: q.Mass = 0.21
    grip_damping_ns_per_m: q.Damping = 1.3
    grip_stiffness_n_per_m: q.Stiffness = 575.0
    arm_damping_ns_per_m: q.Damping = 11.0
    arm_stiffness_n_per_m: q.Stiffness = 170.0


class _Surroundings(Effect):
    """An environment."""

    damping_ns_per_m: q.Damping | None = None
    stiffness_n_per_m: q.Stiffness | None = None


class WallEffect(_Surroundings):
    """The environment on one side only: no force at x < 0."""

    kind: Literal["wall"] = "wall"


class EnvironmentEffect(_Surroundings):
    """The environment on both sides."""

    kind: Literal["environment"] = "environment"


class SimulationEffect(Effect):
    """The engine and its tool of [simulation], joined to the device by a spring and a damper."""

    kind: Literal["simulation"] = "simulation"
    stiffness_n_per_m: q.Stiffness | None = None
    damping_ns_per_m: q.Damping = 0.0
    local_damping_ns_per_m: q.Damping = 0.0
    contact_stiffness_n_per_m: q.Stiffness | None = None
    dropped_share: q.Share = 0.0
    seed: q.Seed = 0


class LawEffect(Effect):
    """The law of [law] in place of a wall and a coupling; in the wall of [environment] where there is one."""

    kind: Literal["law"] = "law"


class DetentEffect(Effect):
    """The detents of [detent], in addition to the wall."""

    kind: Literal["detent"] = "detent"


class CoulombFrictionEffect(Effect):
    """Dry friction of the device, with true sticking."""

    kind: Literal["coulomb-friction"] = "coulomb-friction"
    force_n: q.Force | None = None


class ViscousFrictionEffect(Effect):
    """Viscous friction of the device."""

    kind: Literal["viscous-friction"] = "viscous-friction"
    damping_ns_per_m: q.Damping | None = None


class ResonanceEffect(Effect):
    """A structural resonance of the device."""

    kind: Literal["resonance"] = "resonance"
    frequency_hz: q.Hertz | None = None
    damping_ratio: q.DampingRatio | None = None
    mass_ratio: q.MassShare | None = None


class BacklashEffect(Effect):
    """Play between the handle and the motor, on which the encoder sits."""

    kind: Literal["backlash"] = "backlash"
    gap_m: q.Length | None = None


class EncoderEffect(Effect):
    """Quantised position, at the motor or at the handle beyond the resonance."""

    kind: Literal["encoder"] = "encoder"
    resolution_m: q.Length | None = None
    at: Literal["motor", "handle"] | None = None


class NoiseEffect(Effect):
    """White noise on the sampled position."""

    kind: Literal["noise"] = "noise"
    rms_m: q.Length | None = None
    seed: q.Seed = 0


class NotchEffect(Effect):
    """A notch on the measured position: gain `depth` at its frequency, `width` its band as a share of that."""

    kind: Literal["notch"] = "notch"
    frequency_hz: q.Hertz
    depth: q.Share = 0.0
    width: q.Threshold = 0.5


class ObserverEffect(Effect):
    """An observer of the position between encoder steps; the mass is that of device and hand together."""

    kind: Literal["observer"] = "observer"
    mass_kg: q.Mass | None = None
    resolution_m: q.Length | None = None
    ahead_samples: q.DelaySamples | None = None


class DelayEffect(Effect):
    """Samples between measurement and force, whole or not."""

    kind: Literal["delay"] = "delay"
    samples: q.DelaySamples | None = None


class JitterEffect(Effect):
    """Irregular sampling and lost samples."""

    kind: Literal["jitter"] = "jitter"
    rms_s: q.Wait
    seed: q.Seed = 0
    dropped_share: q.Share = 0.0


class AmplifierEffect(Effect):
    """Bandwidth of the actuator: a lag of order 1, or a current loop of order 2."""

    kind: Literal["amplifier"] = "amplifier"
    bandwidth_hz: q.Hertz | None = None
    order: Literal[1, 2] | None = None
    damping_ratio: q.LoopDampingRatio | None = None


class SaturationEffect(Effect):
    """Largest force of the actuator."""

    kind: Literal["saturation"] = "saturation"
    force_n: q.ForceLimit | None = None


class EstimatorEffect(Effect):
    """Estimate of the interaction frequency that selects the gains."""

    kind: Literal["estimator"] = "estimator"
    method: Literal["zero-crossing", "spectral-peak", "adaptive-notch", "fused"] = "fused"


class AdaptationEffect(Effect):
    """Adaptation of the gains to the estimate: hold time, slew limit (None: no limit), passivity."""

    kind: Literal["adaptation"] = "adaptation"
    hold_s: q.Wait = 0.0
    slew_per_s: q.Rate | None = None
    passive: bool = True


class GuardEffect(Effect):
    """A guard in the time domain that dissipates what the loop generates."""

    kind: Literal["guard"] = "guard"
    method: Literal["passivity-controller", "energy-tank"] = "passivity-controller"
