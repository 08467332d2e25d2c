/* What a board gives. A port writes the functions of the first group and calls those of the second. */
#ifndef AVC_HAL_H
#define AVC_HAL_H

#include <stdbool.h>
#include <stdint.h>

#include "avc_config.h"

/* Sample time, encoder and limits in force; those of a bound board never change. */
const avc_limits_t *hal_limits(void);

void hal_start(void);               /* clocks, pins, serial port with receive interrupt, timer of one sample time */
int32_t hal_encoder_count(void);    /* position in counts, positive into the wall */
void hal_apply_force(float force_n); /* finite and within the limits, positive out of the wall */
bool hal_send(uint8_t byte);        /* false: the transmitter is busy, try again */

/* Optional: boards/defaults.c stands for what a board does not have. */
bool hal_enabled(void);            /* the enable line, as through an emergency stop */
void hal_drive(bool on);           /* the amplifier's enable; after every tick */
uint32_t hal_reset_faults(void);   /* AVC_FAULT_WATCHDOG or AVC_FAULT_BROWN_OUT where the last reset was one */
void hal_feed_watchdog(void);      /* within 50 ms; hal_start starts it */
void hal_unique(uint8_t id[12]);   /* the number of this chip that no other has; left alone where it has none */

void serial_handler(void);          /* the receive interrupt: gives each byte to avc_on_byte */

/* Of SysTick, in boards/start.c. */
bool hal_tick_is_due(void);     /* at the end of a tick: the next one should have begun already */
void hal_set_sample_time(void); /* that of hal_limits has changed */

/* Called by the board. */
void avc_on_tick(void); /* once a sample time, from an interrupt above that of the serial port */
void avc_on_byte(uint8_t byte);

#endif
