"""Export of a whole coupling as C for custom firmware: one function from position to force."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from avc_casadi import InputError
from avc_casadi._util.units import FORCE, KG, M_PER_S, METRE, NEWTON, NS_PER_M, in_its_units
from avc_casadi.claims.deployable import require_deployable
from avc_hardware.codegen.coupling_program import CouplingProgram, coupling_program
from avc_hardware.codegen.firmware_fit import single_rows
from avc_hardware.codegen.operations import DOUBLE, PRECISIONS, SINGLE, Precision
from avc_hardware.codegen.packages import WORDS, checked_name, comment, comment_lines, packaged
from avc_hardware.codegen.sensor_rule import FARTHEST_M, SensorBounds, believed_c
from avc_hardware.codegen.tick_c import start_lines
from avc_hardware.codegen.tick_program import GAINS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from avc_casadi.claims.deployable import Deployable
    from avc_casadi.coupling import Coupling
    from avc_casadi.model.problem import Problem


NAME = "avc_coupling"
HEADER, SOURCE = f"{NAME}.h", f"{NAME}.c"

_HEADER = """\
/* A virtual coupling with its wall, made by avc-casadi; do not edit.
 *
 * Coupling {id} for {problem}{title}
 * method {method}, structure {structure}, {rows}
 * wall: {wall_b:.9g} {NS_PER_M} and {wall_k:.9g} {N_PER_M}, on one side, at position 0; contact law {contact}
 * beside the gains: {beside}{detents}
 * {FORCE}: {force}
 * {verdict}
 * sample time: {sample_time:.9g} s, and no other: the gains mean another loop at another rate
 *
 * C99, also C++11 and later; no heap, no library; an int of 16 bits is enough{table}. IEEE {precision} precision.
 * The bits are the same on every machine, with gcc and clang without any flag; elsewhere let the compiler not contract
 * a * b + c. -ffast-math is refused.
 */
#ifndef AVC_COUPLING_H
#define AVC_COUPLING_H

#define AVC_COUPLING_ID "{id}"
#define AVC_COUPLING_SAMPLE_TIME_S {sample_time_literal}
#define AVC_COUPLING_SAMPLE_TIME_NS {sample_time_ns}L
{max_force}
/* Define AVC_LOOP_SAMPLE_TIME_NS as your loop's own, and a coupling for another one does not compile. */
#ifdef AVC_LOOP_SAMPLE_TIME_NS
#if AVC_LOOP_SAMPLE_TIME_NS != AVC_COUPLING_SAMPLE_TIME_NS
#error "this coupling is made for another sample time than the loop that runs it"
#endif
#endif

#ifdef __cplusplus
extern "C" {{
#endif

typedef {real} avc_coupling_real_t;

/* What the coupling remembers between two samples. */
typedef struct {{
    /* Known of the position: 0 nothing, 1 the last one, 2 its movement too. Samples below 0 in a row, up to 2. Samples
     * in a row inside the wall until what was outside at a fault is believed to be there. */
    unsigned char started, below, wary;
    /* Samples since the device was inside, up to those after which no {FORCE} acts on it any more. */
    unsigned int left;
    /* Of the last position that was believed. */
    {real} position_before_m, moved_before_m;
    /* Where the wall begins until the device has left it: what it went into the wall unseen does not count. */
    {real} face_m;
{states}
}} avc_coupling_t;

/* Forget everything. Call it once before the first step, and whenever sampling has paused. */
void avc_coupling_start(avc_coupling_t *coupling);

/* One sample. position_m: as measured, signed, never clipped: above 0 inside the wall, below 0 outside.
 * Returns the {FORCE} on the device, {NEWTON}, positive out of the wall{limited}; never NaN.
{faults}
 */
{real} avc_coupling_step(avc_coupling_t *coupling, {real} position_m);

#ifdef __cplusplus
}}
#endif

#endif
"""

_SOURCE = """\
/* Coupling {id}: the expressions of avc-casadi's scenes, one statement an operation; do not edit. */
#include "avc_coupling.h"

#ifndef __cplusplus
#include <stdbool.h>
#endif

#ifdef __FAST_MATH__
#error "compile without -ffast-math: a position that is not a number must be seen"
#endif
{check}
/* One rounding an operation: a fused multiply-add would give other bits than were certified. */
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(__GNUC__)
#pragma GCC optimize ("fp-contract=off")
#endif
{look_up}
{believed}
/* The state of a device that has always rested at a position. */
static void rest(avc_coupling_t *coupling, {real} position_m)
{{
{rest}
}}

void avc_coupling_start(avc_coupling_t *coupling)
{{
    rest(coupling, {zero});
    coupling->started = 0u;
    coupling->below = 0u;
    coupling->wary = 0u;
    coupling->left = {leaving};
    coupling->position_before_m = {zero};
    coupling->moved_before_m = {zero};
    coupling->face_m = {zero};
}}

{real} avc_coupling_step(avc_coupling_t *coupling, {real} position_m)
{{
{declared}    if (!believed(position_m, coupling->position_before_m, coupling->moved_before_m,
                  {known}, {jump},
                  {steady})) {{
{doubt}        coupling->started = 0u;
        return {zero};
    }}
{begin}{body}
    if (!(command_n >= {lowest} && command_n <= {largest})) {{
        rest(coupling, position_m);
        coupling->started = 0u;
        return {zero};
    }}
{stores}
    return force_n;
}}
"""

# After a fault a movement must match the previous one, or be seen twice.
_DOUBT = """\
        if (coupling->started == 1u && within(position_m - coupling->position_before_m, {jump})) {{
            coupling->moved_before_m = position_m - coupling->position_before_m;
        }}
        coupling->wary = 2u;
"""
# A coupling starts, initially and after a fault, without stored energy.
_BEGIN = """\
    if (coupling->started == 0u) {{
        /* No deeper than it last was, at the depth that was seen; far away a difference is coarse. */
        {real} depth_m = coupling->position_before_m - coupling->face_m;
        depth_m = depth_m > {zero} ? depth_m : {zero};
        if (position_m - coupling->face_m > depth_m) {{
            coupling->face_m = position_m - depth_m;
            coupling->face_m = position_m - coupling->face_m > depth_m ? position_m : coupling->face_m;
        }}
        if (position_m - coupling->face_m > {zero}) {{
            coupling->wary = 0u; /* it goes on with what it knows: for it no time has passed */
        }} else {{
            rest(coupling, position_m - coupling->face_m);
        }}
        coupling->started = 1u;
    }} else {{
        coupling->moved_before_m = position_m - coupling->position_before_m;
        coupling->started = 2u;
    }}
    if (position_m <= {zero} && coupling->face_m > {zero}) {{
        coupling->face_m = {zero};
        rest(coupling, position_m);
    }}
    coupling->position_before_m = position_m;
    if (position_m > {zero}) {{
        coupling->left = 0u;
    }} else if (coupling->left < {leaving}) {{
        coupling->left++;
    }}
    if (position_m < {zero} && coupling->below < 2u) {{
        coupling->below++;
    }} else if (position_m >= {zero} && coupling->below < 2u) {{
        coupling->below = 0u;
    }}
    clipped = position_m >= {zero} && position_m <= {zero} && coupling->below < 2u;
    if (coupling->wary != 0u) {{
        coupling->wary = position_m > coupling->face_m ? (unsigned char)(coupling->wary - 1u) : 2u;
        coupling->face_m = coupling->wary == 1u ? position_m : coupling->face_m;
    }}
    position_m = position_m - coupling->face_m;
    if (clipped || coupling->wary != 0u) {{
        rest(coupling, position_m);
        coupling->started = clipped ? 1u : coupling->started;
        return {zero};
    }}
"""
# Detents have fixed positions: behind a moved wall they would differ.
_BEGIN_OUTSIDE = """\
    if (coupling->started == 0u) {{
        if (position_m > {zero}) {{
            return {zero};
        }}
        rest(coupling, position_m);
        coupling->started = 1u;
    }} else {{
        coupling->moved_before_m = position_m - coupling->position_before_m;
        coupling->started = 2u;
    }}
    coupling->position_before_m = position_m;
"""
_UNBELIEVED = (
    "{bounds} Then the {FORCE} is 0, and the next position is believed. Outside all is forgotten, and there is no "
    "{FORCE} until the device has gone deeper for two samples. Inside the coupling goes on at the depth that it knows. "
    "What a device went into the wall unseen or without {FORCE}, before the first sample or in a fault, does not "
    "count: the wall begins so much deeper until the device has been at 0 or below, and gives back no energy that it "
    "has not got, as far as the positions tell: in one that jumps elsewhere and stays there, the {FORCE} goes on as "
    "at the depth before."
)
_SIGNLESS = (
    "A position that is 0 where none was below 0 twice in a row since the start is taken for a depth that is clipped "
    "at 0 (of an engine, of a proxy): outside, where there is no {FORCE} and all is forgotten."
)
_UNBELIEVED_BY_DETENTS = (
    "{bounds} Then the {FORCE} is 0 and all is forgotten; so it is inside the wall before the first sample outside, "
    "until the device has been at 0 or below."
)

WIDE_ENOUGH = """
#include <float.h>

#if DBL_MANT_DIG < 53
#error "a double of this compiler has less than 64 bits (avr-gcc): export with --precision single"
#endif
"""

_LOOK_UP = """
enum {{ ROWS = {rows} }};

/* The table stays in flash where data would be copied to memory otherwise. */
#if defined(__AVR__)
#include <avr/pgmspace.h>
#define IN_FLASH PROGMEM
#define FROM_FLASH(place) pgm_read_float(&(place))
#else
#define IN_FLASH
#define FROM_FLASH(place) (place)
#endif

/* ln(frequency), frequency (Hz), b ({NS_PER_M}), k ({N_PER_M}), b_p ({NS_PER_M}). */
static const {real} table[ROWS][5] IN_FLASH = {{
{table}
}};

static {real} entry(unsigned int row, unsigned int column)
{{
    return FROM_FLASH(table[row][column]);
}}

/* ln x of a normal positive number: its exponent times ln 2 and 2 artanh((m - 1)/(m + 1)) of its mantissa. */
static {real} natural_logarithm({real} x)
{{
    {real} m = x, exponent = {zero};
    while (m > {root_2}) {{
        m = m * {half};
        exponent = exponent + {one};
    }}
    while (m <= {half} * {root_2}) {{
        m = m + m;
        exponent = exponent - {one};
    }}
    const {real} s = (m - {one}) / (m + {one});
    const {real} z = s * s;
    {real} series = {first};
{series}
    return exponent * {ln_2} + (s + s) * series;
}}

/* Gains at a frequency: linear in ln(frequency); the end rows beyond the ends. */
static void look_up({real} frequency_hz, {real} gains[3])
{{
    unsigned int low = 0u, high = ROWS - 1u, i;
    {real} share = {zero};
    if (!(frequency_hz > entry(low, 1u))) {{
        high = low;
    }} else if (frequency_hz >= entry(high, 1u)) {{
        low = high;
    }} else {{
        while (high - low > 1u) {{
            const unsigned int middle = (low + high) / 2u;
            if (frequency_hz < entry(middle, 1u)) {{
                high = middle;
            }} else {{
                low = middle;
            }}
        }}
        share = (natural_logarithm(frequency_hz) - entry(low, 0u)) / (entry(high, 0u) - entry(low, 0u));
        if (!(share >= {zero} && share <= {one})) {{
            share = {zero};
        }}
    }}
    for (i = 0u; i < 3u; i++) {{
        const {real} below = entry(low, 2u + i);
        gains[i] = below + share * (entry(high, 2u + i) - below);
    }}
}}
"""


@in_its_units
def export_c(
    coupling: Coupling,
    *,
    precision: str = "single",
    packages: Iterable[str] = (),
    name: str = NAME,
    unsafe: bool = False,
) -> dict[str, str]:
    """Return a coupling as C, ``avc_coupling.h`` and ``avc_coupling.c``, by file name.

    The whole coupling at its own sample time: observer, estimator, adaptation and table where it has them, wall,
    contact damper, guard, force limit. Bit for bit `ReferenceCoupling`. Names and comments are those of the device:
    ``torque_nm`` and ``position_rad`` for a rotary one.

    Args:
        coupling: any; its runtime needs no support by the packaged firmware.
        precision: ``single`` (float) or ``double``, for processors that have it in hardware.
        packages: around the two files, which then are in ``src``: ``arduino``, ``platformio``, ``cmake``, ``esp-idf``
            and ``zephyr`` libraries, ``chai3d``, ``openhaptics`` and ``haply`` examples in C++.
        name: prefix of the files, functions, types and macros (in capitals); two couplings of two names link into one
            program.
        unsafe: whether a coupling that is not deployable is written too.

    Raises:
        NotDeployableError: it is not stable with every hand of ``[hands]`` and released.
        InputError: another precision or package, a name invalid in C, a wall without force, an observer without an
            encoder step for its dead zone, a gain too large for single precision, or two rows that become one in it.
    """
    if precision not in PRECISIONS:
        raise InputError.of(f"is {precision!r}; allowed: {', '.join(PRECISIONS)}", key="precision")
    checked_name(name)
    verdict = require_deployable(coupling, unsafe=unsafe)
    chosen = PRECISIONS[precision]
    rows = single_rows(coupling) if chosen is SINGLE else coupling.table.rows
    program = coupling_program(coupling, chosen)
    files = {HEADER: _header(coupling, program, chosen, verdict), SOURCE: _source(coupling, program, chosen, rows)}
    made = {file: coupling.units.code(text) for file, text in packaged(files, coupling, packages).items()}
    return made if name == NAME else {renamed(file, name): renamed(text, name) for file, text in made.items()}


def renamed(text: str, name: str) -> str:
    """Return a path or a source with the usual name replaced."""
    plain = text.replace(NAME, name).replace(NAME.upper(), name.upper())
    return plain.replace(NAME.replace("_", "-"), name.replace("_", "-"))


def _header(coupling: Coupling, program: CouplingProgram, precision: Precision, verdict: Deployable) -> str:
    problem, runtime, force = coupling.problem, coupling.runtime, coupling.max_force_n
    beside = []
    if runtime.observer_mass_kg is not None:
        ahead = problem.device.delay_samples
        beside.append(f"observer for {runtime.observer_mass_kg:g} {KG}" + (f", {ahead} samples ahead" if ahead else ""))
    if runtime.state_feedback is not None:
        half = runtime.state_feedback.dead_zone_m
        beside.append(
            f"observer of {runtime.state_feedback.states} states with a dead zone of +-{half:.4g} {METRE}, and feedback"
        )
    if program.before is not None:
        slew = "no slew limit" if runtime.slew_per_s is None else f"at most {runtime.slew_per_s:g} a second"
        passive = ", passive" if runtime.passive else ""
        beside.append(f"estimator {runtime.estimator}, hold {runtime.hold_s:g} s, {slew}{passive}")
    if runtime.guard is not None:
        beside.append(f"guard {runtime.guard}")
    count = len(coupling.table)
    low, high = coupling.table.frequency_hz[[0, -1]]
    return _HEADER.format(
        **WORDS,
        id=coupling.id,
        problem=comment(problem.name or "a problem"),
        title=comment(f": {problem.title}") if problem.title else "",
        method=comment(coupling.method),
        structure=comment(coupling.structure),
        contact=comment(coupling.contact),
        rows="constant gains" if program.before is None else f"{count} rows from {low:.6g} to {high:.6g} Hz",
        verdict=comment_lines(
            verdict.sentence if verdict.passed else f"UNSAFE, written by request: {verdict.sentence}"
        ),
        wall_b=coupling.wall.damping_ns_per_m,
        wall_k=coupling.wall.stiffness_n_per_m,
        beside=comment("; ".join(beside) or "nothing"),
        detents=_detents(problem),
        force="the problem knows no limit; limit it yourself" if force is None else f"limited at {force:.9g} {NEWTON}",
        sample_time=coupling.sample_time_s,
        sample_time_literal=precision.literal(coupling.sample_time_s),
        sample_time_ns=round(coupling.sample_time_s * 1e9),
        max_force="" if force is None else f"#define AVC_COUPLING_MAX_FORCE_N {precision.literal(force)}\n",
        precision=precision.name,
        real=precision.c_type,
        table="" if program.before is None else "; on AVR the table stays in flash",
        states="\n".join(f"    {precision.c_type} {name};" for name in program.states),
        limited="" if force is None else ", limited at AVC_COUPLING_MAX_FORCE_N",
        faults="\n".join(
            f" * {comment_lines(told.format(**WORDS, bounds=_unbelieved(_bounds(problem))))}"
            for told in ((_UNBELIEVED, _SIGNLESS) if problem.detent is None else (_UNBELIEVED_BY_DETENTS,))
        ),
    )


def _bounds(problem: Problem) -> SensorBounds:
    return SensorBounds.of(problem.device, detents=problem.detent is not None)


def _unbelieved(bounds: SensorBounds) -> str:
    """Return the description of rejected positions."""
    return (
        f"Not believed is a position that is NaN, infinite or beyond {FARTHEST_M:.0e} {METRE}; one that is more than "
        f"{bounds.jump_m:.4g} {METRE} from the one before, {bounds.fastest_m_per_s:.4g} {M_PER_S}, which no hand does; "
        f"and one that comes by a movement which differs from the one before by more than {bounds.outside_m:.4g} "
        f"{METRE} outside of the wall, {bounds.outside_m_per_s2:.4g} {M_PER_S} in a second, {bounds.leaving_m:.4g} "
        f"{METRE} as long as the last {FORCE} may act there, or {bounds.change_m:.4g} {METRE} inside, "
        f"{bounds.acceleration_m_per_s2:.4g} {M_PER_S} in a second."
    )


def _detents(problem: Problem) -> str:
    """Return the line on the detents; none where there are none."""
    one = problem.detent
    if one is None:
        return ""
    damper = f", a damper of {one.damping_ns_per_m:.9g} {NS_PER_M}" if one.damping_ns_per_m else ""
    return (
        f"\n * detents everywhere: {one.force_n:.9g} {NEWTON} at most, every {one.pitch_m:.9g} {METRE} from "
        f"{one.centre_m:.9g} {METRE}, on"
        f"\n * {100 * one.width:.9g} % of the way{damper}"
    )


def _source(coupling: Coupling, program: CouplingProgram, precision: Precision, rows: NDArray[Any]) -> str:
    literal = precision.literal
    wall, bounds = coupling.problem.detent is None, _bounds(coupling.problem)
    words, leaving = {"real": precision.c_type, "zero": literal(0.0)}, f"{bounds.leaving_samples}u"
    return _SOURCE.format(
        id=coupling.id,
        check=WIDE_ENOUGH if precision is DOUBLE else "",
        **words,
        believed=believed_c(precision),
        jump=literal(bounds.jump_m),
        leaving=leaving,
        steady=f"coupling->left == 0u ? {literal(bounds.change_m)} : coupling->left < {leaving} ? "
        f"{literal(bounds.leaving_m)} : {literal(bounds.outside_m)}"
        if wall
        else literal(bounds.change_m),
        declared="    int clipped;\n" if wall else "",
        known="coupling->started == 1u && coupling->wary != 0u ? 2u : coupling->started"
        if wall
        else "coupling->started",
        doubt=_DOUBT.format(jump=literal(bounds.jump_m)) if wall else "",
        begin=(_BEGIN if wall else _BEGIN_OUTSIDE).format(**words, leaving=leaving),
        look_up="" if program.before is None else _look_up(rows, precision),
        rest=_indented(start_lines("coupling", program.states, program.initial, precision=precision)),
        lowest=literal(-precision.largest),
        largest=literal(precision.largest),
        body=_indented(_body(program, precision)),
        stores=_indented([f"coupling->{name} = next_{name};" for name in program.states]),
    )


def _look_up(rows: NDArray[Any], precision: Precision) -> str:
    literal = precision.literal
    lines = [
        "    {{{}}},".format(", ".join(map(literal, (logarithm, *row))))
        for logarithm, row in zip(precision.ln(rows[:, 0]), rows, strict=True)
    ]
    first, *others = map(literal, precision.ln.coefficients)
    return _LOOK_UP.format(
        **WORDS,
        rows=len(rows),
        table="\n".join(lines),
        real=precision.c_type,
        zero=literal(0.0),
        half=literal(0.5),
        one=literal(1.0),
        root_2=literal(math.sqrt(2.0)),
        ln_2=literal(math.log(2.0)),
        first=first,
        series=_indented([f"series = series * z + {coefficient};" for coefficient in others]),
    )


def _body(program: CouplingProgram, precision: Precision) -> list[str]:
    """Return the statements of one sample; states are read anywhere and written at the end."""
    gains = {f"wanted_{name}": f"gains[{index}]" for index, name in enumerate(GAINS)}

    def of_input(symbol: str) -> str:
        return f"coupling->{symbol[6:]}" if symbol.startswith("state_") else gains.get(symbol, symbol)

    def of_output(symbol: str) -> str:
        return f"const {precision.c_type} {symbol.removeprefix('out_')}"

    lines = []
    if program.before is not None:
        lines += program.before.c_lines(of_input, of_output, prefix="e")
        lines += [f"{precision.c_type} gains[3];", "look_up(frequency_hz, gains);"]
    return lines + program.after.c_lines(of_input, of_output)


def _indented(lines: list[str]) -> str:
    return "\n".join(f"    {line}" for line in lines)
