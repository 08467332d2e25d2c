"""The lifted loop of a device and an engine's tool: against a plain simulation, and a published table of limits."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from engine_simulator import EngineSimulator
from hypothesis import given, settings
from hypothesis import strategies as st
from quick import first
from scipy.linalg import expm

import avc_casadi as avc
from avc_casadi.design.virtual_tool import CouplingSearch, Scale, ToolSearch
from avc_casadi.loops.engine import EngineLoop, ToolLoops, clock_ranges, clocks
from avc_casadi.loops.loop import Body
from avc_casadi.model.ends import RIGID_N_PER_M, Simulation, ToolGains, tool_states

DEVICE = "[device]\nmass_kg = 0.12\ndamping_ns_per_m = 0.8\ndelay_samples = 1\n"


def problem(simulation, device=DEVICE, hands=""):
    return avc.parse_problem(f"{device}[simulation]\n{simulation}\n{hands}")


def largest_root(simulator, gains, samples):
    """Return the largest root a step: from device and tool over some samples and those before, the next follow."""
    known = []
    for start, kick in ((0.0, 1e-3), (1e-3, 0.0)):
        k, b, local = [*vars(gains).values()][:3]
        simulator.motor = gains.motors[0]
        both = np.array(simulator.run(k, b, 30 * samples, local=local, start=start, kick=kick, force=np.inf))
        spans = both.reshape(2, 30, samples).transpose(1, 0, 2).reshape(30, -1)
        known.append(np.stack([spans[:-2], spans[1:-1], spans[2:]]) / np.abs(spans[:-2]).max(axis=1, keepdims=True))
    before, last, after = np.concatenate(known, axis=1)
    over = np.linalg.lstsq(np.hstack([before, last]), np.hstack([last, after]), rcond=1e-12)[0]
    return np.abs(np.linalg.eigvals(over)).max() ** (simulator.step_s / (samples * simulator.T))


@pytest.mark.slow
@settings(max_examples=8, deadline=None)
@given(
    mass=st.floats(0.02, 2.0),
    ratio=st.sampled_from([1, 2, 3, 5, 16, 2.5, 4 / 3]),
    integrator=st.sampled_from(["semi-implicit", "explicit", "exact", "implicit-damping", "implicit"]),
    substeps=st.sampled_from([1, 2, 5]),
    exchange=st.sampled_from(["on-time", "late", "ahead", "held-force"]),
    late=st.integers(0, 2),
    gains=st.builds(ToolGains, st.just(0.0) | st.floats(50.0, 2e4), st.floats(0.0, 100.0), st.sampled_from([0.0, 5.0])),
    motor=st.sampled_from([1.0, 1.22]),
    clock=st.sampled_from(["own", "device"]),
    hand=st.sampled_from([(0.05, 3.0, 200.0), (0.3, 20.0, 800.0)]),
)
def test_spectral_radius_is_the_largest_root_of_a_plain_simulation(
    mass, ratio, integrator, substeps, exchange, late, gains, motor, clock, hand
):
    m, b, k = hand
    hands = f"[hands]\nmass_kg = [{m}, {m}]\ndamping_ns_per_m = [{b}, {b}]\nstiffness_n_per_m = [{k}, {k}]"
    text = (
        f"tool_mass_kg = {mass}\nstep_s = {ratio * 1e-3!r}\nintegrator = '{integrator}'\nexchange = '{exchange}'\n"
        f"steps_late = {late}\nsubsteps = {substeps}\ntool_damping_ns_per_m = 0.7\n"
        "contact_stiffness_n_per_m = 900.0\ncontact_damping_ns_per_m = 5.0"
    )
    of_device = clock == "device" and ratio % 1 == 0
    text += '\nclock = "device"' if of_device else ""
    gains = gains.times(motor, 0)
    radius, worst = ToolLoops(problem(text, hands=hands)).radius(gains)
    if not 1.02 < radius < 4:  # a tool that floats has roots of 1, which are none of the loop's
        return
    whole = round(ratio * 12)  # samples until every pattern of both clocks recurs, and more than the state has
    found = [
        largest_root(one, gains, whole)
        for phase in ((0.0,) if of_device else (0.0, 0.37))
        for contact in (None, (900.0, 5.0))
        for one in simulators(integrator, substeps, ratio, mass, exchange, 0.7, [hand], late, phase, contact)
    ]
    assert max(found) == pytest.approx(radius, rel=1e-9), worst


def simulators(integrator, substeps, ratio, mass, exchange, drag, hands, late=0, phase=0.0, contact=None):
    return [
        EngineSimulator(
            (0.12, 0.8, 1e-3, 1), hand, (tool, drag), ratio * 1e-3, integrator, exchange, late, contact, phase, substeps
        )
        # released, and at its end stop, where a tool that stands still leaves nothing that moves
        for hand in (*hands, (0.0, 0.0, 0.0), (0.0, 7e3, 1e8))
        for tool in ((mass, np.inf) if hand[2] < 1e8 else (mass,))
    ]


def swing_of_drifting_clocks(gains, hand, tool, ratio, how, ppm, samples=24000):
    """Largest swing in each sixth of a run in which the engine's clock passes every phase."""
    simulator = EngineSimulator((0.12, 0.8, 1e-3, 1), hand, tool, ratio * 1e-3 * (1 + 1e-6 * ppm), **how)
    device, moved = simulator.run(gains.stiffness_n_per_m, gains.damping_ns_per_m, samples, kick=1e-6, force=np.inf)
    apart = np.abs(device - (moved if np.isfinite(tool[0]) else 0.0))
    return apart.reshape(6, -1).max(axis=1)


@pytest.mark.slow
@pytest.mark.parametrize("ppm", [-170.0, 170.0])
@pytest.mark.parametrize(
    ("ratio", "integrator", "exchange", "mass", "lag_s"),
    [
        (2, "semi-implicit", "on-time", 0.2, 3e-3),
        (1, "exact", "held-force", 0.2, 2e-3),
        (3, "semi-implicit", "ahead", 0.94, 1.1e-3),
    ],
)
def test_a_coupling_is_stable_while_the_clocks_drift_through_every_phase(ratio, integrator, exchange, mass, lag_s, ppm):
    """A clock 170 ppm off: below the limit a swing decays; above it grows, except where one instant alone refutes."""
    text = f"tool_mass_kg = {mass}\nstep_s = {ratio * 1e-3!r}\nintegrator = '{integrator}'\nexchange = '{exchange}'"
    search, k = ToolSearch(problem(text)), 10.0
    while search.gain_margin(ToolGains(4 * k, 4 * k * lag_s)):
        k *= 4
    limit = ToolGains(k, k * lag_s).times(search.gain_margin_over_ranges(ToolGains(k, k * lag_s)))
    above = limit.times(1.1)
    how = {"integrator": integrator, "exchange": exchange}
    case = ToolLoops(problem(text)).radius(above)[1]
    ends = tuple(case.hand.values()), (np.inf if case.tool.fixed else mass, 0.0)
    for hand, tool in (ends, ((0.0, 0.0, 0.0), (mass, 0.0)), ((0.0, 0.0, 0.0), (np.inf, 0.0))):
        swing = swing_of_drifting_clocks(limit.times(0.95), hand, tool, ratio, how, ppm)
        assert swing[-1] < swing[0]
    swing = swing_of_drifting_clocks(above, *ends, ratio, how, ppm)
    # A state ahead of its force refutes the phase in which a step falls on a sample, and a drift has no time there.
    assert (swing[-1] > 10 * swing[0]) == (exchange != "ahead")


@pytest.mark.parametrize("contact_n_per_m", [1e3, 1e6, 1e9])
def test_an_exact_step_of_a_stiff_contact_is_the_matrix_exponential(contact_n_per_m):
    """The halvings of a step grow with the fastest mode of the tool: 900 turns in a step of the stiffest contact."""
    exact = engine(integrator="exact", contact_stiffness_n_per_m=contact_n_per_m, contact_damping_ns_per_m=2.0)
    state = tool_states(exact, contact_n_per_m)[-1]
    loop = EngineLoop(Body.motion_source(T, 1.0), clocks(4 * T, T)[0], exact, [state])
    rate = np.array([[0.0, 1.0], [-contact_n_per_m / 0.2, -2.0 / 0.2]])
    np.testing.assert_allclose(
        loop.alone()[0] / [[1, 1e-4], [1e4, 1]], expm(rate * 4 * T) / [[1, 1e-4], [1e4, 1]], atol=1e-6
    )


def test_steps_that_the_devices_loop_starts_are_whole_samples_and_begin_at_one():
    keys = "tool_mass_kg = 0.2\nclock = 'device'\nstep_s = "
    assert [(timing.samples, timing.late) for timing in clocks(3 * T, T, "device")] == [((3,), (False,))]
    assert {timing.late for timing in clocks(3 * T, T)} == {(False,), (True,)}
    ranges = clock_ranges((2 * T, 5 * T), T, "device")
    assert [(timing.samples, timing.late) for timing, _ in ranges] == [((n,), (False,)) for n in (2, 3, 4, 5)]
    for step_s in ("0.0025", "[0.002, 0.0035]"):
        with pytest.raises(avc.InputError, match=r"simulation.step_s.*whole number of device.sample_time_s"):
            problem(keys + step_s)
    # A clock off by a hair is one of its own.
    assert ToolLoops(problem("tool_mass_kg = 0.2\nstep_s = 0.003")).corners == 2
    assert ToolLoops(problem(f"{keys}0.003")).corners == 1


@pytest.mark.slow
def test_released_device_ahead_of_its_engine_is_bounded_by_its_own_damping():
    """With states that lie in the future the released device meets a negative damper: K <= 2 b / ((N + 1) T)."""
    for ratio in (1, 2, 5):
        text = f'tool_mass_kg = 0.2\nstep_s = {ratio * 1e-3!r}\nexchange = "ahead"'
        found = ToolSearch(problem(text)).stiffest().stiffness_n_per_m
        assert found == pytest.approx(2 * 0.8 / ((ratio + 1) * 1e-3), rel=0.02)


@pytest.mark.parametrize("narrow", first(np.geomspace(8.0, 90.0, 9).tolist(), 3))
def test_the_stiffest_coupling_is_the_top_of_the_highest_hump_over_its_dampers(narrow):
    """A wide hump of 5 kN/m about 14 N.s/m, and one of 9 kN/m a third of B wide, wherever it lies."""

    def limit(b, top=1.0):
        return max(5e3 * math.exp(-abs(math.log(b / 3))), top * 9e3 * 0.5 ** abs(math.log(b / narrow, 1.2)))

    def search(top):
        def stable(one):
            return one.stiffness_n_per_m <= limit(one.damping_ns_per_m, top)

        loops = SimpleNamespace(stable=stable, has_counterexample=lambda *_: False, motors=0)
        return CouplingSearch(loops, Scale(0.12, 0.8, 1e-3, 1e-2))

    found = search(1.0).stiffest()
    assert 0.97 * 9e3 < found.stiffness_n_per_m <= 9e3
    assert found.damping_ns_per_m == pytest.approx(narrow, rel=0.02)
    lower = search(0.3).stiffest()
    assert 0.97 * 5e3 < lower.stiffness_n_per_m <= 5e3
    # K and B grow together: over B, the least of K with any factor up to 1.5.
    dampers = np.geomspace(1e-3, 120.0, 20000)
    wanted = max(min(limit(f * b) / f for f in (1.0, math.sqrt(1.5), 1.5)) for b in dampers)
    safe = search(1.0).stiffest_with_margin(found, 1.5, local=False)
    assert 0.93 * wanted < safe <= 1.001 * wanted
    assert wanted < found.stiffness_n_per_m / 1.5


# Each part of a coupling to an engine or a second device against integrators, clocks and loops written out.

T = 1e-3


def engine(**keys):
    return Simulation.model_validate({"tool_mass_kg": 0.2, "step_s": 4e-3} | keys)


@pytest.mark.parametrize("ratio", [1.0, 4.0, 2.5])
def test_a_tool_that_stands_still_is_a_spring_and_a_damper(ratio):
    rigid = tool_states(engine(), RIGID_N_PER_M)[-1]
    loop = EngineLoop(Body.motion_source(T), clocks(ratio * T, T)[-1], engine(), [rigid])
    turn = np.exp(-2j * np.pi * 12.0 * T)
    found = loop.force_per_metre(ToolGains(800.0, 6.0, 2.0), 12.0)
    assert found == pytest.approx(800.0 + 8.0 * (1 - turn) / T)
