"""Trials of a coupling on perturbed devices (model mismatch)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi.loops.margins import OpenLoop
from avc_casadi.model.corners import device_with, linear_values
from avc_casadi.model.scene import declared
from avc_casadi.simulation.population.operators import people_of
from avc_casadi.simulation.population.trial import CouplingTrial, try_on_devices

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling
    from avc_casadi.model.device import Device
    from avc_casadi.model.problem import Problem

FIRST = 16
"""Hands of a first trial, corners included."""
SHARE = 0.1
"""Relative perturbation of a value without a stated range; a delay is later, by up to LATER_SAMPLES."""
LATER_SAMPLES = 0.25
_DEVICES = 8


@dataclass(frozen=True)
class PerturbedDevices:
    """Result of a trial with model mismatch; no claim is made for it."""

    keys: tuple[str, ...]
    trial: CouplingTrial  # of the corner hands, each on every device
    unstable: int  # devices on which the linear loop is not stable, though hands may settle

    def document(self) -> dict[str, Any]:
        """Return JSON values."""
        told = {"share": SHARE, "keys": [*self.keys], "devices": self.trial.devices}
        return told | {"linearly_unstable": self.unstable, **self.trial.counts()}


def off_file(coupling: Coupling, seed: int = 0) -> PerturbedDevices | None:
    """Return a trial of the corner hands on devices perturbed by a tenth, each value up or down at random."""
    problem = coupling.problem
    keys = _without_range(problem)
    if not keys:
        return None
    people = people_of(problem.hands, FIRST, seed)
    devices = perturbed(problem.device, keys, seed)
    each_on_all = people.pick(np.repeat(np.arange(len(people)), len(devices)))
    theirs = [replace(coupling, problem=problem.changed(device=device)) for device in devices]
    unstable = sum(bool((np.abs(OpenLoop.of(one).poles) >= 1).any()) for one in theirs)
    return PerturbedDevices(keys, try_on_devices(coupling, each_on_all, devices, seed), unstable)


def _without_range(problem: Problem) -> tuple[str, ...]:
    ranged = set(declared(problem))
    values = linear_values(problem.device)
    return tuple(key for key, value in values.items() if value > 0 and f"device.range.{key}" not in ranged)


def perturbed(device: Device, keys: tuple[str, ...], seed: int) -> list[Device]:
    """Draw perturbed devices; a value at the end of its admissible range moves inwards only."""
    random = np.random.default_rng(seed)
    values = linear_values(device)
    ends = {key: [end for end in _ends(key, values[key]) if _possible(device, key, end)] for key in keys}
    return [
        device_with(device, {key: some[random.integers(len(some))] for key, some in ends.items()})
        for _ in range(_DEVICES)
    ]


def _ends(key: str, value: float) -> tuple[float, float]:
    return (value, value + LATER_SAMPLES) if key == "delay_samples" else ((1 - SHARE) * value, (1 + SHARE) * value)


def _possible(device: Device, key: str, value: float) -> bool:
    try:
        device_with(device, {key: value})
    except ValueError:
        return False
    return True
