"""The scene of a problem file: motion of the hand's target, coupling and effects, listed or those declared."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, SerializeAsAny

from avc_casadi.model import EFFECTS, METHODS
from avc_casadi.model import quantity as q
from avc_casadi.model import table as t
from avc_casadi.model.effects import Effect


class _Motion(t.Table):
    """Motion of the hand's target along the axis of the device; the wall begins at 0 and lies at x > 0."""

    start_m: q.Position = -0.01
    end_m: q.Position = 0.01
    speed_m_per_s: q.Speed = 0.07


class Press(_Motion):
    """From start to end at constant speed, then stay."""

    kind: Literal["press"] = "press"


class Tap(_Motion):
    """To and fro between start and end."""

    kind: Literal["tap"] = "tap"
    frequency_hz: q.Hertz = 2.0
    rest_s: q.Span = 1.0


class Hold(_Motion):
    """Stay at the end from the beginning."""

    kind: Literal["hold"] = "hold"


class _Oscillation(_Motion):
    """Oscillation of the target."""

    kind: Any  # first, as in what is written
    frequency_hz: q.Hertz = 1.0
    amplitude_m: q.Amplitude = 0.005
    rest_s: q.Span = 1.0


class Stroke(_Oscillation):
    """From start to end at constant speed, then oscillate about the end."""

    kind: Literal["stroke"] = "stroke"


class Free(_Oscillation):
    """Oscillate about the start."""

    kind: Literal["free"] = "free"


MOTIONS: dict[str, type[_Motion]] = {"press": Press, "tap": Tap, "hold": Hold, "stroke": Stroke, "free": Free}
Motion = Annotated[Press | Tap | Hold | Stroke | Free, Field(discriminator="kind")]


def coupling_name(value: Any) -> str:
    """Return the coupling of a scene, none or a method of the registry, or refuse it."""
    choices = ("none", *METHODS)
    if not isinstance(value, str) or value not in choices:
        raise t.refusal(f"is {t.shown(value)}; allowed: {t.one_of(choices, value)}")
    return value


_MOST_EFFECTS = 100


def _effects(value: Any) -> tuple[Any, ...]:
    """Return the effects of a scene, each read by the keys of its kind."""
    return t.of_kinds(
        value, {kind: effect.keys for kind, effect in EFFECTS.items()}, "[[scene.effects]]", _MOST_EFFECTS
    )


class Scene(t.Table):
    """The simulated scene: motion of the hand's target, coupling and effects."""

    duration_s: q.Span = 3.0
    coupling: Annotated[str, BeforeValidator(coupling_name)] = "static"
    interaction_hz: q.Hertz | None = None
    integrator: Literal["exact", "projected"] = "exact"
    substeps: q.Substeps = 1
    motion: Motion = Press()
    effects: Annotated[tuple[SerializeAsAny[Effect], ...], BeforeValidator(_effects)] = ()
