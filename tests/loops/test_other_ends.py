"""Each part of a coupling to an engine or a second device against integrators, clocks and loops written out."""

import numpy as np
import pytest

from avc_casadi.loops.engine import Engine, clocks
from avc_casadi.loops.loop import Body
from avc_casadi.model.virtual_tool import RIGID_N_PER_M, ToolGains, ToolState, VirtualTool, tool_states

T = 1e-3


def engine(**keys):
    return VirtualTool.model_validate({"tool_mass_kg": 0.2, "step_s": 4e-3} | keys)


INTEGRATORS = {
    "semi-implicit": lambda m, c, k, t: np.array(
        [[1 - t**2 * k / m, t * (1 - t * c / m)], [-t * k / m, 1 - t * c / m]]
    ),
    "explicit": lambda m, c, k, t: np.array([[1, t], [-t * k / m, 1 - t * c / m]]),
    "implicit": lambda m, c, k, t: np.linalg.inv([[1, -t], [t * k / m, 1 + t * c / m]]),
}


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_a_tool_in_contact_moves_as_its_integrator_has_it(integrator):
    tool, step_s = ToolState(0.2, 0.7, 900.0, 5.0), 4e-3
    loop = Engine(Body.driven(T), clocks(step_s, T)[0], engine(integrator=integrator), [tool])
    np.testing.assert_allclose(loop.alone()[0], INTEGRATORS[integrator](0.2, 5.7, 900.0, step_s), rtol=1e-9)


@pytest.mark.parametrize("ratio", [1.0, 4.0, 2.5])
def test_a_tool_that_stands_still_is_a_spring_and_a_damper(ratio):
    rigid = tool_states(engine(), RIGID_N_PER_M)[-1]
    loop = Engine(Body.driven(T), clocks(ratio * T, T)[-1], engine(), [rigid])
    turn = np.exp(-2j * np.pi * 12.0 * T)
    found = loop.force_per_metre(ToolGains(800.0, 6.0, 2.0), 12.0)
    assert found == pytest.approx(800.0 + 8.0 * (1 - turn) / T)


@pytest.mark.parametrize(("sooner", "later"), [("ahead", "on-time"), ("on-time", "late")])
def test_an_exchange_hands_out_a_tool_one_step_before_the_next(sooner, later):
    """Of a free tool on a soft coupling: its position lags by a step more."""
    free, gains, hz = tool_states(engine(), 0.0)[-1], ToolGains(300.0, 4.0), 10.0
    clock = clocks(4e-3, T)[0]
    before, after = (
        Engine(Body.driven(T), clock, engine(exchange=one), [free]).force_per_metre(gains, hz)
        for one in (sooner, later)
    )
    spring = gains.stiffness_n_per_m + gains.damping_ns_per_m * 2j * np.pi * hz
    turned = np.angle((spring - before) / (spring - after))
    assert turned == pytest.approx(2 * np.pi * hz * 4e-3, rel=0.2)
