"""Velocity estimators by name, from the sampled position alone: two linear, two nonlinear."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.units import spoken_key

if TYPE_CHECKING:
    from avc_casadi._util.arrays import ComplexArray
    from avc_casadi.model.problem import Problem

# A CasADi SX expression; CasADi ships no types.
Expr = Any
Poles = tuple[float, float]
PLAIN: Poles = (0.0, 0.0)
"""No filter: the backward difference itself."""
FOAW_WINDOW = 15
"""Default number of intervals of the longest window."""
# A. Levant, Higher-order sliding modes, differentiation and output-feedback control, Int. J. Control 76 (2003).
_ALPHA, _LAMBDA = 1.1, 1.5


def low_pass(back: ComplexArray, poles: Poles) -> ComplexArray | float:
    """Return (1 + a1 + a2)/(1 + a1/z + a2/z^2) where 1 - 1/z is `back`, exact at low frequency too."""
    first, second = poles
    if poles == PLAIN:
        return 1.0
    whole = 1 + first + second
    return np.asarray(whole / (whole - (first + 2 * second) * back + second * back * back))


@dataclass(frozen=True)
class Known:
    """Values of the scene for keys that an estimator's table leaves out.

    Attributes:
        problem: name of the problem.
        place: key of the table, for messages.
        sample_time_s: T.
        step_m: a step of the encoder of the scene, 0 without one.
        noise_rms_m: of the noise of the scene, 0 without one.
        acceleration_m_per_s2: force limit over the device's mass; None where either is unknown.
    """

    problem: str
    place: str
    sample_time_s: float
    step_m: float
    noise_rms_m: float
    acceleration_m_per_s2: float | None

    @classmethod
    def of(cls, problem: Problem, place: str) -> Self:
        """Return the values of a problem; effects of the scene precede the device."""
        device, listed = problem.device, {effect.kind: effect for effect in problem.scene.effects}

        def told(kind: str, key: str, default: Any) -> Any:
            value = getattr(listed[kind], key) if kind in listed else 0.0
            return default if value is None else value

        force = told("saturation", "force_n", device.max_force_n) or device.max_force_n
        return cls(
            problem.name,
            place,
            device.sample_time_s,
            told("encoder", "resolution_m", device.encoder_resolution_m),
            told("noise", "rms_m", device.position_noise_rms_m),
            force / device.mass_kg if force and device.mass_kg else None,
        )

    def need(self, value: float | None, default: float | None, key: str, source: str) -> float:
        """Return the value of a key, or its default.

        Raises:
            InputError: neither is there.
        """
        found = default if value is None else value
        if found:
            return found
        message = f"is {'missing' if value is None else 0}; allowed: above 0 here, or {source}"
        raise InputError([Fault(self.problem or "problem", None, f"{self.place}.{key}", message)])


class VelocityEstimator(ABC):
    """An estimator with all parameters set.

    Attributes:
        keys: its own keys of the effect velocity-filter.
        required: the required ones.
        poles: (a1, a2) of the low pass (1 + a1 + a2)/(1 + a1/z + a2/z^2) behind the backward difference; None where the
            estimator is nonlinear, or estimates the position too.
    """

    keys: ClassVar[tuple[str, ...]]
    required: ClassVar[tuple[str, ...]] = ()

    @classmethod
    @abstractmethod
    def build(cls, table: Any, known: Known) -> Self:
        """Return the estimator with all parameters set.

        Raises:
            InputError: a number is neither in the table nor in the scene.
        """

    @property
    def poles(self) -> Poles | None:
        """Poles of an estimator that is a low pass behind the backward difference."""
        return None


class RunningEstimator(VelocityEstimator):
    """An estimator with states of its own, not equivalent to a low pass."""

    @abstractmethod
    def initial(self, start_m: float) -> dict[str, float]:
        """Return its states at rest."""

    @abstractmethod
    def step(self, position: Expr, state: Mapping[str, Expr]) -> tuple[dict[str, Expr], Expr, Expr]:
        """Return the next states, the velocity (m/s) and the position for the wall (m), as CasADi's expressions."""


VELOCITY_ESTIMATORS: dict[str, type[VelocityEstimator]] = {}


def _named(name: str) -> Callable[[type[VelocityEstimator]], type[VelocityEstimator]]:
    def add(one: type[VelocityEstimator]) -> type[VelocityEstimator]:
        VELOCITY_ESTIMATORS[name] = one
        return one

    return add


@_named("first-order")
@dataclass(frozen=True)
class FirstOrder(VelocityEstimator):
    """First-order lag behind the backward difference, exact over a sample.

    Attributes:
        old_share: share of the old velocity in the new one, exp(-2 pi f T).
    """

    keys: ClassVar[tuple[str, ...]] = ("cutoff_hz",)
    required: ClassVar[tuple[str, ...]] = ("cutoff_hz",)

    old_share: float

    @classmethod
    def build(cls, table: Any, known: Known) -> Self:
        """Return the estimator for a cut-off frequency."""
        return cls(math.exp(-2 * math.pi * table.cutoff_hz * known.sample_time_s))

    @property
    def poles(self) -> Poles:
        """One pole."""
        return (-self.old_share, 0.0)


@_named("kalman")
@dataclass(frozen=True)
class Kalman(RunningEstimator):
    """Steady Kalman filter of a body whose acceleration is white, constant within a sample (the alpha-beta filter).

    Its gains follow from the tracking index a T^2/n alone (P. R. Kalata, The tracking index, IEEE Trans. Aerospace and
    Electronic Systems AES-20(2), 174-182 (1984)). Its velocity is the backward difference behind two poles.

    Attributes:
        alpha: gain of the position.
        beta: gain of the velocity, times T.
        sample_time_s: T.
        gives_position: whether the wall's spring acts on its position too.
    """

    keys: ClassVar[tuple[str, ...]] = ("acceleration_m_per_s2", "noise_rms_m", "position")
    # Required: the motor's largest acceleration would make it a lead, with up to 217 times the difference's noise.
    required: ClassVar[tuple[str, ...]] = ("acceleration_m_per_s2",)

    alpha: float
    beta: float
    sample_time_s: float
    gives_position: bool

    @classmethod
    def build(cls, table: Any, known: Known) -> Self:
        """Return the filter; the noise defaults to that of the encoder, step/sqrt(12), and of the scene."""
        period = known.sample_time_s
        rms = known.need(
            table.noise_rms_m,
            math.hypot(known.step_m / math.sqrt(12), known.noise_rms_m),
            "noise_rms_m",
            "an encoder or noise in the scene",
        )
        index = table.acceleration_m_per_s2 * period**2 / rms
        # 1 - r^2, where r = (4 + i - sqrt(8 i + i^2))/4, without its cancellation.
        root = 4 / (4 + index + math.sqrt(8 * index + index**2))
        return cls(1 - root**2, 2 * (1 - root) ** 2, period, table.position == "estimated")

    @property
    def poles(self) -> Poles | None:
        """Two poles, unless it estimates the position too."""
        return None if self.gives_position else (self.alpha + self.beta - 2, 1 - self.alpha)

    def initial(self, start_m: float) -> dict[str, float]:
        """Return the states at rest."""
        return {"position_m": start_m, "velocity_m_per_s": 0.0}

    def step(self, position: Expr, state: Mapping[str, Expr]) -> tuple[dict[str, Expr], Expr, Expr]:
        """Predict over a sample and correct."""
        speed = state["velocity_m_per_s"]
        coming = state["position_m"] + self.sample_time_s * speed
        new = position - coming
        found, velocity = coming + self.alpha * new, speed + self.beta / self.sample_time_s * new
        return {"position_m": found, "velocity_m_per_s": velocity}, velocity, found if self.gives_position else position


def _acceleration(table: Any, known: Known) -> tuple[float | None, float | None, str, str]:
    source = f"{spoken_key('device.max_force_n')} and {spoken_key('device.mass_kg')}, whose quotient is taken"
    return table.acceleration_m_per_s2, known.acceleration_m_per_s2, "acceleration_m_per_s2", source


@_named("foaw")
@dataclass(frozen=True)
class Foaw(RunningEstimator):
    """First-order adaptive windowing: slope over the longest window in which a line stays within a band of all samples.

    The line goes through the newest sample; windows are tried from the shortest until one fails. F. Janabi-Sharifi,
    V. Hayward, C.-S. J. Chen, Discrete-time adaptive windowing for velocity estimation, IEEE Trans. Control Systems
    Technology 8(6), 1003-1009 (2000).

    Attributes:
        band_m: largest distance of a sample from the line.
        window_samples: intervals of the longest window.
        best: slope of least squares over the window; otherwise through its ends.
        sample_time_s: T.
    """

    keys: ClassVar[tuple[str, ...]] = ("band_m", "window_samples", "fit")

    band_m: float
    window_samples: int
    best: bool
    sample_time_s: float

    @classmethod
    def build(cls, table: Any, known: Known) -> Self:
        """Return the estimator; the band defaults to an encoder step, as end points and samples between err by half."""
        band = known.need(table.band_m, known.step_m, "band_m", "an encoder in the scene, whose step is taken")
        return cls(band, table.window_samples or FOAW_WINDOW, table.fit != "end", known.sample_time_s)

    def initial(self, start_m: float) -> dict[str, float]:
        """Return the states at rest: all samples equal."""
        return {f"before_{index}_m": start_m for index in range(1, self.window_samples + 1)}

    def step(self, position: Expr, state: Mapping[str, Expr]) -> tuple[dict[str, Expr], Expr, Expr]:
        """Try every window; the longest one whose shorter ones all pass is taken."""
        import casadi as ca  # noqa: PLC0415

        before = list(state.values())
        way = [position - one for one in before]
        # Samples of an encoder may lie on the edge of the band itself.
        band = self.band_m * (1 + 1e-9)
        moved, holds = way[0], ca.SX(1)
        for n in range(2, len(way) + 1):
            slope = way[n - 1] / n
            if self.best:
                slope = 6 / (n * (n + 1) * (n + 2)) * sum((2 * j - n) * way[j - 1] for j in range(1, n + 1))
            inside = [ca.fabs(slope * j - way[j - 1]) <= band for j in range(1, n + self.best)]
            for one in inside:
                holds = ca.logic_and(holds, one)
            moved = ca.if_else(holds, slope, moved)
        following = dict(zip(state, [position, *before[:-1]], strict=True))
        return following, moved / self.sample_time_s, position


@_named("levant")
@dataclass(frozen=True)
class Levant(RunningEstimator):
    """Robust exact differentiator by a sliding mode, with a bound C of the acceleration: 1.1 C and 1.5 sqrt(C).

    A. Levant, Robust exact differentiation via sliding mode technique, Automatica 34(3), 379-384 (1998), for walls: V.
    Chawda, O. Celik, M. K. O'Malley, Proc. IEEE World Haptics (2011); IEEE/ASME Trans. Mechatronics 23(2) (2018).
    Euler's explicit step, which is mostly used, chatters by 1.1 C T; the implicit one does not (B. Brogliato, A.
    Polyakov, D. Efimov, The implicit discretization of the super-twisting sliding-mode control algorithm, IEEE Trans.
    Automatic Control 65(8) (2020)): an error of at most 1.1 C T^2 is taken for motion at once, as by the difference.

    Attributes:
        acceleration_m_per_s2: C.
        explicit: by Euler's explicit step.
        sample_time_s: T.
        gives_position: whether the wall's spring acts on its position too.
    """

    keys: ClassVar[tuple[str, ...]] = ("acceleration_m_per_s2", "discretisation", "position")

    acceleration_m_per_s2: float
    explicit: bool
    sample_time_s: float
    gives_position: bool

    @classmethod
    def build(cls, table: Any, known: Known) -> Self:
        """Return the differentiator; the bound defaults to the force limit over the mass."""
        bound = known.need(*_acceleration(table, known))
        return cls(bound, table.discretisation == "explicit", known.sample_time_s, table.position == "estimated")

    def initial(self, start_m: float) -> dict[str, float]:
        """Return the states at rest."""
        return {"position_m": start_m, "velocity_m_per_s": 0.0}

    def step(self, position: Expr, state: Mapping[str, Expr]) -> tuple[dict[str, Expr], Expr, Expr]:
        """Step over a sample; implicitly, the remaining error s solves s + T lambda sqrt(s) = residual after alpha."""
        import casadi as ca  # noqa: PLC0415

        period, speed = self.sample_time_s, state["velocity_m_per_s"]
        alpha, root = _ALPHA * self.acceleration_m_per_s2, _LAMBDA * math.sqrt(self.acceleration_m_per_s2)
        if self.explicit:
            error = position - state["position_m"]
            velocity = speed + root * ca.sign(error) * ca.sqrt(ca.fabs(error))
            found = state["position_m"] + period * velocity
            following = {"position_m": found, "velocity_m_per_s": speed + period * alpha * ca.sign(error)}
            return following, velocity, state["position_m"] if self.gives_position else position
        error = position - (state["position_m"] + period * speed)
        most = alpha * period**2
        taken = ca.fmin(ca.fmax(error, -most), most)
        rest = ca.fabs(error - taken)
        left = 2 * rest / (period * root + ca.sqrt((period * root) ** 2 + 4 * rest))
        velocity, found = speed + taken / period, position - ca.sign(error) * left * left
        return {"position_m": found, "velocity_m_per_s": velocity}, velocity, found if self.gives_position else position


def velocity_estimator(problem: Problem, table: Any, place: str = "scene.effects") -> VelocityEstimator:
    """Return the estimator of the effect velocity-filter.

    Args:
        problem: the problem, for keys that the table leaves out.
        table: the effect's table.
        place: its key, for messages.

    Raises:
        InputError: a number is neither in the table nor in the problem.
    """
    return VELOCITY_ESTIMATORS[table.estimator].build(table, Known.of(problem, place))
