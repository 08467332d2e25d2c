"""A heavy device in a loose hand swings for seconds with no wall near; no coupling is blamed for that."""

import numpy as np
import pytest
from exported import Exported
from hypothesis import given, settings
from hypothesis import strategies as st
from sampled_wall import spectral_radius
from scipy.linalg import expm
from scipy.signal import StateSpace, lsim

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.loops.plant_family import PlantFamily
from avc_casadi.loops.stable_walls import damping_range, stiffest_wall
from avc_casadi.model.corners import linear_values
from avc_casadi.model.gains import Gains, near_rigid_n_per_m
from avc_casadi.model.hands import hand_corners
from avc_casadi.recommendation.evaluator import least_stable_devices, try_perturbed_devices
from avc_casadi.simulation.compile import target_of
from avc_casadi.simulation.judge import AT_REST_M_PER_S
from avc_casadi.simulation.population.motions import LONGEST_S, MOTIONS, TRIAL_S, course_of
from avc_casadi.simulation.population.operators import BLOCK, draw_hands, draw_population
from avc_casadi.simulation.population.trial import count_at_rest, residual_speeds, try_coupling

JUDGED_S = 0.5
R1 = avc.load_problem("reference-r1")
# 5 kg without damping, held by 50 to 300 g with 3 to 20 N.s/m: one swing dies away in 2 m / b, up to 3.5 s.
HEAVY = avc.load_problem("figure5").changed(
    device={"mass_kg": 5.0, "damping_ns_per_m": 0.0, "delay_samples": 1},
    environment={"stiffness_n_per_m": 1000.0, "damping_ns_per_m": 0.0},
)
PEOPLE = hand_corners(HEAVY.hands)


def softly(problem, contact_damping_ns_per_m=30.0):
    gains = Gains(0.0, 1000.0, contact_damping_ns_per_m)
    return Coupling.constant(problem, gains, "by hand")


def speed_alone(problem, motion, duration_s):
    """Largest speed at the end, of all hands with the device and no wall, over that of rest, by scipy."""
    step = problem.device.sample_time_s
    target = target_of(motion, round(duration_s / step), step)
    time, drive = np.arange(len(target.position_m)) * step, np.c_[target.position_m, target.velocity_m_per_s]
    found = []
    hands = hand_corners(problem.hands)
    for hand_mass, damping, stiffness in zip(*vars(hands).values(), strict=True):
        mass = problem.device.mass_kg + hand_mass
        total = damping + problem.device.damping_ns_per_m
        moves = [[0, 1], [-stiffness / mass, -total / mass]], [[0, 0], [stiffness / mass, damping / mass]]
        plant = StateSpace(*moves, np.eye(2), np.zeros((2, 2)))
        _, state, _ = lsim(plant, drive, time, X0=[target.position_m[0], 0])
        found.append(np.abs(state[-round(JUDGED_S / step) :, 1]).max())
    return max(found) / AT_REST_M_PER_S


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(mass=st.floats(0.02, 5.0), damping=st.just(0.0) | st.floats(1e-3, 20.0))
def test_without_a_wall_everybody_is_at_rest_at_the_end(mass, damping):
    problem = R1.changed(device={"mass_kg": mass, "damping_ns_per_m": damping})
    motions, duration_s = course_of(problem)
    motion = motions["tap"]
    assert speed_alone(problem, motion, duration_s) < 1.25
    assert TRIAL_S <= duration_s <= LONGEST_S


def test_a_heavy_device_that_is_only_slow_counts_as_at_rest():
    coupling = softly(HEAVY)
    trial = try_coupling(coupling, PEOPLE)
    assert speed_alone(HEAVY, MOTIONS["tap"], TRIAL_S) > 10
    assert trial.stable.all()
    assert trial.longest_s == trial.document()["longest_s"] == course_of(HEAVY).duration_s
    assert np.isfinite(trial.vibration).all()
    assert count_at_rest(coupling, 40, seed=3).at_rest == 40
    assert (residual_speeds(coupling, PEOPLE) < 1).all()


@pytest.mark.slow
def test_everybody_is_judged_alone_as_among_the_others():
    together = try_coupling(softly(HEAVY), PEOPLE)
    alone = [try_coupling(softly(HEAVY), PEOPLE.pick(slice(row, row + 1))) for row in range(len(PEOPLE))]
    for figure in ("stable", "stiffness_n_per_m", "vibration", "tap_depth_m", "at_force_limit"):
        each = np.concatenate([getattr(one, figure) for one in alone])
        np.testing.assert_allclose(each, getattr(together, figure), rtol=1e-6, atol=1e-12)


SEED = 4


@pytest.fixture(scope="module")
def coupling():
    problem = avc.load_problem("ve7")
    return Coupling.from_schedule(problem, avc.solve(problem, "static"))


@pytest.mark.slow
def test_counts_are_those_of_a_trial(coupling):
    found = count_at_rest(coupling, 40, SEED, block=17)
    trial = try_coupling(coupling, draw_hands(coupling.problem.hands, 40, SEED), SEED)
    assert found.at_rest == trial.stable.sum()
    assert found.by_motion == {name: int(rest.sum()) for name, rest in trial.by_motion.items()}
    assert found.moving == tuple(np.flatnonzero(~trial.stable)[:20].tolist())
    free = count_at_rest(coupling, 40, SEED, friction=False)
    assert free.at_rest == trial.stable_without_friction.sum()
    assert "coulomb-friction" in found.effects
    assert "coulomb-friction" not in free.effects
    assert 0 < free.at_rest < 40


@pytest.mark.parametrize("population", ["A", "B"])
def test_anybody_is_drawn_without_those_before(population):
    many = draw_population(population, BLOCK + 50, 7)
    some = draw_population(population, 80, 7, first=BLOCK - 40)
    for row in range(80):
        assert many.values(BLOCK - 40 + row) == some.values(row)
    assert len(np.unique(many.mass_kg)) == BLOCK + 50


WALL_N_PER_M, NOBODY = 20e3, (0.0, 0.0, 0.0)


def rigid(problem):
    """A contact damper in the middle of what is linearly stable with everybody."""
    found = damping_range(PlantFamily.of(problem), problem.environment.stiffness_n_per_m)
    damping = (found.lowest_ns_per_m + found.highest_ns_per_m) / 2
    return Coupling.constant(problem, Gains(0.0, near_rigid_n_per_m(problem.device), damping), "contact damper")


def before(wall, **device):
    """A bare wall before an ideal device, and hands so light that the device alone matters."""
    return avc.load_problem("figure5").changed(
        environment={"stiffness_n_per_m": wall, "damping_ns_per_m": 0.0},
        device={"coulomb_friction_n": 0.0, "encoder_resolution_m": 0.0, **device},
        hands={"mass_kg": (1e-3, 2e-3)},
    )


@pytest.mark.slow
def test_a_wall_at_its_limit_moves_on_lighter_devices_and_one_far_from_it_does_not():
    bare = before(WALL_N_PER_M)
    limit = stiffest_wall(PlantFamily.of(bare)).stiffness_n_per_m
    brittle, safe = (try_perturbed_devices(rigid(before(share * limit))) for share in (0.97, 0.5))
    assert safe.trial.counts().at_rest_without_friction == safe.trial.hands
    assert brittle.trial.counts().at_rest_without_friction < brittle.trial.hands


@pytest.mark.slow
def test_a_wall_that_only_a_hand_holds_is_told_to_be_unstable_let_go():
    bare = before(WALL_N_PER_M)
    wall = 0.99 * stiffest_wall(PlantFamily.of(bare)).stiffness_n_per_m
    held = bare.changed(
        hands={"mass_kg": (1.0, 1.2), "damping_ns_per_m": (20.0, 25.0)}, environment={"stiffness_n_per_m": wall}
    )
    coupling = rigid(held)
    assert all(claim.passed for claim in avc.deployable(coupling).claims if claim.name != "disk-margin")
    found = try_perturbed_devices(coupling)
    assert found.trial.counts().at_rest_without_friction == found.trial.hands
    damping = float(coupling.table.gains[2, 0])
    expected = [spectral_radius(device, NOBODY, damping, wall) > 1 for device in least_stable_devices(coupling)[0]]
    assert found.unstable == found.document()["linearly_unstable"] == sum(expected)
    assert sum(expected) > 0


def test_perturbed_devices_are_the_least_stable_of_the_corners():
    """Each number a tenth off; none of the others has a larger radius, by the poles of another code."""
    problem = before(WALL_N_PER_M)
    coupling, values = rigid(problem), linear_values(problem.device)
    keys = tuple(key for key, value in values.items() if value > 0)
    damping = float(coupling.table.gains[2, 0])
    found, every = least_stable_devices(coupling, 2)[0], least_stable_devices(coupling, 10**6)[0]
    assert len(every) == 2 ** len(keys)
    for key in keys:
        assert {round(linear_values(one)[key] / values[key], 9) for one in every} == {0.9, 1.1}
    radii = [spectral_radius(device, NOBODY, damping, WALL_N_PER_M) for device in every]
    assert min(spectral_radius(one, NOBODY, damping, WALL_N_PER_M) for one in found) >= sorted(radii)[-2] - 1e-9


@pytest.mark.slow
def test_every_corner_hand_that_strikes_the_wall_comes_to_rest():
    """At 1 m/s, the C in a plain plant: the nearest law of 8 states swung between no force and 15 N for ever."""
    device = "mass_kg = 0.3\ndamping_ns_per_m = 1.5\nsample_time_s = 2e-3\ndelay_samples = 1\nmax_force_n = 15.0\n"
    more = "encoder_resolution_m = 3e-5\ncoulomb_friction_n = 0.2\n[environment]\ndamping_ns_per_m = 0\n"
    found = avc.recommend(avc.parse_problem(f"[device]\n{device}{more}stiffness_n_per_m = 5000"), hands=16).coupling
    for m, b, k in zip(*vars(hand_corners(found.problem.hands)).values(), strict=True):
        a = np.array([[0.0, 1.0, 0.0], [-k / (0.3 + m), -(1.5 + b) / (0.3 + m), 1 / (0.3 + m)], [0.0, 0.0, 0.0]])
        c, step, x, force, places = Exported(found), expm(2e-3 * a)[:2], np.array([-0.01, 0.0]), 0.0, []
        for tick in range(2000):
            asked, force = force, c.step(3e-5 * round(x[0] / 3e-5))
            x = step @ [*x, k * min(-0.01 + 2e-3 * tick, 0.01) - asked]
            places.append(x[0])
        assert np.ptp(places[-500:]) < 1e-4, (m, b, k)
