/* Frames: COBS (consistent overhead byte stuffing) with a zero byte as delimiter, CRC-32 at the end of the content.
 *
 * Content: version u8, type u8, sequence u16, payload, crc32 u32 of all before it; little-endian.
 */
#ifndef AVC_FRAME_H
#define AVC_FRAME_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* CRC-32 as in zlib: reflected polynomial 0xEDB88320, start and final value inverted. Continues crc; start with 0. */
uint32_t avc_crc32(uint32_t crc, const uint8_t *data, size_t size);

enum {
    AVC_FRAME_MAX = 1024,                    /* encoded, with its delimiter */
    AVC_CONTENT_MAX = 1016,                  /* decoded: 1016 bytes become at most 1022 with the delimiter */
    AVC_HEADER_SIZE = 4,
    AVC_CRC_SIZE = 4,
    AVC_PAYLOAD_MAX = AVC_CONTENT_MAX - AVC_HEADER_SIZE - AVC_CRC_SIZE
};

/* Streaming decoder: keeps the decoded content of one frame. */
typedef struct {
    uint8_t content[AVC_CONTENT_MAX];
    uint16_t size;
    uint8_t left;      /* bytes before the next code byte */
    bool zero_follows; /* a zero stands before the next block */
    bool broken;       /* too long: skip to the delimiter */
    bool started;
} avc_decoder_t;

/* Take one byte; returns whether content[0..size) now is a frame with a right CRC (size still counts the CRC). */
bool avc_decoder_feed(avc_decoder_t *decoder, uint8_t byte);

/* Append the CRC to content (room for 4 more bytes), stuff it into out with a delimiter; returns the bytes written.
 * out holds at least size + 4 + (size + 4) / 254 + 2 bytes. */
size_t avc_frame_encode(uint8_t *content, size_t size, uint8_t *out);

#endif
