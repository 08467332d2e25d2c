"""Firmware with a coupling built in: the bits of its exported C, within the same supervision, and no other coupling."""

import ctypes
from pathlib import Path

import numpy as np
import pytest
from exported import Exported
from hardware_bench import coupling, host_library, push, require, scratch
from host_device import State

from avc_casadi import InputError, load_device
from avc_casadi.cli import main
from avc_casadi.coupling import Coupling
from avc_casadi.files.coupling_file import write_coupling
from avc_casadi.model.runtime import Runtime
from avc_hardware import Connection, DeviceStatus, EmulatedBoard, TableImage, build_firmware
from avc_hardware.codegen.firmware_fit import FirmwareLacksError
from avc_hardware.emulator.machine import CLOCK_HZ
from avc_hardware.link import messages as m
from avc_hardware.link.faults import Reason
from avc_hardware.link.messages import Acknowledged, Kind
from avc_hardware.link.monitor import pause
from avc_hardware.link.session import RefusedError

STEP_M, TICKS = 2e-5, 400
DEVICE = {"encoder_resolution_m": STEP_M, "max_force_n": 2.0}
# An observer between encoder steps; with a table; a guard that no table asks for.
RUNTIMES = {
    1: Runtime(observer_mass_kg=0.25, guard="energy-tank"),
    20: Runtime("zero-crossing", observer_mass_kg=0.25, guard="passivity-controller", slew_per_s=None),
}


def made(rows: int = 1) -> Coupling:
    return coupling(rows, seed=2, largest=(50.0, 2e4, 5.0), wall=(0.0, 1e4), runtime=RUNTIMES[rows], **DEVICE)


def image(of: Coupling) -> Path:
    require("arm-none-eabi-gcc", "unicorn", "gcc")
    folder = scratch() / of.id
    return build_firmware(of, "netduinoplus2", folder, built_in=True, unsafe=True).files[0]


@pytest.mark.thorough
@pytest.mark.parametrize("rows", RUNTIMES)
def test_every_force_has_the_bits_of_the_exported_coupling(rows: int) -> None:
    of = made(rows)
    time = np.arange(TICKS + 10) * 1e-3
    way = np.rint((8e-4 * np.sin(2 * np.pi * (3 + 20 * time) * time) - 2e-4) / STEP_M).astype(np.int32)
    host = ctypes.CDLL(str(host_library()))
    read: list[int] = []
    states: list[State] = []
    boards: list[EmulatedBoard] = []

    def position(_: int) -> int:
        read.append(int(way[len(read)]))
        return read[-1]

    def applied(_: int) -> None:
        records = [board.machine.memory("device") for board in boards]
        states.extend(State.from_buffer_copy(record, host.avc_host_state_offset()) for record in records)

    board = EmulatedBoard(image(of), encoder=position, on_force_code=applied)
    boards.append(board)
    board.machine.run_until(TICKS * CLOCK_HZ // 1000)
    forces = np.array([state.force_n for state in states], dtype=np.float32)
    positions = way[: states[-1].ticks].astype(np.float32) * np.float32(STEP_M)
    assert len(states) > TICKS - 5
    first = states[0].ticks - 1
    assert [state.ticks - 1 for state in states] == list(range(first, first + len(states)))
    assert forces.tobytes() == Exported(of).forces(positions)[first:].tobytes()
    assert forces.max() == 2.0
    assert (forces > 0).sum() > 50


@pytest.mark.thorough
def test_it_tells_its_name_and_takes_no_other_coupling() -> None:
    of = made()
    with Connection(EmulatedBoard(image(of), motion_m=lambda _: -1e-3), session=1) as connection:
        assert (connection.device.built_in, connection.device.coupling_id) == (True, of.id)
        status = connection.run(connection.session.ask(Kind.STATUS, b"", DeviceStatus))
        assert (status.coupling_id, status.mode) == (of.id, "table")
        table = TableImage.of(coupling(1, seed=3))
        begin = m.begin(1, table.table_id, table.crc32, 1)
        with pytest.raises(RefusedError, match=f"coupling {of.id} is built into the firmware") as caught:
            connection.run(connection.session.ask(Kind.BEGIN, begin, Acknowledged))
        assert caught.value.refusal.reason is Reason.BUILT_IN
    with pytest.raises(FirmwareLacksError, match=rf"coupling {of.id} is built into its firmware.*avc firmware"):
        push(coupling(1, seed=3), EmulatedBoard(image(of), motion_m=lambda _: -1e-3))


@pytest.mark.thorough
def test_it_takes_over_out_of_contact_and_fades_with_a_silent_host() -> None:
    place, goal = [1e-3], [1e-3]

    def moves(_: float) -> float:
        place[0] += max(-5e-6, min(5e-6, goal[0] - place[0]))
        return place[0]

    with Connection(EmulatedBoard(image(made()), motion_m=moves)) as connection:

        def after(seconds: float, to: float | None = None) -> tuple[str, float]:
            goal[0] = place[0] if to is None else to
            connection.run(pause(seconds))
            status = connection.run(connection.session.ask(Kind.STATUS, b"", DeviceStatus))
            return status.mode, status.force_n

        assert after(0.1) == ("safe", 0.0)  # started in the wall
        assert after(0.4, -2e-4) == ("table", 0.0)
        mode, force = after(0.3, 3e-4)
        assert (mode, force > 0) == ("table", True)
        connection.heartbeat(0.05)
        assert after(0.3) == ("safe", 0.0)
        connection.heartbeat(0.0)
        assert after(0.3, -2e-4)[0] == "table"


@pytest.mark.thorough
def test_the_command_builds_what_a_push_refuses(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    require("arm-none-eabi-gcc")
    file = tmp_path / "c.json"
    write_coupling(made(), file)
    assert main(["push", str(file), "--port", "emulator", "--unsafe"]) == 1
    assert "avc firmware FILE --board B --built-in --out DIR" in capsys.readouterr().err
    asked = ["firmware", str(file), "--board", "netduinoplus2", "--out", str(tmp_path / "out")]
    assert main([*asked, "--built-in", "--unsafe"]) == 0
    assert made().id in capsys.readouterr().out
    with pytest.raises(InputError, match="is no coupling, and nothing else can be built in"):
        build_firmware(load_device("reference-r1").device, "netduinoplus2", tmp_path, built_in=True)
