"""A whole coupling, or a stated law, as programs of one precision: from position to force, by the scene's effects."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from avc_casadi import InputError
from avc_casadi.model.effects import (
    DelayEffect,
    DetentEffect,
    EncoderEffect,
    HandEffect,
    LawEffect,
    SaturationEffect,
    WallEffect,
)
from avc_casadi.simulation.compile import build_effects
from avc_casadi.simulation.contact import Environment, coupling_parameters, wall_force
from avc_casadi.simulation.effects.base import SceneEffect
from avc_casadi.simulation.effects.computation import Adaptation, Estimator, Guard, Observer, SceneStateFeedback
from avc_casadi.simulation.effects.environment import Detents, SceneLaw, SceneWall
from avc_casadi.simulation.effects.interface import Delay, Saturation
from avc_casadi.simulation.emit import SINGLE, FloatProgram, Precision
from avc_casadi.simulation.tick import Tick
from avc_hardware.codegen.tick_program import GAINS, AnyTable

if TYPE_CHECKING:
    from collections.abc import Sequence

    from avc_casadi.coupling import Coupling
    from avc_casadi.model.effects import Effect
    from avc_casadi.model.problem import Problem


@dataclass(frozen=True)
class CouplingProgram:
    """One tick of a coupling."""

    states: tuple[str, ...]
    initial: tuple[tuple[float, float, float], ...]
    before: FloatProgram | None
    after: FloatProgram
    asked: tuple[str, ...]  # states that are the force of the sample before, as it was given


def coupling_program(coupling: Coupling, precision: Precision = SINGLE) -> CouplingProgram:
    """Build the program of a coupling at its own sample time, with states that begin at rest wherever the device is."""
    wall = coupling.wall
    if not wall.damping_ns_per_m + wall.stiffness_n_per_m > 0:
        raise InputError.of(
            "gives no force: damping and stiffness are 0; allowed: one of them above 0",
            file=coupling.problem.name,
            key="environment",
        )
    effects = _computer(coupling)
    return _program([_CouplingSample(coupling, effects, start_m) for start_m in _STARTS], precision)


def law_program(problem: Problem, precision: Precision = SINGLE) -> CouplingProgram:
    """Return the program of the law of a problem at its own sample time, with detents and force limit."""
    listed: list[Effect] = [HandEffect(), LawEffect()]
    if problem.detent is not None:
        listed.append(DetentEffect())
    if problem.device.max_force_n is not None:
        listed.append(SaturationEffect())
    built = build_effects(problem.changed(scene={"effects": tuple(listed)}))
    effects = tuple(effect for effect in built if isinstance(effect, SceneLaw | Detents | Saturation))
    return _program([_LawSample(problem, effects, start_m) for start_m in _STARTS], precision)


_STARTS = (0.0, 1.0, -1.0)
"""Positions of a device at rest from which the dependence of its states on the position is read."""


def _program(samples: Sequence[_Sample], precision: Precision) -> CouplingProgram:
    """Return the program of a sample that is built for a device at rest at each of `_STARTS`."""
    starts = zip(*([slot.initial for slot in built.tick.states] for built in samples), strict=True)
    initial = tuple((middle, high, low) for middle, high, low in starts)
    return samples[0].program(initial, precision)


def _computer(coupling: Coupling) -> tuple[SceneEffect, ...]:
    """Select what runs on the control computer, by the rules of scenes, in the order of the loop."""
    problem, constant = coupling.problem, coupling.table.constant
    device = problem.device
    listed: list[Effect] = [HandEffect(), WallEffect(), *coupling.runtime.effects(constant=constant)]
    listed_by_scene = {effect.kind: effect for effect in problem.scene.effects}
    if problem.detent is not None:
        listed.append(DetentEffect())
    if device.encoder_resolution_m or "encoder" in listed_by_scene:
        listed.append(listed_by_scene.get("encoder", EncoderEffect()))
    remembers = not constant or coupling.runtime.observer_mass_kg is not None or coupling.runtime.guard is not None
    if device.delay_samples and remembers:  # otherwise the force that acts now is unused
        listed.append(DelayEffect())
    if coupling.max_force_n is not None:
        listed.append(SaturationEffect())
    built = build_effects(problem.changed(scene={"effects": tuple(listed)}))
    kinds = (Observer, SceneStateFeedback, Estimator, Adaptation, SceneWall, Detents, Guard, Saturation, Delay)
    return tuple(effect for effect in built if isinstance(effect, kinds))


class _Sample(ABC):
    """One sample as expressions, with its cuts."""

    tick: Tick
    measured: Any
    command: Any
    frequency: Any = None
    seen: Any = None
    cut: Any = None
    wanted: Sequence[Any] = ()
    keeps_given: bool = True

    @abstractmethod
    def _parameters(self) -> list[float]:
        """Return the values of the tick's parameters, in its order."""

    def program(self, initial: tuple[tuple[float, float, float], ...], precision: Precision) -> CouplingProgram:
        """Return the sample as programs, cut where a table is read; `initial` is its states by where it starts."""
        import casadi as ca  # noqa: PLC0415

        tick = self.tick
        names = tuple(slot.name for slot in tick.states)
        successors = dict(zip(names, map(ca.SX, tick.successors()), strict=True))

        def part(name: str, given: dict[str, Any], made: dict[str, Any], following: tuple[str, ...]) -> FloatProgram:
            results = [*map(ca.SX, made.values()), *(successors[state] for state in following)]
            function = ca.Function(
                name,
                [*given.values(), *(slot.symbol for slot in tick.states)],
                ca.substitute(results, [slot.symbol for slot in tick.parameters], self._parameters()),
                [*given, *(f"state_{state}" for state in names)],
                [*(f"out_{output}" for output in made), *(f"next_{state}" for state in following)],
            )
            return FloatProgram(function, precision)

        measured = {"position_m": self.measured}
        forces = {"command_n": self.command, "force_n": tick.command if tick.undelayed is None else tick.undelayed}
        force = ca.SX(forces["force_n"])
        asked = tuple(name for name in names if self.keeps_given and ca.is_equal(successors[name], force))
        if self.frequency is None:
            after = part("after", measured, forces, tuple(name for name in names if name not in asked))
            return CouplingProgram(names, initial, None, after, asked)
        read = ca.vertcat(self.cut, *self.wanted)
        early = tuple(name for name in names if not ca.depends_on(successors[name], read))
        late = tuple(name for name in names if name not in early + asked)
        before = part("before", measured, {"frequency_hz": self.frequency, "seen_m": self.seen}, early)
        wanted = {f"wanted_{name}": symbol for name, symbol in zip(GAINS, self.wanted, strict=True)}
        after = part("after", {"seen_m": self.cut} | wanted, forces, late)
        return CouplingProgram(names, initial, before, after, asked)


class _CouplingSample(_Sample):
    """One sample of a coupling."""

    def __init__(self, coupling: Coupling, effects: tuple[SceneEffect, ...], start_m: float) -> None:
        """Build one sample of a coupling as expressions, from a device at rest at `start_m`; gains are inputs."""
        import casadi as ca  # noqa: PLC0415

        table, constant = coupling.table, coupling.table.constant
        self.coupling = coupling
        tick = self.tick = Tick(coupling.sample_time_s, start_m)
        self.measured = ca.SX.sym("position_m")
        tick.position = self.measured
        self.wanted = [ca.SX.sym(f"wanted_{name}") for name in GAINS]
        looked: Any = AnyTable(table.rest_hz, table.rest_stiffness_n_per_m, self.wanted)
        wall = next(effect.environment for effect in effects if isinstance(effect, SceneWall))
        environment = replace(wall, clips_last=coupling.contact == "clip-last")
        for effect in effects:
            if isinstance(effect, Adaptation):
                replace(effect, gain_table=looked).sample(tick)
            elif isinstance(effect, Observer | SceneStateFeedback | Estimator):
                effect.sample(tick)
        self.seen = tick.position
        self.cut = tick.position = self.seen if constant else ca.SX.sym("seen_m")
        tick.command = wall_force(tick, environment, rigid=False, damped=coupling.structure == "damped")
        self.command = tick.command
        for effect in effects:
            if isinstance(effect, Detents | Guard | Saturation | Delay):
                effect.sample(tick)
                self.command = tick.command if isinstance(effect, Detents | Guard) else self.command
        for settle in tick.at_end:
            settle()
        self.frequency = looked.frequency[0] if looked.frequency else None

    def _parameters(self) -> list[float]:
        """Return the numbers of a coupling with constant gains and of its observer, in the order of its sample."""
        coupling, wall = self.coupling, self.coupling.wall
        gains = coupling.table.at_rest
        environment = Environment(wall.stiffness_n_per_m, wall.damping_ns_per_m, one_sided=True)
        rate = 1.0 / coupling.sample_time_s
        memory, compliance, series = coupling_parameters(
            gains.damping_ns_per_m, gains.stiffness_n_per_m, environment, rate
        ).tolist()
        known = {
            "coupling_memory_s": memory,
            "coupling_compliance_m_per_n": compliance,
            "series_stiffness_n_per_m": series,
            "contact_damping_ns_per_m": gains.contact_damping_ns_per_m,
        }
        feedback = coupling.runtime.state_feedback
        given = [] if feedback is None else feedback.numbers().tolist()
        # Effects before the wall have added their parameters before the wall's.
        return [*given, *(known[slot.name] for slot in self.tick.parameters[len(given) :])]


class _LawSample(_Sample):
    """One sample of a stated law."""

    keeps_given = False  # a force that is kept between two samples of a slower law is the law's, before any fade

    def __init__(self, problem: Problem, effects: tuple[SceneEffect, ...], start_m: float) -> None:
        """Build one sample of a stated law as expressions, from a device at rest at `start_m`."""
        import casadi as ca  # noqa: PLC0415

        tick = self.tick = Tick(problem.device.sample_time_s, start_m)
        self.measured = tick.position = ca.SX.sym("position_m")
        for effect in effects:
            effect.sample(tick)
            self.command = self.command if isinstance(effect, Saturation) else tick.command
        for settle in tick.at_end:
            settle()

    def _parameters(self) -> list[float]:
        """Return none: the numbers of a law stand in its expressions."""
        return []
