"""The hardware side: a link to the device, code generation, an emulated board; the firmware in C beside them."""

TYPE_CHECKING = False

if TYPE_CHECKING:
    from avc_hardware.codegen.admittance_export import admittance_files
    from avc_hardware.codegen.build import build_firmware
    from avc_hardware.codegen.export import export_c
    from avc_hardware.codegen.figures import BoardLimits, RuntimeFigures
    from avc_hardware.codegen.firmware_fit import FirmwareLacksError, check_runs_on
    from avc_hardware.emulator.bench import BenchDevice
    from avc_hardware.emulator.board import EmulatedBoard
    from avc_hardware.in_the_loop import FirmwareInTheLoop, LoopResult, tried_in_the_loop
    from avc_hardware.link.bytes import ByteLink
    from avc_hardware.link.connection import EMULATOR, EMULATOR_IS_FRESH, Connection, find_port, list_ports, open_link
    from avc_hardware.link.device import Device, DeviceStatus
    from avc_hardware.link.excite import ExcitationLog, excite
    from avc_hardware.link.faults import DeviceFault
    from avc_hardware.link.monitor import monitor
    from avc_hardware.link.push import PushResult, push
    from avc_hardware.link.session import NoAnswerError, RefusedError
    from avc_hardware.link.settings import DeviceLimits, clear_faults, set_limits
    from avc_hardware.link.stream import HOLD_PERIODS, StreamResult, StreamSample, stream
    from avc_hardware.link.table import TableImage
    from avc_hardware.link.telemetry import TelemetryLog, TelemetrySample

__all__ = ["EMULATOR", "EMULATOR_IS_FRESH", "HOLD_PERIODS", "BenchDevice", "BoardLimits", "ByteLink", "Connection"]
__all__ += ["Device", "DeviceFault", "DeviceLimits", "DeviceStatus", "EmulatedBoard", "ExcitationLog"]
__all__ += ["FirmwareInTheLoop", "FirmwareLacksError", "LoopResult", "NoAnswerError", "PushResult", "RefusedError"]
__all__ += ["RuntimeFigures", "StreamResult", "StreamSample", "TableImage", "TelemetryLog", "TelemetrySample"]
__all__ += ["build_firmware", "check_runs_on", "clear_faults", "excite", "export_c", "find_port", "list_ports"]
__all__ += ["admittance_files", "monitor", "open_link", "push", "set_limits", "stream", "tried_in_the_loop"]

if not TYPE_CHECKING:
    # Imported at first use: few of them need CasADi, pyserial or Unicorn.
    _HOMES = {
        "codegen.admittance_export": "admittance_files",
        "codegen.build": "build_firmware",
        "codegen.export": "export_c",
        "codegen.figures": "BoardLimits RuntimeFigures",
        "codegen.firmware_fit": "FirmwareLacksError check_runs_on",
        "emulator.bench": "BenchDevice",
        "emulator.board": "EmulatedBoard",
        "in_the_loop": "FirmwareInTheLoop LoopResult tried_in_the_loop",
        "link.bytes": "ByteLink",
        "link.connection": "EMULATOR EMULATOR_IS_FRESH Connection find_port list_ports open_link",
        "link.device": "Device DeviceStatus",
        "link.excite": "ExcitationLog excite",
        "link.faults": "DeviceFault",
        "link.monitor": "monitor",
        "link.push": "PushResult push",
        "link.session": "NoAnswerError RefusedError",
        "link.settings": "DeviceLimits clear_faults set_limits",
        "link.stream": "HOLD_PERIODS StreamResult StreamSample stream",
        "link.table": "TableImage",
        "link.telemetry": "TelemetryLog TelemetrySample",
    }
    _LAZY = {name: home for home, names in _HOMES.items() for name in names.split()}

    def __getattr__(name):
        from importlib import import_module  # noqa: PLC0415 - paid at first use only

        if name not in _LAZY:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = globals()[name] = getattr(import_module(f"{__name__}.{_LAZY[name]}"), name)
        return value

    def __dir__():
        return sorted({*_LAZY, *(name for name in globals() if name.startswith("__"))})
