"""The firmware's control tick: the scene's effects, cut where a device looks its gains up, in single precision."""

from __future__ import annotations

import functools
import struct
import zlib
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from avc_casadi import UnsupportedError
from avc_casadi._util.arrays import Float32Array
from avc_casadi._util.interrupt import DeferredInterrupt
from avc_casadi.simulation.contact import Environment, wall_force
from avc_casadi.simulation.effects.computation import Adaptation, Estimator, Guard
from avc_casadi.simulation.emit import SINGLE, FloatProgram, Precision
from avc_casadi.simulation.runtime.adaptation import AdaptationSettings
from avc_casadi.simulation.runtime.estimators import EstimatorSettings
from avc_casadi.simulation.tick import Tick
from avc_hardware.codegen.figures import Config, RuntimeFigures

GAINS = ("damping_ns_per_m", "stiffness_n_per_m", "contact_damping_ns_per_m")
SAMPLE_TIMES_S = (5e-5, 0.02)
"""Range of sample times: below, a tick has too few cycles; above, the watchdog is fed too late."""
_ROUNDING = 1e-9
"""Share by which a sample time may miss this range by rounding."""
_FIGURES = (
    "sample_time_s",
    "rate_hz",
    "hold_s",
    "slew_per_s",
    "guard_damping_ns_per_m",
    "floor_m_per_s",
    "fastest_m_per_s",
)

# With the device at 0, at +1 and at -1, which identifies the positions; or the name of a number.
Start = tuple[float, float, float] | str


class _AnyEncoder(EstimatorSettings):
    """Thresholds that are symbols; above `SLOWEST_ESTIMATE_S` no coupling has gains that follow the estimate."""

    def __post_init__(self) -> None:
        pass

    def top_hz(self, sample_time_s: float) -> float:
        del sample_time_s
        return self.high_hz


@dataclass
class _AnyTick(Tick):
    """A tick at any rate, a symbol of its own: x / (1/T) would become x T, with other bits than the scene's."""

    rate_hz: Any = None

    @property
    def rate_gain_per_s(self) -> Any:
        return self.rate_hz


@dataclass(frozen=True)
class RuntimeProgram:
    """One part of the tick: (inputs, numbers, states) -> (outputs, next states), all scalars."""

    name: str
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    initial: tuple[Start, ...]
    program: FloatProgram


@dataclass(frozen=True)
class _AnyWall(Environment):
    """A wall with symbolic parameters: it may have a damper."""

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


@functools.lru_cache(maxsize=8)
def tick_programs(estimator: str, passive: bool) -> tuple[tuple[RuntimeProgram, ...], Any]:
    """Return the firmware's parts estimate, guard, couple_gated, couple_clips as C programs; and figures -> numbers.

    What depends on a device's figures alone is computed once, as numbers of its configuration.
    """
    import casadi as ca  # noqa: PLC0415

    # CasADi calls Python for shapes while it builds an expression, and ignores exceptions then.
    with DeferredInterrupt():
        figures = {name: ca.SX.sym(name) for name in _FIGURES}
        ticks = [_ticks(figures, estimator, passive, start) for start in (0.0, 1.0, -1.0)]
        parts: list[_PlacedPart] = []
        whole: list[Any] = []
        for name, part in ticks[0].items():
            starts = list(zip(*([slot.initial for slot in built[name].tick.states] for built in ticks), strict=True))
            symbolic = [ca.SX(start[0]) for start in starts if isinstance(start[0], ca.SX)]
            values = [ca.SX(value) for value in (*part.outputs.values(), *part.tick.successors())]
            parts.append(_PlacedPart(name, part, starts, first=len(whole), count=len(values)))
            whole += [*values, *symbolic]
        rest, symbols, known = ca.extract_parametric(
            ca.vertcat(*whole), ca.vertcat(*figures.values()), {"extract_trivial": True}
        )
        # The same number once, whoever needs it.
        shared = {str(value): symbol for value, symbol in zip(reversed(known), reversed(symbols), strict=True)}
        rest = ca.substitute(rest, ca.vertcat(*symbols), ca.vertcat(*(shared[str(value)] for value in known)))
        once = {str(value): value for value in known}
        numbers = ca.Function("numbers", list(figures.values()), [ca.vertcat(*once.values())])
        made = [_program(placed, ca.vertsplit(rest), [shared[text] for text in once]) for placed in parts]
    return tuple(made), numbers


@dataclass(frozen=True)
class _Part:
    """A part of the tick as expressions."""

    tick: Tick
    inputs: dict[str, Any]
    outputs: dict[str, Any]


@dataclass(frozen=True)
class _PlacedPart:
    """A part of the tick, and where its values stand among those of all: outputs, next states, then initial states."""

    name: str
    part: _Part
    starts: list[tuple[Any, ...]]
    """Initial states with the device at 0, at +1 and at -1."""
    first: int
    count: int


def _program(placed: _PlacedPart, values: list[Any], numbers: list[Any]) -> RuntimeProgram:
    """Return a part from its place among the values of all."""
    import casadi as ca  # noqa: PLC0415

    tick = placed.part.tick
    inputs = placed.part.inputs
    outputs = placed.part.outputs
    last = placed.first + placed.count
    states = tuple(slot.name for slot in tick.states)
    names = {symbol.__hash__(): f"number_{index}" for index, symbol in enumerate(numbers)}
    begun = iter(values[last:])
    initial = tuple(names[next(begun).__hash__()] if isinstance(start[0], ca.SX) else start for start in placed.starts)
    function = ca.Function(
        placed.name,
        [*inputs.values(), *numbers, *(slot.symbol for slot in tick.states)],
        values[placed.first : last],
        [*inputs, *names.values(), *(f"state_{state}" for state in states)],
        [*(f"out_{output}" for output in outputs), *(f"next_{state}" for state in states)],
    )
    return RuntimeProgram(placed.name, states, tuple(inputs), tuple(outputs), initial, FloatProgram(function))


def tick_numbers(figures: RuntimeFigures) -> Float32Array:
    """Return the numbers of a configuration; UnsupportedError for a sample time that would need another program."""
    low, high = SAMPLE_TIMES_S
    time_s = figures.sample_time_s
    if not low * (1 - _ROUNDING) <= time_s <= high * (1 + _ROUNDING):
        raise UnsupportedError(
            f"the firmware does not support a sample time of {time_s:g} s; allowed: {low:g} to {high:.6g} s; for other "
            "times export the coupling as C: avc export",
            key="device.sample_time_s",
        )
    seen = EstimatorSettings.for_encoder(figures.metres_per_count, time_s, figures.hand_m_per_unit)
    hold_s, slew_per_s, guard_damping_ns_per_m = figures.values[:3]
    _, numbers_of = tick_programs(figures.estimator, figures.passive)
    numbers = numbers_of(
        time_s,
        1 / time_s,
        hold_s,
        slew_per_s,
        guard_damping_ns_per_m,
        seen.floor_m_per_s,
        seen.fastest_m_per_s,
    )
    single: Float32Array = numbers.full().ravel().astype(np.float32)
    return single


def _ticks(figures: dict[str, Any], estimator: str, passive: bool, start_m: float) -> dict[str, _Part]:
    """Return the parts of the firmware's tick by name, built by the effects of a scene from a device at `start_m`."""
    import casadi as ca  # noqa: PLC0415

    def symbols(*names: str) -> dict[str, Any]:
        return {name: ca.SX.sym(name) for name in names}

    time, rate_hz = figures["sample_time_s"], figures["rate_hz"]
    estimate = _AnyTick(time, start_m, rate_hz=rate_hz)
    seen = symbols("position_m", "rest_hz")
    wanted = symbols(*(f"wanted_{name}" for name in GAINS))
    rest = symbols("rest_stiffness_n_per_m")
    table: Any = AnyTable(seen["rest_hz"], rest["rest_stiffness_n_per_m"], list(wanted.values()))
    estimate.position = seen["position_m"]
    settings = _AnyEncoder(floor_m_per_s=figures["floor_m_per_s"], fastest_m_per_s=figures["fastest_m_per_s"])
    Estimator(estimator, settings).sample(estimate)
    adaptation = Adaptation(figures["hold_s"], AdaptationSettings(figures["slew_per_s"], passive), table)
    adaptation.sample(estimate)
    estimated = {
        "estimate_hz": estimate.frequency_hz,
        "valid": estimate.frequency_valid,
        "frequency_hz": table.frequency[0],
    }

    guard = _AnyTick(time, start_m, rate_hz=rate_hz)
    pushed = symbols("position_m", "force_n", "stored_j")
    guard.position = pushed["position_m"]
    guard.command = pushed["force_n"]
    guard.environment_energy_j = pushed["stored_j"]
    Guard("passivity-controller", figures["guard_damping_ns_per_m"]).sample(guard)
    for settle in guard.at_end:
        settle()
    guarded = {"guarded_n": guard.command, "reserve_j": guard.traces["guard_reserve_j"]}

    return {
        "estimate": _Part(estimate, seen, estimated),
        "guard": _Part(guard, pushed, guarded),
        "couple_gated": _couple(adaptation, estimate, wanted | rest, clips_last=False),
        "couple_clips": _couple(adaptation, estimate, wanted | rest, clips_last=True),
    }


def _couple(adaptation: Adaptation, estimate: _AnyTick, gains: dict[str, Any], *, clips_last: bool) -> _Part:
    """Build coupling and wall with varying gains, by a contact law."""
    import casadi as ca  # noqa: PLC0415

    couple = _AnyTick(estimate.sample_time_s, estimate.start_m, adapt=estimate.adapt, rate_hz=estimate.rate_hz)
    # The adaptation keeps its states in the tick that it was made for: it is built anew for this one.
    couple.position = ca.SX.sym("position_m")
    couple.frequency_hz = couple.frequency_valid = ca.SX(0)
    hold_states = len(couple.states)
    adaptation.sample(couple)
    del couple.states[hold_states:]
    wall: dict[str, Any] = {name: ca.SX.sym(name) for name in ("wall_stiffness_n_per_m", "wall_damping_ns_per_m")}
    # With constant gains nothing relaxes out of contact: their scene has no adaptation.
    relaxes = {"relaxes": ca.SX.sym("relaxes")}
    given = {"position_m": couple.position} | gains | wall | relaxes
    adapt: Any = couple.adapt

    def adapted(deflection: Any, one_sided: bool) -> Any:
        adapted_gains = adapt(deflection, one_sided)
        return replace(adapted_gains, touching=ca.if_else(relaxes["relaxes"], adapted_gains.touching, 1))

    couple.adapt = adapted
    stiffness, damping = wall.values()
    environment = _AnyWall(stiffness, damping, one_sided=True, clips_last=clips_last)
    couple.command = wall_force(couple, environment, rigid=False, damped=True)
    for settle in couple.at_end:
        settle()
    made = {"force_n": couple.command, "tool_m": couple.traces["tool_m"]}
    made |= {name: couple.traces[name] for name in (*GAINS, "anchor_m")}
    made["stored_j"] = couple.environment_energy_j + couple.coupling_energy_j
    return _Part(couple, given, made)


_BANNER = "/* Generated from the scene's CasADi expressions when firmware is built; do not edit. */"
CONFIG = "avc_config.c"


def _function(signature: str, sentence: str, body: list[str]) -> list[str]:
    return [f"/* {sentence} */", f"static inline void {signature}", "{", *(f"    {line}" for line in body), "}", ""]


def _of_input(symbol: str) -> str:
    kind, _, rest = symbol.partition("_")
    if kind == "number":
        return f"number[{rest}]"
    return f"state->{rest}" if kind == "state" else f"in->{symbol}"


def _of_output(symbol: str) -> str:
    return f"state->{symbol[5:]}" if symbol.startswith("next_") else f"out->{symbol[4:]}"


def _prefix(part: RuntimeProgram) -> str:
    """Return what names in C begin with: by either contact law a coupling has the same types."""
    return f"avc_{part.name.partition('_')[0]}"


def _types(part: RuntimeProgram) -> list[str]:
    lines = []
    for kind, members in {"state": part.states, "in": part.inputs, "out": part.outputs}.items():
        lines += ["typedef struct {", *(f"    float {member};" for member in members)]
        lines += [f"}} {_prefix(part)}_{kind}_t;", ""]
    return lines


def _start(part: RuntimeProgram) -> list[str]:
    body = start_lines("state", part.states, part.initial)
    numbers = ", const float *number" if any(isinstance(start, str) for start in part.initial) else ""
    sentence = "The state of a device that has always rested at a position."
    return _function(
        f"{_prefix(part)}_start({_prefix(part)}_state_t *state, float position_m{numbers})", sentence, body
    )


def _step(part: RuntimeProgram) -> list[str]:
    given = "{0}_state_t *state, const {0}_in_t *in, {0}_out_t *out, const float *number".format(_prefix(part))
    return _function(f"avc_{part.name}_step({given})", "One tick.", part.program.c_lines(_of_input, _of_output))


def tick_sources(figures: RuntimeFigures) -> dict[str, str]:
    """Return the generated sources of a firmware by file name; estimator and passive change decide."""
    estimate, guard, gated, clips = tick_programs(figures.estimator, figures.passive)[0]
    functions = [line.removeprefix("static inline ") for line in [*_start(estimate), *_step(estimate)]]
    header = [f"enum {{ AVC_NUMBERS = {len(tick_numbers(figures))} }};", "", *_types(estimate)]
    header += [*(f"{line};" for line in functions if line.startswith("void ")), ""]
    header += [*_types(guard), *_start(guard), *_step(guard)]
    # The gated law sees a penetration of 0 in a start before the wall.
    header += [*_types(clips), *_start(clips), *_step(clips), *_step(gated)]
    return {
        "avc_tick.h": "\n".join([_BANNER, "#pragma once", "", "#include <stdbool.h>", "", *header]),
        "avc_estimate.c": "\n".join([_BANNER, '#include "avc_tick.h"', "", *functions]),
    }


def packed_config(config: Config) -> bytes:
    """Return the bytes of a configuration, the checksum of the rest first.

    Raises:
        UnsupportedError: a sample time without a program.
    """
    rest = struct.pack("<15fHH", *config.limits.values, *config.figures.values)
    rest += tick_numbers(config.figures).astype("<f4").tobytes()
    return struct.pack("<I", zlib.crc32(rest)) + rest


def config_source(config: Config, *, bound: bool) -> dict[str, str]:
    """Return the configuration that a firmware starts with; one that is not bound takes any other by the link."""
    literal = SINGLE.literal
    figures = config.figures
    *floats, estimator, passive = figures.values
    numbers = [literal(float(number)) for number in tick_numbers(figures)]
    lines = [
        _BANNER,
        '#include "avc_config.h"',
        "",
        f"const bool avc_bound = {'true' if bound else 'false'};",
        "const avc_config_t avc_built_in = {",
        f"    .crc32 = {struct.unpack('<I', packed_config(config)[:4])[0]:#010x}u,",
        f"    .limits = {{{', '.join(map(literal, config.limits.values))}}},",
        f"    .figures = {{{', '.join(map(literal, floats))}, {estimator}u, {passive}u}},",
        "    .number = {",
        *(f"        {', '.join(numbers[first : first + 6])}," for first in range(0, len(numbers), 6)),
        "    },",
        "};",
        "",
    ]
    return {CONFIG: "\n".join(lines)}


def start_lines(
    pointer: str, states: tuple[str, ...], initial: tuple[Start, ...], precision: Precision = SINGLE
) -> list[str]:
    """Return the statements that set the states of a device at rest."""
    zero, lines = precision.literal(0.0), []
    for name, start in zip(states, initial, strict=True):
        if isinstance(start, str):
            value = _of_input(start)
        else:
            middle, high, low = start
            value = precision.literal(middle)
            if (high, low) == (middle + 1, middle - 1):
                value = "position_m"
            elif (high, low) == (middle + 1, middle):
                value = f"position_m > {zero} ? position_m : {zero}"
        lines.append(f"{pointer}->{name} = {value};")
    if not any("= position_m" in line for line in lines):
        lines.append("(void)position_m;")
    return lines
