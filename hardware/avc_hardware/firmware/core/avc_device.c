#include "avc_device.h"

#include <stdatomic.h>

#include "avc_link.h"

#ifndef AVC_BUILD
#define AVC_BUILD "unnamed"
#endif

/* Identity of this build. */
static const char avc_build[8] = AVC_BUILD;

/* As they travel: little-endian, no padding. */
typedef struct {
    uint32_t interface_version, boot_id;
    uint32_t rows, states, records; /* capacities */
    uint32_t bound;
    char build[8];
    uint8_t unique[AVC_UNIQUE_SIZE];
    uint32_t table_id, table_crc32, coupling_id; /* of the running table; 0: none */
    uint32_t faults;
    avc_lowered_t lowered;
    uint32_t config_crc32;
    avc_limits_t limits;
    avc_figures_t figures;
} avc_hello_t;

typedef struct {
    avc_state_t state;
    uint32_t faults, first_faults, first_tick;
    avc_lowered_t lowered;
    uint32_t limits_wait;
} avc_status_t;

_Static_assert(sizeof(avc_hello_t) == 140, "HELLO travels as 140 bytes");
_Static_assert(sizeof(avc_status_t) == 92, "STATUS travels as 92 bytes");
_Static_assert(sizeof(avc_sample_t) == 44, "a record travels as 44 bytes");
_Static_assert(AVC_SAMPLES_KEPT * sizeof(avc_sample_t) + 128u <= AVC_RING_SIZE, "a message of all records fits the ring");

avc_answer_t avc_answer(avc_device_t *device, uint8_t type, uint16_t sequence)
{
    device->content[0] = AVC_PROTOCOL_VERSION;
    device->content[1] = type;
    memcpy(&device->content[2], &sequence, sizeof sequence);
    return (avc_answer_t){device, AVC_HEADER_SIZE};
}

void avc_put(avc_answer_t *a, const void *data, size_t size)
{
    memcpy(&a->device->content[a->size], data, size);
    a->size += size;
}

void avc_send(avc_answer_t *a)
{
    avc_device_t *device = a->device;
    const size_t size = avc_frame_encode(device->content, a->size, device->encoded);
    for (size_t i = 0; i < size; i++) {
        (void)avc_ring_put(&device->tx, device->encoded[i]); /* poll made sure of the room */
    }
}

avc_verdict_t avc_reply(avc_device_t *device, const avc_request_t *request, const void *data, size_t size)
{
    avc_answer_t a = avc_answer(device, (uint8_t)(request->type | AVC_MESSAGE_REPLY), request->sequence);
    avc_put(&a, data, size);
    avc_send(&a);
    return avc_no(AVC_OK, 0u);
}

avc_verdict_t avc_acknowledge(avc_device_t *device, const avc_request_t *request, uint32_t first, uint32_t second)
{
    const uint32_t words[2] = {first, second};
    return avc_reply(device, request, words, sizeof words);
}

static avc_verdict_t on_hello(avc_device_t *device, const avc_request_t *request)
{
    if ((request->word[1] & 0xFFFFu) != AVC_INTERFACE_VERSION) {
        return avc_no(AVC_REFUSED_INTERFACE, AVC_INTERFACE_VERSION);
    }
    const avc_control_t *control = &device->control;
    avc_hello_t hello = {
        .interface_version = AVC_INTERFACE_VERSION,
        .boot_id = device->boot_id,
        .rows = AVC_ROWS_MAX,
        .states = AVC_STATES_MAX,
        .records = AVC_RECORDS_KEPT,
        .bound = control->bound ? 1u : 0u,
        .faults = avc_faults(control),
        .lowered = control->lowered,
        .config_crc32 = control->config.crc32,
        .limits = control->config.limits,
        .figures = control->config.figures,
    };
    memcpy(hello.build, avc_build, sizeof hello.build);
    memcpy(hello.unique, device->unique, sizeof hello.unique);
    if (control->state.has_table != 0u) {
        hello.table_id = avc_running(device)->id;
        hello.table_crc32 = avc_running(device)->crc32;
        hello.coupling_id = avc_running(device)->image.header.coupling_id;
    }
    return avc_reply(device, request, &hello, sizeof hello);
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

static avc_verdict_t on_status(avc_device_t *device, const avc_request_t *request)
{
    const avc_control_t *control = &device->control;
    const avc_status_t status = {
        .state = snapshot(device),
        .faults = avc_faults(control),
        .first_faults = control->fault.first,
        .first_tick = control->fault.first_tick,
        .lowered = control->lowered,
        .limits_wait = control->limits_wanted,
    };
    return avc_reply(device, request, &status, sizeof status);
}

static avc_verdict_t on_heartbeat(avc_device_t *device, const avc_request_t *request)
{
    avc_control_t *control = &device->control;
    const uint32_t most = avc_longest_hold(control);
    if (request->word[0] > most) {
        return avc_no(AVC_REFUSED_HOLD, most);
    }
    control->heartbeat_wanted = request->word[0];
    atomic_signal_fence(memory_order_release);
    control->heartbeat_seen = 1u;
    return avc_acknowledge(device, request, control->state.ticks, control->state.mode);
}

/* Takes effect with the next tick; what is still wrong then stays. */
static avc_verdict_t on_clear(avc_device_t *device, const avc_request_t *request)
{
    avc_control_t *control = &device->control;
    control->fault.clear_wanted = request->word[0] & control->fault.codes; /* none that comes later */
    return avc_acknowledge(device, request, avc_faults(control), control->state.mode);
}

/* Whether limits are within the board's; 0 becomes the board's. */
static bool within(float *limit, float boards)
{
    if (*limit == 0.0f) {
        *limit = boards;
    }
    return avc_is_finite(*limit) && *limit >= 0.0f && (boards <= 0.0f || *limit <= boards);
}

/* Takes effect with the next tick, a higher force out of contact. */
static avc_verdict_t on_limits(avc_device_t *device, const avc_request_t *request)
{
    avc_control_t *control = &device->control;
    avc_lowered_t wanted;
    memcpy(&wanted, request->payload, sizeof wanted);
    const avc_limits_t *boards = &control->config.limits;
    if (!within(&wanted.force_n, boards->max_force_n) || !within(&wanted.speed_m_per_s, boards->max_speed_m_per_s) ||
        !within(&wanted.energy_j, boards->max_energy_j)) {
        return avc_no(AVC_REFUSED_LIMIT, AVC_AT_LIMITS);
    }
    if (control->excite.busy != 0u) { /* it keeps the limit that its plan was taken for */
        return avc_no(AVC_REFUSED_EXCITED, control->excite.plan.number);
    }
    control->limits_wanted = 0u; /* the tick leaves them alone from here on */
    atomic_signal_fence(memory_order_release);
    control->wanted = wanted;
    atomic_signal_fence(memory_order_release);
    control->limits_wanted = 1u;
    return avc_acknowledge(device, request, control->state.ticks, 0u);
}

static avc_verdict_t on_set_gains(avc_device_t *device, const avc_request_t *request)
{
    avc_control_t *control = &device->control;
    const uint32_t number = request->word[0];
    avc_stream_t sent = {number, request->word[1], {0.0f, 0.0f, 0.0f}};
    memcpy(&sent.gains, &request->word[2], sizeof sent.gains);
    const avc_reason_t reason = avc_gains_check(&sent.gains, &control->config.limits);
    if (reason != AVC_OK) {
        return avc_no(reason, AVC_AT_GAINS);
    }
    if (sent.ticks > avc_longest_hold(control)) {
        return avc_no(AVC_REFUSED_HOLD, avc_longest_hold(control));
    }
    if (control->state.has_table == 0u) { /* nothing to fall back to */
        return avc_no(AVC_REFUSED_NO_TABLE, number);
    }
    const uint32_t running = avc_running(device)->image.header.coupling_id;
    if (request->word[5] != running) { /* judged with another wall */
        return avc_no(AVC_REFUSED_OTHER_COUPLING, running);
    }
    if (control->state.mode != AVC_MODE_TABLE) {
        return avc_no(AVC_REFUSED_MODE, control->state.mode);
    }
    const uint32_t ahead = number - device->stream_number;
    const bool late = ahead == 0u || ahead > 0x7FFFFFFFu; /* or twice */
    if (device->stream_seen && number != 0u && late) { /* number 0 begins a stream */
        return avc_no(AVC_REFUSED_STALE, device->stream_number);
    }
    device->stream_seen = true;
    device->stream_number = number;
    const uint32_t slot = 1u - control->stream_slot;
    control->stream[slot] = sent;
    atomic_signal_fence(memory_order_release);
    control->stream_slot = slot;
    control->stream_fresh = 1u;
    const avc_state_t s = snapshot(device);
    const struct {
        uint32_t number, ticks;
        float frequency_hz, lookup_hz, force_n;
    } taken = {number, s.ticks, s.frequency_hz, s.lookup_hz, s.force_n};
    return avc_reply(device, request, &taken, sizeof taken);
}

/* Another rate begins anew; the same one goes on, so that renewing leaves no gap. */
static avc_verdict_t on_subscribe(avc_device_t *device, const avc_request_t *request)
{
    avc_telemetry_t *t = &device->control.telemetry;
    const uint32_t every = request->word[0], ticks = request->word[1], most = avc_longest_hold(&device->control);
    if (ticks > most) {
        return avc_no(AVC_REFUSED_HOLD, most);
    }
    if (every == 0u || every != t->every || t->left == 0u) {
        t->left = 0u; /* the tick leaves all of it alone from here on */
        atomic_signal_fence(memory_order_release);
        t->every = every;
        t->wait = 0u;
        t->sent = t->made;
        atomic_signal_fence(memory_order_release);
    }
    t->left = every != 0u ? ticks : 0u;
    return avc_acknowledge(device, request, t->every, device->control.state.ticks);
}

static bool push_telemetry(avc_device_t *device)
{
    avc_telemetry_t *t = &device->control.telemetry;
    const uint32_t made = t->made;
    if (made == t->sent || AVC_RING_SIZE - avc_ring_room(&device->tx) > 64u) { /* at most one is ahead of an answer */
        return false;
    }
    atomic_signal_fence(memory_order_acquire);
    const uint32_t coupling_id = device->control.state.has_table != 0u ? avc_running(device)->image.header.coupling_id : 0u;
    const uint32_t head[3] = {t->every, device->boot_id, coupling_id};
    avc_answer_t a = avc_answer(device, AVC_MESSAGE_TELEMETRY, 0u);
    avc_put(&a, head, sizeof head);
    for (uint32_t at = t->sent; at != made; at++) {
        avc_put(&a, &t->kept[at % AVC_SAMPLES_KEPT], sizeof(avc_sample_t));
    }
    atomic_signal_fence(memory_order_release);
    t->sent = made;
    avc_send(&a);
    return true;
}

/* Payload of each message, smallest and largest. */
typedef struct {
    uint8_t type;
    uint16_t least;
    uint16_t most;
    avc_verdict_t (*handle)(avc_device_t *, const avc_request_t *);
} avc_handler_t;

static const avc_handler_t handlers[] = {
    {AVC_MESSAGE_HELLO, 8, 8, on_hello},
    {AVC_MESSAGE_BEGIN, 16, 16, avc_on_begin},
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
    {AVC_MESSAGE_SUBSCRIBE, 8, 8, on_subscribe},
    {AVC_MESSAGE_LIMITS, 12, 12, on_limits},
    {AVC_MESSAGE_CONFIG, 0, 8 + sizeof(avc_config_t), avc_on_config},
};

static avc_verdict_t handle(avc_device_t *device, const avc_request_t *request)
{
    if (device->decoder.content[0] != AVC_PROTOCOL_VERSION) {
        return avc_no(AVC_REFUSED_VERSION, AVC_PROTOCOL_VERSION);
    }
    for (size_t i = 0; i < sizeof handlers / sizeof handlers[0]; i++) {
        if (handlers[i].type == request->type) {
            const bool fits = request->size >= handlers[i].least && request->size <= handlers[i].most;
            return fits ? handlers[i].handle(device, request) : avc_no(AVC_REFUSED_SIZE, handlers[i].most);
        }
    }
    return avc_no(AVC_REFUSED_MESSAGE, request->type);
}

static void on_frame(avc_device_t *device)
{
    const uint8_t *content = device->decoder.content;
    avc_request_t request = {.type = content[1],
                             .payload = &content[AVC_HEADER_SIZE],
                             .size = (size_t)device->decoder.size - AVC_HEADER_SIZE - AVC_CRC_SIZE};
    if ((request.type & AVC_MESSAGE_REPLY) != 0u) {
        return; /* an answer, sent back by a line that echoes: it is never answered */
    }
    memcpy(&request.sequence, &content[2], sizeof request.sequence);
    memcpy(request.word, request.payload, request.size < sizeof request.word ? request.size : sizeof request.word);
    const avc_verdict_t verdict = handle(device, &request);
    if (verdict.reason != AVC_OK) {
        const uint32_t words[2] = {(uint32_t)verdict.reason, verdict.detail};
        avc_answer_t a = avc_answer(device, AVC_MESSAGE_REFUSED, request.sequence);
        avc_put(&a, words, sizeof words);
        avc_send(&a);
    }
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
        if (avc_decoder_feed(&device->decoder, byte)) {
            on_frame(device);
        }
    }
    return push_telemetry(device) || did;
}

void avc_device_init(avc_device_t *device, const avc_config_t *config, bool bound, uint32_t boot_id)
{
    memset(device, 0, sizeof *device);
    avc_control_init(&device->control, config, bound);
    device->boot_id = boot_id;
}
