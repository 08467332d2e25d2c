"""State feedback in the firmware: the bits of the exported C, one start after every table, a meaning in every mode."""

import dataclasses

import numpy as np
import pytest
from hardware_bench import believer, bench_problem, dense_believer, host_library, push, unwatched
from host_device import HostCore, HostLink
from numpy.typing import NDArray
from reference_coupling import ReferenceCoupling
from reference_device import ReferenceFeedback

from avc_casadi.coupling import Coupling
from avc_casadi.model.gains import Gains
from avc_casadi.model.runtime import Runtime, StateFeedback
from avc_hardware import DeviceFault, TableImage
from avc_hardware.link import messages as m
from avc_hardware.link.messages import Kind
from avc_hardware.link.session import Session

Counts = NDArray[np.int32]
Forces = NDArray[np.float32]

STEP_M = 2e-6
LIMIT_N = 4.0
TICKS = 1200
# Counts: before the wall.
OUTSIDE = -400
# Ticks from there to where a motion begins.
APPROACH = 60
FEEDBACKS = [believer(0), *(dense_believer(states, 1) for states in (1, 5, 16))]


SPRING = Gains(0.0, 2.0**16)


def made(feedback: StateFeedback | None, gains: Gains = SPRING, wall: tuple[float, float] = (0.0, 2.0**15)) -> Coupling:
    problem = bench_problem(wall, encoder_resolution_m=STEP_M, max_force_n=LIMIT_N)
    return Coupling.constant(problem, gains, "by hand", Runtime(state_feedback=feedback))


def motions() -> Counts:
    """A stroke through the wall's face, taps that grow faster, noise about the face, a press, rest; (5, TICKS).

    Each begins out of the wall, where a table takes over, and comes from there as a hand does.
    """
    time = np.arange(TICKS) * 1e-3
    metres = [
        6e-4 * np.sin(2 * np.pi * 2 * time),
        3e-4 * np.sin(2 * np.pi * (2 + 25 * time) * time),
        STEP_M * np.random.default_rng(4).integers(-3, 4, TICKS),
        np.minimum(4e-3 * time - 1e-3, 3e-4),
        np.zeros(TICKS),
    ]
    counts = np.rint(np.array(metres) / STEP_M).astype(np.int32)
    ease = 0.5 - 0.5 * np.cos(np.pi * np.arange(APPROACH) / APPROACH)
    approach = np.rint(OUTSIDE + ease * (counts[:, :1] - OUTSIDE)).astype(np.int32)
    return np.concatenate([approach, counts[:, :-APPROACH]], axis=1)


def core_with(coupling: Coupling, *, safe: Gains | None = None) -> HostCore:
    """A device at rest before its wall that is given a coupling."""
    core = HostCore(host_library(), unwatched(max_force_n=LIMIT_N))
    push(coupling, HostLink(core, position=lambda _: OUTSIDE), safe=safe)
    return core


def forces(coupling: Coupling, way: Counts) -> Forces:
    """The table comes into force with the first tick of the motion; the device has been at rest there."""
    core = HostCore(host_library(), unwatched(max_force_n=LIMIT_N))
    core.tick(way[:1])
    give(core, coupling)
    return core.tick(way)[0]


def give(core: HostCore, coupling: Coupling) -> None:
    """Bring a device to where only a tick out of contact is missing."""
    session, table = Session(1, timeout_s=1.0), TableImage.of(coupling)
    name = table.table_id
    for kind, payload in (
        (Kind.BEGIN, m.begin(1, name, table.crc32, 1, table.states)),
        *((Kind.CHUNK, m.words(1, name, at) + table.image[at : at + 512]) for at in range(0, len(table.image), 512)),
        (Kind.COMMIT, m.words(1, name, table.crc32)),
    ):
        core.write(session.message(kind, payload)[1])


def exported(coupling: Coupling, ways: Counts) -> Forces:
    devices = ReferenceCoupling(coupling, len(ways))
    return np.stack([devices.step(column) for column in (ways.astype(np.float32) * np.float32(STEP_M)).T], axis=1)


@pytest.mark.slow
@pytest.mark.parametrize("feedback", FEEDBACKS, ids=lambda found: f"{found.states} states")
@pytest.mark.parametrize(("guard", "contact"), [(None, "clip-last"), ("passivity-controller", "gated")])
def test_firmware_gives_the_bits_of_the_exported_coupling(
    feedback: StateFeedback, guard: str | None, contact: str
) -> None:
    """The export leaves out what is 0 in the matrices, the firmware multiplies by it: no bit of a force tells.

    Where the export would make one constant of two, as of a single weight and the stiffness, the last bit may differ.
    """
    coupling = made(feedback, Gains(0.0, 2.0**16, 20.0))
    coupling = dataclasses.replace(
        coupling,
        problem=coupling.problem.changed(coupling={"contact": contact}),
        runtime=coupling.runtime.model_copy(update={"guard": guard}),
    )
    ways = motions()
    expected = exported(coupling, ways)
    for way, force in zip(ways, expected, strict=True):
        assert forces(coupling, way).tobytes() == force.tobytes()
    assert expected.max() == LIMIT_N
    assert np.isfinite(expected).all()


def test_streamed_gains_keep_the_feedback_of_the_table() -> None:
    """Every force is that of the streamed spring in series with the wall, at the position that the observer makes of
    the measured one and of the force before."""
    feedback, stiffness, wall = believer(3), 4e3, 2.0**15
    way = motions()[3]
    coupling = made(feedback)
    core = core_with(coupling)
    session = Session(1, timeout_s=1.0)
    payload = m.set_gains(int(coupling.id, 16), 0, 5000, 0.0, stiffness, 0.0)
    core.write(session.message(Kind.SET_GAINS, payload)[1])
    # The gains slew to those streamed within 0.2 s, all outside the wall.
    found, _ = core.tick(way)
    assert core.state().streaming
    assert core.state().stiffness_n_per_m == pytest.approx(stiffness)
    observer = ReferenceFeedback(feedback, 1)
    before = np.zeros(1, np.float32)
    observer(np.array([OUTSIDE], np.float32) * np.float32(STEP_M), before)
    series = stiffness * wall / (stiffness + wall)
    for count, force in zip(way, found, strict=True):
        seen = observer(np.array([count], np.float32) * np.float32(STEP_M), before)
        assert force == pytest.approx(max(0.0, series * float(seen[0])), rel=1e-3, abs=1e-3)
        before = np.array([force])
    assert found.max() > 0.5


def test_observer_that_runs_away_ends_in_a_fault() -> None:
    """Finite matrices may end beyond single precision: the force is never infinite, and falls."""
    row = dict.fromkeys(("force_m_per_n", "feedback"), (1.0,))
    doubling = StateFeedback.model_construct(state=((3e37,),), innovation=(0.0,), positions=(0,), **row)
    core = core_with(made(doubling))
    force, _ = core.tick(np.full(50, 100, dtype=np.int32))
    assert core.faults() == DeviceFault.NOT_FINITE
    assert np.isfinite(force).all()
    assert np.abs(force).max() <= LIMIT_N
    assert (force[-25:] == 0).all()
