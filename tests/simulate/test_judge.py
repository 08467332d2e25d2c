"""Figures of a run: on signals whose figures are known, and on the loops whose behaviour is known."""

import math

import numpy as np
import pytest
from scene_reference import scene_problem

from avc_casadi.design.scene_coupling import simulate
from avc_casadi.model.gains import Gains
from avc_casadi.simulation.judge import Traces

T = 1e-3
TIME = np.arange(3000) * T
PRESS = ('kind = "hand"', 'kind = "wall"')


def test_ripple_is_the_rms_between_20_and_500_hz():
    force = (
        5.0 + 0.3 * np.sin(2 * np.pi * 60 * TIME) + 2.0 * np.sin(2 * np.pi * 10 * TIME) + 0.4 * np.cos(np.pi * TIME / T)
    )
    found = Traces(np.full(3000, 1e-3), np.zeros(3000), force, T).judge()
    assert found.force_ripple_n == pytest.approx(math.sqrt(0.3**2 / 2 + 0.4**2), rel=1e-9)
    assert found.buzzing
    calm = Traces(np.full(3000, 1e-3), np.zeros(3000), 5.0 + 0.48 * np.sin(2 * np.pi * 60 * TIME), T).judge()
    assert not calm.buzzing  # 0.48/sqrt(2) = 6.8 % of 5 N
    assert calm.apparent_stiffness_n_per_m == pytest.approx(5000.0)


def test_what_is_felt_is_what_the_hand_holds():
    """2 um at 80 Hz are 1.25 thresholds, and a motor that moves by a tenth of it is not felt."""
    held = 2e-6 * np.sin(2 * np.pi * 80 * TIME)
    ringing = Traces(0.1 * held, np.zeros(3000), np.zeros(3000), T, handle_m=held, handle_m_per_s=np.gradient(held, T))
    assert ringing.vibration == pytest.approx(1.25, rel=1e-2)
    assert ringing.judge().peak_velocity_m_per_s == pytest.approx(2e-6 * 2 * np.pi * 80, rel=0.05)
    assert Traces(held, np.zeros(3000), np.zeros(3000), T).vibration == pytest.approx(1.25, rel=1e-2)
    assert Traces(2 * held, np.zeros(3000), np.zeros(3000), T, 0.5).vibration == pytest.approx(1.25, rel=1e-2)


def test_rate_hardness_is_the_first_rise_over_the_speed_of_contact():
    force = np.where(TIME >= 1.0, 700.0 * (TIME - 1.0 + T), 0.0)
    found = Traces(np.zeros(3000), np.full(3000, 0.07), force, T).judge()
    assert found.rate_hardness_n_per_m == pytest.approx(1e4, rel=1e-6)
    assert math.isnan(Traces(np.zeros(3000), np.ones(3000), np.zeros(3000), T).judge().rate_hardness_n_per_m)


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e200])
def test_a_run_whose_numbers_leave_is_neither_stable_nor_calm(bad):
    position = np.where(TIME > 2.0, bad, 0.0)
    found = Traces(position, np.zeros(3000), position, T).judge()
    assert found.diverged
    assert not found.stable
    assert found.buzzing
    assert np.isnan(found.apparent_stiffness_n_per_m)


@pytest.mark.parametrize(
    ("gains", "share"),
    [
        (Gains(10.0, 7e3), 0.065),
        (Gains(2.0, 18.6e3), 0.157),
        (Gains(200.0, 1e5), 0.5),
        (Gains(math.inf, math.inf, 85.0), 1.0),
    ],
)
def test_pressed_walls_feel_as_stiff_as_springs_in_series(gains, share):
    run = simulate(scene_problem(PRESS), gains)
    assert run.claim == "asymptotic"
    assert run.apparent_stiffness_n_per_m / 1e5 == pytest.approx(share, abs=0.002)
    k = gains.stiffness_n_per_m
    series = 1e5 if gains.rigid else k * 1e5 / (k + 1e5)
    assert run.apparent_stiffness_n_per_m == pytest.approx(series, rel=1e-6)
