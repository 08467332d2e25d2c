#include <stddef.h>

#include "avc_frame.h"
#include "avc_lookup.h"

_Static_assert(sizeof(avc_table_header_t) == 32, "the table header travels as 32 bytes");
_Static_assert(sizeof(avc_config_t) == 68u + 4u * AVC_NUMBERS, "a configuration travels without padding");
_Static_assert(sizeof(avc_row_t) == 16, "a row travels as 16 bytes");
_Static_assert(offsetof(avc_image_t, feedback) == 48, "the state feedback follows the only row");
_Static_assert(offsetof(avc_feedback_t, number) == 32, "32 bytes of the state feedback come before its matrices");
_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "the wire format is the memory format");

/* Beyond these a frequency is no interaction frequency and avc_ln would leave its range. */
static const float frequency_min_hz = 1e-6f;
static const float frequency_max_hz = 1e6f;

avc_reason_t avc_size_check(uint32_t rows, uint32_t states)
{
    if (rows > AVC_ROWS_MAX || (rows == 0u && states != 0u)) {
        return AVC_REFUSED_ROWS;
    }
    if (states > AVC_STATES_MAX || (states != 0u && rows != 1u)) {
        return AVC_REFUSED_STATES;
    }
    return AVC_OK;
}

uint32_t avc_image_size(uint32_t rows, uint32_t states)
{
    if (rows == 0u) {
        return 0u;
    }
    uint32_t size = (uint32_t)sizeof(avc_table_header_t) + rows * (uint32_t)sizeof(avc_row_t);
    if (states != 0u) {
        size += (uint32_t)offsetof(avc_feedback_t, number) + states * (states + 3u) * (uint32_t)sizeof(float);
    }
    return size;
}

static int within(float x, float most)
{
    return x >= 0.0f && x <= most; /* false for NaN */
}

avc_reason_t avc_config_check(const avc_config_t *config, const avc_config_t *now, bool bound)
{
    if (avc_crc32(0, (const uint8_t *)&config->limits, sizeof *config - sizeof config->crc32) != config->crc32) {
        return AVC_REFUSED_CRC;
    }
    const float *limit = &config->limits.sample_time_s, *own = &now->limits.sample_time_s;
    for (uint32_t i = 0; i < sizeof config->limits / sizeof *limit; i++) {
        if (!avc_is_finite(limit[i]) || limit[i] < 0.0f || (i < 6u && limit[i] == 0.0f)) {
            return AVC_REFUSED_LIMIT; /* the first six have no 0 for "not watched" */
        }
        if (bound && avc_bits(limit[i]) != avc_bits(own[i])) {
            return AVC_REFUSED_BOARD; /* another device */
        }
    }
    if (config->limits.sample_time_s < 1e-5f || config->limits.sample_time_s > 0.1f) {
        return AVC_REFUSED_LIMIT;
    }
    for (uint32_t i = 0; i < AVC_NUMBERS; i++) {
        if (!avc_is_finite(config->number[i])) {
            return AVC_REFUSED_NOT_FINITE;
        }
    }
    const avc_figures_t *figures = &config->figures;
    const bool handle = avc_bits(figures->hand_m_per_unit) == avc_bits(now->figures.hand_m_per_unit);
    const bool program = figures->estimator == now->figures.estimator && figures->passive == now->figures.passive;
    return program && (handle || !bound) ? AVC_OK : AVC_REFUSED_BOARD;
}

avc_reason_t avc_gains_check(const avc_gains_t *gains, const avc_limits_t *limits)
{
    if (!avc_is_finite(gains->damping_ns_per_m) || !avc_is_finite(gains->stiffness_n_per_m) ||
        !avc_is_finite(gains->contact_damping_ns_per_m)) {
        return AVC_REFUSED_NOT_FINITE;
    }
    if (!within(gains->damping_ns_per_m, limits->max_damping_ns_per_m) ||
        !within(gains->stiffness_n_per_m, limits->max_stiffness_n_per_m) ||
        !within(gains->contact_damping_ns_per_m, limits->max_contact_damping_ns_per_m)) {
        return AVC_REFUSED_LIMIT;
    }
    return AVC_OK;
}

static avc_reason_t header_check(const avc_table_header_t *header, const avc_limits_t *limits)
{
    const float tolerance = limits->sample_time_s * 1e-5f;
    const float off = header->sample_time_s - limits->sample_time_s;
    if (!(off <= tolerance && off >= -tolerance)) {
        return AVC_REFUSED_SAMPLE_TIME;
    }
    const avc_gains_t safe = {header->safe_damping_ns_per_m, header->safe_stiffness_n_per_m, 0.0f};
    const avc_reason_t reason = avc_gains_check(&safe, limits);
    if (reason != AVC_OK) {
        return reason;
    }
    if (!within(header->wall_damping_ns_per_m, limits->max_damping_ns_per_m) ||
        !within(header->wall_stiffness_n_per_m, limits->max_stiffness_n_per_m)) {
        return AVC_REFUSED_WALL; /* NaN too */
    }
    if (!(header->wall_damping_ns_per_m + header->wall_stiffness_n_per_m > 0.0f)) {
        return AVC_REFUSED_WALL; /* a wall that gives no force is none */
    }
    if (!within(header->max_force_n, limits->max_force_n * 1.00001f)) {
        return AVC_REFUSED_FORCE; /* with less force than it was made for it is another coupling */
    }
    if (((uint32_t)header->flags & ((1u << AVC_TABLE_STATES) - 1u) & ~(uint32_t)AVC_TABLE_FLAGS) != 0u) {
        return AVC_REFUSED_FLAGS; /* it asks for what this firmware does not do */
    }
    return header->coupling_id != 0u ? AVC_OK : AVC_REFUSED_COUPLING;
}

static avc_reason_t feedback_check(const avc_feedback_t *feedback, uint32_t states)
{
    const float *zone = &feedback->dead_zone_m;
    for (uint32_t i = 0; i < AVC_ZONE_NUMBERS; i++) {
        if (!avc_is_finite(zone[i])) {
            return AVC_REFUSED_NOT_FINITE;
        }
        if (!(zone[i] >= 0.0f)) {
            return AVC_REFUSED_LIMIT;
        }
    }
    for (uint32_t i = 0; i < states * (states + 3u); i++) {
        if (!avc_is_finite(feedback->number[i])) {
            return AVC_REFUSED_NOT_FINITE;
        }
    }
    if (feedback->kept > 1.0f || feedback->smoothing > 1.0f) {
        return AVC_REFUSED_LIMIT; /* the range would grow for ever */
    }
    const uint32_t positions = feedback->positions;
    if (feedback->measures >= states || positions >> states != 0u || (positions >> feedback->measures & 1u) == 0u) {
        return AVC_REFUSED_LIMIT;
    }
    return AVC_OK;
}

avc_reason_t avc_image_check(const avc_image_t *image, const avc_limits_t *limits, uint16_t *at_row)
{
    const uint32_t states = avc_states(&image->header);
    *at_row = AVC_AT_HEADER;
    avc_reason_t reason = avc_size_check(image->header.rows, states);
    if (reason != AVC_OK) {
        return reason;
    }
    reason = header_check(&image->header, limits);
    if (reason != AVC_OK) {
        return reason;
    }
    if (states != 0u) {
        if ((image->header.flags & AVC_TABLE_VARIES) != 0u) {
            return AVC_REFUSED_LIMIT;
        }
        *at_row = AVC_AT_FEEDBACK;
        reason = feedback_check(&image->feedback, states);
        if (reason != AVC_OK) {
            return reason;
        }
    }
    float previous_hz = 0.0f;
    for (uint16_t i = 0; i < image->header.rows; i++) {
        const avc_row_t *row = &image->row[i];
        const avc_gains_t gains = {row->damping_ns_per_m, row->stiffness_n_per_m, row->contact_damping_ns_per_m};
        *at_row = i;
        if (!avc_is_finite(row->frequency_hz)) {
            return AVC_REFUSED_NOT_FINITE;
        }
        if (!(row->frequency_hz >= frequency_min_hz && row->frequency_hz <= frequency_max_hz)) {
            return AVC_REFUSED_LIMIT;
        }
        if (!(row->frequency_hz > previous_hz)) {
            return AVC_REFUSED_NOT_MONOTONIC;
        }
        reason = avc_gains_check(&gains, limits);
        if (reason != AVC_OK) {
            return reason;
        }
        previous_hz = row->frequency_hz;
    }
    *at_row = AVC_AT_HEADER;
    return AVC_OK;
}

void avc_table_prepare(avc_table_t *table)
{
    for (uint32_t i = 0; i < table->image.header.rows; i++) {
        table->ln_frequency[i] = avc_ln(table->image.row[i].frequency_hz);
    }
}
