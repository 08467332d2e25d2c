"""Numbers behind an excitation: its centring, its strength, its ramps."""

from types import SimpleNamespace

import numpy as np
import pytest

from avc_casadi.identification.excitation import design as _design
from avc_casadi.identification.excitation.plan import speed_window
from avc_casadi.identification.excitation.signal import WHOLE, ramp
from avc_casadi.model.device import Device

T = 1e-3


@pytest.mark.parametrize("force_n", [0.5, 5.0, 500.0])
def test_the_centring_swings_slowly_beside_its_delay_and_leaves_half_the_force(force_n):
    travel_m, window = 0.02, 4
    devices = [Device(mass_kg=mass, damping_ns_per_m=1.0, sample_time_s=T, delay_samples=20) for mass in (0.2, 0.05)]
    devices = [one.model_copy(update={"coulomb_friction_n": 0.4 * force_n}) for one in devices]
    spring, _ = _design._centring(devices, force_n, travel_m, window)
    late_s = (20 + 1.5 + window / 2) * T
    assert np.sqrt(spring / 0.05) * late_s <= 0.3 * (1 + 1e-9)
    assert spring * travel_m <= 0.5 * force_n * (1 + 1e-9)


def test_a_signal_is_no_stronger_than_the_weakest_that_comes_near_a_limit(monkeypatch):
    """A stronger one may be kept by friction or by its phase: it is none that is taken."""
    plan = SimpleNamespace(max_force_n=1.0, max_speed_m_per_s=1.0, max_travel_m=1.0)
    reached = np.array([[0.1, 0.2, 0.95, 0.3]])
    found = SimpleNamespace(force_n=0.0 * reached, speed_m_per_s=reached, travel_m=0.0 * reached)
    monkeypatch.setattr(_design, "forecast", lambda *_: found)
    assert _design._largest(plan, (), np.array([1.0, 2.0, 3.0, 4.0]), None) == 2.0


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
