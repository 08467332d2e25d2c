"""What goes to and fro between a few counts until the log ends goes on; noise, a slow motion and a ring-down do not."""

from dataclasses import replace

import numpy as np
import pytest
from buzzing_cases import declared_of
from buzzing_device import Buzzing, logged

from avc_casadi.identification.diagnosis.causes import Asked
from avc_casadi.identification.diagnosis.counterfactual import settled
from avc_casadi.identification.diagnosis.diagnose import diagnose
from avc_casadi.identification.diagnosis.evidence import felt
from avc_casadi.identification.diagnosis.hypothesis import Hypothesis
from avc_casadi.identification.diagnosis.intended import Declared
from avc_casadi.identification.diagnosis.law import find_law
from avc_casadi.identification.diagnosis.limit_cycle import find_count_limit_cycle
from avc_casadi.identification.diagnosis.log import log_of
from avc_casadi.identification.diagnosis.oscillation import find_oscillation
from avc_casadi.identification.diagnosis.relay import find_jump
from avc_casadi.identification.diagnosis.saturation import outgrows
from avc_casadi.identification.record import Columns, records_of
from avc_casadi.identification.repair import wrapped

STEP = 5e-5
TIME = np.arange(3000) * 1e-3
WALL = Buzzing(mass=0.05, damping=0.1, delay=0.0, encoder=1e-4, stiffness=3000.0, damper=1.0, end=0.01)
WALL = replace(WALL, hand_mass=0.05, hand_damping=3.0, hand_stiffness=300.0)
GRASP = Buzzing(mass=0.12, damping=0.2, delay=2.0, encoder=2e-5, stiffness=3000.0, damper=15.0, two_sided=1.0)
GRASP = replace(GRASP, hand_mass=0.1, hand_damping=4.0, hand_stiffness=300.0)
LIGHT = Buzzing(mass=0.02, damping=0.05, delay=0.0, encoder=1e-4, stiffness=5000.0, damper=2.0, friction=0.05)
LIGHT = replace(LIGHT, hand_mass=0.01, hand_damping=4.0, hand_stiffness=300.0, end=0.005)
CUT = Buzzing(mass=0.08, damping=0.2, encoder=2e-4, stiffness=5000.0, damper=20.0, limit=2.5, end=0.005)
CUT = replace(CUT, hand_mass=0.1, hand_damping=4.0, hand_stiffness=300.0)


def columns(loop, seconds=3.0):
    return Columns("log", *logged(loop, seconds))


def found_of(loop, log=None):
    return diagnose(log or columns(loop), device=declared_of(loop))


def toggling(counts, stiffness=3000.0):
    position = STEP * (20 + counts)
    log, _ = log_of(Columns("log", TIME, position, -stiffness * position))
    return find_count_limit_cycle(replace(log, encoder_m=STEP))


def pulses(share, cycle=50, height=1):
    return height * (np.arange(TIME.size) % cycle < share * cycle)


@pytest.mark.parametrize("share", [0.06, 0.2, 0.5, 0.85])
@pytest.mark.parametrize("cycle", [8, 50, 110])
def test_pulses_of_any_length_go_on(share, cycle):
    found = toggling(pulses(max(share, 1.0 / cycle), cycle))
    assert found is not None
    assert found.cycle == pytest.approx(cycle, rel=0.01)
    assert found.steps == 1
    assert found.last == TIME.size


def test_what_is_no_cycle_does_not():
    random = np.random.default_rng(0)
    swings = np.sin(2 * np.pi * 20 * TIME)
    none = {
        "noise at the edge of a count": np.round(0.5 + 0.2 * random.standard_normal(TIME.size)),
        "a slow motion": np.round(30 * TIME),
        "a ring-down": np.round(8 * np.exp(-1.5 * TIME) * swings),
        "rest after cycles": pulses(0.2) * (TIME < 2.0),
        "many counts": np.round(30 * swings),
    }
    assert {name: toggling(counts) for name, counts in none.items()} == dict.fromkeys(none)
    assert toggling(np.round(3 * swings)) is not None
    assert toggling(pulses(0.2), stiffness=0.0) is None


@pytest.mark.thorough
@pytest.mark.parametrize("loop", [WALL, replace(GRASP, end=0.0073)])
def test_a_loop_that_its_encoder_swings_until_the_last_row_is_not_healthy(loop):
    log = columns(loop)
    assert np.ptp(log.force_n[-200:]) > 0.3
    found = found_of(loop, log)
    assert found.oscillation.ends_s == pytest.approx(log.time_s[-1], abs=0.05)
    assert found.cause == "encoder", found.conclusion
    finer = replace(loop, encoder=loop.encoder / 50)
    assert found_of(finer).verdict == "nothing wrong"


@pytest.mark.thorough
@pytest.mark.parametrize("loop", [WALL, GRASP])
def test_a_log_that_begins_within_the_cycle_is_read(loop):
    log = columns(loop)
    late = log.time_s > 1.5
    tail = Columns("tail", log.time_s[late] - 1.5, log.position_m[late], log.force_n[late])
    found = found_of(loop, tail)
    assert "encoder" in found.candidates, found.conclusion


def test_a_counter_that_wraps_around_jumps_by_more_than_a_few_counts():
    ramp = np.arange(TIME.size) % 256
    assert wrapped(1e-5 * ramp, TIME).size == (TIME.size - 1) // 256
    for height in (1, 2, 3):
        assert not wrapped(1e-5 * pulses(0.3, height=height), TIME).size
    faults = [records_of(Columns("log", TIME, 1e-5 * counts, np.sin(TIME)))[1] for counts in (ramp, pulses(0.3))]
    assert "wraps around" in faults[0][0].message
    assert "wraps around" not in str(faults[1])


@pytest.mark.thorough
def test_a_light_hand_over_few_counts_is_not_taken_for_none():
    found = found_of(LIGHT)
    assert found.cause != "let-go", found.conclusion
    assert found.candidates[0] == "encoder"


def test_a_hand_is_not_what_is_missing_where_the_encoder_swings_the_loop_with_one():
    """A loop that hardly grows without a hand, and that its encoder swings over two steps with any."""
    loop = Buzzing(mass=0.148, damping=0.69, delay=1.57, encoder=9.5e-5, limit=20.0, stiffness=5530.0, damper=6.66)
    loop = replace(loop, two_sided=1.0, end=0.0071)
    device = declared_of(loop)
    log, _ = log_of(columns(loop))
    swing, law = find_oscillation(log), find_law(log, loop.limit)
    declared = Declared.of(device, None, loop.period)
    free = Asked(Hypothesis(device, None), 1.0, {"let-go": 1.0})
    assert swing.found.steps < 3
    (told,) = settled([free], law, log, swing.found, declared, [])
    assert told.causes == {"encoder": 1.0}
    # A loop that rests with any hand is one that let go.
    (told,) = settled([free], replace(law, stiffness_n_per_m=500.0), log, swing.found, declared, [])
    assert told.causes == {"let-go": 1.0}


def test_what_would_have_grown_long_ago_does_not_swing_over_a_count():
    log, _ = log_of(columns(LIGHT))
    swing = find_oscillation(log)
    law = find_law(log, LIGHT.limit)
    device = declared_of(LIGHT)
    free = Hypothesis(device, None)
    assert swing.found.steps < 2
    assert outgrows(free, law, log, swing.found, device.max_force_n)
    assert not outgrows(free, replace(law, stiffness_n_per_m=500.0), log, swing.found, device.max_force_n)
    # What swings over many counts, or is cut by the limit, may be held there by that.
    assert not outgrows(free, law, log, replace(swing.found, steps=40.0), device.max_force_n)
    assert not outgrows(free, law, log, replace(swing.found, contact_share=0.7), device.max_force_n)


def test_a_spring_that_steps_with_its_encoder_has_a_length():
    log, _ = log_of(columns(CUT))
    swing = find_oscillation(log)
    assert find_jump(log, swing, find_law(log, CUT.limit), CUT.limit) is None
    assert found_of(CUT).cause != "stiffness"
    switched = replace(CUT, bias=1.0, encoder=5e-6, damper=0.0, stiffness=0.0, hand_damping=2.0)
    log, _ = log_of(columns(switched))
    jump = find_jump(log, find_oscillation(log), find_law(log, 2.5), 2.5)
    assert jump is None or jump.force_n == pytest.approx(1.0, rel=0.1)


def test_one_step_is_felt_by_what_its_force_moves():
    loop = replace(WALL, end=0.01)
    device = declared_of(loop)
    log, _ = log_of(columns(loop))
    swing = find_oscillation(log)
    declared = Declared.of(device, None, loop.period)
    whole = felt(log, swing, declared)
    assert whole > 1
    middle = float(log.force_n[swing.first : swing.last].mean())
    weak = replace(log, force_n=middle + 0.05 * (log.force_n - middle))
    assert felt(weak, swing, declared) == pytest.approx(0.05 * whole, rel=0.01)
    # A force at its limit moves nothing: then the position itself counts.
    limited = replace(log, force_n=np.full_like(log.force_n, middle))
    assert felt(limited, swing, declared) > 1
