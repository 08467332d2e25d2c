"""How the hand's target moves in a scene."""

from typing import Annotated, Literal

from pydantic import Field

from avc_casadi.problem._quantity import Amplitude, Hertz, Position, Span, Speed
from avc_casadi.problem._table import Table


class _Motion(Table):
    """Motion of the hand's target along the axis of the device; the wall begins at 0 and lies at x > 0.

    Attributes:
        start_m: where the target begins.
        end_m: where it goes.
        speed_m_per_s: how fast.
    """

    start_m: Position = -0.01
    end_m: Position = 0.01
    speed_m_per_s: Speed = 0.07


class Press(_Motion):
    """From start to end at constant speed, then stay."""

    kind: Literal["press"] = "press"


class Tap(_Motion):
    """To and fro between start and end.

    Attributes:
        frequency_hz: taps a second.
        rest_s: how long the target rests at the end, at least.
    """

    kind: Literal["tap"] = "tap"
    frequency_hz: Hertz = 2.0
    rest_s: Span = 1.0


class Hold(_Motion):
    """Rest at the end from the beginning on."""

    kind: Literal["hold"] = "hold"


class Stroke(_Motion):
    """From start to end at constant speed, then oscillate about the end.

    Attributes:
        frequency_hz: of the oscillation.
        amplitude_m: of the oscillation.
        rest_s: how long the target rests at the end, at least.
    """

    kind: Literal["stroke"] = "stroke"
    frequency_hz: Hertz = 1.0
    amplitude_m: Amplitude = 0.005
    rest_s: Span = 1.0


class Free(_Motion):
    """Oscillate about the start.

    Attributes:
        frequency_hz: of the oscillation.
        amplitude_m: of the oscillation.
        rest_s: how long the target rests at the end, at least.
    """

    kind: Literal["free"] = "free"
    frequency_hz: Hertz = 1.0
    amplitude_m: Amplitude = 0.005
    rest_s: Span = 1.0


Motion = Annotated[Press | Tap | Hold | Stroke | Free, Field(discriminator="kind")]
