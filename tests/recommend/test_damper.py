"""A wall that is a damper alone never pulls: what is rendered is as strong as asked going in, not in the mean."""

import numpy as np
import pytest
from exported import Exported

import avc_casadi as avc
from avc_casadi.claims.passivity.rendered_impedance import Excitation, wall_over_position
from avc_casadi.coupling import Coupling
from avc_casadi.model.gains import Gains, near_rigid_n_per_m
from avc_casadi.model.problem import Impedance

DEVICE = {"mass_kg": 0.2, "damping_ns_per_m": 1.0, "delay_samples": 1, "max_force_n": 10.0}


def fundamental(force, angle):
    """Plain trapezoids of the Fourier integrals."""
    sine, cosine = (2 * np.mean(force * wave) for wave in (np.sin(angle), np.cos(angle)))
    return complex(sine, cosine)


@pytest.mark.parametrize(("stiffness", "damping"), [(0.0, 15.0), (2e3, 5.0), (500.0, 40.0), (1e3, 0.0)])
def test_the_wall_itself_is_that_of_plain_integrals(stiffness, damping):
    hz = np.array([1.0, 10.0])
    wall = Impedance(damping_ns_per_m=damping, stiffness_n_per_m=stiffness)
    found = wall_over_position(wall, Excitation(2e-3, 1e-3), hz)
    angle = np.linspace(0.0, 2 * np.pi, 200_000, endpoint=False)
    for one, rate in zip(found, 2 * np.pi * hz, strict=True):
        force = stiffness * (2e-3 + 1e-3 * np.sin(angle)) + damping * rate * 1e-3 * np.cos(angle)
        assert one == pytest.approx(fundamental(np.maximum(0.0, force), angle) / 1e-3, rel=1e-4, abs=1e-6)


def test_a_damper_alone_leaves_half_of_it():
    damper = Impedance(damping_ns_per_m=15.0, stiffness_n_per_m=0.0)
    found = wall_over_position(damper, Excitation(0.01, 0.005), np.array([2.0]))
    assert found[0] == pytest.approx(0.5 * 15.0 * 2j * np.pi * 2.0, rel=1e-4)


@pytest.mark.thorough
def test_what_is_recommended_gives_the_force_that_was_asked_for():
    problem = avc.Problem(
        device=DEVICE,
        environment={"stiffness_n_per_m": 0.0, "damping_ns_per_m": 15.0},
        stability={"model": "sampled-data", "scope": "hands"},
    )
    coupling = avc.recommend(problem, hands=50, workers=1).coupling
    assert isinstance(coupling, Coupling)
    assert coupling.table.at_rest.contact_damping_ns_per_m == 0
    assert _force_at(coupling, 0.05) == pytest.approx(0.75, rel=1e-3)
    more = Coupling.constant(problem, Gains(0.0, near_rigid_n_per_m(problem.device), 15.0), "more")
    assert _force_at(more, 0.05) == pytest.approx(1.5, rel=1e-3)


def _force_at(coupling, speed):
    device = Exported(coupling)
    device.start()
    return float(device.forces(1e-3 * speed * np.arange(-100, 200.0))[-1])
