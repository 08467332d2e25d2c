"""What is recommended is deployable, as safe and stiff as a plain alternative, and no worse at a smaller margin."""

import itertools

import pytest

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.model.gains import Gains
from avc_casadi.model.runtime import Runtime
from avc_casadi.recommendation.rank import impedance_error
from avc_casadi.simulation.population.operators import people_of
from avc_casadi.simulation.population.trial import try_coupling


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
    environment = {"stiffness_n_per_m": stiffness, "damping_ns_per_m": 1e-4 * stiffness}
    problem = avc.load_problem("ve7").changed(environment=environment, device=device)
    best = avc.recommend(problem, hands=12)
    assert best.deployable
    assert avc.deployable(best.coupling).passed
    people = people_of(problem.hands, 12)
    each = itertools.product((0.0, 10.0), (5e4, 1e8), (0.0, 0.5, 1.0), (None, 0.15))
    for b, k, b_p, observer_kg in each:
        if observer_kg and not problem.device.encoder_resolution_m:
            continue
        plain = Gains(b, k, b_p * stiffness * problem.device.sample_time_s)
        other = Coupling.constant(problem, plain, "plain", Runtime(observer_mass_kg=observer_kg))
        if not avc.deployable(other).passed:
            continue
        tried = try_coupling(other, people)
        assert safety(tried) >= safety(best.trial), (other, best.coupling)
        if safety(tried) == safety(best.trial) < 2 and tried.quiet.all():
            assert tried.stiffness <= 1.1 * best.trial.stiffness, (other, best.coupling)


@pytest.mark.slow
def test_a_smaller_margin_gives_nothing_worse():
    usual = avc.load_problem("reference-r2")
    less = usual.changed(robustness={"disk_margin": 0.15})
    of_usual, of_less = (impedance_error(avc.recommend(one, hands=12).coupling) for one in (usual, less))
    assert of_less < 1.01 * of_usual


@pytest.mark.slow
def test_the_plain_wall_is_recommended_where_it_is_as_good():
    best = avc.recommend("soft", hands=12)
    assert best.trial.stiffness == pytest.approx(best.problem.environment.stiffness_n_per_m, rel=1e-3)
