"""What does not fit the device is refused by the host before a byte of the table travels, and named."""

from dataclasses import replace

import numpy as np
import pytest
from hardware_bench import coupling, host_core, host_library, image, push, refused, unwatched
from host_device import HostCore, HostLink

import avc_hardware
from avc_casadi import InputError, LinkError, NotDeployableError, load_problem
from avc_casadi.coupling import Coupling
from avc_casadi.model.gains import Gains
from avc_casadi.model.runtime import Runtime
from avc_hardware import Connection, RuntimeFigures, TableImage
from avc_hardware.codegen.figures import Config
from avc_hardware.link.faults import Reason, Refusal
from avc_hardware.link.session import RefusedError


def test_table_larger_than_the_device_is_refused_by_it() -> None:
    table = image(300)
    assert len(table.rows) == 300
    assert refused(table) == Refusal(Reason.ROWS, 256)
    with pytest.raises(LinkError, match="300 rows, the device holds 256"):
        push(coupling(300), HostLink(host_core()))


def test_wrong_sample_time_is_refused_on_both_sides() -> None:
    slow = coupling(3, sample_time_s=2e-3)
    assert refused(TableImage.of(slow)).reason is Reason.SAMPLE_TIME
    with pytest.raises(LinkError, match=r"sample time of 0\.002 s, the device runs at 0\.001 s"):
        push(slow, HostLink(host_core()))


def test_safe_gains_are_judged_as_those_of_the_coupling_are() -> None:
    """Before a byte travels: with every hand of [hands] and released, on the loop of the coupling's problem."""
    made = Coupling.constant(load_problem("reference-r1"), Gains(0.0, 500.0, 4.0), "by hand")
    core = HostCore(host_library(), unwatched(max_force_n=8.0))
    with pytest.raises(NotDeployableError, match="reference-r1 by safe gains: not deployable"):
        avc_hardware.push(made, HostLink(core), safe=Gains(0.0, 3e3))
    with pytest.raises(InputError, match=r"safe\.contact_damping_ns_per_m: is 4"):
        avc_hardware.push(made, HostLink(core), safe=Gains(0.0, 100.0, 4.0))
    assert core.image() is None
    avc_hardware.push(made, HostLink(core), safe=Gains(0.0, 100.0))
    assert core.image() is not None


@pytest.mark.parametrize(
    ("limit", "column", "words"),
    [
        ("max_damping_ns_per_m", 1, "damping b is"),
        ("max_stiffness_n_per_m", 2, "stiffness k is"),
        ("max_contact_damping_ns_per_m", 3, "contact damping b_p is"),
    ],
)
def test_host_sends_nothing_above_any_one_limit(limit: str, column: int, words: str) -> None:
    """The largest gain of the table passes; the limit a little lower is named before a byte of the table travels."""
    made = coupling(9, largest=(80.0, 5e3, 60.0), wall=(1.0, 1e3))
    largest = float(np.float32(made.table.rows[:, column].max()))
    core = HostCore(host_library(), unwatched(**{limit: largest}))
    assert push(made, HostLink(core)).rows == 9
    core = HostCore(host_library(), unwatched(**{limit: 0.999 * largest}))
    with pytest.raises(LinkError, match=f"not sent: {words}") as caught:
        push(made, HostLink(core))
    assert str(caught.value).count("narrow") == 1
    assert core.image() is None
    # Of many rows above it the worst is named.
    core = HostCore(host_library(), unwatched(**{limit: 0.3 * largest}))
    with pytest.raises(LinkError, match=f"{words} {largest:.6g} "):
        push(made, HostLink(core))


def test_what_no_hand_could_hold_is_refused_before_a_port_is_opened() -> None:
    for verb in (avc_hardware.push, avc_hardware.stream):
        with pytest.raises(NotDeployableError, match=r"hands \(L5\): linearly unstable"):
            verb(coupling(5), "/dev/does-not-exist")
    with pytest.raises(NotDeployableError, match=r"hands \(L5\): linearly unstable"):
        avc_hardware.export_c(coupling(5))


def test_settings_of_the_coupling_come_with_it_and_those_of_the_device_stay() -> None:
    """Hold, slew and the guard's limit are sent and read back; a bound device keeps its limits for ever."""
    core = host_core()
    runtime = Runtime(hold_s=0.3, slew_per_s=None, guard="passivity-controller")
    found = push(coupling(5, runtime=runtime, damping_ns_per_m=1.5), HostLink(core)).device
    assert (found.figures.hold_s, found.figures.slew_per_s, found.figures.guard_damping_ns_per_m) == (0.3, None, 1.5)
    assert (found.bound, found.limits) == (True, unwatched())
    other = Config(unwatched(max_force_n=8.0), found.figures)
    connection = Connection(HostLink(core))
    for config, told in ((other.packed(), "of another device"), (other.packed()[:-1] + b"?", "the checksum")):
        with pytest.raises(LinkError, match=told):
            connection.run(connection.session.push(replace(image(5), config=config), connection.device))
        assert Connection(HostLink(core)).device.config_crc32 == found.config_crc32
    assert push(coupling(5), HostLink(core)).device.figures.hold_s == 0.2


def test_a_device_without_a_configuration_of_its_own_takes_any_that_is_sound() -> None:
    core = HostCore(host_library(), unwatched(), bound=False)
    made = coupling(5, sample_time_s=5e-4, encoder_resolution_m=1e-5, max_force_n=8.0)
    found = push(made, HostLink(core)).device
    assert (found.sample_time_s, found.metres_per_count, found.max_force_n) == (5e-4, 1e-5, 8.0)
    broken = Config(replace(found.limits, max_force_n=float("inf")), found.figures)
    with pytest.raises(RefusedError, match="the configuration is outside the device's limits"):
        Connection(HostLink(core)).configure(broken)
    Connection(HostLink(core)).configure(Config(unwatched(), RuntimeFigures()))
    assert core.state().has_table == 0
    assert (core.tick(np.full(20, 500, dtype=np.int32))[0] == 0).all()
