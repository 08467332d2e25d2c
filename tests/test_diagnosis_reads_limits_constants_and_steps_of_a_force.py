"""A constant beside a wall, a force limit, the steps of an output and a relay with a dead band are told apart."""

from dataclasses import replace

import numpy as np
import pytest
from held_device import held_log

from avc_casadi.identification.diagnosis.diagnose import diagnose
from avc_casadi.identification.diagnosis.evidence import limit_sentence
from avc_casadi.identification.diagnosis.law import find_law, with_outside_force
from avc_casadi.identification.diagnosis.log import log_of
from avc_casadi.identification.diagnosis.saturation import force_limit
from avc_casadi.identification.record import Columns
from avc_casadi.model.device import Device

T, STEP_M, LIMIT_N = 1e-3, 2e-5, 8.0
TIME = T * np.arange(3000)
# Of a hand that goes in and out of a wall while the loop swings.
MOVED = STEP_M * np.round((2e-3 * np.sin(23 * TIME) + 4e-4 * np.sin(157 * TIME + 1)) / STEP_M)
SPEED = np.diff(MOVED, prepend=MOVED[0]) / T


def device(**more):
    keys = {"mass_kg": 0.12, "damping_ns_per_m": 0.8, "coulomb_friction_n": 0.02, "encoder_resolution_m": STEP_M}
    return Device.model_validate({**keys, "max_force_n": LIMIT_N, "sample_time_s": T, "delay_samples": 1, **more})


def log_with(force):
    return log_of(Columns("log", TIME, MOVED, force))[0]


def wall(constant=0.0, limit=LIMIT_N):
    return np.clip(np.where(MOVED > 0, -4000 * MOVED - 10 * SPEED, 0.0) + constant, -limit, limit)


@pytest.mark.parametrize("constant", [0.3, 1.0, -1.5])
def test_a_constant_beside_a_wall_is_read_where_there_is_no_contact(constant):
    log = with_outside_force(log_with(wall(constant)), LIMIT_N)
    assert log.outside_n == pytest.approx(-constant)
    # By chance a force in contact is the constant too.
    assert np.mean(log.touching == (wall() != 0)) > 0.99
    law = find_law(log, LIMIT_N)
    assert (law.stiffness_n_per_m, law.damping_ns_per_m) == pytest.approx((4000, 10), rel=1e-3)


@pytest.mark.parametrize(
    "force",
    [
        wall(),
        wall(limit=1.0),
        0.4 * np.round(wall() / 0.4),
        -4000 * MOVED - 10 * SPEED,
        np.where(MOVED > 0, -2.0, 2.0),
    ],
    ids=["none", "a limit", "steps", "no wall", "a relay"],
)
def test_no_constant_is_read_where_there_is_none(force):
    assert with_outside_force(log_with(force), None).outside_n == 0


def late_wall(constant):
    """A device on a spring of 400 N/m that a load presses into a wall by a delay of 5 samples."""
    return held_log(
        lambda _, z, u: (-4000 * z - 10 * u if z > 0 else 0.0) + constant,
        mass=0.2, damping=6.8, friction=0.05, spring=400.0, load=2.4 - constant, ticks=3000, delay=5,
    )  # fmt: skip


@pytest.mark.thorough
@pytest.mark.parametrize("constant", [0.0, 1.0, 0.3])
def test_the_delay_of_a_loop_is_named_beside_a_weight_that_is_compensated(constant):
    found = diagnose(late_wall(constant), device=device())
    assert found.cause == "delay"
    assert abs(found.measured.delay_samples - 5) < 0.3
    assert found.law.stiffness_n_per_m == pytest.approx(4000, rel=0.01)
    assert any("stands outside contact" in note for note in found.notes) == bool(constant)


@pytest.mark.thorough
def test_an_offset_of_the_force_column_hides_no_delay():
    log = late_wall(0.0)
    found = diagnose(replace(log, force_n=log.force_n + 1.0), device=device(max_force_n=None))
    assert found.cause == "delay"
    assert abs(found.measured.delay_samples - 5) < 0.3


# A position that toggles over two counts, of which a damper makes more than the limit at once.
TOGGLED = STEP_M * np.repeat(np.resize([0, 1, 2, 1], 300), 10)


@pytest.mark.parametrize(
    ("position", "force", "begins"),
    [
        (TOGGLED, lambda x, u: -3000 * x - 500 * u, "too much damping or encoder limit cycle; whenever the count"),
        # Ordinary swings into the limit.
        (MOVED, lambda x, u: -9000 * x - 10 * u, "the force stands at 8 N, its limit, for"),
        (MOVED, lambda x, u: -3500 * x - 10 * u, ""),
        # The largest level of a coarse output is none, nor is that of a relay.
        (MOVED, lambda x, _: -3 * np.round(500 * x), ""),
        (MOVED, lambda x, _: -2 * np.sign(x), ""),
    ],
    ids=["a count", "saturated", "hardly saturated", "steps", "a relay"],
)
def test_a_limit_is_one_that_was_reached(position, force, begins):
    speed = np.diff(position, prepend=position[0]) / T
    asked = np.clip(force(position, speed), -LIMIT_N, LIMIT_N)
    log, _ = log_of(Columns("log", T * np.arange(position.size), position, asked))
    said = limit_sentence(log, LIMIT_N)
    assert said.startswith(begins)
    assert bool(said) == bool(begins)


@pytest.mark.parametrize(("limit", "told"), [(3.0, 3.0), (30.0, None)])
def test_an_undeclared_limit_is_a_force_that_stays_while_the_position_moves(limit, told):
    log = log_with(np.clip(-3500 * MOVED - 10 * SPEED, -limit, limit))
    assert force_limit(log, None) == told


RELAYS = {
    "wide": (3.0, 2e-3, {"mass": 0.2, "damping": 0.8, "friction": 0.05, "delay": 1, "start": 6e-3}),
    "narrow": (2.0, 1e-4, {"mass": 0.22, "damping": 3.8, "friction": 0.05, "delay": 2, "start": 1e-3, "spring": 100.0}),
}


@pytest.mark.thorough
@pytest.mark.parametrize("kind", RELAYS)
def test_a_relay_with_a_dead_band_is_named_and_rests_over_the_width_that_is_advised(kind):
    size, band, loop = RELAYS[kind]
    log = held_log(lambda _, z, __: -size * np.sign(z) if abs(z) > band else 0.0, ticks=3000, **loop)
    found = diagnose(log, device=device(mass_kg=loop["mass"], delay_samples=loop["delay"]))
    assert found.cause == "relay"
    assert f"+-{size:g} N" in found.conclusion
    (cure,) = found.cures
    wide = held_log(
        lambda _, z, __: -size * np.sign(z) * min(max((abs(z) - band) / cure.value, 0.0), 1.0), ticks=3000, **loop
    )
    assert np.ptp(wide.position_m[-500:]) < 0.1 * np.ptp(log.position_m[-500:])


def test_steps_of_an_output_are_told_and_taken_for_no_limit():
    law = lambda _, z, u: -4000 * z - 15 * u if z > 0 else 0.0  # noqa: E731
    loop = {"mass": 0.2, "damping": 3.8, "friction": 0.02, "load": 3.0, "spring": 300.0, "delay": 1, "step": 5e-6}
    found = diagnose(held_log(law, output=0.6, ticks=3000, **loop), device=device(encoder_resolution_m=5e-6))
    assert found.verdict == "cannot tell"
    assert "steps of 0.6 N" in found.conclusion
    assert "limit" not in found.conclusion
