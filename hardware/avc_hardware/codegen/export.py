"""Export of a whole coupling as C for custom firmware: one function from position to force."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from avc_casadi.claims.deployable import Deployable, require_deployable
from avc_casadi.coupling import Coupling
from avc_casadi.simulation.emit import DOUBLE, Precision
from avc_hardware.codegen import c_frame
from avc_hardware.codegen.coupling_program import CouplingProgram, coupling_program
from avc_hardware.codegen.pair_export import pair_files, pair_verdict
from avc_hardware.codegen.tick_program import GAINS, start_lines

if TYPE_CHECKING:
    from avc_casadi.model.gains import GainTable

_HEADER = """\
/* A virtual coupling with its wall, made by avc-casadi; do not edit.
 *
 * Coupling {id} for {problem}{title}
 * method {method}, structure {structure}, {rows}
 * wall: {wall_b:.9g} N.s/m and {wall_k:.9g} N/m, on one side, at position 0; contact law {contact}
 * beside the gains: {beside}{detents}
 * force: {force}
 * {verdict}
 * sample time: {sample_time:.9g} s, and no other: the gains mean another loop at another rate{units}
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
{loop}
{begin_c}
typedef {real} avc_coupling_real_t;

/* What the coupling remembers between two samples. */
typedef struct {{
    /* Whether a position is known, whether the law runs, and whether the wall begins deeper than at 0. */
    unsigned char known, runs, moved;
    /* The last position that is a number, and the movement that a hand can have made to it. */
    {real} position_before_m, moved_before_m;
    /* Where the wall begins until the device has left it, what it went into it unseen not counted; and how deep it was
     * when the law ran last. */
    {real} face_m, depth_m;
{states}
}} avc_coupling_t;

/* Forget everything. Call it once before the first step, and whenever sampling has paused. */
void avc_coupling_start(avc_coupling_t *coupling);

/* One sample. position_m: as measured, signed, never clipped: above 0 inside the wall, below 0 outside.
 * Returns the force on the device, N, positive out of the wall{limited}; never NaN.
{faults}
 */
{real} avc_coupling_step(avc_coupling_t *coupling, {real} position_m);

{end_c}"""
_UNBELIEVED = """\
Not believed is a position that is NaN, infinite or beyond {farthest:.0e} m; one that is more than {jump:.4g} m from the
one before, {fastest:.4g} m/s, which no hand does; and one that comes by a movement which differs by more than
{outside:.4g} m outside of the wall, {inside:.4g} m inside, from what a hand can have made. Then the force is 0; """
_OF_WALLS = """\
the coupling goes on as soon as a position is believed, at the depth that it knows. What a device went into the wall
unseen, before the first sample or in a fault, does not count: the wall begins so much deeper until the device has been
at 0 or below."""
_OF_DETENTS = "so it is until the device has been at 0 or below."

_SOURCE = """\
/* Coupling {id}: the expressions of avc-casadi's scenes, one statement an operation; do not edit. */
#include "avc_coupling.h"

#ifndef __cplusplus
#include <stdbool.h>
#endif

{checks}
/* One rounding an operation: a fused multiply-add would give other bits than were certified. */
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(__GNUC__)
#pragma GCC optimize ("fp-contract=off")
#endif
{look_up}
/* The state of a device that has always rested at a position. */
static void rest(avc_coupling_t *coupling, {real} position_m)
{{
{rest}
}}

void avc_coupling_start(avc_coupling_t *coupling)
{{
    rest(coupling, {zero});
    coupling->known = 0u;
    coupling->runs = 0u;
    coupling->moved = 0u;
    coupling->position_before_m = {zero};
    coupling->moved_before_m = {zero};
    coupling->face_m = {zero};
    coupling->depth_m = {zero};
}}

static int within({real} value, {real} most)
{{
    return value >= -most && value <= most;
}}

/* Whether a position is a number, and has come by a movement that a hand can make by now: from one sample to the next
 * what is possible changes by no more than an acceleration allows; what rounding adds does not add up. */
static int believed(avc_coupling_t *coupling, {real} position_m)
{{
    const {real} before_m = coupling->position_before_m;
    const {real} moved_m = coupling->known != 0u ? position_m - before_m : {zero};
    const {real} changed_m = moved_m - coupling->moved_before_m;
    const {real} most_m = coupling->runs != 0u && before_m > {zero} ? {inside} : {outside};
    if (!within(position_m, {farthest})) {{
        return 0;
    }}
    coupling->known = 1u;
    coupling->position_before_m = position_m;
    if (within(changed_m, most_m + {unsure})) {{
        coupling->moved_before_m = moved_m;
        return within(moved_m, {jump});
    }}
    coupling->moved_before_m += changed_m > {zero} ? most_m : -most_m;
    return 0;
}}

{real} avc_coupling_step(avc_coupling_t *coupling, {real} position_m)
{{
    if (!believed(coupling, position_m)) {{
        coupling->runs = 0u;
        return {zero};
    }}
{begin}
{body}
    if (!(command_n >= {lowest} && command_n <= {largest})) {{
        rest(coupling, position_m);
        coupling->runs = 0u;
        return {zero};
    }}
{stores}
    return force_n;
}}
"""

# What a device went into the wall unseen does not count, so that nothing begins stretched.
_BEGIN = """\
    if (coupling->runs == 0u && position_m - coupling->face_m > coupling->depth_m) {{
        coupling->face_m = position_m - coupling->depth_m;
    }}
    if (position_m <= {zero}) {{
        coupling->face_m = {zero};
    }}
    coupling->depth_m = position_m > coupling->face_m ? position_m - coupling->face_m : {zero};
    if ((coupling->runs == 0u && coupling->depth_m <= {zero}) || (position_m <= {zero} && coupling->moved != 0u)) {{
        rest(coupling, position_m - coupling->face_m);
    }}
    coupling->moved = coupling->face_m > {zero} ? 1u : 0u;
    coupling->runs = 1u;
    position_m = position_m - coupling->face_m;"""
# Detents have fixed positions: behind a moved wall they would differ.
_BEGIN_OUTSIDE = """\
    if (coupling->runs == 0u) {{
        if (position_m > {zero}) {{
            return {zero};
        }}
        rest(coupling, position_m);
        coupling->runs = 1u;
    }}"""
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

/* ln(frequency), frequency (Hz), b, k, b_p. */
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


def export_c(
    coupling: Coupling, *, precision: str = "single", name: str = c_frame.NAME, unsafe: bool = False
) -> dict[str, str]:
    """Return a coupling to any end as C, ``avc_coupling.h`` and ``avc_coupling.c``, by file name."""
    chosen = c_frame.checked(precision, name)
    if isinstance(coupling, Coupling) and coupling.end != "wall":
        return c_frame.named(pair_files(coupling, chosen, pair_verdict(coupling, unsafe=unsafe)[0]), name)
    verdict = require_deployable(coupling, unsafe=unsafe)
    program = coupling_program(coupling, chosen)
    files = {
        c_frame.HEADER: _header(coupling, program, chosen, verdict),
        c_frame.SOURCE: _source(coupling, program, chosen),
    }
    return c_frame.named(files, name)


def _header(coupling: Coupling, program: CouplingProgram, precision: Precision, verdict: Deployable) -> str:
    """Return the header; a verdict stands in it."""
    problem, force, detent = coupling.problem, coupling.max_force_n, coupling.problem.detent
    bounds = c_frame.SensorBounds.of(problem.device, detents=detent is not None)
    faults = _UNBELIEVED.format(
        farthest=c_frame.FARTHEST_M,
        jump=bounds.jump_m,
        fastest=bounds.fastest_m_per_s,
        outside=bounds.outside_m,
        inside=bounds.change_m,
    )
    low, high = coupling.table.frequency_hz[[0, -1]]
    values = {} if detent is None else detent.model_dump()
    detents = c_frame.comment(", ".join(f"{key} {value:.9g}" for key, value in values.items()))
    return _HEADER.format(
        **c_frame.FRAME,
        id=coupling.id,
        **c_frame.head_words(problem),
        method=c_frame.comment(coupling.method),
        structure=c_frame.comment(coupling.structure),
        contact=c_frame.comment(coupling.contact),
        rows="constant gains" if program.before is None else f"{len(coupling.table)} rows, {low:.6g} to {high:.6g} Hz",
        verdict=c_frame.comment_lines(
            verdict.sentence if verdict.passed else f"UNSAFE, written by request: {verdict.sentence}"
        ),
        wall_b=coupling.wall.damping_ns_per_m,
        wall_k=coupling.wall.stiffness_n_per_m,
        beside=_beside(coupling),
        detents=f"\n * detents everywhere: {detents}" if detents else "",
        force="the problem knows no limit; limit it yourself" if force is None else f"limited at {force:.9g} N",
        sample_time=coupling.sample_time_s,
        sample_time_literal=precision.literal(coupling.sample_time_s),
        sample_time_ns=round(coupling.sample_time_s * 1e9),
        max_force="" if force is None else f"#define AVC_COUPLING_MAX_FORCE_N {precision.literal(force)}\n",
        precision=precision.name,
        real=precision.c_type,
        table="" if program.before is None else "; on AVR the table stays in flash",
        states="\n".join(f"    {precision.c_type} {name};" for name in program.states),
        limited="" if force is None else ", limited at AVC_COUPLING_MAX_FORCE_N",
        faults=f" * {c_frame.comment_lines(faults + (_OF_WALLS if detent is None else _OF_DETENTS))}",
    )


def _beside(coupling: Coupling) -> str:
    """Return what runs beside the gains, by the keys of [runtime]."""
    runtime = coupling.runtime
    found = [] if coupling.table.constant else ["estimator", "hold_s", "slew_per_s", "passive"]
    found += [key for key in ("observer_mass_kg", "guard") if getattr(runtime, key) is not None]
    told = [f"{key} {getattr(runtime, key)}" for key in found]
    if runtime.state_feedback is not None:
        told.append(f"an observer of {runtime.state_feedback.states} states, and feedback")
    return c_frame.comment(", ".join(told) or "nothing")


def _source(coupling: Coupling, program: CouplingProgram, precision: Precision) -> str:
    literal = precision.literal
    wall = coupling.problem.detent is None
    bounds = c_frame.SensorBounds.of(coupling.problem.device, detents=not wall)
    words = {"real": precision.c_type, "zero": literal(0.0)}
    return _SOURCE.format(
        id=coupling.id,
        checks=c_frame.compiler_checks(precision),
        **words,
        farthest=literal(c_frame.FARTHEST_M),
        jump=literal(bounds.jump_m),
        inside=literal(bounds.change_m - bounds.unsure_m),
        outside=literal(bounds.outside_m - bounds.unsure_m),
        unsure=literal(bounds.unsure_m),
        begin=(_BEGIN if wall else _BEGIN_OUTSIDE).format(**words),
        look_up="" if program.before is None else _look_up(coupling.table, precision),
        rest=_indented(start_lines("coupling", program.states, program.initial, precision=precision)),
        lowest=literal(-precision.largest),
        largest=literal(precision.largest),
        body=_indented(_body(program, precision)),
        stores=_indented([f"coupling->{name} = next_{name};" for name in program.states]),
    )


def _look_up(stated: GainTable, precision: Precision) -> str:
    literal, rows = precision.literal, stated.rows if precision is DOUBLE else stated.single()
    lines = [
        "    {{{}}},".format(", ".join(map(literal, (logarithm, *row))))
        for logarithm, row in zip(precision.ln(rows[:, 0]), rows, strict=True)
    ]
    first, *others = map(literal, precision.ln.coefficients)
    return _LOOK_UP.format(
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
