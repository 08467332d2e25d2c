/* A coupling that is part of the image: the exported source itself, in place of the tables that are pushed.
 *
 * What stands round it is the same: takeover out of contact, supervision of the host, faults, force limit, link. */
#ifndef AVC_BUILT_IN_H
#define AVC_BUILT_IN_H

#include "avc_table.h"

#ifdef AVC_BUILT_IN
#include "avc_coupling.h"

enum { AVC_IS_BUILT_IN = 1 };

/* Wall, force limit and name, as a table has them. */
extern const avc_table_header_t avc_built_in;
#else
enum { AVC_IS_BUILT_IN = 0 };

static const avc_table_header_t avc_built_in = {.rows = 0u};

typedef struct {
    uint8_t started;
} avc_coupling_t;

static inline void avc_coupling_start(avc_coupling_t *coupling)
{
    coupling->started = 0u;
}

static inline float avc_coupling_step(avc_coupling_t *coupling, float position_m)
{
    (void)coupling;
    (void)position_m;
    return 0.0f;
}
#endif

#endif
