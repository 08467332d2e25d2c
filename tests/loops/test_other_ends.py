"""Each part of a coupling to an engine or a second device against integrators, clocks and loops written out."""

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.loops.engine import Engine, clocks
from avc_casadi.loops.follower import Link, Touch, link_clocks
from avc_casadi.loops.loop import Body
from avc_casadi.model.hands import Hand
from avc_casadi.model.sampled_plant import sampled_plant
from avc_casadi.model.virtual_tool import RIGID_N_PER_M, ToolGains, ToolState, VirtualTool, tool_states
from avc_casadi.recommendation import tool_impedance as _impedance

T = 1e-3
DEVICE = "[device]\nmass_kg = 0.12\ndamping_ns_per_m = 0.8\ndelay_samples = 1\n"


def problem(simulation, device=DEVICE, table="simulation"):
    return avc.parse_problem(f"{device}[{table}]\n{simulation}")


def engine(**keys):
    return VirtualTool.model_validate({"tool_mass_kg": 0.2, "step_s": 4e-3} | keys)


@pytest.mark.parametrize("ratio", [2.5, 1.5, 0.5, 10 / 3])
def test_every_phase_of_two_clocks_is_one_of_the_patterns(ratio):
    """Samples between two steps of the engine, and whether a step falls on one: counted for phases drawn at random."""

    def turned(pattern):
        pairs = list(zip(*pattern, strict=True))
        return min(tuple(pairs[at:] + pairs[:at]) for at in range(len(pairs)))

    found = {turned((one.samples, one.aged)) for one in clocks(ratio * T, T)}
    random, steps = np.random.default_rng(2), 12
    for phase in (0.0, *random.uniform(0, 1, 30)):
        times = phase + ratio * np.arange(steps * 6 + 1)
        first = np.ceil(times - 1e-9)
        aged = tuple(bool(one) for one in np.abs(times - np.round(times)) > 1e-9)
        period = next(n for n in range(1, 9) if abs(n * ratio - round(n * ratio)) < 1e-9)
        counts = tuple(int(one) for one in np.diff(first))[:period]
        assert turned((counts, aged[:period])) in found


INTEGRATORS = {
    "semi-implicit": lambda m, c, k, t: np.array(
        [[1 - t**2 * k / m, t * (1 - t * c / m)], [-t * k / m, 1 - t * c / m]]
    ),
    "explicit": lambda m, c, k, t: np.array([[1, t], [-t * k / m, 1 - t * c / m]]),
    "implicit": lambda m, c, k, t: np.linalg.inv([[1, -t], [t * k / m, 1 + t * c / m]]),
}


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_a_tool_in_contact_moves_as_its_integrator_has_it(integrator):
    tool, step_s = ToolState(0.2, 0.7, 900.0, 5.0), 4e-3
    loop = Engine(Body.driven(T), clocks(step_s, T)[0], engine(integrator=integrator), [tool])
    np.testing.assert_allclose(loop.alone()[0], INTEGRATORS[integrator](0.2, 5.7, 900.0, step_s), rtol=1e-9)


@pytest.mark.parametrize("ratio", [1.0, 4.0, 2.5])
def test_a_tool_that_stands_still_is_a_spring_and_a_damper(ratio):
    rigid = tool_states(engine(), RIGID_N_PER_M)[-1]
    loop = Engine(Body.driven(T), clocks(ratio * T, T)[-1], engine(), [rigid])
    turn = np.exp(-2j * np.pi * 12.0 * T)
    found = loop.force_per_metre(ToolGains(800.0, 6.0, 2.0), 12.0)
    assert found == pytest.approx(800.0 + 8.0 * (1 - turn) / T)


@pytest.mark.parametrize(("sooner", "later"), [("ahead", "on-time"), ("on-time", "late")])
def test_an_exchange_hands_out_a_tool_one_step_before_the_next(sooner, later):
    """Of a free tool on a soft coupling: its position lags by a step more."""
    free, gains, hz = tool_states(engine(), 0.0)[-1], ToolGains(300.0, 4.0), 10.0
    clock = clocks(4e-3, T)[0]
    before, after = (
        Engine(Body.driven(T), clock, engine(exchange=one), [free]).force_per_metre(gains, hz)
        for one in (sooner, later)
    )
    spring = gains.stiffness_n_per_m + gains.damping_ns_per_m * 2j * np.pi * hz
    turned = np.angle((spring - before) / (spring - after))
    assert turned == pytest.approx(2 * np.pi * hz * 4e-3, rel=0.2)


@pytest.mark.parametrize("late", [0, 4])
def test_a_late_force_of_a_spring_takes_the_drag_that_its_delay_makes_of_it(late):
    """K at the angle omega (d + 1/2) T: a damper of -K (d + 1/2) T."""
    stiffness, hz = 400.0, 1.0
    device = problem(
        "tool_mass_kg = 0.2\nstep_s = 0.004", device=DEVICE.replace("samples = 1", f"samples = {late}")
    ).device
    found = _impedance._felt(device, ToolGains(stiffness, 0.0), hz, (0.0, 0.0), stiffness, stiffness)
    assert found.drag_ns_per_m == pytest.approx(0.8 - stiffness * (late + 0.5) * T, rel=0.01)
    assert found.stiffness_n_per_m == pytest.approx(stiffness, rel=0.01)


def test_what_arrives_over_a_link_is_the_newest_that_had_the_time():
    """At each sample: how many of the sender's samples lie between its newest and the one that has arrived."""
    there, back = 2.5, 1.2
    for clock in link_clocks(T, T, there * T, back * T)[:1]:
        assert clock.follower_sees == (3,)
        assert clock.leader_sees == (2,)
    assert len(link_clocks(T, T, 0.6 * T, 0.6 * T)) > 1
    assert [one.events for one in link_clocks(T, 2 * T, 0.0, 0.0)[:1]] == [((True, True), (True, False))]


def pair(architecture, force, stiffness, damping, ratio=1.0):
    """A leader that is led, and a follower of another sample time before a spring and a damper."""
    follower = problem(
        f"mass_kg = 0.3\ndamping_ns_per_m = 1.0\nsample_time_s = {ratio * T!r}", table="follower"
    ).follower
    touched = Hand(np.zeros(1), np.array([damping]), np.array([stiffness]))
    plant = sampled_plant(follower.at_leader(), touched)
    clock = link_clocks(T, ratio * T, 0.0, 0.0)[-1]
    ends = np.array([stiffness]), np.array([damping])
    sent = follower.model_copy(update={"architecture": architecture, "force": force})
    return Link(Body.driven(T), Touch.of(plant, *ends).axes(0), clock, sent)


def test_what_a_follower_measures_is_the_spring_and_the_damper_that_it_touches():
    gains, s = ToolGains(3000.0, 30.0), 2j * np.pi * 0.5
    loop = pair("position-force", "measured", 500.0, 40.0)
    touched, coupled = 500.0 + 40.0 * s, 3000.0 + 30.0 * s
    # The follower between what it touches and the leader, its mass and drag beside them.
    moved = coupled / (coupled + touched + 0.3 * s**2 + 1.0 * s)
    found = loop.force_per_metre(gains, 0.5)
    assert found.real == pytest.approx((touched * moved).real, rel=0.02)
    assert found.imag == pytest.approx((touched * moved).imag, rel=0.1)


def test_two_ends_that_move_evenly_side_by_side_pull_nothing_whatever_their_clocks():
    loop = pair("position-position", "commanded", 0.0, 0.0, ratio=2.0)
    # What each end has sent, the newest first: all of it at 1 m/s, and both at 0 now.
    sizes = {name: len(loop.loop[name]) for name in ("sent0", "sent1")}
    periods = {"sent0": T, "sent1": 2 * T}
    state = loop.loop.vector(**{name: -periods[name] * np.arange(size) for name, size in sizes.items()})
    for row in loop.pulls(ToolGains(1000.0, 50.0), (0, 0)):
        assert row @ state == pytest.approx(0.0, abs=1e-9)
