"""The generated C of the control tick, a header or source for each part, and the configuration that is built in."""

from __future__ import annotations

import struct

from avc_casadi.simulation.emit import SINGLE, Precision
from avc_hardware.codegen.figures import ESTIMATOR_NUMBERS, NO_SLEW_PER_S, Config, RuntimeFigures
from avc_hardware.codegen.tick_program import LAWS, RuntimeProgram, Start, tick_numbers, tick_programs

_BANNER = "/* Generated from the scene's CasADi expressions when firmware is built; do not edit. */"
CONFIG = "avc_config.c"


def _header(name: str, lines: list[str]) -> str:
    guard = f"{name.upper()}_H"
    body = ["#include <stdbool.h>", "", *lines] if any("bool" in line for line in lines) else lines
    return "\n".join([_BANNER, f"#ifndef {guard}", f"#define {guard}", "", *body, "", "#endif", ""])


def _struct(name: str, members: tuple[str, ...]) -> list[str]:
    return ["typedef struct {", *(f"    float {member};" for member in members), f"}} {name}_t;", ""]


def _function(signature: str, told: str, body: list[str]) -> list[str]:
    return [f"/* {told} */", f"static inline void {signature}", "{", *(f"    {line}" for line in body), "}", ""]


def _of_input(symbol: str) -> str:
    kind, _, rest = symbol.partition("_")
    if kind == "number":
        return f"number[{rest}]"
    return f"state->{rest}" if kind == "state" else f"in->{symbol}"


def _of_output(symbol: str) -> str:
    return f"state->{symbol[5:]}" if symbol.startswith("next_") else f"out->{symbol[4:]}"


def _types(part: RuntimeProgram, name: str) -> list[str]:
    kinds = {"state": part.states, "in": part.inputs, "out": part.outputs}
    return [line for kind, members in kinds.items() for line in _struct(f"{name}_{kind}", members)]


def _start(part: RuntimeProgram, name: str) -> list[str]:
    body = start_lines("state", part.states, part.initial)
    numbers = ", const float *number" if any(isinstance(one, str) for one in part.initial) else ""
    told = "The state of a device that has always rested at a position."
    return _function(f"{name}_start({name}_state_t *state, float position_m{numbers})", told, body)


def _step(part: RuntimeProgram, types: str) -> list[str]:
    name = f"avc_{part.name}_step"
    given = f"{types}_state_t *state, const {types}_in_t *in, {types}_out_t *out, const float *number"
    return _function(f"{name}({given})", "One tick.", part.program.c_lines(_of_input, _of_output))


def tick_sources(figures: RuntimeFigures) -> dict[str, str]:
    """Return the generated sources of a firmware by file name; estimator and passive change decide."""
    parts = {part.name: part for part in tick_programs(figures.estimator, figures.passive)[0]}
    estimate, guard, first = parts["estimate"], parts["guard"], parts[f"couple_{next(iter(LAWS))}"]
    functions = [
        line.removeprefix("static inline ")
        for line in [*_start(estimate, "avc_estimate"), *_step(estimate, "avc_estimate")]
    ]
    declared = [f"{line};" for line in functions if line.startswith("void ")]
    headers = {
        "avc_numbers": [f"enum {{ AVC_NUMBERS = {len(tick_numbers(figures))} }};"],
        "avc_estimate": [*_types(estimate, "avc_estimate"), *declared],
        "avc_guard": [*_types(guard, "avc_guard"), *_start(guard, "avc_guard"), *_step(guard, "avc_guard")],
        # The other law sees a penetration of 0 in a start before the wall.
        "avc_couple": [
            *_types(first, "avc_couple"),
            *_start(parts[f"couple_{next(name for name, clips in LAWS.items() if clips)}"], "avc_couple"),
        ],
    }
    for law in LAWS:
        below = '#include "avc_couple.h"'
        headers[f"avc_couple_{law}"] = [below, "", *_step(parts[f"couple_{law}"], "avc_couple")]
    source = [_BANNER, '#include "avc_estimate.h"', "", "#include <stdbool.h>", "", *functions]
    return {f"{name}.h": _header(name, lines) for name, lines in headers.items()} | {
        "avc_estimate.c": "\n".join(source)
    }


def config_source(config: Config, *, bound: bool) -> dict[str, str]:
    """Return the configuration that a firmware starts with; one that is not bound takes any other by the link."""
    literal, figures = SINGLE.literal, config.figures
    slew = NO_SLEW_PER_S if figures.slew_per_s is None else figures.slew_per_s
    floats = (figures.hold_s, slew, figures.guard_damping_ns_per_m, figures.hand_m_per_unit)
    whole = (ESTIMATOR_NUMBERS.index(figures.estimator), int(figures.passive))
    numbers = [literal(float(number)) for number in tick_numbers(figures)]
    lines = [
        _BANNER,
        '#include "avc_config.h"',
        "",
        f"const bool avc_bound = {'true' if bound else 'false'};",
        "const avc_config_t avc_built_in = {",
        f"    .crc32 = {struct.unpack('<I', config.packed()[:4])[0]:#010x}u,",
        f"    .limits = {{{', '.join(literal(value) for value in vars(config.limits).values())}}},",
        f"    .figures = {{{', '.join(map(literal, floats))}, {whole[0]}u, {whole[1]}u}},",
        "    .number = {",
        *(f"        {', '.join(numbers[at : at + 6])}," for at in range(0, len(numbers), 6)),
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
