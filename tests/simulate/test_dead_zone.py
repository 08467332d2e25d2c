"""The dead zone of an observer law: closed at rest, open in motion, a sector from 0 to 1 at every sample."""

import numpy as np
import pytest
from quick import first

from avc_casadi.model.runtime import StateFeedback
from avc_casadi.simulation.emit import FloatProgram
from avc_casadi.simulation.runtime.observer import state_feedback_step

T, STEP = 1e-3, 2e-5
HALF = 1.5 * STEP
ZONE = {"dead_zone_m": HALF, "opens_m": HALF, "open_m": 4 * HALF, "kept": np.exp(-T / 0.6), "smoothing": 0.91}


def law(**changed):
    """An observer that believes that nothing moves: it takes over the innovation that is used, and no more."""
    rows = {"state": ((1.0,),), "force_m_per_n": (0.0,), "innovation": (1.0,), "feedback": (1.0,), "positions": (0,)}
    return StateFeedback(**(rows | ZONE | changed))


def believed(settings, positions):
    """The position that is believed at every sample, in double precision."""
    step = state_feedback_step(settings)
    state, found = np.zeros(len(step.states)), []
    for position in positions:
        state, output = (part.full().ravel() for part in step.function(state, [position, 0.0], settings.numbers()))
        found.append(float(output[0]))
    return np.array(found)


def used_and_there(settings, positions):
    """The innovation that is used and the one that is there, at every sample but the first."""
    found = believed(settings, positions)
    return np.diff(found), positions[1:] - found[:-1]


@pytest.mark.parametrize("seed", first(range(6)))
def test_what_is_used_of_the_innovation_is_a_share_from_0_to_1(seed):
    rng = np.random.default_rng(seed)
    jumps = rng.choice([-3, -1, 0, 0, 0, 1, 3], 1500) * (rng.random(1500) < 10.0 ** -rng.uniform(0, 2))
    used, there = used_and_there(law(), STEP * np.cumsum(jumps))
    assert (used * there >= 0).all()
    assert (np.abs(used) <= np.abs(there) + 1e-18).all()


@pytest.mark.slow
def test_a_device_in_motion_is_believed_and_one_at_rest_only_beyond_the_half_width():
    time = T * np.arange(4000)
    moving = STEP * np.round(1e-3 / STEP * np.sin(2 * np.pi * time))
    used, there = used_and_there(law(), moving)
    believed_share = (used[100:] @ there[100:]) / (there[100:] @ there[100:])
    assert believed_share > 0.95  # a little is lost where it turns back
    flicker = moving[-1] + STEP * (np.arange(4000) // 5 % 2)  # between two counts, 100 times a second
    used, there = used_and_there(law(), np.concatenate([moving, flicker]))
    assert (used[-500:] == 0).all()
    away = flicker[-1] + 2 * HALF
    used, there = used_and_there(law(), np.concatenate([moving, flicker, [away]]))
    assert used[-1] == pytest.approx(there[-1] - HALF, rel=1e-9)


@pytest.mark.parametrize(("hz", "opens"), [(100.0, False), (5.0, True)])
def test_a_swing_of_two_steps_opens_it_at_the_rate_of_a_hand_and_not_at_that_of_a_limit_cycle(hz, opens):
    positions = 2 * STEP * np.sin(2 * np.pi * hz * T * np.arange(3000) + 0.3)
    used, there = used_and_there(law(dead_zone_m=1.0), positions)  # so wide that all is inside
    shares = used[-1000:] / there[-1000:]
    assert (shares.min() > 0.2) if opens else (shares == 0).all()


def test_it_closes_within_two_seconds_of_any_motion_and_far_from_0_in_single_precision_too():
    settings = law()
    program = FloatProgram(state_feedback_step_in_scalars(settings))
    numbers = settings.numbers().astype(np.float32)
    moving = 0.1 + 0.01 * np.sin(2 * np.pi * 2.0 * T * np.arange(1000))
    positions = np.concatenate([moving, np.full(2000, moving[-1])]).astype(np.float32)
    state, zero = [np.float32(0)] * len(state_feedback_step(settings).states), np.float32(0)
    names = state_feedback_step(settings).states
    ranges = []
    for position in positions:
        *state, _ = program(*state, position, zero, *numbers)
        now = dict(zip(names, state, strict=True))
        ranges.append(float(now["above_m"]) + float(now["below_m"]))
    assert max(ranges) > 3.99 * HALF
    assert ranges[-1] < HALF
    assert ranges[-1] == pytest.approx(ranges[-301] * np.exp(-0.3 / 0.6), rel=1e-3), "it fades as it should"


def state_feedback_step_in_scalars(settings):
    """The step as a function of scalars."""
    import casadi as ca  # noqa: PLC0415

    step = state_feedback_step(settings)
    parts = [[ca.SX.sym(name) for name in names] for names in (step.states, step.inputs, step.parameters)]
    results = step.function(*(ca.vertcat(*part) for part in parts))
    return ca.Function(
        "step", [*parts[0], *parts[1], *parts[2]], [*ca.vertsplit(results[0]), *ca.vertsplit(results[1])]
    )


def test_a_dead_zone_that_is_open_before_it_opens_is_refused():
    for changed in ({"open_m": HALF}, {"open_m": 0.0}, {"opens_m": 5 * HALF}):
        with pytest.raises(Exception, match=r"open_m: is .* allowed: above opens_m"):
            law(**changed)
