/* Gain table: gains against interaction frequency, checked as a whole, looked up by interpolation in ln(frequency). */
#ifndef AVC_TABLE_H
#define AVC_TABLE_H

#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#include "avc_config.h"

/* What a board with less memory defines otherwise. */
#ifndef AVC_CAPACITY_ROWS
#define AVC_CAPACITY_ROWS 256
#endif

enum {
    AVC_ROWS_MAX = AVC_CAPACITY_ROWS,
    AVC_STATES_MAX = AVC_CAPACITY_ROWS < 77 ? 8 : 16, /* of the observer whose state is fed back: they lie where the rows do */
    AVC_FEEDBACK_MAX = AVC_STATES_MAX * (AVC_STATES_MAX + 3),
    AVC_ZONE_NUMBERS = 7 /* of the dead zone, from dead_zone_m on */
};

enum {
    AVC_TABLE_VARIES = 2, /* the gains follow the frequency */
    AVC_TABLE_GUARD = 4,  /* the guard watches the energy */
    AVC_TABLE_CLIPS = 8,  /* the contact law: clip-last; otherwise gated */
    AVC_TABLE_FLAGS = 14, /* all of these */
    AVC_TABLE_STATES = 8  /* the number of the observer's states begins at this bit; 0: no observer */
};

/* The table as it travels and as it is read back: little-endian, no padding. */
typedef struct {
    uint16_t rows;
    uint16_t flags;
    float sample_time_s;
    float wall_damping_ns_per_m;
    float wall_stiffness_n_per_m;
    float safe_damping_ns_per_m; /* what runs after a lost heartbeat */
    float safe_stiffness_n_per_m;
    float max_force_n;    /* 0: the board's own */
    uint32_t coupling_id; /* name of the coupling at the host; not 0 */
} avc_table_header_t;

typedef struct {
    float frequency_hz, damping_ns_per_m, stiffness_n_per_m, contact_damping_ns_per_m;
} avc_row_t;

/* An observer with a dead zone and state feedback; all states are lengths. Only as many numbers travel as n states have. */
typedef struct {
    uint16_t measures;  /* the state that stands for the measured position */
    uint16_t positions; /* a bit for each state that starts where the device stands */
    float dead_zone_m;
    float face_m;        /* shift of the wall's face, as far as the dead zone is closed */
    float opens_m;       /* range of late positions at which the dead zone opens */
    float open_m;        /* and is open */
    float opening_per_m; /* 1/(open - opens); 0: it never opens */
    float kept;          /* share of the range that is left a tick later */
    float smoothing;     /* pole of the lag that the range is taken behind */
    float number[AVC_FEEDBACK_MAX]; /* A by rows (n n), B, L, R (n each) */
} avc_feedback_t;

/* State feedback goes with constant gains: it follows the only row. */
typedef struct {
    avc_table_header_t header;
    union {
        avc_row_t row[AVC_ROWS_MAX];
        struct {
            avc_row_t only;
            avc_feedback_t feedback;
        };
    };
} avc_image_t;

typedef struct {
    avc_image_t image;
    float ln_frequency[AVC_ROWS_MAX];
    uint32_t id, crc32;
} avc_table_t;

typedef struct {
    float damping_ns_per_m, stiffness_n_per_m, contact_damping_ns_per_m;
} avc_gains_t;

/* Why a table or a message is refused; the host turns each into a sentence. */
typedef enum {
    AVC_OK = 0,
    AVC_REFUSED_VERSION = 1,
    AVC_REFUSED_MESSAGE = 2,
    AVC_REFUSED_SIZE = 3,
    AVC_REFUSED_BUSY = 4,
    AVC_REFUSED_NO_TRANSFER = 5,
    AVC_REFUSED_OFFSET = 6,
    AVC_REFUSED_CRC = 7,
    AVC_REFUSED_ROWS = 8,
    AVC_REFUSED_NOT_FINITE = 9,
    AVC_REFUSED_NOT_MONOTONIC = 10,
    AVC_REFUSED_LIMIT = 11,
    AVC_REFUSED_SAMPLE_TIME = 12,
    AVC_REFUSED_STALE = 13,
    AVC_REFUSED_NO_TABLE = 14,
    AVC_REFUSED_INTERFACE = 15,
    AVC_REFUSED_STATES = 16,
    AVC_REFUSED_EXCITED = 17,
    AVC_REFUSED_NO_EXCITATION = 18,
    AVC_REFUSED_WALL = 19,
    AVC_REFUSED_FORCE = 20,
    AVC_REFUSED_COUPLING = 21,
    AVC_REFUSED_IN_CONTACT = 22,
    AVC_REFUSED_MODE = 23,
    AVC_REFUSED_HOLD = 24,
    AVC_REFUSED_FAULT = 25,
    AVC_REFUSED_FLAGS = 29,
    AVC_REFUSED_OTHER_COUPLING = 30,
    AVC_REFUSED_BOARD = 31
} avc_reason_t;

/* What a refusal names in place of a row. */
enum { AVC_AT_GAINS = 0xFFFA, AVC_AT_CONFIG, AVC_AT_LIMITS, AVC_AT_EXCITATION, AVC_AT_FEEDBACK, AVC_AT_HEADER };

/* Number of states of a table's observer; 0 without one. */
static inline uint32_t avc_states(const avc_table_header_t *header)
{
    return (uint32_t)header->flags >> AVC_TABLE_STATES;
}

/* Whether a table may have so many rows and states; avc_image_size is for those alone. None are a configuration alone. */
avc_reason_t avc_size_check(uint32_t rows, uint32_t states);

uint32_t avc_image_size(uint32_t rows, uint32_t states);

/* Positive floats are in the order of their bits: a comparison of whole numbers is half of one of floats. */
static inline uint32_t avc_bits(float x)
{
    uint32_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

/* Whether x is neither infinite nor NaN. */
static inline bool avc_is_finite(float x)
{
    return (avc_bits(x) & 0x7F800000u) != 0x7F800000u;
}

/* Check gains against the device's limits. */
avc_reason_t avc_gains_check(const avc_gains_t *gains, const avc_limits_t *limits);

/* Whether a board that runs now may run so: a checksum, its own program, its own limits where it is bound. */
avc_reason_t avc_config_check(const avc_config_t *config, const avc_config_t *now, bool bound);

/* Check a received image; at_row says where it fails. */
avc_reason_t avc_image_check(const avc_image_t *image, const avc_limits_t *limits, uint16_t *at_row);

/* Fill what the tick needs beside the image. */
void avc_table_prepare(avc_table_t *table);

#endif
