"""An emulated STM32F405: core by Unicorn; SysTick, interrupts and peripherals here."""

from __future__ import annotations

import importlib
import struct
from collections import deque
from collections.abc import Callable
from typing import Any

from avc_casadi import LinkError, MissingExtraError
from avc_casadi._util.interrupt import DeferredInterrupt
from avc_hardware.codegen.image import Image

CLOCK_HZ = 168_000_000
# Memory of the STM32F405: addresses and bytes.
_FLASH = 0x08000000
_FLASH_SIZE = 0x100000
_RAM = 0x20000000
_RAM_SIZE = 0x20000
# Pages of registers: of the core, then of the peripherals.
_SYSTEM = 0xE000E000
_APB1 = 0x40007000
_TIMERS = 0x40010000
_SERIAL = 0x40011000
_WATCHDOG = 0x40003000
_PORTS = 0x40020000
_RESETS = 0x40023000
_PAGE = 0x1000
# Return address of interrupt handlers: a page of its own, never executed.
_RETURN = 0x1FFF0000
# Numbers of interrupt vectors; those of peripherals follow the core's 16.
_SYSTICK_VECTOR = 15
_SERIAL_VECTOR = 16 + 37
# Bits of the serial port's status.
_OVERRUN = 1 << 3
_RECEIVED = 1 << 5
_TRANSMITTED = 1 << 6
_TRANSMIT_EMPTY = 1 << 7
# Reset causes of RCC_CSR.
BY_BROWN_OUT = 1 << 25
BY_POWER_ON = 1 << 27
BY_WATCHDOG = 1 << 29


class Machine:
    """The board: `run_until` advances time; bytes and positions go in, bytes and forces come out."""

    def __init__(
        self,
        image: Image,
        *,
        encoder: Callable[[int], int],
        actuator: Callable[[int], None] = lambda _: None,
        slice_cycles: int = CLOCK_HZ // 1000,
        on_instruction: Callable[[int], None] | None = None,
    ) -> None:
        """Load an image and reset the core."""
        try:
            # On import it ignores any fault of a copy of its library, Ctrl-C included.
            with DeferredInterrupt():
                unicorn: Any = importlib.import_module("unicorn")
                arm_const: Any = importlib.import_module("unicorn.arm_const")
        except ImportError as error:
            raise MissingExtraError(
                "the emulated board needs the extra 'emulator': pip install 'avc-casadi[emulator]'"
            ) from error
        self._image = image
        self._arm = arm_const
        self._error: type[Exception] = unicorn.UcError
        self._encoder = encoder
        self._actuator = actuator
        self._slice = slice_cycles
        core = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)
        core.ctl_set_cpu_model(arm_const.UC_CPU_ARM_CORTEX_M4)
        core.mem_map(_FLASH, _FLASH_SIZE, unicorn.UC_PROT_READ | unicorn.UC_PROT_EXEC)
        core.mem_map(_RAM, _RAM_SIZE, unicorn.UC_PROT_ALL)
        core.mem_map(_RETURN, _PAGE, unicorn.UC_PROT_READ | unicorn.UC_PROT_EXEC)
        for base in (_SYSTEM, _APB1, _TIMERS, _SERIAL, _WATCHDOG, _PORTS, _RESETS):
            core.mmio_map(base, _PAGE, self._read_register, base, self._write_register, base)
        if on_instruction is not None:
            core.hook_add(unicorn.UC_HOOK_CODE, lambda _core, address, _size, _data: on_instruction(address))
        self._core: Any = core
        self._saved = core.context_save()
        self.cycle = 0
        self.enabled = True
        self.received: deque[int] = deque()
        self.sent = bytearray()
        self.reset()

    def reset(self, why: int = BY_POWER_ON | BY_BROWN_OUT) -> None:
        """Start the firmware anew; memory outside .data and .bss keeps its content, time goes on."""
        for address, data in self._image.segments.items():
            self._core.mem_write(address, data)
        stack, entry = struct.unpack("<II", self._core.mem_read(_FLASH, 8))
        self._core.reg_write(self._arm.UC_ARM_REG_SP, stack)
        # Unicorn has no CPACR behind the system registers: the firmware's write to it is seen but has no effect.
        access = self._core.reg_read(self._arm.UC_ARM_REG_C1_C0_2)
        self._core.reg_write(self._arm.UC_ARM_REG_C1_C0_2, access | 0xF << 20)
        self._core.reg_write(self._arm.UC_ARM_REG_PRIMASK, 0)
        self._pc = entry
        self._registers: dict[int, int] = {_RESETS + 0x874: why}
        self._bites: int | None = None
        self._status = _TRANSMIT_EMPTY | _TRANSMITTED
        self._data = 0
        self._next_tick: int | None = None
        self._counted = False
        self._count = 0
        self._in_main = False
        self._next_byte = self.cycle
        self._transmit_free = self.cycle

    @property
    def byte_cycles(self) -> int:
        """Cycles of one byte on the wire: ten bits, at the rate that the firmware has set."""
        return 20 * self._registers.get(_SERIAL + 0x8, 0) or round(10 * CLOCK_HZ / 115200)

    def send(self, data: bytes) -> None:
        """Send bytes to the firmware, behind those that are still on the wire."""
        if not self.received:
            self._next_byte = max(self._next_byte, self.cycle + self.byte_cycles)
        self.received.extend(data)

    def code(self, address: int, size: int) -> bytes:
        """Return bytes of the program."""
        return bytes(self._core.mem_read(address, size))

    def memory(self, symbol: str) -> bytes:
        """Return the memory of a symbol."""
        address, size = self._image.symbols[symbol]
        return bytes(self._core.mem_read(address, size))

    def run_until(self, cycle: int, *, stop: Callable[[], bool] = lambda: False) -> None:
        """Advance time until a cycle, or until ``stop`` is true between two events."""
        with DeferredInterrupt() as interrupt:
            while self.cycle < cycle and not interrupt.came and not stop():
                due = self._due(cycle)
                if due > self.cycle:
                    count = min(due - self.cycle, self._slice)
                    self._run_main(count)
                    # a byte that the slice began to send may end before the event that it ran towards
                    self.cycle = min(self._due(cycle), self.cycle + count) if self._busy else self._due(cycle)
                self._deliver()

    def _due(self, limit: int) -> int:
        """Return the cycle of the next event: a tick, a byte in or out, the watchdog, or the limit."""
        events = [limit]
        if self._next_tick is not None:
            events.append(self._next_tick)
        if self.received:
            events.append(self._next_byte)
        if self._bites is not None:
            events.append(self._bites)
        if not self._status & _TRANSMIT_EMPTY:
            events.append(self._transmit_free)
        return max(min(events), self.cycle)

    def _run_main(self, count: int) -> None:
        self._waits = False
        self._in_main = True
        self._execute(self._pc | 1, 0, max(count, 2))
        self._in_main = False
        self._pc = self._core.reg_read(self._arm.UC_ARM_REG_PC)
        waiting = bytes(self._core.mem_read(self._pc - 2, 2)) == b"\x30\xbf"  # wfi
        self._busy = not (waiting or self._waits)

    def _execute(self, start: int, until: int, count: int) -> None:
        try:
            # An exception in a callback of the emulator is lost, and Ctrl-C with it.
            with DeferredInterrupt():
                self._core.emu_start(start, until, count=count)
        except self._error as error:
            place = self._core.reg_read(self._arm.UC_ARM_REG_PC)
            raise LinkError(f"the emulated firmware crashed at {place:#010x}: {error}") from error

    def _deliver(self) -> None:
        """Process the events of this cycle, the timer first, by interrupt priority."""
        if self._bites is not None and self.cycle >= self._bites:
            self.reset(BY_WATCHDOG)
        if self._next_tick is not None and self.cycle >= self._next_tick:
            self._next_tick += (self._registers.get(_SYSTEM + 0x14, 0) & 0xFFFFFF) + 1
            self._counted = True
            self._interrupt(_SYSTICK_VECTOR)
        if not self._status & _TRANSMIT_EMPTY and self.cycle >= self._transmit_free:
            self._status |= _TRANSMIT_EMPTY | _TRANSMITTED
        if self.received and self.cycle >= self._next_byte:
            self._next_byte = max(self._next_byte, self.cycle) + self.byte_cycles
            byte = self.received.popleft()
            if self._status & _RECEIVED:
                self._status |= _OVERRUN
            else:
                self._data = byte
                self._status |= _RECEIVED
            if self._registers.get(_SERIAL + 0xC, 0) & 1 << 5:
                self._interrupt(_SERIAL_VECTOR)

    def _interrupt(self, vector: int) -> None:
        """Run the handler of an interrupt by its vector, and return to what ran before; LinkError if it hangs."""
        core = self._core
        core.context_update(self._saved)  # the registers stacked by hardware and handler
        stack = core.reg_read(self._arm.UC_ARM_REG_SP)
        core.reg_write(self._arm.UC_ARM_REG_SP, (stack - 26 * 4) & ~7)
        core.reg_write(self._arm.UC_ARM_REG_LR, _RETURN | 1)
        (handler,) = struct.unpack("<I", core.mem_read(_FLASH + 4 * vector, 4))
        # A handler that runs for ten sample times hangs.
        self._execute(handler, _RETURN, 1_680_000)
        if core.reg_read(self._arm.UC_ARM_REG_PC) & ~1 != _RETURN:
            raise LinkError(f"the emulated firmware hangs in interrupt {vector}")
        core.context_restore(self._saved)

    def _read_register(self, _core: Any, offset: int, _size: int, base: int) -> int:
        """Return what the firmware reads of a register: status and data of the link, encoder, timers."""
        match base + offset:
            case 0x40011000:
                if self._in_main and not self._status & _TRANSMIT_EMPTY:
                    self._waits = True
                    self._core.emu_stop()  # polling: nothing changes before the next event
                return self._status
            case 0x40011004:
                self._status &= ~(_RECEIVED | _OVERRUN)
                return self._data
            case 0x40010424:
                ahead = self._encoder(self.cycle) - self._count
                # A counter of 16 bits, read once a tick: a place far from where it was switched on takes some ticks.
                self._count += max(-16384, min(ahead, 16384))
                return self._count & 0xFFFF
            case 0x40020410:
                return 0 if self.enabled else 1
            case 0xE000E010:
                value = self._registers.get(_SYSTEM + 0x10, 0) | (1 << 16 if self._counted else 0)
                self._counted = False
            case address:
                value = self._registers.get(address, 0)
        return value

    def _write_register(self, _core: Any, offset: int, _size: int, value: int, base: int) -> None:
        """Do what the firmware's write to a register does: a byte out, a force, watchdog or flash."""
        address = base + offset
        self._registers[address] = value
        match address:
            case 0x40011004:
                self.sent.append(value & 0xFF)
                self._transmit_free = max(self._transmit_free, self.cycle) + self.byte_cycles
                self._status &= ~(_TRANSMIT_EMPTY | _TRANSMITTED)
            case 0x40007408:
                self._actuator(value)
            case 0x40003000 if value in {0xAAAA, 0xCCCC}:
                ticks = (self._registers.get(_WATCHDOG + 8, 0xFFF) + 1) * (4 << self._registers.get(_WATCHDOG + 4, 0))
                self._bites = self.cycle + ticks * CLOCK_HZ // 32_000
            case 0x40023874 if value & 1 << 24:
                self._registers[address] = 0
            case 0xE000E010:
                on = bool(value & 1)
                self._next_tick = self.cycle + (self._registers[_SYSTEM + 0x14] & 0xFFFFFF) + 1 if on else None
