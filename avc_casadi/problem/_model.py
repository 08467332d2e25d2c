"""The problem: device, environment, realistic bounds, admissible gains and the claim to be met.

Plain frozen pydantic models; a key's name carries its SI unit. The catalogue in ``problems/`` shows every table.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, Strict

from avc_casadi.impedance import Model

Structure = Literal["series", "damped"]
Scope = Literal["pointwise", "band", "all", "hands"]
Objective = Literal["magnitude", "complex", "perceptual"]
CouplingChoice = Literal["none", "static", "static-tuned", "closed-form", "direct", "schedule"]

# The arrays of TOML come as lists; the numbers inside stay strict.
Loose = Strict(strict=False)

Damping = Annotated[float, Field(ge=0, le=1e12)]
Stiffness = Annotated[float, Field(ge=0, le=1e15)]
Mass = Annotated[float, Field(ge=0, le=1e6)]


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, strict=True, extra="forbid", allow_inf_nan=False)


class Device(_Table):
    """The haptic device; the last three are what is known of it and simulated only where a scene lists the effect."""

    mass_kg: Mass
    damping_ns_per_m: Damping
    sample_time_s: Annotated[float, Field(gt=0, le=10)] = 1e-3
    delay_samples: Annotated[int, Field(ge=0, le=1000)] = 0
    coulomb_friction_n: Annotated[float, Field(ge=0, le=1e6)] = 0.0
    encoder_resolution_m: Annotated[float, Field(ge=0, le=1)] = 0.0
    max_force_n: Annotated[float, Field(gt=0, le=1e9)] | None = None


class Impedance(_Table):
    """A damper and a spring side by side, b + k/s."""

    damping_ns_per_m: Damping
    stiffness_n_per_m: Stiffness


class Boundaries(_Table):
    """The range of impedance that feels real; its mean is the desired impedance   (10)."""

    upper: Impedance
    lower: Impedance


class Coupling(_Table):
    """Structure of the coupling and the box of admissible gains, each [lowest, highest]."""

    structure: Structure = "series"
    damping_ns_per_m: Annotated[tuple[Damping, Damping], Loose] = (0.0, 1e4)
    stiffness_n_per_m: Annotated[tuple[Stiffness, Stiffness], Loose] = (0.0, 1e7)
    contact_damping_ns_per_m: Annotated[tuple[Damping, Damping], Loose] = (0.0, 0.0)


class Stability(_Table):
    """The claim that the gains must meet: hold model, scope of frequencies, margin on Re Z_h   (12)."""

    model: Model = "paper"
    scope: Scope = "pointwise"
    band_factor: Annotated[float, Field(ge=1, le=1e6)] = 2.0
    margin_ns_per_m: Damping = 0.0


class Realism(_Table):
    """What counts as error, and the just-noticeable difference as a share of |Z|."""

    objective: Objective = "magnitude"
    jnd: Annotated[float, Field(gt=0, lt=1)] = 0.10


class ScheduleSettings(_Table):
    """Smoothness of the joint schedule over ln(frequency)."""

    slope_penalty: Annotated[float, Field(ge=0)] = 1e-3
    slope_limit: Annotated[float, Field(gt=0)] | None = None
    hand_damping_ns_per_m: Damping = 0.0


class Hands(_Table):
    """The set of hands, each value [lowest, highest]: corners and draws of it are used."""

    mass_kg: Annotated[tuple[Mass, Mass], Loose] = (0.05, 0.3)
    damping_ns_per_m: Annotated[tuple[Damping, Damping], Loose] = (3.0, 20.0)
    stiffness_n_per_m: Annotated[tuple[Stiffness, Stiffness], Loose] = (200.0, 800.0)


class Frequency(_Table):
    """The frequencies of interaction: a range or a list."""

    start_hz: Annotated[float, Field(gt=0)] = 1.0
    stop_hz: Annotated[float, Field(gt=0)] = 450.0
    points: Annotated[int, Field(ge=1, le=1_000_000)] = 200
    spacing: Literal["log", "linear"] = "log"
    values_hz: Annotated[tuple[Annotated[float, Field(gt=0)], ...], Loose] | None = None

    def grid_hz(self) -> NDArray[np.float64]:
        """Return the frequencies, shape (points,), Hz."""
        if self.values_hz is not None:
            return np.array(self.values_hz, dtype=np.float64)
        if self.points == 1:
            return np.array([self.start_hz])
        if self.spacing == "linear":
            return np.linspace(self.start_hz, self.stop_hz, self.points)
        return np.geomspace(self.start_hz, self.stop_hz, self.points)


class Scene(_Table):
    """What is simulated: the motion of the hand's target, the coupling and the effects, and nothing else."""

    duration_s: Annotated[float, Field(gt=0, le=3600)] = 3.0
    coupling: CouplingChoice = "static"
    motion: dict[str, Any] = Field(default_factory=lambda: {"kind": "press"})
    effects: Annotated[tuple[dict[str, Any], ...], Loose] = ()


class Problem(_Table):
    """A whole problem file.

    Attributes:
        name: catalogue name or file stem.
        title: one line for figures and reports.
        source: where the numbers come from; says which are assumed.
    """

    name: str = ""
    title: str = ""
    source: str = ""
    device: Device
    environment: Impedance
    boundaries: Boundaries = Field(
        default_factory=lambda data: Boundaries(upper=data["environment"], lower=data["environment"])
    )
    coupling: Coupling = Coupling()
    stability: Stability = Stability()
    realism: Realism = Realism()
    schedule: ScheduleSettings = ScheduleSettings()
    hands: Hands = Hands()
    frequency: Frequency = Frequency()
    scene: Scene = Scene()

    def frequencies_hz(self) -> NDArray[np.float64]:
        """Return the frequencies of interaction, shape (n,), Hz."""
        return self.frequency.grid_hz()
