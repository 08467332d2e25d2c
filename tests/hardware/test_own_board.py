"""A board that is not in the package: built from its folder, it gives the bits of every other, within its memory."""

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hardware_bench import coupling, require, scratch, unwatched
from host_device import HostCore, queue
from lock_step_board import LockStepBoard, Machine

import avc_casadi
import avc_hardware
from avc_casadi import InputError, LinkError, UnsupportedError, load_device
from avc_casadi.model.runtime import Runtime
from avc_hardware import Connection, DeviceStatus, RuntimeFigures, TableImage, build_firmware
from avc_hardware.codegen.boards import read_board
from avc_hardware.codegen.build import build_host, build_image
from avc_hardware.codegen.figures import Config
from avc_hardware.link.messages import Kind
from avc_hardware.link.monitor import pause
from avc_hardware.link.push import push_over

OWN = Path(__file__).parents[1] / "boards" / "cortex-m0"
CONFIG = Config(unwatched(), RuntimeFigures(estimator="zero-crossing"))
GUARD = "passivity-controller"
MICROBIT = Machine("microbit", 4, 16e6)
TICKS = 500


def image() -> Path:
    require("arm-none-eabi-gcc", "qemu-system-arm", "gcc")
    return build_image(read_board(OWN), scratch() / "own", config=CONFIG, bound=True)


def way(tick: int) -> int:
    """Counts: taps that grow faster, out of the wall to begin with."""
    time = tick * 1e-3
    return round(200 * np.sin(2 * np.pi * (3 + 12 * time) * time)) - 60


@pytest.mark.thorough
def test_a_coupling_that_is_pushed_has_the_bits_of_every_other_board() -> None:
    made = coupling(30, seed=2, largest=(300.0, 1e5, 50.0), runtime=Runtime(guard=GUARD))
    forces: list[float] = []
    with LockStepBoard(image(), MICROBIT, position=way) as board:
        board.on_force = forces.append
        with Connection(board, session=1) as connection:
            upload = connection.run(connection.session.push(TableImage.of(made), connection.device))
            connection.run(pause(TICKS * 1e-3))
            status = connection.run(connection.session.ask(Kind.STATUS, b"", DeviceStatus))
            device = connection.device
    board_of = read_board(OWN)
    core = HostCore(build_host(scratch() / "own-host", estimator=board_of.estimator), unwatched(), CONFIG.figures)
    counts = np.array([way(tick) for tick in range(len(forces))], dtype=np.int32)
    taken = upload.ticks - upload.waited
    core.tick(counts[:taken])
    queue(core, TableImage.of(made))
    expected = np.concatenate([np.zeros(taken, np.float32), core.tick(counts[taken:])[0]])
    assert np.array(forces, dtype=np.float32).tobytes() == expected.tobytes()
    assert expected.max() > 1
    assert status.coupling_id == made.id
    assert f"-DAVC_CAPACITY_ROWS={device.capacity_rows}" in board_of.defines


@pytest.mark.thorough
def test_a_table_too_long_for_it_is_refused_by_name() -> None:
    made = coupling(50, seed=2, largest=(300.0, 1e5, 50.0), runtime=Runtime(estimator="zero-crossing"))
    with (
        LockStepBoard(image(), MICROBIT, position=lambda _: -100) as board,
        Connection(board) as connection,
        pytest.raises(LinkError, match="has 50 rows, the device holds 40"),
    ):
        push_over(connection, made)


@pytest.mark.thorough
def test_the_command_takes_a_folder_copied_anywhere_and_the_installed_package_alone(tmp_path: Path) -> None:
    """As PORTING.md says: a folder outside the repository, and the packages as a wheel lays them out."""
    require("arm-none-eabi-gcc")
    site, own = tmp_path / "site", tmp_path / "elsewhere"
    for package in (avc_casadi, avc_hardware):
        source = Path(str(package.__file__)).parent
        shutil.copytree(source, site / source.name, ignore=shutil.ignore_patterns("_problems", "__pycache__"))
    shutil.copytree(avc_casadi.catalogue_path("figure5").parent, site / "avc_casadi" / "_problems")
    shutil.copytree(OWN, own / "my_board")
    asked = ["firmware", "reference-r1", "--board", "./my_board", "--out", "build"]
    program = f"""
import sys
sys.path.insert(0, {str(site)!r})
import avc_hardware
from avc_casadi.cli import main
print(avc_hardware.__file__)
raise SystemExit(main({asked!r}))
"""
    command = [sys.executable, "-P", "-c", program]
    done = subprocess.run(command, cwd=own, capture_output=True, text=True, check=False)  # noqa: S603 - our own program
    assert done.returncode == 0, done.stderr
    assert str(site / "avc_hardware") in done.stdout
    assert "qemu-system-arm -M microbit -kernel my_board.elf" in done.stdout
    assert {path.suffix for path in (own / "build").iterdir()} == {".elf", ".bin", ".hex"}


def test_every_fault_of_a_manifest_is_told_at_once(tmp_path: Path) -> None:
    device = load_device("reference-r1").device
    with pytest.raises(InputError, match=r"board\.toml: board: does not exist"):
        build_firmware(device, str(tmp_path), tmp_path)
    (tmp_path / "board.toml").write_text(
        'compiler = 3\nsources = ["absent.c"]\nflags = "-O2"\nspeed = 1\n'
        "[flash]\norigin = 0\n[memory]\norigin = 0\nbytes = 0\n[capacity]\nrows = 5\nrecords = 1000\n"
    )
    with pytest.raises(InputError) as caught:
        build_firmware(device, str(tmp_path), tmp_path)
    keys = [fault.key for fault in caught.value.faults]
    assert keys == ["compiler", "flags", "flash.bytes", "memory.bytes", "capacity.rows", "capacity.records", "speed"]


def copied(tmp_path: Path, file: str, old: str, new: str) -> Path:
    """The board in a folder of its own, with other words in one of its files."""
    folder = tmp_path / "own"
    shutil.copytree(OWN, folder)
    text = (folder / file).read_text()
    assert old in text
    (folder / file).write_text(text.replace(old, new))
    return folder


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("changed", "told"),
    [
        (("board.toml", "0x4000\n", "0x2000\n"), "less than 2 KiB of stack"),
    ],
)
def test_what_compiler_and_linker_say_is_told(tmp_path: Path, changed: tuple[str, str, str], told: str) -> None:
    require("arm-none-eabi-gcc")
    with pytest.raises(UnsupportedError, match=re.escape(told)):
        build_firmware(load_device("reference-r1").device, str(copied(tmp_path, *changed)), tmp_path)


@pytest.mark.parametrize("called", ["my board", "x; reboot", "-rf", "v1.2_b-3"])
def test_a_command_is_safe_to_copy_whatever_the_folder_is_called(called: str, tmp_path: Path) -> None:
    folder = tmp_path / called
    shutil.copytree(OWN, folder)
    name = read_board(folder).name
    assert shlex.quote(name) == name
    assert name[0] != "-"


def test_a_board_that_is_nowhere_is_refused_with_those_there_are(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"allowed: netduinoplus2.*or the folder of a board of your own"):
        build_firmware(load_device("reference-r1").device, str(tmp_path / "absent"), tmp_path)
