"""A dead zone before the motor and a drag behind it are numbers of the device, and no friction, damping or mass."""

import numpy as np
import pytest
from held_device import held_log
from small_logs import multisine, of

from avc_casadi.identification.device import device_text
from avc_casadi.identification.identify import identify

DEVICE = {"mass": 0.12, "damping": 0.8, "ticks": 6000, "delay": 1}
RIGHT = {"mass_kg": 0.12, "damping_ns_per_m": 0.8}


def driven(friction, **more):
    push = multisine(4.0, 6000)
    law = lambda tick, z, u: push[tick] - 30 * z - 0.3 * u  # noqa: E731
    return identify(of(held_log(law, **DEVICE, friction=friction, **more)))


def beyond(zone):
    return lambda force: np.sign(force) * max(abs(force) - zone, 0.0)


def assert_holds(found, **truth):
    for key, value in truth.items():
        one = found.estimates[key]
        assert one.low - 3e-3 * value <= value <= one.high + 3e-3 * value, key
        assert one.value == pytest.approx(value, rel=0.01), key
        assert not one.doubt


@pytest.mark.thorough
@pytest.mark.parametrize(("zone", "friction"), [(0.05, 0.15), (0.1, 0.1), (0.2, 0.15)])
def test_a_dead_zone_of_the_amplifier_is_told_beside_the_friction(zone, friction):
    found = driven(friction, given_by=beyond(zone))
    assert set(found.terms) == {"base", "coulomb", "dead-zone"}
    assert_holds(found, **RIGHT, coulomb_friction_n=friction, dead_zone_n=zone)
    assert any("dead_zone_n" in note for note in found.notes)
    assert "beside a dead zone of" in device_text(found.device)


@pytest.mark.thorough
@pytest.mark.parametrize(("drag", "friction"), [(3.0, 0.15), (1.0, 0.3)])
def test_drag_of_the_square_of_the_speed_is_no_damping_and_hides_no_friction(drag, friction):
    found = driven(friction, outside=lambda *now: -drag * now[2] * abs(now[2]))
    assert set(found.terms) == {"base", "coulomb", "drag"}
    assert_holds(found, **RIGHT, coulomb_friction_n=friction, drag_ns2_per_m2=drag)
    assert "beside a drag of" in device_text(found.device)


@pytest.mark.thorough
def test_neither_is_invented():
    found = driven(0.15)
    assert set(found.terms) == {"base", "coulomb"}
    assert {one.term for one in found.trials if not one.taken} >= {"dead-zone", "drag"}
