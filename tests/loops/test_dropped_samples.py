"""A lighter device, missed samples: told as a plant of its own says, and kept where asked for."""

from pathlib import Path

import numpy as np
import pytest
from whole_device import WholeDevice, rests_as_tried

import avc_casadi as avc
import avc_hardware
from avc_casadi.model.robustness import Robustness, unmodelled
from avc_casadi.simulation.population.operators import people_of
from avc_casadi.simulation.population.settled import residual_speeds

COUPLINGS = Path(__file__).parents[1] / "goldens" / "couplings"
HANDS = 24


def coupling(name="reference-r1"):
    return avc.read_coupling(COUPLINGS / f"{name}.json")


def everybody(found):
    hands = people_of(found.problem.hands, HANDS, 3)
    return hands, np.array([hands.mass_kg, hands.damping_ns_per_m, hands.stiffness_n_per_m]).T


def told(found, asked, hands):
    (one,) = unmodelled(found.problem.device, asked)
    return residual_speeds([found], hands, friction=False, device=one.device, effects=one.effects)[0] < 1


@pytest.mark.thorough
@pytest.mark.parametrize("share", [0.2, 0.5])
def test_hands_at_a_lighter_device_are_those_of_another_plant(share):
    found = coupling()
    hands, numbers = everybody(found)
    bench = WholeDevice(found.problem.device, avc_hardware.export_c(found))
    light = (1 - share) * found.problem.device.mass_kg
    seen = rests_as_tried(bench, found.problem.device, numbers, friction=0.0, mass=light)
    assert np.sum(seen != told(found, Robustness(mass_share=share), hands)) <= HANDS / 6


def test_missed_samples_move_nobody_where_another_plant_sees_nobody_move():
    found = coupling()
    hands, numbers = everybody(found)
    bench = WholeDevice(found.problem.device, avc_hardware.export_c(found))
    assert rests_as_tried(bench, found.problem.device, numbers[:8], friction=0.0, dropped=1e-3).all()
    assert told(found, Robustness(dropped_share=1e-3), hands.pick(slice(8))).all()
