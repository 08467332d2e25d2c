"""Each part of a coupling to an engine or a second device against integrators, clocks and loops written out."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.design import tool_region as _region
from avc_casadi.loops.engine import Engine, ToolLoops, clocks, contact_stiffnesses_n_per_m
from avc_casadi.loops.follower import Link, Touch, link_clocks
from avc_casadi.loops.loop import Body
from avc_casadi.model.hands import Hand
from avc_casadi.model.sampled_plant import sampled_plant
from avc_casadi.model.virtual_tool import RIGID_N_PER_M, ToolGains, ToolState, VirtualTool, tool_states
from avc_casadi.recommendation import bilateral as _bilateral
from avc_casadi.recommendation import tool_impedance as _impedance
from avc_casadi.recommendation import tried_tool as _hands
from avc_casadi.recommendation import virtual_tool as _tool

T = 1e-3
DEVICE = "[device]\nmass_kg = 0.12\ndamping_ns_per_m = 0.8\ndelay_samples = 1\n"


def problem(simulation, device=DEVICE, table="simulation"):
    return avc.parse_problem(f"{device}[{table}]\n{simulation}")


def engine(**keys):
    return VirtualTool.model_validate({"tool_mass_kg": 0.2, "step_s": 4e-3} | keys)


def test_only_what_is_ahead_of_its_force_or_holds_one_is_damped_by_the_device():
    """An implicit engine damps of itself; where nothing moves, nothing is ahead."""
    assert [engine(exchange=one).damped_locally for one in ("on-time", "late", "ahead", "held-force")] == [0, 0, 1, 1]
    assert not engine(exchange="ahead", integrator="implicit").damped_locally
    assert engine(exchange="held-force", integrator="implicit").damped_locally
    assert not engine(exchange="ahead", tool_mass_kg=None).damped_locally


def test_a_contact_without_a_damper_of_its_own_is_damped_critically():
    (state,) = tool_states(engine(), 1500.0)
    assert (state.mass_kg, state.contact_stiffness_n_per_m) == (0.2, 1500.0)
    discriminant = state.contact_damping_ns_per_m**2 - 4 * state.mass_kg * state.contact_stiffness_n_per_m
    assert discriminant == pytest.approx(0.0, abs=1e-6)


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


def test_loops_are_those_of_all_hands_tools_contacts_steps_and_of_the_released_device():
    stated = problem("tool_mass_kg = [0.1, 0.3]\nstep_s = [0.0025, 0.004]\ncontact_stiffness_n_per_m = [10.0, 500.0]")
    loops = ToolLoops(stated)
    assert set(loops.hands.values(len(loops.hands) - 1).values()) == {0.0}
    assert {one.case(0).step_s for one in loops.patterns} == {0.0025, 0.004}
    touched = contact_stiffnesses_n_per_m(stated.simulation)
    assert touched[0] == 0.0
    assert touched[-1] == RIGID_N_PER_M
    assert {10.0, 500.0} <= set(np.round(touched, 9))
    for gains, several in ((ToolGains(3000.0, 2.0), True), (ToolGains(8000.0, 30.0), False)):
        radii = {}
        for place, loop in enumerate(loops.patterns):
            each = np.abs(np.linalg.eigvals(loop.maps(gains))).max(axis=-1)
            radii |= {(place, row): one for row, one in enumerate(each)}
        place, at = max(radii, key=lambda one: math.log(radii[one]) / loops.patterns[one[0]].period_s)
        assert (loops.patterns[place].ticks > 1) == several
        assert loops.worst(gains)[2] == pytest.approx(radii[place, at], rel=1e-6)


def test_an_engine_whose_stiffest_contact_leaves_its_place_is_unstable_by_itself():
    for stiffest, stable in ((1e3, True), (1e6, False)):
        text = f"tool_mass_kg = 0.1\nstep_s = 0.005\ncontact_stiffness_n_per_m = [0.0, {stiffest}]"
        undamped = problem(f"{text}\ncontact_damping_ns_per_m = 0.0")
        # dt sqrt(k/m) of the stiffest is 0.5, and 16.
        assert ToolLoops(undamped).engine_alone_stable() == stable


def test_the_region_reckons_with_the_lightest_device_and_its_own_damping(monkeypatch):
    ranged = DEVICE + "[device.range]\nmass_kg = [0.06, 0.2]\ndamping_ns_per_m = [0.5, 1.0]\n"
    stated = problem('tool_mass_kg = 0.2\nstep_s = 0.004\nexchange = "ahead"', device=ranged)
    asked = []

    class Loops:
        def stable(self, gains):
            asked.append(gains)
            return gains.stiffness_n_per_m < 300 + 1e3 * min(gains.damping_ns_per_m, 1.0)

        def refuted(self, _):
            return False

    stiffest = ToolGains(1234.0, 5.0, 6.0)
    search = SimpleNamespace(loops=Loops(), limit=(stiffest, True))
    monkeypatch.setattr(_region, "ToolSearch", lambda _: search)
    found = _region.tool_region(stated)
    assert found.damping_ns_per_m[-1] == pytest.approx(0.06 / T)
    for gains in asked:
        critical = 2 * math.sqrt(gains.stiffness_n_per_m * 0.06)
        assert gains.local_damping_ns_per_m == pytest.approx(max(0.0, critical - 0.5))
    curve = found.document()["curves"][0]
    assert max(curve["stiffness_n_per_m"]) > min(curve["stiffness_n_per_m"])
    told = [curve[f"stiffest_{key}"] for key in ("n_per_m", "with_ns_per_m", "with_local_ns_per_m")]
    assert told == [1234.0, 5.0, 6.0]


def tried(lean, free, first, wanted=None):
    """Choose where hands settle with friction up to one stiffness, and without up to another."""
    stated = problem("tool_mass_kg = 0.2\nstep_s = 0.004" + (f"\nstiffness_n_per_m = {wanted}" if wanted else ""))
    search = SimpleNamespace(damped=lambda k, **_: [ToolGains(k, 1.0)], refuted=lambda *_: False)

    def trial(_, gains, *__):
        k = gains.stiffness_n_per_m
        each = np.ones(4, dtype=bool)
        return SimpleNamespace(
            settled_with_friction=k <= lean,
            settled=k <= min(lean, free),
            stable=each & (k <= lean),
            stable_with_dropped_steps=each,
            stable_without_friction=each & (k <= free),
        )

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(_hands, "try_tool", trial)
        gains, _, stiffer = _hands._tried(stated, search, first, 4, 0, _hands.SILENT, _hands.OPTIONS, local=False)
    # What set K is the next stiffer one.
    if gains is not None and gains.stiffness_n_per_m < first:
        assert stiffer[0] == pytest.approx(gains.stiffness_n_per_m / 0.8)
    elif gains is not None:
        assert stiffer is None
    return None if gains is None else gains.stiffness_n_per_m


def test_softer_couplings_are_tried_until_hands_settle_and_some_for_rest_without_friction():
    assert tried(500.0, 500.0, 1000.0) == pytest.approx(1000 * 0.8**4)
    assert tried(900.0, 600.0, 800.0) == pytest.approx(800 * 0.8**2)
    assert tried(900.0, 0.0, 800.0) == 800.0
    assert tried(900.0, 900.0, 1000.0, wanted=1000.0) is None


def test_a_stiffness_that_is_wanted_is_the_one_that_is_tried(monkeypatch):
    first, gains = [], ToolGains(5000.0, 8.0)
    loops = type("Loops", (), {"radius": lambda *_: (0.9, None), "__len__": lambda _: 1})()
    search = SimpleNamespace(limit=(gains, False), holds=lambda *_, **__: True, loops=loops)
    search.stiffest_with_margin = lambda limit, margin, **_: 0.9 * limit.stiffness_n_per_m / margin
    monkeypatch.setattr(_tool, "ToolSearch", lambda _: search)
    monkeypatch.setattr(_hands, "_tried", lambda _, __, k, *___, **____: first.append(k) or (None, None, None))
    for name in ("why_infeasible", "_why_none"):
        monkeypatch.setattr(_tool, name, lambda *_: "")
    for name in ("least_tool_mass_kg", "slowest_step_s", "what_would_help", "exchanges_that_hold"):
        monkeypatch.setattr(_tool, name, lambda *_, **__: ())
    for more in ("", "\nstiffness_n_per_m = 3000.0"):
        _tool.recommend_tool(problem(f"tool_mass_kg = 0.2\nstep_s = 0.004{more}"))
    assert first == pytest.approx([0.9 * 0.9 * 5000.0 / 1.5, 3000.0])


def test_a_loop_whose_map_overflows_is_unstable():
    """A held force too strong for the device grows e-fold many times a step; 300 ms are beyond the largest number."""
    stated = problem("step_s = 0.3", device=DEVICE.replace("delay_samples = 1\n", ""))
    loops = ToolLoops(stated)
    assert loops.stable(ToolGains(3e4, 50.0))
    for gains in (ToolGains(1e6, 50.0), ToolGains(3e4, 5e3)):
        assert not loops.stable(gains)
        assert loops.radius(gains)[0] > 1
    longer = ToolLoops(stated.changed(simulation={"step_s": 10.0}))
    assert not longer.stable(ToolGains(1e5, 500.0))


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


@pytest.mark.parametrize("ratio", [1.0, 2.0, 1.5])
def test_a_period_of_two_clocks_is_as_long_as_its_samples_of_the_leader(ratio):
    loop = pair("position-position", "commanded", 0.0, 0.0, ratio=ratio)
    assert loop.samples * T == pytest.approx(math.lcm(2, round(2 * ratio)) / 2 * T)


def test_messages_wait_for_whole_samples_and_the_longest_delay_asks_for_most(monkeypatch):
    asked = []
    monkeypatch.setattr(_bilateral, "passivity_margin", lambda one, _: asked.append(one) or (0.0, 0.0))
    monkeypatch.setattr(_bilateral, "damping_needed_ns_per_m", lambda one, _: one.there_samples)
    text = "mass_kg = 0.3\ndamping_ns_per_m = 1.0\ndelay_s = [0.0013, 0.0043]\nreturn_delay_s = [0.0012, 0.002]"
    _, needed = _bilateral._passivity(problem(text, table="follower"), ToolGains(1e3, 1.0))
    for one, (there, back) in zip(asked, ((1.3, 1.2), (4.3, 2.0)), strict=True):
        # Up to the next whole sample, and one more.
        assert one.there_samples + one.back_samples == pytest.approx(math.ceil(there + back) + 1)
        assert one.there_samples - there == pytest.approx(one.back_samples - back)
    assert needed == max(one.there_samples for one in asked) > min(one.there_samples for one in asked)
