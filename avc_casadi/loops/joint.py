"""The loop of kp and kd around a joint that an engine moves: one map of a step, for every joint of declared ranges.

Each step the engine applies force = -(kp x + kd v), of its own state or of that of `steps_late` steps ago, held over
all substeps. What an implicit integrator solves for its new state (kd, or both) acts at once, anew in each substep. v
is the velocity of the engine, or on request the difference of x over a step.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray
from avc_casadi.loops.engine import contact_knots_n_per_m
from avc_casadi.loops.loop import Loop
from avc_casadi.loops.margins import damping_ratios
from avc_casadi.loops.plant_family import RADIUS_TOLERANCE
from avc_casadi.loops.search import Box, corners_and_knots, worst_point
from avc_casadi.loops.spectrum import ClosedLoops
from avc_casadi.model.ends import RIGID_N_PER_M, Simulation, tool_step

Places = dict[str, FloatArray]
"""Joints by their values: `mass_kg`, `damping_ns_per_m`, `step_s`, and those of a contact, each of shape (m,)."""
Values = float | FloatArray | ComplexArray
Measure = Callable[["JointLoops"], FloatArray]
"""A number of each loop, largest in the worst case."""

KEYS = ("mass_kg", "damping_ns_per_m", "step_s", "contact_stiffness_n_per_m", "contact_damping_ns_per_m")
"""Names of the values of a joint."""
LARGEST_ALTERNATION = 0.4
"""Share by which what alternates from step to step shrinks in a well damped joint: to a tenth in less than three."""
# A pole of which the angle is that much less than half a turn is real.
_LEAST_TURN = 1e-6
# Corners of the other sides that are drawn at each knot of a contact.
_KNOT_DRAWS = 4
# Disk margins that are tried, and phases of the factor on the force at each.
_DISKS = np.geomspace(0.02, 1.999, 48)
_PHASES = np.exp(1j * np.linspace(0.0, math.pi, 49))
_PHASES_OF_A_SEARCH = 6
_BISECTIONS = 14
# Joints in contact that a design looks at, before a search of the ranges adds others.
_JOINTS_OF_A_DESIGN = 24
_UNCHANGED: Mapping[str, float] = {}


@dataclass(frozen=True)
class JointGains:
    """kp and kd of a joint, or of each of m joints, and whether v is the difference of the position over a step."""

    kp: float | FloatArray
    kd: float | FloatArray
    difference: bool = False


@dataclass(frozen=True, eq=False)
class JointLoops:
    """The loops of m joints with gains, which may be a factor on the force too, complex or one for each joint."""

    engine: Simulation
    places: Places
    gains: JointGains
    factor: Values = 1.0

    @cached_property
    def loop(self) -> Loop:
        """The state: position and velocity, the position a step before if it is read, and the forces under way."""
        return Loop(joint=2, last=int(self.gains.difference), queue=self.engine.steps_late)

    @cached_property
    def maps(self) -> FloatArray:
        """The maps of a joint over one step of its engine, shape (m, size, size).

        States: position and velocity, the position a step before if the velocity is a difference, and the forces under
        way. The force is -(kp position + kd velocity), of which an implicit engine solves a part.
        """
        loop = self.loop
        values = {name: value[:, None] for name, value in self.places.items()}
        t = values["step_s"] / self.engine.substeps
        kp = np.reshape(self.factor * self.gains.kp, (-1, 1))
        kd = np.reshape(self.factor * self.gains.kd, (-1, 1))
        solved_kp, solved_kd = self.engine.implicit_part(kp, kd)
        place, speed = loop["joint"]
        seen = (place - loop["last"][0]) / values["step_s"] if self.gains.difference else speed
        force = (kp - solved_kp) * place + (kd - solved_kd) * seen
        late = self.engine.steps_late
        acting = loop["queue"][-1] if late else force
        mass = values["mass_kg"]
        drag = values["damping_ns_per_m"] + values["contact_damping_ns_per_m"] + solved_kd
        stiffness = values["contact_stiffness_n_per_m"] + solved_kp
        doublings = 10 + int(np.log2(1 + np.max(np.abs(t * (drag + np.sqrt(stiffness * mass)) / mass))))
        to_place, to_speed = tool_step(self.engine.integrator, t, mass, drag, stiffness, doublings)
        for _ in range(self.engine.substeps):
            place, speed = (
                by_place * place + by_speed * speed - by_force * acting
                for by_place, by_speed, by_force in (to_place, to_speed)
            )
        after = np.stack(np.broadcast_arrays(place, speed), axis=-2)
        newest = np.broadcast_to(force, (*after.shape[:-2], loop.size))[..., None, :]
        last = loop["joint"][:1] if self.gains.difference else loop["last"]
        return loop.event(joint=after, last=last, queue=loop.queue("queue", newest[..., :late, :]))

    @cached_property
    def closed(self) -> ClosedLoops:
        """The loops, which without kp rest anywhere."""
        rest = {"joint": np.array([1.0, 0.0]), "last": 1.0}
        return ClosedLoops(self.maps, self.loop.rests(rest))

    @property
    def free(self) -> BoolArray:
        """Which of the joints touch nothing."""
        return np.asarray(self.places["contact_stiffness_n_per_m"] == 0)

    @property
    def radius(self) -> FloatArray:
        """The spectral radius of each loop over a step."""
        return self.closed.radius

    @property
    def alternation(self) -> FloatArray:
        """The largest real pole below 0 of each loop, its size: what alternates from step to step shrinks by it."""
        poles = self.closed.poles
        alternates = np.abs(np.angle(poles)) > math.pi - _LEAST_TURN
        return np.asarray(np.where(alternates, np.abs(poles), 0.0).max(axis=-1))

    @property
    def damping_ratios(self) -> FloatArray:
        """The least damping ratio of each loop; 1 without an oscillation."""
        return np.asarray(damping_ratios(self.closed.poles).min(axis=-1))


@dataclass(frozen=True)
class JointCase:
    """Where in the ranges a measure of the loop is largest, and the measure there."""

    value: float
    joint: dict[str, float]


class JointFamily:
    """A joint with the ranges of its mass, damping, step and contact: free, and on every declared spring."""

    def __init__(self, engine: Simulation) -> None:
        """Set up the ranges of a joint, free and on the springs that it may touch, and the joints at their corners.

        A rigid contact stops the joint, so that it moves in none.
        """
        assert engine.tool_mass_kg is not None  # noqa: S101 - a joint has one
        self.engine = engine
        free = {
            "mass_kg": engine.tool_mass_kg,
            "damping_ns_per_m": engine.tool_damping_ns_per_m,
            "step_s": engine.step_s,
        }
        self.boxes = [Box(free)]
        # A rigid contact stops the joint: it moves in none.
        springs = next((knots for knots in contact_knots_n_per_m(engine) if 0 < knots[0] < RIGID_N_PER_M), None)
        if springs is not None:
            touching = {**free, "contact_stiffness_n_per_m": (float(springs[0]), float(springs[-1]))}
            if engine.contact_damping_ns_per_m is not None:
                touching["contact_damping_ns_per_m"] = engine.contact_damping_ns_per_m
            knots = {"contact_stiffness_n_per_m": springs} if len(springs) > 1 else {}
            self.boxes.append(Box(touching, knots))
        of_boxes = [self._joints(box, corners_and_knots(box.cells, _KNOT_DRAWS)) for box in self.boxes]
        self.places: Places = {key: np.concatenate([places[key] for places in of_boxes]) for key in KEYS}

    def _joints(self, box: Box, shares: FloatArray) -> Places:
        """Return mass, damping, step and contact of joints at shares of a box of ranges, each of shape (m,).

        A contact without a damper of its own is damped critically, 2 sqrt(k m).
        """
        values = box.values(shares)
        stiffness = values.get("contact_stiffness_n_per_m", np.zeros(shares.shape[1]))
        critical = 2 * np.sqrt(stiffness * values["mass_kg"])
        return {
            **{key: values[key] for key in ("mass_kg", "damping_ns_per_m", "step_s")},
            "contact_stiffness_n_per_m": stiffness,
            "contact_damping_ns_per_m": values.get("contact_damping_ns_per_m", critical),
        }

    def loops(self, gains: JointGains, changes: Mapping[str, float] = _UNCHANGED) -> JointLoops:
        """Return the loops at corners, knots and the worst points so far, with other values of the joint if given."""
        return JointLoops(self.engine, _changed(self.places, changes), gains)

    def worst(self, gains: JointGains, measure: Measure, changes: Mapping[str, float] = _UNCHANGED) -> JointCase:
        """Return where in the ranges a measure is largest, by a search of them all, and keep that joint."""
        cases = [self._worst_of(box, gains, measure, changes) for box in self.boxes]
        worst = max(cases, key=lambda case: case.value)
        self.places = {key: np.append(self.places[key], worst.joint[key]) for key in KEYS}
        return worst

    def _worst_of(self, box: Box, gains: JointGains, measure: Measure, changes: Mapping[str, float]) -> JointCase:
        def of_shares(shares: FloatArray) -> ComplexArray:
            places = _changed(self._joints(box, shares), changes)
            return measure(JointLoops(self.engine, places, gains)).astype(np.complex128)

        shares, values = worst_point(of_shares, len(box.sides), box.cells)
        joint = self._joints(box, shares)
        return JointCase(float(np.abs(values[0])), {key: float(joint[key][0]) for key in KEYS})

    def stable(self, gains: JointGains, changes: Mapping[str, float] = _UNCHANGED) -> bool:
        """Return whether every loop so far is stable."""
        return bool(self.loops(gains, changes).radius.max() < 1 - RADIUS_TOLERANCE)

    def disk_margin(self, gains: JointGains) -> float:
        """Return the least disk margin of all loops so far, up to 1.999; 0 where one is unstable.

        It is the least alpha at which a loop with all forces times (1 + alpha w/2)/(1 - alpha w/2), |w| = 1, is not
        stable (Seiler, Packard and Gahinet 2020). What an engine solves has no actuator to break the loop at: it is
        part of the force too.
        """
        loops = self.loops(gains)
        if loops.radius.max() >= 1:
            return 0.0
        last = 0.0
        for disk in _DISKS.tolist():
            if not self._withstands(loops, disk):
                return self._edge(loops, last, disk)
            last = disk
        return last

    def damping_ratio(self, gains: JointGains) -> tuple[float, float]:
        """Return the least damping ratio of the joint that touches nothing, and its frequency, Hz; 1 and 0 of none."""
        loops = self.loops(gains)
        ratios = np.where(loops.free, loops.damping_ratios, 1.0)
        place = int(ratios.argmin())
        poles = loops.closed.poles[place]
        turn = abs(float(np.angle(poles[damping_ratios(poles).argmin()])))
        step_s = float(loops.places["step_s"][place])
        ratio = 0.0 if abs(ratios[place]) <= RADIUS_TOLERANCE else float(ratios[place])
        return ratio, turn / (2 * math.pi * step_s) if ratio < 1 else 0.0

    def search(self, gains: JointGains, disk: float) -> None:
        """Search the ranges for the least stable joint, the least damped and that of the least disk margin."""
        self.worst(gains, lambda loops: loops.radius)
        self.worst(gains, lambda loops: np.where(loops.free, 1 - loops.damping_ratios, 0.0))
        if disk > 0:
            self.worst(gains, partial(_radius_on_circle, disk=disk, phases=_PHASES[::_PHASES_OF_A_SEARCH]))

    def _edge(self, loops: JointLoops, stable: float, unstable: float) -> float:
        for _ in range(_BISECTIONS):
            middle = 0.5 * (stable + unstable)
            stable, unstable = (middle, unstable) if self._withstands(loops, middle) else (stable, middle)
        return stable

    def _withstands(self, loops: JointLoops, disk: float) -> bool:
        return bool(_radius_on_circle(loops, disk).max() < 1)

    def narrow(self, gains: JointGains, disk: float) -> None:
        """Keep the free joints, and of those in contact the least robust ones."""
        loops = self.loops(gains)
        rank = np.where(loops.free, np.inf, _radius_on_circle(loops, disk))
        kept = np.argsort(-rank)[: int(loops.free.sum()) + _JOINTS_OF_A_DESIGN]
        self.places = {key: value[kept] for key, value in self.places.items()}

    def _with_dampers(self, kp: float, dampers: FloatArray, *, difference: bool) -> JointLoops:
        """Return the loops so far with each of some kd, those of the first kd first."""
        places = {key: np.tile(value, len(dampers)) for key, value in self.places.items()}
        repeated = np.repeat(dampers, len(self.places["mass_kg"]))
        return JointLoops(self.engine, places, JointGains(kp, repeated, difference))

    def damped(self, kp: float, dampers: FloatArray, ratio: float, *, difference: bool) -> BoolArray:
        """Return with which of some kd every loop so far is stable, and every free joint as damped as that."""
        loops = self._with_dampers(kp, dampers, difference=difference)
        is_damped = ~loops.free | ((loops.damping_ratios >= ratio) & (loops.alternation < LARGEST_ALTERNATION))
        is_sound = (loops.radius < 1 - RADIUS_TOLERANCE) & is_damped
        return np.asarray(is_sound.reshape(len(dampers), -1).all(axis=1))

    def withstand(self, kp: float, dampers: FloatArray, disk: float, *, difference: bool) -> BoolArray:
        """Return with which of some kd every loop so far is stable with each factor on the circle of a disk."""
        loops = self._with_dampers(kp, dampers, difference=difference)
        return np.asarray((_radius_on_circle(loops, disk) < 1).reshape(len(dampers), -1).all(axis=1))


def _radius_on_circle(loops: JointLoops, disk: float, phases: ComplexArray = _PHASES) -> FloatArray:
    """Return the largest spectral radius of each loop with factors f = (1 + d e/2)/(1 - d e/2) on its force, (m,).

    d is the disk margin and e a phase: f runs over the circle of the disk that the force may be wrong by.
    """
    turned = 0.5 * disk * phases
    factors = np.tile((1 + turned) / (1 - turned), len(loops.places["mass_kg"]))
    places = {key: np.repeat(value, len(phases)) for key, value in loops.places.items()}
    gains = loops.gains
    if np.ndim(gains.kd):
        gains = replace(gains, kd=np.repeat(gains.kd, len(phases)))
    relative = JointLoops(loops.engine, places, gains, factors).closed.relative
    return np.asarray(np.abs(np.linalg.eigvals(relative)).max(axis=-1).reshape(-1, len(phases)).max(axis=-1))


def _changed(places: Places, changes: Mapping[str, float]) -> Places:
    return {**places, **{key: np.full_like(places[key], value) for key, value in changes.items()}}
