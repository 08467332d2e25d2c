"""A board that is not in the package: built from its folder, it gives the bits of every other, within its memory."""

from pathlib import Path

import numpy as np
import pytest
from hardware_bench import coupling, require, scratch, unwatched
from test_firmware_tick_equals_reference import queue

from avc_casadi import InputError, LinkError, load_device
from avc_casadi.cli import main
from avc_casadi.coupling import Runtime
from avc_hardware import Connection, DeviceStatus, TableImage, build_firmware
from avc_hardware._host import HostCore
from avc_hardware._manifest import read_board
from avc_hardware._messages import Kind
from avc_hardware._monitor import pause
from avc_hardware._push import push_over
from avc_hardware._qemu import LockStepBoard, Machine
from avc_hardware._runtime_c import MADE_FOR, made_for
from avc_hardware.firmware_build import build_host, build_image

FOLDER = Path(__file__).parent / "boards"
GUARD = "passivity-controller"
MACHINES = {
    "cortex-m0": Machine("microbit", 4, 16e6),
    "riscv32": Machine("virt", 5, 1e7, ("-bios", "none"), "qemu-system-riscv32"),
}
TICKS = 500


def image(name: str) -> Path:
    require("arm-none-eabi-gcc", "riscv64-unknown-elf-gcc", "qemu-system-arm", "qemu-system-riscv64", "gcc")
    return build_image(read_board(FOLDER / name), scratch() / "own", generated={MADE_FOR: made_for(unwatched())})


def way(tick: int) -> int:
    """Counts: taps that grow faster, out of the wall to begin with."""
    time = tick * 1e-3
    return round(200 * np.sin(2 * np.pi * (3 + 12 * time) * time)) - 60


@pytest.mark.parametrize("name", MACHINES)
def test_a_coupling_that_is_pushed_has_the_bits_of_every_other_board(name: str) -> None:
    made = coupling(30, seed=2, largest=(300.0, 1e5, 50.0), runtime=Runtime(guard=GUARD))
    forces: list[float] = []
    with LockStepBoard(image(name), MACHINES[name], position=way) as board:
        board.on_force = forces.append
        with Connection(board, session=1) as connection:
            upload = connection.run(connection.session.push(TableImage.of(made), connection.device))
            connection.run(pause(TICKS * 1e-3))
            status = connection.run(connection.session.ask(Kind.STATUS, b"", DeviceStatus))
            device = connection.device
    board_of = read_board(FOLDER / name)
    core = HostCore(build_host(scratch() / f"own-{name}", estimator=board_of.estimator), unwatched())
    counts = np.array([way(tick) for tick in range(len(forces))], dtype=np.int32)
    taken = upload.ticks - upload.waited
    core.tick(counts[:taken])
    queue(core, TableImage.of(made))
    expected = np.concatenate([np.zeros(taken, np.float32), core.tick(counts[taken:])[0]])
    assert np.array(forces, dtype=np.float32).tobytes() == expected.tobytes()
    assert expected.max() > 1
    assert status.coupling_id == made.id
    assert f"-DAVC_CAPACITY_ROWS={device.capacity_rows}" in board_of.defines


def test_a_table_too_long_for_it_is_refused_by_name() -> None:
    made = coupling(50, seed=2, largest=(300.0, 1e5, 50.0), runtime=Runtime(estimator="zero-crossing"))
    with (
        LockStepBoard(image("cortex-m0"), MACHINES["cortex-m0"], position=lambda _: -100) as board,
        Connection(board) as connection,
        pytest.raises(LinkError, match="has 50 rows, the device holds 40; make a coupling for this capacity"),
    ):
        push_over(connection, made)


def test_the_command_takes_a_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    require("arm-none-eabi-gcc")
    asked = ["firmware", "reference-r1", "--board", str(FOLDER / "cortex-m0"), "--out", str(tmp_path / "made")]
    assert main(asked) == 0
    told = capsys.readouterr().out
    assert "qemu-system-arm -M microbit -kernel cortex-m0.elf" in told
    assert {path.suffix for path in (tmp_path / "made").iterdir()} == {".elf", ".bin", ".hex"}


def test_every_fault_of_a_manifest_is_told_at_once(tmp_path: Path) -> None:
    device = load_device("reference-r1").device
    with pytest.raises(InputError, match=r"has no board\.toml"):
        build_firmware(device, str(tmp_path), tmp_path)
    (tmp_path / "board.toml").write_text(
        'processor = "z80"\ncompiler = 3\nsources = ["absent.c"]\nflags = "-O2"\nspeed = 1\n'
        "[flash]\norigin = 0\n[memory]\norigin = 0\nbytes = 0\n[capacity]\nrows = 5\nrecords = 1000\n"
    )
    with pytest.raises(InputError) as caught:
        build_firmware(device, str(tmp_path), tmp_path)
    keys = [fault.key for fault in caught.value.faults]
    assert keys == [
        *("processor", "compiler", "flags", "flash.bytes", "memory.bytes", "capacity.rows", "capacity.records"),
        *("speed", "sources"),
    ]
    told = str(caught.value)
    assert all(word in told for word in ("allowed: cortex-m or other", "give the size in bytes", "is no file of"))


def test_memory_over_flash_and_a_board_without_sources_are_faults(tmp_path: Path) -> None:
    manifest = (FOLDER / "cortex-m0" / "board.toml").read_text()
    manifest = manifest.replace('["../lock_step.c"]', "[]").replace("0x20000000", "0x3f000")
    (tmp_path / "board.toml").write_text(manifest)
    with pytest.raises(InputError) as caught:
        build_firmware(load_device("reference-r1").device, str(tmp_path), tmp_path)
    assert [fault.key for fault in caught.value.faults] == ["sources", "memory"]
    assert "0x3f000 to 0x43000 lies over flash, 0x0 to 0x40000" in str(caught.value)


def test_a_board_that_is_nowhere_is_refused_with_those_there_are(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"allowed: netduinoplus2.*or the folder of a board of your own"):
        build_firmware(load_device("reference-r1").device, str(tmp_path / "absent"), tmp_path)
