"""Two devices coupled over a link with delay: the loop of a teleoperator, with hands, environments and both clocks."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from itertools import product
from typing import Any, Self

import numpy as np

from avc_casadi._util.arrays import FloatArray, Interval
from avc_casadi.loops.contacts import Swing
from avc_casadi.loops.loop import Body, Loop, Map, Rows, period, response, turn_of
from avc_casadi.loops.loop_family import LoopFamily, Pattern, SearchRegion, clock_ratio
from avc_casadi.loops.plant_family import PlantFamily, hand_at, held_plant
from avc_casadi.loops.search import Box, Ranges
from avc_casadi.loops.spectrum import ClosedLoops
from avc_casadi.model.corners import LINEAR_KEYS, device_corners, device_ranges, linear_values
from avc_casadi.model.device import Device
from avc_casadi.model.ends import Follower, ToolGains
from avc_casadi.model.hands import Hand, with_stops
from avc_casadi.model.plant import SampledPlant, sampled_plant
from avc_casadi.model.problem import Problem

CONTACT_DAMPING_RATIO = 0.1
"""Damping ratio of the follower's mass on a contact for which no damper is declared."""

_STIFFNESS = "contact.stiffness_n_per_m"
# Share of m/T^2 that the softest spring has which is tried whatever the gains.
_SOFTEST_OF_UNIT = 1e-5
_SAME_INSTANT = 1e-6
"""Instants that are this share of a sample apart are the same."""


@dataclass(frozen=True)
class LinkClock:
    """Samples of both devices until their pattern recurs, and the age of the data received."""

    events: tuple[tuple[bool, bool], ...]
    leader_sees: tuple[int, ...]
    follower_sees: tuple[int, ...]


def link_clocks(leader_s: float, follower_s: float, forth_s: float, back_s: float) -> list[LinkClock]:
    """Return the distinct patterns of samples and messages of leader and follower, over all phases of their clocks.

    Sample times and delays there and back are in s. The pattern changes where a message arrives at a sample.
    """
    ratio = clock_ratio(follower_s / leader_s)
    forth = forth_s / leader_s
    back = back_s / leader_s
    # Phases recur after one over the denominator; the pattern changes where a message arrives at a sample.
    recurs = Fraction(1, ratio.denominator)
    turns = sorted({Fraction(0), *(Fraction(late).limit_denominator(10**6) % recurs for late in (forth, -back))})
    between = [(before + after) / 2 for before, after in itertools.pairwise([*turns, recurs])]
    return list(dict.fromkeys(_clock(ratio, phase, forth, back) for phase in sorted({*turns, *between})))


def _clock(ratio: Fraction, phase: Fraction, forth: float, back: float) -> LinkClock:
    """Return one pattern; times are counted in samples of the leader, `ratio` being a sample of the follower."""
    leader = [Fraction(k) for k in range(ratio.numerator)]
    follower = [k * ratio + phase for k in range(ratio.denominator)]
    times = sorted({*leader, *follower})
    return LinkClock(
        tuple((time in leader, time in follower) for time in times),
        tuple(_age(float(time - phase) / float(ratio), back / float(ratio)) for time in leader),
        tuple(_age(float(time), forth) for time in follower),
    )


def _age(samples_since_first: float, delay_samples: float) -> int:
    """Return how many samples of the sender lie between its newest one at a time and the one that has arrived."""
    return math.floor(samples_since_first + 1e-9) - math.floor(samples_since_first - delay_samples + 1e-9)


@dataclass(frozen=True)
class RoundTrip:
    """The clocks of one distinct loop over a link, and delays there and back, in s, that make it."""

    clock: LinkClock
    delays_s: tuple[float, float]


def round_trips(
    leader_s: float, follower_s: float, forth_s: Interval, back_s: Interval, *, sends_force: bool = False
) -> list[RoundTrip]:
    """Return each distinct loop of two clocks and of delays in two ranges, of every phase; the shortest delay first.

    A sample of the leader is the unit, p/q one of the follower. The leader's data has an age that changes where the
    delay there less the phase crosses a multiple of 1/q, the follower's where the delay back and the phase do. With a
    and b for both, rounded up, another phase of the clocks moves samples from one to the other, which renumbers the
    follower's samples and is the same loop. So a + b decides, from ceil(q R) to ceil(q R) + 1 of the round trip R.
    """
    ratio = clock_ratio(follower_s / leader_s)
    q = ratio.denominator
    shortest = (forth_s[0] + back_s[0]) / leader_s
    longest = (forth_s[1] + back_s[1]) / leader_s
    fewest = math.ceil(q * shortest - _SAME_INSTANT)
    most = math.ceil(q * longest - _SAME_INSTANT)
    if sends_force and back_s[0] == 0:
        # A force is sent after the sample that it is of, so that one of the same instant is never known.
        fewest = math.floor(q * shortest + _SAME_INSTANT) + 1
    loops = {}
    for count in range(fewest, most + 2):
        # Both clocks in step and no delay: each sees the other's sample of the same instant. Otherwise out of step,
        # all of the delay on the way there: the queue of the leader's positions is the shortest state.
        out_of_step = Fraction(1, 2 * q) if count else Fraction(0)
        share = min(max((count - 1) / q - shortest, 0.0) / max(longest - shortest, _SAME_INSTANT), 1.0)
        forth_and_back_s = (
            forth_s[0] + share * (forth_s[1] - forth_s[0]),
            back_s[0] + share * (back_s[1] - back_s[0]),
        )
        loops[_clock(ratio, out_of_step, max(count - 1, 0) / q, 0.0)] = forth_and_back_s
    return [RoundTrip(clock, delays_s) for clock, delays_s in loops.items()]


@dataclass(frozen=True)
class BilateralCase:
    """One loop: the hand on the leader, the environment of the follower, the delays of the link."""

    hand: dict[str, float]
    environment_n_per_m: float
    leader: dict[str, float]
    follower: dict[str, float]
    delays_s: tuple[float, float]


@dataclass(frozen=True)
class Touch:
    """Environments of a follower, in the leader's units; the arrays have the leading axes of its body."""

    body: Body
    fixed: FloatArray
    force: Rows

    @classmethod
    def of(cls, follower: SampledPlant, stiffness_n_per_m: FloatArray, damping_ns_per_m: FloatArray) -> Self:
        """Return environments, one axis: one device in each, or one for each."""
        body = Body.of(follower).flat()
        fixed = np.isinf(stiffness_n_per_m)
        end = "handle" if "handle_position_m" in body.names else "device"
        spring = np.where(fixed, 0.0, stiffness_n_per_m)[:, None] * body.row(f"{end}_position_m")
        damper = damping_ns_per_m[:, None] * body.row(f"{end}_velocity_m_per_s")
        return cls(body, fixed.astype(np.float64), spring + damper)

    def axes(self, *index: Any) -> Self:
        """Return some environments, or other axes."""
        return type(self)(self.body.axes(*index), self.fixed[index], self.force[index])


@dataclass(frozen=True)
class Link:
    """Leader and follower as events of one loop."""

    leader: Body
    touch: Touch
    clock: LinkClock
    follower: Follower

    @cached_property
    def loop(self) -> Loop:
        """The blocks of the state; two positions more than the oldest one used are kept, for its velocity."""
        leader_sees = max(self.clock.leader_sees)
        follower_sees = max(self.clock.follower_sees)
        return Loop(
            body0=self.leader.size,
            body1=self.touch.body.size,
            sent0=follower_sees + 2,
            sent1=leader_sees + 2,
            forces=leader_sees + 1 if self._sends_force else 0,
        )

    @property
    def samples(self) -> int:
        """Number of the leader's samples until the pattern recurs."""
        return sum(event[0] for event in self.clock.events)

    def closed(self, gains: ToolGains) -> ClosedLoops:
        """Return the loops over one period."""
        leader = {"body0": self.leader.shift, "sent0": 1.0}
        follower = {"body1": self.touch.body.shift, "sent1": 1.0}
        return ClosedLoops(period([event for event, _ in self.events(gains)]), self.loop.rests(leader, follower))

    def force_per_metre(self, gains: ToolGains, frequency_hz: float) -> complex:
        """Return the force commanded by the leader's loop per metre of a driven leader's oscillation, N/m."""
        turn = turn_of(frequency_hz, self.leader.sample_time_s)
        driven = replace(self, leader=Body.motion_source(self.leader.sample_time_s, turn))
        events, reads = zip(*driven.events(gains), strict=True)
        return response(events, reads, turn)

    @property
    def _sends_force(self) -> bool:
        return self.follower.architecture == "position-force"

    def _samples(self, side: int, age: int) -> tuple[Rows, Rows]:
        """Return position and velocity that a side sent a number of its samples ago."""
        sent = self.loop[f"sent{side}"]
        sample_time_s = (self.leader, self.touch.body)[side].sample_time_s
        return sent[age], (sent[age] - sent[age + 1]) / sample_time_s

    def events(self, gains: ToolGains) -> list[tuple[Map, Rows | None]]:
        """Return the maps of a period in order, and before each the commanded force of the leader as a row, or None.

        At each event one or both sides sample: they take the positions that have arrived, command K (x - y) + B (v - w)
        + b v, and send their own. The force is None where the leader does not sample.
        """
        maps: list[tuple[Map, Rows | None]] = []
        leader_samples = 0
        follower_samples = 0
        for leads, follows in self.clock.events:
            sides = [side for side, samples in enumerate((leads, follows)) if samples]
            maps.append((self._sampled(sides), None))
            leader_age = self.clock.leader_sees[leader_samples % len(self.clock.leader_sees)]
            follower_age = self.clock.follower_sees[follower_samples % len(self.clock.follower_sees)]
            pulls = self._pulls(gains, leader_age, follower_age, in_step=leads and follows)
            forces = [
                pull + gains.local_damping_ns_per_m * self._samples(side, 0)[1] for side, pull in enumerate(pulls)
            ]
            moved = {f"body{side}": self._moved(side, gains.motors[side] * forces[side]) for side in sides}
            if follows and self._sends_force:
                moved["forces"] = self.loop.queue("forces", self._force_to_leader(pulls[1]))
            maps.append((self.loop.event(**moved), forces[0] if leads else None))
            leader_samples += leads
            follower_samples += follows
        return maps

    def _sampled(self, sides: Sequence[int]) -> Map:
        """Return the map by which some sides sample their positions and send them."""
        loop = self.loop
        sent = {}
        for side in sides:
            position = (self.leader, self.touch.body)[side].output_row @ loop[f"body{side}"]
            sent[f"sent{side}"] = loop.queue(f"sent{side}", position[None])
        return loop.event(**sent)

    def _pulls(self, gains: ToolGains, leader_age: int, follower_age: int, *, in_step: bool) -> list[Rows]:
        """Return the force of K and B on leader and follower as rows, each from what it knows of the other side.

        Positive is against +x. `leader_age` and `follower_age` count by how many samples of the other side what it
        knows is old; `in_step` says whether both sample at this instant. With position-force the leader gets the
        follower's own force.
        """
        k = gains.stiffness_n_per_m
        b = gains.damping_ns_per_m
        x, v = self._samples(0, 0)
        y, w = self._samples(1, 0)
        known_y, known_w = self._samples(1, leader_age)
        known_x, known_v = self._samples(0, follower_age)
        on_follower = k * (y - known_x) + b * (w - known_v)
        if not self._sends_force:
            return [k * (x - known_y) + b * (v - known_w), on_follower]
        # A force is sent after the sample that it is of: that of a sample of this instant is not yet in the queue.
        sent_ago = max(leader_age - in_step, 0)
        return [-self.loop["forces"][sent_ago], on_follower]

    def _moved(self, side: int, force: Rows) -> Rows:
        """Return the next state of a side's body, pushed by a force; a follower on a rigid contact stands still."""
        body = (self.leader, self.touch.body)[side]
        state = body.next_state(self.loop[f"body{side}"], force)
        return state if side == 0 else state * (1 - self.touch.fixed)[..., None, None]

    def _force_to_leader(self, commanded: Rows) -> Rows:
        """Return the force that the follower sends: commanded, or of its contact where that is not rigid."""
        if self.follower.force == "commanded":
            return commanded[None]
        fixed = self.touch.fixed[..., None]
        measured = -self.touch.force @ self.loop["body1"]
        return np.asarray((fixed * commanded + (1 - fixed) * measured)[..., None, :])


class FollowerLoops(LoopFamily):
    """All loops of a problem with [follower]: hands, end stop, released, environments, both devices, delays, clocks."""

    def __init__(self, problem: Problem) -> None:
        """Build the loops at all corners: hands and released, environments, both devices, delays, phases of the clocks.

        Points that a search finds worse than these join them.
        """
        follower = problem.end_as(Follower)
        self.follower = follower
        family = PlantFamily.of(problem)
        self.hands = with_stops(family.corner_hands, problem.device.mass_kg)
        stiffness, damping = environments(follower)
        self.environments_n_per_m = stiffness
        contact = Hand(np.zeros(len(stiffness)), damping, np.where(np.isinf(stiffness), 0.0, stiffness))
        corners: list[Pattern] = []
        followers = device_corners(follower.at_leader(), LINEAR_KEYS)
        trips = _round_trips(problem)
        # Of a range of delays the shortest and the longest, of both phases.
        ends = list(dict.fromkeys([*trips[:2], *trips[-2:]]))
        for leader, follower_device in product(family.devices, followers):
            body = Body.of(sampled_plant(leader, self.hands)).flat().axes(slice(None), None)
            touch = Touch.of(sampled_plant(follower_device, contact), stiffness, damping)
            for trip in ends:
                case = self._case_of(leader, follower_device, trip.delays_s)
                corners.append(_pattern(Link(body, touch, trip.clock, follower), case))
        regions = [
            _region(problem, trip, knots, side.box)
            for trip, knots, side in product(trips, _contacts_n_per_m(problem), family.sides)
        ]
        super().__init__(corners, regions, motors=2)

    def __len__(self) -> int:
        at_corners = self.corners * len(self.environments_n_per_m) * len(self.hands)
        return at_corners + len(self.patterns) - self.corners

    def _case_of(
        self, leader: Device, follower: Device, delays_s: tuple[float, float]
    ) -> Callable[[int], BilateralCase]:
        """Return the function from a row of loops, over hands and environments, to its case with these devices."""

        def case(row: int) -> BilateralCase:
            hand, environment = np.unravel_index(row, (len(self.hands), len(self.environments_n_per_m)))
            return BilateralCase(
                self.hands.values(int(hand)),
                float(self.environments_n_per_m[environment]),
                linear_values(leader),
                linear_values(follower),
                delays_s,
            )

        return case


def _pattern(pair: Link, case: Callable[[int], BilateralCase]) -> Pattern:
    return Pattern(pair.closed, pair.samples * pair.leader.sample_time_s, pair.samples, case)


def _round_trips(problem: Problem) -> list[RoundTrip]:
    """Return the distinct loops of a problem's link: clocks with delays there and back, s, over their ranges."""
    follower = problem.end_as(Follower)
    forth_s, back_s = follower.ways_s
    return round_trips(
        problem.device.sample_time_s,
        follower.sample_time_s,
        forth_s,
        back_s,
        sends_force=follower.architecture == "position-force",
    )


def _region(problem: Problem, trip: RoundTrip, contacts: FloatArray, of_leader: Ranges) -> SearchRegion:
    """Return the ranges that are searched with one pattern of clocks and delays, and one kind of contact.

    `contacts` are knots of the contact's stiffness, N/m of the follower; `of_leader` the ranges of leader and hand.
    """
    leader = problem.device
    follower = problem.end_as(Follower)
    follower_device = follower.at_leader()
    contact = (float(contacts[0]), float(contacts[-1]))
    of_follower = {f"follower.{key}": ends for key, ends in device_ranges(follower_device, LINEAR_KEYS).items()}
    of_contact = {_STIFFNESS: contact}
    if contact[0] > 0 and contact[1] < math.inf and follower.contact_damping_ns_per_m is not None:
        of_contact["contact.damping_ns_per_m"] = follower.contact_damping_ns_per_m

    def pattern(values: dict[str, FloatArray]) -> Pattern:
        springs = values[_STIFFNESS]
        dampers = values.get("contact.damping_ns_per_m")
        if dampers is None:
            dampers = np.array([_damper_ns_per_m(follower, spring) for spring in springs])
        stiffness = follower.scale * springs
        damping = follower.scale * dampers
        in_contact = {
            "hand.mass_kg": np.zeros(len(springs)),
            "hand.damping_ns_per_m": damping,
            "hand.stiffness_n_per_m": np.where(np.isinf(stiffness), 0.0, stiffness),
        }
        inner = {key.removeprefix("follower."): value for key, value in values.items() if key.startswith("follower.")}
        leaders, held = held_plant(leader, values)
        followers, touching = held_plant(follower_device, {**inner, **in_contact})
        pair = Link(Body.of(held).flat(), Touch.of(touching, stiffness, damping), trip.clock, follower)

        def case(row: int) -> BilateralCase:
            ends = (linear_values(leaders[row]), linear_values(followers[row]))
            return BilateralCase(hand_at(values, row), float(stiffness[row]), *ends, trip.delays_s)

        return _pattern(pair, case)

    ranges = {**of_leader, **of_follower, **of_contact}
    return SearchRegion(
        Box(ranges, {_STIFFNESS: contacts} if len(contacts) > 1 else {}), pattern, (contact, *of_leader.values())
    )


def environments(follower: Follower) -> tuple[FloatArray, FloatArray]:
    """Return stiffness and damping of the follower's environments: free, four springs at most, rigid (infinite).

    They are in the leader's units, N/m and N.s/m.
    """
    low, top = _corner_springs_n_per_m(follower)
    springs = [top] if top > 0 else []
    if low < top:
        springs = np.geomspace(low, top, 4).tolist()
    pairs = [(0.0, 0.0)]
    pairs += [(spring, damper) for spring in springs for damper in contact_dampers_ns_per_m(follower, spring)]
    pairs += [(math.inf, 0.0)] if follower.rigid else []
    stiffness, damping = (follower.scale * np.array(column) for column in zip(*pairs, strict=True))
    return stiffness, damping


def contact_dampers_ns_per_m(follower: Follower, stiffness_n_per_m: float) -> list[float]:
    """Return the dampers in parallel with a contact spring, in the follower's units."""
    if follower.contact_damping_ns_per_m is not None:
        return sorted(set(follower.contact_damping_ns_per_m))
    return [2 * CONTACT_DAMPING_RATIO * math.sqrt(stiffness_n_per_m * follower.mass_kg)]


def _damper_ns_per_m(follower: Follower, stiffness_n_per_m: float) -> float:
    """Return the least damper of a contact spring; 0 of a free or a rigid end."""
    if 0 < stiffness_n_per_m < math.inf:
        return contact_dampers_ns_per_m(follower, stiffness_n_per_m)[0]
    return 0.0


def _contacts_n_per_m(problem: Problem) -> list[FloatArray]:
    """Return the environments that are searched, N/m of the follower: free, the knots of springs, and rigid."""
    follower = problem.end_as(Follower)
    lowest, highest = follower.contact_stiffness_n_per_m
    swing = _swing(problem)
    low = max(lowest, min(swing.softest_n_per_m, _corner_springs_n_per_m(follower)[0]))
    searched = [np.zeros(1)]
    if highest > low:
        searched.append(swing.knots_n_per_m(low, highest))
    elif highest > 0:
        searched.append(np.array([highest]))
    return [*searched, np.array([math.inf])] if follower.rigid else searched


def _swing(problem: Problem) -> Swing:
    """Return how the lightest follower swings on a contact between its samples, which decides where knots lie.

    The time by which forces come late is that of both ways and of both devices' delays.
    """
    leader = problem.device
    follower = problem.end_as(Follower)
    known = follower.range
    period_s = follower.sample_time_s
    dampers = follower.contact_damping_ns_per_m
    mass = (known.mass_kg or (follower.mass_kg, follower.mass_kg))[0]
    if follower.resonance is not None:
        # The contact is at the handle.
        mass *= (known.resonance.mass_ratio or (follower.resonance.mass_ratio,))[0]
    heaviest = (known.mass_kg or (follower.mass_kg,))[-1]
    drag = (known.damping_ns_per_m or (follower.damping_ns_per_m,))[0] * (follower.resonance is None)
    late_s = sum(longest for _, longest in follower.ways_s) + _latest(leader) * leader.sample_time_s
    return Swing(
        mass,
        period_s,
        late_s / period_s + _latest(follower),
        damping_ratio=CONTACT_DAMPING_RATIO if dampers is None else 0.0,
        decay_per_s=0.0 if dampers is None else (drag + dampers[0]) / (2 * heaviest),
        looks=clock_ratio(period_s / leader.sample_time_s).denominator,
    )


def _latest(device: Device) -> float:
    """Return the longest delay of a device, in its samples."""
    return max(device.range.delay_samples or (device.delay_samples,))


def _corner_springs_n_per_m(follower: Follower) -> tuple[float, float]:
    """Return the softest and the stiffest spring of the declared range that are tried whatever the gains."""
    lowest, highest = follower.contact_stiffness_n_per_m
    unit = follower.mass_kg / follower.sample_time_s**2
    low = max(lowest, _SOFTEST_OF_UNIT * unit)
    return low, max(low, unit) if follower.rigid else highest
