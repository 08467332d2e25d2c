"""Export of a whole coupling as C for custom firmware: one function from position to force."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import singledispatch
from typing import TYPE_CHECKING

from avc_casadi.claims.deployable import require_deployable
from avc_casadi.coupling import Coupling, require_coupling
from avc_casadi.model.ends import End, Wall
from avc_casadi.model.problem import Problem
from avc_casadi.simulation.emit import DOUBLE, Precision
from avc_hardware.codegen import c_frame
from avc_hardware.codegen.c_subject import CSubject, Place, coupling_subject, law_subject
from avc_hardware.codegen.coupling_program import CouplingProgram, coupling_program, law_program
from avc_hardware.codegen.pair_export import pair_files, pair_verdict
from avc_hardware.codegen.sensor import DRIFT_M, FARTHEST_M, JUMP_M, SENSOR, SENSOR_TYPE, SensorBounds, fade_samples
from avc_hardware.codegen.tick_program import GAINS, start_lines

if TYPE_CHECKING:
    from avc_casadi.model.device import Device
    from avc_casadi.model.gains import GainTable

_HEADER = """\
/* {what}, made by avc-casadi; do not edit.
 *
{head}
 * force: {force}
 * {verdict}
 * {judged_for}
 * sample time: {sample_time:.9g} s, and no other: {meant} another loop at another rate{units}
 *
 * C99, also C++11 and later; no heap, no library; an int of 16 bits is enough{table}. IEEE {precision} precision.
 * The bits are the same on every machine, with gcc and clang without any flag; elsewhere let the compiler not contract
 * a * b + c. -ffast-math is refused.
 */
#ifndef AVC_COUPLING_H
#define AVC_COUPLING_H

#define AVC_COUPLING_ID "{id}"
{digest}
#define AVC_COUPLING_SAMPLE_TIME_S {sample_time_literal}
#define AVC_COUPLING_SAMPLE_TIME_NS {sample_time_ns}L
{max_force}
{loop}
{begin_c}
typedef {real} avc_coupling_real_t;

{sensor}
/* What the coupling remembers between two samples. */
typedef struct {{
    avc_coupling_sensor_t sensor;
    /* The force that was given last; the share of the law's that is given, and by how much it rises in a sample. */
    {real} given_n, share, rise;
    /* Where the wall begins until the device has left it, what it went into it unseen not counted; and how deep it was
     * when the law ran last. */
    {real} face_m, depth_m;
{states}
}} avc_coupling_t;

/* Forget everything. Call it once before the first step, and whenever sampling has paused. */
void avc_coupling_start(avc_coupling_t *coupling);

/* One sample. position_m: as measured, signed, never clipped{sides}.
 * Returns the force on the device, N{limited}; never NaN.
 * {sense}
{faults}
 */
{real} avc_coupling_step(avc_coupling_t *coupling, {real} position_m);

{end_c}"""
_RUNS = """
    /* Whether the law runs. */
    unsigned char runs;"""
_BELIEVED = """\
WHAT IS BELIEVED. A position is believed where a hand can have brought the device since the last one that was.
Refused are NaN, infinite, beyond {farthest:.0e} m; what is faster than {fastest:.4g} m/s, as no hand is; and a
movement from one sample to the next that differs from the one before by more than {hand:.4g} m outside of the wall,
{driven:.4g} m there while a force acts or has just acted, {inside:.4g} m inside; {unsure:.4g} m of it are steps and
noise of the encoder. After refused samples what is possible grows with their number."""
_FAULT_MODEL = """\
FAULT MODEL. Bad positions while the device rests outside of the wall, the first of them {jump:.4g} m or more away,
the others wherever they like or as they agree, drifting by {drift:.4g} m a sample at most: up to {lasting} in a row
give 0 N, then and after the true ones are back. So does a single one that is refused. More in a row, or a smaller
jump, cannot be told from a hand: then the wall begins where the second of them is believed, and the force rises from
0. After {lost:.4g} s without a position that is believed (an encoder that was set to 0 anew) the next one is where
the device is: outside of the wall the coupling begins anew, {anew}"""
_CONTACT = """\
IN CONTACT. Where a position is refused the law stands still. The last force is given for the part of the depth that
hand and force cannot have left yet: it falls, and is 0 after a few samples, at once in a stiff wall. The law goes on
at the depth that it knows with the first position that is believed, with the second in a row where no force was left;
its force comes back within as many samples as were lost, {fade:.4g} s at most. What a device went into the wall
unseen, before the first sample too, does not count: the wall begins so much deeper until the device has been at 0 or
below."""
_EVERYWHERE = """\
FAULT MODEL. Bad positions while the device rests, the first of them {jump:.4g} m or more away, the others wherever
they like or as they agree, drifting by {drift:.4g} m a sample at most: up to {lasting} in a row give 0 N, as does a
single one that is refused. More in a row, or a smaller jump, cannot be told from a hand. After {lost:.4g} s without a
position that is believed (an encoder that was set to 0 anew) the next one is where the device is.
BEGINNING. The law begins at rest where the device is, and its force rises from 0 in {fade:.4g} s. After refused
positions it begins anew with the second in a row that is believed, and rises within as many samples as were lost."""
_AMONG_DETENTS = """\
AMONG DETENTS. Where a position is refused the force is 0, and stays 0 until the device has been at 0 or below and
two positions in a row are believed; then it comes back within as many samples as were lost, {fade:.4g} s at most."""

_OUT_OF_THE_WALL = "A positive force acts towards negative positions, out of the wall."
_SENSE: dict[Place, str] = {
    "wall": _OUT_OF_THE_WALL,
    "detents": _OUT_OF_THE_WALL,
    "everywhere": "A positive force acts towards negative positions: a spring gives one where position_m is above 0.",
}
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
{sensor}
/* The state of a device that has always rested at a position. */
static void rest(avc_coupling_t *coupling, {real} position_m)
{{
{rest}
}}

void avc_coupling_start(avc_coupling_t *coupling)
{{
    rest(coupling, {zero});
    forget(&coupling->sensor);
    coupling->sensor.runs = 0u;
    coupling->given_n = {zero};
    coupling->share = {one};
    coupling->rise = {one};
    coupling->face_m = {zero};
    coupling->depth_m = {zero};
}}

/* The share of the depth that hand and force cannot have left since the last position that was believed. */
static {real} certain(const avc_coupling_t *coupling)
{{
    const avc_coupling_sensor_t *sensor = &coupling->sensor;
    const {real} samples = ({real})sensor->missed;
    const {real} leaving_m = sensor->moved_m < {zero} ? sensor->moved_m : {zero};
    const {real} left_m = samples * ({half} * (samples + {one}) * driven(sensor) - leaving_m);
    return left_m < coupling->depth_m ? (coupling->depth_m - left_m) / coupling->depth_m : {zero};
}}

{real} avc_coupling_step(avc_coupling_t *coupling, {real} position_m)
{{
    avc_coupling_sensor_t *sensor = &coupling->sensor;
    const unsigned int missed = sensor->missed;
{before}    const {real} kept = missed != 0u ? certain(coupling) : {one};
    const {real} first_m = {first};
    const int seen = look(sensor, position_m, first_m);
    {real} given_n;{moved}
    if (seen == REFUSED) {{
        return certain(coupling) * coupling->given_n;
    }}
    if (seen == AGAIN{moves}) {{
        sensor->runs = 0u;
        coupling->share = kept * coupling->share;
        coupling->rise = {one} / ({real})(missed < {fade} ? missed + 1u : {fade});
        if ({waits}) {{
            coupling->given_n = {zero};
            return {zero};
        }}
    }}
{begin}
{body}
    if (!(command_n >= {lowest} && command_n <= {largest})) {{
        rest(coupling, position_m);
        sensor->runs = 0u;
        coupling->given_n = {zero};
        return {zero};
    }}
    given_n = force_n;
    if (coupling->share < {one}) {{
        coupling->share += coupling->rise;
        coupling->share = coupling->share < {one} ? coupling->share : {one};
        given_n = coupling->share * force_n;
    }}
{stores}
    coupling->given_n = given_n;
    push(sensor, given_n);
    return given_n;
}}
"""

_BEFORE = "    const {real} before_m = sensor->position_m;\n"
_FIRST_OF_WALLS = "sensor->runs != 0u && before_m > {zero} ? {inside} : driven(sensor)"
# A law goes on where the device still rests outside of the wall: begun anew it would take a count for a movement.
_MOVES_OF_WALLS = """ &&
        (coupling->depth_m > {zero} || position_m{ahead} > {zero} || !within(position_m - before_m, {unsure}))"""
# Outside of a wall whatever the law gives is of a law that has begun anew; elsewhere a place is seen twice.
_WAITS_OF_WALLS = "!(coupling->share > {zero}) && position_m{ahead} > {zero}"
_WAITS_OF_DETENTS = "!(coupling->share > {zero})"

# What a device went into the wall unseen does not count, so that nothing begins stretched. {ahead} is how far before
# the measured position a law looks: it is in the wall, or out of it, where it sees itself.
_BEGIN = """\
    moved = coupling->face_m > {zero};
    if (sensor->runs == 0u && position_m{ahead} - coupling->face_m > coupling->depth_m) {{
        coupling->face_m = position_m{ahead} - coupling->depth_m;
    }}
    if (position_m{ahead} <= {zero}) {{
        coupling->face_m = {zero};
    }}
    coupling->depth_m = position_m{ahead} > coupling->face_m ? position_m{ahead} - coupling->face_m : {zero};
    if ((sensor->runs == 0u && coupling->depth_m <= {zero}) ||
        (position_m{ahead} <= {zero} && moved)) {{
        rest(coupling, position_m - coupling->face_m);
        if (position_m{ahead} <= {zero}) {{
            coupling->share = {one};
        }}
    }}
    sensor->runs = 1u;
    position_m = position_m - coupling->face_m;"""
# Detents have fixed positions: behind a moved wall they would differ.
_BEGIN_OUTSIDE = """\
    if (sensor->runs == 0u) {{
        if (position_m > {zero}) {{
            return {zero};
        }}
        rest(coupling, position_m);
        sensor->runs = 1u;
    }}"""
# A law about 0 has no outside at which it gives no force: it rises from 0 where it begins.
_BEGIN_EVERYWHERE = """\
    if (sensor->runs == 0u) {{
        rest(coupling, position_m);
        if (coupling->rise >= {one}) {{
            coupling->share = {zero};
            coupling->rise = {one} / ({real}){fade};
        }}
        sensor->runs = 1u;
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


@dataclass(frozen=True)
class _Guard:
    """What a sample does with a position that is refused, by where a force acts: parts of `_SOURCE` and the header."""

    begin: str
    waits: str
    first: str
    faults: tuple[str, ...]
    anew: str
    before: str = ""
    moves: str = ""
    moved: str = ""


_GUARDS: dict[Place, _Guard] = {
    "wall": _Guard(
        begin=_BEGIN,
        waits=_WAITS_OF_WALLS,
        first=_FIRST_OF_WALLS,
        faults=(_BELIEVED, _FAULT_MODEL, _CONTACT),
        anew="inside the wall begins there.",
        before=_BEFORE,
        moves=_MOVES_OF_WALLS,
        moved="\n    int moved;",
    ),
    "detents": _Guard(
        begin=_BEGIN_OUTSIDE,
        waits=_WAITS_OF_DETENTS,
        first="{inside}",
        faults=(_BELIEVED, _FAULT_MODEL, _AMONG_DETENTS),
        anew="inside there is no force until the device has been outside.",
    ),
    "everywhere": _Guard(
        begin=_BEGIN_EVERYWHERE,
        waits=_WAITS_OF_DETENTS,
        first="{inside}",
        faults=(_BELIEVED, _EVERYWHERE),
        anew="",
    ),
}


def export_c(
    exported: Coupling | Problem, *, precision: str = "single", name: str = c_frame.NAME, unsafe: bool = False
) -> dict[str, str]:
    """Return a coupling to any end, or the law of a problem, as C: ``avc_coupling.h``, ``avc_coupling.c`` by name."""
    chosen = c_frame.checked(precision, name)
    if isinstance(exported, Problem):
        files = _files(law_subject(exported, unsafe=unsafe), law_program(exported, chosen), chosen)
        return c_frame.named(files, name)
    if not isinstance(exported, Coupling):
        require_coupling(exported)
    return c_frame.named(coupling_files(exported.end, exported, chosen, unsafe=unsafe), name)


@singledispatch
def coupling_files(end: End, coupling: Coupling, precision: Precision, *, unsafe: bool) -> dict[str, str]:  # noqa: ARG001
    """Return the C of a coupling to an end, by file name."""
    return pair_files(coupling, precision, pair_verdict(coupling, unsafe=unsafe)[0])


@coupling_files.register
def _wall_files(end: Wall, coupling: Coupling, precision: Precision, *, unsafe: bool) -> dict[str, str]:  # noqa: ARG001
    subject = coupling_subject(coupling, require_deployable(coupling, unsafe=unsafe))
    return _files(subject, coupling_program(coupling, precision), precision)


def _files(subject: CSubject, program: CouplingProgram, precision: Precision) -> dict[str, str]:
    return c_frame.header_and_source(_header(subject, program, precision), _source(subject, program, precision))


def _header(subject: CSubject, program: CouplingProgram, precision: Precision) -> str:
    """Return the text of the C header of a coupling or law: units, limits, verdict, and its state."""
    device = subject.problem.device
    force = device.max_force_n
    return _HEADER.format(
        **c_frame.FRAME,
        what=subject.what,
        head="\n".join(f" * {line}".replace(" *  * ", " * ") for line in subject.head),
        id=subject.id,
        units=c_frame.head_words(subject.problem)["units"],
        meant=subject.meant,
        verdict=c_frame.comment_lines(subject.sentence),
        judged_for=c_frame.judged_for(subject.judged_for),
        force="the problem states no limit; limit the force yourself" if force is None else f"limited at {force:.9g} N",
        sample_time=device.sample_time_s,
        sample_time_literal=precision.literal(device.sample_time_s),
        sample_time_ns=round(device.sample_time_s * c_frame.NS_PER_S),
        max_force="" if force is None else f"#define AVC_COUPLING_MAX_FORCE_N {precision.literal(force)}\n",
        precision=precision.name,
        real=precision.c_type,
        table="" if program.before is None else "; on AVR the table stays in flash",
        states="\n".join(f"    {precision.c_type} {name};" for name in program.states),
        sides="" if subject.place == "everywhere" else ": above 0 inside the wall, below 0 outside",
        sense=_SENSE[subject.place],
        limited="" if force is None else ", limited at AVC_COUPLING_MAX_FORCE_N",
        sensor=SENSOR_TYPE.format(real=precision.c_type, more=_RUNS),
        faults=_fault_model(device, _GUARDS[subject.place]),
    )


def _fault_model(device: Device, guard: _Guard) -> str:
    """Return what a header says of positions that are not believed."""
    bounds, fade_s = SensorBounds.of(device), fade_samples(device) * device.sample_time_s
    numbers = {
        "farthest": FARTHEST_M,
        "fastest": bounds.fastest_m_per_s,
        "hand": bounds.hand_m + bounds.unsure_m,
        "driven": bounds.driven_m + bounds.unsure_m,
        "inside": bounds.inside_m + bounds.unsure_m,
        "unsure": bounds.unsure_m,
        "jump": JUMP_M / device.metres_per_unit,
        "drift": DRIFT_M / device.metres_per_unit,
        "lasting": bounds.most_bad_samples(device.metres_per_unit),
        "lost": bounds.lost_samples * device.sample_time_s,
        "anew": guard.anew,
        "fade": fade_s,
    }
    return "\n".join(f" * {c_frame.comment_lines(paragraph.format(**numbers))}" for paragraph in guard.faults)


def _source(subject: CSubject, program: CouplingProgram, precision: Precision) -> str:
    """Return the C source of a coupling or law: sensor checks, table look-up, and the statements of a sample."""
    literal = precision.literal
    device, guard = subject.problem.device, _GUARDS[subject.place]
    words = {"real": precision.c_type, "zero": literal(0.0), "half": literal(0.5), "one": literal(1.0)}
    words |= SensorBounds.of(device).literals(precision) | {"end": "", "passed": ""}
    words["ahead"] = f" + {literal(subject.ahead_m)}" if subject.ahead_m > 0 else ""
    words["fade"] = f"{fade_samples(device)}u"
    parts = {name: getattr(guard, name).format(**words) for name in ("begin", "waits", "first", "before", "moves")}
    given = dict.fromkeys(program.asked, "given_n")
    return _SOURCE.format(
        id=subject.id,
        checks=c_frame.compiler_checks(precision),
        **words,
        **parts,
        sensor=SENSOR.format(**words),
        moved=guard.moved,
        look_up="" if subject.table is None else _look_up(subject.table, precision),
        rest=_indented(start_lines("coupling", program.states, program.initial, precision=precision)),
        lowest=literal(-precision.largest),
        largest=literal(precision.largest),
        body=_indented(_body(program, precision)),
        stores=_indented([f"coupling->{name} = {given.get(name, f'next_{name}')};" for name in program.states]),
    )


def _look_up(stated: GainTable, precision: Precision) -> str:
    """Return the C of the look-up of gains: linear in ln(frequency), with the device's own logarithm."""
    literal, rows = precision.literal, stated.rows if precision is DOUBLE else stated.single()
    lines = [
        "    {{{}}},".format(", ".join(map(literal, (logarithm, *row))))
        for logarithm, row in zip(precision.ln(rows[:, 0]), rows, strict=True)
    ]
    first, *rest = map(literal, precision.ln.coefficients)
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
        series=_indented([f"series = series * z + {coefficient};" for coefficient in rest]),
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
