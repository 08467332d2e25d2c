"""The exported C in a simulator of its own: a mass, a hand and an encoder by their equations, nothing of the project.

The hand is a mass that moves with the device, held by spring and damper to a target that goes into the wall. Between
two samples the force is held; the motion is integrated in small steps by the classical Runge-Kutta method.
"""

import functools
import math

import pytest
from exported import Exported
from hardware_bench import with_gains

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.model.runtime import Runtime

SUBSTEPS = 8


class Bench:
    """m x'' = -b x' + k_h (x_h - x) + b_h (x_h' - x') - F, the hand's mass on the device, F held over a sample."""

    def __init__(self, mass_kg: float, damping: float, hand: tuple[float, float, float]) -> None:
        self.mass = mass_kg + hand[0]
        self.damping = damping
        self.hand_damping, self.hand_stiffness = hand[1:]
        self.x, self.v = -0.01, 0.0

    @staticmethod
    def target(time: float) -> tuple[float, float]:
        """From -10 mm to 10 mm at 70 mm/s, then at rest."""
        moving = time < 0.02 / 0.07
        return (-0.01 + 0.07 * time, 0.07) if moving else (0.01, 0.0)

    def rate(self, time: float, x: float, v: float, force: float) -> tuple[float, float]:
        x_h, v_h = self.target(time)
        hand = self.hand_stiffness * (x_h - x) + self.hand_damping * (v_h - v)
        return v, (hand - self.damping * v - force) / self.mass

    def pass_time(self, time: float, seconds: float, force: float) -> None:
        h = seconds / SUBSTEPS
        for step in range(SUBSTEPS):
            t, x, v = time + step * h, self.x, self.v
            a = self.rate(t, x, v, force)
            b = self.rate(t + h / 2, x + h / 2 * a[0], v + h / 2 * a[1], force)
            c = self.rate(t + h / 2, x + h / 2 * b[0], v + h / 2 * b[1], force)
            d = self.rate(t + h, x + h * c[0], v + h * c[1], force)
            self.x = x + h / 6 * (a[0] + 2 * b[0] + 2 * c[0] + d[0])
            self.v = v + h / 6 * (a[1] + 2 * b[1] + 2 * c[1] + d[1])


def pressed(coupling: Coupling, hand: tuple[float, float, float], seconds: float = 2.5) -> tuple[float, float, float]:
    """Return the largest speed of the last half second, the stiffness felt then, and the largest force."""
    device = coupling.problem.device
    bench = Bench(device.mass_kg, device.damping_ns_per_m, hand)
    board = Exported(coupling)
    step, time_s = device.encoder_resolution_m, device.sample_time_s
    line = [0.0] * device.delay_samples
    forces, depths, speeds, most = [], [], [], 0.0
    for sample in range(round(seconds / time_s)):
        seen = step * math.floor(bench.x / step + 0.5) if step else bench.x
        line.append(board.step(seen))
        force = line.pop(0)
        bench.pass_time(sample * time_s, time_s, force)
        most = max(most, force)
        if sample * time_s > seconds - 0.5:
            forces.append(force)
            depths.append(bench.x)
            speeds.append(abs(bench.v))
    return max(speeds), sum(forces) / sum(depths), most


@functools.cache
def tuned(name: str) -> Coupling:
    problem = avc.load_problem(name)
    return Coupling.of(problem, avc.solve(problem, "static-tuned"))


HANDS = [(0.05, 3.0, 200.0), (0.175, 11.5, 500.0), (0.3, 20.0, 800.0)]


@pytest.mark.thorough
@pytest.mark.parametrize("hand", HANDS, ids=["light", "middle", "heavy"])
@pytest.mark.parametrize("name", ["ve3", "soft"])
def test_hands_rest_at_the_wall_of_the_coupling(name: str, hand: tuple[float, float, float]) -> None:
    coupling = tuned(name)
    speed, stiffness, most = pressed(coupling, hand)
    k, k_e = coupling.table.at_rest.stiffness_n_per_m, coupling.wall.stiffness_n_per_m
    assert speed < 5e-3
    assert stiffness == pytest.approx(k * k_e / (k + k_e), rel=0.02)
    assert most > 1


class RockingBench(Bench):
    """The target goes to 12 mm and then to and fro at 8 Hz."""

    @staticmethod
    def target(time: float) -> tuple[float, float]:
        arrival, omega = 0.022 / 0.07, 2 * math.pi * 8.0
        if time < arrival:
            return -0.01 + 0.07 * time, 0.07
        phase = omega * (time - arrival)
        return 0.012 + 0.004 * math.sin(phase), 0.004 * omega * math.cos(phase)


def rocked(coupling: Coupling) -> float:
    """Return the mean depth after some seconds of it, over whole periods."""
    device = coupling.problem.device
    bench = RockingBench(device.mass_kg, device.damping_ns_per_m, HANDS[1])
    board = Exported(coupling)
    step, time_s = device.encoder_resolution_m, device.sample_time_s
    line = [0.0] * int(device.delay_samples)
    depths = []
    for sample in range(5000):
        line.append(board.step(step * math.floor(bench.x / step + 0.5)))
        force = line.pop(0)
        bench.pass_time(sample * time_s, time_s, force)
        if sample >= 3000:
            assert force > 0
            depths.append(bench.x)
    return sum(depths) / len(depths)


@pytest.mark.thorough
def test_gains_that_follow_a_moving_hand_do_not_sag_under_its_mean_force() -> None:
    """The mean depth is that of the row of rest, where the row of 8 Hz alone would give way by 4 %."""
    problem = avc.load_problem("ve3").changed(device={"delay_samples": 1})
    made = Coupling.of(problem, avc.solve(problem, "direct"))
    b, k, _ = made.table(8.0).tolist()
    rest = made.table.at_rest
    depth = rocked(with_gains(problem, rest.damping_ns_per_m, rest.stiffness_n_per_m))
    assert rocked(with_gains(problem, b, k)) > 1.03 * depth
    assert rocked(made) == pytest.approx(depth, rel=0.005)


def test_a_rigid_coupling_to_a_stiff_wall_does_not_rest() -> None:
    """The bench can fail: without a coupling that gives way this wall buzzes."""
    speed, _, most = pressed(with_gains(avc.load_problem("figure5"), 1e4, 1e7), HANDS[1])
    assert speed > 0.05
    assert most > 20


def test_the_observer_looks_over_the_delay_that_would_make_the_wall_buzz() -> None:
    """Two samples of delay and a 20 um encoder: with the observer of the export the same gains rest."""
    problem = avc.load_problem("ve3").changed(device={"delay_samples": 2, "encoder_resolution_m": 2e-5})
    gains = with_gains(problem, 5.0, 8e3)
    without = pressed(gains, HANDS[0])[0]
    seen = Coupling(problem, gains.schedule, gains.table, Runtime(observer_mass_kg=0.16))
    speed, stiffness, _ = pressed(seen, HANDS[0])
    assert speed < 5e-3 < without
    assert stiffness == pytest.approx(8e3 * 4.5e3 / 12.5e3, rel=0.03)
