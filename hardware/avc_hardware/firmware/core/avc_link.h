/* Inside the link: a request that has arrived, and the answer being built. */
#ifndef AVC_LINK_H
#define AVC_LINK_H

#include <string.h>

#include "avc_device.h"

typedef struct {
    uint16_t sequence;
    const uint8_t *payload;
    size_t size;
} avc_request_t;

typedef struct {
    avc_device_t *device;
    size_t size;
} avc_answer_t;

/* Begin an answer, add to it, send it; there is room for one at any time. */
avc_answer_t avc_answer(avc_device_t *device, uint8_t type, uint16_t sequence);
void avc_put(avc_answer_t *a, const void *data, size_t size);
void avc_put16(avc_answer_t *a, uint32_t value);
void avc_put32(avc_answer_t *a, uint32_t value);
void avc_put_float(avc_answer_t *a, float value);
void avc_put_lowered(avc_answer_t *a, const avc_lowered_t *lowered);
void avc_put_gains(avc_answer_t *a, const avc_gains_t *gains);
void avc_send(avc_answer_t *a);
void avc_refuse(avc_device_t *device, uint16_t sequence, avc_reason_t reason, uint32_t detail);

/* An excitation. */
void avc_on_excite(avc_device_t *device, const avc_request_t *request);
void avc_on_records(avc_device_t *device, const avc_request_t *request);
void avc_on_stop(avc_device_t *device, const avc_request_t *request);

/* Telemetry. */
void avc_on_subscribe(avc_device_t *device, const avc_request_t *request);
bool avc_push_telemetry(avc_device_t *device);

/* The transfer of a table. */
void avc_on_begin(avc_device_t *device, const avc_request_t *request);
void avc_on_chunk(avc_device_t *device, const avc_request_t *request);
void avc_on_commit(avc_device_t *device, const avc_request_t *request);
void avc_on_abort(avc_device_t *device, const avc_request_t *request);
void avc_on_readback(avc_device_t *device, const avc_request_t *request);
void avc_on_config(avc_device_t *device, const avc_request_t *request);
bool avc_watch_commit(avc_device_t *device);

static inline uint32_t avc_get32(const uint8_t *from)
{
    uint32_t value;
    memcpy(&value, from, sizeof value);
    return value;
}

static inline uint16_t avc_get16(const uint8_t *from)
{
    uint16_t value;
    memcpy(&value, from, sizeof value);
    return value;
}

static inline float avc_get_float(const uint8_t *from)
{
    float value;
    memcpy(&value, from, sizeof value);
    return value;
}

static inline const avc_table_t *avc_running(const avc_device_t *device)
{
    return &device->control.tables[device->control.active];
}

#endif
