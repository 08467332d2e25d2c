#include "avc_frame.h"

#include <string.h>

/* One nibble at a time: 64 bytes of table instead of 1 KiB, twice the work of a byte table. */
static const uint32_t nibble_table[16] = {
    0x00000000u, 0x1DB71064u, 0x3B6E20C8u, 0x26D930ACu, 0x76DC4190u, 0x6B6B51F4u, 0x4DB26158u, 0x5005713Cu,
    0xEDB88320u, 0xF00F9344u, 0xD6D6A3E8u, 0xCB61B38Cu, 0x9B64C2B0u, 0x86D3D2D4u, 0xA00AE278u, 0xBDBDF21Cu,
};

uint32_t avc_crc32(uint32_t crc, const uint8_t *data, size_t size)
{
    crc = ~crc;
    for (size_t i = 0; i < size; i++) {
        crc = (crc >> 4) ^ nibble_table[(crc ^ data[i]) & 15u];
        crc = (crc >> 4) ^ nibble_table[(crc ^ ((uint32_t)data[i] >> 4)) & 15u];
    }
    return ~crc;
}

static void reset(avc_decoder_t *decoder)
{
    decoder->size = 0;
    decoder->left = 0;
    decoder->zero_follows = false;
    decoder->broken = false;
    decoder->started = false;
}

static void append(avc_decoder_t *decoder, uint8_t byte)
{
    if (decoder->size < AVC_CONTENT_MAX) {
        decoder->content[decoder->size++] = byte;
    } else {
        decoder->broken = true;
    }
}

static bool finish(avc_decoder_t *decoder)
{
    const bool complete = decoder->started && !decoder->broken && decoder->left == 0;
    const size_t size = decoder->size;
    reset(decoder);
    if (!complete || size < AVC_HEADER_SIZE + AVC_CRC_SIZE) {
        return false; /* broken, or a spare delimiter */
    }
    uint32_t sent;
    memcpy(&sent, &decoder->content[size - AVC_CRC_SIZE], sizeof sent);
    decoder->size = (uint16_t)size;
    return avc_crc32(0, decoder->content, size - AVC_CRC_SIZE) == sent;
}

bool avc_decoder_feed(avc_decoder_t *decoder, uint8_t byte)
{
    if (byte == 0) {
        return finish(decoder);
    }
    if (!decoder->started) {
        reset(decoder);
        decoder->started = true;
    }
    if (decoder->left == 0) { /* a code byte */
        if (decoder->zero_follows) {
            append(decoder, 0);
        }
        decoder->left = (uint8_t)(byte - 1u);
        decoder->zero_follows = byte != 0xFFu;
    } else {
        append(decoder, byte);
        decoder->left--;
    }
    return false;
}

size_t avc_frame_encode(uint8_t *content, size_t size, uint8_t *out)
{
    const uint32_t crc = avc_crc32(0, content, size);
    memcpy(&content[size], &crc, sizeof crc);
    size += AVC_CRC_SIZE;
    size_t code_at = 0;
    size_t to = 1;
    uint8_t code = 1;
    for (size_t i = 0; i < size; i++) {
        if (content[i] == 0) {
            out[code_at] = code;
            code_at = to++;
            code = 1;
            continue;
        }
        out[to++] = content[i];
        if (++code == 0xFFu && i + 1 < size) {
            out[code_at] = code;
            code_at = to++;
            code = 1;
        }
    }
    out[code_at] = code;
    out[to++] = 0;
    return to;
}
