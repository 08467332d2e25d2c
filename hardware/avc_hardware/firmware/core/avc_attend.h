/* What the link asks of a tick, beside its table: position 0, faults to latch, limits, a pause. */
#ifndef AVC_ATTEND_H
#define AVC_ATTEND_H

#include "avc_control.h"

/* Do what was asked; at the next tick again where it cannot be done yet. */
void avc_attend(avc_control_t *c, int32_t raw_count);

/* A tick without force; the last of them leads back as after a lost heartbeat, out of contact. */
void avc_idle(avc_control_t *c, int32_t encoder_count);

#endif
