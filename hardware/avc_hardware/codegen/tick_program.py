"""The firmware's control tick: the scene's own effects with gains and wall as inputs, as single-precision programs.

A scene reads its gains from a table that is part of the expression; a device receives table and wall by message. So the
tick is cut at the table: `estimate` gives the frequency of the look-up, `couple` takes the gains, and `guard` acts on
the force. The contact law is an input of `couple`; for each law there is a specialised program, and one for constant
gains without adaptation: these run on a processor. All come from the code of scenes.

Constants that depend on the figures are found by building the same expressions for two sets of figures without any
round number: where the constants differ they go into an array, one for each part, in place of the literal, so that an
image can be patched for another device.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from avc_casadi import UnsupportedError
from avc_casadi._util.arrays import Float32Array
from avc_casadi._util.interrupt import HeldInterrupt
from avc_casadi.simulation.contact import Environment, wall_force
from avc_casadi.simulation.effects.computation import Adaptation, Estimator, Guard
from avc_casadi.simulation.runtime.adaptation import AdaptationSettings, HoldSettings
from avc_casadi.simulation.runtime.guard import GuardSettings
from avc_casadi.simulation.runtime.signal import EstimatorSettings
from avc_casadi.simulation.tick import AdaptedGains, Tick
from avc_hardware.codegen.figures import RuntimeFigures
from avc_hardware.codegen.float_program import FloatProgram

LAWS = {"gated": False, "clips": True}
"""Whether the contact law of each name is clip-last."""
# In the order of `Environment`.
_WALL = ("wall_stiffness_n_per_m", "wall_damping_ns_per_m")
GAINS = ("damping_ns_per_m", "stiffness_n_per_m", "contact_damping_ns_per_m")


@dataclass(frozen=True)
class RuntimeProgram:
    """One part of the tick: (states, inputs) -> (next states, outputs), all scalars.

    Attributes:
        name: of the part.
        states: names.
        inputs: names.
        outputs: names.
        initial: state before the first tick with the device at 0, at +1 and at -1, which identifies the positions.
        program: inputs then states -> outputs then next states.
    """

    name: str
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    initial: tuple[tuple[float, float, float], ...]
    program: FloatProgram

    def start(self, position_m: Float32Array) -> dict[str, Float32Array]:
        """Return the states of a device that has always been at rest at a position, each of its shape."""
        return states_at_rest(self.states, self.initial, position_m)

    def __call__(
        self, states: dict[str, Float32Array], inputs: dict[str, Any]
    ) -> tuple[dict[str, Float32Array], dict[str, Float32Array]]:
        """Run one tick in single precision; returns the next states and the outputs."""
        results = self.program(*(inputs[name] for name in self.inputs), *(states[name] for name in self.states))
        outputs = dict(zip(self.outputs, results, strict=False))
        following = dict(zip(self.states, results[len(self.outputs) :], strict=True))
        return following, outputs


def states_at_rest(
    states: tuple[str, ...], initial: tuple[tuple[float, float, float], ...], position_m: NDArray[Any]
) -> dict[str, NDArray[Any]]:
    """Return the states of a device that has always been at rest at a position, each of its shape.

    Args:
        states: names.
        initial: of each with the device at 0, at +1 and at -1.
        position_m: any shape; its precision is that of the states.
    """
    import numpy as np  # noqa: PLC0415

    zero = np.zeros_like(position_m)
    found = {}
    for name, (middle, high, low) in zip(states, initial, strict=True):
        value = zero + zero.dtype.type(middle)
        if (high, low) == (middle + 1, middle - 1):
            value = position_m
        elif (high, low) == (middle + 1, middle):
            value = np.where(position_m > 0, position_m, zero)
        found[name] = value
    return found


@dataclass(frozen=True)
class _AnyWall(Environment):
    """A wall with symbolic parameters and contact law: it may have a damper."""

    @property
    def present(self) -> bool:
        return True

    @property
    def damped(self) -> bool:
        return True


@dataclass
class AnyTable:
    """A symbolic gain table: the look-up is an input."""

    rest_hz: Any
    rest_stiffness_n_per_m: Any
    wanted: list[Any]
    frequency: list[Any] = field(default_factory=list)

    def expressions(self, frequency_hz: Any) -> list[Any]:
        """Record the frequency of the look-up."""
        self.frequency.append(frequency_hz)
        return self.wanted


def runtime_programs(figures: RuntimeFigures) -> tuple[RuntimeProgram, ...]:
    """Return the parts estimate, couple, guard; of each law couple_LAW and steady_LAW."""
    parts = []
    # CasADi calls Python for shapes while it builds an expression, and ignores exceptions then.
    with HeldInterrupt():
        ticks = [_ticks(figures, start) for start in (0.0, 1.0, -1.0)]
        for name, (tick, inputs, outputs) in ticks[0].items():
            starts = [[slot.initial for slot in other[name][0].states] for other in ticks]
            parts.append(_program(name, tick, inputs, outputs, list(zip(*starts, strict=True))))
    return tuple(parts)


_Part = tuple[Tick, dict[str, Any], dict[str, Any]]


def _ticks(figures: RuntimeFigures, start_m: float) -> dict[str, _Part]:
    """Build each part by the scene's effects; returns its tick, inputs and outputs."""
    import casadi as ca  # noqa: PLC0415

    def symbols(*names: str) -> dict[str, Any]:
        return {name: ca.SX.sym(name) for name in names}

    time = figures.sample_time_s
    estimate = Tick(time, start_m)
    seen = symbols("position_m", "rest_hz")
    wanted = symbols(*(f"wanted_{name}" for name in GAINS))
    rest = symbols("rest_stiffness_n_per_m")
    table: Any = AnyTable(seen["rest_hz"], rest["rest_stiffness_n_per_m"], list(wanted.values()))
    estimate.position = seen["position_m"]
    settings = EstimatorSettings.for_encoder(figures.metres_per_count, time, figures.hand_m_per_unit)
    with estimate.owned_by("estimate"):
        Estimator(figures.estimator, settings).sample(estimate)
        changing = AdaptationSettings(figures.slew_per_s, figures.passive)
        adaptation = Adaptation(HoldSettings(figures.hold_s), changing, table)
        adaptation.sample(estimate)
    found = {
        "estimate_hz": estimate.frequency_hz,
        "valid": estimate.frequency_valid,
        "frequency_hz": table.frequency[0],
    }

    guard = Tick(time, start_m)
    pushed = symbols("position_m", "force_n", "stored_j")
    guard.position, guard.command, guard.environment_energy_j = pushed.values()
    Guard("passivity-controller", GuardSettings(figures.guard_damping_ns_per_m)).sample(guard)
    for settle in guard.at_end:
        settle()
    guarded = {"guarded_n": guard.command, "reserve_j": guard.traces["guard_reserve_j"]}

    def couple(law: bool | None) -> _Part:
        return _couple(adaptation, estimate, wanted | rest, clips_last=law)

    parts = {"estimate": (estimate, seen, found), "couple": couple(None), "guard": (guard, pushed, guarded)}
    for name, law in LAWS.items():
        parts |= {f"couple_{name}": couple(law), f"steady_{name}": _steady(time, start_m, clips_last=law)}
    return parts


def _couple(adaptation: Adaptation, estimate: Tick, gains: dict[str, Any], *, clips_last: bool | None) -> _Part:
    """Build coupling and wall with varying gains; a law of None is an input."""
    import casadi as ca  # noqa: PLC0415

    couple = Tick(estimate.sample_time_s, estimate.start_m, adapt=estimate.adapt)
    # The adaptation keeps its states in the tick that it was made for: it is built anew for this one.
    couple.position = ca.SX.sym("position_m")
    couple.frequency_hz = couple.frequency_valid = ca.SX(0)
    hold_states = len(couple.states)
    adaptation.sample(couple)
    del couple.states[hold_states:]
    wall: dict[str, Any] = {name: ca.SX.sym(name) for name in _WALL}
    # With constant gains nothing relaxes out of contact: their scene has no adaptation.
    relaxes = {"relaxes": ca.SX.sym("relaxes")}
    laws = {"clips_last": ca.SX.sym("clips_last")} if clips_last is None else {}
    given = {"position_m": couple.position} | gains | wall | relaxes | laws
    adapt: Any = couple.adapt

    def adapted(deflection: Any, one_sided: bool) -> Any:
        found = adapt(deflection, one_sided)
        return replace(found, touching=ca.if_else(relaxes["relaxes"], found.touching, 1))

    couple.adapt = adapted
    law = laws.get("clips_last", clips_last)
    wall_stiffness, wall_damping = wall.values()
    environment = _AnyWall(wall_stiffness, wall_damping, one_sided=True, clips_last=law)
    couple.command = wall_force(couple, environment, rigid=False, damped=True)
    for settle in couple.at_end:
        settle()
    made = {"force_n": couple.command, "tool_m": couple.traces["tool_m"]}
    made |= {name: couple.traces[name] for name in (*GAINS, "anchor_m")}
    made["stored_j"] = couple.environment_energy_j + couple.coupling_energy_j
    return couple, given, made


def _steady(sample_time_s: float, start_m: float, *, clips_last: bool) -> _Part:
    """Build coupling and wall with constant gains."""
    import casadi as ca  # noqa: PLC0415

    gains: dict[str, Any] = {f"wanted_{name}": ca.SX.sym(name) for name in GAINS}
    wall: dict[str, Any] = {name: ca.SX.sym(name) for name in _WALL}
    tick = Tick(sample_time_s, start_m)
    tick.position = ca.SX.sym("position_m")
    damping, stiffness, contact_damping = gains.values()
    tick.adapt = lambda *_, **__: AdaptedGains(damping, stiffness, contact_damping, anchor_m=0, touching=1)
    wall_stiffness, wall_damping = wall.values()
    environment = _AnyWall(wall_stiffness, wall_damping, one_sided=True, clips_last=clips_last)
    force = wall_force(tick, environment, rigid=False, damped=True)
    made = {
        "force_n": force,
        "tool_m": tick.traces["tool_m"],
        "stored_j": tick.environment_energy_j + tick.coupling_energy_j,
    }
    return tick, {"position_m": tick.position} | gains | wall, made


def _program(
    name: str, tick: Tick, inputs: dict[str, Any], outputs: dict[str, Any], initial: list[tuple[float, ...]]
) -> RuntimeProgram:
    import casadi as ca  # noqa: PLC0415

    states = [slot.name for slot in tick.states]
    results = [ca.SX(value) for value in (*outputs.values(), *tick.successors())]
    function = ca.Function(
        name,
        [*inputs.values(), *(slot.symbol for slot in tick.states)],
        results,
        [*inputs, *(f"state_{state}" for state in states)],
        [*(f"out_{output}" for output in outputs), *(f"next_{state}" for state in states)],
    )
    return RuntimeProgram(
        name=name,
        states=tuple(states),
        inputs=tuple(inputs),
        outputs=tuple(outputs),
        initial=tuple((row[0], row[1], row[2]) for row in initial),
        program=FloatProgram(function),
    )


SAMPLE_TIMES_S = (5e-5, 1 / 300)
"""Range of sample times of one program: below, a tick has too few cycles; above, the estimator has fewer resonators."""

# No two constants of the tick coincide by chance at these: T, encoder step, hold, slew, guard, reach of the handle.
_GENERIC = (
    (1.03719e-3, 5.3713e-5, 0.21371, 19.3717, 2.17137, 0.87731),
    (0.71933e-3, 8.1371e-5, 0.17933, 23.1733, 3.31973, 1.13937),
)


@dataclass(frozen=True)
class Template:
    """A part of the tick with its figures left open.

    Attributes:
        part: the program, with placeholder figures.
        constants: places in the program of the numbers of the array.
        starts: indices of the states whose initial values follow in the array.
    """

    part: RuntimeProgram
    constants: tuple[int, ...]
    starts: tuple[int, ...]

    @property
    def size(self) -> int:
        """Length of the array."""
        return len(self.constants) + len(self.starts)

    def numbers(self, part: RuntimeProgram) -> Float32Array | None:
        """Return the array of a program for given figures, shape (size,); None where its form differs."""
        found = self.part.program.constants_of(part.program)
        if found is None or part.states != self.part.states:
            return None
        fixed = self.part.program.constants_of(self.part.program) or {}
        if any(found[place] != value for place, value in fixed.items() if place not in self.constants):
            return None
        starts = [part.initial[index][0] for index in self.starts]
        return np.array([*(found[place] for place in self.constants), *starts], dtype=np.float32)


def templates(figures: RuntimeFigures) -> tuple[Template, ...]:
    """Return the parts that run on a processor, for any figures."""
    return _templates(figures.estimator, figures.slew_per_s is not None, figures.passive)


def _run(figures: RuntimeFigures) -> list[RuntimeProgram]:
    return [part for part in runtime_programs(figures) if part.name != "couple"]


@functools.lru_cache(maxsize=8)
def _templates(estimator: str, slews: bool, passive: bool) -> tuple[Template, ...]:
    parts = [
        _run(RuntimeFigures(time, step, estimator, hold, slew if slews else None, passive, guard, reach))
        for time, step, hold, slew, guard, reach in _GENERIC
    ]
    made = []
    for one, other in zip(*parts, strict=True):
        own, its = one.program.constants_of(one.program), one.program.constants_of(other.program)
        if own is None or its is None:
            raise UnsupportedError(f"the figures change the form of {one.name}, not its numbers alone")
        constants = tuple(sorted(place for place in own if own[place] != its[place]))
        pairs = enumerate(zip(one.initial, other.initial, strict=True))
        starts = tuple(index for index, (first, second) in pairs if first[0] != second[0])
        made.append(Template(one, constants, starts))
    return tuple(made)


def constants(figures: RuntimeFigures) -> dict[str, Float32Array]:
    """Return the array of each part by its symbol in an image.

    Raises:
        UnsupportedError: a sample time, or other figures, that would need another program.
    """
    low, high = SAMPLE_TIMES_S
    time_s = figures.sample_time_s
    if not low * (1 - 1e-9) <= time_s <= high * (1 + 1e-9):
        raise UnsupportedError(
            f"the packaged firmware has no program for a sample time of {time_s:g} s; allowed: {low:g} to {high:.6g} "
            "s; for others export the coupling as C: avc export",
            key="device.sample_time_s",
        )
    found = {}
    for template, part in zip(templates(figures), _run(figures), strict=True):
        numbers = template.numbers(part)
        if numbers is None:
            raise UnsupportedError(
                f"{figures} change the form of the tick's part {part.name}; change one of them by a thousandth, or "
                "export the coupling as C: avc export"
            )
        found[f"avc_{part.name}_constants"] = numbers
    return found
