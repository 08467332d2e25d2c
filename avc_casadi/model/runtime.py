"""The runtime of the control computer beside the gains, and the effects by which a scene simulates it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields
from typing import TYPE_CHECKING, Any, get_args

import numpy as np

from avc_casadi._errors import Fault, InputError
from avc_casadi.model.effects import (
    AdaptationEffect,
    Effect,
    EstimatorEffect,
    GuardEffect,
    ObserverEffect,
    StateFeedbackEffect,
)

if TYPE_CHECKING:
    from avc_casadi._util.arrays import FloatArray


MOST_STATES = 16

Row = tuple[float, ...]


@dataclass(frozen=True)
class StateFeedback:
    """e = dz(x + face - s_m), s+ = s + L e, y = R s+, and after the force F: s = A s+ + B F."""

    # x is the measured position, m its state, dz the dead zone, y the position that the wall acts on. All states are
    # lengths: velocities times T, forces over a stiffness.
    state: tuple[Row, ...]
    force_m_per_n: Row
    innovation: Row
    feedback: Row
    positions: tuple[int, ...]
    measures: int
    dead_zone_m: float = 0.0
    face_m: float = 0.0

    def __post_init__(self) -> None:
        if faults := [Fault("", None, key, message) for key, message in self._faults()]:
            raise InputError(faults)

    def _faults(self) -> Iterator[tuple[str, str]]:
        n = len(self.force_m_per_n)
        if not 1 <= n <= MOST_STATES:
            yield "force_m_per_n", f"has {n} numbers; allowed: 1 to {MOST_STATES}, one for each state"
            return
        if len(self.state) != n:
            yield "state", f"has {len(self.state)} rows; allowed: {n}, as force_m_per_n"
        rows = {"force_m_per_n": self.force_m_per_n, "innovation": self.innovation, "feedback": self.feedback}
        for name, values in (rows | {f"state[{row}]": values for row, values in enumerate(self.state)}).items():
            if len(values) != n or not all(map(math.isfinite, values)):
                yield name, f"has {len(values)} numbers; allowed: {n}, as force_m_per_n, all finite"
        if any(not 0 <= place < n for place in self.positions) or self.measures not in self.positions:
            yield "positions", f"is {list(self.positions)}; allowed: places from 0 to {n - 1}, measures among"
        for name in ("dead_zone_m", "face_m"):
            if not 0 <= getattr(self, name) < math.inf:
                yield name, f"is {getattr(self, name)!r}; allowed: a finite length, 0 or more"

    @property
    def states(self) -> int:
        """Number of states n."""
        return len(self.force_m_per_n)

    def numbers(self) -> FloatArray:
        """Return A by rows, B, L, R, dead zone and face, in the order of the step's parameters."""
        rows = [value for row in self.state for value in row]
        return np.array([*rows, *self.force_m_per_n, *self.innovation, *self.feedback, self.dead_zone_m, self.face_m])


STATE_FEEDBACK_KEYS: tuple[str, ...] = tuple(item.name for item in fields(StateFeedback))
ESTIMATOR_METHODS: tuple[str, ...] = get_args(EstimatorEffect.model_fields["method"].annotation)
GUARD_METHODS: tuple[str, ...] = get_args(GuardEffect.model_fields["method"].annotation)


@dataclass(frozen=True)
class Runtime:
    """The runtime beside the gains; estimator and adaptation only where the gains vary with frequency."""

    estimator: str = "fused"
    hold_s: float = 0.2
    slew_per_s: float | None = 20.0
    passive: bool = True
    observer_mass_kg: float | None = None
    guard: str | None = None
    state_feedback: StateFeedback | None = None

    def __post_init__(self) -> None:
        for name, known in (("estimator", ESTIMATOR_METHODS), ("guard", (None, *GUARD_METHODS))):
            if (value := getattr(self, name)) not in known:
                raise InputError.of(f"is {value!r}; allowed: {', '.join(map(str, known))}", key=name)
        for name in ("hold_s", "slew_per_s", "observer_mass_kg"):
            value = getattr(self, name)
            if value is not None and not 0 <= value < math.inf:
                raise InputError.of(f"is {value!r}; allowed: a finite number, 0 or more", key=name)
        if self.observer_mass_kg is not None and self.state_feedback is not None:
            raise InputError.of("stands beside observer_mass_kg; allowed: one of them", key="state_feedback")

    def document(self) -> dict[str, Any]:
        """Return JSON values."""
        return asdict(self)

    def effects(self, *, constant: bool) -> tuple[Effect, ...]:
        """Return the effects of a scene; constant gains need no estimator."""
        listed: list[Effect] = []
        if self.observer_mass_kg is not None:
            listed.append(ObserverEffect(mass_kg=self.observer_mass_kg))
        if self.state_feedback is not None:
            listed.append(StateFeedbackEffect(**vars(self.state_feedback)))
        if not constant:
            listed += [
                EstimatorEffect.model_validate({"method": self.estimator}),
                AdaptationEffect(hold_s=self.hold_s, slew_per_s=self.slew_per_s, passive=self.passive),
            ]
        if self.guard is not None:
            listed.append(GuardEffect.model_validate({"method": self.guard}))
        return tuple(listed)
