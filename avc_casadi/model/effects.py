"""Keys of effects that the model or several rooms use; each belongs to an effect of `EFFECTS`.

A new effect has its keys in its own file. A value that is None is taken from the device, the environment or the hands
when the scene is built.
"""

from typing import Any, Literal

from avc_casadi.model import quantity as q
from avc_casadi.model import table as t


class EffectTable(t.Table):
    """An effect of a scene: the keys of one [[scene.effects]].

    Attributes:
        kind: which; a name that `avc_casadi.model.registries.EFFECTS` knows.
    """

    kind: Any


class HandEffect(EffectTable):
    """A hand between its moving target and the device: mass, damper and spring.

    Attributes:
        mass_kg: None: the middle of [hands].
        damping_ns_per_m: None: the middle of [hands].
        stiffness_n_per_m: None: the middle of [hands].
    """

    kind: Literal["hand"] = "hand"
    mass_kg: q.Mass | None = None
    damping_ns_per_m: q.Damping | None = None
    stiffness_n_per_m: q.Stiffness | None = None


class StylusHandEffect(EffectTable):
    """A hand on a stylus: tip, grip (k1, b1), mass, arm (k2, b2), ground.

    The defaults are the means of 15 subjects (Fu & Cavusoglu 2012).

    Attributes:
        mass_kg: between grip and arm.
        grip_damping_ns_per_m: b1.
        grip_stiffness_n_per_m: k1.
        arm_damping_ns_per_m: b2.
        arm_stiffness_n_per_m: k2.
    """

    kind: Literal["stylus-hand"] = "stylus-hand"
    mass_kg: q.Mass = 0.21
    grip_damping_ns_per_m: q.Damping = 1.3
    grip_stiffness_n_per_m: q.Stiffness = 575.0
    arm_damping_ns_per_m: q.Damping = 11.0
    arm_stiffness_n_per_m: q.Stiffness = 170.0


class _Surroundings(EffectTable):
    """An environment.

    Attributes:
        damping_ns_per_m: None: that of [environment].
        stiffness_n_per_m: None: that of [environment].
    """

    damping_ns_per_m: q.Damping | None = None
    stiffness_n_per_m: q.Stiffness | None = None


class WallEffect(_Surroundings):
    """The environment on one side only: no force at x < 0."""

    kind: Literal["wall"] = "wall"


class EnvironmentEffect(_Surroundings):
    """The environment on both sides."""

    kind: Literal["environment"] = "environment"


class SimulationEffect(EffectTable):
    """The engine and its tool of [simulation], joined to the device by a spring and a damper.

    Attributes:
        stiffness_n_per_m: K, at the device; None: that of the coupling that is simulated.
        damping_ns_per_m: B, at the device.
        local_damping_ns_per_m: damper of the device's own loop.
        contact_stiffness_n_per_m: of the object touched at x = 0, in the scene; None: the stiffest of [simulation].
        dropped_share: share of the engine's steps that it misses.
        seed: of the draw of missed steps, and of steps between two lengths.
    """

    kind: Literal["simulation"] = "simulation"
    stiffness_n_per_m: q.Stiffness | None = None
    damping_ns_per_m: q.Damping = 0.0
    local_damping_ns_per_m: q.Damping = 0.0
    contact_stiffness_n_per_m: q.Stiffness | None = None
    dropped_share: q.Share = 0.0
    seed: q.Seed = 0


class DetentEffect(EffectTable):
    """The detents of [detent], beside the wall."""

    kind: Literal["detent"] = "detent"


class CoulombFrictionEffect(EffectTable):
    """Dry friction of the device, with true sticking.

    Attributes:
        force_n: None: that of [device].
    """

    kind: Literal["coulomb-friction"] = "coulomb-friction"
    force_n: q.Force | None = None


class ViscousFrictionEffect(EffectTable):
    """Viscous friction of the device.

    Attributes:
        damping_ns_per_m: on top of the device's own; required.
    """

    kind: Literal["viscous-friction"] = "viscous-friction"
    damping_ns_per_m: q.Damping | None = None


class ResonanceEffect(EffectTable):
    """A structural resonance of the device.

    Attributes:
        frequency_hz: None: that of [device].
        damping_ratio: None: that of [device].
        mass_ratio: share of the handle in the mass; None: that of [device].
    """

    kind: Literal["resonance"] = "resonance"
    frequency_hz: q.Hertz | None = None
    damping_ratio: q.DampingRatio | None = None
    mass_ratio: q.MassRatio | None = None


class BacklashEffect(EffectTable):
    """Play between the handle and the motor, on which the encoder sits.

    Attributes:
        gap_m: the play; None: that of [device].
    """

    kind: Literal["backlash"] = "backlash"
    gap_m: q.Length | None = None


class EncoderEffect(EffectTable):
    """Quantised position, at the motor or at the handle beyond the resonance.

    Attributes:
        resolution_m: a step; None: that of [device].
        at: the side of the resonance; None: that of [device].
    """

    kind: Literal["encoder"] = "encoder"
    resolution_m: q.Length | None = None
    at: Literal["motor", "handle"] | None = None


class NoiseEffect(EffectTable):
    """White noise on the sampled position.

    Attributes:
        rms_m: None: that of [device].
        seed: of the draw.
    """

    kind: Literal["noise"] = "noise"
    rms_m: q.Length | None = None
    seed: q.Seed = 0


class NotchEffect(EffectTable):
    """A notch on the measured position: gain `depth` at its frequency, `width` its band as a share of that.

    Attributes:
        frequency_hz: its middle.
        depth: gain there.
        width: its band as a share of that frequency.
    """

    kind: Literal["notch"] = "notch"
    frequency_hz: q.Hertz
    depth: q.Share = 0.0
    width: q.Threshold = 0.5


class ObserverEffect(EffectTable):
    """An observer of the position between encoder steps; the mass is that of device and hand together.

    Its resolution and its prediction horizon default to those of encoder and delay.

    Attributes:
        mass_kg: of device and hand together; None: a little more than device and lightest hand.
        resolution_m: encoder step that it assumes; None: that of the encoder.
        ahead_samples: prediction horizon; None: the delay.
    """

    kind: Literal["observer"] = "observer"
    mass_kg: q.Mass | None = None
    resolution_m: q.Length | None = None
    ahead_samples: q.DelaySamples | None = None


class StateFeedbackEffect(EffectTable):
    """An observer with a dead zone and state feedback, as of a robust design; its states are lengths.

    Attributes:
        state: matrix from state to state, by rows.
        force_m_per_n: from force to state.
        innovation: from innovation to state.
        feedback: weights of the states in the position that the wall acts on.
        positions: which states are positions.
        measures: which one is measured.
        dead_zone_m: half width of the dead zone of the innovation.
        face_m: outward shift of the wall's face, which compensates the lag of the dead zone.
    """

    kind: Literal["state-feedback"] = "state-feedback"
    state: q.EntryRows
    force_m_per_n: q.Entries
    innovation: q.Entries
    feedback: q.Entries
    positions: q.Places
    measures: q.Place = 0
    dead_zone_m: q.Length = 0.0
    face_m: q.Length = 0.0


class DelayEffect(EffectTable):
    """Samples between measurement and force, whole or not.

    Attributes:
        samples: None: that of [device].
    """

    kind: Literal["delay"] = "delay"
    samples: q.DelaySamples | None = None


class JitterEffect(EffectTable):
    """Irregular sampling and lost samples.

    Attributes:
        rms_s: of the forces' delay.
        seed: of the draw.
        dropped_share: of samples that are lost.
    """

    kind: Literal["jitter"] = "jitter"
    rms_s: q.Wait
    seed: q.Seed = 0
    dropped_share: q.Share = 0.0


class AmplifierEffect(EffectTable):
    """Bandwidth of the actuator: a lag of order 1, or a current loop of order 2.

    Attributes:
        bandwidth_hz: None: that of [device].
        order: None: that of [device].
        damping_ratio: of a current loop; None: that of [device].
    """

    kind: Literal["amplifier"] = "amplifier"
    bandwidth_hz: q.Hertz | None = None
    order: Literal[1, 2] | None = None
    damping_ratio: q.LoopDampingRatio | None = None


class SaturationEffect(EffectTable):
    """Largest force of the actuator.

    Attributes:
        force_n: None: that of [device].
    """

    kind: Literal["saturation"] = "saturation"
    force_n: q.ForceLimit | None = None


class EstimatorEffect(EffectTable):
    """Estimate of the interaction frequency that selects the gains.

    Attributes:
        method: which algorithm.
    """

    kind: Literal["estimator"] = "estimator"
    method: Literal["zero-crossing", "spectral-peak", "adaptive-notch", "fused"] = "fused"


class AdaptationEffect(EffectTable):
    """Adaptation of the gains to the estimate: hold time, slew limit (None: no limit), passivity.

    Attributes:
        hold_s: time for which a lost estimate is held.
        slew_per_s: largest relative change of a gain per second; None: no limit.
        passive: whether changes must not create energy.
    """

    kind: Literal["adaptation"] = "adaptation"
    hold_s: q.Wait = 0.0
    slew_per_s: q.Rate | None = None
    passive: bool = True


class GuardEffect(EffectTable):
    """A guard in the time domain that dissipates what the loop generates.

    Attributes:
        method: a passivity controller, or an energy tank.
    """

    kind: Literal["guard"] = "guard"
    method: Literal["passivity-controller", "energy-tank"] = "passivity-controller"


Effect = EffectTable
