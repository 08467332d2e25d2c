"""Levels L0 to L4 with amplifier, resonance and any delay, against the impedance at the handle written out as a matrix.

The hand moves at all aliases of a frequency at once; the impedance that it meets is a matrix over them, written down
here from the equations of motion, and its Hermitian part says what is passive.
"""

import numpy as np
import pytest
from declared_device import MODE, lowest_eigenvalue, port_equations, random_device, rendered
from quick import first

import avc_casadi as avc
from avc_casadi.claims.certify import certify
from avc_casadi.claims.port import CouplingSlack, RenderingSlack, handle_port, port_worst
from avc_casadi.loops.wall import SampledLoop, fractions
from avc_casadi.model.corners import device_corners
from avc_casadi.model.device import Device
from avc_casadi.model.gains import Status
from avc_casadi.paper.rows import gain_schedule


def extrapolated(device, impedance, turns):
    """What is left out of the matrix falls with the number of aliases."""
    (few, least), (many, _) = (lowest_eigenvalue(device, impedance, turns, n) for n in (120, 240))
    return min(2 * many - few, least)


@pytest.mark.parametrize("seed", [0, 1, 2, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (3, 4, 5))])
def test_the_margin_is_the_lowest_eigenvalue_of_the_impedance_at_the_handle(seed):
    rng = np.random.default_rng(seed)
    device = Device(**random_device(rng))
    gains, wall = 10 ** rng.uniform([-1, 2, -2], [1, 4, 0.5]), 10 ** rng.uniform([-1, 2], [1, 4])
    parts = fractions(
        SampledLoop(0.0, *wall, device.sample_time_s, 0, "sampled-data"), *(np.array([v]) for v in gains[:2])
    )
    found = port_worst([device], RenderingSlack(parts, gains[2:]), 1)
    slack = RenderingSlack(parts, gains[2:])
    for turns in (1e-3, 0.03, 0.2, 0.45, found.frequency_hz[0] * device.sample_time_s):
        if turns < 1e-4:
            continue
        z = np.exp(2j * np.pi * turns)
        expected = extrapolated(device, rendered(gains, wall, device.sample_time_s, z), turns)
        left = slack(handle_port(device, np.array([turns / device.sample_time_s])), np.array([0]))[0][0, 0]
        if abs(expected) > 1e-2:
            assert (left > 0) == (expected > 0)
        if turns == found.frequency_hz[0] * device.sample_time_s:
            assert found.margin_ns_per_m[0] == pytest.approx(expected, rel=2e-3, abs=2e-3)
            assert found.passed[0] == (found.margin_ns_per_m[0] >= 0)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_the_worst_frequency_is_not_missed(seed):
    """A scan of this many points, equally spaced, finds nothing lower than the search."""
    rng = np.random.default_rng(100 + seed)
    device = Device(**random_device(rng))
    wall = 10 ** rng.uniform([-1, 2], [1, 4])
    b, k, contact = 10 ** rng.uniform([-1, 2, -2], [1, 4, 0.5], (5, 3)).T
    slack = RenderingSlack(fractions(SampledLoop(0.0, *wall, device.sample_time_s, 0, "sampled-data"), b, k), contact)
    found = port_worst([device], slack, 5)
    rows = np.arange(5)
    least = slack(handle_port(device, np.linspace(1e-4, 0.5, 6000) / device.sample_time_s), rows)[0].min(axis=1)
    own = slack(handle_port(device, found.frequency_hz[:, None]), rows)[0][:, 0]
    assert (own <= least + 1e-6 * (1 + np.abs(least))).all()


def table(case, b, k, contact=0.0):
    n = len(case.frequencies_hz())
    gains = tuple(np.broadcast_to(np.asarray(value, dtype=float), (n,)) for value in (b, k, contact))
    return gain_schedule(case, "file", gains, (Status.SOLVED,) * n)


def problem(model="sampled-data", **device):
    return avc.parse_problem(
        "[device]\nmass_kg=0.1\ndamping_ns_per_m=3.0\n[environment]\ndamping_ns_per_m=1.0\nstiffness_n_per_m=2e4\n"
        f"[stability]\nmodel='{model}'\n[frequency]\nstart_hz=1.0\nstop_hz=240.0\npoints=8\n"
    ).changed(device=device)


DECLARED = {
    "amplifier": {"amplifier_bandwidth_hz": 300.0},
    "current loop": {"amplifier_bandwidth_hz": 300.0, "amplifier_order": 2},
    "resonance": {"resonance": MODE},
    "encoder at the handle": {"resonance": MODE, "encoder_at": "handle"},
    "fraction": {"delay_samples": 0.5},
    "all": {"resonance": MODE, "amplifier_bandwidth_hz": 600.0, "delay_samples": 1.3},
}


@pytest.mark.parametrize(
    ("device", "model"),
    [
        # The two holds in turn from device to device; the other one of each takes longer.
        pytest.param(device, model, id=f"{name}-{model}", marks=pytest.mark.slow if (row + place) % 2 else ())
        for row, (name, device) in enumerate(DECLARED.items())
        for place, model in enumerate(("paper", "sampled-data"))
    ],
)
def test_own_frequency_and_band_are_the_papers_impedance_with_the_devices_responses(device, model):
    case = problem(model, **device)
    b, k, contact = 2.0, 1500.0, 0.5
    levels = certify(case, table(case, b, k, contact), draws=0).levels
    time, wall = case.device.sample_time_s, case.environment

    def real(frequency):
        s, z = 2j * np.pi * frequency, np.exp(2j * np.pi * frequency * time)
        rate = (1 - 1 / z) / time
        wall_rate = 2 / time * (z - 1) / (z + 1) if model == "paper" else rate
        hold = (z + 1) / (2 * z) if model == "paper" else 1 / z
        alone, tau, seen, admittance, amplifier = port_equations(case.device, s)
        coupling = b + k / rate
        environment = wall.damping_ns_per_m + wall.stiffness_n_per_m / wall_rate
        total = (coupling * environment / (coupling + environment) + contact) * hold * amplifier
        total = total * np.exp(-s * case.device.delay_samples * time)
        return (alone + tau * seen * total / (1 + total * admittance)).real

    own = case.frequencies_hz()
    np.testing.assert_allclose(levels["L0"].row_margin_ns_per_m, real(own), rtol=1e-9, atol=1e-9)
    for row, frequency in enumerate(own):
        lowest = real(np.minimum(np.geomspace(frequency / 2, frequency * 2, 20001), 0.5 / time)).min()
        assert levels["L1"].row_margin_ns_per_m[row] == pytest.approx(lowest, rel=1e-5, abs=1e-6)
    assert levels["L0"].passed == (levels["L0"].row_margin_ns_per_m >= 0).all()


@pytest.mark.parametrize("device", first(DECLARED.values()), ids=DECLARED)
def test_llewellyns_level_is_the_worst_of_all_passive_walls(device):
    """At each frequency the wall may be any impedance with a real part that is not negative."""
    device, rng = problem(**device).device, np.random.default_rng(3)
    time, edges = device.sample_time_s, 0
    wall = np.append(1j * np.tan(np.linspace(-1.5707, 1.5707, 4001)), 0.0)
    for turns in (2e-3, 0.03, 0.2, 0.45):
        port, z = handle_port(device, np.array([turns / time])), np.exp(2j * np.pi * turns)

        def worst(gains, port=port, z=z):
            coupling = gains[0] + gains[1] * time / (1 - 1 / z)
            any_wall = wall * abs(coupling)
            w = (coupling * any_wall / (coupling + any_wall) + gains[2]) / z
            return (np.abs(1 + w * port.centre) - np.abs(w) * port.spread).min()

        def left(gains, port=port):
            return CouplingSlack(*gains[:, None], time)(port, np.array([0]))[0][0, 0]

        for gains in 10 ** rng.uniform([-1, 1, -1], [1, 3, 0.8], (6, 3)):
            # Not every stiffer coupling is worse: the first edge.
            steps = np.geomspace(1e-3, 1e4, 120)
            fails = [step for step in steps if worst(step * gains) < 0]
            if not fails or fails[0] == steps[0]:
                continue
            low, high = fails[0] * steps[0] / steps[1], fails[0]
            for _ in range(30):
                middle = (low + high) / 2
                low, high = (middle, high) if worst(middle * gains) >= 0 else (low, middle)
            edges += 1
            assert left(0.998 * low * gains) >= 0 > left(1.002 * low * gains)
    assert edges > 5


@pytest.mark.slow
def test_every_corner_of_the_declared_device_counts():
    ranges = {"mass_kg": (0.05, 0.2), "amplifier_bandwidth_hz": (60.0, 900.0), "delay_samples": (0, 1.5)}
    case = problem(amplifier_bandwidth_hz=600.0, resonance=MODE, range=ranges)
    gains = table(case, 1.0, 1500.0)
    levels = certify(case, gains, draws=0).levels
    corners = [case.changed(device=corner) for corner in device_corners(case.device)]
    assert len(corners) == 8
    alone = [certify(corner, gains, draws=0).levels for corner in corners]
    for name in ("L0", "L1", "L3", "L4"):
        assert levels[name].passed == all(one[name].passed for one in alone)
    assert levels["L0"].margin_ns_per_m == min(one["L0"].margin_ns_per_m for one in alone)
    assert not levels["L3"].passed
    assert any(one["L3"].passed for one in alone)
