"""The coupling that is deployed to a device, as one object that every verb shares."""

from __future__ import annotations

import hashlib
import json
import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import singledispatch
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from avc_casadi._errors import InputError
from avc_casadi._util.json_values import Document
from avc_casadi._util.units import Units
from avc_casadi.model.device import CURRENT_LOOP_DAMPING_RATIO, Device
from avc_casadi.model.ends import End, Follower, Simulation, ToolGains, Wall
from avc_casadi.model.gains import Gains, GainSchedule, GainTable, Status, fewest_rows
from avc_casadi.model.problem import Contact, Impedance, Problem
from avc_casadi.model.runtime import OPENING_KEYS, Runtime, StateFeedback
from avc_casadi.paper.rows import gain_schedule


def contact_law(requested: Contact, wall_stiffness_n_per_m: float, stiffness_n_per_m: ArrayLike) -> Contact:
    """Return the contact law that runs at a wall."""
    # Dampers alone do not depend on position: clipped last they would act in free space.
    springs = wall_stiffness_n_per_m > 0 and bool(np.all(np.asarray(stiffness_n_per_m) > 0))
    return requested if springs else "gated"


THINNING = 1e-3
"""Largest relative change of a gain by thinning; certificate, scene and device read the thinned table."""
CAPACITY_ROWS = 256
"""Largest number of rows of a device."""


def _device_document(device: Device) -> dict[str, Any]:
    """Return the values that identify a device; keys newer than a file are included only if they change its meaning."""
    document: dict[str, Any] = device.model_dump(mode="json")
    if device.amplifier_damping_ratio == CURRENT_LOOP_DAMPING_RATIO:
        del document["amplifier_damping_ratio"]
    if device.range.amplifier_damping_ratio is None:
        del document["range"]["amplifier_damping_ratio"]
    return document


def hash_of(runs: Mapping[str, Any]) -> str:
    """Return the name of what runs: 8 hexadecimal digits of its hash."""
    return hashlib.sha256(json.dumps(runs, sort_keys=True).encode()).hexdigest()[:8]


class TrialRecord(Document, ABC):
    """What a coupling carries of its trial with simulated hands: the trial itself, or the record of it in a file."""

    @property
    @abstractmethod
    def largest_tap_force_n(self) -> float:
        """Largest force of a tap, N."""


@dataclass(frozen=True, eq=False)
class Coupling:
    """Gains and runtime with the loop that they were designed for.

    The same table is certified, simulated, pushed and exported: `table`, thinned once, read by one look-up.

    Attributes:
        problem: the problem as stated: device, wall, hands, scene.
        schedule: result of the method at each frequency, with its reasons.
        table: the gains that run.
        runtime: observer, feedback, estimator, adaptation, guard.
        certificate: its certificate with the verdict on deployment, or the record of one in a file; None before it was
            certified.
        trial: result with simulated hands, or the record of one in a file; None before it was tried.
        versions: of the software that made it, by package.
        lacks: facts missing from an older file, a sentence each.
        end_type: kind of `end`, what it leads to: a problem with a follower may have couplings to its wall too. The
            row of one to another end is B, K and the damper of each local loop.
        edited: whether its file was changed after avc wrote it; what it declares is judged as it stands.

    Example:
        >>> problem = avc.load_problem("soft")
        >>> coupling = avc.Coupling.from_schedule(problem, avc.solve(problem))
        >>> coupling.structure
        'series'
    """

    problem: Problem
    schedule: GainSchedule = field(repr=False)
    table: GainTable
    runtime: Runtime = field(default_factory=Runtime)
    certificate: Document | None = field(default=None, repr=False)
    trial: TrialRecord | None = field(default=None, repr=False)
    versions: Mapping[str, str] = field(default_factory=dict, repr=False)
    lacks: tuple[str, ...] = ()
    end_type: type[End] = Wall
    edited: bool = False

    @classmethod
    def from_schedule(
        cls,
        problem: Problem,
        schedule: GainSchedule,
        runtime: Runtime | None = None,
        versions: Mapping[str, str] | None = None,
    ) -> Coupling:
        """Return the coupling of a schedule: its rows with gains, thinned once."""
        deployed_runtime = runtime or Runtime(state_feedback=schedule.state_feedback)
        return cls(problem, schedule, thinned(GainTable.of(schedule)), deployed_runtime, versions=versions or {})

    @classmethod
    def constant(cls, problem: Problem, gains: Gains, method: str, runtime: Runtime | None = None) -> Coupling:
        """Return a coupling of finite constant gains, for example ones tuned by hand."""
        table = GainTable.constant_gains(gains, float(problem.frequencies_hz()[0]))
        deployed_runtime = runtime or Runtime()
        return cls(
            problem, schedule_of(problem, table, method, deployed_runtime.state_feedback), table, deployed_runtime
        )

    @property
    def static_stiffness_n_per_m(self) -> float:
        """Stiffness of coupling and wall in series at rest, N/m."""
        k, wall = self.table.at_rest.stiffness_n_per_m, self.wall.stiffness_n_per_m
        return k * wall / (k + wall) if k + wall else 0.0

    @classmethod
    def to_end(
        cls,
        problem: Problem,
        gains: ToolGains,
        certificate: Document | None = None,
        trial: TrialRecord | None = None,
        versions: Mapping[str, str] | None = None,
    ) -> Coupling:
        """Return the coupling of a device to the other end of its problem."""
        row = Gains(gains.damping_ns_per_m, gains.stiffness_n_per_m, gains.local_damping_ns_per_m)
        table = GainTable.constant_gains(row)
        schedule = schedule_of(problem, table, "recommend")
        return cls(problem, schedule, table, Runtime(), certificate, trial, versions or {}, end_type=type(problem.end))

    @property
    def gains(self) -> ToolGains:
        """K, B and the damper of each local loop, at the device."""
        row = self.table.at_rest
        return ToolGains(row.stiffness_n_per_m, row.damping_ns_per_m, row.contact_damping_ns_per_m)

    @property
    def end(self) -> End:
        """What it leads to: the wall or the other end of its problem."""
        return self.problem.end_as(self.end_type)

    @property
    def tool(self) -> Simulation:
        """The simulation that it leads to; an InputError where its problem states none."""
        return self.problem.end_as(Simulation)

    @property
    def follower(self) -> Follower:
        """The follower that it leads to; an InputError where its problem states none."""
        return self.problem.end_as(Follower)

    @property
    def in_scene(self) -> ToolGains:
        """K and B in the engine's units of position and force; the local damper stays at the device."""
        gains, scale = self.gains, self.tool.scale
        return ToolGains(gains.stiffness_n_per_m / scale, gains.damping_ns_per_m / scale, gains.local_damping_ns_per_m)

    @property
    def at_follower(self) -> ToolGains:
        """All gains in the follower's units of position and force."""
        return self.gains.at_scale(1 / self.follower.scale)

    @property
    def units(self) -> Units:
        """Names and units in which it is printed."""
        return self.problem.units

    def __repr__(self) -> str:
        wall, law = self.wall, self.runtime.state_feedback
        # Beside an observer law the table is a stiff placeholder, which renders nothing of its own.
        gains = repr(self.table) if law is None else f"observer ({len(law.innovation)} states) with state feedback"
        return (
            f"Coupling({self.problem.name!r} by {self.method}: {gains}, wall {wall.stiffness_n_per_m:g} "
            f"{self.units.unit('N/m')}, T {1e3 * self.sample_time_s:g} ms)"
        )

    def __eq__(self, other: object) -> bool:
        """Return whether both are the same coupling for the same problem, regardless of certificate and trial."""
        return isinstance(other, Coupling) and self.id == other.id and self.problem == other.problem

    def __hash__(self) -> int:
        return hash(self.id)

    @property
    def method(self) -> str:
        """Name of the method that made the gains."""
        return self.schedule.method

    @property
    def structure(self) -> str:
        """Series or damped: whether a contact damper is in use."""
        return "damped" if bool(np.any(self.table.rows[:, 3] > 0)) else "series"

    @property
    def contact(self) -> Contact:
        """The contact law that runs: that of the problem, or gated where wall or coupling lacks a spring."""
        return contact_law(self.problem.coupling.contact, self.wall.stiffness_n_per_m, self.table.gains[1])

    @property
    def wall(self) -> Impedance:
        """The wall behind the coupling."""
        return self.problem.environment

    @property
    def sample_time_s(self) -> float:
        """T, the only one at which the gains are valid."""
        return self.problem.device.sample_time_s

    @property
    def max_force_n(self) -> float | None:
        """Largest force of the device; None where the problem states none."""
        return self.problem.device.max_force_n

    @property
    def id(self) -> str:
        """Identifier, a hash of table, runtime, end and device: 8 hexadecimal digits."""
        return hash_of(_identity(self.end, self))

    def for_problem(self, problem: Problem) -> Coupling:
        """Return the same table and runtime on another problem: not certified, not tried."""
        check_sample_time(self.sample_time_s, problem, f"coupling by {self.method} for {self.problem.name}")
        return replace(self, problem=problem, certificate=None, trial=None)

    def with_certificate(self, certificate: Document) -> Coupling:
        """Return the same coupling with its certificate beside it."""
        return replace(self, certificate=certificate)


@singledispatch
def _identity(end: End, coupling: Coupling) -> dict[str, Any]:
    """Return what identifies a coupling to an end."""
    device = coupling.problem.device.model_dump(mode="json")
    return {"gains": vars(coupling.gains), "device": device, end.kind: end.document()}


@_identity.register
def _identity_at_wall(end: Wall, coupling: Coupling) -> dict[str, Any]:
    """Return what a coupling to a wall runs, of which its identifier is a hash: rows, runtime, wall and device."""
    runtime, law = coupling.runtime.document(), coupling.runtime.state_feedback
    if law is not None and law.open_m == 0:  # a dead zone that never opens, as in earlier releases
        runtime["state_feedback"] = {
            key: value for key, value in runtime["state_feedback"].items() if key not in OPENING_KEYS
        }
    runs = {
        "rows": (coupling.table.rows + 0.0).tolist(),  # a zero has no sign
        "runtime": runtime,
        "wall": [end.damping_ns_per_m, end.stiffness_n_per_m],
        "device": _device_document(coupling.problem.device),
    }
    if coupling.contact != "gated":  # the only contact law of earlier releases, and part of no id of that time
        runs["contact"] = coupling.contact
    if end.detent is not None:
        runs["detent"] = end.detent.model_dump(mode="json")
    return runs


def thinned(table: GainTable) -> GainTable:
    """Return one row for constant gains, otherwise the fewest within `THINNING`, or within more if too many."""
    if table.constant:
        return GainTable(table.rows[:1])
    tolerance = THINNING
    while len(kept := fewest_rows(table.rows, tolerance)) > CAPACITY_ROWS:
        tolerance *= 1.25
    return GainTable(table.rows[kept])


def schedule_of(
    problem: Problem,
    table: GainTable,
    method: str,
    state_feedback: StateFeedback | None = None,
    without_hz: Sequence[float] = (),
) -> GainSchedule:
    """Return the schedule of a table, with the frequencies at which its method found no gains."""
    frequency = np.union1d(table.frequency_hz, without_hz)
    b, k, contact = table(frequency)
    status = tuple(Status.INFEASIBLE if hz in without_hz else Status.SOLVED for hz in frequency)
    return gain_schedule(
        problem, method, (b, k, contact), status, frequency_hz=frequency, state_feedback=state_feedback
    )


def check_sample_time(sample_time_s: float, problem: Problem, file: str) -> None:
    """Refuse gains of another sample time, which belong to another loop. Unknown (NaN) passes."""
    period_s = problem.device.sample_time_s
    if math.isfinite(sample_time_s) and not math.isclose(sample_time_s, period_s, rel_tol=1e-9):
        raise InputError.of(
            f"is {sample_time_s:g}, but device.sample_time_s of {problem.name} is {period_s:g}; give gains that were "
            "solved for this sample time",
            file=file,
            key="sample_time_s",
        )


def require_coupling(value: object) -> None:
    """Refuse what is no coupling to a wall, with the call that makes one."""
    if isinstance(value, Coupling):
        end = value.end
        if isinstance(end, Wall):
            return
        hint = (
            f"is a coupling to a [{end.kind}], without wall and gain table; use avc certify or avc export"
            f"{', or avc simulate' if end.in_scenes else ''}"
        )
    elif isinstance(value, str | PathLike):
        hint = f"is the text {str(value)!r}; give a coupling: avc.read_coupling({str(value)!r})"
    else:
        hint = f"is a {type(value).__name__}; give a Coupling, such as the attribute `coupling` of a recommendation"
    raise InputError.of(hint, key="coupling")
