"""Detents in the exported C: the bits of the scene's expressions, and the sine of their definition."""

import dataclasses
import math

import numpy as np
import pytest
from exported import C99, CLANG_CPP17, CPP11, Exported
from exported_bench import ran
from exported_cases import motions, notched
from hardware_bench import coupling
from reference_coupling import ReferenceCoupling

from avc_casadi.simulation.emit import PRECISIONS

# Nothing beside the gains; a table; observer and tank; a controller; state feedback.
SEEDS = (0, 1, 2, 7, 16)


def forces_of(seed: int, precision: str = "single") -> np.ndarray:
    ways = motions(notched(seed))
    devices = ReferenceCoupling(notched(seed), len(ways), PRECISIONS[precision])
    return np.stack([devices.step(column) for column in ways.T], axis=1)


@pytest.mark.thorough
@pytest.mark.parametrize("seed", SEEDS)
def test_compiled_detents_have_the_bits_of_the_expressions(seed: int) -> None:
    compiler = (C99, CPP11, CLANG_CPP17)[seed % 3]
    device = Exported(notched(seed), compiler=compiler)
    for way, forces in zip(motions(notched(seed)), forces_of(seed), strict=True):
        device.start()
        assert device.forces(way).tobytes() == forces.tobytes()


@pytest.mark.thorough
@pytest.mark.parametrize(("board", "seed"), [("Cortex-M0", 0), ("ATmega328P", 2)])
def test_a_small_processor_has_the_same_bits(board: str, seed: int) -> None:
    ways = motions(notched(seed))[:, :60]
    assert ran(board, notched(seed), ways).forces.tobytes() == forces_of(seed)[:, :60].tobytes()


@pytest.mark.parametrize(("precision", "off"), [("single", 2e-5), ("double", 1e-12)])
@pytest.mark.parametrize("width", [1.0, 0.3])
def test_the_force_in_front_of_the_wall_is_that_of_the_definition(precision: str, off: float, width: float) -> None:
    pitch, centre = 2e-3, -3.3e-3
    made = dataclasses.replace(
        coupling(1),
        problem=coupling(1).problem.changed(
            detent={"force_n": 1.0, "pitch_m": pitch, "width": width, "centre_m": centre}
        ),
    )
    step = made.problem.device.encoder_resolution_m or 1e-6
    places = -step * np.round(np.linspace(1e-6, 0.05, 400) / step)
    from_valley = (places - centre) / pitch - np.round((places - centre) / pitch)
    expected = np.where(np.abs(from_valley) < width / 2, np.sin(2 * math.pi * from_valley / width), 0.0)
    near_an_edge = np.abs(np.abs(from_valley) - width / 2) < 1e-3
    forces = Exported(made, precision=precision).forces(places)
    # A valley is as far away as single precision tells a place some thousand times its distance.
    assert np.abs(forces - expected)[~near_an_edge].max() < off * 50 / width
