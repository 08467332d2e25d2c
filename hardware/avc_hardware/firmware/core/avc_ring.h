/* A ring of bytes between an interrupt and the main loop. */
#ifndef AVC_RING_H
#define AVC_RING_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

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

#endif
