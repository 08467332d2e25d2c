"""The hardware side: a link to the device, code generation, an emulated board; the firmware in C beside them."""

TYPE_CHECKING = False

if TYPE_CHECKING:
    from avc_hardware.codegen.build import BOARDS as BOARDS
    from avc_hardware.codegen.build import BuiltFirmware as BuiltFirmware
    from avc_hardware.codegen.build import build_firmware as build_firmware
    from avc_hardware.codegen.export import export_c as export_c
    from avc_hardware.codegen.figures import BoardLimits as BoardLimits
    from avc_hardware.codegen.figures import RuntimeFigures as RuntimeFigures
    from avc_hardware.codegen.firmware_fit import FirmwareLacksError as FirmwareLacksError
    from avc_hardware.codegen.firmware_fit import check_runs_on as check_runs_on
    from avc_hardware.emulator.bench import BenchDevice as BenchDevice
    from avc_hardware.emulator.board import EmulatedBoard as EmulatedBoard
    from avc_hardware.in_the_loop import FirmwareInTheLoop as FirmwareInTheLoop
    from avc_hardware.in_the_loop import LoopResult as LoopResult
    from avc_hardware.in_the_loop import LoopTrace as LoopTrace
    from avc_hardware.in_the_loop import tried_in_the_loop as tried_in_the_loop
    from avc_hardware.link.bytes import ByteLink as ByteLink
    from avc_hardware.link.bytes import SerialLink as SerialLink
    from avc_hardware.link.connection import DEFAULT_BAUD as DEFAULT_BAUD
    from avc_hardware.link.connection import EMULATOR as EMULATOR
    from avc_hardware.link.connection import EMULATOR_IS_FRESH as EMULATOR_IS_FRESH
    from avc_hardware.link.connection import Connection as Connection
    from avc_hardware.link.connection import Diagnosis as Diagnosis
    from avc_hardware.link.connection import Port as Port
    from avc_hardware.link.connection import diagnose as diagnose
    from avc_hardware.link.connection import find_port as find_port
    from avc_hardware.link.connection import list_ports as list_ports
    from avc_hardware.link.connection import open_link as open_link
    from avc_hardware.link.device import Device as Device
    from avc_hardware.link.device import DeviceStatus as DeviceStatus
    from avc_hardware.link.excite import ExcitationLog as ExcitationLog
    from avc_hardware.link.excite import excite as excite
    from avc_hardware.link.faults import DeviceFault as DeviceFault
    from avc_hardware.link.monitor import monitor as monitor
    from avc_hardware.link.push import PushResult as PushResult
    from avc_hardware.link.push import push as push
    from avc_hardware.link.session import NoAnswerError as NoAnswerError
    from avc_hardware.link.session import RefusedError as RefusedError
    from avc_hardware.link.settings import Cleared as Cleared
    from avc_hardware.link.settings import DeviceLimits as DeviceLimits
    from avc_hardware.link.settings import Limits as Limits
    from avc_hardware.link.settings import clear_faults as clear_faults
    from avc_hardware.link.settings import set_limits as set_limits
    from avc_hardware.link.stream import HOLD_PERIODS as HOLD_PERIODS
    from avc_hardware.link.stream import StreamResult as StreamResult
    from avc_hardware.link.stream import StreamSample as StreamSample
    from avc_hardware.link.stream import stream as stream
    from avc_hardware.link.table import TableImage as TableImage
    from avc_hardware.link.telemetry import TelemetryLog as TelemetryLog
    from avc_hardware.link.telemetry import TelemetrySample as TelemetrySample
else:
    # Imported at first use: few of them need CasADi, pyserial or Unicorn.
    _HOMES = {
        "codegen.build": ("BOARDS", "BuiltFirmware", "build_firmware"),
        "codegen.export": ("export_c",),
        "codegen.figures": ("BoardLimits", "RuntimeFigures"),
        "codegen.firmware_fit": ("FirmwareLacksError", "check_runs_on"),
        "emulator.bench": ("BenchDevice",),
        "emulator.board": ("EmulatedBoard",),
        "in_the_loop": ("FirmwareInTheLoop", "LoopResult", "LoopTrace", "tried_in_the_loop"),
        "link.bytes": ("ByteLink", "SerialLink"),
        "link.connection": (
            *("Connection", "DEFAULT_BAUD", "EMULATOR", "EMULATOR_IS_FRESH", "open_link"),
            *("Diagnosis", "Port", "diagnose", "find_port", "list_ports"),
        ),
        "link.device": ("Device", "DeviceStatus"),
        "link.excite": ("ExcitationLog", "excite"),
        "link.faults": ("DeviceFault",),
        "link.monitor": ("monitor",),
        "link.push": ("PushResult", "push"),
        "link.session": ("NoAnswerError", "RefusedError"),
        "link.settings": ("Cleared", "DeviceLimits", "Limits", "clear_faults", "set_limits"),
        "link.stream": ("HOLD_PERIODS", "StreamResult", "StreamSample", "stream"),
        "link.table": ("TableImage",),
        "link.telemetry": ("TelemetryLog", "TelemetrySample"),
    }
    _LAZY = {name: home for home, names in _HOMES.items() for name in names}

    def __getattr__(name):
        from importlib import import_module  # noqa: PLC0415 - paid at first use only

        if name not in _LAZY:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = getattr(import_module(f"{__name__}.{_LAZY[name]}"), name)
        globals()[name] = value
        return value

    def __dir__():
        return sorted({*_LAZY, *(name for name in globals() if name.startswith("__"))})
