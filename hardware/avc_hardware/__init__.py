"""Serial link to the device: bytes, frames, messages, session; firmware in C beside it.

`push` sends the table of a coupling, `stream` sends its gains live, `monitor` watches the device, `excite` plays
an excitation and logs it, `export_c` writes C for other firmware. A port is a device path or ``emulator``, the real
firmware image on an emulated board.
"""

from avc_hardware._arm_gains import arm_gains_c as arm_gains_c
from avc_hardware._bench_plant import BenchDevice as BenchDevice
from avc_hardware._built import BOARDS as BOARDS
from avc_hardware._built import BuiltFirmware as BuiltFirmware
from avc_hardware._built import build_firmware as build_firmware
from avc_hardware._bytes import ByteLink as ByteLink
from avc_hardware._bytes import SerialLink as SerialLink
from avc_hardware._clear import Cleared as Cleared
from avc_hardware._clear import clear_faults as clear_faults
from avc_hardware._commission import Commissioned as Commissioned
from avc_hardware._commission import commission as commission
from avc_hardware._connection import DEFAULT_BAUD as DEFAULT_BAUD
from avc_hardware._connection import EMULATOR as EMULATOR
from avc_hardware._connection import EMULATOR_IS_FRESH as EMULATOR_IS_FRESH
from avc_hardware._connection import Connection as Connection
from avc_hardware._connection import open_link as open_link
from avc_hardware._device import Device as Device
from avc_hardware._device import DeviceStatus as DeviceStatus
from avc_hardware._device_fault import DeviceFault as DeviceFault
from avc_hardware._diagnose import Diagnosis as Diagnosis
from avc_hardware._diagnose import diagnose as diagnose
from avc_hardware._emulator import EmulatedBoard as EmulatedBoard
from avc_hardware._excite import ExcitationLog as ExcitationLog
from avc_hardware._excite import excite as excite
from avc_hardware._export import export_c as export_c
from avc_hardware._figures import RuntimeFigures as RuntimeFigures
from avc_hardware._host import BoardLimits as BoardLimits
from avc_hardware._in_the_loop import FirmwareInTheLoop as FirmwareInTheLoop
from avc_hardware._in_the_loop import LoopTrace as LoopTrace
from avc_hardware._limits import DeviceLimits as DeviceLimits
from avc_hardware._limits import Limits as Limits
from avc_hardware._limits import set_limits as set_limits
from avc_hardware._live_plot import LivePlot as LivePlot
from avc_hardware._log import LOG_ENDINGS as LOG_ENDINGS
from avc_hardware._log import TelemetryLog as TelemetryLog
from avc_hardware._log import open_log as open_log
from avc_hardware._monitor import monitor as monitor
from avc_hardware._ports import Port as Port
from avc_hardware._ports import find_port as find_port
from avc_hardware._ports import list_ports as list_ports
from avc_hardware._push import PushResult as PushResult
from avc_hardware._push import push as push
from avc_hardware._runs_on import FirmwareLacksError as FirmwareLacksError
from avc_hardware._runs_on import check_runs_on as check_runs_on
from avc_hardware._session import NoAnswerError as NoAnswerError
from avc_hardware._session import RefusedError as RefusedError
from avc_hardware._store import Stored as Stored
from avc_hardware._store import store as store
from avc_hardware._stream import HOLD_PERIODS as HOLD_PERIODS
from avc_hardware._stream import StreamResult as StreamResult
from avc_hardware._stream import StreamSample as StreamSample
from avc_hardware._stream import stream as stream
from avc_hardware._table import TableImage as TableImage
from avc_hardware._telemetry import TelemetrySample as TelemetrySample
from avc_hardware._tried import LoopResult as LoopResult
from avc_hardware._tried import tried_in_the_loop as tried_in_the_loop
from avc_hardware._wired_bench import Wiring as Wiring
