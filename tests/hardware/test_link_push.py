"""What was pushed is what runs and what the device tells of itself: wall, force limit, names, mode."""

from typing import Any

import numpy as np
import pytest
from hardware_bench import coupling, host_core, host_library, push, unwatched
from host_device import HostCore, HostLink

from avc_casadi import LinkError
from avc_hardware import Connection, TableImage
from avc_hardware.link.device import DeviceStatus
from avc_hardware.link.messages import Kind
from avc_hardware.link.push import push_over


def image(*arguments: Any, **options: Any) -> TableImage:
    return TableImage.of(coupling(*arguments, **options))


def test_heartbeat_reports_the_mode() -> None:
    core = host_core()
    connection = Connection(HostLink(core))
    connection.run(connection.session.push(image(8), connection.device))
    assert connection.heartbeat(0.05) == "table"
    core.tick(np.zeros(40, dtype=np.int32))
    assert connection.heartbeat(0.05) == "table"
    core.tick(np.zeros(60, dtype=np.int32))
    assert connection.heartbeat(0.05) != "table"
    core.tick(np.zeros(101, dtype=np.int32))
    assert connection.heartbeat(0.0) == "safe"
    core.tick(np.zeros(2, dtype=np.int32))
    assert connection.heartbeat(0.0) == "table"


def test_the_same_table_twice_changes_nothing() -> None:
    core = host_core()
    first = push(coupling(9), HostLink(core))
    swaps = core.state().swaps
    again = push(coupling(9), HostLink(core))
    assert (again.table_id, again.crc32) == (first.table_id, first.crc32)
    assert again.readback_equal
    assert core.state().swaps == swaps


def test_status_names_the_coupling_and_the_device_takes_the_lower_force_limit() -> None:
    """The wall of a second coupling is its own; nothing of the first is left."""
    core = HostCore(host_library(), unwatched(max_force_n=20.0))
    connection = Connection(HostLink(core))
    ask = connection.session.ask
    assert connection.run(ask(Kind.STATUS, b"", DeviceStatus)).coupling_id == ""
    for limit, told in ((5.0, 5.0), (20.0, 20.0), (None, 20.0), (50.0, 20.0)):
        made = coupling(1, largest=(10.0, 1e5, 0.0), wall=(0.0, 1e5 + (limit or 0.0)), max_force_n=limit)
        if limit == 50.0:
            with pytest.raises(LinkError, match="a force limit of 50, the device gives 20"):
                push_over(connection, made)
        result = push_over(connection, made, unsafe=True)
        assert result.max_force_n == told
        assert ("its certificate does not know" in " ".join(result.notes)) == (limit == 50.0)
        force, _ = core.tick(np.full(50, 5000, dtype=np.int32))
        assert force[-1] == np.float32(told)
        assert connection.run(ask(Kind.STATUS, b"", DeviceStatus)).coupling_id == made.id == result.coupling_id
        device = connection.run(connection.session.hello())
        assert (device.coupling_id, device.force_limit_n) == (made.id, told)
        assert device.wall_stiffness_n_per_m == pytest.approx(made.wall.stiffness_n_per_m, rel=1e-6)


def test_the_wall_is_that_of_the_coupling() -> None:
    core = host_core()
    for stiffness in (2e3, 5e3):
        push(coupling(1, largest=(0.0, 1e6, 0.0), seed=4, wall=(0.0, stiffness)), HostLink(core))
        force, _ = core.tick(np.full(400, 500, dtype=np.int32))
        k = TableImage.of(coupling(1, largest=(0.0, 1e6, 0.0), seed=4)).rows[0, 2]
        assert force[-1] == pytest.approx(1e-3 * k * stiffness / (k + stiffness), rel=1e-4)


@pytest.mark.parametrize("damping", [0.0, 40.0, 100.0])
def test_the_damper_of_the_wall_is_that_of_the_coupling(damping: float) -> None:
    """Pressed at speed v through a spring k, the wall answers with k k_e/(k + k_e) x + b_e v (k/(k + k_e))^2."""
    core, stiffness, speed = host_core(), 2e3, 0.01
    made = coupling(1, largest=(0.0, 1e4, 0.0), seed=4, wall=(damping, stiffness))
    push(made, HostLink(core))
    # 5 counts of 2 um in each tick of 1 ms, from the surface on.
    force, _ = core.tick(np.arange(400, dtype=np.int32) * 5)
    (k,), depth = made.table.gains[1], 399 * speed * 1e-3
    share = k / (k + stiffness)
    assert force[-1] == pytest.approx(share * stiffness * depth + damping * speed * share**2, rel=1e-4)
