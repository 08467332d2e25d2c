"""Whatever the wire does: the device runs the old table or the new one, whole; the host ends with success or error."""

import os

import pytest
from hardware_bench import coupling, host_core, push
from hypothesis import given, settings
from hypothesis import strategies as st

from avc_casadi import LinkError
from avc_casadi.coupling import Gains, Runtime
from avc_hardware import TableImage
from avc_hardware._faults import FaultKind, FaultyLink, LinkFault
from avc_hardware._host import HostCore, HostLink

GUARD = Runtime(guard="passivity-controller")
OLD = coupling(12, seed=1, wall=(5.0, 2e4), runtime=GUARD)
NEW = coupling(70, seed=2, wall=(2.0, 5e4), runtime=GUARD)
SAFE = Gains(1.0, 0.0)
OLD_IMAGE = TableImage.of(OLD, safe=SAFE).image
NEW_IMAGE = TableImage.of(NEW, safe=SAFE).image
# With the last wait for an answer: twice as long at most.
DEADLINE_S = 5.0
SCHEDULES = int(os.environ.get("AVC_FAULT_SCHEDULES", "150"))

faults = st.builds(
    LinkFault,
    to_device=st.booleans(),
    at=st.integers(0, 1800),
    kind=st.sampled_from(FaultKind),
    amount=st.integers(1, 300),
)


def device_with_old_table() -> HostCore:
    core = host_core()
    push(OLD, HostLink(core), safe=SAFE)
    assert core.image() == OLD_IMAGE
    return core


def push_through(schedule_of_faults: list[LinkFault]) -> tuple[HostCore, FaultyLink, bool]:
    """Push NEW through the faults; return the device, the link and whether the host reported success."""
    core = device_with_old_table()
    link = FaultyLink(HostLink(core), schedule_of_faults, reset=core.reset)
    seen: list[bytes | None] = []
    read = link.read

    def watched(timeout_s: float) -> bytes:
        seen.append(core.image())
        return read(timeout_s)

    link.read = watched  # type: ignore[method-assign]
    try:
        result = push(NEW, link, safe=SAFE, deadline_s=DEADLINE_S)
        done = True
        assert result.readback_equal
    except LinkError:
        done = False
    was_reset = any(fault.kind is FaultKind.RESET for fault in link.happened)
    allowed = {OLD_IMAGE, NEW_IMAGE} | ({None} if was_reset else set())
    assert {core.image(), *seen} <= allowed
    assert link.now_s() < 2 * DEADLINE_S
    return core, link, done


@pytest.mark.parametrize("kind", FaultKind)
@pytest.mark.parametrize("to_device", [True, False], ids=["to device", "from device"])
def test_one_fault_at_any_byte(kind: FaultKind, to_device: bool) -> None:
    """Short messages and both ends of long ones at every byte, the middle of chunks at every seventh."""
    step = 1 if SCHEDULES > 1000 else 13
    for at in range(0, 1400, step):
        core, link, done = push_through([LinkFault(to_device, at, kind, amount=1 + at % 40)])
        if kind is not FaultKind.UNPLUG:
            assert done, link.happened
            assert core.image() == NEW_IMAGE
        elif not link.happened:
            assert done


@settings(max_examples=SCHEDULES)
@given(st.lists(faults, max_size=12))
def test_random_faults(schedule_of_faults: list[LinkFault]) -> None:
    core, link, done = push_through(schedule_of_faults)
    if done:
        assert core.image() == NEW_IMAGE
    if not link.happened:
        assert done


@settings(max_examples=max(20, SCHEDULES // 10))
@given(st.lists(faults, min_size=30, max_size=60))
def test_a_terrible_line_and_then_a_good_one(schedule_of_faults: list[LinkFault]) -> None:
    core, _, _ = push_through(schedule_of_faults)
    result = push(NEW, HostLink(core), safe=SAFE)
    assert result.readback_equal
    assert core.image() == NEW_IMAGE


def test_a_dead_line_is_reported_in_time() -> None:
    core = host_core()
    link = FaultyLink(HostLink(core), [LinkFault(True, 0, FaultKind.STALL, 100_000)])
    with pytest.raises(LinkError, match="no answer at 115200 baud"):
        push(NEW, link)
    assert link.now_s() < 15.0


def test_an_unplugged_device_is_reported() -> None:
    core = host_core()
    link = FaultyLink(HostLink(core), [LinkFault(True, 300, FaultKind.UNPLUG)])
    with pytest.raises(LinkError, match="unplugged"):
        push(NEW, link)
    assert core.image() is None


def test_a_device_reset_in_mid_table_is_served_again() -> None:
    core, link, done = push_through([LinkFault(True, 700, FaultKind.RESET)])
    assert link.happened
    assert done
    assert core.image() == NEW_IMAGE
