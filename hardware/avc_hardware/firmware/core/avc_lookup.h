/* The look-up: gains at a frequency, linear in ln(frequency) between two rows. Compiled into the tick. */
#ifndef AVC_LOOKUP_H
#define AVC_LOOKUP_H

#include "avc_table.h"

/* Natural logarithm of a normal positive number: the same float32 operations on every machine. */
static inline float avc_ln(float x)
{
    uint32_t bits = avc_bits(x);
    int32_t exponent = (int32_t)(bits >> 23) - 127;
    bits = (bits & 0x007FFFFFu) | 0x3F800000u;
    float m;
    memcpy(&m, &bits, sizeof m);
    if (m > 1.41421354f) {
        m = m * 0.5f;
        exponent += 1;
    }
    const float s = (m - 1.0f) / (m + 1.0f); /* ln m = 2 artanh s, |s| <= 0.172 */
    const float z = s * s;
    float series = 0.111111112f;
    series = series * z + 0.142857149f;
    series = series * z + 0.2f;
    series = series * z + 0.333333343f;
    series = series * z + 1.0f;
    return (float)exponent * 0.693147182f + (s + s) * series;
}

static inline avc_gains_t avc_gains_of(const avc_row_t *row)
{
    return (avc_gains_t){row->damping_ns_per_m, row->stiffness_n_per_m, row->contact_damping_ns_per_m};
}

/* Gains at a frequency; the first and last row beyond the table's ends, and the first for NaN. */
static inline avc_gains_t avc_table_lookup(const avc_table_t *table, float frequency_hz)
{
    const avc_row_t *rows = table->image.row;
    const uint32_t last = (uint32_t)table->image.header.rows - 1u;
    const uint32_t key = avc_bits(frequency_hz);
    if (!(frequency_hz > rows[0].frequency_hz)) {
        return avc_gains_of(&rows[0]);
    }
    if (frequency_hz >= rows[last].frequency_hz) {
        return avc_gains_of(&rows[last]);
    }
    uint32_t low = 0u, high = last;
    while (high - low > 1u) {
        const uint32_t middle = (low + high) >> 1;
        if (key >= avc_bits(rows[middle].frequency_hz)) {
            low = middle;
        } else {
            high = middle;
        }
    }
    const float ln = avc_ln(frequency_hz);
    const avc_row_t *a = &rows[low];
    const avc_row_t *b = &rows[low + 1u];
    const float base = table->ln_frequency[low];
    const float span = table->ln_frequency[low + 1u] - base;
    float share = (ln - base) / span;
    if (avc_bits(share) > avc_bits(1.0f)) { /* also below 0: neighbours so close that their logarithms are equal */
        share = 0.0f;
    }
    return (avc_gains_t){
        a->damping_ns_per_m + share * (b->damping_ns_per_m - a->damping_ns_per_m),
        a->stiffness_n_per_m + share * (b->stiffness_n_per_m - a->stiffness_n_per_m),
        a->contact_damping_ns_per_m + share * (b->contact_damping_ns_per_m - a->contact_damping_ns_per_m),
    };
}

#endif
