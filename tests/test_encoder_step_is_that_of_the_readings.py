"""The step of the encoder is found from readings, however few of the steps between them a fast motion leaves."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from avc_casadi.identification.encoder import encoder_step_m
from avc_casadi.identification.record import Record

ROUNDED = {
    "as they are": lambda position, _: position,
    "float32": lambda position, _: position.astype(np.float32).astype(float),
    "eight digits": lambda position, _: np.array([float(f"{each:.8g}") for each in position]),
    "a tenth of a step": lambda position, step: np.round(position / (0.1 * step)) * (0.1 * step),
}


def readings(seed, step, travel_steps, samples):
    random = np.random.default_rng(seed)
    motion = np.cumsum(np.cumsum(random.normal(size=samples)))
    motion = (motion - motion.min()) / np.ptp(motion) * step * travel_steps
    return np.round(motion / step + random.uniform()) * step


@pytest.mark.thorough
@pytest.mark.parametrize("rounded", ROUNDED)
@given(
    seed=st.integers(0, 2**32 - 1),
    step=st.floats(-7, -4).map(lambda power: 10**power),
    travel_steps=st.floats(1.3, 5).map(lambda power: 10**power),
    samples=st.integers(2000, 12_000),
)
def test_it_is_found(rounded, seed, step, travel_steps, samples):
    position = ROUNDED[rounded](readings(seed, step, travel_steps, samples), step)
    found = encoder_step_m([Record("log", 1e-3, position, np.zeros(samples))])
    assert found == pytest.approx(step, rel=1e-3)


@given(seed=st.integers(0, 2**32 - 1))
def test_noise_has_none(seed):
    random = np.random.default_rng(seed)
    position = readings(seed, 1e-6, 1e3, 4000) + 1e-6 * random.normal(size=4000)
    assert encoder_step_m([Record("log", 1e-3, position, np.zeros(4000))]) is None
