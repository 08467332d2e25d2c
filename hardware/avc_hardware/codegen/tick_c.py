"""The generated C of the control tick: header, source and constants of each part."""

from __future__ import annotations

from avc_hardware.codegen.figures import ESTIMATOR_NUMBERS, BoardLimits, RuntimeFigures
from avc_hardware.codegen.operations import SINGLE, Precision
from avc_hardware.codegen.tick_program import LAWS, Template, constants, templates

_BANNER = "/* Generated from the scene's CasADi expressions when firmware is built; do not edit. */"


def c_sources(template: Template) -> dict[str, str]:
    """Return the sources of one part by file name; its constants are in `constants_sources`.

    The estimator is a function. Short parts are compiled into the tick: the guard, and for each contact law of the
    coupling one header for varying and one for constant gains, with the same states.
    """
    name = template.part.name
    kind, _, law = name.partition("_")
    if kind == "estimate":
        return _function(template)
    if kind == "steady":
        return {f"avc_{name}.h": _header(f"avc_{name}", ['#include "avc_couple.h"', "", *_steady(template)])}
    step = [*_numbers(template), "", *_steps(template, f"avc_{kind}", f"avc_{name}")]
    own = [*_types(template, f"avc_{kind}"), "", *_start(template, f"avc_{kind}")]
    if not law:
        return {f"avc_{name}.h": _header(f"avc_{name}", [*own, "", *step])}
    files = {f"avc_{name}.h": _header(f"avc_{name}", [f'#include "avc_{kind}.h"', "", *step])}
    # The other law sees a penetration of 0 in a start before the wall.
    return files | ({f"avc_{kind}.h": _header(f"avc_{kind}", own)} if LAWS[law] else {})


def _header(name: str, lines: list[str]) -> str:
    guard = f"{name.upper()}_H"
    body = ["#include <stdbool.h>", "", *lines] if any("bool" in line for line in lines) else lines
    return "\n".join([_BANNER, f"#ifndef {guard}", f"#define {guard}", "", *body, "", "#endif", ""])


def _struct(name: str, members: tuple[str, ...]) -> list[str]:
    return ["typedef struct {", *(f"    float {member};" for member in members), f"}} {name}_t;"]


def _types(template: Template, name: str) -> list[str]:
    part = template.part
    kinds = {"state": part.states, "in": part.inputs, "out": part.outputs}
    lines = [line for kind, members in kinds.items() for line in [*_struct(f"{name}_{kind}", members), ""]]
    return lines[:-1]


def _numbers(template: Template) -> list[str]:
    return [
        "/* What depends on sample time, encoder and settings. */",
        f"extern const float avc_{template.part.name}_constants[{template.size}];",
    ]


def _start(template: Template, name: str) -> list[str]:
    part = template.part
    first = len(template.constants)
    starts = {state: f"avc_{part.name}_constants[{first + index}]" for index, state in enumerate(template.starts)}
    return [
        "/* The state of a device that has always rested at a position. */",
        f"static inline void {name}_start({name}_state_t *state, float position_m)",
        "{",
        *(f"    {line}" for line in start_lines("state", part.states, part.initial, starts)),
        "}",
    ]


def _signature(types: str, name: str) -> str:
    return f"static inline void {name}({types}_state_t *state, const {types}_in_t *in, {types}_out_t *out)"


def _step(
    template: Template, types: str, name: str, *, told: str = "One tick.", truths: dict[str, bool] | None = None
) -> list[str]:
    """Return one tick; nothing is written of a state that is known to be true."""
    known = truths or {}
    places = {place: f"avc_{template.part.name}_constants[{index}]" for index, place in enumerate(template.constants)}
    stays = {f"next_{symbol.removeprefix('state_')}" for symbol, truth in known.items() if truth}
    body = template.part.program.knowing(known).c_lines(
        _of_input, lambda symbol: None if symbol in stays else _of_output(symbol), constants=places
    )
    return [f"/* {told} */", _signature(types, name), "{", *(f"    {line}" for line in body), "}"]


def _steps(template: Template, types: str, name: str) -> list[str]:
    """Return the first tick, the following ones, and the choice between them: neither uses it in between."""
    (started,) = (state for state in template.part.states if state.endswith("_started"))
    first, later = (
        _step(template, types, f"{name}_{when}", told=told, truths={f"state_{started}": truth})
        for when, told, truth in (("first", "The first tick.", False), ("later", "A tick after the first.", True))
    )
    choice = [
        "/* One tick. */",
        _signature(types, f"{name}_step"),
        "{",
        f"    if (state->{started} != 0.0f) {{",
        f"        {name}_later(state, in, out);",
        "    } else {",
        f"        {name}_first(state, in, out);",
        "    }",
        "}",
    ]
    return [*first, "", *later, "", *choice]


def _of_input(symbol: str) -> str:
    return f"state->{symbol[6:]}" if symbol.startswith("state_") else f"in->{symbol}"


def _of_output(symbol: str) -> str:
    return f"state->{symbol[5:]}" if symbol.startswith("next_") else f"out->{symbol[4:]}"


def _function(template: Template) -> dict[str, str]:
    name = f"avc_{template.part.name}"
    start, step = _start(template, name), _step(template, name, f"{name}_step")
    bodies = [[line.removeprefix("static inline ") for line in lines] for lines in (start, step)]
    declared = [line for lines in bodies for line in (lines[0], f"{lines[1]};", "")]
    header = _header(name, [*_types(template, name), "", *_numbers(template), "", *declared[:-1]])
    source = [_BANNER, f'#include "{name}.h"', "", "#include <stdbool.h>", "", *bodies[0][1:], "", *bodies[1][1:], ""]
    return {f"{name}.h": header, f"{name}.c": "\n".join(source)}


def _steady(template: Template) -> list[str]:
    """Return the precomputation for constant gains, and the step with it."""
    part, name = template.part, f"avc_{template.part.name}"
    numbers = {place: f"{name}_constants[{index}]" for index, place in enumerate(template.constants)}
    given = tuple(symbol for symbol in part.inputs if symbol != "position_m")
    kept = {place: f"steady->v{place}" for place in part.program.settled_by(given, template.constants)}
    settle = part.program.settling_lines(_of_input, kept, constants=numbers)
    return [
        "/* What gains and wall come to, computed once. */",
        *_struct(name, tuple(place.removeprefix("steady->") for place in kept.values())),
        "",
        *_struct(f"{name}_in", given),
        "",
        *_struct(f"{name}_out", part.outputs),
        "",
        *_numbers(template),
        "",
        f"static inline void {name}_settle({name}_t *steady, const {name}_in_t *in)",
        "{",
        *(f"    {line}" for line in settle),
        "}",
        "",
        "/* One tick; of the coupling's states only those that gains which stay have. */",
        f"static inline void {name}_step(avc_couple_state_t *state, const {name}_t *steady, float position_m,",
        f"                                {name}_out_t *out)",
        "{",
        *(f"    {line}" for line in part.program.c_lines(_of_steady, _of_output, kept=kept)),
        "}",
    ]


def _of_steady(symbol: str) -> str:
    return _of_input(symbol) if symbol.startswith("state_") else symbol


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

/* Gains beyond these are refused. */
#define AVC_MADE_FOR_MAX_DAMPING_NS_PER_M {damping}
#define AVC_MADE_FOR_MAX_STIFFNESS_N_PER_M {stiffness}
#define AVC_MADE_FOR_MAX_CONTACT_DAMPING_NS_PER_M {contact}

/* What is no plausible motion of the device, nor a plausible tick; 0: not watched. */
#define AVC_MADE_FOR_MAX_SPEED_M_PER_S {speed}
#define AVC_MADE_FOR_MAX_ACCELERATION_M_PER_S2 {acceleration}
#define AVC_MADE_FOR_MAX_ENERGY_J {energy}
#define AVC_MADE_FOR_STUCK_SWING_N {swing}
#define AVC_MADE_FOR_MAX_OVERRUNS {overruns}

#endif
"""


def made_for(limits: BoardLimits) -> str:
    """Return the header of the sample time, encoder and force of a firmware."""
    return _MADE_FOR.format(
        banner=_BANNER,
        time=SINGLE.literal(limits.sample_time_s),
        time_ns=_whole(limits.sample_time_s, 1e9),
        count=SINGLE.literal(limits.metres_per_count),
        count_pm=_whole(limits.metres_per_count, 1e12),
        force=SINGLE.literal(limits.max_force_n),
        damping=SINGLE.literal(limits.max_damping_ns_per_m),
        stiffness=SINGLE.literal(limits.max_stiffness_n_per_m),
        contact=SINGLE.literal(limits.max_contact_damping_ns_per_m),
        speed=SINGLE.literal(limits.max_speed_m_per_s),
        acceleration=SINGLE.literal(limits.max_acceleration_m_per_s2),
        energy=SINGLE.literal(limits.max_energy_j),
        swing=SINGLE.literal(limits.stuck_swing_n),
        overruns=SINGLE.literal(limits.max_overruns),
    )


def _whole(value: float, scale: float) -> int:
    return round(value * scale)


def constants_sources(figures: RuntimeFigures) -> dict[str, str]:
    """Return the constants of all parts, and their figures, by file name.

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
        f"    .hand_m_per_unit = {SINGLE.literal(figures.hand_m_per_unit)},",
        f"    .estimator = {ESTIMATOR_NUMBERS.index(figures.estimator)}u,",
        f"    .passive = {int(figures.passive)}u,",
    ]
    files["avc_figures.c"] = "\n".join([*text, "};", ""])
    return files


def sources_for(limits: BoardLimits, figures: RuntimeFigures) -> dict[str, str]:
    """Return every generated source of a firmware for one device, by file name.

    Raises:
        UnsupportedError: no program exists for the sample time or other figures.
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
    """Return the statements that set the states of a device at rest; ``starts`` replace numbers, by state."""
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
