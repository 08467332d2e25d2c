"""What is recommended is deployable, as safe and as stiff as any plain alternative, and never gets worse on a better
device."""

import functools

import pytest

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.model.gains import Gains
from avc_casadi.model.runtime import Runtime
from avc_casadi.simulation.population.operators import people_of
from avc_casadi.simulation.population.trial import try_coupling


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


@pytest.mark.slow
@pytest.mark.parametrize(
    ("stiffness", "device"),
    [
        (1e5, {}),
        (1e5, {"encoder_resolution_m": 20e-6}),
        (8e3, {"coulomb_friction_n": 1.0, "encoder_resolution_m": 38e-6, "max_force_n": 8.0}),
    ],
    ids=["figure 5", "20 um", "a Falcon"],
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


@pytest.mark.slow
def test_the_plain_wall_is_recommended_where_it_is_as_good():
    best = avc.recommend("soft", hands=12)
    assert best.trial.stiffness == pytest.approx(best.problem.environment.stiffness_n_per_m, rel=1e-3)
