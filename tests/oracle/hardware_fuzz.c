/* Fuzzing the device from the wire. Two ways in, chosen by the first byte of the input: raw bytes, which meet the framing;
 * and messages, which the harness frames with a right checksum, because random bytes never pass one. Between them ticks
 * run. After each, what must always hold is checked.
 *
 * clang -fsanitize=fuzzer,address,undefined */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "avc_device.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static avc_device_t device;

static void must(bool holds, const char *what)
{
    if (!holds) {
        (void)fprintf(stderr, "violated: %s\n", what);
        abort();
    }
}

static void check(void)
{
    const avc_control_t *control = &device.control;
    const avc_transfer_t *transfer = &device.transfer;
    const avc_limits_t limits = control->config.limits;
    must(device.boot_id == 1u && device.unique[0] == 0u, "nothing is written beyond the buffer of an answer");
    must(device.decoder.size <= AVC_CONTENT_MAX, "a frame fits its buffer");
    must(transfer->received <= transfer->size && transfer->size <= sizeof(avc_image_t), "a transfer fits its table");
    must(device.rx.written - device.rx.read <= AVC_RING_SIZE, "the receive ring holds what it can");
    must(device.tx.written - device.tx.read <= AVC_RING_SIZE, "the transmit ring holds what it can");
    must(avc_config_check(&control->config, &control->config, false) == AVC_OK, "the configuration is whole");
    must(control->active < 2u && control->stream_slot < 2u, "one of two is active");
    must(avc_is_finite(control->state.force_n), "the force is a number");
    must(control->state.force_n <= limits.max_force_n && control->state.force_n >= -limits.max_force_n,
         "the force keeps its limit");
    const float lowered = control->lowered.force_n * 1.000001f;
    must(lowered <= limits.max_force_n * 1.00001f, "no limit rises above the board's");
    must((control->state.force_n <= lowered && control->state.force_n >= -lowered) || control->fault.codes != 0u ||
             control->limits_wanted != 0u,
         "the force keeps the lowered limit");
    must(control->telemetry.made - control->telemetry.sent <= AVC_SAMPLES_KEPT, "the records fit");
    const avc_excite_t *excited = &control->excite;
    must(excited->state <= AVC_EXCITE_FAULT, "an excitation ends in a known way");
    if (excited->state == AVC_EXCITE_RUNS) {
        const float most = excited->plan.max_force_n * 1.000001f;
        must(control->state.force_n <= most && control->state.force_n >= -most, "an excitation keeps its force limit");
        must(control->state.has_table == 0u, "no table runs beside an excitation");
        must(excited->made <= excited->plan.ticks, "an excitation ends in time");
    } else if (control->state.has_table == 0u) {
        must(control->state.force_n == 0.0f || control->fault.codes != 0u, "no force after an excitation");
    }
    must((control->fault.codes != 0u) == (control->state.mode == AVC_MODE_FAULT), "a fault is a mode");
    if (control->state.has_table != 0u) {
        const avc_table_t *table = &control->tables[control->active];
        uint16_t row;
        must(avc_image_check(&table->image, &limits, &row) == AVC_OK, "the running table is valid");
        const uint32_t states = avc_states(&table->image.header);
        const size_t total = avc_image_size(table->image.header.rows, states);
        must(avc_crc32(0, (const uint8_t *)&table->image, total) == table->crc32, "the running table is whole");
        must(states <= AVC_STATES_MAX && (states == 0u || table->image.header.rows == 1u), "the states fit");
    }
}

static void drain(void)
{
    uint8_t byte;
    do {
        while (avc_ring_get(&device.tx, &byte)) {
        }
    } while (avc_device_poll(&device));
}

static void feed(const uint8_t *data, size_t size)
{
    for (size_t i = 0; i < size; i++) {
        (void)avc_ring_put(&device.rx, data[i]);
        if (data[i] == 0u || i % 256u == 255u) {
            drain();
        }
    }
    drain();
}

static void message(uint8_t type, const uint8_t *payload, size_t size)
{
    static uint8_t content[AVC_CONTENT_MAX];
    static uint8_t encoded[AVC_FRAME_MAX];
    content[0] = AVC_PROTOCOL_VERSION;
    content[1] = type;
    content[2] = 7u;
    content[3] = 0u;
    memcpy(&content[AVC_HEADER_SIZE], payload, size);
    feed(encoded, avc_frame_encode(content, AVC_HEADER_SIZE + size, encoded));
}

static void tick(int32_t count)
{
    (void)avc_control_tick(&device.control, count);
    drain();
}

/* A valid upload of a table whose rows come from the input, so that deep states are reached quickly. */
static void upload(const uint8_t *data, size_t size)
{
    static uint8_t payload[12 + AVC_CHUNK_MAX];
    avc_image_t image;
    memset(&image, 0, sizeof image);
    const uint32_t states = size > 4u && (data[4] & 1u) != 0u ? data[4] / 2u % (AVC_STATES_MAX + 1u) : 0u;
    const uint32_t rows = size > 3u && states == 0u ? 1u + data[3] : 1u;
    image.header.rows = (uint16_t)rows;
    image.header.sample_time_s = device.control.config.limits.sample_time_s;
    image.header.flags = (uint16_t)((size > 0u ? data[0] & 15u : 0u) | states << AVC_TABLE_STATES);
    image.header.wall_stiffness_n_per_m = 1e4f;
    image.header.coupling_id = 7u;
    const float apart_hz = size > 5u && (data[5] & 1u) != 0u ? 1e-4f : 1.0f; /* rows that crowd, too */
    for (uint32_t i = 0; i < rows; i++) {
        const float value = size > 0u ? (float)data[i % size] : 1.0f;
        image.row[i] = (avc_row_t){1.0f + apart_hz * (float)i, value, 1000.0f * value, value};
    }
    if (states != 0u) {
        image.header.flags = (uint16_t)(image.header.flags & ~(uint32_t)AVC_TABLE_VARIES);
        image.feedback.measures = (uint16_t)(data[4] / 16u % states);
        image.feedback.positions = (uint16_t)((1u << states) - 1u);
        for (uint32_t i = 0; i < states * (states + 3u); i++) {
            image.feedback.number[i] = ((float)data[i % size] - 128.0f) / 64.0f;
        }
    }
    if (size > 2u) {
        const size_t at = data[1] % avc_image_size(rows, states);
        ((uint8_t *)&image)[at] = (uint8_t)(((uint8_t *)&image)[at] ^ data[2]);
    }
    const uint32_t total = avc_image_size(rows, states);
    const uint32_t crc = avc_crc32(0, (const uint8_t *)&image, total);
    const uint32_t begin[5] = {1u, crc, crc, rows | 1u << 16, states};
    message(AVC_MESSAGE_BEGIN, (const uint8_t *)begin, sizeof begin);
    for (uint32_t sent = 0; sent < total;) {
        const uint32_t part = total - sent < AVC_CHUNK_MAX ? total - sent : AVC_CHUNK_MAX;
        const uint32_t head[3] = {1u, crc, sent};
        memcpy(payload, head, sizeof head);
        memcpy(&payload[12], (const uint8_t *)&image + sent, part);
        message(AVC_MESSAGE_CHUNK, payload, 12u + part);
        sent += part;
    }
    const uint32_t commit[3] = {1u, crc, crc};
    message(AVC_MESSAGE_COMMIT, (const uint8_t *)commit, sizeof commit);
}

/* A configuration for the transfer that is open, with some of its bytes from the input and a right checksum. */
static void configure(const uint8_t *data, size_t size)
{
    static uint8_t payload[8 + sizeof(avc_config_t)];
    avc_config_t config = device.control.config;
    for (size_t i = 0; i + 1u < size; i += 2u) {
        ((uint8_t *)&config)[data[i] % sizeof config] = data[i + 1u];
    }
    config.crc32 = avc_crc32(0, (const uint8_t *)&config.limits, sizeof config - sizeof config.crc32);
    const uint32_t head[2] = {device.transfer.session, device.transfer.table_id};
    memcpy(payload, head, sizeof head);
    memcpy(&payload[8], &config, sizeof config);
    message(AVC_MESSAGE_CONFIG, payload, sizeof payload);
}

/* A chunk of the transfer that is open, at any offset and of any length. */
static void wild_chunk(const uint8_t *data, size_t size)
{
    static uint8_t payload[12 + AVC_CHUNK_MAX];
    uint32_t offset = device.transfer.received;
    size_t length = size;
    if (size >= 4u) {
        memcpy(&offset, data, sizeof offset);
        length = (size_t)data[0] * 2u + data[1] % 3u;
    }
    const uint32_t head[3] = {device.transfer.session, device.transfer.table_id, offset};
    memcpy(payload, head, sizeof head);
    memset(&payload[12], 0x5A, AVC_CHUNK_MAX);
    message(AVC_MESSAGE_CHUNK, payload, 12u + length);
}

/* A plan that is nearly always good, of tones from the input; then a word from the host. */
static void excite(const uint8_t *data, size_t size)
{
    avc_plan_t plan;
    memset(&plan, 0, sizeof plan);
    const uint8_t first = size > 0u ? data[0] : 1u;
    plan.number = 1u + first;
    plan.ticks = 100u + 16u * first;
    plan.ramp_ticks = 1u + first / 8u;
    plan.silent_ticks = 40u;
    plan.growth = (uint32_t)first << 16;
    plan.max_force_n = 3.0f;
    plan.max_speed_m_per_s = 1.0f;
    plan.max_travel_m = 0.05f;
    plan.spring_n_per_m = 20.0f;
    plan.damper_ns_per_m = 1.0f;
    plan.window = (uint16_t)(1u + first % AVC_SPEED_WINDOW_MAX);
    plan.tones = (uint16_t)(1u + first % AVC_TONES_MAX);
    for (uint32_t i = 0; i < AVC_KNOTS; i++) {
        plan.knot[i] = (uint16_t)(size > 1u ? data[i % size] << 7 : 0x8000);
    }
    for (uint32_t i = 0; i < plan.tones && size > 1u; i++) {
        const uint32_t value = data[(i + 1u) % size];
        plan.tone[i] = (avc_tone_t){value << 22, (uint16_t)(value << 8), (int16_t)(uint16_t)(value * 257u)};
    }
    const size_t total = AVC_PLAN_HEAD + plan.tones * sizeof(avc_tone_t);
    if (size > 2u) {
        const size_t at = data[1] % total;
        ((uint8_t *)&plan)[at] = (uint8_t)(((uint8_t *)&plan)[at] ^ data[2]);
    }
    message(AVC_MESSAGE_EXCITE, (const uint8_t *)&plan, total);
    tick(0);
    const uint32_t asked[2] = {device.control.excite.plan.number, size > 3u ? data[3] : 0u};
    message(AVC_MESSAGE_RECORDS, (const uint8_t *)asked, sizeof asked);
}

/* A part of the running table, anywhere near its size. */
static void wild_readback(const uint8_t *data, size_t size)
{
    uint16_t asked[2] = {0u, 0u};
    memcpy(asked, data, size < sizeof asked ? size : sizeof asked);
    const uint32_t payload[2] = {asked[0] % 5000u, asked[1] % 5000u};
    message(AVC_MESSAGE_READBACK, (const uint8_t *)payload, sizeof payload);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    avc_device_init(&device, &avc_built_in, size % 2u == 0u, 1u);
    drain();
    if (size == 0u) {
        return 0;
    }
    if ((data[0] & 1u) == 0u) {
        feed(&data[1], size - 1u);
        check();
        return 0;
    }
    size_t at = 1;
    while (at + 2u <= size) { /* records: kind, length, bytes */
        const uint8_t kind = data[at];
        size_t length = data[at + 1u];
        at += 2u;
        length = length < size - at ? length : size - at;
        if (kind < 0xC0u) {
            message(kind % 20u, &data[at], length);
        } else if (kind < 0xC4u) {
            configure(&data[at], length);
        } else if (kind < 0xC8u) {
            wild_chunk(&data[at], length);
        } else if (kind < 0xCCu) {
            excite(&data[at], length);
        } else if (kind < 0xD0u) {
            wild_readback(&data[at], length);
        } else if (kind < 0xE0u) {
            upload(&data[at], length);
        } else {
            for (size_t i = 0; i + 1u < length; i += 2u) {
                tick((int32_t)(int16_t)((uint16_t)data[at + i] | (uint16_t)((uint16_t)data[at + i + 1u] << 8)));
            }
            tick(0);
        }
        at += length;
        check();
    }
    return 0;
}
