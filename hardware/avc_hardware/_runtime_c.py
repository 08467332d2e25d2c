"""The generated C of the control tick: a header, a source and the numbers of each part."""

from __future__ import annotations

from avc_hardware._figures import ESTIMATOR_NUMBERS, RuntimeFigures
from avc_hardware._host import BoardLimits
from avc_hardware._precision import SINGLE, Precision
from avc_hardware._runtime_constants import Template, constants, templates

_BANNER = """/* Generated from the scene's CasADi expressions, do not edit:
 * python -m avc_hardware.firmware_build generate */"""


def c_sources(template: Template) -> dict[str, str]:
    """Return header and source of one part by file name; its numbers are in `constants_sources`."""
    part = template.part
    name = f"avc_{part.name}"
    numbers = f"{name}_constants"

    def struct(kind: str, members: tuple[str, ...]) -> str:
        return "typedef struct {\n" + "".join(f"    float {member};\n" for member in members) + f"}} {name}_{kind}_t;\n"

    def of_input(symbol: str) -> str:
        return f"state->{symbol[6:]}" if symbol.startswith("state_") else f"in->{symbol}"

    def of_output(symbol: str) -> str:
        return f"state->{symbol[5:]}" if symbol.startswith("next_") else f"out->{symbol[4:]}"

    start = f"void {name}_start({name}_state_t *state, float position_m)"
    step = f"void {name}_step({name}_state_t *state, const {name}_in_t *in, {name}_out_t *out)"
    guard = f"{name.upper()}_H"
    header = "\n".join(
        [
            _BANNER,
            f"#ifndef {guard}",
            f"#define {guard}",
            "",
            struct("state", part.states),
            struct("in", part.inputs),
            struct("out", part.outputs),
            "/* What depends on sample time, encoder and settings. */",
            f"extern const float {numbers}[{template.size}];",
            "",
            "/* The state of a device that has always rested at a position. */",
            f"{start};",
            "",
            "/* One tick. */",
            f"{step};",
            "",
            "#endif",
            "",
        ]
    )
    places = {place: f"{numbers}[{index}]" for index, place in enumerate(template.constants)}
    first = len(template.constants)
    starts = {state: f"{numbers}[{first + index}]" for index, state in enumerate(template.starts)}
    body = part.program.c_lines(of_input, of_output, constants=places)
    source = [
        _BANNER,
        f'#include "{name}.h"',
        "",
        "#include <stdbool.h>",
        "",
        start,
        "{",
        *(f"    {line}" for line in start_lines("state", part.states, part.initial, starts)),
        "}",
    ]
    source += ["", step, "{", *(f"    {line}" for line in body), "}", ""]
    return {f"{name}.h": header, f"{name}.c": "\n".join(source)}


MADE_FOR = "avc_made_for.h"
_MADE_FOR = """\
{banner}
#ifndef AVC_MADE_FOR_H
#define AVC_MADE_FOR_H

/* What this firmware is made for. Every source with numbers that depend on it asserts the whole numbers. */
#define AVC_MADE_FOR_SAMPLE_TIME_S {time}
#define AVC_MADE_FOR_SAMPLE_TIME_NS {time_ns}
#define AVC_MADE_FOR_COUNT_M {count}
#define AVC_MADE_FOR_COUNT_PM {count_pm}
#define AVC_MADE_FOR_MAX_FORCE_N {force}

/* What is no plausible motion of the device, nor a plausible tick; 0: not watched. */
#define AVC_MADE_FOR_MAX_SPEED_M_PER_S {speed}
#define AVC_MADE_FOR_MAX_ACCELERATION_M_PER_S2 {acceleration}
#define AVC_MADE_FOR_MAX_ENERGY_J {energy}
#define AVC_MADE_FOR_STUCK_SWING_N {swing}
#define AVC_MADE_FOR_MAX_OVERRUNS {overruns}

#endif
"""


def made_for(limits: BoardLimits) -> str:
    """Return the header that says which sample time, encoder and force a firmware is made for."""
    return _MADE_FOR.format(
        banner=_BANNER,
        time=SINGLE.literal(limits.sample_time_s),
        time_ns=_whole(limits.sample_time_s, 1e9),
        count=SINGLE.literal(limits.metres_per_count),
        count_pm=_whole(limits.metres_per_count, 1e12),
        force=SINGLE.literal(limits.max_force_n),
        speed=SINGLE.literal(limits.max_speed_m_per_s),
        acceleration=SINGLE.literal(limits.max_acceleration_m_per_s2),
        energy=SINGLE.literal(limits.max_energy_j),
        swing=SINGLE.literal(limits.stuck_swing_n),
        overruns=SINGLE.literal(limits.max_overruns),
    )


def _whole(value: float, scale: float) -> int:
    return round(value * scale)


def constants_sources(figures: RuntimeFigures) -> dict[str, str]:
    """Return the numbers of all parts, and what they were made for, by file name.

    Raises:
        UnsupportedError: figures that would need another program.
    """
    files = {}
    asserted = [
        f"_Static_assert(AVC_MADE_FOR_SAMPLE_TIME_NS == {_whole(figures.sample_time_s, 1e9)} &&",
        f"                   AVC_MADE_FOR_COUNT_PM == {_whole(figures.metres_per_count, 1e12)},",
        '               "these numbers are made for another sample time or encoder");',
    ]
    for symbol, numbers in constants(figures).items():
        part = symbol.removesuffix("_constants")
        lines = [f"    {SINGLE.literal(number)}," for number in numbers]
        text = [
            _BANNER,
            f"/* {_named(figures, part)} */",
            f'#include "{part}.h"',
            f'#include "{MADE_FOR}"',
            "",
            *asserted,
            "",
            f"const float {symbol}[{len(numbers)}] = {{",
        ]
        files[f"{symbol}.c"] = "\n".join([*text, *lines, "};", ""])
    text = [_BANNER, '#include "avc_figures.h"', "", "const avc_figures_t avc_figures = {"]
    text += [
        f"    .hold_s = {SINGLE.literal(figures.hold_s)},",
        f"    .slew_per_s = {SINGLE.literal(figures.slew_per_s or 0.0)},",
        f"    .guard_damping_ns_per_m = {SINGLE.literal(figures.guard_damping_ns_per_m)},",
        f"    .estimator = {ESTIMATOR_NUMBERS.index(figures.estimator)}u,",
        f"    .passive = {int(figures.passive)}u,",
    ]
    files["avc_figures.c"] = "\n".join([*text, "};", ""])
    return files


def sources_for(limits: BoardLimits, figures: RuntimeFigures) -> dict[str, str]:
    """Return every generated source of a firmware that is made for one device, by file name.

    Raises:
        UnsupportedError: a sample time, or other figures, that no program is made for.
    """
    return all_sources(figures) | {MADE_FOR: made_for(limits)}


def _named(figures: RuntimeFigures, part: str) -> str:
    named = vars(figures) | ({} if part == "avc_estimate" else {"estimator": "any"})
    return ", ".join(f"{name} {value}" for name, value in named.items())


def all_sources(figures: RuntimeFigures) -> dict[str, str]:
    """Return every generated source for some figures but `made_for`, by file name."""
    files: dict[str, str] = {}
    for template in templates(figures):
        files |= c_sources(template)
    return files | constants_sources(figures)


def start_lines(
    pointer: str,
    states: tuple[str, ...],
    initial: tuple[tuple[float, float, float], ...],
    starts: dict[int, str] | None = None,
    precision: Precision = SINGLE,
) -> list[str]:
    """Return the statements that set the states of a device at rest; ``starts`` stand for numbers, by state."""
    places = starts or {}
    lines = []
    for index, (name, (middle, high, low)) in enumerate(zip(states, initial, strict=True)):
        value = places.get(index) or precision.literal(middle)
        if (high, low) == (middle + 1, middle - 1):
            value = "position_m"
        elif (high, low) == (middle + 1, middle):
            zero = precision.literal(0.0)
            value = f"position_m > {zero} ? position_m : {zero}"
        lines.append(f"{pointer}->{name} = {value};")
    if not any("= position_m" in line for line in lines):
        lines.append("(void)position_m;")
    return lines
