"""A coupling by one convex program: the smallest impedance error with a margin for every hand, by cutting planes.

A law is an observer with state feedback, s+ = s + L e, F = K R s+, its gain L free: X over 1 + Y without innovation,
Phi_h = 1 + (Y + P_h X) L. The conditions, cones in L about the last iterate, stand in this room's page (Karimi and
Kammer, Automatica 2017). What was found is judged by exact eigenvalues.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.claims.impedance import handle_impedance, target_impedance
from avc_casadi.coupling import Coupling
from avc_casadi.design.cones import PER_LACK, Cones
from avc_casadi.design.observer_law import GUESSES, Loops, Structure
from avc_casadi.design.static import constant_schedule
from avc_casadi.loops.spectrum import eigenvalues
from avc_casadi.loops.wall import MAX_DELAY_SAMPLES
from avc_casadi.model.corners import LINEAR_KEYS, device_corners
from avc_casadi.model.device import Device
from avc_casadi.model.gains import Gains, GainSchedule, spring_before
from avc_casadi.model.hands import Hand, StylusHand, hand_corners, no_hand
from avc_casadi.model.plant import SampledPlant, sampled_plant
from avc_casadi.model.problem import Problem
from avc_casadi.model.runtime import Runtime

ErrorRows = tuple[ComplexArray, ComplexArray, ComplexArray, ComplexArray]

DISK_MARGIN, RIPPLE_N, NOISE_OVER_STIFFNESS = 0.204, 1.5, 12.0
"""Default goals: margin, so that 0.2 is met; force for a sine of one encoder step, N, or noise gain over stiffness if
that is more."""
BAND_HZ, NEAR = (1.0, 30.0), 0.1
"""Of the error; and that at which no other guess of model and feedback is tried."""
GAINS = np.array([1.0, 0.5, 0.25, 0.12, 0.06, 0.03, 0.015])
"""Sector gains of quantiser and dead zone at which the loop is required to decay."""
# Least relative change of Phi that a law in single precision may depend on: with less L grows without an effect.
RESOLVED = 1e-6
# Least cosine of half the phase that a clipped force leaves before a lower gain of the clip is unstable: 6 degrees.
_CLIPPED = 0.05
# Share of Phi on contours, and twice that of the observer, that a step leaves at least; after one that failed, more.
_LEFT = (0.2, 0.6, 0.85)


def contour_per_s(device: Device, hz: FloatArray, row: int) -> FloatArray:
    """Return the required decay at frequencies for one of `GAINS`, 1/s; less before a wall without a damper."""
    oscillating, slow = (1, 0.9, 0.8, 0.6, 0.3, 0.1, 0.02)[row], (1, 1, 0.8, 0.6, 0.35, 0.15, 0.05)[row]
    fast = min(5.0, 4.0 + 0.05 * device.damping_ns_per_m / device.mass_kg) * oscillating
    return np.asarray(fast + (10.0 * slow - fast) / (1 + (hz / 4.0) ** 4))


@dataclass(frozen=True)
class Performance:
    """What a law reaches over all hands and devices."""

    error: float  # largest |Z_h - Z|/max(|Z|, |Z_e|) from 1 to 30 Hz, Z of device and physical wall, Z_e of the wall
    disk_margin: float  # 2/max |(1 - L)/(1 + L)| of the loop L at the actuator, a hand or released
    noise_n_per_m: float  # largest force over a sine of encoder noise
    clipped: float  # least cosine of half the phase of 1 - G, G the loop of a clipped force, at gains from 1 to 0.015
    decay: FloatArray  # least decay over the required one, at each of `GAINS`
    free: FloatArray  # least |1 + g (Phi - 1)| with a hand, at each of `GAINS`
    radius: float  # spectral

    @property
    def stable(self) -> bool:
        """Whether every hand is stable, and the device released, at each gain of a force that is clipped."""
        return self.radius < 1 and self.clipped > _CLIPPED

    def lack(self, free: FloatArray) -> float:
        """Return the largest missing share of decay and of |1 + g (Phi - 1)|; 0 where none is missing."""
        some = free > 0
        return max(0.0, 0.97 - float(self.decay.min()), 0.95 - float((self.free[some] / free[some]).min()))


@dataclass(eq=False)
class Program:
    """The program of one structure on a problem."""

    problem: Problem
    structure: Structure
    hands: Hand | StylusHand  # corners, without the released device, which is always there
    disk_margin: float  # goal
    noise_n_per_m: float  # goal
    distance: float = 1.0  # goal of 1 + g (Phi - 1) from 0, as a share of the usual one
    _near: dict[object, BoolArray] = field(default_factory=dict, init=False)
    _contours: dict[tuple[int, float], ComplexArray] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        # Shares of |Phi| kept free at each gain.
        self._free = self.distance * np.array([0.35, 0.25, 0.17, 0.12, 0.06, 0.0, 0.0])
        device = self.problem.device
        corners = device_corners(device, LINEAR_KEYS)
        held, free = (plants_with_forces(sampled_plant(corners, who)) for who in (self.hands, no_hand()))
        self.held: Loops = held
        self.plants: Loops = (np.concatenate([held[0], free[0]]), np.concatenate([held[1], free[1]]), held[2])
        self.hz = self._grid(2)
        self.z = np.exp(2j * np.pi * self.hz * device.sample_time_s)
        self.response = force_to_position(self.plants, self.z)
        self.x, self.y = self.structure.rows(self.z)
        self.phi = self.y + self.response[..., None] * self.x
        self.observer, self.feedback = self.structure.differences(self.z)
        z = np.exp(2j * np.pi * self._grid(8) * device.sample_time_s)
        x, y = self.structure.rows(z)
        # Of the denser grid on which margin and noise are judged: X, Y and Phi.
        self.dense = x, y, y + force_to_position(self.plants, z)[..., None] * x
        self.error = self.error_rows(np.geomspace(*BAND_HZ, 12))

    def _grid(self, density: int) -> FloatArray:
        """Return frequencies from 0.1 Hz to the Nyquist frequency itself, dense about resonances."""
        device, rate = self.problem.device, 1 / self.problem.device.sample_time_s
        lower, upper = min(3.0, 0.01 * rate), 0.08 * rate
        parts = [
            np.geomspace(0.1, lower, 6 * density),
            np.geomspace(lower, upper, 32 * density),
            np.linspace(upper, 0.5 * rate, 24 * density),
        ]
        for one in device_corners(device, LINEAR_KEYS):
            if one.resonance is not None:
                about = np.geomspace(0.004, 0.5, 6 * density)
                parts.append(one.resonance.frequency_hz * np.concatenate([1 - about, 1 + about]))
        hz = np.unique(np.concatenate(parts))
        return hz[hz <= 0.5 * rate * (1 + 1e-12)]

    def error_rows(self, hz: FloatArray) -> ErrorRows:
        """Return rows and constants of E_n and E_d: the handle's impedance is a ratio of terms linear in the law's."""
        device, k = self.problem.device, self.structure.stiffness_n_per_m
        # Z = (z_0 + p C)/(1 + q C), from three laws C.
        alone, one, other = (handle_impedance(device, c, hz)[0] for c in (0j, k + 0j, 1j * k))
        matrix = np.array([[k + 0 * one, -k * one], [1j * k + 0 * one, -1j * k * other]]).transpose(2, 0, 1)
        p, q = np.linalg.solve(matrix, np.array([one - alone, other - alone]).T[..., None])[..., 0].T
        wanted, size = target_impedance(self.problem, hz)
        x, y = self.structure.rows(np.exp(2j * np.pi * hz * device.sample_time_s))
        near = (p - wanted * q)[:, None] * x + (alone - wanted)[:, None] * y
        return near, alone - wanted, size[:, None] * (y + q[:, None] * x), size.astype(np.complex128)

    @staticmethod
    def errors(gain: FloatArray, rows: ErrorRows) -> FloatArray:
        """Return |E_n|/|E_d|."""
        near, near_0, far, far_0 = rows
        return np.asarray(np.abs(near @ gain + near_0) / np.abs(far @ gain + far_0))

    def evaluate(self, gain: FloatArray) -> Performance:
        """Return what a gain L reaches."""
        structure = self.structure
        phi = 1 + self.phi @ gain
        decay, radius = [], 0.0
        for row, passed in enumerate(GAINS):
            poles = eigenvalues(structure.loops(self.plants if row == 0 else self.held, gain, passed))
            radius = max(radius, float(np.abs(poles).max())) if row == 0 else radius
            decay.append(float(self._decays(poles, row).min()))
        held = len(self.held[0])
        free = [np.abs(1 + passed * (phi[:held] - 1)).min() for passed in GAINS]
        # Stable at gain 1, so at each lower g with g G off 1; below the last of `GAINS` the hand alone decides.
        difference = phi * self.feedback / (1 + self.observer @ gain)
        cosine = np.cos(np.angle(difference) / 2)[np.abs(difference) < 1 / GAINS[-1]]
        x, y, rows = self.dense
        dense = 1 + rows @ gain
        return Performance(
            error=float(self.errors(gain, self.error).max()),
            disk_margin=float(2 / np.abs((2 * (1 + y @ gain) - dense) / dense).max()),
            noise_n_per_m=float(np.abs((x @ gain) / dense).max()),
            clipped=float(cosine.min(initial=1.0)),
            decay=np.array(decay),
            free=np.array(free),
            radius=radius,
        )

    def _decays(self, poles: ComplexArray, row: int) -> FloatArray:
        """Return the decay of poles over the required one at one of `GAINS`."""
        t = self.problem.device.sample_time_s
        wanted = contour_per_s(self.problem.device, np.abs(np.angle(poles)) / (2 * np.pi * t), row)
        return np.asarray(-np.log(np.maximum(np.abs(poles), 1e-9)) / t / wanted)

    def meets(self, found: Performance) -> bool:
        """Return whether all but the error is as asked for."""
        return self._excess(found) <= 0 and found.lack(self._free) <= 0

    def _excess(self, found: Performance) -> float:
        """Return by how much margin and noise miss their goals, weighed; 0 where they do not."""
        margin = max(0.0, 0.985 * self.disk_margin - found.disk_margin)
        noise = max(0.0, math.log(found.noise_n_per_m / self.noise_n_per_m / 1.02)) if found.noise_n_per_m else 0.0
        return 20 * margin + noise

    def _cost(self, found: Performance) -> float:
        return 30 * self._excess(found) + PER_LACK * found.lack(self._free) + found.error**2

    def improve(self, gain: FloatArray) -> tuple[FloatArray, Performance]:
        """Return a gain improved by programs, each step shortened until all holds that held, and what it reaches."""
        best, failed = self.evaluate(gain), 0
        for _ in range(40):
            wide = best.disk_margin >= self.disk_margin
            reach = (1.15, 0.9) if failed == 0 else (0.98, 1.0)
            margin = self.disk_margin if wide else max(min(self.disk_margin, reach[0] * best.disk_margin), 0.02)
            noise = max(self.noise_n_per_m, reach[1] * best.noise_n_per_m)
            decay = np.where(best.decay > 1, 1.0, np.round(best.decay - 0.02 * np.abs(best.decay), 3))
            towards = self._step(gain, best, margin, noise, decay, _LEFT[failed])
            for share in (1.0, 0.6, 0.3, 0.1):
                tried = gain + share * (towards - gain)
                found = self._better(tried, best, decay)
                if found is not None:
                    break
            else:
                failed += 1
                if failed == len(_LEFT):
                    break
                continue
            won, before = self._cost(best) - self._cost(found), self._cost(found)
            gain, best, failed = tried, found, 0
            if self.meets(best) and won < 5e-3 * before:
                break
        return gain, best

    def _better(self, gain: FloatArray, before: Performance, decay: FloatArray) -> Performance | None:
        """Return what a gain reaches if that is better, and decays as it must."""
        if not np.isfinite(gain).all() or self.structure.observer_radius(gain) >= 1:
            return None
        found = self.evaluate(gain)
        keeps = found.radius < 1 and bool((found.decay >= decay - 0.03 * np.abs(decay) - 0.01).all())
        if keeps and self._cost(found) < self._cost(before) - 1e-5:
            return found
        return None

    def _contour(self, row: int, share: float) -> ComplexArray:
        """Return rows of Phi on the contour of a share of the required decay at one of `GAINS`, held hands alone."""
        key = (row, share)
        if key not in self._contours:
            hz = np.concatenate([[1e-4, 0.03], self.hz])
            decay = contour_per_s(self.problem.device, hz, row)
            z = np.exp((2j * np.pi * hz - share * decay) * self.problem.device.sample_time_s)
            x, y = self.structure.rows(z)
            plants = self.plants if row == 0 else self.held
            self._contours[key] = y + force_to_position(plants, z)[..., None] * x
        return self._contours[key]

    def _step(
        self, gain: FloatArray, now: Performance, margin: float, noise: float, decay: FloatArray, left: float
    ) -> FloatArray:
        """Solve the program about a gain, with those cones that matter: cutting planes."""
        c = 1 + self.phi @ gain
        # Variables are whitened by the relative change of Phi.
        relative = _flat(self.phi / np.abs(c)[..., None])
        _, values, axes = np.linalg.svd(np.concatenate([relative.real, relative.imag]), full_matrices=False)
        some = values > RESOLVED * values[0]
        cones = Cones(gain, axes[some].T * np.sqrt(2 * len(relative)) / values[some])
        x, y, phi = self.dense
        there = 1 + phi @ gain
        size = 1 / np.abs(there)
        turned = np.conj(there) * size**2
        real, real_0 = _flat((turned[..., None] * phi).real), turned.real.ravel()
        away = _flat(size[..., None] * (2 * y - phi))
        cones.second("margin", (2 / margin * real, 2 / margin * real_0), away, size.ravel())
        cones.second("noise", (real, real_0), _flat(size[..., None] / noise * x), 0 * size.ravel())
        for row, passed in enumerate(GAINS):
            self._decaying(cones, gain, row, (float(decay[row]), left))
            if self._free[row] > 0:
                held = 1 + passed * (c[: len(self.held[0])] - 1)
                unit = np.conj(held) / np.abs(held)
                rows = _flat((passed * unit[..., None] * self.phi[: len(held)]).real)
                level = unit.real.ravel()
                cones.linear(("free", row), rows, level - min(self._free[row], 0.98 * now.free[row]))
                if now.free[row] < 0.98 * self._free[row]:
                    cones.linear(("freer", row), rows / self._free[row], level / self._free[row] - 1, lack=1.0)
        observer = 1 + self.observer @ gain
        unit = np.conj(observer) / np.abs(observer) ** 2
        cones.linear("observer", (unit[:, None] * self.observer).real, unit.real - 0.5 * left)
        cones.error(*self.error)
        return cones.solved(self._near)

    def _decaying(self, cones: Cones, gain: FloatArray, row: int, kept: tuple[float, float]) -> None:
        """Keep the poles at one of `GAINS` inside their contour; those near it by their derivatives."""
        passed, rows = float(GAINS[row]), self._contour(row, kept[0]) * GAINS[row]
        value = 1 + rows @ gain
        turned = np.conj(value) / np.abs(value) ** 2
        cones.linear(("decay", row), _flat((turned[..., None] * rows).real), turned.real.ravel() - kept[1])
        plants = self.plants if row == 0 else self.held
        poles = eigenvalues(self.structure.loops(plants, gain, passed))
        t, reached = self.problem.device.sample_time_s, self._decays(poles, row)
        some = (reached < 1.5) & (poles.imag >= 0) & (np.abs(poles) > 0.5)
        if not some.any():
            return
        matrix, push, measured = plants
        whose = np.nonzero(some)[0]
        slopes = self.structure.slopes((matrix[whose], push[whose], measured), gain, passed, poles[some])
        hz, reached = np.angle(poles[some]) / (2 * np.pi * t), reached[some]
        wanted, more = (contour_per_s(self.problem.device, f, row) for f in (hz, hz + 1e-3))
        per_hz = (more - wanted) / 1e-3
        moved = slopes / poles[some][:, None] / t
        change = (-moved.real - (reached * per_hz)[:, None] * moved.imag / (2 * np.pi)) / wanted[:, None]
        aim = np.minimum(1.02, reached + 0.5)
        cones.linear(("pole", row), change, reached - change @ gain - aim, lack=1.0)


def _flat(rows: Any) -> Any:
    return rows.reshape(-1, rows.shape[-1])


def plants_with_forces(plant: SampledPlant) -> Loops:
    """Return A, B and the measured row of each plant with its forces under way, devices and hands along one axis."""
    matrix, push = plant.with_forces_under_way()
    size = push.shape[-1]
    measured = np.pad(plant.output_row, (0, size - len(plant.output_row)))
    return matrix.reshape(-1, size, size), push.reshape(-1, size), measured


def force_to_position(plants: Loops, z: ComplexArray) -> ComplexArray:
    """Return measured position over force at points z, positive where the force pushes out, shape (p, len(z))."""
    matrix, push, measured = plants
    pencil = z[:, None, None] * np.eye(len(measured)) - matrix[:, None]
    right = np.broadcast_to(-push[:, None, :, None], (*pencil.shape[:3], 1))
    return np.asarray(np.linalg.solve(pencil, right)[..., 0] @ measured)


def _starts(program: Program) -> Iterator[FloatArray]:
    """Yield gains to start from: spring and damper of some margin, stiffer at rest by a lag, and the regulator."""
    device, k, z = program.problem.device, program.structure.stiffness_n_per_m, program.z
    t = device.sample_time_s
    springs, poles, lags = k * np.geomspace(1, 0.003, 17), np.array([0.6, 0.2]), np.array([0.3, 0.7, 1.5, 3.0, 6.0])
    dampers = np.geomspace(0.003, 1.2, 18) * 2 * device.mass_kg / t / (1 + device.delay_samples)
    grid = np.array(np.meshgrid(springs, dampers, poles, lags, indexing="ij")).reshape(4, -1).T

    def force(some: FloatArray, z: ComplexArray) -> ComplexArray:
        spring, damper, pole, lag = some.T[..., None]
        slow = np.exp(-2 * np.pi * lag * t)
        damped = damper / t * (1 - 1 / z) * (1 - pole) / (1 - pole / z)
        return np.asarray(spring + damped + (k - spring) * (1 - slow) / (z - slow))

    coarse = slice(None, None, 2)
    law, margin, held = force(grid, z[coarse]), np.full(len(grid), np.inf), len(program.held[0])
    for row, response in enumerate(program.response):
        phi = 1 + response[coarse] * law
        # Stable where Phi does not wind; of a released device it begins with the turn of two integrators at most.
        turn = np.angle(phi[:, 1:] / phi[:, :-1]).sum(axis=1) + (np.angle(phi[:, 0]) if row < held else 0.0)
        stable = np.abs(turn) < 0.5 if row < held else (turn > -0.5) & (turn < 4)
        margin = np.where(stable, np.minimum(margin, 2 / np.abs((2 - phi) / phi).max(axis=1)), 0.0)
    # Of each spring the fastest lag and the largest margin.
    enough = np.minimum(margin, 1.25 * program.disk_margin)
    for score in (enough + 1e-3 * grid[:, 3], margin):
        for some in np.argsort(-score.reshape(len(springs), -1), axis=1)[:, 0] + np.arange(
            0, len(grid), len(grid) // len(springs)
        ):
            if margin[some] > 0:
                yield _match(program, force(grid[some : some + 1], z)[0])
    yield program.structure.innovation


def _match(program: Program, law: ComplexArray) -> FloatArray:
    """Return the gain whose law is nearest to a transfer from position to force, by the relative change of Phi."""
    weight = (np.abs(program.response) / np.abs(1 + program.response * law)).max(axis=0)
    rows, right = (program.x - law[:, None] * program.y) * weight[:, None], law * weight
    both, aim = np.concatenate([rows.real, rows.imag]), np.concatenate([right.real, right.imag])
    scale = np.linalg.norm(both, axis=0)
    return np.asarray(np.linalg.lstsq(both / scale, aim, rcond=RESOLVED)[0] / scale)


def best_start(program: Program) -> FloatArray | None:
    """Return the most promising start that is stable with every hand and released; None without any."""
    best: FloatArray | None = None
    cost = math.inf
    for gain in _starts(program):
        if program.structure.observer_radius(gain) >= 1:
            continue
        found = program.evaluate(gain)
        lack = PER_LACK * max(0.0, 1 - float(found.decay.min())) + 4 * max(
            0.0, 1 - found.disk_margin / program.disk_margin
        )
        noise = max(0.0, math.log(max(found.noise_n_per_m, 1e-9) / program.noise_n_per_m))
        if found.radius < 1 and (total := lack + noise + found.error**2) < cost:
            best, cost = gain, total
    return best


@dataclass(frozen=True, eq=False)
class ProgramAnswer:
    """The coupling of the program, not yet tried."""

    problem: Problem
    program: Program  # of the structure with the smallest error, with the goals
    gain: FloatArray  # L
    performance: Performance

    @property
    def meets_goals(self) -> bool:
        """Whether it is stable, and margin, noise and decay are as asked for."""
        return self.performance.stable and self.program.meets(self.performance)

    @property
    def coupling(self) -> Coupling:
        """The law behind the spring that gives the wall its stiffness."""
        inner, problem = self.program.problem, self.problem
        spring = spring_before(problem, inner.environment.stiffness_n_per_m)
        runtime = Runtime(state_feedback=self.program.structure.law(self.gain, inner))
        return Coupling.constant(problem, Gains(0.0, spring), "robust", runtime)

    def errors(self, hz: FloatArray) -> FloatArray:
        """Return the impedance error at frequencies."""
        return self.program.errors(self.gain, self.program.error_rows(hz))

    def with_goals(self, disk_margin: float = 1.0, noise: float = 1.0, distance: float = 1.0) -> ProgramAnswer:
        """Return the coupling for goals multiplied by factors, from this one on."""
        one = self.program
        program = replace(
            one,
            disk_margin=disk_margin * one.disk_margin,
            noise_n_per_m=noise * one.noise_n_per_m,
            distance=distance * one.distance,
        )
        gain, found = program.improve(self.gain)
        return replace(self, program=program, gain=gain, performance=found)


def why_no_law(problem: Problem) -> str:
    """Return why a device and wall have no law; empty where they may have one."""
    device = problem.device
    faults = []
    if not problem.environment.stiffness_n_per_m > 0:
        faults.append("the wall has no stiffness to be rendered (environment.stiffness_n_per_m)")
    if not device.mass_kg > 0:
        faults.append("the device has no mass (device.mass_kg), so that nothing is there when it is released")
    if device.delay_samples > MAX_DELAY_SAMPLES / 4:
        faults.append(f"the delay of {device.delay_samples:g} samples is above {MAX_DELAY_SAMPLES // 4}")
    return "; ".join(faults)


def program_answers(
    problem: Problem,
    disk_margin: float | None = None,
    noise_n_per_m: float | None = None,
    *,
    stiffness_n_per_m: float | None = None,
    filters: int = 4,
) -> list[ProgramAnswer]:
    """Return the couplings that the guesses of model and feedback lead to: those that meet the goals, then by error."""
    if why := why_no_law(problem):
        raise UnsupportedError(f"{problem.name}: program: {why}")
    device, inner, k = problem.device, problem, problem.environment.stiffness_n_per_m
    if stiffness_n_per_m is not None and stiffness_n_per_m < k:
        inner = problem.changed(environment={"stiffness_n_per_m": stiffness_n_per_m, "damping_ns_per_m": 0.0})
    asked, step = problem.robustness, max(device.encoder_resolution_m, 1e-9)
    if disk_margin is None:
        disk_margin = DISK_MARGIN if asked.disk_margin is None else asked.disk_margin
    if noise_n_per_m is None:
        least = NOISE_OVER_STIFFNESS * inner.environment.stiffness_n_per_m if asked.ripple_n is None else 0.0
        ripple_n = device.metres_per_unit * (RIPPLE_N if asked.ripple_n is None else asked.ripple_n)
        noise_n_per_m = max(ripple_n / step, least)
    answers: list[ProgramAnswer] = []
    hands = hand_corners(problem.hands.model_copy(update={"let_go": False}))
    for guess in GUESSES:
        with suppress(np.linalg.LinAlgError):
            program = Program(inner, Structure.of(inner, guess, filters), hands, disk_margin, noise_n_per_m)
            if (gain := best_start(program)) is None:
                continue
            gain, found = program.improve(gain)
            if not found.stable:
                continue
            answers.append(ProgramAnswer(problem, program, gain, found))
            if answers[-1].meets_goals and found.error <= NEAR:
                break
    return sorted(answers, key=lambda one: (not one.meets_goals, one.performance.error))


def solve_robust(problem: Problem, *, progress: Progress = SILENT) -> GainSchedule:
    """Solve by the law of the program, in ``state_feedback``; every row has the same gains."""
    if why := why_no_law(problem):
        raise UnsupportedError(f"{problem.name}: robust: {why}; take another method, such as static")
    started = time.perf_counter()
    with progress.step("convex program"):
        answer = next(iter(program_answers(problem)), None)
    if answer is None:
        reason = "no law is found that holds every hand; soften the wall, or narrow [hands] or [device.range]"
        return constant_schedule(problem, "robust", None, started, reason=reason)
    found, goals = answer.performance, "as required" if answer.meets_goals else "not all as required"
    note = (
        f"error of the impedance from 1 to 30 Hz {100 * found.error:.3g} % at most, disk margin "
        f"{found.disk_margin:.2f}; margin, noise and decay {goals}"
    )
    gains, law = answer.coupling.table.at_rest, answer.coupling.runtime.state_feedback
    return constant_schedule(problem, "robust", gains, started, notes=(note,), law=law)
