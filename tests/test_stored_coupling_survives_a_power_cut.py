"""A device keeps coupling, limits and name over a reset: the old or the new, whole, wherever the power is cut."""

import json

import numpy as np
import pytest
from hardware_bench import coupling, host_core, push, with_gains
from host_device import FLASH_SLOT, HostCore, HostFlash, HostLink
from hypothesis import given, settings
from hypothesis import strategies as st

from avc_casadi import InputError, LinkError, load_problem
from avc_casadi.cli import main
from avc_hardware import Connection, DeviceStatus, TableImage, set_limits, store
from avc_hardware.link import messages as m
from avc_hardware.link.faults import Reason
from avc_hardware.link.frames import Frame, encode
from avc_hardware.link.messages import Kind
from avc_hardware.link.session import RefusedError

WALL = with_gains(load_problem("damped"), 50.0, 2e4, 20.0)
OTHER = coupling(5, seed=3, largest=(300.0, 1e4, 50.0))


def status(core: HostCore) -> DeviceStatus:
    connection = Connection(HostLink(core))
    return connection.run(connection.session.ask(Kind.STATUS, b"", DeviceStatus))


def kept_of(core: HostCore) -> tuple[str, bool, str, float]:
    device = Connection(HostLink(core)).device
    return device.kept_coupling_id, device.kept_acts, device.name, device.lowered_force_n


def test_it_acts_after_a_reset_out_of_contact_alone_and_can_be_switched_off() -> None:
    core = host_core(flash=HostFlash())
    link = HostLink(core)
    push(WALL, link)
    set_limits(link, force_n=7.0)
    found = store(link, acts=True, name="prüfstand 3")
    assert (found.number, found.coupling_id, found.acts, found.name) == (1, WALL.id, True, "prüfstand 3")
    core.tick(np.full(20, -100, dtype=np.int32))
    assert core.state().mode == 0
    core.reset()
    assert not core.tick(np.full(300, 200, dtype=np.int32))[0].any()  # in the wall: nothing
    assert status(core).waits
    assert not core.tick(np.rint(np.linspace(200, -100, 60)).astype(np.int32))[0].any()
    assert core.image() == TableImage.of(WALL).image
    forces = core.tick(np.rint(np.linspace(-100, 1500, 200)).astype(np.int32))[0]
    assert forces.max() == 7.0
    core.tick(np.rint(np.linspace(1500, -100, 200)).astype(np.int32))
    assert not store(link, coupling=False).acts
    core.reset()
    core.tick(np.full(50, -100, dtype=np.int32))
    assert core.image() is None
    assert kept_of(core) == ("", False, "prüfstand 3", 7.0)
    push(WALL, link)
    assert store(link).coupling_id == WALL.id
    core.reset()
    core.tick(np.full(50, -100, dtype=np.int32))
    assert core.image() is None
    assert kept_of(core) == (WALL.id, False, "prüfstand 3", 7.0)


def test_the_power_may_be_cut_at_every_operation() -> None:
    """Of a store over another one, in either slot: each byte that is written, each part that is erased."""
    core = host_core(flash=HostFlash())
    link = HostLink(core)
    olds = [("", False, "", 50.0)]
    for made, name, force in ((WALL, "old", 7.0), (OTHER, "new", 9.0), (WALL, "newest", 5.0)):
        push(made, link)
        set_limits(link, force_n=force)
        assert core.flash is not None
        before, left = core.flash.memory.raw, core.flash.left.value
        store(link, acts=True, name=name)
        operations = left - core.flash.left.value
        assert operations == 16 + 4 * (4 + 10 + len(TableImage.of(made).image) // 4)
        olds.append((made.id, True, name, force))
        _, data = Connection(link).session.message(Kind.STORE, m.store(3, name))
        for cut in range(operations):
            cutting = host_core(flash=HostFlash(before))
            push(made, HostLink(cutting))
            set_limits(HostLink(cutting), force_n=force)
            assert cutting.flash is not None
            cutting.flash.left.value = cut
            cutting.write(data)
            cutting.tick(np.full(3, -100, dtype=np.int32))
            assert Frame(Kind.REFUSED, 0, b"").type in cutting.read()[:8]
            after = HostFlash(cutting.flash.memory.raw)
            cutting.free()
            booted = host_core(flash=after)
            device = Connection(HostLink(booted)).device
            now = (device.kept_coupling_id, device.kept_acts, device.name, device.lowered_force_n)
            assert now in olds[-2:]
            image = booted.image()
            assert image in (None, TableImage.of(WALL).image, TableImage.of(OTHER).image)
            booted.free()


@settings(max_examples=60, deadline=None)
@given(st.binary(max_size=400), st.integers(0, 2 * FLASH_SLOT - 1), st.integers(0, 255))
def test_no_content_of_the_memory_is_mistaken(noise: bytes, at: int, value: int) -> None:
    first = host_core(flash=HostFlash())
    push(WALL, HostLink(first))
    store(HostLink(first), acts=True, name="a")
    assert first.flash is not None
    content = bytearray(first.flash.memory.raw)
    content[at] = value
    content[at : at + len(noise)] = noise[: 2 * FLASH_SLOT - at]
    spoilt = host_core(flash=HostFlash(bytes(content)))
    assert kept_of(spoilt) in ((WALL.id, True, "a", 50.0), ("", False, "", 50.0))
    spoilt.tick(np.full(20, -100, dtype=np.int32))
    assert spoilt.image() in (None, TableImage.of(WALL).image)


def test_a_push_or_a_zero_takes_the_place_of_what_waits() -> None:
    core = host_core(flash=HostFlash())
    push(WALL, HostLink(core))
    store(HostLink(core), acts=True)
    core.reset()
    core.tick(np.full(5, 200, dtype=np.int32))
    push(OTHER, HostLink(core))
    assert core.image() == TableImage.of(OTHER).image
    core.reset()
    core.tick(np.full(5, 200, dtype=np.int32))
    connection = Connection(HostLink(core, position=lambda _: 200))
    connection.run(connection.session.ask(Kind.ZERO, b"", m.Zeroed))
    core.tick(np.full(50, 100, dtype=np.int32))
    assert core.image() is None


def test_a_device_in_contact_is_not_stored_and_gives_its_force_on() -> None:
    core, alone = host_core(flash=HostFlash()), host_core()
    for one in (core, alone):
        push(WALL, HostLink(one))
    way = np.rint(np.linspace(-100, 300, 60)).astype(np.int32)
    core.tick(way)
    link = HostLink(core, position=lambda _: 300)
    with pytest.raises(RefusedError, match="in contact") as caught:
        store(link)
    assert caught.value.refusal.reason is Reason.IN_CONTACT
    assert core.state().force_n > 5.0
    with pytest.raises(LinkError, match="no memory that lasts"):
        store(HostLink(alone))
    empty = host_core(flash=HostFlash())
    with pytest.raises(RefusedError, match="no table yet"):
        store(HostLink(empty))
    with pytest.raises(InputError, match="takes 17 bytes"):
        store(HostLink(empty), name="n" * 17)
    with pytest.raises(InputError, match="that is kept"):
        store(HostLink(empty), coupling=False, acts=True)
    assert store(HostLink(empty), coupling=False, name="n" * 16).name == "n" * 16
    core.write(encode(Frame(Kind.STORE, 5, m.store(4, ""))))
    assert bytes([Kind.REFUSED]) in core.read()


def test_the_command_stores_on_the_packaged_board_and_says_what_is_lacking(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["device", "--store", "--port", "emulator", "--json"]) != 0
    assert "no table yet" in json.loads(capsys.readouterr().out)["errors"][0]["message"]
    assert main(["device", "--store", "--port", "emulator", "--no-coupling", "--name", "bench", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["name"] == "bench"
