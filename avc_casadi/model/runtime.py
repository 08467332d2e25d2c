"""The runtime of the control computer beside the gains, and the effects by which a scene simulates it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Literal

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.model import quantity as q
from avc_casadi.model import table as t
from avc_casadi.model.effects import (
    AdaptationEffect,
    Effect,
    EffectTable,
    EstimatorEffect,
    GuardEffect,
    ObserverEffect,
)

MOST_STATES = 16


class StateFeedback(EffectTable):
    """An observer with a dead zone and state feedback, as of a robust design; its states are lengths."""

    # e = dz(x + face - s_m), s+ = s + L e, y = R s+, and after the force F: s = A s+ + B F. x is the measured position,
    # m its state, dz the dead zone, y the position that the wall acts on; velocities times T, forces over a stiffness.
    kind: Literal["state-feedback"] = "state-feedback"
    state: q.EntryRows
    force_m_per_n: q.Entries
    innovation: q.Entries
    feedback: q.Entries
    positions: q.Places
    measures: q.Place = 0
    dead_zone_m: q.Length = 0.0
    face_m: q.Length = 0.0

    def faults(self) -> Iterator[t.Finding]:
        """Yield too many states, rows of other lengths, and places without a state."""
        n = self.states
        if n > MOST_STATES:
            yield ("force_m_per_n",), f"has {n} numbers; allowed: 1 to {MOST_STATES}, one for each state"
            return
        if len(self.state) != n:
            yield ("state",), f"has {len(self.state)} rows; allowed: {n}, as force_m_per_n"
        rows: dict[t.Path, tuple[float, ...]] = {("innovation",): self.innovation, ("feedback",): self.feedback}
        for path, values in (rows | {("state", row): values for row, values in enumerate(self.state)}).items():
            if len(values) != n:
                yield path, f"has {len(values)} numbers; allowed: {n}, as force_m_per_n"
        if max(self.positions) >= n or self.measures not in self.positions:
            yield (
                ("positions",),
                f"is {t.shown(self.positions)}; allowed: places below {n}, measures among them",
            )

    @property
    def states(self) -> int:
        """Number of states n."""
        return len(self.force_m_per_n)

    def numbers(self) -> FloatArray:
        """Return A by rows, B, L, R, dead zone and face, in the order of the step's parameters."""
        rows = [value for row in self.state for value in row]
        return np.array([*rows, *self.force_m_per_n, *self.innovation, *self.feedback, self.dead_zone_m, self.face_m])


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
            yield ("state_feedback",), "stands beside observer_mass_kg; allowed: one of them"

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
