"""The problem: device, environment, realistic bounds, admissible gains and the claim to be met.

Frozen pydantic models of plain numbers; a key's name carries its SI unit. ``problems/`` holds examples.
"""

from collections.abc import Mapping
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field, model_validator

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.printed import short
from avc_casadi._util.units import KG, N_PER_M, NS_PER_M, Units, in_its_units
from avc_casadi.model.device import Detent, Device
from avc_casadi.model.findings import checked
from avc_casadi.model.follower import Follower
from avc_casadi.model.quantity import (
    Damping,
    DampingInterval,
    Factor,
    Frequencies,
    FrequencyInterval,
    Hertz,
    MassInterval,
    Points,
    Slope,
    Stiffness,
    StiffnessInterval,
    Table,
    Text,
    Threshold,
    Weight,
    refusal,
)
from avc_casadi.model.robustness import Robustness
from avc_casadi.model.rotary_defaults import with_rotary_defaults
from avc_casadi.model.rules import RULES, Values, broken_rules, dotted
from avc_casadi.model.scene import Scene
from avc_casadi.model.virtual_tool import VirtualTool

Model = Literal["paper", "sampled-data"]
Structure = Literal["series", "damped"]
Contact = Literal["clip-last", "gated"]
Scope = Literal["pointwise", "band", "all", "hands"]
Objective = Literal["magnitude", "complex", "perceptual"]
Required = Literal["none", "jnd", "bounds"]


class Impedance(Table):
    """A damper and a spring side by side, b + k/s.

    Attributes:
        damping_ns_per_m: damper b.
        stiffness_n_per_m: spring k.
    """

    damping_ns_per_m: Damping
    stiffness_n_per_m: Stiffness


class Boundaries(Table):
    """The range of realistic impedance; its mean is the desired impedance   (10)."""

    upper: Impedance
    lower: Impedance


class GainBox(Table):
    """Structure of the coupling, its law at a one-sided wall, and the box of admissible gains, each [lowest, highest].

    Contact clip-last: F = max(0, y), y the force of the coupling to an environment on both sides. Gated: the same on
    the tool's penetration, and only where the device is in the wall; it always applies where the wall or the
    coupling has no spring.

    Attributes:
        structure: series, the paper's spring and damper; damped, the same with a contact damper.
        contact: law at a one-sided wall.
        damping_ns_per_m: b, [lowest, highest].
        stiffness_n_per_m: k, [lowest, highest].
        contact_damping_ns_per_m: b_p, [lowest, highest]; structure damped only.
    """

    structure: Structure = "series"
    contact: Contact = "clip-last"
    damping_ns_per_m: DampingInterval = (0.0, 1e4)
    stiffness_n_per_m: StiffnessInterval = (0.0, 1e7)
    contact_damping_ns_per_m: DampingInterval = (0.0, 0.0)


class Stability(Table):
    """The claim that the gains must meet: hold model, scope of frequencies, margin on Re Z_h   (12).

    Attributes:
        model: paper, its hold (z+1)/(2z); sampled-data, the loop that runs on a device.
        scope: frequencies or hands for which each row of gains must meet the claim.
        band_factor: for the scope band: from f/factor to f factor.
        margin_ns_per_m: least Re Z_h.
    """

    model: Model = "paper"
    scope: Scope = "pointwise"
    band_factor: Factor = 2.0
    margin_ns_per_m: Damping = 0.0


class Realism(Table):
    """Error measure, just-noticeable difference as a share of |Z|, and the requirement on every row of gains.

    Required: nothing; |Z_h - Z_h_ds| <= jnd |Z_h_ds|; or |Z_h| between those of the boundaries. The methods direct and
    schedule keep it as a constraint.

    Attributes:
        objective: magnitude, (11); complex, phase too; perceptual, the excess over the just-noticeable difference.
        jnd: just-noticeable difference as a share of |Z|.
        require: kept by schedule at every row: within jnd of the desired impedance, or |Z| within
            the boundaries.
    """

    objective: Objective = "magnitude"
    jnd: Threshold = 0.10
    require: Required = "none"


class ScheduleSettings(Table):
    """Smoothness of the joint schedule over ln(frequency), and the terms of its cost.

    A slope limit of None is no limit. Outside `interaction_hz` the error weighs a tenth. The contact damping penalty
    weighs the mean of (b_p/|Z_h_ds|)^2. The hand's damping is credited to the device in the constraints on Re Z_h.

    Attributes:
        slope_penalty: weight of (d ln b/d ln f)^2 + (d ln k/d ln f)^2.
        slope_limit: largest |d ln b/d ln f| and |d ln k/d ln f|; None: no limit.
        hand_damping_ns_per_m: damping credited to the hand.
        interaction_hz: band of interaction: errors elsewhere weigh a tenth; None: equal weight everywhere.
        contact_damping_penalty: weight of the mean of (b_p/|Z_h_ds|)^2.
    """

    slope_penalty: Weight = 1e-3
    slope_limit: Slope | None = None
    hand_damping_ns_per_m: Damping = 0.0
    interaction_hz: FrequencyInterval | None = None
    contact_damping_penalty: Weight = 1e-6


class Hands(Table):
    """The set of hands, each value [lowest, highest]: corners and draws of it are used.

    With `let_go` the released device belongs to the set, as is required for deployment.

    Attributes:
        mass_kg: [lowest, highest].
        damping_ns_per_m: [lowest, highest].
        stiffness_n_per_m: [lowest, highest].
        let_go: whether the released device (no operator) belongs to the set.
    """

    mass_kg: MassInterval = (0.05, 0.3)
    damping_ns_per_m: DampingInterval = (3.0, 20.0)
    stiffness_n_per_m: StiffnessInterval = (200.0, 800.0)
    let_go: bool = False


class Frequency(Table):
    """The frequencies of interaction: a range, or the list `values_hz` in its place.

    Attributes:
        start_hz: lowest frequency of interaction.
        stop_hz: highest; below half the sampling rate. If that is below the default, it is 0.45 of the rate.
        points: how many rows.
        spacing: even in ln f, or in f.
        values_hz: a list in place of all four.
    """

    start_hz: Hertz = 1.0
    stop_hz: Hertz = 450.0
    points: Points = 200
    spacing: Literal["log", "linear"] = "log"
    values_hz: Frequencies | None = None

    def grid_hz(self) -> NDArray[np.float64]:
        """Return the frequencies, shape (points,), Hz; a range of one point is its start."""
        if self.values_hz is not None:
            return np.array(self.values_hz, dtype=np.float64)
        if self.points == 1:
            return np.array([self.start_hz])
        if self.spacing == "linear":
            return np.linspace(self.start_hz, self.stop_hz, self.points)
        return np.geomspace(self.start_hz, self.stop_hz, self.points)


def _merged(table: Any, change: Any) -> Any:
    """Return a table updated by keys; other than mappings replace it."""
    if not isinstance(change, Mapping) or not isinstance(table, BaseModel):
        return change
    given = {key: getattr(table, key) for key in table.model_fields_set}
    return given | {key: _merged(given.get(key), value) for key, value in change.items()}


class Problem(Table):
    """A problem: device, wall, hands, coupling and requirements, as in a problem file.

    Attributes:
        name: catalogue name or file stem.
        title: one line for figures and reports.
        source: origin of the values; states which are assumed.
        boundaries: if left out, the environment is both bounds.
        environment: the wall; if left out beside a simulation, there is none.
        detent: notches along the axis, beside the wall; None: there are none.
        simulation: the engine and its tool at the remote end of the coupling; None: the wall is in the device's loop.
        follower: a second device at the remote end; None: there is none.

    Raises:
        pydantic.ValidationError: a value is refused, or a rule between values is broken.

    Example:
        >>> problem = avc.load_problem("figure5")
        >>> problem.changed(device={"damping_ns_per_m": 5.0}).device.damping_ns_per_m
        5.0
    """

    name: Text = ""
    title: Text = ""
    source: Text = ""
    device: Device
    environment: Impedance
    boundaries: Boundaries = Field(
        default_factory=lambda data: Boundaries(upper=data["environment"], lower=data["environment"])
    )
    coupling: GainBox = GainBox()
    stability: Stability = Stability()
    realism: Realism = Realism()
    schedule: ScheduleSettings = ScheduleSettings()
    hands: Hands = Hands()
    robustness: Robustness = Robustness()
    detent: Detent | None = None
    simulation: VirtualTool | None = None
    follower: Follower | None = None
    frequency: Frequency = Frequency()
    scene: Scene = Scene()

    @model_validator(mode="before")
    @classmethod
    def _hands_that_turn(cls, tables: Any) -> Any:
        """Fill in defaults: no wall beside a remote end; for a rotary device those of a linear one at its handle."""
        if not isinstance(tables, Mapping):
            return tables
        far = tables.get("simulation") is not None or tables.get("follower") is not None
        if far and "environment" not in tables:
            tables = {**tables, "environment": {"damping_ns_per_m": 0.0, "stiffness_n_per_m": 0.0}}
        return with_rotary_defaults(tables)

    @model_validator(mode="after")
    def _keeps_the_rules(self) -> Self:
        broken = broken_rules(Values(self, type(self)), RULES)
        if broken:
            raise refusal("\n".join(f"{dotted(path)}: {message}" for path, message in broken))
        return self

    def changed(self, **tables: Mapping[str, Any] | BaseModel | str | None) -> Self:
        """Return the problem with some keys changed, validated as a file is.

        Args:
            tables: by name, keys to change in a table (``stability={"scope": "hands"}``), a whole table, a text, or
                None, which removes an optional table.

        Raises:
            InputError: with every refused value and every broken rule.
        """
        whole = {name: getattr(self, name) for name in type(self).model_fields if name != "name"}
        found = checked(
            type(self),
            {
                name: _merged(whole.get(name), tables[name]) if name in tables else whole[name]
                for name in {**whole, **tables}
            },
            self.name,
        )
        if isinstance(found, list):
            raise InputError([Fault(self.name or "problem", None, dotted(path), message) for path, message in found])
        return found

    @in_its_units
    def __repr__(self) -> str:
        device, wall, f = self.device, self.environment, self.frequencies_hz()
        return (
            f"Problem({self.name!r}: wall {wall.stiffness_n_per_m:g} {N_PER_M}, {wall.damping_ns_per_m:g} "
            f"{NS_PER_M}; device "
            f"{device.mass_kg:g} {KG}, {device.damping_ns_per_m:g} {NS_PER_M}, T {1e3 * device.sample_time_s:g} "
            "ms, delay "
            f"{device.delay_samples};\n  {self.coupling.structure}, model {self.stability.model}, scope "
            f"{self.stability.scope}, {short(f, 'Hz')} in {len(f)} rows)"
        )

    __str__ = __repr__

    @property
    def units(self) -> Units:
        """Names and units in which its values are printed."""
        return self.device.units

    def frequencies_hz(self) -> NDArray[np.float64]:
        """Return the frequencies of interaction, shape (n,), Hz."""
        return self.frequency.grid_hz()
