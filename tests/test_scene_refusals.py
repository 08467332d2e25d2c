"""Unknown and impossible scenes are refused by name, all faults at once, before anything runs."""

import math

import numpy as np
import pytest
from scene_reference import MASSLESS, scene_problem

import avc_casadi as avc
from avc_casadi import InputError, UnsupportedError
from avc_casadi.design.scene_coupling import simulate
from avc_casadi.model.gains import Gains, gains_at
from avc_casadi.model.hands import Hand
from avc_casadi.simulation.compile import compile_scene
from avc_casadi.simulation.scene import simulate_batch

BARE = (
    "[device]\nmass_kg = 0.1\ndamping_ns_per_m = 2.0\n[environment]\ndamping_ns_per_m={b_e}\nstiffness_n_per_m={k_e}\n"
)
HAND, WALL = 'kind = "hand"', 'kind = "wall"'


def faults(effects, head=BARE):
    with pytest.raises(InputError) as caught:
        compile_scene(scene_problem(effects, head=head, name="mine"))
    assert all(fault.file == "mine" for fault in caught.value.faults)
    return {fault.key: fault.message for fault in caught.value.faults}


@pytest.mark.parametrize(
    ("effect", "key", "words"),
    [
        ('kind = "coulomb-friction"', "force_n", "device.coulomb_friction_n"),
        ('kind = "encoder"', "resolution_m", "device.encoder_resolution_m"),
        ('kind = "delay"', "samples", "device.delay_samples"),
        ('kind = "viscous-friction"', "damping_ns_per_m", "above 0"),
        ('kind = "encoder"\nresolution_m = 0.0', "resolution_m", "is 0"),
        ('kind = "resonance"\nfrequency_hz = 100.0\ndamping_ratio = 0.1\nmass_ratio = 1.0', "mass_ratio", "below 1"),
    ],
)
def test_an_effect_without_its_number_is_refused_with_its_key(effect, key, words):
    found = faults((HAND, WALL, effect))
    assert list(found) == [f"scene.effects[2].{key}"]
    assert words in found[f"scene.effects[2].{key}"]
    assert "allowed" in found[f"scene.effects[2].{key}"]


def test_all_faults_are_told_at_once():
    effects = (HAND, 'kind = "stylus-hand"', WALL, WALL, 'kind = "environment"', 'kind = "encoder"', 'kind = "delay"')
    with pytest.raises(InputError) as caught:
        compile_scene(scene_problem(effects, head=BARE))
    text = str(caught.value)
    assert len(caught.value.faults) == 5
    for words in ("wall is listed 2 times", "hand and stylus-hand exclude", "wall and environment exclude"):
        assert words in text
    assert "scene.effects[5].resolution_m" in text
    assert "scene.effects[6].samples" in text


def test_jitter_that_does_nothing_is_refused():
    assert (
        "rms_s and dropped_share are both 0" in faults((HAND, WALL, 'kind = "jitter"\nrms_s = 0.0'))["scene.effects[2]"]
    )


def test_a_scene_without_any_mass_is_refused():
    massless = BARE.replace("mass_kg = 0.1", "mass_kg = 0.0")
    for effects in ((WALL,), ('kind = "stylus-hand"', WALL), ('kind = "hand"\nmass_kg = 0.0', WALL)):
        assert "mass" in faults(effects, massless)["scene.effects"]
    assert compile_scene(scene_problem((HAND, WALL), head=massless)).instructions > 0


def test_unknown_kinds_are_refused_when_the_file_is_read():
    with pytest.raises(InputError, match="magnet"):
        scene_problem(('kind = "magnet"',))


def test_another_hand_needs_a_hand_to_replace():
    with pytest.raises(InputError, match="lists no hand"):
        simulate(scene_problem(('kind = "stylus-hand"', WALL)), Gains(10, 7e3), hand=Hand(0.1, 1.0, 100.0))
    with pytest.raises(InputError, match="lists no hand"):
        simulate_batch(scene_problem((WALL,)), Hand(np.ones(2), np.ones(2), np.ones(2)), Gains(10, 7e3))


@pytest.mark.parametrize(
    "values", [(-1.0, 1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, -1.0), (1.0, 1.0, math.inf), (math.nan, 1.0, 0.0)]
)
def test_gains_that_are_no_gains_are_refused(values):
    with pytest.raises(InputError, match="allowed: 0 or more"):
        Gains(*values)


def test_gains_of_a_table_only_where_it_has_some():
    problem = avc.load_problem("hard/infeasible-box")
    table = avc.solve(problem, "exact")
    missing = table.frequency_hz[~table.usable][0]
    with pytest.raises(InputError, match=f"no gains at {missing:g} Hz"):
        gains_at(table, float(missing))
    with pytest.raises(InputError, match="allowed: "):
        gains_at(table, 1e6)


def test_mechanics_too_fast_for_exact_friction_are_refused_with_a_way_out():
    hand = 'kind = "hand"\nmass_kg = 1e-6\ndamping_ns_per_m = 1e5\nstiffness_n_per_m = 1e8'
    effects = (hand, WALL, 'kind = "coulomb-friction"')
    with pytest.raises(UnsupportedError, match="projected"):
        compile_scene(scene_problem(effects, head=MASSLESS))
    run = simulate(
        scene_problem(effects, head=MASSLESS, scene='integrator = "projected"\nsubsteps = 4\n'), Gains(10, 7e3)
    )
    assert np.isfinite(run.position_m).all()
    late = (hand, WALL, 'kind = "jitter"\nrms_s = 1e-4')
    with pytest.raises(UnsupportedError, match="jitter"):
        compile_scene(scene_problem(late, head=MASSLESS))
