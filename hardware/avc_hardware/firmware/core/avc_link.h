/* Inside the link: a request that has arrived, and the answer being built. */
#ifndef AVC_LINK_H
#define AVC_LINK_H

#include <string.h>

#include "avc_device.h"

typedef struct {
    uint8_t type;
    uint16_t sequence;
    const uint8_t *payload;
    size_t size;
    uint32_t word[6]; /* the payload's first, 0 behind its end */
} avc_request_t;

typedef struct {
    avc_device_t *device;
    size_t size;
} avc_answer_t;

/* Why a request is refused, and with which detail; AVC_OK where it has its answer, or will have. */
typedef struct {
    avc_reason_t reason;
    uint32_t detail;
} avc_verdict_t;

static inline avc_verdict_t avc_no(avc_reason_t reason, uint32_t detail)
{
    return (avc_verdict_t){reason, detail};
}

/* Begin an answer, add to it, send it; there is room for one at any time. */
avc_answer_t avc_answer(avc_device_t *device, uint8_t type, uint16_t sequence);
void avc_put(avc_answer_t *a, const void *data, size_t size);
void avc_send(avc_answer_t *a);

/* A whole answer to a request, and one of two words. */
avc_verdict_t avc_reply(avc_device_t *device, const avc_request_t *request, const void *data, size_t size);
avc_verdict_t avc_acknowledge(avc_device_t *device, const avc_request_t *request, uint32_t first, uint32_t second);

/* An excitation. */
avc_verdict_t avc_on_excite(avc_device_t *device, const avc_request_t *request);
avc_verdict_t avc_on_records(avc_device_t *device, const avc_request_t *request);
avc_verdict_t avc_on_stop(avc_device_t *device, const avc_request_t *request);

/* The transfer of a table. */
avc_verdict_t avc_on_begin(avc_device_t *device, const avc_request_t *request);
avc_verdict_t avc_on_chunk(avc_device_t *device, const avc_request_t *request);
avc_verdict_t avc_on_commit(avc_device_t *device, const avc_request_t *request);
avc_verdict_t avc_on_abort(avc_device_t *device, const avc_request_t *request);
avc_verdict_t avc_on_readback(avc_device_t *device, const avc_request_t *request);
avc_verdict_t avc_on_config(avc_device_t *device, const avc_request_t *request);
bool avc_watch_commit(avc_device_t *device);

static inline const avc_table_t *avc_running(const avc_device_t *device)
{
    return &device->control.tables[device->control.active];
}

#endif
