"""Hands that guide the handle of an admittance device, hold it, release it and push it against a contact.

A hand aims ahead of the way that it has in mind, by what moves the ideal law along it:

    b x_t' + k x_t = (M + m_s + m) p'' + (B + b) p' + (K + k) p,

p the way, x_t its target, M, B and K the law, m, b and k the hand, m_s the handle. So all hands guide alike, firm or
loose. The sensor has its noise, its steps and its range, the commanded velocity its limit, where the file states them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
from avc_casadi.loops.handle import plants_of
from avc_casadi.loops.loop import Body
from avc_casadi.loops.wall import closed
from avc_casadi.model.admittance import AdmittanceDevice, VirtualImpedance
from avc_casadi.model.hands import Hand
from avc_casadi.simulation.judge import AT_REST_M_PER_S, SETTLING_WINDOW_S
from avc_casadi.simulation.population.handle_lanes import HandleLanes, HandTarget
from avc_casadi.simulation.population.motions import LONGEST_S

GUIDE_HZ = 1.0
"""Frequency at which a hand guides to and fro, at which `recommend` counts the effort too."""
_WAY_M = 0.02
"""How far a hand guides the handle to each side, where neither speed nor force is near its limit."""
_SHARE_OF_LIMITS = 0.5
"""Share of the largest speed and of the sensor's range that guiding takes at most."""
_SWINGS = 4
"""Times that a hand guides to and fro; the first one begins softly, and the last one ends softly."""
_MOTION_S = _SWINGS / GUIDE_HZ
"""Time until all hands keep still."""
_MOVE_S = 0.5
"""Duration of a move to the contact, or away from it."""
_STRUCK_M_PER_S = 0.1
"""Speed of a handle that is struck."""
_RELEASED_S = 2.0
"""When a hand that guides or presses lets go: where it guides, at full speed."""
_THROWN = 2.0
"""Speed of a handle that a contact throws back, over that of guiding."""
_LEAST_REST_S = 1.0
"""Shortest time from the end of all motions to the end, of which the last half second is judged."""
_NOISE = 5
"""Stream of random numbers of a seed from which the sensor's noise is drawn."""


@dataclass(frozen=True)
class HandMotion:
    """What a hand does: the way that it has in mind, in units of its largest, and when it lets go.

    Attributes:
        start: the place at the beginning; the surface of a contact is at 0.
        moves: time at which each move begins, and its end.
        swings: whether it guides to and fro.
        released: whether the hand lets go.
        struck: whether the handle is struck at the beginning.
        touches: whether there is a contact.
    """

    start: float = 0.0
    moves: tuple[tuple[float, float], ...] = ()
    swings: bool = False
    released: bool = False
    struck: bool = False
    touches: bool = False

    def way(self, time_s: FloatArray) -> FloatArray:
        """Return the way at some times, s, in units of its largest: smooth moves, or sines in a smooth window."""
        place, way = self.start, np.full(time_s.shape, self.start)
        for begin_s, end in self.moves:
            way = way + (end - place) * _smooth((time_s - begin_s) / _MOVE_S)
            place = end
        if self.swings:
            window = _smooth(time_s * GUIDE_HZ) * _smooth(_SWINGS - time_s * GUIDE_HZ)
            way = way + window * np.sin(2 * math.pi * GUIDE_HZ * time_s)
        return way


_BEFORE = -0.5
"""In front of a contact, in ways of a guiding hand."""
_INTO = 0.5
"""As deep into a contact as a hand in free space would go, in ways of a guiding hand."""

MOTIONS = {
    "guide": HandMotion(swings=True),
    "hold": HandMotion(struck=True),
    "release": HandMotion(swings=True, released=True),
    "press": HandMotion(start=_BEFORE, moves=((0.0, _INTO),), touches=True),
    "tap": HandMotion(
        start=_BEFORE,
        moves=((0.0, _INTO), (0.6, _BEFORE), (1.2, _INTO), (1.8, _BEFORE), (2.4, _INTO)),
        touches=True,
    ),
    "leave": HandMotion(start=_BEFORE, moves=((0.0, _INTO),), released=True, touches=True),
}
"""Motions of hands: those with a contact apply where the file states one. `leave` presses, then lets go."""


def _smooth(share: FloatArray) -> FloatArray:
    """Return a step from 0 to 1 of least jerk, 10 s^3 - 15 s^4 + 6 s^5."""
    s = np.clip(share, 0.0, 1.0)
    return np.asarray(s**3 * (10 - 15 * s + 6 * s**2))


@dataclass(frozen=True)
class HandTask:
    """Some hands on one of the devices, which has no ranges, with the contacts of each of them."""

    place: int
    device: AdmittanceDevice
    law: VirtualImpedance
    numbers: IndexArray
    hands: Hand
    contacts: list[Hand]
    seed: int


@dataclass(frozen=True)
class _Lanes:
    """Every motion of hands on every contact: lanes run over motions, then contacts of the motion, then hands.

    Attributes:
        motions: the motion of each group of lanes; a group has one lane for each hand.
        hands: the hand of each lane.
        contacts: what the handle of each lane may touch.
    """

    motions: tuple[str, ...]
    hands: Hand
    contacts: Hand

    @classmethod
    def of(cls, task: HandTask) -> _Lanes:
        """Return the lanes of a task; motions with a contact only where there is one."""
        nothing = Hand(*np.zeros((3, len(task.hands))))
        groups = [
            (name, contact)
            for name, motion in MOTIONS.items()
            for contact in (task.contacts if motion.touches else [nothing])
        ]
        names = tuple(name for name, _ in groups)
        return cls(names, _joined([task.hands] * len(groups)), _joined([contact for _, contact in groups]))

    def have(self, *motions: str) -> BoolArray:
        """Return which lanes have one of some motions."""
        return np.repeat([name in motions for name in self.motions], len(self.hands) // len(self.motions))


def _joined(hands: Sequence[Hand]) -> Hand:
    return Hand(*(np.concatenate([getattr(hand, key) for hand in hands]) for key in vars(hands[0])))


class _Aim:
    """Where the hands of all lanes aim, sample by sample."""

    def __init__(self, task: HandTask, lanes: _Lanes, way_m: float, samples: int) -> None:
        """Set up where the hands aim: so that the handle of law, handle and hand would follow the way of the motion."""
        hands, law = lanes.hands, task.law
        self._hands = hands
        self._period_s = period_s = task.device.sample_time_s
        self._mass = law.mass_kg + task.device.force_sensor.handle_mass_kg + np.asarray(hands.mass_kg)
        self._damping = law.damping_ns_per_m + np.asarray(hands.damping_ns_per_m)
        self._stiffness = law.stiffness_n_per_m + np.asarray(hands.stiffness_n_per_m)
        time_s: FloatArray = np.arange(-1, samples + 2, dtype=np.float64) * period_s
        self._ways_m = way_m * np.array([MOTIONS[name].way(time_s) for name in lanes.motions])
        self._each = len(hands) // len(lanes.motions)
        self.start_m = np.repeat(self._ways_m[:, 0], self._each)
        self._sample = 0
        self._place_m = self._placed(self.start_m)

    def _placed(self, start_m: FloatArray) -> FloatArray:
        """Return the targets at rest: K + k times the way is k times the target."""
        stiffness = np.asarray(self._hands.stiffness_n_per_m)
        firm = np.where(stiffness > 0, stiffness, 1.0)
        return np.where(stiffness > 0, self._stiffness * start_m / firm, start_m)

    def advance(self) -> HandTarget:
        """Return the target over the next sample: (b x_t + T g)/(b + k T), g what moves the law, handle and hand."""
        self._sample += 1
        before, here, after = (
            np.repeat(self._ways_m[:, place], self._each) for place in range(self._sample, self._sample + 3)
        )
        period_s = self._period_s
        speed = (after - before) / (2 * period_s)
        push = self._mass * (after - 2 * here + before) / period_s**2 + self._damping * speed + self._stiffness * here
        damping, stiffness = self._hands.damping_ns_per_m, self._hands.stiffness_n_per_m
        total = np.asarray(damping + period_s * stiffness)
        moved = (damping * self._place_m + period_s * push) / np.where(total > 0, total, 1.0)
        place_m = np.where(total > 0, moved, here)
        target = HandTarget(self._place_m, (place_m - self._place_m) / period_s)
        self._place_m = place_m
        return target


class _Computer:
    """The law with its sensor, sample by sample: noise, steps and range of the reading, limit of the velocity."""

    def __init__(self, task: HandTask, rest_n: FloatArray) -> None:
        """Set up the law with its low pass, the sensor's noise, steps and range, and the limit of the velocity."""
        device = task.device
        cutoff_hz = task.law.cutoff_hz
        self._law = task.law
        self._sensor = device.force_sensor
        self._period_s = device.sample_time_s
        self._share = 1.0 if cutoff_hz is None else -math.expm1(-2 * math.pi * cutoff_hz * device.sample_time_s)
        self._largest_m_per_s = math.inf if device.max_speed_m_per_s is None else device.max_speed_m_per_s
        self._largest_n = math.inf if device.force_sensor.max_force_n is None else device.force_sensor.max_force_n
        self._random = np.random.default_rng([task.seed, _NOISE, int(task.numbers[0])])
        self._filtered_n = rest_n
        self._velocity = np.zeros(len(rest_n))
        self.at_speed_limit = np.zeros(len(rest_n), dtype=bool)
        self.at_force_limit = np.zeros(len(rest_n), dtype=bool)

    def step(self, position_m: FloatArray, force_n: FloatArray) -> FloatArray:
        """Return the velocity that is commanded: v+ = (M v + T (g - K x))/(M + B T), g the force behind its filter."""
        sensor = self._sensor
        law = self._law
        period_s = self._period_s
        if sensor.noise_rms_n:
            force_n = force_n + sensor.noise_rms_n * self._random.standard_normal(len(force_n))
        if sensor.resolution_n:
            force_n = sensor.resolution_n * np.round(force_n / sensor.resolution_n)
        self.at_force_limit |= np.abs(force_n) >= self._largest_n
        reading_n = np.clip(force_n, -self._largest_n, self._largest_n)
        self._filtered_n = self._filtered_n + self._share * (reading_n - self._filtered_n)
        push_n = self._filtered_n - law.stiffness_n_per_m * position_m
        velocity = (law.mass_kg * self._velocity + period_s * push_n) / (law.mass_kg + law.damping_ns_per_m * period_s)
        self.at_speed_limit |= np.abs(velocity) >= self._largest_m_per_s
        self._velocity = np.clip(velocity, -self._largest_m_per_s, self._largest_m_per_s)
        return self._velocity


class HandleRecord:
    """What is seen of all lanes; arrays have shape (lanes,).

    Attributes:
        last_m_per_s: largest speed of handle and drive in the time at the end that is judged.
        peak_n: largest force of the hand that guides.
        squares: sums over guiding of the squares of that force, and of the handle's speed.
        at_release_m_per_s: speed of the handle at release.
        released_m_per_s: largest speed of handle and drive from then on.
        released_m: how far the handle moves on.
        gap_m: how far the handle leaves the surface, after its first touch or after release.
    """

    def __init__(self, lanes: int) -> None:
        self.last_m_per_s, self.peak_n, self.at_release_m_per_s, self.released_m_per_s = np.zeros((4, lanes))
        self.released_m, self.gap_m, self._release_m = np.zeros((3, lanes))
        self.squares = np.zeros((2, lanes))
        self._touched = np.zeros(lanes, dtype=bool)

    def guides(self, handles: HandleLanes, hands: Hand, target: HandTarget) -> None:
        """Note the force of hands that guide: of spring and damper, less what moves the hand itself."""
        handle_m, handle_m_per_s = handles.state[-2:]
        spring = hands.stiffness_n_per_m * (target.position_m - handle_m)
        damper = hands.damping_ns_per_m * (target.velocity_m_per_s - handle_m_per_s)
        force = spring + damper - hands.mass_kg * handles.acceleration_m_per_s2(target)
        self.peak_n = np.maximum(self.peak_n, np.abs(force))
        self.squares += np.square(np.stack([force, handle_m_per_s]))

    def releases(self, handles: HandleLanes, released: BoolArray) -> None:
        """Note place and speed of handles now, some of which are released: their gaps count from here on."""
        self._release_m = handles.state[-2].copy()
        self.at_release_m_per_s = np.abs(handles.state[-1])
        self.gap_m = np.where(released, 0.0, self.gap_m)

    def moves(self, handles: HandleLanes, *, released: bool, judged: bool) -> None:
        """Note speeds of drive and handle and the gap to a contact after a sample, for released and judged lanes."""
        speed = np.maximum(np.abs(handles.state[1]), np.abs(handles.state[-1]))
        self._touched |= handles.touching
        self.gap_m = np.maximum(self.gap_m, np.where(self._touched, -handles.state[-2], 0.0))
        if released:
            self.released_m_per_s = np.maximum(self.released_m_per_s, speed)
            self.released_m = np.maximum(self.released_m, np.abs(handles.state[-2] - self._release_m))
        if judged:
            self.last_m_per_s = np.maximum(self.last_m_per_s, speed)


@dataclass(frozen=True)
class TriedHands:
    """What a task has found; arrays have shape (lanes,)."""

    lanes: _Lanes
    duration_s: float
    way_m: float
    record: HandleRecord
    computer: _Computer
    settles: BoolArray
    guided_samples: int

    @property
    def motions(self) -> tuple[str, ...]:
        """The motion of each group of lanes."""
        return self.lanes.motions

    def of(self, motion: str, values: FloatArray) -> FloatArray:
        """Return the values of a motion."""
        return np.asarray(values[..., self.lanes.have(motion)])

    def rests(self, motion: str) -> BoolArray:
        """Return whether each hand settles in a motion, on every contact."""
        return np.asarray(self.settles.reshape(len(self.motions), -1)[np.array(self.motions) == motion].all(axis=0))

    def hands_at(self, limit: BoolArray) -> int:
        """Return with how many hands a limit is reached."""
        return int(limit.reshape(len(self.motions), -1).any(axis=0).sum())


def simulated(task: HandTask) -> TriedHands:
    """Simulate all motions of some hands on one device with its law, sample by sample; return what is seen of them."""
    device, lanes = task.device, _Lanes.of(task)
    period_s, way_m = device.sample_time_s, _way_m(task)
    samples = round((_MOTION_S + _rest_s(task, way_m)) / period_s)
    aim, handles = _Aim(task, lanes, way_m, samples), HandleLanes(device, lanes.hands, lanes.contacts)
    rest_n = task.law.stiffness_n_per_m * aim.start_m
    struck = np.where(lanes.have("hold"), _STRUCK_M_PER_S / device.metres_per_unit, 0.0)
    handles.place(aim.start_m, aim.start_m + rest_n / device.force_sensor.stiffness_n_per_m, struck)
    computer, record = _Computer(task, rest_n), HandleRecord(len(struck))
    released = lanes.have(*(name for name, motion in MOTIONS.items() if motion.released))
    release = round(_RELEASED_S / period_s)
    # The first swing begins softly, and the last one ends softly.
    guided = range(round(1 / GUIDE_HZ / period_s), round((_SWINGS - 1) / GUIDE_HZ / period_s))
    judged = samples - max(1, round(SETTLING_WINDOW_S / period_s))
    with np.errstate(over="ignore", invalid="ignore"):  # an unstable loop without a limit grows for ever
        for sample in range(samples):
            if sample == release:
                record.releases(handles, released)
                handles.release(released)
            command, target = computer.step(handles.state[0], handles.sensor_n), aim.advance()
            if sample in guided:
                record.guides(handles, lanes.hands, target)
            handles.move(command, target)
            record.moves(handles, released=sample >= release, judged=sample >= judged)
        settles = record.last_m_per_s < AT_REST_M_PER_S / device.metres_per_unit
    return TriedHands(lanes, samples * period_s, way_m, record, computer, settles, len(guided))


def _way_m(task: HandTask) -> float:
    """Return how far a hand guides: less than usual where that comes near the largest speed, or the sensor's range.

    At w = 2 pi f the force is |K - w^2 M + j w B| times the way, the speed w times the way.
    """
    device = task.device
    law = task.law
    omega = 2 * math.pi * GUIDE_HZ
    ways_m = [_WAY_M / device.metres_per_unit]
    if device.max_speed_m_per_s is not None:
        ways_m.append(_SHARE_OF_LIMITS * device.max_speed_m_per_s / omega)
    if device.force_sensor.max_force_n is not None:
        per_m = math.hypot(law.stiffness_n_per_m - omega**2 * law.mass_kg, omega * law.damping_ns_per_m)
        ways_m.append(_SHARE_OF_LIMITS * device.force_sensor.max_force_n / per_m if per_m else math.inf)
    return min(ways_m)


def _rest_s(task: HandTask, way_m: float) -> float:
    """Return how long the hands keep still, until the slowest motion of all loops has decayed to the speed of rest.

    A pole s of a loop moves at most at the speed of guiding, or at |s| times the way. A released handle coasts from
    that speed whatever its way, or from twice it where a contact throws it back. A pole decays by exp(Re s t), or
    grows by as much where it is unstable.
    """
    device, law = task.device, task.law.law(task.device.sample_time_s)
    nothing = Hand(*np.zeros((3, len(task.hands))))
    sums = [
        Hand(*(getattr(hand, key) + getattr(contact, key) for key in vars(hand)))
        for hand, contact in product((task.hands, nothing), (nothing, *task.contacts))
    ]
    poles = closed(Body.of(plants_of([(device, _joined(sums))])).flat(), law).poles
    rest_m_per_s = AT_REST_M_PER_S / device.metres_per_unit
    with np.errstate(divide="ignore", invalid="ignore"):
        rates = np.log(poles) / device.sample_time_s
        speed = np.minimum(2 * math.pi * GUIDE_HZ * way_m, np.abs(rates) * way_m)
        released = slice(len(speed) // 2, None)
        speed[released] = _THROWN * 2 * math.pi * GUIDE_HZ * way_m
        decay_s = np.where(speed > rest_m_per_s, np.log(speed / rest_m_per_s) / np.abs(rates.real), 0.0)
    return float(np.clip(np.nanmax(decay_s, initial=0.0), _LEAST_REST_S, LONGEST_S - _MOTION_S))
