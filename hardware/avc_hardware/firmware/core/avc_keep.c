/* The message that has a device keep what it is, and what it does with that after a reset. */
#include <stdatomic.h>

#include "avc_crc32.h"
#include "avc_link.h"

/* A device that is not let go for so long keeps what it kept before. */
static const float patience_s = 1.0f;

void avc_recall(avc_device_t *device)
{
    avc_control_t *control = &device->control;
    avc_kept_t *kept = &device->kept;
    uint32_t slot = 0u;
    device->kept_number = avc_store_load(kept, &slot);
    if (device->kept_number == 0u) {
        memset(kept, 0, sizeof *kept);
        return;
    }
    if (avc_lowered_check(&kept->lowered, &control->limits)) {
        control->lowered = kept->lowered;
        avc_fault_limit(&control->fault, &control->limits, kept->lowered.speed_m_per_s, kept->lowered.energy_j);
    }
    if (AVC_IS_BUILT_IN) { /* only the limits are those kept */
        control->most_n = control->lowered.force_n < control->most_n ? control->lowered.force_n : control->most_n;
        return;
    }
    if ((kept->flags & (uint32_t)AVC_KEEPS_COUPLING) == 0u || kept->table_size < sizeof(avc_table_header_t)) {
        return;
    }
    avc_table_t *table = &control->tables[1u - control->active];
    if (kept->table_size > sizeof table->image) {
        return;
    }
    uint16_t row;
    avc_store_table(slot, 0u, &table->image, kept->table_size);
    const avc_table_header_t *header = &table->image.header;
    device->kept_coupling = header->coupling_id;
    if ((kept->flags & (uint32_t)AVC_COUPLING_ACTS) == 0u || avc_image_check(&table->image, &control->limits, &row) != AVC_OK ||
        avc_image_size(header->rows, avc_states(header)) != kept->table_size) {
        return;
    }
    table->id = kept->table_id;
    table->crc32 = avc_crc32(0u, (const uint8_t *)&table->image, kept->table_size);
    avc_table_prepare(table);
    control->swap_wanted = 1u; /* as any table: out of contact */
}

void avc_forget_recalled(avc_device_t *device)
{
    if (!device->transfer.committing) {
        device->control.swap_wanted = 0u;
    }
}

void avc_on_store(avc_device_t *device, const avc_request_t *request)
{
    avc_control_t *control = &device->control;
    const uint32_t flags = avc_get32(request->payload);
    if (hal_flash_size() == 0u) {
        avc_refuse(device, request->sequence, AVC_REFUSED_NO_FLASH, 0u);
    } else if ((flags & ~(uint32_t)(AVC_KEEPS_COUPLING | AVC_COUPLING_ACTS)) != 0u) {
        avc_refuse(device, request->sequence, AVC_REFUSED_MESSAGE, flags);
    } else if (device->transfer.committing || device->storing) {
        avc_refuse(device, request->sequence, AVC_REFUSED_BUSY, device->transfer.session);
    } else if (avc_excite_runs(&control->excite)) {
        avc_refuse(device, request->sequence, AVC_REFUSED_EXCITED, control->excite.plan.number);
    } else if ((flags & (uint32_t)AVC_KEEPS_COUPLING) != 0u && control->state.has_table == 0u) {
        avc_refuse(device, request->sequence, AVC_REFUSED_NO_TABLE, 0u);
    } else {
        device->storing = true;
        device->store_sequence = request->sequence;
        device->store_tick = control->state.ticks;
        device->store_flags = flags;
        memcpy(device->store_name, &request->payload[4], sizeof device->store_name);
        control->pause_wanted = 1u;
        atomic_signal_fence(memory_order_release);
        control->asked = 1u;
    }
}

static void resume(avc_device_t *device)
{
    device->control.pause_wanted = 0u;
    device->storing = false;
    atomic_signal_fence(memory_order_release);
    device->control.asked = 1u;
}

bool avc_watch_store(avc_device_t *device)
{
    avc_control_t *control = &device->control;
    if (control->paused == 0u) {
        const bool late = control->state.ticks - device->store_tick > (uint32_t)(patience_s * control->rate_hz);
        if (late) {
            resume(device);
            avc_refuse(device, device->store_sequence, AVC_REFUSED_IN_CONTACT, 0u);
        }
        return late;
    }
    const avc_table_t *table = avc_running(device);
    const avc_table_header_t *header = &table->image.header;
    const bool keeps = (device->store_flags & (uint32_t)AVC_KEEPS_COUPLING) != 0u && control->state.has_table != 0u;
    avc_kept_t kept;
    memset(&kept, 0, sizeof kept);
    kept.flags = keeps ? device->store_flags : 0u;
    kept.lowered = control->limits_wanted != 0u ? control->wanted : control->lowered;
    memcpy(kept.name, device->store_name, sizeof kept.name);
    kept.table_id = keeps ? table->id : 0u;
    kept.table_size = keeps ? avc_image_size(header->rows, avc_states(header)) : 0u;
    const bool saved = avc_store_save(&kept, &table->image);
    if (saved) {
        uint32_t slot = 0u;
        device->kept_number = avc_store_load(&device->kept, &slot);
        device->kept_coupling = keeps ? header->coupling_id : 0u;
    }
    resume(device);
    if (!saved) {
        avc_refuse(device, device->store_sequence, AVC_REFUSED_FLASH, hal_flash_size());
        return true;
    }
    avc_answer_t a = avc_answer(device, AVC_MESSAGE_STORE | AVC_MESSAGE_REPLY, device->store_sequence);
    avc_put32(&a, device->kept_number);
    avc_put32(&a, kept.flags);
    avc_send(&a);
    return true;
}
