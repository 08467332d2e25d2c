"""The exported C of a coupling behind a sensor that fails, on a released device: `faulty_sensor.c`, compiled."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from simulator_in_c import with_exported

from avc_casadi._util.arrays import FloatArray
from avc_casadi.model.device import Device

KINDS = ("sound", "glitch", "no number", "elsewhere", "stuck", "clipped at 0", "dropped", "jitter")
SHARE, LONGEST = 0.02, 20.0
_SOURCE = Path(__file__).with_name("faulty_sensor.c")


@dataclass(frozen=True)
class Found:
    """What is found of many runs, each of shape (runs,)."""

    faults: FloatArray
    outside_n: FloatArray
    given_j: FloatArray
    entry_j: FloatArray


class FaultySensor:
    """A released device without dry friction that runs the exported files, by name."""

    def __init__(self, device: Device, files: Mapping[str, str]) -> None:
        self._run = with_exported(files, _SOURCE).faulty_sensor
        self._device = device

    def meets(
        self,
        kind: str,
        runs: int,
        seed: int,
        *,
        thrown: bool,
        spring_n_per_m: float = 0.0,
        sizes_m: tuple[float, float] = (1e-3, 1e6),
        seconds: float = 0.5,
    ) -> Found:
        """Let the device meet faults of a kind."""
        device, rng = self._device, np.random.default_rng(seed)
        unit, time = device.metres_per_unit, device.sample_time_s
        numbers = (
            *(device.mass_kg, device.damping_ns_per_m, 0.0, time),
            *(device.encoder_resolution_m or 0.0, float(device.delay_samples), unit),
        )
        fault = (float(KINDS.index(kind)), SHARE, *sizes_m, LONGEST)
        found = np.empty((runs, 4))
        for index, row in enumerate(found):
            place, speed = -(10 ** rng.uniform(-4, -1.7)) / unit, 10 ** rng.uniform(-1.7, -0.3) / unit
            out = (ctypes.c_double * 4)()
            self._run(
                (ctypes.c_double * len(numbers))(*numbers),
                (ctypes.c_double * len(fault))(*fault),
                ctypes.c_double(spring_n_per_m),
                ctypes.c_double(device.max_force_n or np.inf),
                ctypes.c_double(place),
                ctypes.c_double(speed if thrown else 0.0),
                ctypes.c_int(round(seconds / time)),
                ctypes.c_uint64(seed * 1_000_003 + index + 1),
                out,
            )
            row[:] = out
        return Found(*found.T)
