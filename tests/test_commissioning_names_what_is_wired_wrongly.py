"""Wiring is checked before a coupling may push; limits at run time are never exceeded, nor raised with a kick."""

import json
from typing import Any

import numpy as np
import pytest
from excited import DECLARED, device, planned
from hardware_bench import host_core, host_library, image, push, require, with_gains
from host_device import HostCore, HostLink
from hypothesis import given, settings
from hypothesis import strategies as st

from avc_casadi import InputError, LinkError, load_problem
from avc_casadi.cli import main
from avc_casadi.model.device import Device
from avc_hardware import (
    BenchDevice,
    Connection,
    DeviceFault,
    DeviceStatus,
    Wiring,
    clear_faults,
    commission,
    excite,
    set_limits,
)
from avc_hardware.emulator.bench import WiredBench
from avc_hardware.link import messages as m
from avc_hardware.link.faults import Reason
from avc_hardware.link.messages import Kind
from avc_hardware.link.session import RefusedError

WALL = with_gains(load_problem("damped"), 50.0, 2e4, 20.0)
SLOW = Device(mass_kg=2.0, damping_ns_per_m=5.0, coulomb_friction_n=1.0, encoder_resolution_m=5e-5, max_force_n=12.0)


def bench(wiring: Wiring, declared: Device = DECLARED) -> HostLink:
    """A device on the core, wired so, with a hand that does what is asked."""
    wired = WiredBench(declared, wiring)
    core = HostCore(host_library(), wired.device.limits)
    return HostLink(core, position=lambda _: wired.count(), on_force=wired.hold)


FOUND = {
    Wiring.RIGHT: DeviceFault(0),
    Wiring.ENCODER_REVERSED: DeviceFault.ENCODER_REVERSED,
    Wiring.ENCODER_STUCK: DeviceFault.STUCK,
    Wiring.MOTOR_REVERSED: DeviceFault.MOTOR_REVERSED,
    Wiring.MOTOR_DEAD: DeviceFault.MOTOR_DEAD,
}


@pytest.mark.thorough
@pytest.mark.parametrize("wiring", Wiring)
@pytest.mark.parametrize(
    "declared", [DECLARED, pytest.param(SLOW, marks=pytest.mark.exhaustive)], ids=["light", "slow"]
)
def test_each_wiring_is_named_and_latched(wiring: Wiring, declared: Device) -> None:
    link = bench(wiring, declared)
    steps: list[str] = []
    forces: list[float] = []
    told, link._on_force = link._on_force, forces.append
    link._on_force = lambda force: (forces.append(force), told(force))[1]
    found = commission(declared, link, on_step=steps.append)
    assert found.found == FOUND[wiring]
    assert link.core.faults() == FOUND[wiring]
    assert np.abs(forces).max() <= found.pulse_n * (1 + 1e-6)
    pulsed = wiring not in {Wiring.ENCODER_STUCK, Wiring.ENCODER_REVERSED}
    assert bool(np.abs(forces).max() > 0) is pulsed
    assert len(steps) == (3 if pulsed else 1)
    json.dumps(found.document())
    if wiring is Wiring.RIGHT:
        status = Connection(link).run(Connection(link).session.ask(Kind.STATUS, b"", DeviceStatus))
        assert status.has_zero
        assert status.lowered_force_n == pytest.approx(declared.max_force_n / 10)
        assert 1e-4 < found.pulse_m < 1e-2
    elif wiring is not Wiring.ENCODER_STUCK:
        connection = Connection(link)
        with pytest.raises(RefusedError, match=f"{FOUND[wiring].word}.*avc device --clear") as caught:
            connection.run(connection.session.push(image(), connection.device))
        assert caught.value.refusal.reason is Reason.FAULT
        assert clear_faults(link).left == 0
        assert link.core.image() is None


@pytest.mark.thorough
def test_the_emulated_board_tells_the_same(capsys: pytest.CaptureFixture[str]) -> None:
    require("unicorn")
    assert main(["commission", "reference-r1", "--port", "emulator", "--on-bench", "motor-reversed"]) == 1
    told = capsys.readouterr()
    assert "motor reversed" in told.err
    assert "swap the motor's two wires" in told.err
    assert "3. hands off" in told.out
    assert main(["commission", "reference-r1", "--port", "/dev/none", "--on-bench", "motor-dead"]) == 2


@pytest.mark.thorough
def test_a_hand_that_does_nothing_or_too_little_is_told() -> None:
    core = HostCore(host_library())
    with pytest.raises(LinkError, match=r"moved by 1\.99 mm only in 30 s"):
        commission(DECLARED, HostLink(core, position=lambda tick: min(tick, 1000)))
    with pytest.raises(InputError, match="at most the device's 8 N"):
        commission(DECLARED, bench(Wiring.RIGHT), force_n=9.0)


@pytest.mark.thorough
@pytest.mark.parametrize("force_n", [1.25, 3.0])
@pytest.mark.parametrize("friction_n", [0.05, 0.5])
def test_a_pulse_little_above_the_friction_moves_the_device(force_n: float, friction_n: float) -> None:
    """Dry friction takes much of a weak pulse, which then lasts longer: no sound motor is taken for a dead one."""
    declared = Device(
        mass_kg=0.1, damping_ns_per_m=0.5, coulomb_friction_n=friction_n, encoder_resolution_m=5e-5, max_force_n=8.0
    )
    found = commission(declared, bench(Wiring.RIGHT, declared), force_n=force_n * friction_n)
    assert found.found == 0
    assert 3e-4 < found.pulse_m < 2e-3


@pytest.mark.thorough
def test_what_no_device_can_do_is_refused_before_it_is_touched(capsys: pytest.CaptureFixture[str]) -> None:
    asked = ["commission", "reference-r1", "--port", "/dev/absent", "--by-hand-m", "100", "--force-n", "0.24"]
    assert main(asked) == 2
    told = capsys.readouterr().err
    assert "--by-hand-m: 100 m; allowed: 20 counts of the encoder to 0.1 m" in told
    assert "--force-n: 0.24 N against a dry friction of 0.2 N; allowed: 0.25 N or more" in told
    uncertain = DECLARED.model_copy(update={"range": DECLARED.range.model_copy(update={"coulomb_friction_n": (0, 3)})})
    with pytest.raises(InputError, match=r"dry friction of 3 N; allowed: 3\.75 N"):
        commission(uncertain, "/dev/absent", force_n=3.0)
    link = bench(Wiring.RIGHT)
    with pytest.raises(InputError) as caught:
        commission(DECLARED, link, force_n=9.0, first_touch_n=10.0, by_hand_m=1e-5)
    assert [fault.key for fault in caught.value.faults] == ["force_n", "first_touch_n", "by_hand_m"]
    assert link.core.state().ticks < 1000
    stiff = DECLARED.model_copy(update={"coulomb_friction_n": 7.0})
    with pytest.raises(InputError, match=r"8 N against a dry friction of 7 N; allowed: 8\.75 N or more, as the device"):
        commission(stiff, bench(Wiring.RIGHT, stiff))


def test_zero_is_where_the_device_stands_and_ends_what_ran() -> None:
    core = host_core()
    push(WALL, HostLink(core))
    core.tick(np.full(50, -777, dtype=np.int32))
    connection = Connection(HostLink(core, position=lambda _: -777))
    connection.run(connection.session.ask(Kind.ZERO, b"", m.Zeroed))
    assert core.tick(np.array([-777, -776], dtype=np.int32))[0].tolist() == [0.0, 0.0]
    state = core.state()
    assert (state.encoder_count, state.has_table) == (1, 0)
    assert state.velocity_m_per_s == pytest.approx(2e-3)
    assert core.faults() == 0
    push(WALL, HostLink(core, position=lambda _: -800))
    way = np.rint(np.linspace(-800, -700, 40)).astype(np.int32)
    fresh = host_core()
    push(WALL, HostLink(fresh, position=lambda _: -23))
    assert core.tick(way)[0].tolist() == fresh.tick(way + 777)[0].tolist()
    assert core.state().force_n > 0
    with pytest.raises(RefusedError, match="in contact"):
        connection.run(connection.session.ask(Kind.ZERO, b"", m.Zeroed))


@pytest.mark.thorough
@settings(max_examples=25, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.integers(1, 1600).map(lambda part: part / 32),
            st.integers(1, 120),
            st.floats(0.2, 8.0),
            st.floats(-400.0, 800.0),
        ),
        min_size=1,
        max_size=8,
    )
)
def test_no_tick_exceeds_the_limit_and_no_raise_is_a_kick(plan: list[tuple[float, int, float, float]]) -> None:
    """Random limits at random moments of random motion, beside a device without them."""
    limited, free = host_core(), host_core()
    for core in (limited, free):
        push(WALL, HostLink(core))
    connection = Connection(HostLink(limited))
    connection.session.timeout_s = 1e-3
    free.tick(np.full(limited.state().ticks - free.state().ticks, -100, dtype=np.int32))
    tick = 0
    in_force = 50.0
    for wanted, ticks, rate, swing in plan:
        _, data = connection.session.message(Kind.LIMITS, m.limits(wanted, 3.0, 0.2))
        limited.write(data)
        limited.read()
        for _ in range(ticks):
            place = np.array([round(swing * np.sin(rate * 0.02 * tick)) - 100], dtype=np.int32)
            place = np.clip(place, *(limited.state().encoder_count + np.array([-400, 400])))
            contact = limited.state().contact or limited.state().position_m > 0
            force, unlimited = float(limited.tick(place)[0][0]), float(free.tick(place)[0][0])
            if wanted <= in_force or not contact:
                in_force = wanted
            assert abs(force) <= in_force * (1 + 1e-6)
            assert force == pytest.approx(float(np.clip(unlimited, -in_force, in_force)), rel=1e-6)
            tick += 1


def test_limits_are_told_kept_and_never_above_the_boards() -> None:
    core = HostCore(host_library())
    link = HostLink(core)
    found = set_limits(link, force_n=2.0, speed_m_per_s=0.1)
    assert (found.hold.force_n, found.hold.speed_m_per_s, found.hold.energy_j) == (2.0, 0.1, 0.2)
    assert (found.boards.force_n, found.waits) == (50.0, False)
    told = Connection(link).device
    assert (told.lowered_force_n, told.lowered_speed_m_per_s, told.max_force_n) == (2.0, 0.1, 50.0)
    pushed = push(WALL, link)
    assert pushed.max_force_n == 2.0
    assert any("limited to 2 N at run time" in note for note in pushed.notes)
    core.tick(np.arange(-100, 0, 60, dtype=np.int32))  # 0.12 m/s, and a count or two
    core.tick(np.arange(0, 600, 60, dtype=np.int32))
    assert core.faults() == DeviceFault.SPEED
    with pytest.raises(InputError, match=r"force_n.*50.*\n?.*energy_j") as caught:
        set_limits(link, force_n=51.0, energy_j=0.3)
    assert len(caught.value.faults) == 2
    assert set_limits(link, built_in=True).hold == found.boards
    connection = Connection(link)
    for wrong in ((51.0, 0.0, 0.0), (float("nan"), 0.0, 0.0), (1.0, -1.0, 0.0), (1.0, 0.0, float("inf"))):
        answer: Any = connection.run(connection.session.request(Kind.LIMITS, m.limits(*wrong)))
        assert str(answer) == "a limit is outside the device's limits"
    for codes in (0, int(DeviceFault.JUMP), int(DeviceFault.MOTOR_DEAD | DeviceFault.HEARTBEAT)):
        answer = connection.run(connection.session.request(Kind.LATCH, m.latch(codes)))
        assert answer.reason is Reason.MESSAGE
    core.reset()
    assert Connection(link).device.lowered_force_n == 50.0


def test_a_higher_force_waits_for_the_device_to_be_let_go(capsys: pytest.CaptureFixture[str]) -> None:
    core = host_core()
    push(WALL, HostLink(core))
    set_limits(HostLink(core, position=lambda _: -100), force_n=1.0)
    way = np.rint(np.linspace(-100, 300, 60)).astype(np.int32)
    assert core.tick(way)[0].max() == 1.0
    found = set_limits(HostLink(core, position=lambda _: 300), force_n=20.0)
    assert (found.hold.force_n, found.asked.force_n, found.waits) == (1.0, 20.0, True)
    core.tick(way[::-1].copy())
    assert core.tick(way)[0].max() > 5.0
    require("unicorn")
    assert main(["device", "--port", "emulator", "--force-n", "3"]) == 0
    assert "3.00 N of 50.0 N built in" in capsys.readouterr().out


@pytest.mark.thorough
def test_an_excitation_keeps_the_lowered_force() -> None:

    there = BenchDevice(device())
    core = HostCore(host_library(), there.limits)
    link = HostLink(core, position=lambda _: there.count(), on_force=there.hold)
    plan = planned(force_n=2.0)
    set_limits(link, force_n=1.0)
    with pytest.raises(LinkError, match="the plan of the excitation is outside"):
        excite(plan, link)
    set_limits(link, force_n=2.0)
    assert excite(plan, link).whole


def test_a_push_for_a_device_refuses_another() -> None:
    core = host_core()
    with pytest.raises(LinkError, match="no number of its own and no name"):
        push(WALL, HostLink(core), device_id="0102030405060708090a0b0c")
    core.name_chip(bytes(range(1, 13)))
    with pytest.raises(LinkError, match="this is device 0102030405060708090a0b0c, not ff"):
        push(WALL, HostLink(core), device_id="ff")
    assert core.image() is None
    assert push(WALL, HostLink(core), device_id="0102030405060708090A0B0C").readback_equal
