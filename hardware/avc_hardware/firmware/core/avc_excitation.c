/* The messages of an excitation: begin one, read its records, stop it. */
#include <stdatomic.h>

#include "avc_link.h"

enum { READ_HEAD = 24, A_RECORD = 4 };

static void tell(avc_device_t *device, uint8_t type, uint16_t sequence)
{
    const avc_excite_t *e = &device->control.excite;
    avc_answer_t a = avc_answer(device, (uint8_t)(type | AVC_MESSAGE_REPLY), sequence);
    avc_put32(&a, e->plan.number);
    avc_put32(&a, e->busy != 0u ? (uint32_t)AVC_EXCITE_RUNS : e->state);
    avc_send(&a);
}

void avc_on_excite(avc_device_t *device, const avc_request_t *request)
{
    avc_excite_t *e = &device->control.excite;
    const uint32_t number = avc_get32(request->payload);
    if (number == e->plan.number && number != 0u) { /* its answer was lost; it is not played again */
        tell(device, AVC_MESSAGE_EXCITE, request->sequence);
        return;
    }
    if (avc_excite_runs(e)) {
        avc_refuse(device, request->sequence, AVC_REFUSED_EXCITED, e->plan.number);
        return;
    }
    if (device->control.fault.codes != 0u) {
        avc_refuse(device, request->sequence, AVC_REFUSED_FAULT, device->control.fault.codes);
        return;
    }
    if (device->transfer.committing) {
        avc_refuse(device, request->sequence, AVC_REFUSED_BUSY, device->transfer.session);
        return;
    }
    avc_plan_t plan;
    memset(&plan, 0, sizeof plan);
    memcpy(&plan, request->payload, request->size);
    avc_reason_t reason = avc_plan_check(&plan, &device->control.config.limits);
    if (reason == AVC_OK && plan.max_force_n > avc_most_force(&device->control)) {
        reason = AVC_REFUSED_LIMIT;
    }
    if (reason != AVC_OK) {
        avc_refuse(device, request->sequence, reason, AVC_AT_EXCITATION);
        return;
    }
    if (request->size != AVC_PLAN_HEAD + plan.tones * sizeof(avc_tone_t)) {
        avc_refuse(device, request->sequence, AVC_REFUSED_SIZE, (uint32_t)request->size);
        return;
    }
    e->plan = plan;
    e->stop_wanted = 0u;
    e->heard = 0u;
    e->made = 0u;
    e->state = AVC_EXCITE_NEVER;
    atomic_signal_fence(memory_order_release);
    e->busy = 1u;
    tell(device, AVC_MESSAGE_EXCITE, request->sequence);
}

static bool is_of(avc_device_t *device, const avc_request_t *request)
{
    const avc_excite_t *e = &device->control.excite;
    if (e->plan.number != 0u && avc_get32(request->payload) == e->plan.number) {
        return true;
    }
    avc_refuse(device, request->sequence, AVC_REFUSED_NO_EXCITATION, e->plan.number);
    return false;
}

/* Records from an index on, the oldest that is kept where that one is gone. */
void avc_on_records(avc_device_t *device, const avc_request_t *request)
{
    if (!is_of(device, request)) {
        return;
    }
    avc_excite_t *e = &device->control.excite;
    e->heard = 1u;
    const uint32_t state = e->busy != 0u ? (uint32_t)AVC_EXCITE_RUNS : e->state;
    atomic_signal_fence(memory_order_acquire); /* the end is told with the last record or after it */
    const uint32_t made = e->made;
    const uint32_t oldest = made > AVC_RECORDS_KEPT ? made - AVC_RECORDS_KEPT : 0u;
    uint32_t first = avc_get32(&request->payload[4]);
    first = first > made ? made : first < oldest ? oldest : first;
    uint32_t past = first;
    int32_t before = first < made ? e->count[first % AVC_RECORDS] : 0;
    avc_answer_t a = avc_answer(device, AVC_MESSAGE_RECORDS | AVC_MESSAGE_REPLY, request->sequence);
    avc_put32(&a, e->plan.number);
    avc_put32(&a, state);
    avc_put32(&a, e->start_tick);
    avc_put32(&a, made);
    avc_put32(&a, first);
    avc_put32(&a, (uint32_t)before);
    while (past < made && past - first < (AVC_PAYLOAD_MAX - READ_HEAD) / A_RECORD) {
        const int32_t count = e->count[past % AVC_RECORDS];
        const int32_t step = (int32_t)((uint32_t)count - (uint32_t)before);
        if (step > INT16_MAX || step < INT16_MIN) {
            break; /* the next answer begins with it */
        }
        avc_put16(&a, (uint32_t)step);
        avc_put16(&a, (uint32_t)e->force[past % AVC_RECORDS]);
        before = count;
        past++;
    }
    avc_send(&a);
}

void avc_on_stop(avc_device_t *device, const avc_request_t *request)
{
    if (!is_of(device, request)) {
        return;
    }
    device->control.excite.stop_wanted = 1u;
    tell(device, AVC_MESSAGE_STOP, request->sequence);
}
