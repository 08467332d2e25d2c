"""What the search works out at once, by halves or by bounds is what one after the other gives."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import avc_casadi as avc
from avc_casadi.design.robust.goal import cost_of, costs_of
from avc_casadi.design.robust.lqg import Space
from avc_casadi.design.robust.uncertainty_set import Loops
from avc_casadi.loops.spectrum import eigenvalues, leading_radii, worst_radius
from avc_casadi.loops.wall import Laws, frozen_rendering, stiffness_at_rest
from avc_casadi.loops.walls import loop_radius, stiffest_wall
from avc_casadi.model.hands import hand_corners, with_released


@st.composite
def groups_of_loops(draw):
    """Loops as they come: near the unit circle, in units that lie far apart, defective, unstable, equal."""
    seed, s, p, decades = (draw(st.integers(*span)) for span in ((0, 10**6), (2, 17), (1, 9), (0, 6)))
    rng = np.random.default_rng(seed)
    loops = rng.standard_normal((3, p, s, s)) / np.sqrt(s)
    loops /= np.abs(np.linalg.eigvals(loops)).max(axis=-1)[..., None, None]
    loops *= 1 + draw(st.sampled_from([1e-2, 1e-4, 1e-9])) * rng.standard_normal((3, p, 1, 1))
    if draw(st.booleans()):
        loops[0] = np.diag(np.ones(s - 1), 1)
    if draw(st.booleans()):
        loops[1, -1] = loops[1, 0]
    if draw(st.booleans()):
        loops[2] *= 0.7
    unit = 10.0 ** rng.uniform(-decades, decades, s)
    return loops * unit[:, None] / unit


@given(groups_of_loops())
def test_worst_radius_is_that_of_all_eigenvalues(loops):
    by_all = np.abs(np.linalg.eigvals(loops)).max(axis=(-2, -1))
    np.testing.assert_array_equal(worst_radius(loops), by_all)


@given(groups_of_loops(), st.integers(1, 10))
def test_leading_radii_are_the_largest_of_all(loops, leaders):
    by_all = np.abs(np.linalg.eigvals(loops)).max(axis=-1)
    found = leading_radii(loops, leaders)
    known = np.isfinite(found)
    np.testing.assert_array_equal(found[known], by_all[known])
    np.testing.assert_array_equal(*(np.sort(radii, axis=-1)[:, -leaders:] for radii in (found, by_all)))


@pytest.mark.parametrize("count", [1, 47, 48, 101])
def test_eigenvalues_by_halves_are_those_of_each(count):
    matrices = np.random.default_rng(count).standard_normal((count, 5, 5))
    each = np.array([np.linalg.eigvals(one).astype(np.complex128) for one in matrices])
    found = eigenvalues(matrices.reshape(1, count, 5, 5))
    assert found.shape == (1, count, 5)
    np.testing.assert_array_equal(found[0], each)


@pytest.mark.parametrize("name", ["figure5", "reference-r3"])
def test_many_laws_at_once_are_those_one_by_one(name):
    problem = avc.load_problem(name)
    space, rng = Space(problem.device, problem.hands), np.random.default_rng(5)
    rendering = frozen_rendering(problem, 0.0, problem.environment.stiffness_n_per_m)
    stiffness = stiffness_at_rest(rendering)
    points = np.clip(space.starts[0] + 0.5 * rng.standard_normal((8, len(space.knobs))), *space.bounds)
    one_by_one = [space.law(point, stiffness) for point in points]
    quick = space.laws(points, stiffness)
    for row, law in enumerate(one_by_one):
        for part, exact in vars(Laws.of(law)).items():
            found = getattr(quick, part)
            if not isinstance(exact, np.ndarray):
                assert found == exact
                continue
            np.testing.assert_allclose(found[row], exact[0], rtol=1e-9, atol=1e-9 * np.abs(exact).max())
    loops = Loops.of(problem).hardest(one_by_one[0], rendering)
    at_once = costs_of(quick, rendering, loops)
    assert at_once[:3] == costs_of(quick.pick(np.arange(3)), rendering, loops)
    singly = [cost_of(law, rendering, loops).total for law in one_by_one]
    np.testing.assert_allclose([cost.total for cost in at_once], singly, rtol=1e-7)
    assert len(set(np.isfinite(singly))) == 1


def test_a_point_without_a_law_costs_more_than_any_other():
    problem = avc.load_problem("reference-r1")
    space = Space(problem.device, problem.hands)
    rendering = frozen_rendering(problem, 0.0, problem.environment.stiffness_n_per_m)
    points = np.stack([space.starts[0], np.full(len(space.knobs), np.nan)])
    with np.errstate(invalid="ignore"):
        laws = space.laws(points, stiffness_at_rest(rendering))
    found, none = costs_of(laws, rendering, Loops.of(problem))
    assert np.isfinite(found.total)
    assert none.total == np.inf


def test_stiffest_wall_lies_between_dampings_that_hold_and_none():
    problem = avc.load_problem("reference-r2")
    people = with_released(hand_corners(problem.hands))
    found = stiffest_wall(problem.device, people)
    damping = np.linspace(found.lowest_ns_per_m, found.highest_ns_per_m, 3)
    for share, holds in ((1.0, True), (1.001, False)):
        stiffness = np.full(len(damping), share * found.stiffness_n_per_m)
        assert (loop_radius(problem.device, people, stiffness, damping) < 1).all(axis=1).any() == holds


@pytest.mark.parametrize("error", [ValueError("reordering failed"), np.linalg.LinAlgError("no solution")])
def test_a_law_is_found_where_the_order_of_eigenvalues_is_lost(error, monkeypatch):
    problem = avc.load_problem("reference-r1")
    space = Space(problem.device, problem.hands)
    precise = Laws.of(space.law(space.starts[0], 5000.0))

    def lost(*_):
        raise error

    monkeypatch.setattr("scipy.linalg.solve_discrete_are", lost)
    again = Laws.of(space.law(space.starts[0], 5000.0))
    for part in ("innovation", "feedback"):
        np.testing.assert_allclose(getattr(again, part), getattr(precise, part), rtol=1e-6, atol=1e-9)
    with pytest.raises(np.linalg.LinAlgError), np.errstate(invalid="ignore"):
        space.law(np.full(len(space.knobs), np.nan), 5000.0)
