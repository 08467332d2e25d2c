"""A knob is identified in rad, N.m and kg.m2: the same device as the linear one at its rim."""

import numpy as np
import pytest
from linear_keys import linear_keys
from measured_device import Truth, measured, multisine

import avc_casadi as avc
from avc_casadi.files.device_file import parse_device
from avc_casadi.identification.device import device_text
from avc_casadi.identification.identify import identify
from avc_casadi.identification.log import Record
from avc_casadi.identification.read import Layout, read_logs

RADIUS = 0.02


@pytest.mark.slow
def test_what_is_found_of_a_turn_is_what_is_found_at_its_rim():
    random = np.random.default_rng(3)
    truth = Truth(coulomb=0.3, delay=1.2, encoder=2e-5)
    _, position, force = measured(truth, multisine(random, 3.0, truth.period, 0.5, 200.0, 2.0), random)
    at_rim = identify([Record("rim", truth.period, position, force)])
    turned = Record("turn", truth.period, position / RADIUS, force * RADIUS, motion="rotary")
    found = identify([turned], handle_radius_m=RADIUS)
    powers = {"mass_kg": 2, "damping_ns_per_m": 2, "coulomb_friction_n": 1, "encoder_resolution_m": -1}
    for key, one in at_rim.estimates.items():
        scale = RADIUS ** powers.get(key, 0)
        its = found.estimates[key]
        if key in powers or key == "delay_samples":
            assert (its.low, its.value, its.high) == pytest.approx(
                tuple(scale * x for x in (one.low, one.value, one.high)), rel=1e-6
            )
    text = device_text(found.device)
    assert linear_keys(text) == []
    assert parse_device(text).device == found.device.device
    assert found.device.device.handle_radius_m == RADIUS


@pytest.mark.parametrize(
    ("header", "turn", "size"), [("angle_deg,torque_mNm", 180 / np.pi, 1e3), ("q_rad,tau_Nm", 1, 1)]
)
def test_turns_and_newton_metres_are_read_and_mixed_kinds_refused(header, turn, size, tmp_path):
    time = np.arange(400) * 1e-3
    angle, torque = np.sin(20 * time), 0.1 * np.cos(20 * time)
    rows = zip(time, turn * angle, size * torque, strict=True)
    log = tmp_path / "log.csv"
    log.write_text(f"time_s,{header}\n" + "".join("{:.9g},{:.12g},{:.12g}\n".format(*row) for row in rows))
    (record,), _ = read_logs([log])
    assert record.motion == "rotary"
    np.testing.assert_allclose(record.position_m, angle, atol=1e-10)
    np.testing.assert_allclose(record.force_n, torque, atol=1e-10)
    with pytest.raises(avc.InputError) as caught:
        read_logs([log], Layout(units={"force": "N"}))
    assert [fault.key for fault in caught.value.faults] == ["position"]
