"""Export: the table and a step function as one C header for firmware of one's own."""

from __future__ import annotations

import numpy as np

from avc_casadi.design import GainSchedule
from avc_hardware._firmware import GENERATED
from avc_hardware._float_program import literal
from avc_hardware._reference import ln
from avc_hardware._table import Float32Array, gain_table

_HEADER = """\
/* Gains of an adaptive virtual coupling against interaction frequency: made by avc-casadi, do not edit.
 * {source}
 * {rows} rows, {low:.6g} to {high:.6g} Hz, sample time {sample_time:.6g} s; rounding changed gains by {rounding:.2g}.
 * Compile with -ffp-contract=off to get the same bits on every machine. Needs no library.
 */
#ifndef AVC_GAINS_H
#define AVC_GAINS_H

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

_COUPLING = """
/* State of the coupling; start with zeros. */
typedef struct {
    float coupling_deflection_before_m, environment_deflection_before_m, contact_depth_before_m, tool_m;
} avc_coupling_t;

"""

_STEP = """
/* One control tick: position (m, positive into a one-sided wall at 0) to force (N, positive out of the wall).
 * Limit the force and check it for NaN before it reaches the motor. */
static inline float avc_step(avc_coupling_t *state, float position_m, float frequency_hz, float wall_damping_ns_per_m,
                             float wall_stiffness_n_per_m)
{
    const avc_gains_t gains = avc_lookup(frequency_hz);
    return avc_coupling_step(state, position_m, &gains, wall_damping_ns_per_m, wall_stiffness_n_per_m,
                             AVC_SAMPLE_TIME_S);
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
        table="\n".join(lines),
    )
    return header + _LOOKUP + _COUPLING + _coupling_step() + _STEP


def _coupling_step() -> str:
    """The force law of the firmware, which is that of the scenes, as a function of a header."""
    text = GENERATED.read_text(encoding="utf-8")
    comment, _, function = text.partition('#include "avc_coupling.h"\n\n')
    return comment + "static inline " + function
