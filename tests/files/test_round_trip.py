"""What `dump_problem` writes loads as an equal problem, for any problem."""

import tomllib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import avc_casadi as avc
from avc_casadi.model.device import Device, DeviceRange, Resonance, ResonanceRange
from avc_casadi.model.problem import (
    Boundaries,
    Frequency,
    GainBox,
    Hands,
    Impedance,
    Problem,
    Realism,
    ScheduleSettings,
    Stability,
)
from avc_casadi.model.scene import Scene

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


def number(lowest, highest, *, zero=True):
    values = st.floats(lowest, highest)
    return st.one_of(st.just(0.0), values) if zero else values


damping, stiffness, mass = number(1e-9, 1e9), number(1e-9, 1e12), number(1e-9, 1e6)
text = st.text(st.characters(exclude_categories=["Cc", "Cs"], include_characters="\n\t"), max_size=30)


def interval(values):
    return st.tuples(values, values).map(lambda pair: tuple(sorted(pair)))


def about(value):
    return st.tuples(st.floats(0, 1), st.floats(1, 2)).map(
        lambda f: (max(value * f[0], min(value, 1e-9)), value * f[1])
    )


@st.composite
def frequencies(draw, sample_time):
    below = 0.49 / sample_time
    if draw(st.booleans()):
        return Frequency(values_hz=sorted(draw(st.sets(st.floats(1e-6, below), min_size=1, max_size=5))))
    start, stop = draw(st.floats(1e-6, below / 4)), draw(st.floats(below / 2, below))
    points = draw(st.integers(1, 10_000))
    return Frequency(start_hz=start, stop_hz=stop, points=points, spacing=draw(st.sampled_from(["log", "linear"])))


@st.composite
def motions(draw):
    kind = draw(st.sampled_from(["press", "tap", "hold", "stroke", "free"]))
    motion = {"kind": kind, "start_m": draw(st.one_of(st.just(0.0), st.floats(-10, -1e-9)))}
    return motion | ({"amplitude_m": draw(number(1e-12, 1))} if kind in {"stroke", "free"} else {})


@st.composite
def problems(draw):
    low = draw(st.builds(Impedance, damping_ns_per_m=number(1e-9, 1e8), stiffness_n_per_m=number(1e-9, 1e11)))
    high = Impedance(damping_ns_per_m=low.damping_ns_per_m * 2, stiffness_n_per_m=low.stiffness_n_per_m * 3)
    nominal = draw(st.floats(1e-3, 10))
    sample_time = draw(st.floats(1e-6, 0.1))
    structure = draw(st.sampled_from(["series", "damped"]))
    mode = draw(st.one_of(st.none(), st.just(Resonance(frequency_hz=150.0, damping_ratio=0.05, mass_ratio=0.5))))
    kinds = draw(st.lists(st.sampled_from(sorted(EFFECTS)), max_size=4))
    return Problem(
        name=draw(text),
        title=draw(text),
        source=draw(text),
        device=Device(
            mass_kg=nominal,
            damping_ns_per_m=draw(damping),
            sample_time_s=sample_time,
            delay_samples=draw(st.one_of(st.integers(0, 1000), st.floats(1e-3, 1000))),
            position_noise_rms_m=draw(number(1e-12, 1)),
            amplifier_bandwidth_hz=draw(st.one_of(st.none(), st.floats(1e-6, 1e7))),
            amplifier_order=draw(st.sampled_from([1, 2])),
            max_force_n=draw(st.one_of(st.none(), st.floats(1e-6, 1e6))),
            backlash_m=draw(number(1e-12, 1)),
            resonance=mode,
            encoder_at=draw(st.sampled_from(["motor", "handle"])),
            range=DeviceRange(
                mass_kg=draw(st.one_of(st.none(), about(nominal))),
                delay_samples=draw(st.just((0, 1000)) | st.none()),
                resonance=ResonanceRange(frequency_hz=(50.0, 400.0)) if draw(st.booleans()) else ResonanceRange(),
            )
            if mode
            else DeviceRange(),
        ),
        environment=draw(st.builds(Impedance, damping_ns_per_m=damping, stiffness_n_per_m=stiffness)),
        boundaries=Boundaries(upper=high, lower=low),
        coupling=GainBox(
            structure=structure,
            damping_ns_per_m=draw(interval(damping)),
            stiffness_n_per_m=draw(interval(stiffness)),
            contact_damping_ns_per_m=(0.0, 0.0) if structure == "series" else draw(interval(damping)),
        ),
        stability=draw(st.builds(Stability, band_factor=st.floats(1, 1e6), margin_ns_per_m=damping)),
        realism=draw(st.builds(Realism, jnd=st.floats(1e-3, 0.999), require=st.sampled_from(["none", "jnd"]))),
        schedule=draw(
            st.builds(
                ScheduleSettings,
                slope_limit=st.one_of(st.none(), st.floats(1e-6, 1e6)),
                interaction_hz=st.one_of(st.none(), interval(st.floats(1e-3, 1e3))),
                contact_damping_penalty=st.floats(1e-12, 1e6),
                hand_damping_ns_per_m=damping,
            )
        ),
        hands=draw(st.builds(Hands, mass_kg=interval(mass))),
        frequency=draw(frequencies(sample_time)),
        scene=Scene(motion=draw(motions()), effects=[{"kind": kind, **EFFECTS[kind]} for kind in kinds]),
    )


@pytest.mark.slow
@settings(max_examples=200)
@given(problems())
def test_a_written_problem_loads_equal(problem):
    written = avc.dump_problem(problem)
    assert avc.parse_problem(written, name=problem.name) == problem
    assert tomllib.loads(written)["title"] == problem.title


@pytest.mark.parametrize("entry", avc.catalogue(), ids=lambda entry: entry.name)
def test_every_catalogue_problem_survives(entry):
    problem = avc.load_problem(entry.name)
    assert avc.parse_problem(avc.dump_problem(problem), name=entry.name) == problem
