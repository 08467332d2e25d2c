"""Run: the results of a simulated scene as plain numbers and arrays; saved as traces (npz) and a manifest (JSON)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.files import write_file
from avc_casadi._util.json_values import json_text, plain
from avc_casadi._util.printed import Columns, Tabular
from avc_casadi._util.units import LINEAR, Units
from avc_casadi.simulation.judge import DIVERGED_M, Judgement, Ledger, criterion

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem

Claim = Literal["asymptotic", "held-by-friction", "unstable"]

_CLAIMS: dict[Claim, str] = {
    "asymptotic": "settled, and does so without dry friction too",
    "held-by-friction": "settled only because dry friction holds it; without friction it does not",
    "unstable": "did not settle",
}


_TRACES = ("position_m", "velocity_m_per_s", "force_n", "tool_m", "target_m")
_GAINS = ("damping_ns_per_m", "stiffness_n_per_m", "contact_damping_ns_per_m")


@dataclass(frozen=True, eq=False, repr=False)
class Run(Tabular):
    """A simulated scene: traces of shape (samples,), energies, and whether the device settles.

    Attributes:
        problem: name of the problem.
        coupling: method of the gains: none, static, ..., or given.
        effects: kinds of the effects that were simulated, in the order of the loop.
        sample_time_s: T.
        position_m: true position of the device.
        velocity_m_per_s: true velocity of the device.
        force_n: commanded force, held over a sample, positive against +x.
        tool_m: position of the virtual tool between coupling and environment.
        target_m: position of the hand's target.
        damping_ns_per_m: b; infinite for a rigid coupling.
        stiffness_n_per_m: k; infinite for a rigid coupling.
        contact_damping_ns_per_m: b_p.
        interaction_hz: estimated interaction frequency, not a number at rest; None without an estimator.
        ledger: energies.
        judgement: figures of the run.
        claim: ``asymptotic``, ``held-by-friction`` or ``unstable``.
        states: number of states of one sample.
        instructions: number of instructions of one sample.
        build_seconds: time to compile.
        seconds: time to run.
        metres_per_unit: displacement of the hand for a unit of the position.
        units: names and units of the device.
        stated: the problem given to `simulate`, for ``print``; None of a run among many.
        asked: gains, hand, frequency and seed given to `simulate`.
        notes: where the scene's own coupling is designed for another device than the one simulated.

    Example:
        >>> run = avc.simulate("scenes/free-motion")
        >>> run.position_m.shape == run.time_s.shape == (run.samples,)
        True
    """

    problem: str
    coupling: str
    effects: tuple[str, ...]
    sample_time_s: float
    position_m: FloatArray
    velocity_m_per_s: FloatArray
    force_n: FloatArray
    tool_m: FloatArray
    target_m: FloatArray
    damping_ns_per_m: FloatArray
    stiffness_n_per_m: FloatArray
    contact_damping_ns_per_m: FloatArray
    interaction_hz: FloatArray | None
    ledger: Ledger
    judgement: Judgement
    claim: Claim
    states: int
    instructions: int
    build_seconds: float
    seconds: float
    metres_per_unit: float = 1.0
    units: Units = LINEAR
    stated: Problem | None = None
    asked: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def to_dict(self) -> Columns:
        """Return the traces against time as columns, each of shape (samples,)."""
        names = ("time_s", *_TRACES, *_GAINS, *(() if self.interaction_hz is None else ("interaction_hz",)))
        return {name: getattr(self, name) for name in names}

    def _summary(self) -> str:
        duration = self.samples * self.sample_time_s
        return f"{self.problem!r}, coupling {self.coupling}, {duration:g} s: {_CLAIMS[self.claim]}"

    @property
    def samples(self) -> int:
        """Number of samples."""
        return len(self.position_m)

    @property
    def time_s(self) -> FloatArray:
        """Times of the samples."""
        return np.arange(self.samples, dtype=np.float64) * np.float64(self.sample_time_s)

    @property
    def samples_in_reach(self) -> int:
        """Number of samples before the run leaves the workspace for good; all of them, unless it diverged."""
        beyond = ~(np.abs(self.position_m) < DIVERGED_M / self.metres_per_unit)
        return int(beyond.argmax()) if beyond.any() else self.samples

    @property
    def stable(self) -> bool:
        """Whether the device settled."""
        return bool(self.judgement.stable)

    @property
    def buzzing(self) -> bool:
        """Whether the force chatters."""
        return bool(self.judgement.buzzing)

    @property
    def apparent_stiffness_n_per_m(self) -> float:
        """Mean force over mean penetration at the end; not a number without contact."""
        return float(self.judgement.apparent_stiffness_n_per_m)

    @property
    def energy_generated_j(self) -> float:
        """Largest energy that the virtual side gave out beyond all that it had absorbed."""
        return float(self.ledger.generated_j)

    def certificate(self) -> dict[str, Any]:
        """Return the level L6: this time-varying run, with its energy ledger."""
        found: dict[str, Any] = plain(
            {
                "pass": self.claim == "asymptotic",
                "margin_ns_per_m": None,
                "frequency_hz": None,
                "model": "sampled-data",
                "claim": f"simulated for {self.samples * self.sample_time_s:g} s: {_CLAIMS[self.claim]}",
                "outcome": self.claim,
                "energy_generated_j": self.energy_generated_j,
            }
        )
        return found

    def document(self, trace: Path | None = None) -> dict[str, Any]:
        """Return the JSON document; `trace` is the file of the traces."""
        found = self.judgement
        document = {
            "problem": self.problem,
            "coupling": self.coupling,
            "damping_ns_per_m": self.damping_ns_per_m[0],
            "stiffness_n_per_m": self.stiffness_n_per_m[0],
            "contact_damping_ns_per_m": self.contact_damping_ns_per_m[0],
            "stable": self.stable,
            "outcome": self.claim,
            "diverged": bool(found.diverged),
            "buzzing": self.buzzing,
            "criterion": criterion(self.metres_per_unit),
            "steps": self.samples,
            "states": self.states,
            "instructions": self.instructions,
            "peak_velocity_m_per_s": found.peak_velocity_m_per_s,
            "position_peak_to_peak_m": found.position_peak_to_peak_m,
            "mean_force_n": found.mean_force_n,
            "force_ripple_n": found.force_ripple_n,
            "apparent_stiffness_n_per_m": self.apparent_stiffness_n_per_m,
            "rate_hardness_n_per_m": found.rate_hardness_n_per_m,
            "energy_generated_j": self.energy_generated_j,
            "certificate": {"L6": self.certificate()},
            "seconds": {"build": self.build_seconds, "run": self.seconds},
            "trace": None if trace is None else str(trace),
        }
        whole: dict[str, Any] = plain(document)
        return whole

    def save(self, path: Path | str) -> Path:
        """Write the traces to `path` (npz) and the manifest beside it (the same name, ``.json``)."""
        target = Path(path).with_suffix(".npz")
        arrays = BytesIO()
        np.savez_compressed(
            arrays,
            **self.units.keyed(self.to_dict()),
            absorbed_j=self.ledger.absorbed_j,
            stored_j=self.ledger.stored_j,
            dissipated_j=self.ledger.dissipated_j,
        )
        text = json_text(self.document(target) | {"effects": list(self.effects)}, self.units)
        write_file(target, arrays.getvalue())
        write_file(target.with_suffix(".json"), text)
        return target
