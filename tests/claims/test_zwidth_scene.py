"""`zwidth` says which effects of a scene it does not use: those that change none of its curves."""

from __future__ import annotations

import numpy as np
import pytest
from quick import first

import avc_casadi as avc
from avc_casadi.model import EFFECTS
from avc_casadi.model.declared import effects_of_scene_alone

BASE = """
[device]
mass_kg = 0.1
damping_ns_per_m = 1.0
delay_samples = 1
amplifier_bandwidth_hz = 1000.0
coulomb_friction_n = 0.1
max_force_n = 8.0
encoder_resolution_m = 1e-5
[environment]
stiffness_n_per_m = 1000.0
damping_ns_per_m = 5.0
"""
# Each with a value that differs from the device's, where it has any.
EFFECT_LINES = {
    "hand": "mass_kg = 0.2",
    "stylus-hand": "",
    "detent": "",
    "coulomb-friction": "force_n = 0.5",
    "viscous-friction": "damping_ns_per_m = 5.0",
    "resonance": "frequency_hz = 60.0\ndamping_ratio = 0.02\nmass_ratio = 0.3",
    "backlash": "gap_m = 1e-4",
    "encoder": "resolution_m = 1e-3",
    "noise": "rms_m = 1e-4",
    "notch": "frequency_hz = 80.0",
    "observer": "mass_kg = 0.2",
    "delay": "samples = 4",
    "jitter": "rms_s = 1e-4",
    "amplifier": "bandwidth_hz = 100.0",
    "saturation": "force_n = 2.0",
    "velocity-filter": "cutoff_hz = 50.0",
    "estimator": "",
    "adaptation": "",
    "guard": "",
}


def region(effects: str):
    return avc.zwidth(avc.parse_problem(f"{BASE}{effects}"))


def table(kind: str) -> str:
    return f'[[scene.effects]]\nkind = "{kind}"\n{EFFECT_LINES[kind]}\n'


@pytest.mark.parametrize("kind", first(sorted(EFFECT_LINES.keys() - {"detent"}), 6))
def test_an_effect_that_changes_no_curve_is_named(kind: str) -> None:
    bare, with_effect = region(""), region(table(kind))
    pairs = zip(bare.curves, with_effect.curves, strict=False)
    same = len(bare.curves) == len(with_effect.curves)
    same &= all(np.array_equal(a.stiffness_n_per_m, b.stiffness_n_per_m, equal_nan=True) for a, b in pairs)
    named = [name for name in with_effect.not_used if name.startswith(f"scene.effects: {kind}")]
    assert bool(named) is same, (kind, with_effect.not_used)
    assert any(name.startswith(f"scene.effects: {kind}") for name in with_effect.used) is not same


def test_every_kind_of_effect_is_tried() -> None:
    of_other_tables = {"wall", "environment", "simulation", "law"}
    of_couplings = {kind for kind in EFFECTS if EFFECTS[kind].of_coupling}
    assert set(EFFECTS) - of_other_tables - of_couplings <= set(EFFECT_LINES)


def test_an_effect_that_repeats_the_device_is_not_named() -> None:
    again = "".join(
        f'[[scene.effects]]\nkind = "{kind}"\n{line}\n'
        for kind, line in (
            ("amplifier", "bandwidth_hz = 1000.0"),
            ("delay", "samples = 1"),
            ("saturation", ""),
            ("coulomb-friction", "force_n = 0.1"),
            ("wall", ""),
        )
    )
    assert not [name for name in region(again).not_used if name.startswith("scene")]


def test_of_a_simulation_no_effect_of_the_scene_is_used() -> None:
    device = BASE.partition("[environment]")[0]
    problem = avc.parse_problem(f"{device}[simulation]\nstep_s = 0.002\ntool_mass_kg = 0.2\n{table('notch')}")
    assert effects_of_scene_alone(problem) == ("scene.effects: notch",)
