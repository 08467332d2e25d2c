"""What runs beside the gains on the control computer, and as which effects a scene simulates it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, get_args

from avc_casadi._errors import InputError
from avc_casadi.problem import (
    AdaptationEffect,
    Effect,
    EstimatorEffect,
    GuardEffect,
    ObserverEffect,
    StateFeedback,
    StateFeedbackEffect,
)

ESTIMATOR_METHODS: tuple[str, ...] = get_args(EstimatorEffect.model_fields["method"].annotation)
GUARD_METHODS: tuple[str, ...] = get_args(GuardEffect.model_fields["method"].annotation)
RUNTIME_KINDS = ("observer", "state-feedback", "estimator", "adaptation", "guard")
"""Effects of a scene that belong to the control computer: a coupling brings its own."""


@dataclass(frozen=True)
class Runtime:
    """What runs beside the gains; estimator and adaptation only where the gains vary with frequency.

    Attributes:
        estimator: method that estimates the interaction frequency.
        hold_s: how long a lost estimate is kept before it falls to that of rest.
        slew_per_s: largest relative change of a gain, a second; None for no limit.
        passive: whether gains change without creating energy, with anchor and tank.
        observer_mass_kg: mass that the observer between encoder steps reckons with; None for no observer.
        guard: method of the guard in the time domain; None for no guard.
        state_feedback: observer and feedback of a robust design; None for the measured position as it is.
    """

    estimator: str = "fused"
    hold_s: float = 0.2
    slew_per_s: float | None = 20.0
    passive: bool = True
    observer_mass_kg: float | None = None
    guard: str | None = None
    state_feedback: StateFeedback | None = None

    def __post_init__(self) -> None:
        if self.estimator not in ESTIMATOR_METHODS:
            raise InputError.of(f"is {self.estimator!r}; allowed: {', '.join(ESTIMATOR_METHODS)}", key="estimator")
        if self.guard is not None and self.guard not in GUARD_METHODS:
            raise InputError.of(f"is {self.guard!r}; allowed: {', '.join(GUARD_METHODS)}, or none", key="guard")
        for name in ("hold_s", "slew_per_s", "observer_mass_kg"):
            value = getattr(self, name)
            if value is not None and not 0 <= value < float("inf"):
                raise InputError.of(f"is {value!r}; allowed: a finite number, 0 or more", key=name)
        if self.observer_mass_kg is not None and self.state_feedback is not None:
            raise InputError.of("stands beside observer_mass_kg; allowed: one of them", key="state_feedback")

    def document(self) -> dict[str, Any]:
        """Return JSON values."""
        return asdict(self)

    def effects(self, *, constant: bool) -> tuple[Effect, ...]:
        """Return the effects of a scene; constant gains need nothing that follows frequency."""
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
