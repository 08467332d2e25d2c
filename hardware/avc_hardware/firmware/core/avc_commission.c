/* The messages of commissioning: where the position is 0, what is wired wrongly, and limits below those of the board. */
#include <stdatomic.h>

#include "avc_link.h"

static void ask(avc_control_t *control)
{
    atomic_signal_fence(memory_order_release);
    control->asked = 1u;
}

/* Takes effect with the next tick, and ends what runs. */
void avc_on_zero(avc_device_t *device, const avc_request_t *request)
{
    avc_control_t *control = &device->control;
    if (device->transfer.committing) {
        avc_refuse(device, request->sequence, AVC_REFUSED_BUSY, device->transfer.session);
        return;
    }
    if (avc_excite_runs(&control->excite)) {
        avc_refuse(device, request->sequence, AVC_REFUSED_EXCITED, control->excite.plan.number);
        return;
    }
    if (control->state.has_table != 0u && control->state.contact != 0u) {
        avc_refuse(device, request->sequence, AVC_REFUSED_IN_CONTACT, 0u);
        return;
    }
    avc_forget_recalled(device);
    control->zero_wanted = 1u;
    ask(control);
    avc_answer_t a = avc_answer(device, AVC_MESSAGE_ZERO | AVC_MESSAGE_REPLY, request->sequence);
    avc_put32(&a, control->state.ticks);
    avc_send(&a);
}

void avc_on_latch(avc_device_t *device, const avc_request_t *request)
{
    avc_control_t *control = &device->control;
    const uint32_t codes = avc_get32(request->payload);
    if (codes == 0u || (codes & ~(uint32_t)(AVC_FAULT_WIRED_WRONGLY | AVC_FAULT_STUCK)) != 0u) {
        avc_refuse(device, request->sequence, AVC_REFUSED_MESSAGE, codes); /* the others are for the device to find */
        return;
    }
    control->latch_wanted = codes;
    ask(control);
    avc_answer_t a = avc_answer(device, AVC_MESSAGE_LATCH | AVC_MESSAGE_REPLY, request->sequence);
    avc_put32(&a, avc_faults(control));
    avc_put32(&a, control->state.mode);
    avc_send(&a);
}

void avc_on_limits(avc_device_t *device, const avc_request_t *request)
{
    avc_control_t *control = &device->control;
    avc_lowered_t wanted = {avc_get_float(&request->payload[0]), avc_get_float(&request->payload[4]),
                            avc_get_float(&request->payload[8])};
    if (!avc_lowered_check(&wanted, &control->limits)) {
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
    ask(control);
    avc_answer_t a = avc_answer(device, AVC_MESSAGE_LIMITS | AVC_MESSAGE_REPLY, request->sequence);
    avc_put_lowered(&a, &wanted);
    avc_send(&a);
}
