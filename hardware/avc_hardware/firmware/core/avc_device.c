#include "avc_device.h"

#include <stdatomic.h>
#include <string.h>

#include "avc_crc32.h"

#ifndef AVC_BUILD
#define AVC_BUILD "unnamed"
#endif

const char avc_build[8] = AVC_BUILD;

/* ---- rings ---------------------------------------------------------------------------------------------------- */

static bool ring_put(avc_ring_t *ring, uint8_t byte)
{
    const uint32_t written = ring->written;
    if (written - ring->read >= AVC_RING_SIZE) {
        return false;
    }
    ring->bytes[written % AVC_RING_SIZE] = byte;
    atomic_signal_fence(memory_order_release);
    ring->written = written + 1u;
    return true;
}

static bool ring_get(avc_ring_t *ring, uint8_t *byte)
{
    const uint32_t read = ring->read;
    if (read == ring->written) {
        return false;
    }
    atomic_signal_fence(memory_order_acquire);
    *byte = ring->bytes[read % AVC_RING_SIZE];
    atomic_signal_fence(memory_order_release);
    ring->read = read + 1u;
    return true;
}

static uint32_t ring_room(const avc_ring_t *ring)
{
    return AVC_RING_SIZE - (ring->written - ring->read);
}

void avc_device_receive(avc_device_t *device, uint8_t byte)
{
    if (!ring_put(&device->rx, byte)) {
        device->rx_overruns++;
    }
}

bool avc_device_transmit(avc_device_t *device, uint8_t *byte)
{
    return ring_get(&device->tx, byte);
}

float avc_device_tick(avc_device_t *device, int32_t encoder_count)
{
    return avc_control_tick(&device->control, encoder_count);
}

/* ---- answers -------------------------------------------------------------------------------------------------- */

typedef struct {
    avc_device_t *device;
    size_t size;
} avc_answer_t;

static avc_answer_t answer(avc_device_t *device, uint8_t type, uint16_t sequence)
{
    device->content[0] = AVC_PROTOCOL_VERSION;
    device->content[1] = type;
    memcpy(&device->content[2], &sequence, sizeof sequence);
    return (avc_answer_t){device, AVC_HEADER_SIZE};
}

static void put(avc_answer_t *a, const void *data, size_t size)
{
    memcpy(&a->device->content[a->size], data, size);
    a->size += size;
}

static void put16(avc_answer_t *a, uint32_t value)
{
    const uint16_t short_value = (uint16_t)value;
    put(a, &short_value, sizeof short_value);
}

static void put32(avc_answer_t *a, uint32_t value)
{
    put(a, &value, sizeof value);
}

static void put_float(avc_answer_t *a, float value)
{
    put(a, &value, sizeof value);
}

static void put_gains(avc_answer_t *a, const avc_gains_t *gains)
{
    put_float(a, gains->damping_ns_per_m);
    put_float(a, gains->stiffness_n_per_m);
    put_float(a, gains->contact_damping_ns_per_m);
}

static void send(avc_answer_t *a)
{
    avc_device_t *device = a->device;
    const size_t size = avc_frame_encode(device->content, a->size, device->encoded);
    for (size_t i = 0; i < size; i++) {
        (void)ring_put(&device->tx, device->encoded[i]); /* poll made sure of the room */
    }
}

static void refuse(avc_device_t *device, uint16_t sequence, avc_reason_t reason, uint32_t detail)
{
    avc_answer_t a = answer(device, AVC_MESSAGE_REFUSED, sequence);
    put16(&a, (uint32_t)reason);
    put16(&a, 0u);
    put32(&a, detail);
    send(&a);
}

/* ---- messages ------------------------------------------------------------------------------------------------- */

typedef struct {
    uint16_t sequence;
    const uint8_t *payload;
    size_t size;
} avc_request_t;

static uint32_t get32(const uint8_t *from)
{
    uint32_t value;
    memcpy(&value, from, sizeof value);
    return value;
}

static uint16_t get16(const uint8_t *from)
{
    uint16_t value;
    memcpy(&value, from, sizeof value);
    return value;
}

static float get_float(const uint8_t *from)
{
    float value;
    memcpy(&value, from, sizeof value);
    return value;
}

static const avc_table_t *running(const avc_device_t *device)
{
    return &device->control.tables[device->control.active];
}

static avc_table_t *shadow(avc_device_t *device)
{
    return &device->control.tables[1u - device->control.active];
}

static bool runs(const avc_device_t *device, uint32_t table_id, uint32_t crc32)
{
    return device->control.state.has_table != 0u && device->control.swap_wanted == 0u &&
           running(device)->id == table_id && running(device)->crc32 == crc32;
}

static void on_hello(avc_device_t *device, const avc_request_t *request)
{
    const avc_limits_t *limits = &device->control.limits;
    const avc_table_t *table = running(device);
    const bool has_table = device->control.state.has_table != 0u;
    avc_answer_t a = answer(device, AVC_MESSAGE_HELLO | AVC_MESSAGE_REPLY, request->sequence);
    put16(&a, AVC_INTERFACE_VERSION);
    put16(&a, AVC_ROWS_MAX);
    put16(&a, AVC_WINDOW);
    put16(&a, AVC_CHUNK_MAX);
    put(&a, avc_build, sizeof avc_build);
    put32(&a, device->serial);
    put32(&a, device->boot_id);
    put_float(&a, limits->sample_time_s);
    put_float(&a, limits->metres_per_count);
    put_float(&a, limits->max_force_n);
    put_float(&a, limits->max_damping_ns_per_m);
    put_float(&a, limits->max_stiffness_n_per_m);
    put_float(&a, limits->max_contact_damping_ns_per_m);
    put32(&a, has_table ? table->id : 0u);
    put32(&a, has_table ? table->crc32 : 0u);
    put16(&a, has_table ? table->image.header.rows : 0u);
    put16(&a, device->transfer.open ? 1u : 0u);
    send(&a);
}

static void acknowledge(avc_device_t *device, uint8_t type, uint16_t sequence)
{
    avc_answer_t a = answer(device, (uint8_t)(type | AVC_MESSAGE_REPLY), sequence);
    put32(&a, device->transfer.table_id);
    put32(&a, device->transfer.received);
    send(&a);
}

static bool transfer_stale(const avc_device_t *device)
{
    return device->control.state.ticks - device->transfer.last_tick > AVC_STALE_TICKS;
}

static void on_begin(avc_device_t *device, const avc_request_t *request)
{
    avc_transfer_t *transfer = &device->transfer;
    const uint32_t session = get32(&request->payload[0]);
    const uint32_t table_id = get32(&request->payload[4]);
    const uint32_t crc32 = get32(&request->payload[8]);
    const uint16_t rows = get16(&request->payload[12]);
    const uint16_t units = get16(&request->payload[14]);
    if (units != 1u) { /* 1: Hz, N.s/m, N/m, N.s/m */
        refuse(device, request->sequence, AVC_REFUSED_MESSAGE, units);
        return;
    }
    if (rows == 0 || rows > AVC_ROWS_MAX) {
        refuse(device, request->sequence, AVC_REFUSED_ROWS, AVC_ROWS_MAX);
        return;
    }
    if (transfer->committing || (transfer->open && transfer->session != session && !transfer_stale(device))) {
        refuse(device, request->sequence, AVC_REFUSED_BUSY, transfer->session);
        return;
    }
    const uint32_t size = avc_image_size(rows);
    transfer->open = true;
    transfer->session = session;
    transfer->table_id = table_id;
    transfer->crc32 = crc32;
    transfer->size = size;
    transfer->received = runs(device, table_id, crc32) ? size : 0u; /* nothing to do for a table that runs already */
    transfer->last_tick = device->control.state.ticks;
    acknowledge(device, AVC_MESSAGE_BEGIN, request->sequence);
}

static bool in_transfer(avc_device_t *device, const avc_request_t *request)
{
    const avc_transfer_t *transfer = &device->transfer;
    if (!transfer->open) {
        refuse(device, request->sequence, AVC_REFUSED_NO_TRANSFER, 0u);
        return false;
    }
    if (transfer->session != get32(&request->payload[0]) || transfer->table_id != get32(&request->payload[4])) {
        refuse(device, request->sequence, AVC_REFUSED_BUSY, transfer->session);
        return false;
    }
    return true;
}

static void on_chunk(avc_device_t *device, const avc_request_t *request)
{
    avc_transfer_t *transfer = &device->transfer;
    if (!in_transfer(device, request)) {
        return;
    }
    const uint32_t offset = get32(&request->payload[8]);
    const uint32_t count = (uint32_t)(request->size - 12u);
    if (count == 0u || count > AVC_CHUNK_MAX || offset > transfer->size || count > transfer->size - offset) {
        refuse(device, request->sequence, AVC_REFUSED_SIZE, transfer->size);
        return;
    }
    if (offset > transfer->received) {
        refuse(device, request->sequence, AVC_REFUSED_OFFSET, transfer->received); /* one before it was lost */
        return;
    }
    if (offset + count > transfer->received && !transfer->committing) {
        memcpy((uint8_t *)&shadow(device)->image + offset, &request->payload[12], count);
        transfer->received = offset + count;
    }
    transfer->last_tick = device->control.state.ticks;
    acknowledge(device, AVC_MESSAGE_CHUNK, request->sequence);
}

static void on_commit(avc_device_t *device, const avc_request_t *request)
{
    avc_transfer_t *transfer = &device->transfer;
    const uint32_t table_id = get32(&request->payload[4]);
    const uint32_t crc32 = get32(&request->payload[8]);
    if (runs(device, table_id, crc32) && !transfer->committing) { /* its answer was lost, or it ran before */
        transfer->open = false;
        avc_answer_t a = answer(device, AVC_MESSAGE_COMMIT | AVC_MESSAGE_REPLY, request->sequence);
        put32(&a, table_id);
        put32(&a, device->control.state.ticks);
        send(&a);
        return;
    }
    if (!in_transfer(device, request)) {
        return;
    }
    if (transfer->committing) {
        transfer->commit_sequence = request->sequence;
        return;
    }
    avc_table_t *table = shadow(device);
    if (transfer->received != transfer->size || avc_image_size(table->image.header.rows) != transfer->size) {
        refuse(device, request->sequence, AVC_REFUSED_SIZE, transfer->received);
        return;
    }
    if (crc32 != transfer->crc32 || avc_crc32(0, (const uint8_t *)&table->image, transfer->size) != crc32) {
        transfer->received = 0u;
        refuse(device, request->sequence, AVC_REFUSED_CRC, crc32);
        return;
    }
    uint16_t row;
    const avc_reason_t reason = avc_image_check(&table->image, &device->control.limits, &row);
    if (reason != AVC_OK) {
        transfer->open = false;
        refuse(device, request->sequence, reason, row);
        return;
    }
    table->id = table_id;
    table->crc32 = crc32;
    avc_table_prepare(table);
    transfer->committing = true;
    transfer->commit_sequence = request->sequence;
    atomic_signal_fence(memory_order_release);
    device->control.swap_wanted = 1u;
}

/* The tick has swapped: now the commit is answered. */
static void finish_commit(avc_device_t *device)
{
    avc_transfer_t *transfer = &device->transfer;
    transfer->committing = false;
    transfer->open = false;
    avc_answer_t a = answer(device, AVC_MESSAGE_COMMIT | AVC_MESSAGE_REPLY, transfer->commit_sequence);
    put32(&a, transfer->table_id);
    put32(&a, device->control.state.ticks);
    send(&a);
}

static void on_abort(avc_device_t *device, const avc_request_t *request)
{
    if (device->transfer.open && !device->transfer.committing &&
        device->transfer.session == get32(&request->payload[0])) {
        device->transfer.open = false;
    }
    acknowledge(device, AVC_MESSAGE_ABORT, request->sequence);
}

static void on_readback(avc_device_t *device, const avc_request_t *request)
{
    if (device->control.state.has_table == 0u) {
        refuse(device, request->sequence, AVC_REFUSED_NO_TABLE, 0u);
        return;
    }
    const avc_table_t *table = running(device);
    const uint32_t offset = get32(&request->payload[0]);
    const uint32_t count = get32(&request->payload[4]);
    const uint32_t size = avc_image_size(table->image.header.rows);
    if (count == 0u || count > AVC_CHUNK_MAX || offset > size || count > size - offset) {
        refuse(device, request->sequence, AVC_REFUSED_SIZE, size);
        return;
    }
    avc_answer_t a = answer(device, AVC_MESSAGE_READBACK | AVC_MESSAGE_REPLY, request->sequence);
    put32(&a, table->id);
    put32(&a, offset);
    put(&a, (const uint8_t *)&table->image + offset, count);
    send(&a);
}

/* A copy that no tick has torn. */
static avc_state_t snapshot(const avc_device_t *device)
{
    const volatile uint32_t *ticks = &device->control.state.ticks;
    avc_state_t state;
    uint32_t before;
    do {
        before = *ticks;
        atomic_signal_fence(memory_order_acquire);
        state = device->control.state;
        atomic_signal_fence(memory_order_acquire);
    } while (before != *ticks);
    return state;
}

static void on_status(avc_device_t *device, const avc_request_t *request)
{
    const avc_state_t s = snapshot(device);
    const bool has_table = s.has_table != 0u;
    avc_answer_t a = answer(device, AVC_MESSAGE_STATUS | AVC_MESSAGE_REPLY, request->sequence);
    put32(&a, s.ticks);
    put32(&a, s.overruns);
    put_float(&a, s.frequency_hz);
    put_float(&a, s.lookup_hz);
    put_gains(&a, &s.gains);
    put_float(&a, s.force_n);
    put_float(&a, s.position_m);
    put_float(&a, s.velocity_m_per_s);
    put_float(&a, s.energy_j);
    put32(&a, (uint32_t)s.encoder_count);
    put32(&a, has_table ? running(device)->id : 0u);
    put32(&a, has_table ? running(device)->crc32 : 0u);
    put32(&a, device->frames_good);
    put32(&a, device->frames_bad);
    put32(&a, device->rx_overruns);
    put32(&a, s.saturated);
    put32(&a, s.not_finite);
    put32(&a, s.heartbeats_missed);
    put32(&a, s.swaps);
    put32(&a, device->stream_number);
    put32(&a, device->stream_stale);
    put32(&a, device->stream_missing);
    put32(&a, s.stream_expired);
    const uint8_t flags[4] = {s.mode, s.streaming, s.contact, s.has_table};
    put(&a, flags, sizeof flags);
    send(&a);
}

static void on_heartbeat(avc_device_t *device, const avc_request_t *request)
{
    device->control.heartbeat_ticks = get32(&request->payload[0]);
    atomic_signal_fence(memory_order_release);
    device->control.heartbeat_seen = 1u;
    avc_answer_t a = answer(device, AVC_MESSAGE_HEARTBEAT | AVC_MESSAGE_REPLY, request->sequence);
    put32(&a, device->control.state.ticks);
    put32(&a, device->control.state.mode);
    send(&a);
}

static void on_set_gains(avc_device_t *device, const avc_request_t *request)
{
    const uint32_t number = get32(&request->payload[0]);
    const uint32_t ticks = get32(&request->payload[4]);
    const avc_gains_t gains = {get_float(&request->payload[8]), get_float(&request->payload[12]),
                               get_float(&request->payload[16])};
    const avc_reason_t reason = avc_gains_check(&gains, &device->control.limits);
    if (reason != AVC_OK) {
        refuse(device, request->sequence, reason, number);
        return;
    }
    if (device->control.state.has_table == 0u) { /* nothing to fall back to */
        refuse(device, request->sequence, AVC_REFUSED_NO_TABLE, number);
        return;
    }
    const uint32_t ahead = number - device->stream_number;
    if (device->stream_seen && number != 0u && (ahead == 0u || ahead > 0x7FFFFFFFu)) { /* late or twice */
        device->stream_stale++;
        refuse(device, request->sequence, AVC_REFUSED_STALE, device->stream_number);
        return;
    }
    if (device->stream_seen && number != 0u) {
        device->stream_missing += ahead - 1u;
    }
    device->stream_seen = true;
    device->stream_number = number; /* number 0 begins a stream */
    avc_control_t *control = &device->control;
    const uint32_t slot = 1u - control->stream_slot;
    control->stream[slot] = (avc_stream_t){number, ticks, gains};
    atomic_signal_fence(memory_order_release);
    control->stream_slot = slot;
    control->stream_fresh = 1u;
    const avc_state_t s = snapshot(device);
    avc_answer_t a = answer(device, AVC_MESSAGE_SET_GAINS | AVC_MESSAGE_REPLY, request->sequence);
    put32(&a, number);
    put32(&a, s.ticks);
    put_float(&a, s.frequency_hz);
    put_float(&a, s.lookup_hz);
    put_float(&a, s.force_n);
    send(&a);
}

/* Payload of each message, smallest and largest. */
typedef struct {
    uint8_t type;
    uint16_t least;
    uint16_t most;
    void (*handle)(avc_device_t *, const avc_request_t *);
} avc_handler_t;

static const avc_handler_t handlers[] = {
    {AVC_MESSAGE_HELLO, 4, 4, on_hello},
    {AVC_MESSAGE_BEGIN, 16, 16, on_begin},
    {AVC_MESSAGE_CHUNK, 13, 12 + AVC_CHUNK_MAX, on_chunk},
    {AVC_MESSAGE_COMMIT, 12, 12, on_commit},
    {AVC_MESSAGE_READBACK, 8, 8, on_readback},
    {AVC_MESSAGE_STATUS, 0, 0, on_status},
    {AVC_MESSAGE_HEARTBEAT, 4, 4, on_heartbeat},
    {AVC_MESSAGE_SET_GAINS, 20, 20, on_set_gains},
    {AVC_MESSAGE_ABORT, 4, 4, on_abort},
};

static void on_frame(avc_device_t *device)
{
    const uint8_t *content = device->decoder.content;
    const avc_request_t request = {get16(&content[2]), &content[AVC_HEADER_SIZE],
                                   (size_t)device->decoder.size - AVC_HEADER_SIZE - AVC_CRC_SIZE};
    if (content[0] != AVC_PROTOCOL_VERSION) {
        refuse(device, request.sequence, AVC_REFUSED_VERSION, AVC_PROTOCOL_VERSION);
        return;
    }
    for (size_t i = 0; i < sizeof handlers / sizeof handlers[0]; i++) {
        if (handlers[i].type == content[1]) {
            if (request.size < handlers[i].least || request.size > handlers[i].most) {
                refuse(device, request.sequence, AVC_REFUSED_SIZE, handlers[i].most);
            } else {
                handlers[i].handle(device, &request);
            }
            return;
        }
    }
    refuse(device, request.sequence, AVC_REFUSED_MESSAGE, content[1]);
}

bool avc_device_poll(avc_device_t *device)
{
    bool did = false;
    uint8_t byte;
    while (ring_room(&device->tx) >= AVC_FRAME_MAX) { /* an answer always fits */
        if (device->transfer.committing && device->control.swap_wanted == 0u) {
            finish_commit(device);
            did = true;
            continue;
        }
        if (!ring_get(&device->rx, &byte)) {
            break;
        }
        did = true;
        const avc_frame_result_t result = avc_decoder_feed(&device->decoder, byte);
        if (result == AVC_FRAME_GOOD) {
            device->frames_good++;
            on_frame(device);
        } else if (result == AVC_FRAME_BAD) {
            device->frames_bad++;
        }
    }
    return did;
}

void avc_device_init(avc_device_t *device, const avc_limits_t *limits, uint32_t serial, uint32_t boot_id)
{
    memset(device, 0, sizeof *device);
    avc_control_init(&device->control, limits);
    avc_decoder_reset(&device->decoder);
    device->serial = serial;
    device->boot_id = boot_id;
    const char note[] = "avc device ready";
    avc_answer_t a = answer(device, AVC_MESSAGE_LOG, 0u);
    put(&a, note, sizeof note - 1u);
    send(&a);
}
