"""Before a wall that some stylus hands do not settle at, a spring may be nearer in motion than a law: it is found."""

import pytest

import avc_casadi as avc

DEVICE = {
    "mass_kg": 0.08,
    "damping_ns_per_m": 0.3,
    "delay_samples": 1.5,
    "coulomb_friction_n": 0.05,
    "encoder_resolution_m": 3e-5,
    "max_force_n": 4.0,
    "held": "stylus",
}


def rendered(wall=2000.0, **changed):
    wanted = {"stiffness_n_per_m": wall, "damping_ns_per_m": 0.0}
    answer = avc.recommend({"device": DEVICE | changed, "environment": wanted})
    assert answer.deployable
    felt = answer.felt()
    return felt["complex_error"]["1"], felt["stiffness_in_motion_n_per_m"]["1"]


@pytest.mark.thorough
def test_neighbours_of_a_stylus_render_the_same():
    # The bisection ends where walls are 5 % apart.
    error, stiffness = rendered()
    assert error < 0.3
    for changed in ({"mass_kg": 0.0808}, {"delay_samples": 1.6}, {"mass_kg": 0.0792}):
        assert rendered(**changed)[1] == pytest.approx(stiffness, rel=0.05)
    # Without any friction nothing is easier.
    assert rendered(coulomb_friction_n=0.0)[1] == pytest.approx(stiffness, rel=0.1)


@pytest.mark.thorough
def test_a_wall_that_is_asked_for_stiffer_is_not_rendered_softer():
    stiffness = [rendered(wall)[1] for wall in (1500.0, 1700.0, 2300.0, 3000.0)]
    assert min(stiffness) > 0.9 * max(stiffness)
