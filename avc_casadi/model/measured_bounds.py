"""Measured bounds of the realistic impedance: frequency responses in place of spring and damper."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Self

import numpy as np
from pydantic import BeforeValidator, model_validator

from avc_casadi._util.units import FORCE, NS_PER_M
from avc_casadi.model.quantity import LARGEST_DAMPING_NS_PER_M, Damping, Frequencies, Quantity, Table, refusal, sequence

if TYPE_CHECKING:
    from avc_casadi._util.arrays import ComplexArray, FloatArray

_Part = Annotated[float, BeforeValidator(Quantity(NS_PER_M, 1e-12, LARGEST_DAMPING_NS_PER_M, signed=True))]


# Negative real part, as a share of |Z|, beyond measurement error.
_ACTIVE = 0.3
# Frequencies at which the bounds are compared.
_COMPARED = 200


class MeasuredImpedance(Table):
    """A frequency response Z(j omega) of n points, with real and imaginary part linear in log f between.

    Attributes:
        frequency_hz: rising.
        real_ns_per_m: Re Z.
        imag_ns_per_m: Im Z.
        error_ns_per_m: half width of the uncertainty interval of |Z|, for each point; 0 if left out.
    """

    frequency_hz: Frequencies
    real_ns_per_m: Annotated[tuple[_Part, ...], BeforeValidator(sequence)]
    imag_ns_per_m: Annotated[tuple[_Part, ...], BeforeValidator(sequence)]
    error_ns_per_m: Annotated[tuple[Damping, ...], BeforeValidator(sequence)] | None = None

    @model_validator(mode="after")
    def _is_a_response(self) -> Self:
        points = len(self.frequency_hz)
        columns = (self.real_ns_per_m, self.imag_ns_per_m, self.error_ns_per_m or self.frequency_hz)
        if points < 2 or any(len(column) != points for column in columns):
            lengths = ", ".join(str(len(column)) for column in (self.frequency_hz, *columns))
            raise refusal(f"has columns of {lengths} points; allowed: two points at least, as many in each column")
        if not (np.diff(self.frequency_hz) > 0).all():
            raise refusal("has frequencies that do not rise; allowed: each higher than the one before")
        real, imag = np.array(self.real_ns_per_m), np.array(self.imag_ns_per_m)
        active = int(np.count_nonzero(real < -_ACTIVE * np.hypot(real, imag)))
        if 2 * active > points:
            raise refusal(
                f"has a real part far below 0 at {active} of {points} points, which no passive environment has; "
                f"allowed: Re and Im of {FORCE} over velocity, in these columns"
            )
        return self

    @property
    def range_hz(self) -> tuple[float, float]:
        """Lowest and highest frequency."""
        return self.frequency_hz[0], self.frequency_hz[-1]

    def at(self, frequency_hz: FloatArray | float) -> ComplexArray:
        """Return Z at frequencies of the range, N.s/m; beyond it that of its end."""
        real, imag = (self._over(column, frequency_hz) for column in (self.real_ns_per_m, self.imag_ns_per_m))
        return np.asarray(real + 1j * imag)

    def error_at(self, frequency_hz: FloatArray | float) -> FloatArray:
        """Return the half width at frequencies of the range, N.s/m."""
        return self._over(self.error_ns_per_m or (0.0,) * len(self.frequency_hz), frequency_hz)

    def spring_and_damper(self) -> dict[str, float]:
        """Return the damping (N.s/m) and stiffness (N/m) of b + k/(j omega) with the least error relative to |Z|."""
        omega = 2 * np.pi * np.array(self.frequency_hz)
        real, imag = np.array(self.real_ns_per_m), np.array(self.imag_ns_per_m)
        weight = 1 / np.maximum(real**2 + imag**2, np.finfo(np.float64).tiny)
        damping = float((weight * real).sum() / weight.sum())
        stiffness = float(-(weight * imag / omega).sum() / (weight / omega**2).sum())
        return {"damping_ns_per_m": max(0.0, damping), "stiffness_n_per_m": max(0.0, stiffness)}

    def _over(self, column: tuple[float, ...], frequency_hz: FloatArray | float) -> FloatArray:
        return np.asarray(np.interp(np.log(frequency_hz), np.log(self.frequency_hz), column))


class MeasuredBounds(Table):
    """Measured upper and lower bound."""

    upper: MeasuredImpedance
    lower: MeasuredImpedance

    @model_validator(mode="after")
    def _is_ordered(self) -> Self:
        low, high = self.range_hz
        if low > high:
            raise refusal("has no frequency at which both bounds were measured; allowed: ranges that overlap")
        both = np.geomspace(low, high, _COMPARED)
        below = int(np.count_nonzero(np.abs(self.upper.at(both)) < np.abs(self.lower.at(both))))
        if 2 * below > _COMPARED:
            share = 100 * below / _COMPARED
            raise refusal(f"has |upper| below |lower| over {share:.3g} % of their range; allowed: the other way round")
        return self

    @property
    def range_hz(self) -> tuple[float, float]:
        """Frequencies at which both are known."""
        return (
            max(self.upper.range_hz[0], self.lower.range_hz[0]),
            min(self.upper.range_hz[1], self.lower.range_hz[1]),
        )

    def desired(self, frequency_hz: FloatArray | float) -> ComplexArray:
        """Return Z_ds, the mean of both   (10)."""
        return np.asarray((self.upper.at(frequency_hz) + self.lower.at(frequency_hz)) / 2)
