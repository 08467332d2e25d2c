"""What logs and the file of their device say against each other, where no fit could be right."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from avc_casadi._errors import Fault, InputError
from avc_casadi.identification._device import states
from avc_casadi.identification._record import Record
from avc_casadi.problem import DeviceFile
from avc_casadi.support import number, told_in

# A command so much above the limit is no rounding, and so large a share of them no single slip.
_ABOVE, _SHARE = 1.01, 1e-3
# Sample times nearer than this share are one.
_SAME = 0.02


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
