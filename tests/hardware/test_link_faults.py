"""Whatever the wire does: the device runs the old table or the new one, whole; the host ends with success or error."""

import os

import pytest
from faulty_link import FaultKind, FaultyLink, LinkFault
from hardware_bench import coupling, dense_believer, host_core, require
from host_device import HostCore, HostLink
from hypothesis import given, settings
from hypothesis import strategies as st
from quick import first

from avc_casadi import LinkError
from avc_casadi.coupling import Coupling
from avc_casadi.model.gains import Gains
from avc_casadi.model.runtime import Runtime
from avc_hardware import Connection, EmulatedBoard, TableImage
from avc_hardware.link.bytes import ByteLink
from avc_hardware.link.push import push_over

GUARD = Runtime(guard="passivity-controller")
OLD = coupling(12, seed=1, wall=(5.0, 2e4), runtime=GUARD)
NEW = coupling(70, seed=2, wall=(2.0, 5e4), runtime=GUARD)
SAFE = Gains(1.0, 0.0)
FED_BACK, OTHER = (
    coupling(1, wall=(5.0, 2e4), runtime=Runtime(state_feedback=dense_believer(8, seed))) for seed in (1, 2)
)
# The running table and the one that is pushed: rows, matrices over matrices of the same size, rows over matrices.
PAIRS = {"rows": (OLD, NEW), "matrices": (FED_BACK, OTHER), "both": (FED_BACK, NEW), "back": (NEW, FED_BACK)}
# With the last wait for an answer: twice as long at most.
DEADLINE_S = 5.0
# Every so many bytes a fault begins: all of them with AVC_FAULT_SCHEDULES above 1000.
BYTES_BETWEEN = 199
SCHEDULES = int(os.environ.get("AVC_FAULT_SCHEDULES", "150"))

faults = st.builds(
    LinkFault,
    to_device=st.booleans(),
    at=st.integers(0, 1800),
    kind=st.sampled_from(FaultKind),
    amount=st.integers(1, 300),
)


def image(of: Coupling) -> bytes:
    return TableImage.of(of, safe=SAFE).image


def push(coupling: Coupling, link: ByteLink, deadline_s: float | None = None) -> None:
    """Push a coupling with safe gains; neither is judged, which would take ten times as long as the dialogue."""
    with Connection(link, deadline_s=deadline_s) as connection:
        push_over(connection, coupling, safe=SAFE, unsafe=True)


def push_through(schedule_of_faults: list[LinkFault], pair: str = "rows") -> tuple[HostCore, FaultyLink, bool]:
    """Push the new table through the faults; return the device, the link and whether the host reported success."""
    old, new = PAIRS[pair]
    core = host_core()
    push(old, HostLink(core))
    assert core.image() == image(old)
    link = FaultyLink(HostLink(core), schedule_of_faults, reset=core.reset)
    seen: list[bytes | None] = []
    read = link.read

    def watched(timeout_s: float) -> bytes:
        seen.append(core.image())
        return read(timeout_s)

    link.read = watched  # type: ignore[method-assign]
    try:
        push(new, link, DEADLINE_S)
        done = True
    except LinkError:
        done = False
    was_reset = any(fault.kind is FaultKind.RESET for fault in link.happened)
    allowed = {image(old), image(new)} | ({None} if was_reset else set())
    assert {core.image(), *seen} <= allowed
    assert link.now_s() < 2 * DEADLINE_S
    return core, link, done


@pytest.mark.parametrize("kind", first(FaultKind))
@pytest.mark.parametrize(
    ("to_device", "pair", "size"),
    first([(True, "rows", 1400), (False, "matrices", 600)]),
    ids=["to device", "from device"],
)
def test_one_fault_at_any_byte(kind: FaultKind, to_device: bool, pair: str, size: int) -> None:
    for place in range(0, size, 1 if SCHEDULES > 1000 else BYTES_BETWEEN):
        core, link, done = push_through([LinkFault(to_device, place, kind, amount=1 + place % 40)], pair)
        if kind is not FaultKind.UNPLUG:
            assert done, link.happened
            assert core.image() == image(PAIRS[pair][1])
        elif not link.happened:
            assert done


@pytest.mark.slow
@settings(max_examples=SCHEDULES)
@given(st.lists(faults, max_size=12), st.sampled_from(sorted(PAIRS)))
def test_random_faults(schedule_of_faults: list[LinkFault], pair: str) -> None:
    core, link, done = push_through(schedule_of_faults, pair)
    if done:
        assert core.image() == image(PAIRS[pair][1])
    if not link.happened:
        assert done


@settings(max_examples=max(20, SCHEDULES // 10))
@given(st.lists(faults, min_size=30, max_size=60), st.sampled_from(sorted(PAIRS)))
def test_a_terrible_line_and_then_a_good_one(schedule_of_faults: list[LinkFault], pair: str) -> None:
    core, _, _ = push_through(schedule_of_faults, pair)
    new = PAIRS[pair][1]
    push(new, HostLink(core))
    assert core.image() == image(new)


@pytest.mark.slow
def test_preemption_at_any_instruction_changes_no_byte() -> None:
    """The main loop is interrupted after every few instructions, also inside conditional blocks."""
    require("unicorn")
    for slice_cycles in (3, 5, 11, 168_000):
        board = EmulatedBoard(slice_cycles=slice_cycles, encoder=lambda _: 0)
        with Connection(board) as connection:
            table = TableImage.of(coupling(20))
            assert connection.run(connection.session.push(table, connection.device)).attempts == 1
            assert connection.run(connection.session.read_table(len(table.image))) == table.image
