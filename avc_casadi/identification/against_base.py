"""What logs and the file of their device say against each other, where no fit could be right."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.text import number
from avc_casadi._util.units import told_in
from avc_casadi.files.device_file import DeviceFile
from avc_casadi.identification.device import states
from avc_casadi.identification.model import Identification
from avc_casadi.identification.record import Record
from avc_casadi.identification.terms import LOOP_RATIO

# A command so much above the limit is no rounding, and so large a share of them no single slip.
_ABOVE, _SHARE = 1.01, 1e-3
# Sample times nearer than this share are one.
_SAME = 0.02
# A value without a range is meant within this factor.
_FAR = 2.0
_COMPARED = ("mass_kg", "damping_ns_per_m", "coulomb_friction_n", "encoder_resolution_m", LOOP_RATIO)


def check_against(records: Sequence[Record], base: DeviceFile) -> None:
    """Refuse forces that the device does not give, and logs of some of its ticks.

    Args:
        records: in the units of the device.
        base: what is known of it.

    Raises:
        InputError: both faults.
    """
    faults = []
    device, units = base.device, base.device.units
    if states(base, "max_force_n") and device.max_force_n is not None:
        force = np.abs(np.concatenate([record.force_n for record in records]))
        share = float(np.mean(force > _ABOVE * device.max_force_n))
        if share > _SHARE:
            limit, largest = number(device.max_force_n), number(float(force.max()), 3)
            message = (
                f"asks for up to {largest} N, in {100 * share:.2g} % of its samples for more than device.max_force_n, "
                f"{limit} N: what acts is then not what is logged; allowed: less, or in {base.name} the force that "
                "the device gives for so long"
            )
            faults.append(Fault(records[0].name, None, "force", message))
    period = records[0].sample_time_s
    ticks = period / device.sample_time_s
    if states(base, "sample_time_s") and round(ticks) > 1 and abs(ticks / round(ticks) - 1) < _SAME:
        message = (
            f"steps by {number(1e3 * period)} ms, {round(ticks)} times device.sample_time_s: the forces between are "
            f"not in the log; allowed: every tick of the loop, or in {base.name} the sample time that it ran at"
        )
        faults.append(Fault(records[0].name, None, "time", message))
    if faults:
        with told_in(units):
            raise InputError(faults)


def differs_from(found: Identification, base: DeviceFile) -> list[str]:
    """Say where logs tell something else than the file of their device does: it may be that of another one.

    Args:
        found: what the logs tell, in the units of the device.
        base: what was known of it.
    """
    told = []
    period = base.device.sample_time_s
    if states(base, "sample_time_s") and abs(found.sample_time_s / period - 1) > _SAME:
        told.append(f"sample_time_s {number(period)}, the logs {number(found.sample_time_s)}")
    for key in _COMPARED:
        one, said = found.estimates.get(key), getattr(base.device, key)
        if one is None or not states(base, key) or not said or one.value <= 0:
            continue
        low, high = getattr(base.device.range, key, None) or (said / _FAR, said * _FAR)
        if one.high < low or one.low > high:
            known = number(said, 3) if low == high else f"{number(low, 3)} to {number(high, 3)}"
            told.append(f"{key} {known}, the logs {number(one.value, 3)}")
    order = base.device.amplifier_order
    if "amplifier" in found.terms and states(base, "amplifier_order") and order != found.amplifier_order:
        told.append(f"amplifier_order {order}, the logs {found.amplifier_order}")
    if not told:
        return []
    return [base.device.units.text(f"{base.name} says {'; '.join(told)}: is it the device of these logs?")]


def leans_on(found: Identification, base: DeviceFile) -> list[str]:
    """Say that a delay is measured only as well as the lag that the file of the device says beside it.

    Args:
        found: what the logs tell, in the units of the device.
        base: what was known of it.
    """
    key = "amplifier_bandwidth_hz"
    if key in found.estimates or "delay_samples" not in found.estimates or not states(base, key):
        return []
    bandwidth = base.device.amplifier_bandwidth_hz
    if bandwidth is None or base.device.range.amplifier_bandwidth_hz is not None:
        return []
    lag = f"the lag of {key} {number(bandwidth, 4)}, which {base.name} gives without a range"
    told = f"the delay in the device file is what the logs tell less {lag}: it is as wrong as that"
    return [f"{told}; say how well it is known in [device.range]"]
