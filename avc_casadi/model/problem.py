"""The problem: device, environment, realistic bounds, admissible gains and the claim to be met."""

import itertools
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any, Literal, Self, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field, model_validator

from avc_casadi._errors import InputError
from avc_casadi._util.units import Units
from avc_casadi.model import quantity as q
from avc_casadi.model import table as t
from avc_casadi.model.annotation import tables_of
from avc_casadi.model.control_law import ControlLaw
from avc_casadi.model.corners import Robustness
from avc_casadi.model.device import Detent, Device
from avc_casadi.model.ends import End, Follower, Simulation, Wall, at_least_a_sample
from avc_casadi.model.joint import Joint, NoDevice, joint_law_faults
from avc_casadi.model.scene import MOTIONS, Scene
from avc_casadi.model.unit_text import power_at_handle

Model = Literal["paper", "sampled-data"]
Structure = Literal["series", "damped"]
Contact = Literal["clip-last", "gated"]
Scope = Literal["pointwise", "band", "all", "hands"]
Objective = Literal["magnitude", "complex", "perceptual"]
Required = Literal["none", "jnd", "bounds"]

E = TypeVar("E", bound=End)


class Impedance(t.Table):
    """A damper and a spring in parallel, b + k/s."""

    damping_ns_per_m: q.Damping
    stiffness_n_per_m: q.Stiffness


class Boundaries(t.Table):
    """The range of impedance that feels real; the mean of the range is the desired impedance, equation (10)."""

    upper: Impedance
    lower: Impedance

    def faults(self) -> Iterator[t.Finding]:
        """Yield upper bounds below the lower."""
        for (key, upper), (_, lower) in zip(self.upper, self.lower, strict=True):
            if upper < lower:
                message = f"is {t.shown(upper)}, below the lower bound {t.shown(lower)}; allowed: at least that"
                yield ("upper", key), message


class GainBox(t.Table):
    """Structure of the coupling, its contact law at a one-sided wall, and the range of allowed gains."""

    structure: Structure = "series"
    # clip-last: max(0, y) of the force y to an environment on both sides; gated: y of the penetration, inside alone.
    contact: Contact = "clip-last"
    damping_ns_per_m: q.Pair[q.Damping] = (0.0, 1e4)
    stiffness_n_per_m: q.Pair[q.Stiffness] = (0.0, 1e7)
    contact_damping_ns_per_m: q.Pair[q.Damping] = (0.0, 0.0)

    def faults(self) -> Iterator[t.Finding]:
        """Yield a contact damper in the series structure, which has none."""
        interval = self.contact_damping_ns_per_m
        if self.structure == "series" and interval != (0, 0):
            message = f'is {t.shown(interval)}; allowed: [0.0, 0.0], or structure = "damped", which has this damper'
            yield ("contact_damping_ns_per_m",), message


class Stability(t.Table):
    """The condition (12) on the gains: with which hold, at which frequencies, with which margin on Re Z_h."""

    model: Model = "paper"
    scope: Scope = "pointwise"
    band_factor: q.Factor = 2.0
    margin_ns_per_m: q.Damping = 0.0


class Realism(t.Table):
    """The impedance error to minimise, the just-noticeable difference, and a requirement on every row of gains."""

    objective: Objective = "magnitude"
    jnd: q.Threshold = 0.10
    require: Required = "none"


class ScheduleSettings(t.Table):
    """Smoothness of the gains of the method `schedule` over ln(frequency), and the terms of the cost."""

    slope_penalty: q.Weight = 1e-3
    slope_limit: q.Slope | None = None
    hand_damping_ns_per_m: q.Damping = 0.0
    interaction_hz: q.Pair[q.Hertz] | None = None
    contact_damping_penalty: q.Weight = 1e-6


class Hands(t.Table):
    """The range of hands, each value [lowest, highest]; `avc` uses extreme and random hands of this range."""

    mass_kg: q.Pair[q.Mass] = (0.05, 0.3)
    damping_ns_per_m: q.Pair[q.Damping] = (3.0, 20.0)
    stiffness_n_per_m: q.Pair[q.Stiffness] = (200.0, 800.0)
    let_go: bool = False


_LEAST_STEP = 1e-12
"""Least distance of two frequencies of a range, as a share of its end."""


class Frequency(t.Table):
    """The frequencies of the hand's motion: a range, or the list `values_hz` instead."""

    start_hz: q.Hertz = 1.0
    stop_hz: q.Hertz = 450.0
    points: q.Points = 200
    spacing: Literal["log", "linear"] = "log"
    values_hz: q.Frequencies | None = None

    def faults(self) -> Iterator[t.Finding]:
        """Yield what makes no rising list of frequencies."""
        if self.values_hz is not None:
            for key in sorted(self.model_fields_set - {"values_hz"}):
                yield (key,), "is given with values_hz; give a range or a list, not both"
            for index, (frequency, next_frequency) in enumerate(itertools.pairwise(self.values_hz), start=1):
                if next_frequency <= frequency:
                    message = f"is {t.shown(next_frequency)} after {t.shown(frequency)}; allowed: increasing values"
                    yield ("values_hz", index), message
        elif self.points > 1 and self.stop_hz - self.start_hz < _LEAST_STEP * self.stop_hz * (self.points - 1):
            key = "stop_hz" if self.stop_hz < self.start_hz else "points"
            band = f"{t.shown(self.start_hz)} to {t.shown(self.stop_hz)}{self.origin('stop_hz')} Hz"
            yield (
                (key,),
                f"is {t.shown(getattr(self, key))} in {band}; allowed: a band that has room for {self.points} points",
            )

    @classmethod
    def stated_faults(cls, table: Mapping[str, Any]) -> Iterator[t.Finding]:
        """Yield an end of a range below its start."""
        start, stop = table.get("start_hz"), table.get("stop_hz")
        if isinstance(start, int | float) and isinstance(stop, int | float) and 0 < stop < start:
            yield ("stop_hz",), f"is {t.shown(stop)}; allowed: above start_hz = {t.shown(start)}"

    def origin(self, key: str) -> str:
        """Return a note where a key was not given."""
        return "" if key in self.model_fields_set else " (the default)"


def _given(table: Any) -> Any:
    """Return the keys of a table that were given, its kind included."""
    if not isinstance(table, BaseModel):
        return {} if table is None else table
    kind = {"kind": getattr(table, "kind", None)} if "kind" in type(table).model_fields else {}
    return kind | {key: getattr(table, key) for key in table.model_fields_set}


def _merged(table: Any, change: Any) -> Any:
    """Return a table updated by keys; other than mappings, and a table of another kind, replace it."""
    if not isinstance(change, Mapping) or not isinstance(table, BaseModel):
        return change
    if "kind" in change and change["kind"] != getattr(table, "kind", None):
        return change
    given = _given(table)
    return given | {key: _merged(given.get(key), value) for key, value in change.items()}


def defaults_at(model: type[t.Table], radius_m: float) -> dict[str, Any]:
    """Return the defaults of a table, for a linear device at a radius, as those of the device that turns."""
    scaled: dict[str, Any] = {}
    for key, field in model.model_fields.items():
        scale = radius_m ** -power_at_handle(key)
        if scale != 1 and isinstance(field.default, float):
            scaled[key] = scale * field.default
        elif scale != 1 and isinstance(field.default, tuple) and any(field.default):
            scaled[key] = tuple(scale * end for end in field.default)
    return scaled


def _with_defaults_at(tables: Mapping[str, Any], radius_m: float) -> dict[str, Any]:
    """Return the tables of a problem with the defaults of hands, coupling and motion at the handle's radius."""
    filled = {**tables}
    for key, model in (("hands", Hands), ("coupling", GainBox)):
        table = _given(tables.get(key))
        filled[key] = {**defaults_at(model, radius_m), **table} if isinstance(table, Mapping) else table
    scene = _given(tables.get("scene"))
    motion = _given(scene.get("motion", {"kind": "press"})) if isinstance(scene, Mapping) else None
    kind = motion.get("kind") if isinstance(motion, Mapping) else None
    if motion and isinstance(kind, str) and kind in MOTIONS:
        filled["scene"] = {**scene, "motion": {**defaults_at(MOTIONS[kind], radius_m), **motion}}
    return filled


@cache
def _end_tables(problem: type[t.Table]) -> dict[str, type[End]]:
    return {
        name: table
        for name, field in problem.model_fields.items()
        for table in tables_of(field.annotation, t.Table)
        if issubclass(table, End)
    }


class Problem(t.Table):
    """A problem: device, wall, hands, coupling and requirements, as in a problem file.

    Attributes:
        name: catalogue name or file stem.
        title: one line for figures and reports.
        source: origin of the values; states which are assumed.
        boundaries: if left out, the environment is both bounds.
        environment: the wall; if left out beside a simulation, there is none.
        detent: notches along the axis, beside the wall; None: there are none.
        law: what a controller of one's own does, judged by `certify_law`; None: none is stated.
        simulation: the engine and its tool at the remote end of the coupling; None: the wall is in the device's loop.
            Without a device it is a joint that an engine moves, and no hand is there.
        follower: a second device at the remote end; None: there is none.

    Raises:
        InputError: with every refused value and every broken rule.

    Example:
        >>> problem = avc.load_problem("figure5")
        >>> problem.changed(device={"damping_ns_per_m": 5.0}).device.damping_ns_per_m
        5.0
    """

    name: t.Text = ""
    title: t.Text = ""
    source: t.Text = ""
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
    law: ControlLaw | None = None
    simulation: Simulation | None = None
    follower: Follower | None = None
    frequency: Frequency = Frequency()
    scene: Scene = Scene()

    @model_validator(mode="before")
    @classmethod
    def _with_defaults(cls, tables: Any) -> Any:
        """Fill in defaults: no wall beside a remote end or a law; of what turns those of what slides, at its handle."""
        if not isinstance(tables, Mapping):
            return tables
        without_wall = (*cls.end_tables(), "law")
        if any(tables.get(name) is not None for name in without_wall) and "environment" not in tables:
            tables = {**tables, "environment": {"damping_ns_per_m": 0.0, "stiffness_n_per_m": 0.0}}
        if tables.get("device") is None and tables.get("simulation") is not None:
            tables = {**tables, "device": NoDevice(mass_kg=0.0, damping_ns_per_m=0.0)}
        device = _given(tables.get("device"))
        radius = device.get("handle_radius_m") if isinstance(device, Mapping) else None
        if isinstance(radius, bool) or not isinstance(radius, int | float) or device.get("motion") != "rotary":
            return tables
        if not q.RADII_M[0] <= radius <= q.RADII_M[1]:
            return tables  # the radius is the fault to report, not its consequences
        return _with_defaults_at(tables, radius)

    def faults(self) -> Iterator[t.Finding]:
        """Yield the faults between tables."""
        yield from self._below_nyquist()
        bounds = self.boundaries
        # If left out, both bounds are the environment.
        if self.realism.require == "bounds" and bounds.upper == bounds.lower:
            message = 'is "bounds", but both [boundaries] are equal; use "jnd", or change [boundaries]'
            yield ("realism", "require"), message
        yield from self._scene_faults()
        yield from self._end_faults()
        yield from self._law_faults()

    def _scene_faults(self) -> Iterator[t.Finding]:
        """Yield a scene shorter than a sample, and saturation without a limit."""
        if self.scene.duration_s < self.device.sample_time_s:
            yield ("scene", "duration_s"), f"is {t.shown(self.scene.duration_s)}; {at_least_a_sample(self.device)}"
        for index, effect in enumerate(self.scene.effects):
            if effect.kind == "saturation" and getattr(effect, "force_n", None) is None and not self.device.max_force_n:
                message = "is missing, and so is device.max_force_n; give one of them"
                yield ("scene", "effects", index, "force_n"), message

    def _end_faults(self) -> Iterator[t.Finding]:
        """Yield more than one remote end, detents beside one, and the faults of each with the device."""
        stated = (*self.end_tables(), "device", "detent", "law")
        yield from self.stated_faults({name: getattr(self, name) for name in stated})
        for name, end in self._other_ends().items():
            for path, message in end.faults_beside(self.device):
                yield (name, *path), message

    @classmethod
    def stated_faults(cls, table: Mapping[str, Any]) -> Iterator[t.Finding]:
        """Yield more than one remote end, and what acts in the device's own loop beside one."""
        ends = [name for name in cls.end_tables() if table.get(name) is not None]
        for second in ends[1:]:
            yield (second,), f"is given with [{ends[0]}]; give one of them"
        # The slope of a detent is a spring in the device's own loop, in which no coupling to another end is judged.
        if ends and table.get("detent") is not None:
            known = " or ".join(f"[{name}]" for name in cls.end_tables())
            yield (
                ("detent",),
                f"is given with {known}; give one of them, or compute the detents in the engine or follower",
            )
        is_joint = table.get("device") is None or isinstance(table.get("device"), NoDevice)
        for name in ends if table.get("law") is not None and not is_joint else ():
            yield ("law",), f"is given with [{name}]; give one of them, because a law acts in the device's own loop"

    def _law_faults(self) -> Iterator[t.Finding]:
        """Yield a law beside a remote end, and what of it no loop of the device holds."""
        if self.law is None:
            return
        end = self.end
        if isinstance(end, Joint):
            for path, message in joint_law_faults(self.law, end.engine):
                yield ("law", *path), message
            return
        for path, message in self.law.faults_beside(self.device, self.lightest_kg):
            yield ("law", *path), message

    def _below_nyquist(self) -> Iterator[t.Finding]:
        """Yield the frequencies at which the Tustin map is infinite."""
        band, period = self.frequency, self.device.sample_time_s
        ends = ("start_hz",) if band.points == 1 else ("start_hz", "stop_hz")
        places: list[tuple[t.Path, float, str]] = [((end,), getattr(band, end), band.origin(end)) for end in ends]
        if band.values_hz is not None:
            places = [(("values_hz", index), value, "") for index, value in enumerate(band.values_hz)]
        by_default = [origin for _, value, origin in places if origin and value * period >= 0.5]
        if by_default:
            # Such a frequency stands on no line of the file.
            start_hz, stop_hz = (q.plain(end) for end in (band.start_hz, band.stop_hz))
            usual = f"is {t.shown(period)}, half whose rate is {q.plain(0.5 / period)} Hz; [frequency] is by default"
            yield (
                ("device", "sample_time_s"),
                f"{usual} {start_hz} to {stop_hz} Hz; give start_hz and stop_hz below half the rate",
            )
        for place, value, origin in places:
            if value * period >= 0.5 and not origin:
                allowed = f"below {q.plain(0.5 / period)} Hz, half the rate of sample_time_s = {t.shown(period)}"
                yield ("frequency", *place), f"is {t.shown(value)}; allowed: {allowed}"

    @classmethod
    def end_tables(cls) -> dict[str, type[End]]:
        """Return the kinds of end that a table of the problem states, by the name of that table."""
        return _end_tables(cls)

    def _other_ends(self) -> dict[str, End]:
        stated = {name: getattr(self, name) for name in self.end_tables()}
        ends: dict[str, End] = {name: end for name, end in stated.items() if end is not None}
        if isinstance(self.device, NoDevice) and self.simulation is not None:
            ends["simulation"] = Joint(self.simulation)
        return ends

    @property
    def wall(self) -> Wall:
        """The wall in the device's own loop; without stiffness and damping where the problem states none."""
        return Wall(self.environment.damping_ns_per_m, self.environment.stiffness_n_per_m, self.detent)

    @property
    def lightest_kg(self) -> float:
        """The least mass that moves: of the device, or else of the lightest hand."""
        return min(self.device.range.mass_kg or (self.device.mass_kg,)) or self.hands.mass_kg[0]

    @property
    def law_in_wall(self) -> bool:
        """Whether spring, damper and integral of the law act in a wall, on one side; else they act everywhere."""
        return bool(self.environment.stiffness_n_per_m or self.environment.damping_ns_per_m)

    @property
    def end(self) -> End:
        """What the coupling leads to: the other end that a table states, or else the wall."""
        return next(iter(self._other_ends().values()), self.wall)

    @property
    def end_table(self) -> str:
        """Name of the table that states the end."""
        return next(iter(self._other_ends()), "environment")

    def end_as(self, kind: type[E]) -> E:
        """Return the end of a kind: the wall, or the other end that the problem states.

        Raises:
            InputError: the problem states none of this kind.
        """
        for end in (self.end, self.wall):
            if isinstance(end, kind):
                return end
        raise InputError.of(f"is missing; allowed: {kind.required}", file=self.name or "problem", key=kind.kind)

    def changed(self, **tables: Mapping[str, Any] | BaseModel | str | None) -> Self:
        """Return the problem with some keys changed, validated as a file is.

        Args:
            tables: by name, keys to change in a table (``stability={"scope": "hands"}``), a whole table, a text, or
                None, which removes an optional table.

        Raises:
            InputError: with every refused value and every broken rule.
        """
        whole = {name: getattr(self, name) for name in type(self).model_fields if name != "name"}
        new = {
            name: _merged(whole.get(name), tables[name]) if name in tables else whole[name]
            for name in {**whole, **tables}
        }
        return t.valid(type(self), new, self.name or "problem", self.name)

    def __repr__(self) -> str:
        device = self.device
        wall = self.environment
        unit = self.units.unit
        return (
            f"Problem({self.name!r}: wall {wall.stiffness_n_per_m:g} {unit('N/m')}, {wall.damping_ns_per_m:g} "
            f"{unit('N.s/m')}; device {device.mass_kg:g} {unit('kg')}, {device.damping_ns_per_m:g} {unit('N.s/m')}, "
            f"T {1e3 * device.sample_time_s:g} ms, delay {device.delay_samples})"
        )

    __str__ = __repr__

    @property
    def units(self) -> Units:
        """Names and units in which its values are printed."""
        return self.device.units

    def frequencies_hz(self) -> NDArray[np.float64]:
        """Return the frequencies of interaction, shape (n,), Hz; a range of one point is its start."""
        band = self.frequency
        if band.values_hz is not None:
            return np.array(band.values_hz, dtype=np.float64)
        spread = np.linspace if band.spacing == "linear" else np.geomspace
        return spread(band.start_hz, band.stop_hz, band.points)
