"""Every record of an excitation is that of its own tick: over a bad line, when read too late, and in the file."""

import dataclasses

import numpy as np
import pytest
from excited import Bench, device, planned
from faulty_link import FaultKind, FaultyLink, LinkFault
from hardware_bench import require
from hypothesis import given, settings
from hypothesis import strategies as st

from avc_casadi.identification.excitation.signal import FULL, Signal
from avc_casadi.identification.read import read_logs
from avc_hardware import Connection, excite
from avc_hardware.link import messages as m
from avc_hardware.link.messages import Kind

KINDS = (FaultKind.FLIP, FaultKind.DROP, FaultKind.DUPLICATE, FaultKind.INSERT, FaultKind.TRUNCATE, FaultKind.SPLIT)


@pytest.fixture(autouse=True)
def _tools():
    require("gcc")


def faded(plan):
    """The signal with its ramps, units, from what the README says of them."""
    near = np.minimum(np.arange(1, plan.ticks + 1), np.arange(plan.ticks, 0, -1))
    share = np.where(near < plan.ramp_ticks, near * 32768 // plan.ramp_ticks, 32768)
    units = plan.signal.units(plan.ticks)
    return np.clip(np.sign(units) * (np.abs(units) * share // 32768), -FULL, FULL)


@pytest.mark.thorough
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


@pytest.mark.thorough
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


def test_host_that_comes_too_late_sees_a_gap_and_no_shift():
    """The device keeps 4032 records; older ones are gone, and the rest keeps its ticks."""
    plan = dataclasses.replace(planned(), ticks=5000)
    bench = Bench(device())
    connection = Connection(bench.link)
    bench.play_unheard(connection, plan, 500)
    ask = connection.session.ask
    early = connection.run(ask(Kind.RECORDS, m.records(7, 0), m.Records))
    for _ in range(6):  # it says that it is there, and reads nothing
        bench.pass_by(800)
        connection.run(ask(Kind.RECORDS, m.records(7, 1 << 30), m.Records))
    bench.pass_by(500)
    late = connection.run(ask(Kind.RECORDS, m.records(7, len(early.counts)), m.Records))
    assert late.made == plan.ticks + 1
    assert late.first == late.made - 4032
    start = late.start_tick
    assert np.array_equal(late.counts, bench.counts[start + late.first : start + late.first + len(late.counts)])
    assert np.array_equal(early.counts, bench.counts[start : start + len(early.counts)])


def test_file_keeps_ticks_and_a_gap_cuts_the_record(tmp_path):
    log = Bench(device()).excite(planned())
    path = tmp_path / "log.csv"
    log.save(path)
    ((record,), told) = read_logs([path])
    assert not told
    assert record.sample_time_s == 1e-3
    assert np.allclose(record.position_m, log.position_m, rtol=0, atol=1e-12)
    assert np.allclose(record.force_n, log.force_n, rtol=1e-8)
    kept = np.r_[0:1000, 1040 : log.index.size]
    columns = {name: getattr(log, name)[kept] for name in ("index", "position_m", "force_n")}
    dataclasses.replace(log, **columns).save(path)
    records, told = read_logs([path])
    assert [record.position_m.size for record in records] == [1000, log.index.size - 1040]
    assert "1 gap in time" in told[0]
