"""The sampled plant of a device: an independent exponential, and the Jacobian of the scene with the same effects."""

import re

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import expm

import avc_casadi as avc
from avc_casadi.loops.plant_family import plants_of
from avc_casadi.model.device import Device
from avc_casadi.model.gains import NO_COUPLING
from avc_casadi.model.hands import Hand, StylusHand
from avc_casadi.model.plant import sampled_plant
from avc_casadi.simulation.compile import build_effects, compile_scene
from avc_casadi.simulation.effects.mechanics import Grip

SPRING = 700.0


def random_device(rng):
    order = int(rng.integers(0, 3))
    amplifier = {"amplifier_bandwidth_hz": rng.uniform(100, 3000), "amplifier_order": order}
    amplifier["amplifier_damping_ratio"] = rng.uniform(0.2, 2.0)
    mode = {
        "frequency_hz": rng.uniform(30, 400),
        "damping_ratio": rng.uniform(0, 0.3),
        "mass_ratio": rng.uniform(0.1, 0.9),
    }
    delay = int(rng.integers(0, 4)) if rng.random() < 0.3 else round(rng.uniform(0, 3), 3)
    return Device.model_validate(
        {
            "mass_kg": rng.uniform(0.02, 1.0),
            "damping_ns_per_m": rng.uniform(0, 5.0),
            "sample_time_s": rng.uniform(2e-4, 2e-3),
            "delay_samples": delay,
            **(amplifier if order else {}),
            **({"resonance": mode} if rng.random() < 0.6 else {}),
            "encoder_at": str(rng.choice(["motor", "handle"])),
        }
    )


def random_hand(rng):
    if rng.random() < 0.3:
        return StylusHand(0.21, 1.3, 575.0, 11.0, 170.0)
    return Hand(rng.uniform(0.05, 0.3), rng.uniform(3, 20), rng.uniform(200, 800))


def by_hand(device, hand):
    """The continuous plant written down once more, for a hand of mass, damper and spring: A and b."""
    mode, b_d = device.resonance, device.damping_ns_per_m
    handle = device.mass_kg * mode.mass_ratio if mode else 0.0
    motor, held = device.mass_kg - handle, handle + hand.mass_kg
    if mode:
        reduced, omega = motor * handle / device.mass_kg, 2 * np.pi * mode.frequency_hz
        k, b = reduced * omega**2, 2 * mode.damping_ratio * omega * reduced
        a = np.array(
            [
                [0, 1, 0, 0],
                [-k / motor, -(b + b_d) / motor, k / motor, b / motor],
                [0, 0, 0, 1],
                [k / held, b / held, -(k + hand.stiffness_n_per_m) / held, -(b + hand.damping_ns_per_m) / held],
            ]
        )
        push = np.array([0, -1 / motor, 0, 0])
    else:
        total = motor + hand.mass_kg
        a = np.array([[0, 1], [-hand.stiffness_n_per_m / total, -(b_d + hand.damping_ns_per_m) / total]])
        push = np.array([0, -1 / total])
    if device.amplifier_bandwidth_hz is None:
        return a, push
    w, n, order = 2 * np.pi * device.amplifier_bandwidth_hz, len(push), device.amplifier_order
    whole, drive = np.zeros((n + order, n + order)), np.zeros(n + order)
    whole[:n, :n], whole[:n, n] = a, push
    if order == 1:
        whole[n, n], drive[n] = -w, w
    else:
        slows = 2 * device.amplifier_damping_ratio * w
        whole[n, n + 1], whole[n + 1, n], whole[n + 1, n + 1], drive[n + 1] = 1, -(w**2), -slows, w**2
    return whole, drive


def units(device, names):
    """What each state moves the device in a sample, about, so that numbers of all states can be compared."""
    period = device.sample_time_s
    of = {"m": 1.0, "m_per_s": period, "n": period**2 / device.mass_kg, "n_per_s": period**3 / device.mass_kg}
    return np.array([of[re.fullmatch(r"\w+?_(m|m_per_s|n|n_per_s)", name)[1]] for name in names])


def close(found, expected, rows, columns):
    """To 1e-9 of the largest number, in comparable units."""
    scale = rows[:, None] / columns
    assert np.abs((found - expected) * scale).max() < 1e-9 * np.abs(expected * scale).max()


@pytest.mark.parametrize("seed", range(24))
def test_the_matrices_are_those_of_the_written_down_plant(seed):
    rng = np.random.default_rng(seed)
    device, hand = random_device(rng), Hand(rng.uniform(0.05, 0.3), rng.uniform(3, 20), rng.uniform(200, 800))
    found = sampled_plant(device, hand)
    a, b = by_hand(device, hand)
    n, period = len(b), device.sample_time_s
    # Rates are counted by the sample, so that the exponential is balanced.
    scale = np.array([period if name.endswith("_per_s") else 1.0 for name in found.names])

    def step(duration):
        whole = np.zeros((n + 1, n + 1))
        whole[:n, :n], whole[:n, n] = a * scale[:, None] / scale * duration, b * scale * duration
        moved = expm(whole)
        return moved[:n, :n] / scale[:, None] * scale, moved[:n, n] / scale

    late = (device.delay_samples % 1) * period
    rows, force = units(device, found.names), units(device, ["asked_force_n"])
    close(found.matrix[0, 0], step(period)[0], rows, rows)
    rest = step(period - late)
    close(found.new[0, 0][:, None], rest[1][:, None], rows, force)
    if late == 0:
        assert not found.old.any()
    else:
        close(found.old[0, 0][:, None], (rest[0] @ step(late)[1])[:, None], rows, force)
    assert found.whole_delay == int(device.delay_samples)


def scene_jacobian(device, hand):
    """Next states by states of the scene in a spring on both sides, with their names."""
    effects = ['kind = "hand"', f'kind = "environment"\nstiffness_n_per_m = {SPRING}\ndamping_ns_per_m = 0.0']
    if device.resonance is not None:
        effects.append('kind = "resonance"')
        if device.encoder_at == "handle":
            effects.append('kind = "encoder"')
    if device.amplifier_bandwidth_hz is not None:
        effects.append('kind = "amplifier"')
    if device.delay_samples:
        effects.append('kind = "delay"')
    text = "[device]\nmass_kg = 1.0\ndamping_ns_per_m = 1.0\n[environment]\ndamping_ns_per_m = 0.0\n"
    text += "stiffness_n_per_m = 1.0\n[frequency]\nstop_hz = 10.0\n"
    text += "".join(f"[[scene.effects]]\n{effect}\n" for effect in effects)
    problem = avc.parse_problem(text).changed(device=device)
    built = tuple(Grip(hand) if isinstance(effect, Grip) else effect for effect in build_effects(problem))
    scene = compile_scene(problem, built)
    states, inputs, parameters = (ca.SX.sym(name, scene.function.numel_in(i)) for i, name in enumerate("xup"))
    slope = ca.Function(
        "slope", [states, inputs, parameters], [ca.jacobian(scene.function(states, inputs, parameters)[0], states)]
    )
    at = [np.full(states.numel(), 1e-3), np.zeros(inputs.numel()), scene.parameter_values(NO_COUPLING)[0]]
    return slope(*at).full(), scene.states


@pytest.mark.parametrize("seed", range(24))
def test_the_closed_loop_is_the_jacobian_of_the_scene(seed):
    rng = np.random.default_rng(seed)
    device, hand = random_device(rng), random_hand(rng)
    found = sampled_plant(device, hand)
    a, b = (part[0, 0] for part in found.with_forces_under_way())
    d = found.forces_under_way
    closed = a + np.outer(b, SPRING * np.append(found.output_row, np.zeros(d)))
    jacobian, names = scene_jacobian(device, hand)
    assert names == (*found.names, *(f"delayed_{place + 1}_n" for place in range(d)))
    rows = units(device, names)
    close(closed, jacobian, rows, rows)


@pytest.mark.parametrize(("b", "k"), [(2.0, 500.0), (2.0, 0.0), (0.0, 500.0)])
def test_a_plant_without_mass_is_the_limit_of_little_mass(b, k):
    """Where it is after a sample: by where it was and the held force. Without damper it stands on its spring."""
    light, none = (plants_of([Device(mass_kg=m, damping_ns_per_m=b)], Hand(0.0, 0.0, k)) for m in (1e-9, 0.0))
    stays, pushed = none.matrix[0, 0][0, 0], none.new[0, 0][0]
    if b > 0:
        assert (stays, pushed) == pytest.approx((light.matrix[0, 0][0, 0], light.new[0, 0][0]), rel=1e-5)
    else:
        assert (stays, pushed) == pytest.approx((0.0, -1 / k))
