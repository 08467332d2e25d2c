/* The same on every board: the interrupts tick and receive, the main loop talks. */
#include "avc_device.h"
#include "hal.h"

static avc_device_t device;

/* Kept over a reset (not over a loss of power): tells the host that the device has started anew. */
static uint32_t boots __attribute__((section(".noinit")));

const avc_limits_t *hal_limits(void)
{
    return &device.control.config.limits;
}

void avc_on_byte(uint8_t byte)
{
    (void)avc_ring_put(&device.rx, byte); /* without one that is lost its frame is broken, and the host sends it again */
}

void avc_on_tick(void)
{
    device.control.fault.disabled = hal_enabled() ? 0u : (uint32_t)AVC_FAULT_DISABLED;
    const float sample_time_s = hal_limits()->sample_time_s;
    const float force_n = avc_control_tick(&device.control, hal_encoder_count());
    if (avc_bits(sample_time_s) != avc_bits(hal_limits()->sample_time_s)) {
        hal_set_sample_time();
    }
    hal_apply_force(force_n);
    hal_drive(avc_control_drives(&device.control));
    if (hal_tick_is_due()) {
        device.control.state.overruns++; /* the next tick came due before this one had ended */
    }
}

int main(void)
{
    boots++;
    avc_device_init(&device, &avc_built_in, avc_bound, boots);
    hal_unique(device.unique);
    avc_control_fault(&device.control, hal_reset_faults());
    hal_start();
    bool waiting = false;
    uint8_t byte = 0;
    uint32_t fed = 0;
    for (;;) {
        const uint32_t ticks = *(const volatile uint32_t *)&device.control.state.ticks;
        if (ticks != fed) { /* both the tick and this loop are alive */
            fed = ticks;
            hal_feed_watchdog();
        }
        const bool busy = avc_device_poll(&device);
        if (!waiting) {
            waiting = avc_ring_get(&device.tx, &byte);
        }
        if (waiting) {
            waiting = !hal_send(byte);
        } else if (!busy) {
            __asm volatile("wfi"); /* the next tick wakes it at the latest */
        }
    }
}
