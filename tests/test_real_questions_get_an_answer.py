"""What users ask of a device that shakes: each as a log of a simulator of its own, with the answer, or none."""

import re
from dataclasses import replace

import numpy as np
import pytest
from buzzing_cases import declared_of, rests
from buzzing_device import Buzzing, logged

from avc_casadi.identification.diagnosis.diagnose import diagnose
from avc_casadi.identification.record import Columns

HAND = {"hand_mass": 0.12, "hand_damping": 8.0, "hand_stiffness": 400.0}
FALCON = Buzzing(mass=0.35, damping=1.5, friction=0.1, delay=1.5, encoder=3.8e-5, limit=8.0, end=0.004, **HAND)
GRIPPER = Buzzing(mass=0.08, damping=0.8, delay=2.0, encoder=2e-5, limit=10.0, grab=0.05, two_sided=1.0, **HAND)
KNOB = Buzzing(mass=0.03, damping=0.05, encoder=1e-4, limit=3.0, two_sided=1.0, release=0.0, start=-4e-4)


def log(loop):
    return Columns("log", *logged(loop, 1500 * loop.period))


def answer(loop, meant=None, **known):
    return diagnose(log(loop), device=declared_of(meant or loop), **known)


@pytest.mark.parametrize(("stiffness", "damper"), [(0.0, 0.0), (3000.0, 20.0)])
def test_falcon_vibrates_when_5_n_are_switched_on_in_contact(stiffness, damper):
    """The force goes with the contact: at its edge it jumps."""
    wall = replace(FALCON, stiffness=stiffness, damper=damper)
    found = answer(replace(wall, bias=5.0, bias_from=0.5))
    assert (found.verdict, found.cause) == ("named", "stiffness")
    assert float(re.search(r"jumps by ([\d.]+)", found.conclusion)[1]) == pytest.approx(5.0, abs=0.2)
    # Nothing else of that wall is wrong.
    if stiffness:
        assert answer(wall).verdict == "nothing wrong"


@pytest.mark.thorough
def test_motors_shake_when_an_object_is_grabbed_over_one_step_of_the_encoder():
    """The damper makes 1.6 N of every step: it is the encoder, though the swing has but one of its steps."""
    found = answer(replace(GRIPPER, stiffness=2000.0, damper=80.0), GRIPPER)
    assert found.oscillation.steps < 2
    assert (found.verdict, found.cause) == ("named", "encoder"), found.conclusion
    finer = next(cure.value for cure in found.cures if cure.key == "encoder_resolution_m")
    cured = replace(GRIPPER, stiffness=2000.0, damper=80.0, encoder=finer)
    assert rests(logged(cured, 1.5)[1], cured.period, cured.encoder)


@pytest.mark.thorough
def test_knob_twitches_at_rest():
    """Nobody holds it, and its damper swings it without a hand, whatever the encoder: four steps of it tell so much."""
    found = answer(replace(KNOB, stiffness=300.0, damper=25.0))
    assert found.oscillation.steps < 5
    assert (found.verdict, found.cause) == ("named", "let-go"), found.conclusion
    assert found.measured.growth_per_s > 0
    softer = next(cure.value for cure in found.cures if cure.key == "damping_ns_per_m")
    quiet = replace(KNOB, stiffness=300.0, damper=softer)
    swung, left = (np.ptp(logged(one, 1.5)[1][-300:]) for one in (replace(quiet, damper=25.0), quiet))
    assert left < 0.5 * swung


@pytest.mark.thorough
def test_device_oscillates_since_its_rate_was_halved():
    meant = Buzzing(encoder=5e-6, stiffness=10000.0, damper=12.0)
    found = answer(replace(meant, period=2e-3), meant)
    assert (found.verdict, found.cause) == ("named", "rate"), found.conclusion
    assert found.cures[0].value == pytest.approx(1e-3)
    assert answer(meant).verdict == "nothing wrong"


def test_gains_that_were_set_for_the_worst_case_leave_nothing_to_find():
    """Such a log rests: it is soft, not wrong, and what more could be had is the question of avc recommend."""
    found = answer(Buzzing(encoder=5e-6, stiffness=600.0, damper=2.0))
    assert found.verdict == "nothing wrong"
    assert found.law.stiffness_n_per_m == pytest.approx(600.0, rel=1e-3)


@pytest.mark.thorough
def test_notch_that_is_offered_for_a_resonance_cures_it():
    meant = Buzzing(encoder=5e-6, stiffness=3000.0, damper=40.0)
    wrong = replace(meant, resonance=110.0, ratio=0.02)
    found = answer(wrong, meant)
    assert found.cause == "resonance", found.conclusion
    notch = next(cure for cure in found.cures if cure.key == "notch_hz")
    depth, width = map(float, re.search(r"depth ([\d.]+), width ([\d.]+)", notch.change).groups())
    for beside in (0.95, 1.0, 1.05):
        cured = replace(wrong, notch=beside * notch.value, depth=depth, width=width)
        assert rests(logged(cured, 1.5)[1], cured.period, cured.encoder)
    assert any("resonance = {" in note for note in found.notes)


@pytest.mark.parametrize(("size", "unit"), [(1e3, "mm read as m"), (1e-3, "mm read as um"), (1 / 5e-6, "counts")])
def test_positions_in_another_unit_are_noticed(size, unit):
    meant = Buzzing(encoder=5e-6, stiffness=3000.0, damper=12.0)
    time, position, force = logged(replace(meant, delay=7.0), 1.0)
    found = diagnose(Columns("log", time, size * position, force), device=declared_of(meant))
    assert found.verdict == "cannot tell"
    assert unit in found.conclusion


@pytest.mark.thorough
def test_delay_and_stiffness_that_are_both_too_much_are_both_told():
    """Late by four samples, and too stiff without that too: to name one of them would mend half of it."""
    meant = Buzzing(encoder=5e-6, stiffness=2000.0, damper=2.0, delay=1.0)
    both = replace(meant, stiffness=12000.0, delay=5.0)
    for half in (replace(both, delay=1.0), replace(both, stiffness=2000.0), both):
        assert not rests(logged(half, 1.5)[1], half.period, half.encoder)
    found = answer(both, meant)
    assert found.verdict == "cannot tell", found.conclusion
    assert set(found.candidates) == {"delay", "stiffness"}
    assert {"delay_samples", "stiffness_n_per_m"} <= {cure.key for cure in found.cures}
