#include "avc_link.h"

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

void avc_put16(avc_answer_t *a, uint32_t value)
{
    const uint16_t short_value = (uint16_t)value;
    avc_put(a, &short_value, sizeof short_value);
}

void avc_put32(avc_answer_t *a, uint32_t value)
{
    avc_put(a, &value, sizeof value);
}

void avc_put_float(avc_answer_t *a, float value)
{
    avc_put(a, &value, sizeof value);
}

void avc_put_lowered(avc_answer_t *a, const avc_lowered_t *lowered)
{
    avc_put_float(a, lowered->force_n);
    avc_put_float(a, lowered->speed_m_per_s);
    avc_put_float(a, lowered->energy_j);
}

void avc_put_gains(avc_answer_t *a, const avc_gains_t *gains)
{
    avc_put_float(a, gains->damping_ns_per_m);
    avc_put_float(a, gains->stiffness_n_per_m);
    avc_put_float(a, gains->contact_damping_ns_per_m);
}

void avc_send(avc_answer_t *a)
{
    avc_device_t *device = a->device;
    const size_t size = avc_frame_encode(device->content, a->size, device->encoded);
    for (size_t i = 0; i < size; i++) {
        (void)avc_ring_put(&device->tx, device->encoded[i]); /* poll made sure of the room */
    }
}

void avc_refuse(avc_device_t *device, uint16_t sequence, avc_reason_t reason, uint32_t detail)
{
    avc_answer_t a = avc_answer(device, AVC_MESSAGE_REFUSED, sequence);
    avc_put16(&a, (uint32_t)reason);
    avc_put16(&a, 0u);
    avc_put32(&a, detail);
    avc_send(&a);
}
