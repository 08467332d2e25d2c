"""The packaged board's flash driver on an emulated controller: whole wherever the power is cut, no count is lost."""

import functools

import pytest
from hardware_bench import push, require, with_gains
from hypothesis import given
from hypothesis import strategies as st

from avc_casadi import LinkError, load_problem
from avc_hardware import Connection, DeviceStatus, EmulatedBoard, TableImage, set_limits, store
from avc_hardware.emulator.flash import BASE, KEPT, SECTOR_BYTES, FlashController
from avc_hardware.emulator.machine import CLOCK_HZ
from avc_hardware.link import messages as m
from avc_hardware.link.messages import Kind

WALL = with_gains(load_problem("damped"), 50.0, 2e4, 20.0)
KEY, STATUS, CONTROL = BASE + 0x04, BASE + 0x0C, BASE + 0x10
LOCK, PROGRAM, ERASE, WORDS, START = 1 << 31, 1, 2, 2 << 8, 1 << 16
# An erase, and the words: of the head, of what is kept, of the table.
OPERATIONS = 1 + 4 + 10 + len(TableImage.of(WALL).image) // 4


def before_wall(_: float) -> float:
    return -1e-3


def kept_of(board: EmulatedBoard) -> tuple[str, bool, str, float]:
    device = Connection(board).device
    return device.kept_coupling_id, device.kept_acts, device.name, device.lowered_force_n


def status(board: EmulatedBoard) -> DeviceStatus:
    connection = Connection(board)
    return connection.run(connection.session.ask(Kind.STATUS, b"", DeviceStatus))


@functools.cache
def kept_twice() -> tuple[bytes, bytes]:
    """What the flash holds with one store, and with a second one in the other slot."""
    require("unicorn")
    board = EmulatedBoard(motion_m=before_wall)
    push(WALL, board)
    found = []
    for name, force in (("first", 7.0), ("second", 5.0)):
        set_limits(board, force_n=force)
        assert store(board, acts=True, name=name).name == name
        found.append(bytes(board.machine.flash.memory))
    return found[0], found[1]


def test_what_is_kept_takes_over_after_the_power_was_off() -> None:
    board = EmulatedBoard(motion_m=before_wall, flash=FlashController(kept_twice()[1]))
    found = status(board)
    assert (found.coupling_id, found.mode, found.boot_id, found.faults) == (WALL.id, "table", 1, 0)
    assert kept_of(board) == (WALL.id, True, "second", 5.0)
    assert Connection(board).device.flash_bytes == SECTOR_BYTES


@pytest.mark.thorough
@pytest.mark.parametrize("stored", [0, 1])
def test_the_power_may_be_cut_in_every_erase_and_every_word(stored: int) -> None:
    before = kept_twice()[stored]
    old = (WALL.id, True, *(("first", 7.0), ("second", 5.0))[stored])
    new = (WALL.id, True, "newest", old[3])
    board = EmulatedBoard(motion_m=before_wall)
    flash = board.machine.flash
    seen = set()
    for cut in range(OPERATIONS + 1):
        flash.memory[:] = before
        flash.left = None
        board.restart()
        _, data = Connection(board).session.message(Kind.STORE, m.store(3, "newest"))
        flash.left = cut
        board.write(data)
        board.machine.run_until(board.machine.cycle + round(1.2 * CLOCK_HZ))
        assert flash.powered == (cut == OPERATIONS)
        flash.left = None
        board.restart()
        now = kept_of(board)
        # the last bits of its last word may have been written when the power went
        assert now == (new if cut == OPERATIONS else old) or (cut == OPERATIONS - 1 and now == new)
        assert status(board).coupling_id == WALL.id
        seen.add(now)
    assert seen == {old, new}


def test_while_a_sector_is_erased_the_watchdog_is_fed_and_no_count_is_lost() -> None:
    require("unicorn")

    def moving(time_s: float) -> float:
        return -1e-3 - 0.2 * min(max(time_s - 0.2, 0.0), 0.8)  # 80 000 counts: more than the counter has

    board = EmulatedBoard(motion_m=moving)
    push(WALL, board)
    store(board, name="moved")
    found = status(board)
    assert board.now_s() > 1.0
    assert found.encoder_count == round(moving(2.0) / board.limits.metres_per_count)
    assert (found.boot_id, found.faults, found.mode) == (1, 0, "table")


def test_a_flash_that_takes_nothing_is_told_and_what_was_kept_stays() -> None:
    board = EmulatedBoard(motion_m=before_wall, flash=FlashController(kept_twice()[0]))
    board.machine.flash.write_register(KEY, 0, 0)  # a wrong key: locked until the next reset
    with pytest.raises(LinkError, match="did not take it"):
        store(board, name="other")
    assert kept_of(board) == (WALL.id, True, "first", 7.0)


def unlocked() -> FlashController:
    flash = FlashController()
    for key in (0x45670123, 0xCDEF89AB):
        flash.write_register(KEY, key, 0)
    return flash


@given(st.lists(st.integers(0, 2**32 - 1), min_size=1, max_size=4), st.integers(0, 2 * SECTOR_BYTES // 4 - 1))
def test_bits_of_the_emulated_flash_fall_alone_until_it_is_erased(words: list[int], at: int) -> None:
    flash = unlocked()
    flash.write_register(CONTROL, PROGRAM | WORDS, 0)
    expected = 2**32 - 1
    for word in words:
        flash.write(4 * at, 4, word, 0)
        expected &= word
        assert flash.read(4 * at, 4) == expected
    sector = 10 + 4 * at // SECTOR_BYTES
    flash.write_register(CONTROL, ERASE | sector << 3 | WORDS | START, 0)
    assert flash.read_register(STATUS, CLOCK_HZ // 2) == 1 << 16
    assert flash.read_register(STATUS, 2 * CLOCK_HZ) == 0
    assert flash.memory == b"\xff" * 2 * SECTOR_BYTES


def test_the_emulated_controller_refuses_what_the_chip_refuses() -> None:
    locked = FlashController()
    locked.write(0, 4, 0, 0)
    assert locked.read_register(STATUS, 0) == 1 << 7
    locked.write_register(STATUS, 1 << 7, 0)
    locked.write_register(CONTROL, PROGRAM, 0)
    assert (locked.read_register(STATUS, 0), locked.read_register(CONTROL, 0)) == (0, LOCK)
    flash = unlocked()
    for control, offset, size, error in (
        (PROGRAM, 0, 4, 1 << 6),
        (PROGRAM | WORDS, 2, 4, 1 << 5),
        (WORDS, 0, 4, 1 << 7),
    ):
        flash.write_register(CONTROL, control, 0)
        flash.write(offset, size, 0, 0)
        assert flash.read_register(STATUS, 0) == error
        flash.write_register(STATUS, error, 0)
    flash.write_register(CONTROL, ERASE | 9 << 3 | WORDS | START, 0)
    assert flash.read_register(STATUS, 0) == 1 << 4
    assert flash.memory == b"\xff" * 2 * SECTOR_BYTES
    flash.write_register(CONTROL, LOCK, 0)
    flash.write_register(KEY, 0xCDEF89AB, 0)
    for key in (0x45670123, 0xCDEF89AB):
        flash.write_register(KEY, key, 0)
    assert flash.read_register(CONTROL, 0) & LOCK
    assert KEPT + 2 * SECTOR_BYTES == 0x08100000
