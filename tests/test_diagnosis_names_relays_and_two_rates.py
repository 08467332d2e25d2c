"""A force that a sign switches, and a loop of two rates, are named where one change of them brings rest."""

import numpy as np
import pytest
from held_device import held_log

from avc_casadi.identification.diagnosis.diagnose import diagnose
from avc_casadi.identification.diagnosis.law import Law
from avc_casadi.identification.record import Columns
from avc_casadi.model.device import Device

DEVICE = {"mass_kg": 0.1, "damping_ns_per_m": 0.5, "coulomb_friction_n": 0.1, "sample_time_s": 1e-3}


def declared(**more):
    return Device.model_validate({**DEVICE, "encoder_resolution_m": 2e-5, "max_force_n": 8.0, **more})


def least(force):
    return force + 0.8 * np.sign(force)


WHEEL = {
    "mass": 0.05,
    "damping": 0.02,
    "friction": 0.005,
    "ticks": 5000,
    "step": 9.587e-5,
    "delay": 1,
    "start": 0.3,
    "rotary": True,
}


def swings(law, **loop):
    position = held_log(law, **loop).position_m
    return np.ptp(position[2 * position.size // 3 :])


RELAYS = {
    "a sign beside a spring": lambda _, z, u: -200 * z - np.sign(z) - u,
    "a minimum force": lambda _, z, u: least(-100 * z - u),
    "on and off": lambda _, z, __: -2.0 * np.sign(z),
}


@pytest.mark.thorough
@pytest.mark.parametrize("law", RELAYS.values(), ids=RELAYS)
def test_a_force_that_a_sign_switches_is_named(law):
    log = held_log(law, mass=0.1, damping=0.5, friction=0.1, delay=4, start=0.01)
    found = diagnose(log, device=declared(delay_samples=4))
    assert (found.verdict, found.cause) == ("named", "relay")


@pytest.mark.thorough
def test_a_switched_wall_of_a_slow_loop_is_named():
    law = lambda _, z, __: -7.6 * np.sign(z - 0.002)  # noqa: E731
    log = held_log(law, mass=0.3, damping=0.5, friction=0.1, period=0.01, ticks=800, delay=1, start=0.01)
    assert diagnose(log, device=declared(mass_kg=0.3, sample_time_s=0.01, delay_samples=1)).cause == "relay"


def frames(every, late, stiffness, damping):
    held = [0.0] * (late + 1)

    def law(tick, z, u):
        if tick % every == 0:
            held.append(-stiffness * z)
            held.pop(0)
        return held[0] - damping * u

    return law


@pytest.mark.thorough
@pytest.mark.parametrize(("every", "late"), [(16, 1), (10, 1), (33, 0)])
def test_a_spring_of_every_frame_beside_a_damper_of_every_tick_is_named_with_both_rates(every, late):
    law = frames(every, late, 8.0, 0.1)
    log = held_log(law, **WHEEL)
    device = Device.model_validate(
        {
            "motion": "rotary",
            "handle_radius_m": 0.15,
            "mass_kg": 0.05,
            "damping_ns_per_m": 0.02,
            "sample_time_s": 1e-3,
            "delay_samples": 1,
            "max_force_n": 8.0,
        }
    )
    found = diagnose(log, device=device)
    assert (found.verdict, found.cause) == ("named", "rates")
    assert f"every {every} ms" in found.conclusion
    assert all(cure.growth_per_s < 0 for cure in found.cures)
    keys = {cure.key: cure.value for cure in found.cures}
    assert {"sample_time_s", "stiffness_n_per_m"} == keys.keys()
    # At a decay of 0.3 1/s the softer one is not at rest within the log.
    assert swings(frames(every, late, keys["stiffness_n_per_m"], 0.1), **WHEEL) < 0.5 * swings(law, **WHEEL)
    assert swings(frames(1, 0, 8.0, 0.1), **WHEEL) < 0.1 * swings(law, **WHEEL)


SWITCHED = {
    "position": lambda over, size: lambda _, z, u: -200 * z - size * over(z) - u,
    "force": lambda over, size: lambda _, z, u: -100 * z - u + size * over(-100 * z - u),
    "against the motion": lambda over, size: lambda _, z, u: -50 * z - size * over(u),
}


@pytest.mark.thorough
@pytest.mark.parametrize("kind", SWITCHED)
def test_over_the_width_that_is_advised_a_switched_force_rests(kind):
    loop = {"mass": 0.1, "damping": 0.5, "friction": 0.1, "delay": 4, "start": 0.01}
    law = SWITCHED[kind](np.sign, 1.0)
    found = diagnose(held_log(law, **loop), device=declared(delay_samples=4))
    assert found.cause == "relay"
    (cure,) = found.cures
    assert cure.key == "switch_width"
    wide = SWITCHED[kind](lambda by: np.clip(by / cure.value, -1, 1), 1.0)
    assert swings(wide, **loop) < 0.1 * swings(law, **loop)


@pytest.mark.thorough
def test_friction_that_is_compensated_beyond_its_size_is_named_and_less_of_it_rests():
    loop = {"mass": 0.1, "damping": 0.9, "friction": 0.1, "delay": 2, "start": 0.01}
    found = diagnose(held_log(lambda _, z, u: -100 * z + 0.25 * np.sign(u), **loop), device=declared(delay_samples=2))
    assert found.cause == "relay"
    (cure,) = found.cures
    assert cure.key == "switched_n"
    assert cure.value < 0.1
    less = swings(lambda _, z, u: -100 * z + cure.value * np.sign(u), **loop)
    assert less < 0.1 * swings(lambda _, z, u: -100 * z + 0.25 * np.sign(u), **loop)


@pytest.mark.parametrize("hertz", [1.5, 2.5])
def test_a_hand_that_goes_to_and_fro_in_a_wall_is_nothing_wrong(hertz):
    # The device goes where the hand takes it; the wall pushes back.
    time = 1e-3 * np.arange(5000)
    seen = 2e-5 * np.round(0.02 * np.sin(2 * np.pi * hertz * time) / 2e-5)
    log = Columns("hand", time, seen, -200 * seen - 2000 * np.diff(seen, prepend=0.0))
    assert diagnose(log, device=declared(delay_samples=1)).verdict == "nothing wrong"


@pytest.mark.thorough
def test_a_plain_spring_and_damper_are_neither():
    log = held_log(lambda _, z, u: -4000 * z - 5 * u, mass=0.1, damping=0.5, friction=0.02, delay=4, start=0.01)
    assert diagnose(log, device=declared(delay_samples=1)).cause not in {"relay", "rates"}


def test_no_filter_is_told_above_the_nyquist_frequency():
    cut = [
        Law(1e3, 1.0, float(np.exp(-2 * np.pi * hertz * 1e-3)), 0, 0.0, 1e-3, 500).filter_hz(1e-3)
        for hertz in (400, 5300)
    ]
    assert cut[0] == pytest.approx(400)
    assert cut[1] is None


@pytest.mark.parametrize("every", [12, 33])
def test_a_force_computed_every_so_many_ticks_is_read_with_that_period(every):
    held = [0.0]

    def law(tick, z, u):
        if tick % every == 0:
            held[0] = -400 * z - 2 * u
        return held[0]

    log = held_log(law, mass=0.3, damping=0.8, friction=0.05, ticks=3000, delay=1, start=2e-3)
    assert diagnose(log, device=declared(mass_kg=0.3, delay_samples=1)).ticks.held == every


def test_a_log_beyond_the_force_limit_leaves_the_declared_ranges_as_they_are():
    wall = lambda _, z, u: -max(0.0, 6000 * z + 2 * u)  # noqa: E731
    log = held_log(wall, mass=0.12, damping=0.6, friction=0.05, spring=200, delay=2, ticks=2000, start=2e-3, limit=20)
    found = diagnose(log, device=declared(range={"delay_samples": [0.0, 3.0]})).measured
    assert found is not None
    assert (found.least_declared_delay_samples, found.declared_delay_samples) == (0, 3)
