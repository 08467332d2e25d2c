"""Keys of the effect velocity-filter: a velocity estimator by name, with the keys of each."""

from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, model_validator

from avc_casadi._util.units import spoken_key
from avc_casadi.model.effects import EffectTable
from avc_casadi.model.quantity import Acceleration, Hertz, Length, Window, one_of, refusal, shown
from avc_casadi.model.velocity import VELOCITY_ESTIMATORS


class _Estimators:
    """Validator of the name of a velocity estimator."""

    choices = tuple(VELOCITY_ESTIMATORS)

    def __call__(self, value: Any) -> str:
        """Return the name, or refuse it."""
        if value not in self.choices:
            raise refusal(f"is {shown(value)}; allowed: {one_of(self.choices, value)}")
        return str(value)


class VelocityFilterEffect(EffectTable):
    """Estimator of the velocity in place of the backward difference; each has its own keys.

    Attributes:
        estimator: its name; foaw, levant and those that estimate the position need the wall rendered directly.
        cutoff_hz: first-order: -3 dB frequency; required.
        band_m: foaw: largest distance of samples from the line; None: a step of the encoder.
        window_samples: foaw: intervals of the longest window; None: 15.
        fit: foaw: slope by least squares or through the ends; None: best.
        acceleration_m_per_s2: kalman: its rms; required. levant: its bound; None: force limit over the mass.
        noise_rms_m: kalman: of the measured position; None: a step of the encoder over sqrt(12), and the noise.
        discretisation: levant: Euler's implicit or explicit step; None: implicit.
        position: kalman, levant: whether the spring acts on the measured position or the estimate; None: measured.
    """

    kind: Literal["velocity-filter"] = "velocity-filter"
    estimator: Annotated[str, BeforeValidator(_Estimators())] = "first-order"
    cutoff_hz: Hertz | None = None
    band_m: Length | None = None
    window_samples: Window | None = None
    fit: Literal["best", "end"] | None = None
    acceleration_m_per_s2: Acceleration | None = None
    noise_rms_m: Length | None = None
    discretisation: Literal["implicit", "explicit"] | None = None
    position: Literal["measured", "estimated"] | None = None

    @model_validator(mode="after")
    def _keys_of_its_own(self) -> Self:
        """Refuse keys of other estimators, which would be ignored, and missing ones."""
        one = VELOCITY_ESTIMATORS[self.estimator]
        told = [key for key, value in self if value is not None and key not in ("kind", "estimator")]
        for key in told:
            if key not in one.keys:
                allowed = ", ".join(map(spoken_key, one.keys))
                raise refusal(f'has {spoken_key(key)}, no key of estimator "{self.estimator}"; allowed: {allowed}')
        for key in one.required:
            if key not in told:
                raise refusal(f'has no {spoken_key(key)}; allowed: with it, which estimator "{self.estimator}" needs')
        return self
