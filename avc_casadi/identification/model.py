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
class Stretch:
    """A stretch of a record beside the free-running model, arrays of shape (samples,)."""

    record: str
    time_s: FloatArray
    measured_m: FloatArray
    simulated_m: FloatArray


@dataclass(frozen=True, eq=False)
class Identification:
    """An identified device."""

    sources: tuple[str, ...]
    seconds: float
    records: int
    sample_time_s: float
    motion: MotionKind
    rungs: tuple[str, ...]
    encoder_at: str
    estimates: Mapping[str, Estimate]
    unknown: Mapping[str, str]
    trials: tuple[Trial, ...]
    names: tuple[str, ...]
    correlation: FloatArray
    error_m: FloatArray
    lags: FloatArray
    notes: tuple[str, ...]
    response: Response
    modelled: ComplexArray
    stretches: tuple[Stretch, ...]
    device: DeviceFile | None = None

    @property
    def amplifier_order(self) -> int:
        """1, a lag; 2, a current loop."""
        return 2 if "loop" in self.rungs else 1

    def data(self) -> dict[str, Any]:
        """Return its JSON values."""
        device, key_of = self.device, units_for(self.motion).key
        result: dict[str, Any] = plain(
            {
                "logs": self.sources,
                "seconds": self.seconds,
                "records": self.records,
                "sample_time_s": self.sample_time_s,
                "rungs": self.rungs,
                "encoder_at": self.encoder_at,
                "amplifier_order": self.amplifier_order,
                "estimates": {
                    key: {name: value for name, value in vars(one).items() if name != "key"}
                    for key, one in self.estimates.items()
                },
                "unknown": self.unknown,
                "evidence": [vars(one) for one in self.trials],
                "correlation": {"names": [*map(key_of, self.names)], "of_estimates": self.correlation},
                "error_autocorrelation": self.lags,
                "notes": self.notes,
                "device": None if device is None else device.device.model_dump(mode="json", exclude_unset=True),
                "gaps": None if device is None else [*map(key_of, device.gaps)],
                "response": {
                    "frequency_hz": self.response.frequency_hz,
                    "measured_re": self.response.velocity_per_force.real,
                    "measured_im": self.response.velocity_per_force.imag,
                    "model_re": self.modelled.real,
                    "model_im": self.modelled.imag,
                    "coherence": self.response.coherence,
                },
            }
        )
        return result
