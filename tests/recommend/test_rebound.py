"""How fast a released device leaves the wall is told: as on a device written here, and where it gains in a row."""

import copy

import numpy as np
import pytest
from exported import Exported
from scipy.integrate import solve_ivp

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.model.gains import Gains
from avc_casadi.present.row import Value
from avc_casadi.present.rows.recommend import wall_rows
from avc_casadi.recommendation.rebound import rebound

T, MASS, DAMPING, STEP, WALL = 1e-3, 0.12, 0.4, 2e-5, 1500.0


def problem(delay, friction):
    device = {"mass_kg": MASS, "damping_ns_per_m": DAMPING, "sample_time_s": T, "encoder_resolution_m": STEP}
    device |= {"delay_samples": delay, "coulomb_friction_n": friction, "max_force_n": 40.0}
    return avc.load_problem("spring").changed(
        device=device, environment={"stiffness_n_per_m": WALL, "damping_ns_per_m": 0.0}
    )


def struck(coupling, delay, friction, speed, phase):
    """Throw a released device at the wall; return the speed at which it leaves over that at which it came."""
    law, substeps = Exported(coupling), 200
    x, v, came, h = -0.03 - phase * STEP, speed, 0.0, T / substeps
    queue = [0.0] * delay
    for _ in range(3000):
        queue.append(law.step(round(x / STEP) * STEP))
        force = queue.pop(0)
        for _ in range(substeps):
            v -= h / MASS * (force + DAMPING * v)
            v -= np.sign(v) * min(abs(v), h * friction / MASS)
            before, x = x, x + h * v
            if before <= 0 < x:
                came = v
            if x <= 0 < before:
                return came, -v / came
    return came, 0.0


def thrown(speed, friction):
    """Return the speed 30 mm before the wall of a device that reaches it at a speed."""
    away = solve_ivp(lambda _, v: (friction / v + DAMPING) / MASS, (0.0, 0.03), [speed], rtol=1e-9)
    return away.y[0, -1]


@pytest.mark.parametrize(("delay", "damper", "friction"), [(0, 0.0, 0.0), (1, 6.0, 0.0)])
def test_the_rebound_is_that_of_a_device_that_is_thrown(delay, damper, friction):
    stated = problem(delay, friction)
    coupling = Coupling.constant(stated, Gains(0.0, 1e9, damper), "mine")
    told = rebound(coupling)
    for key, share in told.items():
        speed = float(key)
        found = [
            struck(coupling, delay, off, thrown(speed, off), phase)
            for off in {friction, 0.0}
            for phase in (0.0, 0.25, 0.5, 0.75)
        ]
        assert [came for came, _ in found] == pytest.approx([speed] * len(found), rel=0.05)
        assert share == pytest.approx(max(one for _, one in found), rel=0.05)


def test_a_late_spring_gives_energy_and_a_damper_takes_it():
    late = rebound(Coupling.constant(problem(1, 0.0), Gains(0.0, 1e9, 0.0), "mine"))
    damped = rebound(Coupling.constant(problem(1, 0.0), Gains(0.0, 1e9, 6.0), "mine"))
    assert min(late.values()) > 1.05
    assert max(damped.values()) < 1.0


@pytest.mark.thorough
def test_it_is_a_row_where_the_device_gains_speed_and_none_where_it_does_not():
    found = avc.recommend("spring", hands=10)
    data = copy.deepcopy(found.data())
    assert max(data["felt"]["rebound"].values()) < 1.0
    assert "Rebound" not in {row.label for row in wall_rows(data, found.problem)}
    data["felt"]["rebound"] = {"0.1": 1.19, "0.4": 0.96}
    (told,) = (row for row in wall_rows(data, found.problem) if row.label == "Rebound")
    assert [value.number for value in told.values if isinstance(value, Value)] == [1.19, 0.1]
