"""Result of an identification: estimates with intervals, and the model beside the log.

Values of a rotary device stand unchanged under the linear names: kg.m2 in ``mass_kg``, N.m in forces.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi._util.json_values import plain
from avc_casadi._util.units import MotionKind, units_for
from avc_casadi.files.device_file import DeviceFile
from avc_casadi.identification.frequency import Response
from avc_casadi.identification.intervals import Trial
from avc_casadi.identification.terms import Measured


@dataclass(frozen=True)
class Estimate:
    """An estimate with its 95 % interval."""

    key: str
    quantity: Measured
    value: float
    low: float
    high: float
    source: str
    identified: bool = True


@dataclass(frozen=True, eq=False)
class Identification:
    """An identified device; `stretch` is time, and position measured and of the model running nearly free, (3, n)."""

    sources: tuple[str, ...]
    seconds: float
    records: int
    sample_time_s: float
    motion: MotionKind
    rungs: tuple[str, ...]
    encoder_at: str
    estimates: Mapping[str, Estimate]
    unknown: tuple[str, ...]
    trials: tuple[Trial, ...]
    error_m: FloatArray
    lags: FloatArray
    notes: tuple[str, ...]
    response: Response
    modelled: ComplexArray
    stretch: FloatArray
    device: DeviceFile | None = None

    @property
    def amplifier_order(self) -> int:
        """1, a lag; 2, a current loop."""
        return 2 if "loop" in self.rungs else 1

    def data(self) -> dict[str, Any]:
        """Return its JSON values."""
        key_of, response = units_for(self.motion).key, self.response
        plainly = ("seconds", "records", "sample_time_s", "rungs", "encoder_at", "amplifier_order", "notes")
        device = None if self.device is None else self.device.device.model_dump(mode="json", exclude_unset=True)
        result: dict[str, Any] = plain(
            {
                "logs": self.sources,
                **{key: getattr(self, key) for key in plainly},
                "estimates": {
                    key: {name: value for name, value in vars(one).items() if name != "key"}
                    for key, one in self.estimates.items()
                },
                "unknown": [*map(key_of, self.unknown)],
                "evidence": [vars(one) for one in self.trials],
                "error_autocorrelation": self.lags,
                "device": device,
                "gaps": None if self.device is None else [*map(key_of, self.device.gaps)],
                "response": {
                    "frequency_hz": response.frequency_hz,
                    "measured_re": response.velocity_per_force.real,
                    "measured_im": response.velocity_per_force.imag,
                    "model_re": self.modelled.real,
                    "model_im": self.modelled.imag,
                    "coherence": response.coherence,
                },
            }
        )
        return result
