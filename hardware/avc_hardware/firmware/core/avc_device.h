/* The device: link and control loop round one context, no I/O of its own.
 *
 * Two contexts of execution: the interrupts put bytes into the ring rx and call avc_control_tick, the main loop calls
 * avc_device_poll and takes bytes out of the ring tx. Nothing else is shared.
 */
#ifndef AVC_DEVICE_H
#define AVC_DEVICE_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "avc_control.h"
#include "avc_frame.h"

/* A ring of bytes between an interrupt and the main loop. */
enum { AVC_RING_SIZE = 2048 }; /* a power of two */

/* One writer, one reader; indices run freely and wrap. */
typedef struct {
    uint8_t bytes[AVC_RING_SIZE];
    volatile uint32_t written;
    volatile uint32_t read;
} avc_ring_t;

static inline bool avc_ring_put(avc_ring_t *ring, uint8_t byte)
{
    const uint32_t written = ring->written;
    if (written - ring->read >= AVC_RING_SIZE) {
        return false;
    }
    ring->bytes[written % AVC_RING_SIZE] = byte;
    atomic_signal_fence(memory_order_release);
    ring->written = written + 1u;
    return true;
}

static inline bool avc_ring_get(avc_ring_t *ring, uint8_t *byte)
{
    const uint32_t read = ring->read;
    if (read == ring->written) {
        return false;
    }
    atomic_signal_fence(memory_order_acquire);
    *byte = ring->bytes[read % AVC_RING_SIZE];
    atomic_signal_fence(memory_order_release);
    ring->read = read + 1u;
    return true;
}

static inline uint32_t avc_ring_room(const avc_ring_t *ring)
{
    return AVC_RING_SIZE - (ring->written - ring->read);
}

enum {
    AVC_PROTOCOL_VERSION = 1,
    AVC_INTERFACE_VERSION = 14,
    AVC_CHUNK_MAX = 512, /* table bytes in one message */
    AVC_UNIQUE_SIZE = 12 /* bytes of the number that no other chip has; 0 where there is none */
};

typedef enum {
    AVC_MESSAGE_HELLO = 0x01,
    AVC_MESSAGE_BEGIN = 0x02,
    AVC_MESSAGE_CHUNK = 0x03,
    AVC_MESSAGE_COMMIT = 0x04,
    AVC_MESSAGE_READBACK = 0x05,
    AVC_MESSAGE_STATUS = 0x06,
    AVC_MESSAGE_HEARTBEAT = 0x07,
    AVC_MESSAGE_SET_GAINS = 0x08,
    AVC_MESSAGE_ABORT = 0x09,
    AVC_MESSAGE_EXCITE = 0x0A,
    AVC_MESSAGE_RECORDS = 0x0B,
    AVC_MESSAGE_STOP = 0x0C,
    AVC_MESSAGE_CLEAR = 0x0D,
    AVC_MESSAGE_SUBSCRIBE = 0x0E,
    AVC_MESSAGE_LIMITS = 0x11,
    AVC_MESSAGE_CONFIG = 0x12,
    AVC_MESSAGE_REPLY = 0x80, /* set in the answer to each of the above */
    AVC_MESSAGE_TELEMETRY = 0xFD,
    AVC_MESSAGE_REFUSED = 0xFF
} avc_message_t;

typedef struct {
    bool open;
    bool committing;      /* the tick has been asked to swap; its reply is still owed */
    uint16_t commit_sequence;
    uint32_t commit_tick; /* when the tick was asked */
    uint32_t session, table_id, crc32;
    uint32_t size, received; /* bytes */
    uint32_t last_tick;
} avc_transfer_t;

typedef struct {
    avc_control_t control;
    avc_ring_t rx;
    avc_ring_t tx;
    avc_decoder_t decoder;
    avc_transfer_t transfer;
    uint8_t content[AVC_CONTENT_MAX]; /* the answer being built */
    uint8_t encoded[AVC_FRAME_MAX];
    uint32_t boot_id;
    uint8_t unique[AVC_UNIQUE_SIZE];
    uint32_t stream_number;
    bool stream_seen;
} avc_device_t;

void avc_device_init(avc_device_t *device, const avc_config_t *config, bool bound, uint32_t boot_id);

/* From the main loop: takes in what has arrived. Returns whether something was done. */
bool avc_device_poll(avc_device_t *device);

#endif
