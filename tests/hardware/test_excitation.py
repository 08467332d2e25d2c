"""Force, speed and travel: the device itself stops at a limit, without its host, and pushes no more."""

import dataclasses

import numpy as np
import pytest
from excited import DECLARED, Bench, device, first_broken, half_sines, planned
from faulty_link import FaultKind, FaultyLink, LinkFault
from hardware_bench import coupling, push, require
from hypothesis import given, settings
from hypothesis import strategies as st
from quick import first

from avc_casadi.identification.excitation import plan_excitation
from avc_casadi.identification.read import read_logs
from avc_casadi.identification.signal import FULL, Signal
from avc_hardware import BenchDevice, Connection, RefusedError, excite
from avc_hardware.link import messages as m
from avc_hardware.link.excite import plan_bytes
from avc_hardware.link.faults import RefusalReason
from avc_hardware.link.messages import Kind
from avc_hardware.link.session import LinkError


@pytest.fixture(autouse=True)
def _tools():
    require("gcc")


@pytest.mark.slow
@settings(max_examples=18, deadline=None)
@given(
    kind=st.sampled_from(["multisine", "chirp"]),
    mass=st.floats(0.004, 0.3),
    damping=st.just(0.0) | st.floats(1e-3, 3.0),
    friction=st.sampled_from([0.0, 0.05, 0.3]),
    delay=st.integers(0, 6) | st.floats(0.01, 6.0),
)
def test_no_force_from_the_tick_at_which_a_limit_is_exceeded(kind, mass, damping, friction, delay):
    """Devices drawn at random, up to 17 times lighter than the lightest declared."""
    plan = planned(kind)
    bench = Bench(device(mass_kg=mass, damping_ns_per_m=damping, coulomb_friction_n=friction, delay_samples=delay))
    log = bench.excite(plan)
    start = log.start_tick
    force = np.array(bench.force_n[start:])
    assert np.abs(force).max() <= plan.max_force_n * (1 + 1e-6)
    broken = first_broken(plan, bench.counts, start)
    end = plan.ticks if broken is None or broken >= plan.ticks else broken
    assert log.whole == (end == plan.ticks)
    assert log.index.size == end + 1
    assert not force[end:].any()
    speed = np.abs(bench.device.speed_m_per_s[start : start + end + 1]).max()
    late = plan.window + delay + 2
    allowed = plan.max_speed_m_per_s + plan.metres_per_count / plan.sample_time_s
    assert speed <= allowed + late * plan.sample_time_s * plan.max_force_n / mass


@given(mass=st.floats(0.01, 1.0), delay=st.integers(0, 5) | st.floats(0.001, 5.0), force=st.floats(-8.0, 8.0))
def test_a_force_on_the_bench_moves_the_device_after_its_delay(mass, delay, force):
    """Without friction and damping the speed is the impulse that has arrived, over the mass; +x is against it."""
    bench = BenchDevice(device(mass_kg=mass, damping_ns_per_m=0.0, coulomb_friction_n=0.0, delay_samples=delay))
    for _ in range(9):
        bench.hold(force)
        bench.count()
    arrived_s = 1e-3 * np.maximum(np.arange(1, 10) - delay, 0.0)
    np.testing.assert_allclose(bench.speed_m_per_s, -force * arrived_s / mass, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("share", first([1.01, 1.5, 1.99]))
def test_a_plan_of_more_force_than_the_device_gives_is_not_sent(share):
    """The host itself refuses it: the device is not asked."""
    bench = Bench(device())
    with pytest.raises(LinkError) as caught:
        bench.excite(half_sines(0.5, ticks=1000, max_force_n=8.0 * share))
    assert not isinstance(caught.value, RefusedError)
    bench.pass_by(50)
    assert not np.any(bench.force_n)


@pytest.mark.slow
def test_silent_host_stops_it_within_a_second():
    plan = planned()
    bench = Bench(device())
    connection = Connection(bench.link)
    began = len(bench.force_n)
    bench.play_unheard(connection, plan, 1500)
    force = np.array(bench.force_n[began:])
    assert np.abs(force[500:1000]).max() > 0.5
    assert not force[plan.silent_ticks + 1 :].any()
    part = connection.run(connection.session.ask(Kind.RECORDS, m.words(7, 0), m.Records))
    assert part.state == 4
    assert part.made == plan.silent_ticks + 1


@pytest.mark.slow
def test_stop_takes_the_force_away_at_the_next_tick():
    bench = Bench(device())
    connection = Connection(bench.link)
    bench.play_unheard(connection, planned(), 700)
    assert bench.force_n[-1] != 0
    connection.run(connection.session.ask(Kind.STOP, m.words(7), m.Acknowledged))
    stopped = len(bench.force_n)
    bench.pass_by(1500)
    assert not np.any(bench.force_n[stopped:])


@pytest.mark.slow
def test_no_coupling_runs_beside_or_after_it_until_one_is_pushed():
    bench = Bench(device(encoder_resolution_m=2e-6))
    plan = dataclasses.replace(planned(), metres_per_count=2e-6)
    made = coupling(5, encoder_resolution_m=2e-6)
    push(made, bench.link)
    assert bench.core.state().has_table
    connection = Connection(bench.link)
    bench.play_unheard(connection, plan, 200)
    assert not bench.core.state().has_table
    with pytest.raises(RefusedError) as caught:
        push(made, bench.link)
    assert caught.value.refusal.reason is RefusalReason.EXCITED
    bench.pass_by(2000)
    assert bench.force_n[-1] == 0
    assert not bench.core.state().has_table
    bench.device.plant.place(-1e-3)
    push(made, bench.link)
    assert bench.core.state().has_table


@pytest.mark.slow
@pytest.mark.parametrize(
    "wrong",
    [
        {"max_force_n": 9.0},
        {"max_force_n": float("nan")},
        {"max_speed_m_per_s": 0.0},
        {"max_travel_m": float("inf")},
        {"spring_n_per_m": -1.0},
        {"window": 33},
        {"ramp_ticks": 0},
        {"ticks": 100},
    ],
    ids=str,
)
def test_device_refuses_a_plan_without_limits(wrong):
    bench = Bench(device())
    connection = Connection(bench.link)
    plan = dataclasses.replace(planned(), **wrong)
    with pytest.raises(RefusedError, match="plan of the excitation"):
        connection.run(connection.session.ask(Kind.EXCITE, plan_bytes(plan, 1), m.Acknowledged))
    bench.pass_by(50)
    assert not np.any(bench.force_n)


# Every record of an excitation is that of its own tick: over a bad line, when read too late, and in the file.

KINDS = (FaultKind.FLIP, FaultKind.DROP, FaultKind.DUPLICATE, FaultKind.INSERT, FaultKind.TRUNCATE, FaultKind.SPLIT)


def faded(plan):
    """The signal with its ramps, units, from what the README says of them."""
    near = np.minimum(np.arange(1, plan.ticks + 1), np.arange(plan.ticks, 0, -1))
    share = np.where(near < plan.ramp_ticks, near * 32768 // plan.ramp_ticks, 32768)
    units = plan.signal.units(plan.ticks)
    return np.clip(np.sign(units) * (np.abs(units) * share // 32768), -FULL, FULL)


@pytest.mark.slow
@settings(max_examples=12, deadline=None)
@given(
    tones=st.lists(
        st.tuples(st.floats(0.0, 450.0), st.floats(-0.9, 0.9), st.floats(0.0, 6.28)), min_size=1, max_size=64
    ),
    growth=st.sampled_from([0.0, 1e-4, 9e-4]),
    seed=st.integers(0, 1000),
)
def test_signal_of_the_device_is_that_of_the_plan_in_every_bit(tones, growth, seed):
    knots = np.random.default_rng(seed).uniform(0, 1, 33)
    signal = Signal.of(*np.array(tones).T, 1e-3, growth_per_tick=growth, knots=knots)
    plan = dataclasses.replace(planned(), signal=signal, spring_n_per_m=0.0, damper_ns_per_m=0.0, ticks=1500)
    heavy = Bench(device(mass_kg=1000.0))
    log = heavy.excite(plan)
    unit = float(np.float32(plan.max_force_n)) / FULL
    came = np.round(log.force_n / unit).astype(int)
    # A force that lasts beside no motion is that of a stuck encoder, which ends the log.
    assert log.whole or ("latched a fault" in log.end and len(came) > 100)
    assert np.array_equal(came, [*faded(plan), 0][: len(came)])


def test_sines_of_the_device_are_sines():
    ticks = np.arange(4000)
    signal = Signal.of([3.0, 77.0], [0.5, 0.25], [0.3, 2.0], 1e-3)
    true = 0.5 * np.sin(2 * np.pi * 3e-3 * ticks + 0.3) + 0.25 * np.sin(2 * np.pi * 77e-3 * ticks + 2.0)
    assert np.abs(signal.units(4000) / FULL - true).max() < 2e-4
    chirp = Signal.of([1.0], [1.0], [0.0], 1e-3, growth_per_tick=1e-3)
    phase = 2 * np.pi * 1e-3 * (1.001**ticks - 1) / 1e-3
    assert np.abs(chirp.units(4000) / FULL - np.sin(phase)).max() < 1e-3


@pytest.mark.slow
@settings(max_examples=15, deadline=None)
@given(
    st.lists(st.tuples(st.booleans(), st.integers(700, 9000), st.sampled_from(KINDS), st.integers(1, 40)), max_size=6)
)
def test_bad_line_changes_no_record(faults):
    """Bytes flipped, lost, doubled: what is told is what the encoder showed at that tick, or nothing is told."""
    bench = Bench(device())
    spoilt = [LinkFault(to, at, kind, amount) for to, at, kind, amount in faults]
    log = excite(planned(), FaultyLink(bench.link, spoilt))
    places = log.start_tick + log.index
    assert np.array_equal(np.diff(log.index), np.ones(log.index.size - 1))
    assert log.lost == 0
    assert np.array_equal(np.round(log.position_m / 2e-5), np.array(bench.counts)[places])
    assert np.allclose(log.force_n, np.array(bench.force_n)[places], rtol=1e-6, atol=1e-7)
    assert log.whole or log.end.startswith("stopped: the device did not hear")


@pytest.mark.slow
def test_file_keeps_ticks_and_a_gap_cuts_the_record(tmp_path):
    log = Bench(device()).excite(planned())
    path = tmp_path / "log.csv"
    path.write_text(log.csv())
    ((record,), told) = read_logs([path])
    assert not told
    assert record.sample_time_s == 1e-3
    assert np.allclose(record.position_m, log.position_m, rtol=0, atol=1e-12)
    assert np.allclose(record.force_n, log.force_n, rtol=1e-8)
    kept = np.r_[0:1000, 1040 : log.index.size]
    columns = {name: getattr(log, name)[kept] for name in ("index", "position_m", "force_n")}
    path.write_text(dataclasses.replace(log, **columns).csv())
    records, told = read_logs([path])
    assert [record.position_m.size for record in records] == [1000, log.index.size - 1040]
    assert "1 gap in time" in told[0]


@pytest.mark.slow
@pytest.mark.parametrize("limits", [{"force_n": 0.8}, {"speed_m_per_s": 0.1}, {"travel_m": 0.0012}], ids=str)
def test_every_limit_is_kept_by_the_plan(limits):
    made = plan_excitation(DECLARED, seconds=2.0, **limits)
    (key, most), reached = *limits.items(), made.forecast
    assert getattr(reached, key).max() <= most
    assert made.nearest_limit == key
    assert made.plan.peak_force_n > 0.24
