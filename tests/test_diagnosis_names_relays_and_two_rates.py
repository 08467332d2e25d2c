"""A force that a sign switches, and a loop of two rates, are named where one change of them brings rest."""

import numpy as np
import pytest
from held_device import held_log

from avc_casadi.identification.diagnosis.diagnose import diagnose
from avc_casadi.model.device import Device

DEVICE = {"mass_kg": 0.1, "damping_ns_per_m": 0.5, "coulomb_friction_n": 0.1, "sample_time_s": 1e-3}


def declared(**more):
    return Device.model_validate({**DEVICE, "encoder_resolution_m": 2e-5, "max_force_n": 8.0, **more})


def least(force):
    return force + 0.8 * np.sign(force)


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
    log = held_log(
        law, mass=0.05, damping=0.02, friction=0.005, ticks=5000, step=9.587e-5, delay=1, start=0.3, rotary=True
    )
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
    assert found.cures
    assert all(cure.growth_per_s < 0 for cure in found.cures)


@pytest.mark.thorough
def test_a_plain_spring_and_damper_are_neither():
    log = held_log(lambda _, z, u: -4000 * z - 5 * u, mass=0.1, damping=0.5, friction=0.02, delay=4, start=0.01)
    assert diagnose(log, device=declared(delay_samples=1)).cause not in {"relay", "rates"}
