"""At a gain margin of a law with state feedback the spectral radius is 1."""

from dataclasses import replace

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.loops.loop import Body
from avc_casadi.loops.margins import OpenLoop
from avc_casadi.loops.wall import closed, law_at_rest
from avc_casadi.model.gains import Gains
from avc_casadi.model.hands import hand_corners, with_released
from avc_casadi.model.plant import sampled_plant


@pytest.fixture(scope="module")
def fed_back():
    """A coupling with an observer and state feedback."""
    problem = avc.load_problem("reference-r2")
    return Coupling.from_schedule(problem, avc.solve(problem, "robust"))


def test_a_damper_that_is_thin_at_an_end_of_a_range_is_not_deployable():
    """At two samples of delay a tenth more of motor gain or less of mass makes the released device swing."""
    device = {"mass_kg": 0.15, "damping_ns_per_m": 0.6, "delay_samples": 1, "encoder_resolution_m": 1e-5}
    problem = avc.load_problem("spring").changed(device=device, environment={"stiffness_n_per_m": 5e3})
    later = problem.changed(device={"range": {"delay_samples": (1, 2)}})
    one, other = (avc.deployable(Coupling.constant(some, Gains(0.0, 1e12, 14.07), "x")) for some in (problem, later))
    assert one.passed
    assert [claim.name for claim in other.claims if not claim.passed] == ["disk-margin"]


@pytest.mark.slow
def test_with_state_feedback_the_observer_knows_the_force_that_was_asked_for(fed_back):
    """The loop of the project itself, its device pushed by so many times the force."""
    problem, law = fed_back.problem, law_at_rest(fed_back)
    assert law.sectors
    corners = with_released(hand_corners(problem.hands))
    body = Body.of(sampled_plant(problem.device, corners)).flat()

    def radii(factor):
        # Forces under way are what was asked for: the factor stands where they reach the device.
        moved, under_way = body.a.copy(), body.size - len(body.names)
        first = body.b.copy()
        if under_way:
            states = len(body.names)
            moved[:, :states, states:] *= factor
            first[:, :states] *= factor
        else:
            first *= factor
        pushed = replace(body, a=moved, b=first)
        return np.abs(np.linalg.eigvals(closed(pushed, law).maps)).max(axis=-1)

    released, held = OpenLoop.of(fed_back).margins()
    for found, some in ((released, slice(-1, None)), (held, slice(-1))):
        assert radii(1.0)[some].max() < 1
        assert radii(found.gain)[some].max() == pytest.approx(1, abs=1e-8)
        assert radii(1.001 * found.gain)[some].max() > 1
        if found.gain_down:
            assert radii(found.gain_down)[some].max() == pytest.approx(1, abs=1e-8)


def swing_on_a_late_spring(mass_kg, damping_ns_per_m, stiffness_n_per_m, ticks):
    """Return the largest position in each half of a simulation of a device on a spring that acts a sample late."""
    decay = np.exp(-damping_ns_per_m * 1e-3 / mass_kg)
    position, speed, late, seen = 1e-3, 0.0, 0.0, []
    for _ in range(ticks):
        late, force = stiffness_n_per_m * position, -late
        final = force / damping_ns_per_m
        position += final * 1e-3 + (speed - final) * (1 - decay) * mass_kg / damping_ns_per_m
        speed = final + (speed - final) * decay
        seen.append(abs(position))
    return max(seen[: ticks // 2]), max(seen[ticks // 2 :])


@pytest.mark.parametrize("damping", [0.6, 5.0, 6.5, 8.0, 20.0])
def test_a_loop_has_margins_just_where_its_swing_dies_away(damping):
    device = {"mass_kg": 0.15, "damping_ns_per_m": damping, "delay_samples": 1}
    problem = avc.load_problem("spring").changed(device=device, environment={"stiffness_n_per_m": 5e3})
    released, _ = OpenLoop.of(Coupling.constant(problem, Gains(0.0, 1e12), "spring")).margins()
    first, second = swing_on_a_late_spring(0.15, damping, 5e3, 2000)
    margins = (released.gain - 1, released.phase_deg, released.delay_samples, released.disk)
    if second < first:
        assert min(margins) > 0
    else:
        assert margins == (0, 0, 0, 0)
