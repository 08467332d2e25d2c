"""Each file of the catalogue has the property for which it is there."""

import itertools

import numpy as np
import pytest

import avc_casadi as avc

LADDER = ["ve2", "ve3", "ve4", "ve5", "ve6", "ve7"]


@pytest.mark.parametrize("entry", avc.catalogue(), ids=lambda entry: entry.name)
def test_every_entry_loads_and_says_what_it_is(entry):
    problem = avc.load_problem(entry.name)
    assert problem == avc.load_problem(entry.path)
    assert problem.name == entry.name
    assert avc.catalogue_path(entry.name) == entry.path
    assert problem.title == entry.title != ""
    assert problem.source == entry.source
    assert "assumed" in problem.source
    assert problem.source.startswith("Hard case: ") == entry.name.startswith("hard/")
    frequency = problem.frequencies_hz()
    assert np.all(np.diff(frequency) > 0)
    assert np.all(frequency * problem.device.sample_time_s < 0.5)


def test_the_ladder_rises_and_crosses_what_a_hand_holds():
    walls = [avc.load_problem(name) for name in LADDER]
    stiffness = [wall.environment.stiffness_n_per_m for wall in walls]
    assert all(1.2 < upper / lower < 5 for lower, upper in itertools.pairwise(stiffness))
    # Without delay a hand with damping b_h holds about 2 (b_d + b_h)/T.
    lowest, highest = (
        2 * (walls[0].device.damping_ns_per_m + damping) / walls[0].device.sample_time_s
        for damping in walls[0].hands.damping_ns_per_m
    )
    assert stiffness[1] < lowest < stiffness[2] < highest < stiffness[3]
