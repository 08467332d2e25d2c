"""Numbers behind an excitation: its centring, its strength, its ramps."""

import numpy as np
import pytest

from avc_casadi.identification.excitation.design import plan_excitation
from avc_casadi.identification.excitation.plan import speed_window
from avc_casadi.identification.excitation.signal import WHOLE, ramp
from avc_casadi.model.device import Device

T = 1e-3


@pytest.mark.parametrize("force_n", [0.5, 5.0])
def test_the_centring_swings_slowly_beside_its_delay_and_leaves_half_the_force(force_n):
    ranges = {"mass_kg": (0.05, 0.2)}
    device = Device(mass_kg=0.2, damping_ns_per_m=1.0, delay_samples=20, max_force_n=2 * force_n, range=ranges)
    plan = plan_excitation(device, seconds=2.0, force_n=force_n).plan
    late_s = (20 + 1.5 + plan.window / 2) * T
    assert np.sqrt(plan.spring_n_per_m / 0.05) * late_s <= 0.3 * (1 + 1e-9)
    assert plan.spring_n_per_m * plan.max_travel_m <= 0.5 * force_n * (1 + 1e-9)


@pytest.mark.parametrize("steps", [0.3, 1.0, 2.4, 7.01])
def test_a_velocity_is_taken_over_enough_ticks_for_a_tenth_of_its_limit(steps):
    speed = 0.3
    count = steps * 0.1 * speed * T
    window = speed_window(count, T, speed)
    assert count / (window * T) <= 0.1 * speed * (1 + 1e-9)
    assert window == 1 or count / ((window - 1) * T) > 0.1 * speed


def test_a_signal_fades_out_as_it_fades_in():
    found = ramp(400, 50)
    np.testing.assert_array_equal(found, found[::-1])
    assert found[0] < 0.05 * WHOLE
    assert set(found[60:-60]) == {WHOLE}
