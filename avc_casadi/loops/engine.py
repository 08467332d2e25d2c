"""Device and virtual tool of a physics engine: the loop over whole steps, with hands, tools and clocks."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property, reduce

import numpy as np

from avc_casadi._util.arrays import FloatArray, Interval
from avc_casadi.loops.contacts import Swing
from avc_casadi.loops.loop import Body, Loop, Map, Rows, period, response, turn_of
from avc_casadi.loops.loop_family import TOLERANCE, LoopFamily, Pattern, SearchRegion
from avc_casadi.loops.plant_family import PlantFamily, hand_at, held_plant
from avc_casadi.loops.search import Box, Ranges
from avc_casadi.loops.spectrum import ClosedLoops
from avc_casadi.model.corners import LINEAR_KEYS, device_ranges, linear_values
from avc_casadi.model.device import Device
from avc_casadi.model.ends import (
    RIGID_N_PER_M,
    Clock,
    Simulation,
    ToolGains,
    ToolState,
    tool_at,
    tool_states,
    tool_step,
    whole_samples,
)
from avc_casadi.model.hands import Hand, joined, with_stops
from avc_casadi.model.plant import sampled_plant
from avc_casadi.model.problem import Problem

# Patterns lie closer than the step over this number.
_FRACTIONS = 32
# Instants that are this share of a sample apart are the same.
_SAME_INSTANT = 1e-6
# Steps after which a pattern recurs at the latest.
_MOST_STEPS = 60
# Steps that resolve a beat lie N^2 over this number apart, in samples: 0.002 at two samples, where a study found a beat
# 0.009 wide. A wide range has no more of them than the second number.
_BEATS = 2048
_MOST_BEATS = 256
# The softest spring that is tried whatever the gains, of the stiffest; the stiffest one that is not rigid.
_SOFTEST_SHARE = 1e-3
_STIFFEST_SPRING_N_PER_M = 0.999 * RIGID_N_PER_M


@dataclass(frozen=True)
class StepTiming:
    """Timing of an engine's steps in samples of the device, until the pattern recurs."""

    samples: tuple[int, ...]
    late: tuple[bool, ...]
    step_s: float

    @property
    def on_samples(self) -> bool:
        """Whether each step of the engine falls on a sample, evenly spaced."""
        return len(self.samples) == 1 and not self.late[0]


def clocks(step_s: float, sample_time_s: float, clock: Clock = "own") -> list[StepTiming]:
    """Return the patterns of an engine's steps, one for each distinct phase of its clock.

    No clock of its own keeps a phase: one that is off by 50 ppm passes all of them every 20 s at 1 kHz. So each is
    judged, of steps of whole samples too. Steps that the loop of the device starts begin at a sample.
    """
    if clock == "device":
        return [StepTiming((whole_samples(step_s, sample_time_s),), (False,), step_s)]
    period = Fraction(step_s / sample_time_s).limit_denominator(_MOST_STEPS)
    # Phases within 1/period of each other give the same pattern; either one step falls on a sample or none does.
    return [_clock(period, phase, step_s) for phase in (Fraction(0), Fraction(1, 2 * period.denominator))]


def clock_ranges(
    step_s: Interval, sample_time_s: float, clock: Clock = "own", *, beats: bool = False
) -> list[tuple[StepTiming, Interval]]:
    """Return the patterns of every steady step in a range, each with the steps that it stands for.

    A step of N samples that begins at a sample is of one kind, the only one of steps that the device's loop starts.
    Every other step is of the other: where it is p/q samples long, its pattern recurs after q steps, in two phases;
    where it is not rational, its samples are those of its two neighbours p/q in turn (a Sturmian word). Steps take the
    pattern of the nearest p/q, closer than a thirty-second of the step; beyond 32 samples some whole N stand for all.

    Steps of N + f samples beat with the samples, f turns a step, and feed a mode that turns by pi f in a step: in a
    range of steps no wider than a hundredth of a sample, as weakly as 1/N. With a hand of a range, or a device of one,
    each f is that of some mode. Where a loop has one mode alone, `beats` resolves that range.
    """
    shortest = step_s[0] / sample_time_s
    longest = step_s[1] / sample_time_s
    if longest - shortest < _SAME_INSTANT:
        return [(timing, step_s) for timing in clocks(step_s[0], sample_time_s, clock)]
    lengths = _step_lengths(shortest, longest, beats=beats)
    patterns: list[tuple[StepTiming, Interval]] = []
    for length in lengths:
        if length.denominator == 1 and shortest - _SAME_INSTANT <= length <= longest + _SAME_INSTANT:
            whole_s = float(length) * sample_time_s
            patterns.append((StepTiming((int(length),), (False,), whole_s), (whole_s, whole_s)))
    if clock == "device":
        return patterns
    ends = [-math.inf, *(float(length + after) / 2 for length, after in itertools.pairwise(lengths)), math.inf]
    for length, (before, after) in zip(lengths, itertools.pairwise(ends), strict=True):
        low = max(before, shortest)
        high = min(after, longest)
        if low < high:
            steps_s = (low * sample_time_s, high * sample_time_s)
            phases = (Fraction(0), Fraction(1, 2 * length.denominator))
            patterns += [(_clock(length, phase, steps_s[0]), steps_s) for phase in phases]
    return patterns


def _step_lengths(shortest: float, longest: float, *, beats: bool) -> list[Fraction]:
    """Return the lengths of an engine's step, in samples of the device, whose patterns stand for all, increasing.

    With `beats` lengths that are almost whole join, in which the phase of step and sample drifts slowly.
    """
    number = max(math.floor(shortest), 1)
    most = math.ceil(longest)
    lengths = {Fraction(most)}
    while number < most:
        finest = min(max(math.ceil(_FRACTIONS / number), 2), 8) if number < _FRACTIONS else 1
        lengths |= {number + Fraction(part, q) for q in range(1, finest + 1) for part in range(q)}
        number += max(number // _FRACTIONS, 1)
    if beats:
        # Evenly in 1/N, so that the distance grows as N^2.
        count = math.ceil(min(_BEATS * (1 / shortest - 1 / longest), _MOST_BEATS))
        even = 1 / np.linspace(1 / longest, 1 / shortest, count + 1)
        lengths |= {Fraction(length).limit_denominator(_MOST_STEPS) for length in even.tolist()}
    return sorted(lengths)


def _clock(period: Fraction, phase: Fraction, step_s: float) -> StepTiming:
    """Return when an engine steps among the samples of the device: every `period` samples, the first at `phase`."""
    times = [step * period + phase for step in range(period.denominator + 1)]
    # A step at a sample precedes the force of that sample; one between two samples takes effect at the later one.
    first = [math.ceil(time) for time in times]
    return StepTiming(
        tuple(after - before for before, after in itertools.pairwise(first)),
        tuple(time.denominator != 1 for time in times[:-1]),
        step_s,
    )


@dataclass(frozen=True)
class ToolCase:
    """One loop: hand, device, tool with its contact, engine step."""

    hand: dict[str, float]
    device: dict[str, float]
    tool: ToolState
    step_s: float


@dataclass(frozen=True)
class EngineLoop:
    """Device, engine and tools as events of one loop."""

    body: Body
    clock: StepTiming
    engine: Simulation
    tools: Sequence[ToolState]
    # Step of each tool, where they differ in a pattern of samples that they share.
    steps_s: FloatArray | None = None

    @cached_property
    def loop(self) -> Loop:
        """The blocks of the state."""
        return Loop(plant=self.body.size, positions=2, tool=2, queue=self._wide * (1 + self.engine.queued))

    def closed(self, gains: ToolGains) -> ClosedLoops:
        """Return the closed loops over one period of device and engine, shape (tools, ...), () of each tool and body.

        A period is the product of the maps of its events: samples of the device, and steps of the engine.
        """
        sample = self.sample(gains)
        steps = {late: self.step(gains, late=late) for late in set(self.clock.late)}
        order = list(zip(self.clock.samples, self.clock.late, strict=True))
        events = {
            (count, late): np.linalg.matrix_power(sample, count) @ steps[late] for count, late in dict.fromkeys(order)
        }
        # A body that rests one metre on: its position, and no speed.
        stands = np.array([1.0, 0.0])
        queue = np.tile(stands, 1 + self.engine.queued) if self._wide == 2 else 0.0
        device = {"plant": self.body.shift, "positions": 1.0}
        tool = {"tool": stands, "queue": queue}
        return ClosedLoops(period([events[event] for event in order]), self.loop.rests(device, tool))

    def force_per_metre(self, gains: ToolGains, frequency_hz: float) -> complex:
        """Return the force that the loop commands per metre of oscillation of a driven device, N/m, complex.

        The device moves as a sine of `frequency_hz`; forces at the samples of a period are averaged at that frequency.
        """
        turn = turn_of(frequency_hz, self.body.sample_time_s)
        driven = replace(self, body=Body.motion_source(self.body.sample_time_s, turn))
        sample = driven.sample(gains)
        force = driven.force(gains)
        events: list[Map] = []
        reads: list[Rows | None] = []
        for count, late in zip(self.clock.samples, self.clock.late, strict=True):
            events += [driven.step(gains, late=late)[0], *(count * [sample])]
            reads += [None, *(count * [force])]
        return response(events, reads, turn)

    def alone(self) -> FloatArray:
        """Return the maps of the tools over a step without any coupling, shape (tools, 2, 2)."""
        tool = self.loop.at["tool"]
        step = self.step(ToolGains(0.0, 0.0), late=False)
        return np.asarray(step.reshape(-1, *step.shape[-2:])[:, tool, tool])

    @cached_property
    def _of_tools(self) -> _Tools:
        """The mass, drag and contact of each tool, along the first axis; a fixed tool is marked as not free."""
        axes = (len(self.tools), *(1,) * max(self.body.a.ndim - 2, 1))

        def column(value: Callable[[ToolState], float], fixed: float = 0.0) -> FloatArray:
            return np.reshape([fixed if tool.fixed else value(tool) for tool in self.tools], axes)

        return _Tools(
            free=column(lambda _: 1.0),
            mass_kg=column(lambda tool: tool.mass_kg, fixed=1.0),
            drag_ns_per_m=column(lambda tool: tool.damping_ns_per_m + tool.contact_damping_ns_per_m),
            contact_n_per_m=column(lambda tool: tool.contact_stiffness_n_per_m),
        )

    @property
    def _wide(self) -> int:
        return 1 if self.engine.exchange == "held-force" else 2

    def reading(self, *, late: bool) -> tuple[Rows, Rows]:
        """Return rows of position and velocity of the device at its newest sample, or the one before."""
        last, older = self.loop["positions"]
        if late:
            return last, (last - older) / self.body.sample_time_s
        now = self.body.output_row @ self.loop["plant"]
        return now, (now - last) / self.body.sample_time_s

    def force(self, gains: ToolGains) -> Rows:
        """Return the commanded force as a row over the states: K (x - y) + B (v - w) + b v, positive against +x.

        x and v are position and velocity of the device, y and w those of the tool that came last, b the damper of the
        device's own loop. Where the engine sends the force of K and B instead, that is taken.
        """
        x, v = self.reading(late=False)
        oldest = self.loop["queue"][-self._wide :]
        if self._wide == 1:
            pull = oldest[0]
        else:
            pull = gains.stiffness_n_per_m * (x - oldest[0]) + gains.damping_ns_per_m * (v - oldest[1])
        return np.asarray(pull + gains.local_damping_ns_per_m * v)

    def sample(self, gains: ToolGains) -> Map:
        """Return the maps of one sample of the device."""
        loop = self.loop
        positions = np.stack([self.body.output_row @ loop["plant"], loop["positions"][0]])
        plant = self.body.next_state(loop["plant"], gains.motors[0] * self.force(gains))
        return loop.event(plant=plant, positions=positions)

    def step(self, gains: ToolGains, *, late: bool) -> Map:
        """Return the maps of one step of the engine over the states, shape (tools, ..., size, size).

        In each substep the tool moves by the spring K and damper B to the device, its own damper and its contact,
        integrated as the engine does; then the new state of the tool, or the force on it, is sent. A step that is
        `late` reads the sample before the device's newest one.
        """
        loop = self.loop
        x, v = self.reading(late=late)
        place, speed = loop["tool"]
        tools = self._of_tools
        mass = tools.mass_kg
        k = gains.stiffness_n_per_m
        b = gains.damping_ns_per_m
        step_s = self.clock.step_s if self.steps_s is None else self.steps_s.reshape(mass.shape)
        t = np.asarray(step_s) / self.engine.substeps
        implicit_k, implicit_b = self.engine.implicit_part(k, b)
        push = k * x + b * v - (k - implicit_k) * place - (b - implicit_b) * speed
        drag = tools.drag_ns_per_m + implicit_b
        stiffness = tools.contact_n_per_m + implicit_k
        # So many halvings of a substep make it short beside the tool's fastest mode.
        doublings = 10 + int(np.log2(1 + np.max(t * (drag + np.sqrt(stiffness * mass)) / mass)))
        to_place, to_speed = tool_step(self.engine.integrator, t, mass, drag, stiffness, doublings)
        new_place = place
        new_speed = speed
        for _ in range(self.engine.substeps):
            new_place, new_speed = (
                by_place * new_place + by_speed * new_speed + by_force * push
                for by_place, by_speed, by_force in (to_place, to_speed)
            )
        tool = np.stack([tools.free * new_place, tools.free * new_speed], axis=-2)
        if self._wide == 1:
            sent = (k * (x - tools.free * place) + b * (v - tools.free * speed))[..., None, :]
        else:
            sent = tool if self.engine.exchange == "ahead" else tools.free[..., None] * loop["tool"]
        return loop.event(tool=tool, queue=loop.queue("queue", sent))


@dataclass(frozen=True)
class _Tools:
    """Tools of an engine along one axis: 1 where they are free to move, mass, all their damping, their contacts."""

    free: FloatArray
    mass_kg: FloatArray
    drag_ns_per_m: FloatArray
    contact_n_per_m: FloatArray


class ToolLoops(LoopFamily):
    """All loops of a problem with [simulation]: hands, end stop, released, devices, tools, contacts and clocks."""

    def __init__(self, problem: Problem, more_hands: Sequence[Hand] = ()) -> None:
        """Build the loops at all corners: devices, hands and released, tools, contacts, patterns of step and sample.

        Points that a search finds worse than these join them.
        """
        tool = problem.end_as(Simulation)
        self.tool = tool
        family = PlantFamily.of(problem)
        self.hands = with_stops(reduce(joined, more_hands, family.corner_hands), problem.device.mass_kg)
        self._devices = family.devices
        contacts_n_per_m = contact_stiffnesses_n_per_m(tool)
        self.tools = list(dict.fromkeys(state for contact in contacts_n_per_m for state in tool_states(tool, contact)))
        body = Body.of(sampled_plant(self._devices, self.hands)).axes(None)
        sample_time_s = problem.device.sample_time_s

        def at_corners(clock: StepTiming) -> Pattern:
            engine = EngineLoop(body, clock, tool, self.tools)
            return _pattern(engine, lambda row: self._case(row, clock.step_s))

        corners = [
            at_corners(timing)
            for step_s in sorted(set(tool.step_s))
            for timing in clocks(step_s, sample_time_s, tool.clock)
        ]
        plants = Plants(problem.device)
        regions = [
            _region(problem, plants, clocked, contacts, side.box)
            for side in family.sides
            for clocked in clock_ranges(tool.step_s, sample_time_s, tool.clock, beats=not side.varies)
            for contacts in contact_knots_n_per_m(tool)
        ]
        super().__init__(corners, regions)

    @property
    def worst_hands(self) -> tuple[Hand, ...]:
        """The worst hands inside the ranges that searches found."""
        return tuple(Hand(**pattern.case(0).hand) for pattern in self.patterns[self.corners :])

    def __len__(self) -> int:
        at_corners = self.corners * len(self.tools) * len(self._devices) * len(self.hands)
        return at_corners + len(self.patterns) - self.corners

    def engine_alone_stable(self) -> bool:
        """Return whether the tool in contact is stable without any coupling, which the engine alone decides."""
        touching = [tool for tool in self.tools if not tool.fixed and tool.contact_stiffness_n_per_m > 0]
        if not touching:
            return True
        body = Body.motion_source(self._devices[0].sample_time_s, 1.0)
        of_clocks = (clock for step_s in set(self.tool.step_s) for clock in clocks(step_s, body.sample_time_s))
        alone = (np.linalg.eigvals(EngineLoop(body, clock, self.tool, touching).alone()) for clock in of_clocks)
        return all(np.abs(values).max() <= 1 + TOLERANCE for values in alone)

    def _case(self, row: int, step_s: float) -> ToolCase:
        shape = (len(self.tools), len(self._devices), len(self.hands))
        tool, device, hand = (int(index) for index in np.unravel_index(row, shape))
        return ToolCase(self.hands.values(hand), linear_values(self._devices[device]), self.tools[tool], step_s)


def _pattern(engine: EngineLoop, case: Callable[[int], ToolCase]) -> Pattern:
    samples = engine.clock.samples
    return Pattern(engine.closed, sum(samples) * engine.body.sample_time_s, len(samples), case)


def _region(
    problem: Problem, plants: Plants, clocked: tuple[StepTiming, Interval], contacts: FloatArray, of_plant: Ranges
) -> SearchRegion:
    """Return the ranges that are searched with one pattern of step and sample and one kind of contact.

    `clocked` are the pattern and the range of the step, s; `contacts` the knots of the contact's stiffness, N/m;
    `of_plant` the ranges of device and hand. The tool of a fixed end has no ranges.
    """
    tool = problem.end_as(Simulation)
    clock, step_s = clocked
    contact = (float(contacts[0]), float(contacts[-1]))
    fixed = contact[0] >= RIGID_N_PER_M
    mass = tool.tool_mass_kg or (math.inf, math.inf)
    of_tool = {
        "tool.mass_kg": (mass[0], mass[0]) if fixed else mass,
        "tool.damping_ns_per_m": (0.0, 0.0) if fixed else tool.tool_damping_ns_per_m,
        "contact.stiffness_n_per_m": contact,
    }
    if 0 < contact[0] < RIGID_N_PER_M and tool.contact_damping_ns_per_m is not None:
        of_tool["contact.damping_ns_per_m"] = tool.contact_damping_ns_per_m

    def pattern(values: dict[str, FloatArray]) -> Pattern:
        devices, body = plants.held(values)
        tools = [tool_at(tool, *row) for row in np.array([values[key] for key in of_tool]).T.tolist()]
        steps_s = values["step_s"]
        engine = EngineLoop(body, clock, tool, tools, steps_s)

        def case(row: int) -> ToolCase:
            return ToolCase(hand_at(values, row), linear_values(devices[row]), tools[row], float(steps_s[row]))

        return _pattern(engine, case)

    # The step of a tool that is fixed changes nothing but the pattern.
    of_step = {"step_s": (step_s[0], step_s[0]) if fixed else step_s}
    ranges = {**of_plant, **of_tool, **of_step}
    knots = {"contact.stiffness_n_per_m": contacts} if len(contacts) > 1 else {}
    return SearchRegion(Box(ranges, knots), pattern, (contact, clock.on_samples, *of_plant.values()))


class Plants:
    """Devices in their hands as bodies of a loop; those of the last places are kept, which many clocks share."""

    _kept = 8

    def __init__(self, device: Device) -> None:
        self._device = device
        self._last: dict[bytes, tuple[list[Device], Body]] = {}

    def held(self, values: Mapping[str, FloatArray]) -> tuple[list[Device], Body]:
        """Return m devices and bodies, each in its own hand, from values as of `Box.values`."""
        names = [name for name in values if name.startswith("hand.")] + list(device_ranges(self._device, LINEAR_KEYS))
        key = np.array([values[name] for name in names]).tobytes()
        if key not in self._last:
            devices, plant = held_plant(self._device, values)
            while len(self._last) >= self._kept:
                del self._last[next(iter(self._last))]
            self._last[key] = devices, Body.of(plant).flat()
        return self._last[key]


def contact_stiffnesses_n_per_m(tool: Simulation) -> list[float]:
    """Return stiffnesses of the contacts at whose corners a tool is tried, N/m of the scene: 0, springs, rigid."""
    lowest, highest = tool.contact_stiffness_n_per_m
    if tool.constraint:
        return [0.0, RIGID_N_PER_M]
    if tool.rigid:
        return [0.0, *dict.fromkeys((lowest, _STIFFEST_SPRING_N_PER_M)), RIGID_N_PER_M]
    low = max(lowest, _SOFTEST_SHARE * highest)
    between = np.geomspace(low, highest, 4).tolist() if 0 < low < highest else [highest]
    return sorted({0.0, *between, RIGID_N_PER_M})


def contact_knots_n_per_m(tool: Simulation) -> list[FloatArray]:
    """Return the contacts that are searched, N/m of the scene: no contact, the knots of springs, and a rigid one.

    A tool without mass is fixed, which no contact moves.
    """
    if tool.tool_mass_kg is None:
        return [np.array([RIGID_N_PER_M])]
    tried = contact_stiffnesses_n_per_m(tool)
    springs = [stiffness for stiffness in tried if 0 < stiffness < RIGID_N_PER_M]
    swing = _swing(tool)
    searched = [np.zeros(1)]
    if springs:
        # No spring counts that is softer than any hand, and than a thousandth of the stiffest.
        lowest = tool.contact_stiffness_n_per_m[0]
        low = springs[0] if lowest > 0 else min(springs[0], max(swing.softest_n_per_m, lowest))
        searched.append(swing.knots_n_per_m(low, springs[-1]) if low < springs[-1] else np.array([low]))
    return [*searched, np.array([RIGID_N_PER_M])]


def _swing(tool: Simulation) -> Swing:
    """Return how the lightest tool swings on a contact in the engine's longest step, which decides where knots lie."""
    lightest, heaviest = tool.tool_mass_kg or (math.inf, math.inf)
    dampers = tool.contact_damping_ns_per_m
    exact = tool.integrator == "exact"
    # At sqrt(k/m) dt = 2, dt a substep, a semi-implicit step turns by half a turn; beyond that it grows. An implicit
    # step damps, and its loop no longer depends on the stiffness there. An exact one turns on and on.
    last_rad = math.inf if exact else 2.0 * tool.substeps
    return Swing(
        mass_kg=lightest,
        period_s=max(tool.step_s),
        late_samples=1.0 + tool.queued,
        damping_ratio=1.0 if dampers is None else 0.0,
        decay_per_s=0.0 if dampers is None else (tool.tool_damping_ns_per_m[0] + dampers[0]) / (2 * heaviest),
        last_rad=last_rad,
    )
