"""Pieces of a law that are not linear: their ranges of slopes, estimators beside SciPy's, and what is refused."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import solve_discrete_are

import avc_casadi as avc
from avc_casadi.files.problem_file import load_any
from avc_casadi.model import law_pieces as pieces
from avc_casadi.model.control_law import ControlLaw

DEVICE = {"mass_kg": 0.12, "damping_ns_per_m": 0.8, "encoder_resolution_m": 2e-5, "max_force_n": 8.0}
PLAIN = {"stiffness_n_per_m": 900.0, "damping_ns_per_m": 4.0}


def stated(law, device=DEVICE):
    return load_any({"device": device, "law": law})


@settings(max_examples=20)
@given(st.floats(1e-4, 1e-2), st.floats(1e-3, 0.45), st.floats(1e-3, 0.49))
def test_the_kalman_velocity_is_the_steady_filter_of_white_accelerations(period, share, at):
    size = np.exp(-np.sqrt(2) * np.pi * share)
    index = 2 * (1 - size) ** 2 / size  # tracking index: rms acceleration T^2 over rms noise
    a = np.array([[1.0, 1.0], [0.0, 1.0]])
    drive = np.array([[0.5], [1.0]]) * index
    covariance = solve_discrete_are(a.T, np.array([[1.0], [0.0]]), drive @ drive.T, np.eye(1))
    gain = covariance[:, 0] / (covariance[0, 0] + 1)
    z = np.exp(2j * np.pi * at)
    # x = (a - gain [1 0] a) x/z + gain y
    corrected = a - np.outer(gain, a[0])
    estimate = np.linalg.solve(np.eye(2) - corrected / z, gain.astype(complex))
    growth = pieces.Kalman(share / period).growth(period)
    assert complex(growth.transfer(np.array(z))) == pytest.approx(estimate[1], rel=1e-6)
    # A ramp is followed without error: v T of one unit a sample.
    almost = np.exp(1e-6j)
    assert complex(growth.transfer(np.array(almost))) / (1 - 1 / almost) == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("samples", [1, 7, 40])
def test_the_time_between_steps_is_as_old_as_its_window_at_the_slowest_speed(samples):
    # At one step in n samples: half of n within the two changes, and 0 to n while it is kept.
    mean_age = samples / 2 + np.mean(np.linspace(0, samples, 1001))
    turn = 1e-5
    slope = complex(pieces.Ticks(samples * 1e-3).growth(1e-3).transfer(np.exp(np.array(1j * turn))))
    assert -np.angle(slope / (1j * turn)) / turn == pytest.approx(mean_age, rel=1e-4)


@settings(max_examples=20)
@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(0.01, 0.49))
def test_sectors_are_the_pieces_at_their_slopes(spring, friction, integral, at):
    own = stated(
        {
            **PLAIN,
            "dead_zone_m": 1e-4,
            "integral_n_per_m_s": 700.0,
            "integral_limit_n": 2.0,
            "friction_compensation": {"force_n": 0.2, "velocity_m_per_s": 0.05},
        }
    ).law
    period = 1e-3
    law = own.with_sectors(period).at_slopes(
        spring_dead_zone=spring, friction_compensation=friction, integral_limit=integral
    )
    z = np.exp(2j * np.pi * at)
    velocity = (1 - 1 / z) / period
    summed = integral / (1 - integral / z)  # s = share (s/z + x)
    expected = spring * 900 + 4 * velocity + 700 * period * summed - friction * 0.2 / 0.05 * velocity
    assert complex(law.transfer(np.array(z))) == pytest.approx(expected, rel=1e-9)
    steepest = own.with_sectors(period).at_slopes().transfer(np.array(z))
    assert complex(own.law(period).transfer(np.array(z))) == pytest.approx(complex(steepest), rel=1e-12)
    ranges = {item.key: (item.least, item.most) for item in own.slope_ranges}
    assert ranges == {
        "dead_zone_m": (0.0, 900.0),
        "integral_limit_n": (0.0, 1.0),
        "friction_compensation": (-4.0, 0.0),
    }
    outside = complex(own.outside(period).transfer(np.array(z)))
    assert outside == pytest.approx(-0.2 / 0.05 * velocity, rel=1e-9)


def test_a_slower_law_has_its_own_period():
    own = stated({**PLAIN, "rate_divider": 4}).law
    assert own.law(1e-3).sample_time_s == 4e-3
    assert not own.is_linear
    z = np.exp(0.3j)
    expected = 900 + 4 * (1 - 1 / z) / 4e-3
    assert complex(own.law(1e-3).transfer(np.array(z))) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("law", "key", "said"),
    [
        ({"stiffness_n_per_m": 0.0, "dead_zone_m": 1e-4}, "dead_zone_m", "is 0.0001, which needs a spring"),
        ({"integral_limit_n": 2.0}, "integral_limit_n", "is 2.0, which needs an integral"),
        ({"dead_zone_m": -1e-4}, "dead_zone_m", "is -0.0001; allowed: 0 or 1e-12 to 1"),
        ({"friction_compensation": {"force_n": 0.2}}, "friction_compensation.velocity_m_per_s", "is missing"),
        (
            {"friction_compensation": {"force_n": 0.2, "velocity_m_per_s": 0.0}},
            "friction_compensation.velocity_m_per_s",
            "is 0.0; allowed: 1e-6 to 100",
        ),
        (
            {"friction_compensation": {"force_n": -0.2, "velocity_m_per_s": 0.02}},
            "friction_compensation.force_n",
            "is -0.2; allowed: ",
        ),
        (
            {"friction_compensation": {"force_n": 9.0, "velocity_m_per_s": 0.02}},
            "friction_compensation.force_n",
            "is 9.0; allowed: up to device.max_force_n, 8.0",
        ),
        ({"rate_divider": 0}, "rate_divider", "is 0; allowed: an integer 1 to 1000"),
        ({"rate_divider": 1.5}, "rate_divider", "not an integer"),
        (
            {"rate_divider": 5, "filters": [{"kind": "notch", "frequency_hz": 150.0}]},
            "filters[0].frequency_hz",
            "below 100 Hz, half the rate of device.sample_time_s over rate_divider",
        ),
        ({"velocity": {"kind": "kalman", "bandwidth_hz": 600.0}}, "velocity.bandwidth_hz", "allowed: below 500"),
        ({"velocity": {"kind": "ticks", "timeout_s": 1e-5}}, "velocity.timeout_s", "1 to 128 samples"),
        ({"velocity": {"kind": "ticks", "timeout_s": 2.0}}, "velocity.timeout_s", "is 2.0; allowed: 0.001 to 0.128 s"),
        ({"velocity": {"kind": "tick"}}, "velocity.kind", "ticks"),
    ],
)
def test_a_piece_outside_its_sense_is_refused(law, key, said):
    with pytest.raises(avc.InputError) as refused:
        stated({**PLAIN, **law})
    assert f"law.{key}: " in str(refused.value)
    assert said in str(refused.value)
    assert any(way in str(refused.value) for way in ("allowed: ", "; give ", "is missing"))


def test_the_time_between_steps_needs_steps():
    device = {key: value for key, value in DEVICE.items() if key != "encoder_resolution_m"}
    with pytest.raises(avc.InputError, match=r"and device.encoder_resolution_m is 0; give a resolution"):
        stated({**PLAIN, "velocity": {"kind": "ticks", "timeout_s": 0.02}}, device)


def test_keys_of_a_device_that_turns():
    device = {"motion": "rotary", "handle_radius_m": 0.05, "inertia_kgm2": 1e-3, "damping_nms_per_rad": 1e-3}
    law = {
        "stiffness_nm_per_rad": 8.0,
        "dead_zone_rad": 0.01,
        "integral_nm_per_rad_s": 2.0,
        "integral_limit_nm": 0.3,
        "friction_compensation": {"torque_nm": 0.02, "velocity_rad_per_s": 0.5},
    }
    own = stated(law, device).law
    assert (own.dead_zone_m, own.integral_limit_n) == (0.01, 0.3)
    assert (own.friction_compensation.force_n, own.friction_compensation.velocity_m_per_s) == (0.02, 0.5)


def test_a_timeout_is_searched_within_what_a_law_may_have():
    law = ControlLaw(damping_ns_per_m=2.0, velocity={"kind": "ticks", "timeout_s": 0.02})
    timeout = next(number for number in law.numbers(1e-3) if number.path[-1] == "timeout_s")
    assert (timeout.lowest, timeout.highest) == (1e-3, 0.032)


@pytest.mark.parametrize("samples", [20, 60])
def test_a_transfer_of_many_states_is_that_of_the_difference_over_its_window(samples):
    law = ControlLaw(
        damping_ns_per_m=2.0, local_damping_ns_per_m=0.5, velocity={"kind": "window", "samples": samples}
    ).law(1e-3)
    z = np.exp(1j * np.geomspace(1e-4, np.pi, 200))
    expected = 2.5 * (1 - z**-samples) / (samples * 1e-3)
    assert law.transfer(z) == pytest.approx(expected, rel=1e-9, abs=1e-9)
