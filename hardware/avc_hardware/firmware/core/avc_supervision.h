/* What leads away from the coupling, and back: a host that is silent, a fault. The force falls by a ramp, and comes back out
 * of contact alone. */
#ifndef AVC_SUPERVISION_H
#define AVC_SUPERVISION_H

#include "avc_control.h"

/* A fault has ended it: nothing of the coupling is left. Returns the force, which falls. */
float avc_fail(avc_control_t *c, uint32_t codes, float x);

/* A tick in another mode than that of the table, or one that a host should have been heard by. */
void avc_leave_or_return(avc_control_t *c, float x);

/* What follows runs in every tick, and is compiled into it. */

/* Heartbeat: missed, the force ramps to zero; then static safe gains, from the next time out of contact. */
static inline void avc_supervise(avc_control_t *c, float x)
{
    if ((c->heartbeat_seen | c->heartbeat_ticks | c->state.mode) != 0u) {
        avc_leave_or_return(c, x);
    }
}

#endif
