/* How a coupling begins, and gives way to the next one: never with a force, or with energy
 * stored, that the new one knows nothing of. What leads away from it, and back: a host that is silent, a fault; the force
 * falls by a ramp, and comes back out of contact alone. */
#ifndef AVC_TAKEOVER_H
#define AVC_TAKEOVER_H

#include "avc_control.h"

static inline bool avc_varies(const avc_table_t *table)
{
    return (table->image.header.flags & AVC_TABLE_VARIES) != 0u;
}

/* What the gated law remembers of the wall: where the other one, or a start, has left a place before it, there is none. */
static inline void avc_see_penetration(avc_control_t *c)
{
    const float before_m = c->couple.environment_deflection_before_m;
    c->couple.environment_deflection_before_m = before_m > 0.0f ? before_m : 0.0f;
}

/* What the wall sees in place of the measured position, a weighted sum of what an observer with a dead zone believes: one
 * tick, in the order of operations of the scene's step; force_n is that of the tick before, as the actuator gives it. The
 * first tick takes the position as it is, the device at rest. */
float avc_feedback_step(avc_feedback_state_t *state, const avc_image_t *image, float position_m, float force_n);

/* No coupling runs: the next tick of one begins at rest. */
void avc_rest(avc_control_t *c, float x);

/* Whether a table that begins here gives no force and stores no energy. */
bool avc_out_of_wall(const avc_table_t *table, float x);

/* Limits at run time that the link has set: a lower force at once; a higher one out of contact, where no spring is held
 * back by the old one. */
void avc_adopt_limits(avc_control_t *c);

/* Out of the wall of the new table, and of the old one too: nothing of it is left. Where an observer goes on believing in
 * contact, being measured out of it for some ticks is enough. */
void avc_swap(avc_control_t *c, float x);

/* A fault has ended it: nothing of the coupling is left. Returns the force, which falls. */
float avc_fail(avc_control_t *c, uint32_t codes, float x);

/* A tick in another mode than that of the table, or one that a host should have been heard by: missed, the force ramps to
 * zero; then static safe gains, from the next time out of contact. */
void avc_leave_or_return(avc_control_t *c, float x);

#endif
