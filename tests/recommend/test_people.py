"""Hands that are only counted rest as those of a trial do; how they are dealt out changes nobody."""

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.simulation.population.coupling_trial import try_coupling
from avc_casadi.simulation.population.operators import BLOCK, draw_hands, draw_population
from avc_casadi.simulation.population.settled import settled_hands

SEED = 4


@pytest.fixture(scope="module")
def coupling():
    problem = avc.load_problem("ve7")
    return Coupling.of(problem, avc.solve(problem, "static"))


@pytest.mark.thorough
def test_counts_are_those_of_a_trial(coupling):
    found = settled_hands(coupling, 40, SEED, block=17)
    trial = try_coupling(coupling, draw_hands(coupling.problem.hands, 40, SEED), SEED)
    assert found.at_rest == trial.stable.sum()
    assert found.by_motion == {name: int(rest.sum()) for name, rest in trial.by_motion.items()}
    assert found.moving == tuple(np.flatnonzero(~trial.stable)[:20])
    free = settled_hands(coupling, 40, SEED, friction=False)
    assert free.at_rest == trial.stable_without_friction.sum()
    assert "coulomb-friction" in found.effects
    assert "coulomb-friction" not in free.effects
    assert 0 < free.at_rest < 40


@pytest.mark.parametrize("population", ["A", "B"])
def test_anybody_is_drawn_without_those_before(population):
    many = draw_population(population, BLOCK + 50, 7)
    some = draw_population(population, 80, 7, first=BLOCK - 40)
    for row in range(80):
        assert many.values(BLOCK - 40 + row) == some.values(row)
    assert len(np.unique(many.mass_kg)) == BLOCK + 50
