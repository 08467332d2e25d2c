#include <stdatomic.h>

#include "avc_link.h"

/* A transfer without a message for so long may be taken over. */
static const float stale_s = 2.0f;

static avc_table_t *shadow(avc_device_t *device)
{
    return &device->control.tables[1u - device->control.active];
}

static bool avc_runs(const avc_device_t *device, uint32_t table_id, uint32_t crc32)
{
    return device->control.state.has_table != 0u && device->control.swap_wanted == 0u &&
           avc_running(device)->id == table_id && avc_running(device)->crc32 == crc32;
}

static avc_verdict_t acknowledge(avc_device_t *device, const avc_request_t *request)
{
    return avc_acknowledge(device, request, device->transfer.table_id, device->transfer.received);
}

static bool transfer_stale(const avc_device_t *device)
{
    return device->control.state.ticks - device->transfer.last_tick > (uint32_t)(stale_s * device->control.rate_hz);
}

avc_verdict_t avc_on_begin(avc_device_t *device, const avc_request_t *request)
{
    avc_transfer_t *transfer = &device->transfer;
    const uint32_t session = request->word[0], table_id = request->word[1], crc32 = request->word[2];
    const uint32_t rows = request->word[3] & 0xFFFFu, states = request->word[3] >> 16;
    const avc_reason_t reason = avc_size_check(rows, states);
    if (reason != AVC_OK) {
        return avc_no(reason, reason == AVC_REFUSED_ROWS ? AVC_ROWS_MAX : AVC_STATES_MAX);
    }
    if (transfer->committing || (transfer->open && transfer->session != session && !transfer_stale(device))) {
        return avc_no(AVC_REFUSED_BUSY, transfer->session);
    }
    const uint32_t size = avc_image_size(rows, states);
    if (!transfer->open || transfer->session != session || transfer->table_id != table_id) { /* not the same once more */
        device->control.next = device->control.config; /* unless another one is sent */
        memset(&shadow(device)->image.header, 0, sizeof shadow(device)->image.header);
    }
    transfer->open = true;
    transfer->session = session;
    transfer->table_id = table_id;
    transfer->crc32 = crc32;
    transfer->size = size;
    transfer->received = avc_runs(device, table_id, crc32) ? size : 0u; /* nothing to do for a table that runs already */
    transfer->last_tick = device->control.state.ticks;
    return acknowledge(device, request);
}

/* Whether a request is of the transfer that is open. */
static avc_verdict_t in_transfer(const avc_device_t *device, const avc_request_t *request)
{
    const avc_transfer_t *transfer = &device->transfer;
    if (!transfer->open) {
        return avc_no(AVC_REFUSED_NO_TRANSFER, 0u);
    }
    const bool its = transfer->session == request->word[0] && transfer->table_id == request->word[1];
    return avc_no(its ? AVC_OK : AVC_REFUSED_BUSY, transfer->session);
}

/* Empty: the configuration in force; otherwise that of the transfer that is open. */
avc_verdict_t avc_on_config(avc_device_t *device, const avc_request_t *request)
{
    avc_control_t *control = &device->control;
    avc_transfer_t *transfer = &device->transfer;
    if (request->size == 0u) {
        return avc_reply(device, request, &control->config, sizeof control->config);
    }
    if (request->size != 8u + sizeof(avc_config_t)) {
        return avc_no(AVC_REFUSED_SIZE, 8u + sizeof(avc_config_t));
    }
    const avc_verdict_t its = in_transfer(device, request);
    if (its.reason != AVC_OK) {
        return its;
    }
    transfer->last_tick = control->state.ticks;
    if (!transfer->committing) {
        avc_config_t config;
        memcpy(&config, &request->payload[8], sizeof config);
        const avc_reason_t reason = avc_config_check(&config, &control->config, control->bound);
        if (reason != AVC_OK) {
            transfer->open = false;
            return avc_no(reason, AVC_AT_CONFIG);
        }
        control->next = config;
    }
    return acknowledge(device, request);
}

avc_verdict_t avc_on_chunk(avc_device_t *device, const avc_request_t *request)
{
    avc_transfer_t *transfer = &device->transfer;
    const avc_verdict_t its = in_transfer(device, request);
    if (its.reason != AVC_OK) {
        return its;
    }
    const uint32_t offset = request->word[2];
    const uint32_t count = (uint32_t)(request->size - 12u);
    if (count == 0u || count > AVC_CHUNK_MAX || offset > transfer->size || count > transfer->size - offset) {
        return avc_no(AVC_REFUSED_SIZE, transfer->size);
    }
    if (offset > transfer->received) {
        return avc_no(AVC_REFUSED_OFFSET, transfer->received); /* one before it was lost */
    }
    if (offset + count > transfer->received && !transfer->committing) {
        memcpy((uint8_t *)&shadow(device)->image + offset, &request->payload[12], count);
        transfer->received = offset + count;
    }
    transfer->last_tick = device->control.state.ticks;
    return acknowledge(device, request);
}

static void committed(avc_device_t *device, uint16_t sequence)
{
    const uint32_t words[3] = {avc_running(device)->id, device->control.swap_tick, device->control.swap_waited};
    const avc_request_t request = {.type = AVC_MESSAGE_COMMIT, .sequence = sequence};
    (void)avc_reply(device, &request, words, sizeof words);
}

avc_verdict_t avc_on_commit(avc_device_t *device, const avc_request_t *request)
{
    avc_transfer_t *transfer = &device->transfer;
    const uint32_t table_id = request->word[1];
    const uint32_t crc32 = request->word[2];
    if (avc_runs(device, table_id, crc32) && !transfer->committing) { /* its answer was lost, or it ran before */
        if (transfer->session == request->word[0] && transfer->table_id == table_id) {
            transfer->open = false;
        }
        committed(device, request->sequence);
        return avc_no(AVC_OK, 0u);
    }
    const avc_verdict_t its = in_transfer(device, request);
    if (its.reason != AVC_OK) {
        return its;
    }
    if (device->control.excite.busy != 0u) {
        return avc_no(AVC_REFUSED_EXCITED, device->control.excite.plan.number);
    }
    transfer->last_tick = device->control.state.ticks;
    if (transfer->committing) {
        transfer->commit_sequence = request->sequence;
        const bool waits = device->control.swap_wanted != 0u && transfer->last_tick - transfer->commit_tick > 1u;
        return avc_no(waits ? AVC_REFUSED_IN_CONTACT : AVC_OK, table_id); /* not yet */
    }
    avc_table_t *table = shadow(device);
    const avc_table_header_t *header = &table->image.header;
    if (transfer->received != transfer->size || avc_image_size(header->rows, avc_states(header)) != transfer->size) {
        return avc_no(AVC_REFUSED_SIZE, transfer->received);
    }
    if (crc32 != transfer->crc32 || avc_crc32(0, (const uint8_t *)&table->image, transfer->size) != crc32) {
        transfer->received = 0u;
        return avc_no(AVC_REFUSED_CRC, crc32);
    }
    uint16_t row = AVC_AT_HEADER;
    const avc_limits_t *limits = &device->control.next.limits;
    const bool alone = transfer->size == 0u; /* a configuration, and no table */
    const avc_reason_t reason = alone ? AVC_OK : avc_image_check(&table->image, limits, &row);
    if (reason != AVC_OK) {
        transfer->open = false;
        return avc_no(reason, row);
    }
    table->id = table_id;
    table->crc32 = crc32;
    avc_table_prepare(table);
    transfer->committing = true;
    transfer->commit_sequence = request->sequence;
    transfer->commit_tick = transfer->last_tick;
    device->control.waited = 0u;
    device->control.away = 0u;
    atomic_signal_fence(memory_order_release);
    device->control.swap_wanted = 1u;
    return avc_no(AVC_OK, 0u); /* answered by the tick that swaps */
}

/* The tick may swap until here, and not after. */
static void give_up_commit(avc_device_t *device)
{
    device->control.swap_wanted = 0u;
    device->transfer.committing = false;
    device->transfer.open = false;
}

/* Once the tick has swapped, the commit is answered; returns whether it was. A table that waits for a host that is gone never takes over. */
bool avc_watch_commit(avc_device_t *device)
{
    avc_transfer_t *transfer = &device->transfer;
    if (device->control.swap_wanted != 0u) {
        if (transfer_stale(device)) {
            give_up_commit(device);
        }
        return false;
    }
    transfer->committing = false;
    transfer->open = false;
    committed(device, transfer->commit_sequence);
    return true;
}

avc_verdict_t avc_on_abort(avc_device_t *device, const avc_request_t *request)
{
    if (device->transfer.open && device->transfer.session == request->word[0]) {
        give_up_commit(device);
    }
    return acknowledge(device, request);
}

avc_verdict_t avc_on_readback(avc_device_t *device, const avc_request_t *request)
{
    if (device->control.state.has_table == 0u) {
        return avc_no(AVC_REFUSED_NO_TABLE, 0u);
    }
    const avc_table_t *table = avc_running(device);
    const uint32_t offset = request->word[0];
    const uint32_t count = request->word[1];
    const uint32_t size = avc_image_size(table->image.header.rows, avc_states(&table->image.header));
    if (count == 0u || count > AVC_CHUNK_MAX || offset > size || count > size - offset) {
        return avc_no(AVC_REFUSED_SIZE, size);
    }
    const uint32_t words[2] = {table->id, offset};
    avc_answer_t a = avc_answer(device, AVC_MESSAGE_READBACK | AVC_MESSAGE_REPLY, request->sequence);
    avc_put(&a, words, sizeof words);
    avc_put(&a, (const uint8_t *)&table->image + offset, count);
    avc_send(&a);
    return avc_no(AVC_OK, 0u);
}
