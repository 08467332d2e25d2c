"""What runs beside the gains: velocity filter, observer, estimator, adaptation, guard; and their effects in a scene."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, Literal

import numpy as np

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi.model import quantity as q
from avc_casadi.model import table as t
from avc_casadi.model.device import Device
from avc_casadi.model.effects import AdaptationEffect, Effect, EstimatorEffect, GuardEffect, ObserverEffect
from avc_casadi.model.scene import Scene

Poles = tuple[float, float]
"""(a1, a2) of the low pass (1 + a1 + a2)/(1 + a1/z + a2/z^2) behind the backward difference."""
PLAIN: Poles = (0.0, 0.0)
"""No filter: the backward difference itself."""


class VelocityFilterEffect(Effect):
    """Estimator of the velocity in place of the backward difference; each has its own keys."""

    kind: Literal["velocity-filter"] = "velocity-filter"
    estimator: Literal["first-order", "kalman"] = "first-order"
    cutoff_hz: q.Hertz | None = None
    acceleration_m_per_s2: q.Acceleration | None = None
    noise_rms_m: q.Length | None = None

    def faults(self) -> Iterator[t.Finding]:
        """Yield keys of the other estimator, which would be ignored, and a missing one."""
        # The required key first. The motor's largest acceleration would make a Kalman filter a lead, with up to 217
        # times the difference's noise: it has no default.
        keys = {"first-order": ("cutoff_hz",), "kalman": ("acceleration_m_per_s2", "noise_rms_m")}[self.estimator]
        given = [key for key, value in self if value is not None and key not in ("kind", "estimator")]
        for key in given:
            if key not in keys:
                yield (), f'has {key}, but estimator "{self.estimator}" uses {", ".join(keys)} only; leave it out'
        if keys[0] not in given:
            yield (), f'has no {keys[0]}; estimator "{self.estimator}" needs it'


def low_pass(back: ComplexArray, poles: Poles) -> ComplexArray | float:
    """Return (1 + a1 + a2)/(1 + a1/z + a2/z^2) where 1 - 1/z is `back`, exact at low frequency too."""
    first, second = poles
    if poles == PLAIN:
        return 1.0
    whole = 1 + first + second
    return np.asarray(whole / (whole - (first + 2 * second) * back + second * back * back))


def velocity_poles(
    device: Device, scene: Scene, table: VelocityFilterEffect, problem: str, place: str = "scene.effects"
) -> Poles:
    """Return the coefficients a1, a2 of the estimator of the velocity, (1 + a1 + a2)/(1 + a1/z + a2/z^2).

    A first-order filter, or the steady Kalman filter of an acceleration and a noise; faults name the problem.
    """
    period = device.sample_time_s
    if table.cutoff_hz is not None:
        return (-math.exp(-2 * math.pi * table.cutoff_hz * period), 0.0)
    noise = _noise_m(device, scene) if table.noise_rms_m is None else table.noise_rms_m
    if noise == 0 or table.acceleration_m_per_s2 is None:
        said = "missing" if table.noise_rms_m is None else "0"
        message = f"is {said}; it must be above 0, or the scene needs an encoder or noise"
        raise InputError([Fault(problem or "problem", None, f"{place}.noise_rms_m", message)])
    # The steady filter of white acceleration, constant within a sample: P. R. Kalata, The tracking index, IEEE Trans.
    # Aerospace and Electronic Systems AES-20(2), 174-182 (1984).
    index = table.acceleration_m_per_s2 * period**2 / noise
    # 1 - r^2, where r = (4 + i - sqrt(8 i + i^2))/4, without its cancellation.
    root = 4 / (4 + index + math.sqrt(8 * index + index**2))
    alpha, beta = 1 - root**2, 2 * (1 - root) ** 2
    return (alpha + beta - 2, 1 - alpha)


def _noise_m(device: Device, scene: Scene) -> float:
    """Return the rms, m, of encoder steps q, q/sqrt(12), and noise of a scene, whose effects precede the device."""
    listed = {effect.kind: effect for effect in scene.effects}

    def value_of(kind: str, key: str, default: float) -> float:
        value: float | None = getattr(listed[kind], key) if kind in listed else 0.0
        return default if value is None else value

    step = value_of("encoder", "resolution_m", device.encoder_resolution_m)
    return math.hypot(step / math.sqrt(12), value_of("noise", "rms_m", device.position_noise_rms_m))


MOST_STATES = 16
OPENING_KEYS = ("opens_m", "open_m", "kept", "smoothing")
"""Keys of a dead zone that opens in motion."""


class StateFeedback(Effect):
    """An observer with a dead zone and state feedback, as of a robust design; its states are lengths.

    Velocities count times T, forces over a stiffness. With x the measured position, F the force, s_m the state that
    stands for x and y the position that the wall acts on, a sample is

        i = x + c face - s_m,   e = i - c clip(i, -d, d),   s+ = s + L e,   y = R s+,   then s = A s+ + B F.

    d is half of the dead zone. It is closed by c = 1 - clip((r - opens)/(open - opens), 0, 1), 1 at rest and 0 in
    motion. The range r of recent positions reaches from the lowest to the highest of a smoothed x. A sample later the
    share `kept` of their distances from the present one is left; no distance counts more than `open`. x is smoothed
    by a lag of first order with the pole `smoothing`.
    """

    kind: Literal["state-feedback"] = "state-feedback"
    state: q.EntryRows
    force_m_per_n: q.Entries
    innovation: q.Entries  # gain L of the innovation
    feedback: q.Entries
    positions: q.Places
    measures: q.Place = 0
    dead_zone_m: q.Length = 0.0
    face_m: q.Length = 0.0
    opens_m: q.Length = 0.0
    open_m: q.Length = 0.0
    kept: q.Share = 0.0
    smoothing: q.Share = 0.0

    def faults(self) -> Iterator[t.Finding]:
        """Yield too many states, rows of other lengths, places without a state, a dead zone open before it opens."""
        n = self.states
        if n > MOST_STATES:
            yield ("force_m_per_n",), f"has {n} numbers; allowed: 1 to {MOST_STATES}, one for each state"
            return
        if len(self.state) != n:
            yield ("state",), f"has {len(self.state)} rows; allowed: {n}, as many as force_m_per_n"
        rows: dict[t.Path, tuple[float, ...]] = {("innovation",): self.innovation, ("feedback",): self.feedback}
        for path, values in (rows | {("state", row): values for row, values in enumerate(self.state)}).items():
            if len(values) != n:
                yield path, f"has {len(values)} numbers; allowed: {n}, as many as force_m_per_n"
        if max(self.positions) >= n or self.measures not in self.positions:
            yield ("positions",), f"is {t.shown(self.positions)}; allowed: indices below {n}, including measures"
        if self.open_m <= self.opens_m and self.open_m + self.opens_m > 0:
            allowed = f"above opens_m, {self.opens_m:g}; or both 0, for a dead zone that never opens"
            yield ("open_m",), f"is {self.open_m:g}; allowed: {allowed}"

    @property
    def states(self) -> int:
        """Number of states n."""
        return len(self.force_m_per_n)

    @property
    def linear(self) -> StateFeedback:
        """The law without its dead zone."""
        return self.model_copy(update=dict.fromkeys(("dead_zone_m", "face_m", *OPENING_KEYS), 0.0))

    @property
    def zone_numbers(self) -> tuple[float, ...]:
        """Numbers of the dead zone: d, face, opens, open, 1/(open - opens) (0: never open), kept, smoothing."""
        opening_per_m = 1.0 / (self.open_m - self.opens_m) if self.open_m > 0 else 0.0
        return (self.dead_zone_m, self.face_m, self.opens_m, self.open_m, opening_per_m, self.kept, self.smoothing)

    def numbers(self) -> FloatArray:
        """Return A by rows, B, L, R and the numbers of the dead zone, in the order of the step's parameters."""
        rows = [value for row in self.state for value in row]
        return np.array([*rows, *self.force_m_per_n, *self.innovation, *self.feedback, *self.zone_numbers])


class Runtime(t.Table):
    """The runtime beside the gains; estimator and adaptation only where the gains vary with frequency."""

    estimator: Literal["zero-crossing", "spectral-peak", "adaptive-notch", "fused"] = "fused"
    hold_s: q.Wait = 0.2
    slew_per_s: q.Rate | None = 20.0
    passive: bool = True
    observer_mass_kg: q.Mass | None = None
    guard: Literal["passivity-controller", "energy-tank"] | None = None
    state_feedback: StateFeedback | None = None

    def faults(self) -> Iterator[t.Finding]:
        """Yield two observers."""
        if self.observer_mass_kg is not None and self.state_feedback is not None:
            yield ("state_feedback",), "is given with observer_mass_kg; give one of them"

    def document(self) -> dict[str, Any]:
        """Return JSON values."""
        return self.model_dump(exclude={"state_feedback": {"kind"}})

    def effects(self, *, constant: bool) -> tuple[Effect, ...]:
        """Return the effects of a scene; constant gains need no estimator."""
        listed: list[Effect] = []
        if self.observer_mass_kg is not None:
            listed.append(ObserverEffect(mass_kg=self.observer_mass_kg))
        if self.state_feedback is not None:
            listed.append(self.state_feedback)
        if not constant:
            adaptation = AdaptationEffect(hold_s=self.hold_s, slew_per_s=self.slew_per_s, passive=self.passive)
            listed += [EstimatorEffect(method=self.estimator), adaptation]
        if self.guard is not None:
            listed.append(GuardEffect(method=self.guard))
        return tuple(listed)
