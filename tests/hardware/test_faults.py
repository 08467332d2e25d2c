"""What must not go on ends in a latched fault with a name: the force falls by the ramp, and only a clear leads out."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hardware_bench import host_library, push, require, with_gains
from host_device import HostCore, HostLink
from hypothesis import given, settings
from hypothesis import strategies as st
from quick import first

from avc_casadi import load_problem
from avc_casadi.coupling import Coupling
from avc_hardware import BoardLimits, Connection, DeviceFault, DeviceStatus, EmulatedBoard, clear_faults
from avc_hardware.emulator.machine import CLOCK_HZ
from avc_hardware.link import messages as m
from avc_hardware.link.messages import Kind

WALL = with_gains(load_problem("damped"), 50.0, 2e4, 20.0)
FADE_TICKS = 20
PRESS = 300  # counts: 0.6 mm
OUT = -100


def board(made: Coupling = WALL) -> HostCore:
    core = HostCore(host_library())
    push(made, HostLink(core))
    return core


def go(core: HostCore, *places: int, ticks: int = 40) -> Any:
    """Move smoothly from place to place, each reached within so many ticks; returns the forces."""
    found = []
    for place in places:
        ease = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, ticks + 1) / ticks)
        start = core.state().encoder_count
        found.append(core.tick(np.rint(start + ease * (place - start)).astype(np.int32))[0])
    return np.concatenate(found)


def still(core: HostCore, ticks: int) -> Any:
    return core.tick(np.full(ticks, core.state().encoder_count, dtype=np.int32))[0]


def jump(core: HostCore) -> Any:
    return core.tick(np.array([core.state().encoder_count + 1000], dtype=np.int32))[0]


def opened(core: HostCore) -> Any:
    core.disable(True)
    return still(core, 1)


# What happens before each tick, and by how many counts the device moves until then, tick by tick.
INJECTED: dict[DeviceFault, tuple[Callable[[HostCore], object], list[int]]] = {
    DeviceFault.JUMP: (HostCore.state, [1000]),
    # ever faster out of the wall, each tick by 0.6 m/s: no jump, but beyond 3 m/s
    DeviceFault.SPEED: (HostCore.state, [-300 * tick for tick in range(1, 8)]),
    DeviceFault.DISABLED: (lambda core: core.disable(True), [0]),
    DeviceFault.OVERRUN: (HostCore.overrun, [0] * 5),
}


@pytest.mark.slow
@pytest.mark.parametrize("fault", INJECTED)
def test_the_force_falls_by_the_ramp_and_stays_away(fault: DeviceFault) -> None:
    core = board()
    assert go(core, 20_000, ticks=900)[-1] == 50.0
    act, moves = INJECTED[fault]
    forces = [50.0]
    for moved in moves:
        act(core)
        forces += core.tick(np.array([core.state().encoder_count + moved], dtype=np.int32))[0].tolist()
        if core.state().mode == 3:
            break
    assert core.faults() == fault
    forces = [*forces[-2:], *still(core, 100).tolist()]
    ramp = forces[0] * np.clip(1 - np.arange(102) / FADE_TICKS, 0, None)
    assert forces == pytest.approx(ramp.tolist(), abs=1e-4)
    assert not core.drives()
    assert (go(core, -PRESS, PRESS) == 0).all()


@pytest.mark.parametrize("sign", first([1, -1]))
@settings(max_examples=40)
@given(counts=st.integers(510, 100_000), at=st.integers(0, 39))
def test_no_glitch_reaches_the_motor(sign: int, counts: int, at: int) -> None:
    """+-1000 counts gave 50 N; now no tick gives more than the one before."""
    core = board()
    go(core, PRESS)
    still(core, at)
    before = core.state().force_n
    place = core.state().encoder_count
    forces = core.tick(np.array([place + sign * counts, place, place], dtype=np.int32))[0]
    assert (np.diff(np.concatenate([[before], forces])) < 0).all()
    assert core.faults() & DeviceFault.JUMP


def test_a_plausible_motion_is_no_fault() -> None:
    """Taps, strokes at 2 m/s, a tap of 600 m/s^2, a press to the force limit for seconds."""
    core = board()
    go(core, PRESS, OUT, PRESS, OUT, ticks=15)
    go(core, 20_000, ticks=1500)
    still(core, 3000)
    go(core, -20_000, ticks=60)
    go(core, 0, ticks=60)
    go(core, OUT, 40, OUT, ticks=8)
    assert core.faults() == 0
    assert core.state().saturated > 3000


def test_a_clear_leads_out_of_contact_alone() -> None:
    core = board()
    go(core, PRESS)
    jump(core)
    still(core, 50)
    link = HostLink(core, position=lambda _: PRESS + 1000)
    found = clear_faults(link)
    assert (found.were, found.left, found.first) == (DeviceFault.JUMP, DeviceFault(0), DeviceFault.JUMP)
    assert found.status.mode == "safe"
    assert (still(core, 200) == 0).all()  # still in the wall
    go(core, OUT)
    assert core.state().mode == 0
    fresh = board()
    assert go(core, PRESS)[-1] == go(fresh, PRESS)[-1] > 5.0
    assert core.drives()


@pytest.mark.parametrize("gains", ["safe", "streamed"])
def test_a_wall_without_gains_gives_no_force_and_lacks_no_energy(gains: str) -> None:
    """Its spring would hold 50 J by then; heartbeats, or the end of the stream, and leaving contact lead back."""
    core = board()
    go(core, OUT)
    connection = Connection(HostLink(core))
    if gains == "safe":
        connection.run(connection.session.request(Kind.HEARTBEAT, m.words(20)))
        still(core, 200)
    else:
        payload = m.set_gains(int(WALL.id, 16), 0, 5000, 0.0, 0.0, 0.0)
        connection.run(connection.session.request(Kind.SET_GAINS, payload))
        still(core, 1000)
    assert np.abs(go(core, 15_000, ticks=1500)).max() < 1e-6
    silent = gains == "safe"
    assert (core.faults(), core.state().mode) == (DeviceFault.HEARTBEAT * silent, 2 * silent)
    connection.run(connection.session.request(Kind.HEARTBEAT, m.words(0)))
    assert np.abs(go(core, OUT, ticks=1500)).max() < 1e-6
    still(core, 3000)
    assert (core.faults(), core.state().mode) == (0, 0)
    assert go(core, PRESS)[-1] > 5.0


def test_what_is_still_wrong_is_latched_again_and_nothing_unseen_is_cleared() -> None:
    core = board()
    opened(core)
    assert clear_faults(HostLink(core)).left == DeviceFault.DISABLED
    core.disable(False)
    connection = Connection(HostLink(core))
    connection.run(connection.session.ask(Kind.CLEAR, m.words(DeviceFault.JUMP), m.Acknowledged))
    still(core, 5)
    assert core.faults() == DeviceFault.DISABLED
    found = clear_faults(HostLink(core))
    assert (found.left, found.status.mode) == (DeviceFault(0), "table")


def test_a_force_that_swings_over_a_count_that_stands_is_a_stuck_encoder() -> None:
    """The host streams soft and stiff gains; where the hand moves by a count now and then, nothing is stuck."""
    for moves, expected in ((False, DeviceFault.STUCK), (True, DeviceFault(0))):
        core = board()
        go(core, 1500, ticks=400)
        connection = Connection(HostLink(core, position=lambda _: 1500))
        for number in range(12):
            stiffness = (100.0, 2e4)[number % 2]
            payload = m.set_gains(int(WALL.id, 16), number, 4000, 10.0, stiffness, 0.0)
            connection.run(connection.session.request(Kind.SET_GAINS, payload))
            still(core, 400)
            if moves:
                core.tick(np.array([1501, 1500], dtype=np.int32))
        assert core.faults() == expected


def test_a_wall_that_feeds_a_vibration_is_stopped() -> None:
    """A mass let go on a wall far too stiff for its sample time: it shakes itself until the energy limit ends it."""
    core = HostCore(host_library(), BoardLimits(max_acceleration_m_per_s2=0.0, max_speed_m_per_s=0.0))
    wall = {"stiffness_n_per_m": 1e5, "damping_ns_per_m": 0.0}
    push(with_gains(load_problem("damped").changed(environment=wall), 0.0, 1e8), HostLink(core))
    x, v, force, speeds = -1e-4, 0.05, 0.0, []
    for _ in range(4000):
        v += 1e-3 / 0.1 * (5.0 - force)
        x += 1e-3 * v
        force = float(core.tick(np.array([round(x / 2e-6)], dtype=np.int32))[0][0])
        speeds.append(abs(v))
        if core.faults():
            break
    assert core.faults() == DeviceFault.ENERGY
    assert max(speeds) > 0.1


class OnBoard:
    """The packaged image with a hand that stands where it is put."""

    def __init__(self, made: Coupling | None = WALL) -> None:
        require("unicorn")
        self.count = OUT
        self.codes: list[int] = []
        self.board = EmulatedBoard(encoder=lambda _: self.count, on_force_code=self.codes.append)
        self.machine = self.board.machine
        if made is not None:
            push(made, self.board)

    def run(self, seconds: float, count: int | None = None) -> None:
        self.count = self.count if count is None else count
        self.machine.run_until(self.machine.cycle + round(seconds * CLOCK_HZ))

    def status(self) -> DeviceStatus:
        connection = Connection(self.board)
        return connection.run(connection.session.ask(Kind.STATUS, b"", DeviceStatus))


def test_each_byte_to_the_firmware_takes_ten_bits_of_the_wire() -> None:
    """A start bit, eight bits and a stop bit at 115200 baud, however long the wire was quiet before."""
    machine = OnBoard(made=None).machine
    byte_s = 10 / 115200
    for sent in (1, 3):
        machine.run_until(machine.cycle + CLOCK_HZ // 100)
        begin = machine.cycle
        machine.send(bytes(sent))
        machine.run_until(begin + round((sent - 0.1) * byte_s * CLOCK_HZ))
        assert len(machine.received) == 1
        machine.run_until(begin + round((sent + 0.1) * byte_s * CLOCK_HZ))
        assert not machine.received


def test_on_the_emulated_board_a_hang_is_ended_by_the_watchdog() -> None:
    """The timer stops: the main loop lives, but no tick; within 50 ms the watchdog starts the firmware anew."""
    bench = OnBoard()
    boots = Connection(bench.board).device.boot_id
    machine: Any = bench.machine
    machine._next_tick = None
    bench.run(0.12)
    status = bench.status()
    assert (status.has_table, status.mode) == (False, "fault")
    assert Connection(bench.board).device.boot_id == boots + 1
    assert status.faults == DeviceFault.WATCHDOG
    assert clear_faults(bench.board).status.mode == "table"
