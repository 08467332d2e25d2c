"""Hands that are only counted rest as those of a trial do; how they are dealt out changes nobody."""

import json

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.cli import main
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


@pytest.mark.thorough
def test_the_command_gives_the_counts_and_their_interval(coupling, tmp_path, capsys):
    avc.write_coupling(coupling, tmp_path / "c.json")
    command = ["trial", str(tmp_path / "c.json"), "--hands", "20", "--seed", "1", "--workers", "1"]
    assert main([*command, "--json"]) == 0
    whole = json.loads(capsys.readouterr().out)
    assert whole["at_rest"] == settled_hands(coupling, 20, 1).at_rest
    assert whole["at_rest_interval"][0] <= whole["at_rest"] / 20 <= whole["at_rest_interval"][1]
    assert main(command) == 0
    assert f"{whole['at_rest']} of 20 hands in every motion" in capsys.readouterr().out
