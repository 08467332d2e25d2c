"""The toy of `avc explore`, run in Chromium, against the compiled scene."""

import json
import threading

import numpy as np
import pytest
from browser import chromium
from hardware_bench import believer

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.model.gains import NO_COUPLING, Gains
from avc_casadi.model.runtime import Runtime
from avc_casadi.present.explore.explorer import Explorer
from avc_casadi.present.explore.server import ExploreServer
from avc_casadi.present.explore.toy import toy_document
from avc_casadi.simulation.scene import simulate


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    explorer = Explorer(avc.load_problem("figure5").changed(frequency={"points": 8}), "figure5")
    with ExploreServer(explorer) as started, chromium(tmp_path_factory.mktemp("browser")) as driver:
        threading.Thread(target=started.serve_forever, daemon=True).start()
        driver.get(started.url)
        yield driver
        started.shutdown()


@pytest.mark.thorough
@pytest.mark.parametrize("gains", [None, (0.0, 6e3, 12.0), (4.0, 2e4, 0.0)])
def test_the_page_moves_the_device_as_the_scene_does(page, gains):
    """The toy's own loop against the compiled scene, on a device with all that the toy knows."""
    problem = avc.load_problem("figure5").changed(
        device={
            "delay_samples": 1.5,
            "encoder_resolution_m": 2e-5,
            "amplifier_bandwidth_hz": 1000.0,
            "max_force_n": 3.0,
            "resonance": {"frequency_hz": 150.0, "damping_ratio": 0.05, "mass_ratio": 0.4},
        },
        environment={"stiffness_n_per_m": 4e3, "damping_ns_per_m": 1.0},
        boundaries={"upper": {"stiffness_n_per_m": 4e3}, "lower": {"stiffness_n_per_m": 4e3}},
        scene={"duration_s": 0.4, "integrator": "projected", "substeps": 4},
    )
    coupling = None if gains is None else avc.Coupling.constant(problem, coupling_gains(gains), "typed")
    run = simulate(problem, coupling_gains(gains) if coupling is None else coupling)
    moved = driven(page, problem, coupling, run)
    np.testing.assert_allclose(moved[:, 0], run.position_m, rtol=0, atol=1e-9)
    np.testing.assert_allclose(moved[:, 1], run.force_n, rtol=0, atol=1e-5)
    assert np.abs(run.force_n).max() > 1.0


@pytest.mark.thorough
def test_the_page_feeds_back_the_believed_state_as_the_scene_does(page):
    problem = avc.load_problem("figure5").changed(
        scene={"duration_s": 0.5, "integrator": "projected", "substeps": 4}, device={"encoder_resolution_m": 1e-5}
    )
    runtime = Runtime(state_feedback=believer(1))
    coupling = Coupling.constant(problem, Gains(0.0, 1e8), "believer", runtime)
    run = simulate(problem, coupling)
    moved = driven(page, problem, coupling, run)
    kept = slice(0, 200)  # the loop amplifies what rounding leaves
    np.testing.assert_allclose(moved[kept, 0], run.position_m[kept], rtol=0, atol=1e-9)


@pytest.mark.thorough
def test_the_page_turns_a_knob_through_its_detents_as_the_scene_does(page):
    problem = avc.load_problem("knob").changed(
        scene={"duration_s": 0.4, "integrator": "projected", "substeps": 4},
        detent={"width": 0.6, "damping_ns_per_m": 2e-4},
    )
    coupling = avc.Coupling.constant(problem, Gains(0.0, 20.0, 2e-3), "typed")
    run = simulate(problem, coupling)
    moved = driven(page, problem, coupling, run)
    np.testing.assert_allclose(moved[:, 0], run.position_m, rtol=0, atol=1e-9)
    np.testing.assert_allclose(moved[:, 1], run.force_n, rtol=0, atol=1e-7)
    assert run.force_n.min() < 0 < run.force_n.max()


def coupling_gains(gains):
    return NO_COUPLING if gains is None else Gains(*gains)


def driven(page, problem, coupling, run):
    """Let the page's loop follow the scene's target; returns position and force at every sample."""
    numbers = json.dumps(toy_document(problem, coupling))
    speed = np.gradient(run.target_m, run.sample_time_s)
    target = np.stack([run.target_m, np.r_[np.diff(run.target_m) / run.sample_time_s, speed[-1]]], axis=1)
    return np.array(
        page.execute_async_script(
            """
            const [numbers, targets, start, done] = arguments;
            import(new URL('loop.js', location.href)).then(({ gainsAt, Loop }) => {
              const found = JSON.parse(numbers);
              const loop = new Loop(found, found.rows ? gainsAt(found.rows, 1) : null, start);
              done(targets.map(([position, velocity]) => {
                const before = loop.position_m;
                loop.step(position, velocity);
                return [before, loop.force];
              }));
            });
            """,
            numbers,
            target.tolist(),
            float(run.position_m[0]),
        )
    )
