"""No table takes over in contact; nothing of what ran before is left where it does; nothing stale revives."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from faulty_link import FaultKind, FaultyLink, LinkFault
from hardware_bench import believer, coupling, dense_believer, host_core, push, stream
from host_device import HostCore, HostLink, queue
from hypothesis import given, settings
from hypothesis import strategies as st

from avc_casadi.model.gains import Gains
from avc_casadi.model.runtime import Runtime
from avc_hardware import Connection, StreamResult, TableImage
from avc_hardware.link import messages as m
from avc_hardware.link.faults import RefusalReason
from avc_hardware.link.messages import Kind
from avc_hardware.link.session import InContactError, RefusedError

SAFE = Gains(0.0, 3e3)
_GUARD = "passivity-controller"
COUPLINGS = (
    coupling(20, seed=1, largest=(300.0, 1e5, 50.0), wall=(2.0, 8e4)),
    coupling(1, seed=2, largest=(50.0, 5e4, 30.0), wall=(0.0, 1e3), contact="clip-last"),
    coupling(9, seed=3, largest=(3e3, 1e6, 9.0), runtime=Runtime(guard=_GUARD), contact="clip-last"),
    coupling(1, seed=4, largest=(0.0, 1e5, 5.0), wall=(3.0, 5e4), runtime=Runtime(state_feedback=believer(5))),
    coupling(1, seed=5, largest=(9.0, 5e4, 5.0), wall=(0.0, 3e4), runtime=Runtime(state_feedback=dense_believer(4))),
)
ID = int(COUPLINGS[0].id, 16)
TABLES = tuple(TableImage.of(made, safe=SAFE) for made in COUPLINGS)


def motion(seed: int, ticks: int = 400) -> Any:
    """Counts: a hand that wanders in and out of the wall."""
    rng = np.random.default_rng(seed)
    time = np.arange(ticks) * 1e-3
    metres = sum(
        rng.uniform(1e-4, 8e-4) * np.sin(2 * np.pi * rng.uniform(1, 30) * time + rng.uniform(0, 6)) for _ in range(3)
    )
    return np.rint(metres / 2e-6).astype(np.int32)


def until_taken(core: HostCore, way: Any) -> tuple[list[np.float32], int]:
    """Tick until the table that waits has taken over; returns the forces, that tick's included, and their number."""
    before, forces = core.state().swaps, []
    for count in way:
        forces.append(core.tick(np.array([count], dtype=np.int32))[0][0])
        if core.state().swaps > before:
            break
    return forces, len(forces)


@settings(max_examples=60)
@given(
    old=st.sampled_from([None, *TABLES]),
    new=st.sampled_from(TABLES),
    seed=st.integers(0, 10**6),
    at=st.integers(0, 250),
)
def test_it_waits_out_of_contact_and_begins_as_if_nothing_had_been(
    old: TableImage | None, new: TableImage, seed: int, at: int
) -> None:
    """So what it gives and takes is its own: no energy comes from the change, whatever ran and however it moved."""
    way = np.concatenate([np.full(3, -500, dtype=np.int32), motion(seed)])
    changed, unchanged, fresh = host_core(), host_core(), host_core()
    for core in (changed, unchanged):
        if old is not None:
            queue(core, old)
        core.tick(way[:1])
    fresh.tick(way[:1])
    if old is not None and old.table_id == new.table_id:
        return
    changed.tick(way[1 : 1 + at])
    queue(changed, new)
    waited, ticks = until_taken(changed, way[1 + at :])
    taken = at + ticks  # index of the tick that took over
    plain, _ = unchanged.tick(way[1:taken])
    assert np.array(waited[:-1], dtype=np.float32).tobytes() == plain[at:].tobytes()
    if changed.state().swaps == (old is not None):  # the hand has not left the wall
        return
    assert way[taken] <= 0
    assert waited[-1] == 0
    fresh.tick(way[1:taken])
    queue(fresh, new)
    expected, _ = fresh.tick(way[taken:])
    assert expected[0] == 0
    if new.varies and old is not None and not old.varies:
        return  # the frequency of the look-up has sunk to another lowest row meanwhile
    assert changed.tick(way[taken + 1 :])[0].tobytes() == expected[1:].tobytes()


def test_a_device_that_is_held_in_its_wall_keeps_what_it_runs() -> None:
    core = host_core()
    with pytest.raises(InContactError, match=r"stood at 0.0006, inside the new wall, which begins at -?0,"):
        push(COUPLINGS[0], HostLink(core, position=lambda _: 300))
    push(COUPLINGS[0], HostLink(core))
    told = []
    with pytest.raises(InContactError):
        push(COUPLINGS[1], HostLink(core, position=lambda _: 300), on_wait=lambda: told.append(1))
    assert told == [1]
    assert core.image() == TableImage.of(COUPLINGS[0]).image
    core.tick(np.full(9, -500, dtype=np.int32))
    assert core.image() == TableImage.of(COUPLINGS[0]).image
    push(COUPLINGS[1], HostLink(core))
    assert core.image() == TableImage.of(COUPLINGS[1]).image


def test_a_table_whose_host_has_gone_never_takes_over() -> None:
    core = host_core()
    core.tick(np.full(1, 300, dtype=np.int32))
    queue(core, TABLES[0])
    core.tick(np.full(2100, 300, dtype=np.int32))
    core.read()  # the main loop runs
    core.tick(np.full(50, -300, dtype=np.int32))
    assert core.image() is None


def asked(core: HostCore, kind: Kind, payload: bytes, answer: Any, session: int = 1) -> Any:
    connection = Connection(HostLink(core), session=session)
    return connection.run(connection.session.ask(kind, payload, answer))


def silence(core: HostCore, within: int = 20) -> None:
    """Ask for heartbeats and send none: past the ramp, out of the wall."""
    asked(core, Kind.HEARTBEAT, m.words(within), m.Acknowledged)
    core.tick(np.full(within + 130, -500, dtype=np.int32))


def test_gains_for_a_device_that_does_not_run_its_table_are_refused_and_not_kept() -> None:
    core = host_core()
    push(COUPLINGS[0], HostLink(core))
    silence(core)
    assert core.state().mode == 2
    with pytest.raises(RefusedError):
        asked(core, Kind.SET_GAINS, m.set_gains(ID, 0, 4000, 1.0, 5e4, 0.0), m.GainsTaken)
    asked(core, Kind.HEARTBEAT, m.words(0), m.Acknowledged, session=2)
    core.tick(np.full(50, -500, dtype=np.int32))
    assert (core.state().mode, core.state().streaming) == (0, 0)


def test_gains_of_another_coupling_do_not_run_over_a_table() -> None:
    core = host_core()
    push(COUPLINGS[0], HostLink(core))
    with pytest.raises(RefusedError) as caught:
        asked(core, Kind.SET_GAINS, m.set_gains(int(COUPLINGS[1].id, 16), 0, 4000, 1.0, 5e4, 0.0), m.GainsTaken)
    assert caught.value.refusal.reason is RefusalReason.OTHER_COUPLING
    with pytest.raises(RefusedError, match="a message of gains is outside the device's limits"):
        asked(core, Kind.SET_GAINS, m.set_gains(ID, 0, 4000, -1.0, 5e4, 0.0), m.GainsTaken)
    core.tick(np.full(3, -500, dtype=np.int32))
    assert core.state().streaming == 0


def test_streamed_gains_end_with_the_table_they_were_for() -> None:
    core = host_core()
    push(COUPLINGS[0], HostLink(core))
    asked(core, Kind.SET_GAINS, m.set_gains(ID, 0, 4000, 1.0, 5e4, 0.0), m.GainsTaken)
    core.tick(np.full(3, -500, dtype=np.int32))
    assert core.state().streaming == 1
    push(COUPLINGS[1], HostLink(core))
    core.tick(np.full(3, -500, dtype=np.int32))
    assert core.state().streaming == 0


@pytest.mark.parametrize(
    ("kind", "payload", "answer"),
    [
        (Kind.SET_GAINS, m.set_gains(ID, 0, 5001, 1.0, 1.0, 0.0), m.GainsTaken),
        (Kind.SET_GAINS, m.set_gains(ID, 0, 2**32 - 1, 1.0, 1.0, 0.0), m.GainsTaken),
        (Kind.HEARTBEAT, m.words(5001), m.Acknowledged),
    ],
)
def test_nothing_holds_for_longer_than_five_seconds(kind: Kind, payload: bytes, answer: Any) -> None:
    core = host_core()
    push(COUPLINGS[0], HostLink(core))
    with pytest.raises(RefusedError, match="at most 5000 ticks") as caught:
        asked(core, kind, payload, answer)
    assert caught.value.refusal.reason is RefusalReason.HOLD


def streamed(*faults: LinkFault, act: Callable[[HostCore], None] = lambda _: None) -> StreamResult:
    core = host_core()
    link = FaultyLink(HostLink(core), list(faults), reset=core.reset)
    left = [30]

    def after(_sample: object) -> None:
        left[0] -= 1
        if left[0] == 0:
            act(core)

    return stream(COUPLINGS[0], link, rate_hz=50, seconds=1.0, on_sample=after)


def test_a_stream_ends_well_only_on_its_own_table() -> None:
    assert streamed().faults == ()
    anew = " ".join(streamed(act=HostCore.reset).faults)
    assert "restarted" in anew
    assert "no table" in anew
    other = " ".join(streamed(act=lambda core: push(COUPLINGS[1], HostLink(core)) and None).faults)
    assert f"of coupling {COUPLINGS[1].id}, another host's" in other
    lost = " ".join(streamed(LinkFault(True, 1500, FaultKind.STALL, 40)).faults)
    assert "were lost" in lost
    assert "1 times" in lost
