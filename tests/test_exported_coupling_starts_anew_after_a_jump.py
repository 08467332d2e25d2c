"""A position that no hand brings about is a fault of the sensor: exported C starts anew, and pushes nobody."""

import dataclasses

import numpy as np
import pytest
from exported import WARNINGS, Exported
from hardware_bench import believer, bench_problem, export_c, require, run, scratch, with_gains

from avc_casadi.coupling import Coupling
from avc_casadi.model.device import Detent
from avc_casadi.model.runtime import Runtime

STEP = 2e-5


def laws() -> dict[str, Coupling]:
    """Couplings that remember: an observer between steps, one whose state is fed back, a guard."""
    problem = bench_problem((5.0, 5e3), encoder_resolution_m=STEP, max_force_n=8.0)
    plain = with_gains(problem, 5.0, 4e3, 3.0)
    runtimes = {
        "observer": Runtime("zero-crossing", observer_mass_kg=0.25),
        "state feedback": Runtime("zero-crossing", state_feedback=believer(3)),
        "guard": Runtime("zero-crossing", guard="passivity-controller"),
    }
    return {name: dataclasses.replace(plain, runtime=runtime) for name, runtime in runtimes.items()}


LAWS = laws()


@pytest.mark.parametrize("wrong_m", [0.1, -1.0, 1e6, 0.02])
@pytest.mark.parametrize("name", LAWS)
def test_one_wrong_sample_at_rest_outside_gives_no_force_then_or_later(name: str, wrong_m: float) -> None:
    device = Exported(LAWS[name])
    way = np.full(1200, -5e-3)
    way[100] += wrong_m
    assert np.abs(device.forces(way)).max() == 0


@pytest.mark.parametrize("name", LAWS)
def test_what_comes_after_a_jump_is_a_coupling_that_starts_there(name: str) -> None:
    """To the bit; and the fastest stroke of a hand, 10 m/s, is none."""
    device, fresh = Exported(LAWS[name]), Exported(LAWS[name])
    press = STEP * np.round(np.linspace(-1e-3, 2e-3, 60) / STEP)
    first = device.forces(press)
    assert device.step(press[-1] - 0.02) == 0
    assert device.forces(press).tobytes() == fresh.forces(press).tobytes() == first.tobytes()
    device.start()
    stroke = np.array([-0.015, -0.005, 0.005])  # 10 mm in each sample of 1 ms
    assert device.forces(stroke)[-1] > 0


@pytest.mark.parametrize("name", LAWS)
def test_a_depth_that_is_clipped_at_0_gives_no_force_outside(name: str) -> None:
    """Each contact has the forces of a coupling that starts with it; compiled for a signed position nothing changes."""
    clipped = Exported(LAWS[name], flags=(*WARNINGS, "-DAVC_DEPTH_IS_CLIPPED"))
    fresh = Exported(LAWS[name])
    way = np.maximum(STEP * np.round(2e-3 * np.sin(2 * np.pi * 5 * np.arange(600) * 1e-3) / STEP), 0.0)
    found = clipped.forces(way)
    assert (found[way == 0] == 0).all()
    inside = np.flatnonzero(way > 0)
    contacts = np.split(inside, np.flatnonzero(np.diff(inside) > 1) + 1)
    assert len(contacts) == 3
    for contact in contacts:
        fresh.start()
        assert found[contact].tobytes() == fresh.forces(way[contact]).tobytes()
    assert found.max() > 1


def test_detents_refuse_a_depth_that_is_clipped() -> None:
    """They act in front of the wall, where such a depth is always 0."""
    require("gcc")
    problem = bench_problem((5.0, 5e3), max_force_n=8.0).changed(detent=Detent(pitch_m=0.01, force_n=0.5))
    folder = scratch() / "clipped detents"
    folder.mkdir()
    for name, text in export_c(with_gains(problem, 5.0, 4e3)).items():
        (folder / name).write_text(text, encoding="ascii")
    source = str(folder / "avc_coupling.c")
    run("gcc", "-fsyntax-only", source)
    with pytest.raises(AssertionError, match="they need the position with its sign"):
        run("gcc", "-fsyntax-only", "-DAVC_DEPTH_IS_CLIPPED", source)
