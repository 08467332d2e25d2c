"""Trials of a coupling to a virtual tool and to a follower: many hands in free motion, in and out of contact.

A tool is simulated in the scene of all declared effects; both devices of a teleoperator exactly between samples and
changes of contact, with encoders, limits, delays and losses, without dry friction, which settles no unstable loop.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
from avc_casadi.loops.engine import contact_stiffnesses_n_per_m, tool_of
from avc_casadi.loops.follower import contact_dampers_ns_per_m, environments, follower_of
from avc_casadi.model.declared import declared_effects
from avc_casadi.model.device import Device
from avc_casadi.model.effects import SimulationEffect
from avc_casadi.model.ends import HEAVIEST_TOOL_KG, ToolGains, tool_states
from avc_casadi.model.gains import NO_COUPLING
from avc_casadi.model.hands import Hand
from avc_casadi.model.plant import device_plant, sampled_plant, transition
from avc_casadi.model.problem import Problem
from avc_casadi.model.scene import Free, Stroke
from avc_casadi.simulation.compile import target_of
from avc_casadi.simulation.execute import execute
from avc_casadi.simulation.judge import AT_REST_M_PER_S, SETTLING_WINDOW_S, Traces, window_samples
from avc_casadi.simulation.population.motions import LONGER_S, course_of, motions_at
from avc_casadi.simulation.population.setup import FRICTION, Setup, prepare
from avc_casadi.simulation.population.trial import NEAR_LIMIT, Trial

WITH_TOOL = ("free", "press", "tap", "hold", "drag", "strike", "touch")
STEP_LOSS = 0.01  # of the engine's steps
WITH_FOLLOWER = ("free", "press", "tap", "hold", "strike")


def try_tool(
    problem: Problem, gains: ToolGains, people: Hand, seed: int = 0, motions: Sequence[str] = WITH_TOOL
) -> Trial:
    """Simulate hands that move a tool: as declared, without dry friction and with missed steps, on every contact."""
    tool, device = tool_of(problem), problem.device
    contacts = [one for one in contact_stiffnesses_n_per_m(tool) if one > 0] or [0.0]
    # In free motion the tool's mass swings with the device.
    mass = device.mass_kg + (0.0 if tool.tool_mass_kg is None else tool.scale * tool.tool_mass_kg[1])
    heavier = problem.changed(device={"mass_kg": min(mass, HEAVIEST_TOOL_KG), "range": {"mass_kg": None}})
    courses = course_of(heavier), course_of(heavier, LONGER_S)
    others = tuple(one for one in declared_effects(problem) if not isinstance(one, SimulationEffect))
    setups = [
        Setup(problem, NO_COUPLING, (*others, engine), steps_anywhere=False)
        for engine in (SimulationEffect(stiffness_n_per_m=1.0, dropped_share=share) for share in (0.0, STEP_LOSS))
    ]
    setups += [setups[0].without(FRICTION)] * setups[0].rough
    # A tool moves in one sample for a whole step of its engine.
    limit, moves_s = device.max_force_n or np.inf, max(device.sample_time_s, tool.step_s[0])
    settles = [dict.fromkeys(motions, np.ones(len(people), dtype=bool)) for _ in setups]
    stiffness, tap = np.full(len(people), np.nan), np.zeros(len(people))
    for setup, rests in zip(setups, settles, strict=True):
        for name, contact in product(motions, contacts):
            rest = np.zeros(len(people), dtype=bool)
            for course in courses:  # what is not at rest may decay slowly, or move for ever
                late = np.flatnonzero(~rest)
                scene, _, inputs = prepare(setup, people, course.motions[name], course.duration_s)
                scene = scene.with_numbers("simulation", gains=gains, state=tool_states(tool, contact)[-1])
                hands = scene.parameter_values(NO_COUPLING)[late]
                traces = execute(scene, hands, inputs)
                verdict, last = Traces.of(traces, device).judge(), window_samples(scene.samples, device.sample_time_s)
                with np.errstate(invalid="ignore", over="ignore"):
                    speed = np.abs(np.diff(traces["tool_m"][:, -last:], axis=-1)).max(axis=-1) / moves_s
                    slow = speed * device.metres_per_unit < AT_REST_M_PER_S
                rest[late] = verdict.stable & slow
                if setup is setups[0] and name == "press":
                    at_limit = np.abs(verdict.mean_force_n) > NEAR_LIMIT * limit
                    stiffness[late] = np.where(at_limit, np.nan, verdict.apparent_stiffness_n_per_m)
                if setup is setups[0] and name == "tap" and course is courses[0]:
                    tap = np.abs(traces["force_n"]).max(axis=-1)
                if rest.all():
                    break
            rests[name] = rests[name] & rest
    declared, step_loss, free = (np.asarray(np.all(list(settles[at].values()), axis=0)) for at in (0, 1, -1))
    beside = {"without_friction": free if setups[0].rough else declared, "with_dropped_steps": step_loss}
    return Trial(seed, settles[0], stiffness, tap, beside, {"dropped_share": STEP_LOSS})


def try_bilateral(problem: Problem, gains: ToolGains, people: Hand, seed: int = 0) -> Trial:
    """Simulate hands that move a follower, on a link with the declared delay, jitter and losses, which a seed draws."""
    follower = follower_of(problem)
    stiffness, _ = environments(follower)
    some = sorted({float(stiffness[place]) for place in (len(stiffness) // 2, -1)})
    shape = len(WITH_FOLLOWER), len(some), len(people)
    settles = np.ones(shape, dtype=bool)
    for delays_s in follower.delays_s:
        run = _Run(problem, gains, people, some, delays_s, seed)
        rests = run.settles.reshape(shape)
        if (late := np.flatnonzero(~rests.all(axis=(0, 1)))).size:
            longer = _Run(problem, gains, people.pick(late), some, delays_s, seed, LONGER_S)
            rests[..., late] |= longer.settles.reshape(*shape[:2], -1)
        settles &= rests
    press = run.stiffness_n_per_m.reshape(shape)[WITH_FOLLOWER.index("press"), -1]
    tap = run.peak_n.reshape(shape)[WITH_FOLLOWER.index("tap"), -1]
    by_motion = {name: np.asarray(settles[place].all(axis=0)) for place, name in enumerate(WITH_FOLLOWER)}
    return Trial(seed, by_motion, press, tap, facts={"jitter": follower.jitter, "lost_share": follower.lost_share})


def _newest(
    sender_s: float, receiver_s: float, delay_s: float, samples: int, jitter: float, loss: float, seed: int
) -> IndexArray:
    """Draw the arrivals of a sender's messages; return the newest one at each of the receiver's samples."""
    rng = np.random.default_rng(seed)
    count = int(np.ceil(samples * receiver_s / sender_s)) + 1
    arrival = np.arange(count) * sender_s + delay_s * (1 + jitter * rng.uniform(-1, 1, count))
    arrival[rng.random(count) < loss] = np.inf
    # A message that arrives after a newer one is discarded.
    order = np.argsort(arrival, kind="stable")
    best = np.maximum.accumulate(order)
    place = np.searchsorted(arrival[order], np.arange(samples) * receiver_s + 1e-12, side="right") - 1
    return np.asarray(np.where(place >= 0, best[np.maximum(place, 0)], -1))


class _Side:
    """One device in many parallel runs (lanes), advanced sample by sample."""

    def __init__(self, device: Device, hands: list[Hand], start_m: FloatArray) -> None:
        plants = [sampled_plant(device, one) for one in hands]
        self.maps = [tuple(part[0] for part in plant.with_forces_under_way()) for plant in plants]
        self.aims = [transition(device_plant(device, one).linear(), device.sample_time_s).target for one in hands]
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
        """Advance by a sample."""
        count, nexts = len(self.names), []
        for (matrix, push), aim in zip(self.maps, self.aims, strict=True):
            after = np.matmul(matrix, self.state[..., None])[..., 0] + push * force[:, None]
            if target is not None:
                after[:, :count] += np.matmul(aim, target[..., None])[..., 0]
            nexts.append(after)
        self.state = nexts[0] if len(nexts) == 1 else np.where(which[:, None], nexts[1], nexts[0])


class _Run:
    """Every motion of many hands on every contact: lanes of shape (motions, contacts, hands), flattened."""

    def __init__(
        self,
        problem: Problem,
        gains: ToolGains,
        hands: Hand,
        contacts_n_per_m: list[float],
        delays_s: tuple[float, float],
        seed: int,
        longer_s: float = 0.0,
    ) -> None:
        self.follower, leader, self.gains = follower_of(problem), problem.device, gains
        other = self.follower.at_leader()
        self.times = leader.sample_time_s, other.sample_time_s
        samples = round((5.0 + longer_s) / self.times[0])
        motions = [
            one.model_copy(update={"rest_s": 2.0 + longer_s}) if isinstance(one, Free | Stroke) else one
            for one in map(motions_at(leader).__getitem__, WITH_FOLLOWER)
        ]
        targets = [target_of(one, samples, self.times[0]) for one in motions]
        each = len(contacts_n_per_m) * len(hands)
        self.lanes = len(motions) * each
        aims = [np.stack([one.position_m, one.velocity_m_per_s], axis=-1) for one in targets]
        self.targets = np.repeat(np.stack(aims, axis=1), each, axis=1)
        contact = np.tile(np.repeat(contacts_n_per_m, len(hands)), len(motions))
        self.rigid = np.isinf(contact)
        self.spring = np.where(self.rigid, 0.0, contact)
        scale = self.follower.scale
        self.damper = np.array([scale * max(contact_dampers_ns_per_m(self.follower, k / scale)) for k in self.spring])
        held = Hand(*(np.tile(np.atleast_1d(value), self.lanes // len(hands)) for value in vars(hands).values()))
        nothing = np.zeros(self.lanes)
        start = np.repeat([min(one.device_start_m, 0.0) for one in targets], each)
        free, touch = Hand(nothing, nothing, nothing), Hand(nothing, self.damper, self.spring)
        self.sides = _Side(leader, [held], start), _Side(other, [free, touch], start)
        uneven = self.follower.jitter, self.follower.lost_share
        self.links = (
            _newest(self.times[1], self.times[0], delays_s[1], samples, *uneven, seed + 1),
            _newest(*self.times, delays_s[0], math.ceil(samples * self.times[0] / self.times[1]) + 2, *uneven, seed),
        )
        self.forces = [np.zeros(self.lanes)]
        window = max(1, round(SETTLING_WINDOW_S / self.times[0]))
        self.peak_n, speed, force, depth = np.zeros((4, self.lanes))
        other_sample = 0
        for sample in range(samples):
            while other_sample * self.times[1] < (sample - 1e-6) * self.times[0]:
                self.sides[1].sent.append(self.sides[1].measure())
                self._follow(other_sample)
                other_sample += 1
            together = other_sample * self.times[1] < (sample + 1e-6) * self.times[0]
            for side in self.sides[: 1 + together]:
                side.sent.append(side.measure())
            command = self._lead(sample)
            if together:
                self._follow(other_sample)
                other_sample += 1
            if sample >= samples - window:
                speed = np.maximum(speed, np.maximum(*(np.abs(side.state[:, 1]) for side in self.sides)))
                force, depth = force + command / window, depth + self.sides[0].state[:, 0] / window
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
        side, pull = self.sides[1], self._pull(1, int(self.links[1][sample]))
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
        """Return the coupling force on a side, from its own newest message and the newest received."""
        own, far = self.sides[to].sent, self.sides[1 - to].sent
        # The initial positions come first in each list.
        place = newest + 1
        speed = (own[-1] - own[-2]) / self.times[to]
        far_speed = (far[place] - far[max(place - 1, 0)]) / self.times[1 - to]
        k, b = self.gains.stiffness_n_per_m, self.gains.damping_ns_per_m
        return np.asarray(k * (own[-1] - far[place]) + b * (speed - far_speed))

    def _local(self, of: int) -> FloatArray:
        before, here = self.sides[of].sent[-2:]
        return np.asarray(self.gains.local_damping_ns_per_m * (here - before) / self.times[of])
