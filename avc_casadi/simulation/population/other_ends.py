"""Trials of a coupling to a virtual tool and to a follower: many hands in free motion, in and out of contact.

A tool is simulated in the scene of all declared effects; both devices of a teleoperator exactly between samples and
changes of contact, with encoders, limits, delays and losses, without dry friction, which settles no unstable loop.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import singledispatch
from itertools import product

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
from avc_casadi.loops.engine import contact_stiffnesses_n_per_m
from avc_casadi.loops.follower import contact_dampers_ns_per_m, environments
from avc_casadi.model.declared import declared_effects
from avc_casadi.model.device import Device
from avc_casadi.model.effects import SimulationEffect
from avc_casadi.model.ends import HEAVIEST_TOOL_KG, End, Follower, Simulation, ToolGains, not_known, tool_states
from avc_casadi.model.gains import NO_COUPLING
from avc_casadi.model.hands import Hand
from avc_casadi.model.plant import device_plant, sampled_plant, transition
from avc_casadi.model.problem import Problem
from avc_casadi.model.scene import Free, Motion, Stroke
from avc_casadi.simulation.compile import CompiledScene, target_of
from avc_casadi.simulation.execute import execute
from avc_casadi.simulation.judge import AT_REST_M_PER_S, SETTLING_WINDOW_S, Judgement, Traces, window_samples
from avc_casadi.simulation.population.motions import LONGER_S, Course, course_of, motions_at
from avc_casadi.simulation.population.setup import FRICTION, Setup, prepare
from avc_casadi.simulation.population.trial import NEAR_LIMIT, FollowerTrial, ToolTrial, Trial

WITH_TOOL = ("free", "press", "tap", "hold", "drag", "strike", "touch")
"""Motions of hands that move a tool."""
SCREENING_WITH_TOOL = ("touch", "free")
"""Those that most often fail."""
STEP_LOSS = 0.01
"""Share of the engine's steps that it misses."""
WITH_FOLLOWER = ("free", "press", "tap", "hold", "strike")
"""Motions of hands that move a follower."""
BILATERAL_S = 5.0
"""Duration of a motion with a follower."""
BILATERAL_REST_S = 2.0
"""Rest at its end."""
_SAME_TIME = 1e-6
"""Share of the leader's sample by which two samples that fall together may differ by rounding."""
_ARRIVAL_ROUNDING_S = 1e-12
"""Time by which a message that arrives at a sample may seem to arrive after it."""


def try_tool(
    problem: Problem, gains: ToolGains, hands: Hand, seed: int = 0, motions: Sequence[str] = WITH_TOOL
) -> ToolTrial:
    """Simulate hands that move a tool: as declared, without dry friction and with missed steps, on every contact."""
    tool = problem.end_as(Simulation)
    courses = _tool_courses(problem, tool)
    results = [_try_setup(setup, tool, gains, hands, motions, courses) for setup in _tool_setups(problem)]
    declared, with_missed_steps, *without_friction = results
    smooth = without_friction[0] if without_friction else declared
    return ToolTrial(
        seed=seed,
        by_motion=declared.by_motion,
        stiffness_n_per_m=declared.stiffness_n_per_m,
        tap_force_n=declared.tap_force_n,
        stable_without_friction=smooth.settles,
        stable_with_dropped_steps=with_missed_steps.settles,
        dropped_share=STEP_LOSS,
    )


@dataclass(frozen=True)
class _ToolResults:
    """Results of hands that move a tool; every array has shape (hands,)."""

    by_motion: dict[str, BoolArray]
    stiffness_n_per_m: FloatArray
    tap_force_n: FloatArray

    @property
    def settles(self) -> BoolArray:
        """Settled in every motion."""
        return np.asarray(np.all(list(self.by_motion.values()), axis=0))


def _try_setup(
    setup: Setup,
    tool: Simulation,
    gains: ToolGains,
    hands: Hand,
    motions: Sequence[str],
    courses: tuple[Course, Course],
) -> _ToolResults:
    """Simulate every motion on every contact; hands that do not settle in the first course take the longer one.

    A hand settles in a motion if it settles on every contact. Apparent stiffness (of a press below the force limit) and
    peak force (of a tap) are those on the last contact, which is the stiffest.
    """
    device = setup.problem.device
    contacts = [stiffness for stiffness in contact_stiffnesses_n_per_m(tool) if stiffness > 0] or [0.0]
    limit_n = device.max_force_n or np.inf
    by_motion = dict.fromkeys(motions, np.ones(len(hands), dtype=bool))
    stiffness, tap = np.full(len(hands), np.nan), np.zeros(len(hands))
    for name, contact in product(motions, contacts):
        rest = np.zeros(len(hands), dtype=bool)
        for course in courses:  # what is not at rest may decay slowly, or move for ever
            late = np.flatnonzero(~rest)
            scene, _, inputs = prepare(setup, hands, course.motions[name], course.duration_s)
            scene = scene.with_numbers("simulation", gains=gains, state=tool_states(tool, contact)[-1])
            run = _move_tool(tool, device, scene, scene.parameter_values(NO_COUPLING)[late], inputs)
            rest[late] = run.rests
            if name == "press":
                at_limit = np.abs(run.verdict.mean_force_n) > NEAR_LIMIT * limit_n
                stiffness[late] = np.where(at_limit, np.nan, run.verdict.apparent_stiffness_n_per_m)
            if name == "tap" and course is courses[0]:
                tap = run.peak_n
            if rest.all():
                break
        by_motion[name] = by_motion[name] & rest
    return _ToolResults(by_motion, stiffness, tap)


def _tool_courses(problem: Problem, tool: Simulation) -> tuple[Course, Course]:
    """Return the motions of hands that move a tool, of usual and of longer duration."""
    # In free motion the tool's mass swings with the device.
    mass = problem.device.mass_kg + (0.0 if tool.tool_mass_kg is None else tool.scale * tool.tool_mass_kg[1])
    heavier = problem.changed(device={"mass_kg": min(mass, HEAVIEST_TOOL_KG), "range": {"mass_kg": None}})
    return course_of(heavier), course_of(heavier, LONGER_S)


def _tool_setups(problem: Problem) -> list[Setup]:
    """Return what hands try: the device as declared, with missed steps, and, where it has friction, without."""
    effects = tuple(effect for effect in declared_effects(problem) if not isinstance(effect, SimulationEffect))
    setups = [
        Setup(problem, NO_COUPLING, (*effects, engine), steps_anywhere=False)
        for engine in (SimulationEffect(stiffness_n_per_m=1.0, dropped_share=share) for share in (0.0, STEP_LOSS))
    ]
    return [*setups, setups[0].without(FRICTION)] if setups[0].rough else setups


@dataclass(frozen=True)
class _ToolRun:
    """Hands that moved a tool; every array has shape (hands,)."""

    verdict: Judgement
    rests: BoolArray
    """Whether device, handle and tool are at rest."""
    peak_n: FloatArray


def _move_tool(
    tool: Simulation, device: Device, scene: CompiledScene, parameters: FloatArray, inputs: FloatArray
) -> _ToolRun:
    """Simulate hands that move a tool; return which settle with the tool, and the largest force, N."""
    traces = execute(scene, parameters, inputs)
    verdict = Traces.of(traces, device).judge()
    last = window_samples(scene.samples, device.sample_time_s)
    # A tool moves in one sample for a whole step of its engine.
    moves_s = max(device.sample_time_s, tool.step_s[0])
    with np.errstate(invalid="ignore", over="ignore"):
        speed = np.abs(np.diff(traces["tool_m"][:, -last:], axis=-1)).max(axis=-1) / moves_s
        slow = speed * device.metres_per_unit < AT_REST_M_PER_S
    return _ToolRun(verdict, np.asarray(verdict.stable & slow), np.abs(traces["force_n"]).max(axis=-1))


def try_bilateral(problem: Problem, gains: ToolGains, hands: Hand, seed: int = 0) -> FollowerTrial:
    """Simulate hands that move a follower, on a link with the declared delay, jitter and losses, which a seed draws."""
    follower = problem.end_as(Follower)
    stiffness, _ = environments(follower)
    contacts = sorted({float(stiffness[place]) for place in (len(stiffness) // 2, -1)})
    shape = len(WITH_FOLLOWER), len(contacts), len(hands)
    settles = np.ones(shape, dtype=bool)
    for delays_s in follower.delays_s:
        link = _Link(problem, gains, contacts, delays_s, seed)
        run = _Run(link, hands)
        rests = run.settles.reshape(shape)
        late = np.flatnonzero(~rests.all(axis=(0, 1)))
        if late.size:
            longer = _Run(link, hands.pick(late), LONGER_S)
            rests[..., late] |= longer.settles.reshape(*shape[:2], -1)
        settles &= rests
    press = run.stiffness_n_per_m.reshape(shape)[WITH_FOLLOWER.index("press"), -1]
    tap = run.peak_n.reshape(shape)[WITH_FOLLOWER.index("tap"), -1]
    by_motion = {name: np.asarray(settles[place].all(axis=0)) for place, name in enumerate(WITH_FOLLOWER)}
    return FollowerTrial(
        seed=seed,
        by_motion=by_motion,
        stiffness_n_per_m=press,
        tap_force_n=tap,
        jitter=follower.jitter,
        lost_share=follower.lost_share,
    )


@singledispatch
def try_end(
    end: End,
    problem: Problem,  # noqa: ARG001
    gains: ToolGains,  # noqa: ARG001
    hands: Hand,  # noqa: ARG001
    seed: int,  # noqa: ARG001
    *,
    screen: bool,  # noqa: ARG001
) -> Trial:
    """Simulate hands on a coupling to the end of a problem; a screening takes the motions that most often fail.

    Raises:
        UnsupportedError: of this kind of end no hand is simulated.
    """
    raise not_known(end, "a trial with simulated hands")


@try_end.register
def _try_simulation(
    end: Simulation,  # noqa: ARG001
    problem: Problem,
    gains: ToolGains,
    hands: Hand,
    seed: int,
    *,
    screen: bool,
) -> Trial:
    """Return the trial of a coupling to a simulation: `screen` tries fewer motions."""
    return try_tool(problem, gains, hands, seed, SCREENING_WITH_TOOL if screen else WITH_TOOL)


@try_end.register
def _try_follower(
    end: Follower,  # noqa: ARG001
    problem: Problem,
    gains: ToolGains,
    hands: Hand,
    seed: int,
    *,
    screen: bool,  # noqa: ARG001 - a teleoperator is tried as quickly as screened
) -> Trial:
    """Return the trial of a coupling to a follower, with all motions."""
    return try_bilateral(problem, gains, hands, seed)


def _newest(
    sender_s: float, receiver_s: float, delay_s: float, samples: int, jitter: float, loss: float, seed: int
) -> IndexArray:
    """Return the number of the newest message at each of the receiver's samples, -1 before the first.

    Messages leave every `sender_s` and take `delay_s`, spread by `jitter`, a share of it; a share `loss` is lost.
    """
    rng = np.random.default_rng(seed)
    count = int(np.ceil(samples * receiver_s / sender_s)) + 1
    arrival = np.arange(count) * sender_s + delay_s * (1 + jitter * rng.uniform(-1, 1, count))
    arrival[rng.random(count) < loss] = np.inf
    # A message that arrives after a newer one is discarded.
    order = np.argsort(arrival, kind="stable")
    best = np.maximum.accumulate(order)
    place = np.searchsorted(arrival[order], np.arange(samples) * receiver_s + _ARRIVAL_ROUNDING_S, side="right") - 1
    return np.asarray(np.where(place >= 0, best[np.maximum(place, 0)], -1))


class _Side:
    """One device in many parallel runs (lanes), advanced sample by sample."""

    def __init__(self, device: Device, hands: list[Hand], start_m: FloatArray) -> None:
        """Set up one device with each of some hands in many lanes, at rest at `start_m`."""
        plants = [sampled_plant(device, hand) for hand in hands]
        self.maps = [tuple(part[0] for part in plant.with_forces_under_way()) for plant in plants]
        self.aims = [transition(device_plant(device, hand).linear(), device.sample_time_s).target for hand in hands]
        n = self.maps[0][0].shape[-1]
        self.names = plants[0].names
        places = [name.endswith("_position_m") for name in self.names] + [False] * (n - len(self.names))
        self.state = np.where(places, start_m[:, None], 0.0)
        self.row = np.zeros(n)
        self.row[: len(self.names)] = plants[0].output_row
        self.step_m = device.encoder_resolution_m
        self.limit_n = np.inf if device.max_force_n is None else device.max_force_n
        self.sent = [self.measure()]

    def measure(self) -> FloatArray:
        """Return the measured positions, shape (lanes,)."""
        position = self.state @ self.row
        return np.asarray(np.round(position / self.step_m) * self.step_m if self.step_m > 0 else position)

    def move(self, which: BoolArray, force: FloatArray, target: FloatArray | None = None) -> None:
        """Advance the states of all lanes by one sample.

        `force` is the commanded force of each lane, N, `target` where its hand aims, m; the lanes of `which` move with
        the second hand's matrices, the others with the first's.
        """
        count, nexts = len(self.names), []
        for (matrix, push), aim in zip(self.maps, self.aims, strict=True):
            after = np.matmul(matrix, self.state[..., None])[..., 0] + push * force[:, None]
            if target is not None:
                after[:, :count] += np.matmul(aim, target[..., None])[..., 0]
            nexts.append(after)
        self.state = nexts[0] if len(nexts) == 1 else np.where(which[:, None], nexts[1], nexts[0])


def _bilateral_motions(leader: Device, longer_s: float) -> list[Motion]:
    """Return the motions of the leader's hands, the oscillations among them with a rest at the end."""
    motions = (motions_at(leader)[name] for name in WITH_FOLLOWER)
    return [
        motion.model_copy(update={"rest_s": BILATERAL_REST_S + longer_s})
        if isinstance(motion, Free | Stroke)
        else motion
        for motion in motions
    ]


def _tiled(hands: Hand, repeats: int) -> Hand:
    """Return a set of hands several times over."""
    return Hand(
        mass_kg=np.tile(hands.mass_kg, repeats),
        damping_ns_per_m=np.tile(hands.damping_ns_per_m, repeats),
        stiffness_n_per_m=np.tile(hands.stiffness_n_per_m, repeats),
    )


@dataclass(frozen=True)
class _Link:
    """Two devices joined by gains, the contacts that the follower meets, and the delays of a link, drawn by a seed."""

    problem: Problem
    gains: ToolGains
    contacts_n_per_m: list[float]
    delays_s: tuple[float, float]
    """Of the leader's messages, and of the follower's."""
    seed: int


class _Run:
    """Every motion of many hands on every contact: lanes of shape (motions, contacts, hands), flattened."""

    def __init__(self, link: _Link, hands: Hand, longer_s: float = 0.0) -> None:
        """Set up every motion of the hands on every contact as lanes, and simulate them; `longer_s` is added."""
        leader = link.problem.device
        contacts = link.contacts_n_per_m
        self.gains = link.gains
        self.follower = link.problem.end_as(Follower)
        follower = self.follower.at_leader()
        self.times = leader.sample_time_s, follower.sample_time_s
        self.samples = round((BILATERAL_S + longer_s) / self.times[0])
        targets = [target_of(motion, self.samples, self.times[0]) for motion in _bilateral_motions(leader, longer_s)]
        lanes_of_motion = len(contacts) * len(hands)
        self.lanes = len(targets) * lanes_of_motion
        aims = [np.stack([target.position_m, target.velocity_m_per_s], axis=-1) for target in targets]
        self.targets = np.repeat(np.stack(aims, axis=1), lanes_of_motion, axis=1)
        contact = np.tile(np.repeat(contacts, len(hands)), len(targets))
        self.rigid = np.isinf(contact)
        self.spring = np.where(self.rigid, 0.0, contact)
        scale = self.follower.scale
        self.damper = np.array([scale * max(contact_dampers_ns_per_m(self.follower, k / scale)) for k in self.spring])
        start = np.repeat([min(target.device_start_m, 0.0) for target in targets], lanes_of_motion)
        nothing = np.zeros(self.lanes)
        free, touch = Hand(nothing, nothing, nothing), Hand(nothing, self.damper, self.spring)
        held = _tiled(hands, self.lanes // len(hands))
        self.sides = _Side(leader, [held], start), _Side(follower, [free, touch], start)
        uneven = self.follower.jitter, self.follower.lost_share
        to_leader_s, to_follower_s = link.delays_s[1], link.delays_s[0]
        followed = math.ceil(self.samples * self.times[0] / self.times[1]) + 2
        self.links = (
            _newest(self.times[1], self.times[0], to_leader_s, self.samples, *uneven, link.seed + 1),
            _newest(self.times[0], self.times[1], to_follower_s, followed, *uneven, link.seed),
        )
        self.forces = [np.zeros(self.lanes)]
        self.peak_n = np.zeros(self.lanes)
        self._simulate(leader)

    def _simulate(self, leader: Device) -> None:
        """Advance both sides through all samples, then judge the end."""
        window = max(1, round(SETTLING_WINDOW_S / self.times[0]))
        speed = np.zeros(self.lanes)
        force = np.zeros(self.lanes)
        depth = np.zeros(self.lanes)
        follower_sample = 0
        for sample in range(self.samples):
            while follower_sample * self.times[1] < (sample - _SAME_TIME) * self.times[0]:
                self.sides[1].sent.append(self.sides[1].measure())
                self._follow(follower_sample)
                follower_sample += 1
            together = follower_sample * self.times[1] < (sample + _SAME_TIME) * self.times[0]
            for side in self.sides[: 1 + together]:
                side.sent.append(side.measure())
            command = self._lead(sample)
            if together:
                self._follow(follower_sample)
                follower_sample += 1
            if sample >= self.samples - window:
                speed = np.maximum(speed, np.maximum(*(np.abs(side.state[:, 1]) for side in self.sides)))
                force = force + command / window
                depth = depth + self.sides[0].state[:, 0] / window
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            self.settles = np.asarray(speed * leader.metres_per_unit < AT_REST_M_PER_S)
            stiff = np.where(depth > 0, force / depth, np.nan)
            self.stiffness_n_per_m = np.where(np.abs(force) > NEAR_LIMIT * self.sides[0].limit_n, np.nan, stiff)

    def _lead(self, sample: int) -> FloatArray:
        """Advance the leader by a sample and return the force held over it."""
        newest = int(self.links[0][sample])
        by_force = self.follower.architecture == "position-force"
        pull = -self.forces[max(newest, 0)] if by_force else self._pull(0, newest)
        side = self.sides[0]
        command = np.clip(pull + self._local(0), -side.limit_n, side.limit_n)
        side.move(np.zeros(self.lanes, dtype=bool), command, self.targets[sample])
        self.peak_n = np.maximum(self.peak_n, np.abs(command))
        return np.asarray(command)

    def _follow(self, sample: int) -> None:
        """Advance the follower by a sample."""
        side = self.sides[1]
        pull = self._pull(1, int(self.links[1][sample]))
        command = np.clip(pull + self._local(1), -side.limit_n, side.limit_n)
        touching = side.state[:, 0] > 0
        speed = (side.sent[-1] - side.sent[-2]) / self.times[1]
        touch = np.where(touching, -(self.spring * side.sent[-1] + self.damper * speed), 0.0)
        self.forces.append(np.where(self.rigid, pull, touch) if self.follower.force == "measured" else pull)
        side.move(touching, command)
        into = self.rigid & (side.state[:, 0] > 0)
        side.state[into, 1] = np.minimum(side.state[into, 1], 0.0)
        side.state[into, 0] = 0.0

    def _pull(self, to: int, newest: int) -> FloatArray:
        """Return the force of K and B on a side, N, from its own newest position and the newest that it has received.

        `to` is the side, 0 the leader, and `newest` the numbers of the messages received, per lane.
        """
        near, far = self.sides[to].sent, self.sides[1 - to].sent
        # The initial positions come first in each list.
        place = newest + 1
        speed = (near[-1] - near[-2]) / self.times[to]
        far_speed = (far[place] - far[max(place - 1, 0)]) / self.times[1 - to]
        k, b = self.gains.stiffness_n_per_m, self.gains.damping_ns_per_m
        return np.asarray(k * (near[-1] - far[place]) + b * (speed - far_speed))

    def _local(self, of: int) -> FloatArray:
        before, here = self.sides[of].sent[-2:]
        return np.asarray(self.gains.local_damping_ns_per_m * (here - before) / self.times[of])
