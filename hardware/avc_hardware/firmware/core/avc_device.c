#include "avc_device.h"

#include <stdatomic.h>
#include <string.h>

#include "avc_link.h"

#ifndef AVC_BUILD
#define AVC_BUILD "unnamed"
#endif

const char avc_build[8] = AVC_BUILD;

void avc_device_receive(avc_device_t *device, uint8_t byte)
{
    if (!avc_ring_put(&device->rx, byte)) {
        device->rx_overruns++;
    }
}

bool avc_device_transmit(avc_device_t *device, uint8_t *byte)
{
    return avc_ring_get(&device->tx, byte);
}

float avc_device_tick(avc_device_t *device, int32_t encoder_count)
{
    return avc_control_tick(&device->control, encoder_count);
}

static void on_hello(avc_device_t *device, const avc_request_t *request)
{
    if (avc_get16(&request->payload[4]) != AVC_INTERFACE_VERSION) {
        avc_refuse(device, request->sequence, AVC_REFUSED_INTERFACE, AVC_INTERFACE_VERSION);
        return;
    }
    const avc_limits_t *limits = &device->control.config.limits;
    const avc_figures_t *figures = &device->control.config.figures;
    const avc_table_t *table = avc_running(device);
    const avc_table_header_t *header = &table->image.header;
    const bool has_table = device->control.state.has_table != 0u;
    avc_answer_t a = avc_answer(device, AVC_MESSAGE_HELLO | AVC_MESSAGE_REPLY, request->sequence);
    avc_put16(&a, AVC_INTERFACE_VERSION);
    avc_put16(&a, AVC_ROWS_MAX);
    avc_put16(&a, AVC_WINDOW);
    avc_put16(&a, AVC_CHUNK_MAX);
    avc_put(&a, avc_build, sizeof avc_build);
    avc_put32(&a, device->boot_id);
    avc_put_float(&a, limits->sample_time_s);
    avc_put_float(&a, limits->metres_per_count);
    avc_put_float(&a, limits->max_force_n);
    avc_put_float(&a, limits->max_damping_ns_per_m);
    avc_put_float(&a, limits->max_stiffness_n_per_m);
    avc_put_float(&a, limits->max_contact_damping_ns_per_m);
    avc_put32(&a, has_table ? table->id : 0u);
    avc_put32(&a, has_table ? table->crc32 : 0u);
    avc_put16(&a, has_table ? header->rows : 0u);
    avc_put16(&a, device->transfer.open ? 1u : 0u);
    avc_put_float(&a, figures->hold_s);
    avc_put_float(&a, figures->slew_per_s);
    avc_put_float(&a, figures->guard_damping_ns_per_m);
    avc_put_float(&a, figures->hand_m_per_unit);
    avc_put16(&a, figures->estimator);
    avc_put16(&a, figures->passive);
    avc_put16(&a, AVC_STATES_MAX);
    avc_put16(&a, has_table ? avc_states(header) : 0u);
    avc_put16(&a, AVC_TONES_MAX);
    avc_put16(&a, AVC_RECORDS_KEPT);
    avc_put32(&a, has_table ? header->coupling_id : 0u);
    avc_put_float(&a, has_table ? header->wall_damping_ns_per_m : 0.0f);
    avc_put_float(&a, has_table ? header->wall_stiffness_n_per_m : 0.0f);
    avc_put_float(&a, has_table ? avc_force_limit(header, limits) : 0.0f);
    avc_put_float(&a, limits->max_speed_m_per_s);
    avc_put_float(&a, limits->max_acceleration_m_per_s2);
    avc_put_float(&a, limits->max_energy_j);
    avc_put_float(&a, limits->stuck_swing_n);
    avc_put_float(&a, limits->max_overruns);
    avc_put32(&a, avc_faults(&device->control));
    avc_put_lowered(&a, &device->control.lowered);
    avc_put(&a, device->unique, sizeof device->unique);
    avc_put32(&a, device->control.config.crc32);
    avc_put16(&a, device->control.bound ? 1u : 0u);
    avc_put16(&a, 0u);
    avc_send(&a);
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
    avc_answer_t a = avc_answer(device, AVC_MESSAGE_STATUS | AVC_MESSAGE_REPLY, request->sequence);
    avc_put32(&a, s.ticks);
    avc_put32(&a, s.overruns);
    avc_put_float(&a, s.frequency_hz);
    avc_put_float(&a, s.lookup_hz);
    avc_put_gains(&a, &s.gains);
    avc_put_float(&a, s.force_n);
    avc_put_float(&a, s.position_m);
    avc_put_float(&a, s.velocity_m_per_s);
    avc_put_float(&a, s.energy_j);
    avc_put32(&a, (uint32_t)s.encoder_count);
    avc_put32(&a, has_table ? avc_running(device)->id : 0u);
    avc_put32(&a, has_table ? avc_running(device)->crc32 : 0u);
    avc_put32(&a, has_table ? avc_running(device)->image.header.coupling_id : 0u);
    avc_put32(&a, device->frames_good);
    avc_put32(&a, device->frames_bad);
    avc_put32(&a, device->rx_overruns);
    avc_put32(&a, s.saturated);
    avc_put32(&a, s.not_finite);
    avc_put32(&a, s.heartbeats_missed);
    avc_put32(&a, s.swaps);
    avc_put32(&a, device->stream_number);
    avc_put32(&a, device->stream_stale);
    avc_put32(&a, device->stream_missing);
    avc_put32(&a, s.stream_expired);
    avc_put32(&a, device->boot_id);
    avc_put32(&a, avc_faults(&device->control));
    avc_put32(&a, device->control.fault.first);
    avc_put32(&a, device->control.fault.first_tick);
    const uint8_t waits = device->control.swap_wanted != 0u ? 1u : 0u;
    const uint8_t flags[8] = {s.mode, s.streaming, s.contact, s.has_table, waits,
                              (uint8_t)device->control.limits_wanted, 0u, 0u};
    avc_put(&a, flags, sizeof flags);
    avc_put_lowered(&a, &device->control.lowered);
    avc_send(&a);
}

static void on_heartbeat(avc_device_t *device, const avc_request_t *request)
{
    const uint32_t ticks = avc_get32(&request->payload[0]);
    const uint32_t most = avc_longest_hold(&device->control);
    if (ticks > most) {
        avc_refuse(device, request->sequence, AVC_REFUSED_HOLD, most);
        return;
    }
    device->control.heartbeat_wanted = ticks;
    atomic_signal_fence(memory_order_release);
    device->control.heartbeat_seen = 1u;
    avc_answer_t a = avc_answer(device, AVC_MESSAGE_HEARTBEAT | AVC_MESSAGE_REPLY, request->sequence);
    avc_put32(&a, device->control.state.ticks);
    avc_put32(&a, device->control.state.mode);
    avc_send(&a);
}

/* Takes effect with the next tick; what is still wrong then stays. */
static void on_clear(avc_device_t *device, const avc_request_t *request)
{
    avc_control_t *control = &device->control;
    control->fault.clear_wanted = avc_get32(&request->payload[0]) & control->fault.codes; /* none that comes later */
    avc_answer_t a = avc_answer(device, AVC_MESSAGE_CLEAR | AVC_MESSAGE_REPLY, request->sequence);
    avc_put32(&a, avc_faults(&device->control));
    avc_put32(&a, device->control.state.mode);
    avc_send(&a);
}

/* Takes effect with the next tick, a higher force out of contact. */
static void on_limits(avc_device_t *device, const avc_request_t *request)
{
    avc_control_t *control = &device->control;
    avc_lowered_t wanted = {avc_get_float(&request->payload[0]), avc_get_float(&request->payload[4]),
                            avc_get_float(&request->payload[8])};
    if (!avc_lowered_check(&wanted, &control->config.limits)) {
        avc_refuse(device, request->sequence, AVC_REFUSED_LIMIT, AVC_AT_LIMITS);
        return;
    }
    if (avc_excite_runs(&control->excite)) { /* it keeps the limit that its plan was taken for */
        avc_refuse(device, request->sequence, AVC_REFUSED_EXCITED, control->excite.plan.number);
        return;
    }
    control->limits_wanted = 0u; /* the tick leaves them alone from here on */
    atomic_signal_fence(memory_order_release);
    control->wanted = wanted;
    atomic_signal_fence(memory_order_release);
    control->limits_wanted = 1u;
    avc_answer_t a = avc_answer(device, AVC_MESSAGE_LIMITS | AVC_MESSAGE_REPLY, request->sequence);
    avc_put_lowered(&a, &wanted);
    avc_send(&a);
}

static void on_set_gains(avc_device_t *device, const avc_request_t *request)
{
    const uint32_t number = avc_get32(&request->payload[0]);
    const uint32_t ticks = avc_get32(&request->payload[4]);
    const avc_gains_t gains = {avc_get_float(&request->payload[8]), avc_get_float(&request->payload[12]),
                               avc_get_float(&request->payload[16])};
    const avc_reason_t reason = avc_gains_check(&gains, &device->control.config.limits);
    if (reason != AVC_OK) {
        avc_refuse(device, request->sequence, reason, number);
        return;
    }
    if (ticks > avc_longest_hold(&device->control)) {
        avc_refuse(device, request->sequence, AVC_REFUSED_HOLD, avc_longest_hold(&device->control));
        return;
    }
    if (device->control.state.has_table == 0u) { /* nothing to fall back to */
        avc_refuse(device, request->sequence, AVC_REFUSED_NO_TABLE, number);
        return;
    }
    const uint32_t running = avc_running(device)->image.header.coupling_id;
    if (avc_get32(&request->payload[20]) != running) { /* judged with another wall */
        avc_refuse(device, request->sequence, AVC_REFUSED_OTHER_COUPLING, running);
        return;
    }
    if (device->control.state.mode != AVC_MODE_TABLE) {
        avc_refuse(device, request->sequence, AVC_REFUSED_MODE, device->control.state.mode);
        return;
    }
    const uint32_t ahead = number - device->stream_number;
    if (device->stream_seen && number != 0u && (ahead == 0u || ahead > 0x7FFFFFFFu)) { /* late or twice */
        device->stream_stale++;
        avc_refuse(device, request->sequence, AVC_REFUSED_STALE, device->stream_number);
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
    avc_answer_t a = avc_answer(device, AVC_MESSAGE_SET_GAINS | AVC_MESSAGE_REPLY, request->sequence);
    avc_put32(&a, number);
    avc_put32(&a, s.ticks);
    avc_put_float(&a, s.frequency_hz);
    avc_put_float(&a, s.lookup_hz);
    avc_put_float(&a, s.force_n);
    avc_send(&a);
}

/* Payload of each message, smallest and largest. */
typedef struct {
    uint8_t type;
    uint16_t least;
    uint16_t most;
    void (*handle)(avc_device_t *, const avc_request_t *);
} avc_handler_t;

static const avc_handler_t handlers[] = {
    {AVC_MESSAGE_HELLO, 8, 8, on_hello},
    {AVC_MESSAGE_BEGIN, 20, 20, avc_on_begin},
    {AVC_MESSAGE_CHUNK, 13, 12 + AVC_CHUNK_MAX, avc_on_chunk},
    {AVC_MESSAGE_COMMIT, 12, 12, avc_on_commit},
    {AVC_MESSAGE_READBACK, 8, 8, avc_on_readback},
    {AVC_MESSAGE_STATUS, 0, 0, on_status},
    {AVC_MESSAGE_HEARTBEAT, 4, 4, on_heartbeat},
    {AVC_MESSAGE_SET_GAINS, 24, 24, on_set_gains},
    {AVC_MESSAGE_ABORT, 4, 4, avc_on_abort},
    {AVC_MESSAGE_EXCITE, AVC_PLAN_HEAD + sizeof(avc_tone_t), sizeof(avc_plan_t), avc_on_excite},
    {AVC_MESSAGE_RECORDS, 8, 8, avc_on_records},
    {AVC_MESSAGE_STOP, 4, 4, avc_on_stop},
    {AVC_MESSAGE_CLEAR, 4, 4, on_clear},
    {AVC_MESSAGE_SUBSCRIBE, 8, 8, avc_on_subscribe},
    {AVC_MESSAGE_LIMITS, 12, 12, on_limits},
    {AVC_MESSAGE_CONFIG, 0, 8 + sizeof(avc_config_t), avc_on_config},
};

static void on_frame(avc_device_t *device)
{
    const uint8_t *content = device->decoder.content;
    const avc_request_t request = {avc_get16(&content[2]), &content[AVC_HEADER_SIZE],
                                   (size_t)device->decoder.size - AVC_HEADER_SIZE - AVC_CRC_SIZE};
    if ((content[1] & AVC_MESSAGE_REPLY) != 0u) {
        return; /* an answer, sent back by a line that echoes: it is never answered */
    }
    if (content[0] != AVC_PROTOCOL_VERSION) {
        avc_refuse(device, request.sequence, AVC_REFUSED_VERSION, AVC_PROTOCOL_VERSION);
        return;
    }
    for (size_t i = 0; i < sizeof handlers / sizeof handlers[0]; i++) {
        if (handlers[i].type == content[1]) {
            if (request.size < handlers[i].least || request.size > handlers[i].most) {
                avc_refuse(device, request.sequence, AVC_REFUSED_SIZE, handlers[i].most);
            } else {
                handlers[i].handle(device, &request);
            }
            return;
        }
    }
    avc_refuse(device, request.sequence, AVC_REFUSED_MESSAGE, content[1]);
}

bool avc_device_poll(avc_device_t *device)
{
    bool did = false;
    uint8_t byte;
    while (avc_ring_room(&device->tx) >= AVC_FRAME_MAX) { /* an answer always fits */
        if (device->transfer.committing && avc_watch_commit(device)) {
            did = true;
            continue;
        }
        if (!avc_ring_get(&device->rx, &byte)) {
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
    return avc_push_telemetry(device) || did;
}

void avc_device_init(avc_device_t *device, const avc_config_t *config, bool bound, uint32_t boot_id)
{
    memset(device, 0, sizeof *device);
    avc_control_init(&device->control, config, bound);
    avc_decoder_reset(&device->decoder);
    device->boot_id = boot_id;
    const char note[] = "avc device ready";
    avc_answer_t a = avc_answer(device, AVC_MESSAGE_LOG, 0u);
    avc_put(&a, note, sizeof note - 1u);
    avc_send(&a);
}
