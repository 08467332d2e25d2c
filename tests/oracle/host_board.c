/* The host as a board: the device as an object that tests drive through plain functions. */
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "avc_device.h"
#include "avc_lookup.h"

avc_device_t *avc_host_new(const avc_config_t *config, int bound, uint32_t boot_id);
void avc_host_free(avc_device_t *device);
void avc_host_write(avc_device_t *device, const uint8_t *data, size_t size);
size_t avc_host_read(avc_device_t *device, uint8_t *out, size_t room);
void avc_host_state(const avc_device_t *device, avc_state_t *state);
size_t avc_host_image(const avc_device_t *device, uint8_t *out);
void avc_host_ticks(avc_device_t *device, const int32_t *counts, float *force, float *frequency, size_t size);
void avc_host_disable(avc_device_t *device, int disabled);
void avc_host_overrun(avc_device_t *device);
int avc_host_drives(const avc_device_t *device);
uint32_t avc_host_faults(const avc_device_t *device);
float avc_host_ln(float x);
avc_gains_t avc_host_lookup(const avc_table_t *table, float frequency_hz);
size_t avc_host_size(void);
size_t avc_host_state_offset(void);

avc_device_t *avc_host_new(const avc_config_t *config, int bound, uint32_t boot_id)
{
    avc_device_t *device = malloc(sizeof *device);
    if (device != NULL) {
        avc_device_init(device, config, bound != 0, boot_id);
    }
    return device;
}

void avc_host_free(avc_device_t *device)
{
    free(device);
}

/* Bytes as from the receive interrupt, the main loop in between: no byte is lost. */
void avc_host_write(avc_device_t *device, const uint8_t *data, size_t size)
{
    for (size_t i = 0; i < size; i++) {
        (void)avc_ring_put(&device->rx, data[i]);
        if (data[i] == 0u) {
            (void)avc_device_poll(device);
        }
    }
    (void)avc_device_poll(device);
}

size_t avc_host_read(avc_device_t *device, uint8_t *out, size_t room)
{
    size_t size = 0;
    (void)avc_device_poll(device);
    while (size < room && avc_ring_get(&device->tx, &out[size])) {
        size++;
        (void)avc_device_poll(device);
    }
    return size;
}

void avc_host_state(const avc_device_t *device, avc_state_t *state)
{
    *state = device->control.state;
}

/* The table in force, as bytes; 0 when there is none. */
size_t avc_host_image(const avc_device_t *device, uint8_t *out)
{
    if (device->control.state.has_table == 0u) {
        return 0;
    }
    const avc_image_t *image = &device->control.tables[device->control.active].image;
    const size_t size = avc_image_size(image->header.rows, avc_states(&image->header));
    memcpy(out, image, size);
    return size;
}

void avc_host_ticks(avc_device_t *device, const int32_t *counts, float *force, float *frequency, size_t size)
{
    for (size_t i = 0; i < size; i++) {
        force[i] = avc_control_tick(&device->control, counts[i]);
        frequency[i] = device->control.state.frequency_hz;
    }
}

/* The enable line. */
void avc_host_disable(avc_device_t *device, int disabled)
{
    device->control.fault.disabled = disabled != 0 ? (uint32_t)AVC_FAULT_DISABLED : 0u;
}

/* The tick before took too long. */
void avc_host_overrun(avc_device_t *device)
{
    device->control.state.overruns++;
}

int avc_host_drives(const avc_device_t *device)
{
    return avc_control_drives(&device->control) ? 1 : 0;
}

uint32_t avc_host_faults(const avc_device_t *device)
{
    return avc_faults(&device->control);
}

/* What is compiled into the tick. */
float avc_host_ln(float x)
{
    return avc_ln(x);
}

avc_gains_t avc_host_lookup(const avc_table_t *table, float frequency_hz)
{
    return avc_table_lookup(table, frequency_hz);
}

/* The device has no pointers, so that its layout is the same on every machine: tests read a board's memory with these. */
size_t avc_host_size(void)
{
    return sizeof(avc_device_t);
}

size_t avc_host_state_offset(void)
{
    return offsetof(avc_device_t, control) + offsetof(avc_control_t, state);
}
