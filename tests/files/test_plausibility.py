"""What a device declares is named, and values far from what is usual are doubted, not refused."""

import pytest

import avc_casadi as avc
from avc_casadi.files.plausibility import plausibility
from avc_casadi.recommendation.preconditions import assumed

PLAIN = {"mass_kg": 0.1, "damping_ns_per_m": 2.0, "sample_time_s": 1e-3}
MODE = {"frequency_hz": 150.0, "damping_ratio": 0.05, "mass_ratio": 0.5}


def problem(device=PLAIN, **tables):
    bare = avc.parse_problem(
        "[device]\nmass_kg=0.1\ndamping_ns_per_m=2\n[environment]\ndamping_ns_per_m=1\nstiffness_n_per_m=1e3\n",
        name="p",
    )
    return bare.changed(device=device, **tables)


@pytest.mark.parametrize(
    ("tables", "key"),
    [
        ({"device": {"mass_kg": 250.0}}, "device.mass_kg"),
        ({"environment": {"stiffness_n_per_m": 8.0}}, "environment.stiffness_n_per_m"),
        ({"device": {"encoder_resolution_m": 0.06}}, "device.encoder_resolution_m"),
        ({"device": {"sample_time_s": 1.0}, "frequency": {"values_hz": [0.1]}}, "device.sample_time_s"),
        ({"device": {"position_noise_rms_m": 2e-4}}, "device.position_noise_rms_m"),
        ({"device": {"delay_samples": 0.001}}, "device.delay_samples"),
        ({"device": {"range": {"delay_samples": [0.0, 0.0025]}}}, "device.range.delay_samples"),
        ({"device": {"max_force_n": 0.01}}, "device.max_force_n"),
        ({"device": {"resonance": MODE | {"frequency_hz": 1e4}}}, "device.resonance.frequency_hz"),
        ({"device": {"range": {"mass_kg": [1e-6, 9.0]}}}, "device.range.mass_kg"),
        ({"device": {"encoder_at": "handle"}}, "device.encoder_at"),
        ({"device": {"amplifier_order": 2}}, "device.amplifier_order"),
        ({"device": {"amplifier_damping_ratio": 0.5}}, "device.amplifier_damping_ratio"),
        ({"device": {"range": {"amplifier_damping_ratio": [0.5, 0.9]}}}, "device.range.amplifier_damping_ratio"),
        ({"device": {"backlash_m": 1e-4, "encoder_at": "handle", "resonance": MODE}}, "device.backlash_m"),
        ({"device": {"coulomb_friction_n": 3.0, "max_force_n": 2.0}}, "device.coulomb_friction_n"),
        ({"hands": {"damping_ns_per_m": (0, 0), "stiffness_n_per_m": (0, 0)}}, "hands.stiffness_n_per_m"),
    ],
)
def test_an_unlikely_value_is_doubted_and_valid(tables, key):
    (doubt,) = plausibility(problem().changed(**tables))
    assert doubt.key == key
    assert any(f"{key} {doubt.message}" in line for line in assumed(problem().changed(**tables)))
