"""The same session over pyserial: a pseudo-terminal with the compiled firmware core behind it."""

import dataclasses
import itertools
import os
import select
import signal
import threading
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from excited import planned
from hardware_bench import coupling, host_core, push, stream
from host_device import HostCore

from avc_casadi import LinkError
from avc_casadi.identification.excitation import Plan
from avc_hardware import TableImage, excite, monitor

pty = pytest.importorskip("pty", reason="pseudo-terminals need a Unix system")
tty = pytest.importorskip("tty", reason="pseudo-terminals need a Unix system")


class Bench:
    """A device at the other end of a pseudo-terminal, in a thread of its own."""

    def __init__(self, core: HostCore) -> None:
        self.core = core
        self.on_force: Callable[[], None] | None = None  # called once, at the first force
        self._master, slave = pty.openpty()
        tty.setraw(slave)
        self.port = os.ttyname(slave)
        self._slave = slave  # kept open: a terminal without any reader hangs up
        self._stop, self._wake = os.pipe()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self) -> None:
        while True:
            ready, _, _ = select.select([self._master, self._stop], [], [], 1e-3)
            if self._stop in ready:
                return
            if self._master in ready:
                self.core.write(os.read(self._master, 4096))
            force, _ = self.core.tick(np.zeros(1, dtype=np.int32))
            if self.on_force is not None and force.any():
                called, self.on_force = self.on_force, None
                called()
            data = self.core.read()
            while data:
                data = data[os.write(self._master, data) :]

    def unplug(self) -> None:
        os.write(self._wake, b"x")
        self._thread.join()
        for handle in (self._master, self._slave, self._stop, self._wake):
            os.close(handle)


@pytest.fixture
def bench() -> Iterator[Bench]:
    made = Bench(host_core())
    yield made
    if made._thread.is_alive():
        made.unplug()


def test_push_over_a_serial_port(bench: Bench) -> None:
    made = coupling(200, seed=1)
    assert push(made, bench.port).rows == 200
    assert bench.core.image() == TableImage.of(made).image


def test_stream_and_monitor_over_a_serial_port(bench: Bench) -> None:
    result = stream(coupling(20), bench.port, rate_hz=50, seconds=0.3)
    assert result.sent == 15
    assert result.taken + result.lost + result.late == 15
    assert result.status.has_table
    samples = list(monitor(bench.port, rate_hz=50, seconds=0.1))
    assert sum(1 + sample.lost for sample in samples) >= 6
    assert all(a.ticks <= b.ticks for a, b in itertools.pairwise(samples))


def excitation(ticks: int) -> Plan:
    """Of the core's own board, whose encoder stands still here."""
    return dataclasses.replace(planned(), metres_per_count=2e-6, ticks=ticks)


@pytest.mark.slow
def test_excitation_over_a_serial_port(bench: Bench) -> None:
    log = excite(excitation(800), bench.port)
    assert log.whole
    assert log.lost == 0
    assert np.array_equal(log.index, np.arange(801))
    assert np.abs(log.force_n).max() > 0.5


@pytest.mark.slow
def test_interrupt_of_an_excitation_stops_the_device_first(bench: Bench) -> None:
    before = signal.getsignal(signal.SIGINT)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    bench.on_force = lambda: os.kill(os.getpid(), signal.SIGINT)
    try:
        with pytest.raises(KeyboardInterrupt):
            excite(excitation(100_000), bench.port)
    finally:
        signal.signal(signal.SIGINT, before)
    bench.unplug()
    assert bench.on_force is None
    assert bench.core.state().ticks < 100_000
    assert bench.core.state().force_n == 0
    force, _ = bench.core.tick(np.zeros(200, dtype=np.int32))
    assert not force.any()


def test_unplugging_in_mid_session_is_reported(bench: Bench) -> None:
    samples = monitor(bench.port, rate_hz=100)
    next(samples)
    bench.unplug()
    with pytest.raises(LinkError):
        for _ in samples:
            pass
