"""What `dump_problem` writes loads as an equal problem, for any problem."""

import tomllib

import numpy as np
import pytest
from drawn_problems import drawn_problem

import avc_casadi as avc

EFFECTS = {
    "hand": {"mass_kg": 0.0},
    "stylus-hand": {},
    "wall": {"stiffness_n_per_m": 1e7},
    "environment": {},
    "simulation": {"stiffness_n_per_m": 900.0, "dropped_share": 0.1},
    "coulomb-friction": {"force_n": 0.3},
    "detent": {},
    "viscous-friction": {},
    "resonance": {"frequency_hz": 120, "damping_ratio": 0.01, "mass_ratio": 0.3},
    "encoder": {"resolution_m": 2e-5},
    "noise": {"rms_m": 1e-7, "seed": 4},
    "backlash": {"gap_m": 1e-4},
    "notch": {"frequency_hz": 120.0, "depth": 0.1},
    "velocity-filter": {"cutoff_hz": 50.0},
    "observer": {"mass_kg": 0.2},
    "state-feedback": {
        "state": [[1.0, 0.5], [0.0, 0.9]],
        "force_m_per_n": [-1e-6, -2e-6],
        "innovation": [0.5, 0.1],
        "feedback": [1.0, 0.4],
        "positions": [0],
        "dead_zone_m": 1e-5,
    },
    "delay": {"samples": 2.5},
    "jitter": {"rms_s": 1e-5, "dropped_share": 0.01},
    "amplifier": {"bandwidth_hz": 300.0, "order": 2},
    "saturation": {"force_n": 5.0},
    "estimator": {"method": "spectral-peak"},
    "adaptation": {"hold_s": 0.1, "slew_per_s": 20.0, "passive": False},
    "guard": {"method": "energy-tank"},
}
DEVICE = {
    "mass_kg": 0.3,
    "encoder_at": "handle",
    "amplifier_bandwidth_hz": 700.0,
    "resonance": {"frequency_hz": 150.0, "damping_ratio": 0.05, "mass_ratio": 0.5},
    "range": {"delay_samples": (0, 1000), "resonance": {"frequency_hz": (50.0, 400.0)}},
}
TEXT = "a 'quoted' \"line\", \\ and\n\ttwo \u00b5m \U0001f91a"


@pytest.mark.parametrize("seed", range(30))
def test_a_written_problem_loads_equal(seed):
    rng = np.random.default_rng(seed)
    chosen = [{"kind": kind, **keys} for kind, keys in EFFECTS.items() if rng.random() < 0.3]
    problem = drawn_problem(rng).changed(scene={"effects": chosen}, title=TEXT, source=TEXT)
    problem = problem.changed(device=DEVICE) if seed % 2 else problem
    written = avc.dump_problem(problem)
    assert avc.parse_problem(written, name=problem.name) == problem
    assert tomllib.loads(written)["title"] == TEXT


@pytest.mark.parametrize("entry", avc.catalogue(), ids=lambda entry: entry.name)
def test_every_catalogue_problem_survives(entry):
    problem = avc.load_problem(entry.name)
    assert avc.parse_problem(avc.dump_problem(problem), name=entry.name) == problem
