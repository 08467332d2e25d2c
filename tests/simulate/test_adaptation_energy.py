"""A change of the gains never raises the stored energy, whatever the deflection; a naive change does."""

import numpy as np
import pytest

from avc_casadi.simulation.runtime.adaptation import AdaptationSettings, adaptation_step

T = 1e-3
CHANGES = 10_000


def _drawn(seed):
    """Gains over 8 decades, deflections to 20 mm either way, anchors anywhere between."""
    rng = np.random.default_rng(seed)
    before, after = 10.0 ** rng.uniform(0, 8, (2, CHANGES))
    before[:100], after[50:150] = 0.0, 0.0
    deflection = rng.uniform(-0.02, 0.02, CHANGES)
    return before, after, deflection, deflection * rng.uniform(-1, 2, CHANGES)


def _changed(step, before, after, deflection, anchor, tank=0.0):
    """Run one tick of many springs at once from a given past; returns the outputs by name."""
    stored = 0.5 * before * (deflection - anchor) ** 2
    past = {"started": 1.0, "stiffness_n_per_m": before, "anchor_m": anchor, "tank_j": tank, "stored_j": stored}
    now = {"wanted_stiffness_n_per_m": after, "deflection_m": deflection, "touching": 1.0}
    state, inputs = (
        np.array([np.broadcast_to(values.get(name, 0.0), CHANGES) for name in names])
        for values, names in ((past, step.states), (now, step.inputs))
    )
    outputs = step.function.map(CHANGES)(state, inputs, np.zeros((0, CHANGES)))[1].full()
    return stored, dict(zip(step.outputs, outputs, strict=True))


def _energy(outputs, deflection):
    return 0.5 * outputs["stiffness_n_per_m"] * (deflection - outputs["anchor_m"]) ** 2


@pytest.mark.parametrize("slew", [None, 50.0])
def test_ten_thousand_random_changes_create_none(slew):
    before, after, deflection, anchor = _drawn(1)
    step = adaptation_step(T, AdaptationSettings(slew_per_s=slew))
    stored, outputs = _changed(step, before, after, deflection, anchor)
    created = _energy(outputs, deflection) - stored
    assert np.count_nonzero(created > 1e-12 * stored) == 0


def test_force_is_held_where_stiffness_rises_and_falls_with_it_otherwise():
    before, after, deflection, anchor = _drawn(2)
    step = adaptation_step(T, AdaptationSettings())
    stored, outputs = _changed(step, before, after, deflection, anchor)
    force = outputs["stiffness_n_per_m"] * (deflection - outputs["anchor_m"])
    held = before * (deflection - anchor)
    rises = after > before
    # Towards 0 the anchor moves freely where that gives energy back; there the force falls further. Rounding: of the
    # deflection, and of the stored energy, which the tank may hold.
    expected = np.where(rises, held, after * (deflection - anchor))
    rounding = after * 1e-17 + np.sqrt(2 * after * 1e-14 * stored)
    assert np.all(np.abs(force) <= np.abs(expected) * (1 + 1e-9) + rounding)
    outward = rises & (np.sign(deflection - anchor) == np.sign(anchor)) & (np.abs(anchor) < np.abs(deflection))
    assert outward.sum() > 1000
    np.testing.assert_allclose(force[outward], held[outward], rtol=1e-7, atol=1e-6)


def test_anchor_returns_to_zero_under_load_on_dissipated_energy_and_at_once_outside():
    step = adaptation_step(T, AdaptationSettings(return_s=0.05))
    ticks = 3000
    wanted = np.where(np.arange(ticks) < 100, 1e4, 1e5)
    # A damper beside the spring: the held force takes in 0.1 W that nothing stores.
    position = 1e-3 + 2e-3 * np.sin(2 * np.pi * 5 * np.arange(ticks) * T)
    force = np.gradient(position, T) * 50.0
    inputs = {
        "wanted_stiffness_n_per_m": wanted,
        "deflection_m": np.full(ticks, 1e-3),
        "held_force_n": np.roll(force, 1),
        "position_m": position,
        "touching": np.arange(ticks) < 2900,
    }
    rows = np.array([inputs.get(name, np.zeros(ticks)) for name in step.inputs], dtype=float)
    anchor = step.run(rows)["anchor_m"]
    assert anchor[99] == 0.0
    assert anchor[100] > 0.8e-3
    assert abs(anchor[2899]) < 0.05 * anchor[100]
    assert anchor[2900] == 0.0


def test_without_anchor_the_published_switch_injects_45_mj():
    step = adaptation_step(T, AdaptationSettings(passive=False))
    rows = {"wanted_stiffness_n_per_m": [1e4, 1e5], "deflection_m": [1e-3, 1e-3]}
    found = step.run(np.array([rows.get(name, [0.0, 0.0]) for name in step.inputs]))
    energy = 0.5 * found["stiffness_n_per_m"] * 1e-3**2
    assert energy[1] - energy[0] == pytest.approx(45e-3, rel=1e-12)
