"""Export: the table and a step function as one C header for firmware of one's own."""

from __future__ import annotations

import numpy as np

from avc_casadi.coupling import GainSchedule
from avc_casadi.support import Float32Array
from avc_hardware._firmware import GENERATED
from avc_hardware._float_program import literal
from avc_hardware._reference import ln
from avc_hardware._table import (
    gain_table,
)

_HEADER = """\
/* Gains of an adaptive virtual coupling against interaction frequency: made by avc-casadi, do not edit.
 * {source}
 * {rows} rows, {low:.6g} to {high:.6g} Hz, sample time {sample_time:.6g} s; rounding changed gains by {rounding:.2g}.
 * Compile with -ffp-contract=off to get the same bits on every machine. Runs at {rate:.6g} Hz only; needs no library.
 */
#ifndef AVC_GAINS_H
#define AVC_GAINS_H

#include <stdbool.h>

#define AVC_ROWS {rows}
#define AVC_SAMPLE_TIME_S {time_literal}

typedef struct {{
    float damping_ns_per_m, stiffness_n_per_m, contact_damping_ns_per_m;
}} avc_gains_t;

static const struct {{
    float ln_frequency, frequency_hz;
    avc_gains_t gains;
}} avc_rows[AVC_ROWS] = {{
{table}
}};
"""

_LOOKUP = """
/* ln x of a normal positive number. */
static inline float avc_ln(float x)
{
    union { float f; unsigned u; } bits = {x};
    int exponent = (int)(bits.u >> 23) - 127;
    bits.u = (bits.u & 0x007FFFFFu) | 0x3F800000u;
    if (bits.f > 1.41421354f) { bits.f = bits.f * 0.5f; exponent += 1; }
    const float s = (bits.f - 1.0f) / (bits.f + 1.0f), z = s * s;
    const float series = (((0.111111112f * z + 0.142857149f) * z + 0.2f) * z + 0.333333343f) * z + 1.0f;
    return (float)exponent * 0.693147182f + (s + s) * series;
}

/* Gains at a frequency: linear in ln(frequency); the end rows beyond the ends, the first where it is NaN (at rest). */
static inline avc_gains_t avc_lookup(float frequency_hz)
{
    int low = 0, high = AVC_ROWS - 1;
    if (!(frequency_hz > avc_rows[low].frequency_hz)) return avc_rows[low].gains;
    if (frequency_hz >= avc_rows[high].frequency_hz) return avc_rows[high].gains;
    while (high - low > 1) {
        const int middle = (low + high) / 2;
        if (frequency_hz < avc_rows[middle].frequency_hz) high = middle; else low = middle;
    }
    const float base = avc_rows[low].ln_frequency;
    float share = (avc_ln(frequency_hz) - base) / (avc_rows[high].ln_frequency - base);
    if (!(share >= 0.0f && share <= 1.0f)) share = 0.0f;
    const avc_gains_t a = avc_rows[low].gains, b = avc_rows[high].gains;
    const avc_gains_t gains = {
        a.damping_ns_per_m + share * (b.damping_ns_per_m - a.damping_ns_per_m),
        a.stiffness_n_per_m + share * (b.stiffness_n_per_m - a.stiffness_n_per_m),
        a.contact_damping_ns_per_m + share * (b.contact_damping_ns_per_m - a.contact_damping_ns_per_m),
    };
    return gains;
}
"""

_STEP = """
/* One control tick: position (m, positive into a one-sided wall at 0) to force (N, positive out of the wall). Call
 * avc_couple_start once before. Limit the force and check it for NaN before it reaches the motor; where you limit it,
 * write what is held to state->held_force_n. */
static inline float avc_step(avc_couple_state_t *state, float position_m, float frequency_hz,
                             float wall_damping_ns_per_m, float wall_stiffness_n_per_m)
{
    const avc_gains_t gains = avc_lookup(frequency_hz);
    const avc_couple_in_t in = {
        .position_m = position_m,
        .wanted_damping_ns_per_m = gains.damping_ns_per_m,
        .wanted_stiffness_n_per_m = gains.stiffness_n_per_m,
        .wanted_contact_damping_ns_per_m = gains.contact_damping_ns_per_m,
        .wall_damping_ns_per_m = wall_damping_ns_per_m,
        .wall_stiffness_n_per_m = wall_stiffness_n_per_m,
    };
    avc_couple_out_t out;
    avc_couple_step(state, &in, &out);
    return out.force_n;
}

#endif
"""


def export_c(gains: GainSchedule, *, sample_time_s: float | None = None) -> str:
    """Return a C header: the usable rows as a const float table, and functions to look it up and step the coupling.

    Args:
        gains: rows without usable gains are left out.
        sample_time_s: for schedules that do not know theirs (bare CSV files).

    Raises:
        InputError: no usable row, or no sample time.
    """
    table = gain_table(gains, sample_time_s=sample_time_s)
    rows: Float32Array = table.rows
    lines = [
        "    {{{}, {}, {{{}, {}, {}}}}},".format(*map(literal, (logarithm, *row)))
        for logarithm, row in zip(ln(rows[:, 0]), rows, strict=True)
    ]
    source = f"{gains.problem}: method {gains.method}, structure {gains.structure}, model {gains.model}"
    header = _HEADER.format(
        source=source.replace("*/", "* /").replace("\n", " "),
        rows=len(rows),
        low=rows[0, 0],
        high=rows[-1, 0],
        sample_time=table.sample_time_s,
        time_literal=literal(np.float32(table.sample_time_s)),
        rounding=table.rounding_max,
        rate=1 / table.sample_time_s,
        table="\n".join(lines),
    )
    return header + _LOOKUP + _coupling_step() + _STEP


def _coupling_step() -> str:
    """The force law of the firmware, which is that of the scenes, as functions of a header."""
    header = (GENERATED / "avc_couple.h").read_text(encoding="utf-8")
    types = header[header.index("typedef") : header.index("/* The state of")]
    source = (GENERATED / "avc_couple.c").read_text(encoding="utf-8")
    functions = source[source.index("void ") :].replace("void avc_couple", "static inline void avc_couple")
    return f"\n/* Coupling, adaptation and wall: the expressions of the scenes, generated. */\n{types}{functions}"
