"""The observer from which a search begins is as fast in seconds at shorter samples; a law moves to another device."""

import numpy as np
import pytest
from robust_steps import step_at

import avc_casadi as avc
from avc_casadi.design.robust.cma_continuation import moved
from avc_casadi.design.robust.lqg import Space
from avc_casadi.loops.wall import Laws

STIFFNESS = 5000.0
SLOWEST = 3


def slowest_of_the_filter_per_s(problem):
    """Decay of the observer's error, from A (I - L C) of the law, written down anew."""
    law = Space(problem.device, problem.hands).law(Space(problem.device, problem.hands).starts[0], STIFFNESS)
    a, innovation = np.array(law.state), np.array(law.innovation)
    seen = np.zeros(len(a))
    seen[law.measures] = 1.0
    poles = np.linalg.eigvals(a @ (np.eye(len(a)) - np.outer(innovation, seen)))
    return -np.log(np.sort(np.abs(poles))[: -SLOWEST - 1 : -1]) / problem.device.sample_time_s


@pytest.mark.parametrize("name", ["reference-r1", "reference-r3"])
def test_a_shorter_sample_leaves_the_filter_as_it_is(name):
    whole = avc.load_problem(name)
    # Late by the same time, so that only the sampling differs.
    short = whole.changed(device={"sample_time_s": 0.25e-3, "delay_samples": 4})
    slow, fast = (slowest_of_the_filter_per_s(one) for one in (whole, short))
    np.testing.assert_allclose(fast, slow, rtol=0.35)


def test_a_longer_sample_does_not_ask_for_more_in_a_sample():
    whole = avc.load_problem("reference-r1")
    long = whole.changed(device={"sample_time_s": 2e-3}, frequency={"stop_hz": 200.0})
    starts = [{knob.name: knob.starts for knob in Space(one.device, one.hands).knobs} for one in (whole, long)]
    assert starts[0] == starts[1]


@pytest.mark.thorough
@pytest.mark.parametrize("change", [{"sample_time_s": 5e-4}, {"delay_samples": 0}, {"resonance": None}])
def test_a_law_moves_to_a_device_much_like_it(change):
    before = avc.load_problem("reference-r1").changed(environment={"stiffness_n_per_m": 1e6})
    changed = before.changed(device=change)
    step = step_at(before, STIFFNESS)
    found = moved(step, before, changed)
    assert found is not None
    assert found.stiffness_n_per_m == STIFFNESS
    old, new = Space(before.device, before.hands), Space(changed.device, changed.hands)
    away = dict(zip([knob.name for knob in old.knobs], step.best.logarithms - old.starts[0], strict=True))
    low, high = new.bounds
    inside = (found.best.logarithms > low) & (found.best.logarithms < high)
    there = found.best.logarithms - new.starts[0]
    assert inside.sum() > 4
    for place in np.flatnonzero(inside):
        assert there[place] == pytest.approx(away[new.knobs[place].name], abs=1e-12)
    assert np.isfinite(Laws.of(found.best.law).innovation).all()
