"""Trials of couplings that differ in numbers alone share a compiled scene, and find what each finds alone."""

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.model.gains import Gains
from avc_casadi.model.hands import Hand
from avc_casadi.model.runtime import Runtime
from avc_casadi.simulation.population import prepared as _prepared
from avc_casadi.simulation.population.coupling_trial import try_coupling
from avc_casadi.simulation.population.operators import people_of

PROBLEM = avc.load_problem("reference-r1").changed(environment={"stiffness_n_per_m": 1500.0, "damping_ns_per_m": 1.0})


def couplings():
    gains = [Gains(0.0, 1e8), Gains(0.0, 1e8, 3.0), Gains(0.0, 1e8, 4.0), Gains(2.0, 900.0, 4.0), Gains(5.0, 0.0)]
    return [Coupling.constant(PROBLEM, one, "x") for one in gains] + [
        Coupling.constant(PROBLEM, Gains(0.0, 1e8), "x", runtime)
        for runtime in (Runtime(observer_mass_kg=0.15), Runtime(observer_mass_kg=0.4))
    ]


def columns(coupling, people):
    return try_coupling(coupling, people).to_dict()


@pytest.mark.thorough
def test_the_same_is_found_one_after_the_other_and_each_alone():
    people = people_of(PROBLEM.hands, 20)
    together = [columns(one, people) for one in couplings()]
    for one, found in zip(couplings(), together, strict=True):
        _prepared._alike.cache_clear()
        for name, values in columns(one, people).items():
            np.testing.assert_array_equal(found[name], values)


@pytest.mark.parametrize("change", [{"mass_kg": 0.2}, {"delay_samples": 2}, {"coulomb_friction_n": 0.0}])
def test_another_device_or_other_people_have_a_scene_of_their_own(change):
    people = people_of(PROBLEM.hands, 20)
    others = Hand(*(1.1 * values for values in vars(people).values()))
    first = couplings()[2]
    other = Coupling.constant(PROBLEM.changed(device=change), first.table.at_rest, "x")
    before = [columns(one, who) for one, who in ((first, people), (first, others), (other, people))]
    _prepared._alike.cache_clear()
    after = [columns(one, who) for one, who in ((other, people), (first, others), (first, people))][::-1]
    for found, again in zip(before, after, strict=True):
        for name, values in found.items():
            np.testing.assert_array_equal(values, again[name])
    assert not np.array_equal(before[0]["tap_force_n"], before[1]["tap_force_n"])
