"""What the device meets: a wall on one side or both, detents, or the tool of a physics engine at its own rate."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.arrays import FloatArray
from avc_casadi.model.control_law import ControlLaw
from avc_casadi.model.device import Detent
from avc_casadi.model.effects import DetentEffect, EnvironmentEffect, LawEffect, SimulationEffect, WallEffect
from avc_casadi.model.ends import RIGID_N_PER_M, Simulation, ToolGains, ToolState, tool_states, tool_step
from avc_casadi.model.problem import Contact, Problem
from avc_casadi.simulation.contact import Environment
from avc_casadi.simulation.effects.base import SceneEffect
from avc_casadi.simulation.runtime.law import law_step
from avc_casadi.simulation.tick import Expr, Rate, Tick, ca, insert


@dataclass(frozen=True)
class Detents(SceneEffect, keys=DetentEffect, rank=180):
    """The force of the detents of a problem and their damper."""

    detent: Detent

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:  # noqa: ARG003
        if problem.detent is None:
            message = "is listed and [detent] is missing; give both, or neither"
            raise InputError.of(message, file=problem.name, key=place)
        return cls(problem.detent)

    def sample(self, tick: Tick) -> None:
        """Add the force of the detents, N: F sin(2 pi s) for |s| < 1/2, s the distance from the nearest over its width.

        A damper acts everywhere, and the stored energy counts as the environment's.
        """
        detent = self.detent
        turns = (tick.position - detent.centre_m) / detent.pitch_m
        share = (turns - ca.floor(turns + 0.5)) / detent.width
        inside = ca.fabs(share) < 0.5
        force = ca.if_else(inside, detent.force_n * ca.sin(2 * math.pi * share), 0)
        tick.environment_energy_j += self._depth_j * (1 - ca.cos(2 * math.pi * ca.fmin(ca.fabs(share), 0.5)))
        if detent.damping_ns_per_m > 0:
            force += detent.damping_ns_per_m * Rate(tick, "detent_position", tick.start_m).settle(tick.position)
        tick.command = force if tick.command is None else tick.command + force

    @property
    def _depth_j(self) -> float:
        detent = self.detent
        return detent.force_n * detent.width * detent.pitch_m / (2 * math.pi)

    def potential_j(self, position_m: FloatArray) -> FloatArray:
        """Return the energy stored in the detents at positions, 0 in the valleys."""
        detent = self.detent
        turns = (position_m - detent.centre_m) / detent.pitch_m
        share = np.minimum(np.abs(turns - np.floor(turns + 0.5)) / detent.width, 0.5)
        return np.asarray(self._depth_j * (1 - np.cos(2 * math.pi * share)))


@dataclass(frozen=True)
class SceneWall(SceneEffect, keys=WallEffect, rank=160, role="environment"):
    """A spring and a damper that begin at x = 0 and never pull."""

    damping_ns_per_m: float
    stiffness_n_per_m: float
    contact: Contact

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:  # noqa: ARG003
        wall = problem.environment
        return cls(
            wall.damping_ns_per_m if table.damping_ns_per_m is None else table.damping_ns_per_m,
            wall.stiffness_n_per_m if table.stiffness_n_per_m is None else table.stiffness_n_per_m,
            problem.coupling.contact,
        )

    @property
    def environment(self) -> Environment:
        clips_last = self.contact == "clip-last"
        return Environment(self.stiffness_n_per_m, self.damping_ns_per_m, one_sided=True, clips_last=clips_last)


@dataclass(frozen=True)
class TwoSidedEnvironment(SceneWall, keys=EnvironmentEffect, rank=170, role="environment"):
    """A spring towards x = 0 and a damper, always in contact."""

    @property
    def environment(self) -> Environment:
        return Environment(self.stiffness_n_per_m, self.damping_ns_per_m, one_sided=False)


@dataclass(frozen=True)
class SceneLaw(SceneEffect, keys=LawEffect, rank=158, role="environment"):
    """A user's own law, in the wall where the problem has one, else everywhere."""

    law: ControlLaw
    one_sided: bool

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:  # noqa: ARG003
        if problem.law is None:
            raise InputError.of(
                "is listed and [law] is missing; allowed: both, or neither", file=problem.name, key=place
            )
        return cls(problem.law, problem.law_in_wall)

    def sample(self, tick: Tick) -> None:
        step = law_step(self.law, tick.sample_time_s, one_sided=self.one_sided, start_m=tick.start_m)
        tick.command = insert(tick, "law", step, [tick.position])["force_n"]


@dataclass(frozen=True)
class _EngineNumbers:
    """Gains of the coupling, tool and contact of an engine, as parameters of a run."""

    coupling_n_per_m: Expr
    coupling_ns_per_m: Expr
    local_ns_per_m: Expr
    tool_kg: Expr
    tool_ns_per_m: Expr
    contact_n_per_m: Expr
    contact_ns_per_m: Expr


def _stepped(rows: Iterable[Iterable[Expr]], x: Expr, v: Expr, push: Expr) -> list[Expr]:
    """Return position and velocity of a tool after a step of `tool_step`: its rows times (x, v, push)."""
    return [of_x * x + of_v * v + of_push * push for of_x, of_v, of_push in rows]


_ROUNDING = 1e-6
"""Share of a sample by which a step that ends at a sample may seem to end after it, by rounding."""


@dataclass(frozen=True)
class EngineEffect(SceneEffect, keys=SimulationEffect, rank=155, role="environment"):
    """An engine, its tool with the one-sided contact at x = 0, rigid or a spring and damper, and the coupling."""

    tool: Simulation
    state: ToolState
    gains: ToolGains
    dropped_share: float
    seed: int

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        """Build it; tool and engine are those of [simulation]: the heaviest tool, the stiffest contact."""
        tool, faults = problem.end, []
        if not isinstance(tool, Simulation):
            faults.append((place, "is listed and [simulation] is missing; give both, or neither"))
        if table.stiffness_n_per_m is None:
            message = "is missing; give a stiffness, or simulate a coupling file (avc recommend P --out FILE)"
            faults.append((f"{place}.stiffness_n_per_m", message))
        if not isinstance(tool, Simulation) or table.stiffness_n_per_m is None:
            raise InputError([Fault(problem.name or "problem", None, key, message) for key, message in faults])
        stiffest = tool.contact_stiffness_n_per_m[1]
        contact = stiffest if table.contact_stiffness_n_per_m is None else table.contact_stiffness_n_per_m
        gains = ToolGains(table.stiffness_n_per_m, table.damping_ns_per_m, table.local_damping_ns_per_m)
        return cls(tool, tool_states(tool, contact)[-1], gains, table.dropped_share, table.seed)

    @property
    def _numbers(self) -> dict[str, float]:
        """Gains, tool and contact; an immovable mass and a rigid contact are infinite."""
        gains, state = self.gains, self.state
        return {
            "coupling_n_per_m": gains.stiffness_n_per_m,
            "coupling_ns_per_m": gains.damping_ns_per_m,
            "local_ns_per_m": gains.local_damping_ns_per_m,
            "tool_kg": state.mass_kg,
            "tool_ns_per_m": state.damping_ns_per_m,
            "contact_n_per_m": state.contact_stiffness_n_per_m,
            "contact_ns_per_m": state.contact_damping_ns_per_m,
        }

    @property
    def numbers(self) -> FloatArray:
        return np.array([*self._numbers.values()])

    def sample(self, tick: Tick) -> None:
        """Add engine and tool: at each step the tool moves, and K and B pull the device to what it receives.

        A step between two samples reads the sample before. What the device receives is the tool's state or the force on
        it.
        """
        numbers = _EngineNumbers(**{name: tick.parameter(name) for name in self._numbers})
        k, b = numbers.coupling_n_per_m, numbers.coupling_ns_per_m
        moves = not math.isinf(self.state.mass_kg)
        start_m = min(tick.start_m, 0.0) if moves else 0.0
        place = tick.position
        last, older = tick.state("engine_last_m", tick.start_m), tick.state("engine_older_m", tick.start_m)
        x, v = tick.state("tool_m", start_m), tick.state("tool_m_per_s")
        t = tick.sample_time_s
        time_s = tick.input("engine_step_s", lambda samples, run: self._steps(samples, run, t)[0])
        late = tick.input("engine_between_samples", lambda samples, run: self._steps(samples, run, t)[1])
        steps = time_s > 0
        period = ca.if_else(steps, time_s, 1.0)
        position = ca.if_else(late, last, place)
        speed = ca.if_else(late, last - older, place - last) / t
        after = (x, v)
        if moves:
            after = self._tool_after((x, v), period, (position, speed), numbers)
        output = self._output(tick, steps, (x, v), after, k * (position - x) + b * (speed - v), start_m)
        rate = (place - last) / t
        gets_force = self.tool.exchange == "held-force"
        force = output[0] if gets_force else k * (place - output[0]) + b * (rate - output[1])
        tick.command = force + numbers.local_ns_per_m * rate
        tick.trace("tool_m", x)
        for name, value, before in (("tool_m", after[0], x), ("tool_m_per_s", after[1], v)):
            tick.follow(name, ca.if_else(steps, value, before))
        tick.follow("engine_last_m", place)
        tick.follow("engine_older_m", last)

    def _tool_after(
        self, tool: tuple[Expr, Expr], period_s: Expr, device: tuple[Expr, Expr], numbers: _EngineNumbers
    ) -> tuple[Expr, Expr]:
        """Return position and velocity of the tool after a step, as in `loops.engine`, with a one-sided contact."""
        x, v = tool
        position, speed = device
        k, b = numbers.coupling_n_per_m, numbers.coupling_ns_per_m
        mass, drag = numbers.tool_kg, numbers.tool_ns_per_m
        rigid = numbers.contact_n_per_m > RIGID_N_PER_M
        integrator = self.tool.integrator
        t = period_s / self.tool.substeps
        implicit_k, implicit_b = self.tool.implicit_part(k, b)
        push = k * position + b * speed - (k - implicit_k) * x - (b - implicit_b) * v
        k_c = ca.if_else(rigid, 0, numbers.contact_n_per_m)
        b_c = ca.if_else(rigid, 0, numbers.contact_ns_per_m)
        free = tool_step(integrator, t, mass, drag + implicit_b, implicit_k)
        touching = tool_step(integrator, t, mass, drag + implicit_b + b_c, implicit_k + k_c)
        for _ in range(self.tool.substeps):
            place, rate = _stepped(free, x, v, push)
            face, slower = _stepped(touching, x, v, push)
            presses = ca.logic_and(x > 0, slower < rate)
            place, rate = ca.if_else(presses, face, place), ca.if_else(presses, slower, rate)
            stops = ca.logic_and(rigid, place >= 0)  # what rests there keeps no speed into it
            # Where the new velocity moves the tool it ends at the face.
            at_face = ca.fmin(rate, 0) if integrator in ("explicit", "exact") else -x / t
            x, v = ca.if_else(stops, 0, place), ca.if_else(stops, at_face, rate)
        return x, v

    def _output(
        self, tick: Tick, steps: Expr, before: tuple[Expr, Expr], after: tuple[Expr, Expr], force: Expr, start_m: float
    ) -> list[Expr]:
        """Return what the device receives now of the engine: the force on the tool, or its position and velocity.

        At each step the newest is taken, `before` or `after` the step by the exchange, and comes late by the queued
        steps.
        """
        exchange = self.tool.exchange
        fresh = [force] if exchange == "held-force" else list(after if exchange == "ahead" else before)
        starts = [0.0] if exchange == "held-force" else [start_m, 0.0]
        for late in range(self.tool.queued + 1):
            for row, value in enumerate(fresh):
                name = f"handed_{late}_{row}"
                held = tick.state(name, starts[row])
                now = ca.if_else(steps, value, held)
                tick.follow(name, now)
                # The stored value is late by one more step.
                fresh[row] = now if late == self.tool.queued else held
        return fresh

    def _steps(self, samples: int, run: int, sample_time_s: float) -> FloatArray:
        """Return lengths (0 if missed) and lateness of the steps at the first samples after them, (2, samples)."""
        low, high = self.tool.step_s
        count = math.ceil(samples * sample_time_s / low) + 1
        share = np.random.default_rng((self.seed, run, 4)).random(count) if high > low else np.zeros(count)
        lengths = low + (high - low) * share
        # A clock of the engine's own has any phase. The device's loop starts its steps at samples.
        phase = 0.0 if self.tool.clock == "device" else np.random.default_rng((self.seed, run, 5)).random()
        ends = phase + np.concatenate([[0.0], np.cumsum(lengths[:-1])]) / sample_time_s
        first = np.ceil(ends - _ROUNDING).astype(int)
        inside = first < samples
        runs = inside & (np.random.default_rng((self.seed, run, 3)).random(count) >= self.dropped_share)
        table = np.zeros((2, samples))
        table[0, first[runs]] = lengths[runs]
        table[1, first[inside]] = (first - ends > _ROUNDING)[inside]
        return table
