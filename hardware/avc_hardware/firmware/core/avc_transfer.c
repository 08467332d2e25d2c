#include <stdatomic.h>

#include "avc_crc32.h"
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

static void acknowledge(avc_device_t *device, uint8_t type, uint16_t sequence)
{
    avc_answer_t a = avc_answer(device, (uint8_t)(type | AVC_MESSAGE_REPLY), sequence);
    avc_put32(&a, device->transfer.table_id);
    avc_put32(&a, device->transfer.received);
    avc_send(&a);
}

static bool transfer_stale(const avc_device_t *device)
{
    return device->control.state.ticks - device->transfer.last_tick > (uint32_t)(stale_s * device->control.rate_hz);
}

void avc_on_begin(avc_device_t *device, const avc_request_t *request)
{
    avc_transfer_t *transfer = &device->transfer;
    const uint32_t session = avc_get32(&request->payload[0]);
    const uint32_t table_id = avc_get32(&request->payload[4]);
    const uint32_t crc32 = avc_get32(&request->payload[8]);
    const uint16_t rows = avc_get16(&request->payload[12]);
    const uint16_t units = avc_get16(&request->payload[14]);
    if (units != 1u) { /* 1: Hz, N.s/m, N/m, N.s/m */
        avc_refuse(device, request->sequence, AVC_REFUSED_MESSAGE, units);
        return;
    }
    const uint16_t states = avc_get16(&request->payload[16]);
    const avc_reason_t reason = avc_size_check(rows, states);
    if (reason != AVC_OK) {
        avc_refuse(device, request->sequence, reason, reason == AVC_REFUSED_ROWS ? AVC_ROWS_MAX : AVC_STATES_MAX);
        return;
    }
    if (transfer->committing || (transfer->open && transfer->session != session && !transfer_stale(device))) {
        avc_refuse(device, request->sequence, AVC_REFUSED_BUSY, transfer->session);
        return;
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
    acknowledge(device, AVC_MESSAGE_BEGIN, request->sequence);
}

static bool in_transfer(avc_device_t *device, const avc_request_t *request)
{
    const avc_transfer_t *transfer = &device->transfer;
    if (!transfer->open) {
        avc_refuse(device, request->sequence, AVC_REFUSED_NO_TRANSFER, 0u);
        return false;
    }
    if (transfer->session != avc_get32(&request->payload[0]) || transfer->table_id != avc_get32(&request->payload[4])) {
        avc_refuse(device, request->sequence, AVC_REFUSED_BUSY, transfer->session);
        return false;
    }
    return true;
}

/* Empty: the configuration in force; otherwise that of the transfer that is open. */
void avc_on_config(avc_device_t *device, const avc_request_t *request)
{
    avc_control_t *control = &device->control;
    avc_transfer_t *transfer = &device->transfer;
    if (request->size == 0u) {
        avc_answer_t a = avc_answer(device, AVC_MESSAGE_CONFIG | AVC_MESSAGE_REPLY, request->sequence);
        avc_put(&a, &control->config, sizeof control->config);
        avc_send(&a);
        return;
    }
    if (request->size != 8u + sizeof(avc_config_t)) {
        avc_refuse(device, request->sequence, AVC_REFUSED_SIZE, 8u + sizeof(avc_config_t));
        return;
    }
    if (!in_transfer(device, request)) {
        return;
    }
    transfer->last_tick = control->state.ticks;
    if (!transfer->committing) {
        avc_config_t config;
        memcpy(&config, &request->payload[8], sizeof config);
        const avc_reason_t reason = avc_config_check(&config, &control->config, control->bound);
        if (reason != AVC_OK) {
            transfer->open = false;
            avc_refuse(device, request->sequence, reason, AVC_AT_CONFIG);
            return;
        }
        control->next = config;
    }
    acknowledge(device, AVC_MESSAGE_CONFIG, request->sequence);
}

void avc_on_chunk(avc_device_t *device, const avc_request_t *request)
{
    avc_transfer_t *transfer = &device->transfer;
    if (!in_transfer(device, request)) {
        return;
    }
    const uint32_t offset = avc_get32(&request->payload[8]);
    const uint32_t count = (uint32_t)(request->size - 12u);
    if (count == 0u || count > AVC_CHUNK_MAX || offset > transfer->size || count > transfer->size - offset) {
        avc_refuse(device, request->sequence, AVC_REFUSED_SIZE, transfer->size);
        return;
    }
    if (offset > transfer->received) {
        avc_refuse(device, request->sequence, AVC_REFUSED_OFFSET, transfer->received); /* one before it was lost */
        return;
    }
    if (offset + count > transfer->received && !transfer->committing) {
        memcpy((uint8_t *)&shadow(device)->image + offset, &request->payload[12], count);
        transfer->received = offset + count;
    }
    transfer->last_tick = device->control.state.ticks;
    acknowledge(device, AVC_MESSAGE_CHUNK, request->sequence);
}

static void committed(avc_device_t *device, uint16_t sequence)
{
    avc_answer_t a = avc_answer(device, AVC_MESSAGE_COMMIT | AVC_MESSAGE_REPLY, sequence);
    avc_put32(&a, avc_running(device)->id);
    avc_put32(&a, device->control.swap_tick);
    avc_put32(&a, device->control.swap_waited);
    avc_send(&a);
}

void avc_on_commit(avc_device_t *device, const avc_request_t *request)
{
    avc_transfer_t *transfer = &device->transfer;
    const uint32_t table_id = avc_get32(&request->payload[4]);
    const uint32_t crc32 = avc_get32(&request->payload[8]);
    if (avc_runs(device, table_id, crc32) && !transfer->committing) { /* its answer was lost, or it ran before */
        if (transfer->session == avc_get32(&request->payload[0]) && transfer->table_id == table_id) {
            transfer->open = false;
        }
        committed(device, request->sequence);
        return;
    }
    if (!in_transfer(device, request)) {
        return;
    }
    if (avc_excite_runs(&device->control.excite)) {
        avc_refuse(device, request->sequence, AVC_REFUSED_EXCITED, device->control.excite.plan.number);
        return;
    }
    transfer->last_tick = device->control.state.ticks;
    if (transfer->committing) {
        transfer->commit_sequence = request->sequence;
        if (device->control.swap_wanted != 0u && transfer->last_tick - transfer->commit_tick > 1u) {
            avc_refuse(device, request->sequence, AVC_REFUSED_IN_CONTACT, table_id); /* not yet */
        }
        return;
    }
    avc_table_t *table = shadow(device);
    const avc_table_header_t *header = &table->image.header;
    if (transfer->received != transfer->size || avc_image_size(header->rows, avc_states(header)) != transfer->size) {
        avc_refuse(device, request->sequence, AVC_REFUSED_SIZE, transfer->received);
        return;
    }
    if (crc32 != transfer->crc32 || avc_crc32(0, (const uint8_t *)&table->image, transfer->size) != crc32) {
        transfer->received = 0u;
        avc_refuse(device, request->sequence, AVC_REFUSED_CRC, crc32);
        return;
    }
    uint16_t row = AVC_AT_HEADER;
    const avc_config_t *config = &device->control.next;
    const bool alone = transfer->size == 0u; /* a configuration, and no table */
    const avc_reason_t reason = alone ? AVC_OK : avc_image_check(&table->image, &config->limits, &row);
    if (reason != AVC_OK) {
        transfer->open = false;
        avc_refuse(device, request->sequence, reason, row);
        return;
    }
    table->id = table_id;
    table->crc32 = crc32;
    if (!alone) {
        avc_table_prepare(table, config);
    }
    transfer->committing = true;
    transfer->commit_sequence = request->sequence;
    transfer->commit_tick = transfer->last_tick;
    device->control.waited = 0u;
    device->control.away = 0u;
    atomic_signal_fence(memory_order_release);
    device->control.swap_wanted = 1u;
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

void avc_on_abort(avc_device_t *device, const avc_request_t *request)
{
    if (device->transfer.open && device->transfer.session == avc_get32(&request->payload[0])) {
        give_up_commit(device);
    }
    acknowledge(device, AVC_MESSAGE_ABORT, request->sequence);
}

void avc_on_readback(avc_device_t *device, const avc_request_t *request)
{
    if (device->control.state.has_table == 0u) {
        avc_refuse(device, request->sequence, AVC_REFUSED_NO_TABLE, 0u);
        return;
    }
    const avc_table_t *table = avc_running(device);
    const uint32_t offset = avc_get32(&request->payload[0]);
    const uint32_t count = avc_get32(&request->payload[4]);
    const uint32_t size = avc_image_size(table->image.header.rows, avc_states(&table->image.header));
    if (count == 0u || count > AVC_CHUNK_MAX || offset > size || count > size - offset) {
        avc_refuse(device, request->sequence, AVC_REFUSED_SIZE, size);
        return;
    }
    avc_answer_t a = avc_answer(device, AVC_MESSAGE_READBACK | AVC_MESSAGE_REPLY, request->sequence);
    avc_put32(&a, table->id);
    avc_put32(&a, offset);
    avc_put(&a, (const uint8_t *)&table->image + offset, count);
    avc_send(&a);
}
