"""A law is searched before few loops of many; those that its numbers make the hardest are looked at on the way."""

import numpy as np
import pytest
from robust_steps import step_at

import avc_casadi as avc
from avc_casadi.design.robust.cma_continuation import continuation
from avc_casadi.design.robust.goal import DECAY_PER_S, RANGED_DECAY_PER_S, cost_of
from avc_casadi.design.robust.lqg import Space
from avc_casadi.design.robust.uncertainty_set import Loops
from avc_casadi.loops.loop import Body
from avc_casadi.loops.spectrum import largest_radius
from avc_casadi.loops.wall import Laws, frozen_rendering, observed_wall
from avc_casadi.model.corners import device_corners
from avc_casadi.model.gains import spring_before
from avc_casadi.model.hands import hand_corners
from avc_casadi.model.sampled_plant import sampled_plant


@pytest.fixture(scope="module")
def known_to_a_tenth():
    """R1, each of its numbers known to a tenth: 128 corners and some between."""
    problem = avc.load_problem("reference-r1")
    device = problem.device
    tenth = {
        key: (0.9 * getattr(device, key), 1.1 * getattr(device, key))
        for key in ("mass_kg", "damping_ns_per_m", "delay_samples", "amplifier_bandwidth_hz")
    }
    mode = {key: (0.9 * value, 1.1 * value) for key, value in device.resonance.model_dump().items()}
    return problem.changed(
        device={"range": {**tenth, "resonance": mode}},
        environment={"stiffness_n_per_m": 2e4, "damping_ns_per_m": 0.0},
    )


def rendered(problem, stiffness):
    return frozen_rendering(problem, 0.0, spring_before(problem, stiffness))


@pytest.mark.thorough
def test_a_stiffer_wall_is_reached_from_a_softer_one_on_a_device_of_many_corners(known_to_a_tenth):
    problem = known_to_a_tenth
    space, loops = Space(problem.device, problem.hands), Loops.of(problem)
    stiff = rendered(problem, 5000.0)
    steps = continuation(problem, space.starts[0], (2500.0, 5000.0))
    assert steps[-1].stiffness_n_per_m == 5000.0
    found = steps[-1].best
    assert found.cost.holds
    for plants in (loops.nominal, loops.varied, loops.free):
        assert largest_radius(observed_wall(plants, Laws.of(found.law), stiff)[0]).max() < 1
    shares = np.linspace(0.01, 1.0, 34)
    assert largest_radius(observed_wall(loops.ranged, Laws.of(found.law), stiff, shares)[0]).max() < 1


@pytest.mark.thorough
def test_on_devices_within_the_ranges_any_share_of_the_innovation_may_pass():
    alone = avc.load_problem("reference-r1").changed(environment={"stiffness_n_per_m": 1e5, "damping_ns_per_m": 0.0})
    ranged = alone.changed(device={"range": {"delay_samples": (0.5, 1.5), "mass_kg": (0.08, 0.12)}})
    before, loops = (Loops.of(one) for one in (alone, ranged))
    rendering = rendered(alone, 6000.0)
    law = step_at(alone, 6000.0).best.law
    assert before.ranged is None
    hands, devices = hand_corners(ranged.hands), device_corners(ranged.device)
    plants = Body.of(sampled_plant(devices, hands)).flat()
    corners = largest_radius(observed_wall(plants, Laws.of(law), rendering, tuple(RANGED_DECAY_PER_S))[0])
    nominal = largest_radius(observed_wall(loops.nominal, Laws.of(law), rendering, tuple(DECAY_PER_S))[0])
    cost = cost_of(law, rendering, loops)
    every = largest_radius(observed_wall(loops.ranged, Laws.of(law), rendering, tuple(RANGED_DECAY_PER_S))[0])
    assert corners.max() <= every.max()
    assert cost.radius_any_share == pytest.approx(max(every.max(), nominal.max()), abs=1e-12)
    assert cost_of(law, rendering, before).radius_any_share == pytest.approx(nominal.max(), abs=1e-12)
    assert cost.total > cost_of(law, rendering, before).total


def test_loops_that_are_kept_with_others_stand_once(known_to_a_tenth):
    problem = known_to_a_tenth
    space, loops = Space(problem.device, problem.hands), Loops.of(problem)
    rendering = rendered(problem, 5000.0)
    one, other = (loops.hardest(space.law(start, 5000.0), rendering) for start in space.starts[:2])
    both = one.and_of(other)
    for all_of, part in ((loops.varied, both.varied), (loops.nominal, both.nominal)):
        rows = {matrix.tobytes() for matrix in part.a}
        assert len(rows) == len(part.a)
        assert rows <= {matrix.tobytes() for matrix in all_of.a}
    assert {row.tobytes() for row in both.varied.a} == {row.tobytes() for part in (one, other) for row in part.varied.a}
    same = one.and_of(one)
    assert np.array_equal(same.varied.a, one.varied.a)
    assert np.array_equal(same.varied.b, one.varied.b)


@pytest.mark.thorough
def test_only_the_robust_method_keeps_all_ranges_and_the_others_say_so(known_to_a_tenth):
    problem = known_to_a_tenth.changed(environment={"stiffness_n_per_m": 2000.0})
    told = {method: " ".join(avc.solve(problem, method).notes) for method in ("robust", "static")}
    assert "designed for the nominal value" not in told["robust"]
    assert "designed for the nominal value of device.range.delay_samples" in told["static"]
