"""What is recommended is deployable, as safe and as stiff as any plain alternative, and never gets worse on a better
device."""

import functools

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.loops.walls import stiffest_wall
from avc_casadi.model.gains import Gains
from avc_casadi.model.hands import hand_corners, with_released
from avc_casadi.model.runtime import Runtime
from avc_casadi.simulation.population.coupling_trial import try_coupling
from avc_casadi.simulation.population.operators import people_of


def wall(stiffness, **device):
    problem = avc.load_problem("ve7").changed(
        environment={"stiffness_n_per_m": stiffness, "damping_ns_per_m": 1e-4 * stiffness}
    )
    return problem.changed(device=device) if device else problem


@functools.cache
def found(stiffness, hands=12, **device):
    return avc.recommend(wall(stiffness, **device), hands=hands)


def safety(trial):
    """Everybody at rest without friction, with it only, or not everybody: smaller is safer."""
    if trial.stable.all():
        return 0 if trial.stable_without_friction.all() else 1
    return 2


@pytest.mark.thorough
@pytest.mark.one_of(2)
@pytest.mark.parametrize(
    ("stiffness", "device"),
    [
        (1e5, {}),
        (2e4, {}),
        (1e5, {"encoder_resolution_m": 20e-6}),
        (2e4, {"delay_samples": 1}),
        (8e3, {"coulomb_friction_n": 1.0, "encoder_resolution_m": 38e-6, "max_force_n": 8.0}),
    ],
    ids=["figure 5", "softer", "20 um", "one sample of delay", "a Falcon"],
)
def test_no_plain_pair_is_deployable_as_safe_and_stiffer(stiffness, device):
    problem = wall(stiffness, **device)
    best = found(stiffness, **device)
    assert best.deployable
    assert avc.deployable(best.coupling).passed
    people = people_of(problem.hands, 12)
    for k in (5e4, 1e8):
        for b in (0.0, 10.0):
            for b_p in (0.0, 0.5, 1.0):
                plain = Gains(b, k, b_p * stiffness * problem.device.sample_time_s)
                for runtime in (Runtime(), Runtime(observer_mass_kg=0.15)):
                    other = Coupling.constant(problem, plain, "plain", runtime)
                    if runtime.observer_mass_kg and not problem.device.encoder_resolution_m:
                        continue
                    if not avc.deployable(other).passed:
                        continue
                    tried = try_coupling(other, people)
                    if safety(tried) < safety(best.trial):
                        pytest.fail(f"{other} is safer than {best.coupling}")
                    if safety(tried) == safety(best.trial) < 2 and tried.quiet.all():
                        assert tried.stiffness <= 1.1 * best.trial.stiffness, (other, best.coupling)


@pytest.mark.thorough
def test_a_stiffer_wall_is_never_felt_softer():
    felt = [found(stiffness).trial.stiffness for stiffness in (1e3, 2e4, 1e5)]
    assert np.all(np.diff(felt) > -0.02 * np.array(felt[:-1]))
    assert felt[0] == pytest.approx(1e3, rel=0.02)


@pytest.mark.exhaustive
def test_a_wall_beyond_reach_costs_nothing_of_what_is_felt():
    held, beyond = (found(stiffness, delay_samples=1).trial.stiffness for stiffness in (9e4, 1e6))
    assert held == pytest.approx(9e4, rel=0.02)
    assert beyond > 0.9 * held


@pytest.mark.thorough
@pytest.mark.one_of(3)
@pytest.mark.parametrize(
    ("key", "values"),
    [
        ("delay_samples", (1, 0.5, 0)),
        ("damping_ns_per_m", (1.0, 2.0, 8.0)),
        ("encoder_resolution_m", (5e-5, 5e-6, 0.0)),
    ],
)
def test_a_better_device_is_never_felt_softer(key, values):
    felt = [found(5e4, **{key: value}).trial.stiffness for value in values]
    assert np.all(np.diff(felt) > -0.02 * np.array(felt[:-1]))


@pytest.mark.thorough
def test_the_plain_wall_is_recommended_where_it_is_as_good():
    best = avc.recommend("soft", hands=12)
    assert best.trial.stiffness == pytest.approx(best.problem.environment.stiffness_n_per_m, rel=1e-3)


def test_hands_are_those_of_the_problem():
    heavy = avc.load_problem("ve7").changed(hands={"mass_kg": [1.0, 1.5], "damping_ns_per_m": [20.0, 30.0]})
    assert set(np.round(people_of(heavy.hands, 8).mass_kg, 6)) == {1.0, 1.5}


@pytest.mark.exhaustive
def test_nothing_is_promised_that_does_not_hold():
    best = found(1e5, hands=8, encoder_resolution_m=1e-3, coulomb_friction_n=0.0, position_noise_rms_m=1e-3)
    trial = best.trial.document()
    assert trial["at_rest"] < trial["hands"]
    assert "nothing of the wall is rendered" in best.reason
    assert not best.deployable


@pytest.mark.thorough
def test_where_nothing_is_deployable_it_says_so():
    hand = {"mass_kg": (0.1, 0.1), "damping_ns_per_m": (5.0, 5.0), "stiffness_n_per_m": (400.0, 400.0)}
    best = avc.recommend(wall(1e4, delay_samples=33).changed(hands=hand), hands=2)
    assert not best.deployable
    assert best.coupling is None
    assert "linear stability" in best.reason
    assert best.data()["coupling"] is None


@pytest.mark.thorough
def test_what_would_help_is_what_the_device_then_holds():
    best = found(2e4, delay_samples=1)
    told = {one.change: one.stiffest_wall_n_per_m for one in best.helps}
    other = wall(2e4)
    undelayed = stiffest_wall(other.device, with_released(hand_corners(other.hands))).stiffness_n_per_m
    assert told["no delay"] == pytest.approx(undelayed, rel=1e-3)
    assert min(told.values()) >= best.plain_wall_n_per_m
    assert list(told.values()) == sorted(told.values(), reverse=True)


def test_nothing_is_recommended_for_a_wall_without_force():
    found = avc.recommend(avc.load_problem("spring").changed(environment={"stiffness_n_per_m": 0.0}), hands=2)
    assert found.coupling is None
    assert not found.deployable
    assert "gives no force" in found.reason


@pytest.mark.thorough
def test_what_no_coupling_mends_is_told_before_any_is_looked_for():
    massless = avc.recommend("hard/massless", hands=5)
    assert (massless.considered, massless.deployable) == (0, False)
    assert "device.mass_kg" in massless.reason
    knob = avc.load_problem("knob")
    deep = knob.changed(detent={"force_n": 5 * knob.detent.force_n, "damping_ns_per_m": 0.0})
    found = avc.recommend(deep, hands=5)
    assert (found.considered, found.deployable, found.helps) == (0, False, ())
    assert avc.recommend(deep.changed(detent={"damping_ns_per_m": 5e-3}), hands=5).considered > 0


def test_a_seed_below_0_is_refused():
    with pytest.raises(avc.InputError, match="seed: is -1; allowed: 0 or more"):
        avc.recommend("soft", hands=3, seed=-1)
