#include <stdatomic.h>

#include "avc_link.h"

_Static_assert(sizeof(avc_sample_t) == 44, "a record travels as 44 bytes");
_Static_assert(AVC_SAMPLES_KEPT * sizeof(avc_sample_t) + 128u <= AVC_RING_SIZE, "a message of all records fits the ring");

void avc_telemetry_tick(avc_control_t *control)
{
    avc_telemetry_t *t = &control->telemetry;
    const avc_state_t *s = &control->state;
    t->left--;
    if (t->wait != 0u) {
        t->wait--;
        return;
    }
    t->wait = t->every - 1u;
    if (t->made - t->sent >= AVC_SAMPLES_KEPT) {
        t->dropped++;
        return;
    }
    t->kept[t->made % AVC_SAMPLES_KEPT] = (avc_sample_t){
        .ticks = s->ticks,
        .encoder_count = s->encoder_count,
        .velocity_m_per_s = s->velocity_m_per_s,
        .force_n = s->force_n,
        .frequency_hz = s->frequency_hz,
        .damping_ns_per_m = s->gains.damping_ns_per_m,
        .stiffness_n_per_m = s->gains.stiffness_n_per_m,
        .contact_damping_ns_per_m = s->gains.contact_damping_ns_per_m,
        .energy_j = s->energy_j,
        .faults = avc_faults(control),
        .mode = s->mode,
        .streaming = s->streaming,
        .contact = s->contact,
        .has_table = s->has_table,
    };
    atomic_signal_fence(memory_order_release);
    t->made++;
}

/* Another rate begins anew; the same one goes on, so that renewing leaves no gap. */
avc_verdict_t avc_on_subscribe(avc_device_t *device, const avc_request_t *request)
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
        t->dropped = 0u;
        t->number = 0u;
        atomic_signal_fence(memory_order_release);
    }
    t->left = every != 0u ? ticks : 0u;
    return avc_acknowledge(device, request, t->every, device->control.state.ticks);
}

bool avc_push_telemetry(avc_device_t *device)
{
    avc_telemetry_t *t = &device->control.telemetry;
    const uint32_t made = t->made;
    if (made == t->sent || AVC_RING_SIZE - avc_ring_room(&device->tx) > 64u) { /* at most one is ahead of an answer */
        return false;
    }
    atomic_signal_fence(memory_order_acquire);
    const uint32_t coupling_id = device->control.state.has_table != 0u ? avc_running(device)->image.header.coupling_id : 0u;
    const uint32_t head[5] = {t->number, t->dropped, t->every, device->boot_id, coupling_id};
    avc_answer_t a = avc_answer(device, AVC_MESSAGE_TELEMETRY, 0u);
    avc_put(&a, head, sizeof head);
    for (uint32_t at = t->sent; at != made; at++) {
        avc_put(&a, &t->kept[at % AVC_SAMPLES_KEPT], sizeof(avc_sample_t));
    }
    atomic_signal_fence(memory_order_release);
    t->sent = made;
    t->number++;
    avc_send(&a);
    return true;
}
