"""Hands that are only counted rest as those of a trial do; how they are dealt out changes nobody."""

import json

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.cli import main
from avc_casadi.coupling import Coupling
from avc_casadi.simulation.population.coupling_trial import try_coupling
from avc_casadi.simulation.population.operators import BLOCK, draw_hands, draw_population
from avc_casadi.simulation.population.settled import settling_study

SEED = 4


@pytest.fixture(scope="module")
def coupling():
    problem = avc.load_problem("ve7")
    return Coupling.of(problem, avc.solve(problem, "static"))


@pytest.mark.thorough
def test_counts_are_those_of_a_trial(coupling):
    found = settling_study(coupling, 40, SEED, chunk=17).run()
    trial = try_coupling(coupling, draw_hands(coupling.problem.hands, 40, SEED), SEED)
    assert found.at_rest == trial.stable.sum()
    assert found.by_motion == {name: int(rest.sum()) for name, rest in trial.by_motion.items()}
    assert found.moving == tuple(np.flatnonzero(~trial.stable)[:20])
    free = settling_study(coupling, 40, SEED, friction=False).run()
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
def test_command_in_shares_gives_the_answer_of_one_go(coupling, tmp_path, capsys):
    file, folder = tmp_path / "c.json", tmp_path / "jobs"
    avc.write_coupling(coupling, file)
    command = ["trial", str(file), "--hands", "20", "--seed", "1", "--workers", "1"]

    def answer(*more, code=0):
        assert main([*command, *more, "--json"]) == code
        return json.loads(capsys.readouterr().out)

    whole = answer()
    assert "holds no study" in answer("--merge", "--resume", str(folder), code=2)["errors"][0]["message"]
    assert answer("--chunk", "1/2", "--resume", str(folder))["done"] == 1
    assert answer("--merge", "--resume", str(folder)) == whole
    assert whole["at_rest_interval"][0] <= whole["at_rest"] / 20 <= whole["at_rest_interval"][1]
    assert "--resume DIR" in answer("--merge", code=2)["errors"][0]["message"]
    assert "another study" in answer("--resume", str(folder), "--without-friction", code=2)["errors"][0]["message"]
    assert main(command) == 0
    assert f"{whole['at_rest']} of 20 hands in every motion" in capsys.readouterr().out
