"""Unknown and impossible scenes are refused by name, all faults at once, before anything runs."""

import pytest
from scene_reference import scene_problem

from avc_casadi import InputError
from avc_casadi.simulation.compile import compile_scene

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
