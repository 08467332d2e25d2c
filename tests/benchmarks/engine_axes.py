"""Many single axes at once, each a device, a hand and a tool that MuJoCo moves, without the project's own loop.

Device and hand are sampled exactly (matrix exponential); the coupling is computed here; the tool is a body on a slide
joint, pushed by `qfrc_applied` and moved by `mj_step`. What the device knows of the tool is what is handed out here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

Array = NDArray[np.float64]

# A kick of the device, m/s; what grows beyond the second is taken out of the run, as engines refuse such numbers.
_KICK_M_PER_S, _LOST_M_PER_S = 1e-3, 100.0
# Energies below this share of the kick's are rounding.
_ROUNDING = 1e-20
SOLREF_WALL = '<geom type="box" pos="1 0 0" size="1 {wide} 1"/>'
"""Box that the tools run against, its face at x = 0: MuJoCo's default contact."""


@dataclass(frozen=True)
class Axis:
    """What all axes of a run share; with `engine_damps` the coupling's damper is a joint's, taken implicitly."""

    mass_kg: float
    damping_ns_per_m: float
    sample_time_s: float
    delay_samples: float
    tool_mass_kg: float
    step_s: float
    exchange: str
    engine_damps: bool = False
    steps_late: int = 0


@dataclass(frozen=True)
class Run:
    """What became of the axes, shape (axes,) or (axes, samples); one grows if the energy after a kick does at last."""

    grows: NDArray[np.bool_]
    device_m: Array
    tool_m: Array
    force_n: Array


def sampled(axis: Axis, hands: Array, share: float) -> Array:
    """Return exact maps over a share of T, (hands, 2, 5), of position, velocity, force, target and its speed."""
    maps = []
    for mass, damping, stiffness in hands:
        m = axis.mass_kg + mass
        rate = np.zeros((5, 5))
        rate[0, 1] = rate[3, 4] = 1
        rate[1] = np.array([-stiffness, -damping - axis.damping_ns_per_m, -1, stiffness, damping]) / m
        maps.append(expm(rate * axis.sample_time_s * share)[:2])
    return np.array(maps)


class MujocoTools:
    """Tools on slide joints in one model of MuJoCo; those that are held are bodies without a joint.

    Joints may have a damper, which MuJoCo takes implicitly; with `box` a box with its default contact stands at x = 0.
    """

    RADIUS_M = 0.01

    def __init__(
        self,
        mass_kg: float,
        step_s: float,
        held: NDArray[np.bool_],
        damping_ns_per_m: Array | float = 0.0,
        *,
        box: bool = False,
        start_m: float = 0.0,
    ) -> None:
        integrator = "implicitfast" if np.any(np.asarray(damping_ns_per_m) > 0) else "Euler"
        flags = '<flag autoreset="disable"/>' if box else '<flag contact="disable" autoreset="disable"/>'
        wide = 0.05 * len(held)
        bodies = "".join(
            f'<body pos="{start_m - self.RADIUS_M if box else 0} {0.05 * row - wide / 2} 0">'
            + ("" if is_held else '<joint type="slide" axis="1 0 0"/>')
            + (
                f'<geom type="sphere" size="{self.RADIUS_M}" mass="{mass_kg!r}" contype="2" conaffinity="1"/></body>'
                if box
                else f'<inertial pos="0 0 0" mass="{mass_kg!r}" diaginertia="1 1 1"/></body>'
            )
            for row, is_held in enumerate(held)
        )
        wall = SOLREF_WALL.format(wide=wide) if box else ""
        self.model: Any = mujoco.MjModel.from_xml_string(
            f'<mujoco><option timestep="{step_s!r}" gravity="0 0 0" integrator="{integrator}">{flags}</option>'
            f"<worldbody>{wall}{bodies}</worldbody></mujoco>"
        )
        self.model.dof_damping[:] = np.broadcast_to(damping_ns_per_m, held.shape)[~held]
        self.data: Any = mujoco.MjData(self.model)
        self.moves, self.substeps = ~held, 1
        self.start_m = start_m if box else 0.0

    def state(self) -> tuple[Array, Array]:
        """Return positions and velocities, shape (n,)."""
        x, v = np.full(len(self.moves), self.start_m), np.zeros(len(self.moves))
        x[self.moves] += self.data.qpos
        v[self.moves] = self.data.qvel
        return x, v

    def step(self, force_n: Array) -> None:
        """Move all by one step under a force each."""
        self.data.qfrc_applied[:] = force_n[self.moves]
        mujoco.mj_step(self.model, self.data, nstep=self.substeps)

    def stop(self, rows: NDArray[np.bool_]) -> None:
        """Bring some back to where nothing moves."""
        some = rows[self.moves]
        self.data.qpos[some] = self.data.qvel[some] = self.data.qacc_warmstart[some] = 0.0


def run(
    axis: Axis,
    hands: Array,
    gains: tuple[Array, Array, Array],
    samples: int,
    *,
    held: NDArray[np.bool_],
    target_m: Array | None = None,
    box: bool = False,
    start_m: float = 0.0,
    dropped: Callable[[int], bool] = lambda _: False,
    force_limit_n: float = np.inf,
    tools: Any = None,
) -> Run:
    """Simulate all axes."""
    k, b, local = gains
    count, t = len(k), axis.sample_time_s
    kept = int(np.ceil(axis.delay_samples))
    early = kept - axis.delay_samples  # share of T at its end in which the newer of two forces acts already
    shares = [(1 - early, kept)] + ([(early, kept - 1)] if early else [])
    parts = [
        (np.ascontiguousarray(sampled(axis, hands, share).transpose(2, 1, 0)), share, back) for share, back in shares
    ]
    tools = tools or MujocoTools(
        axis.tool_mass_kg, axis.step_s, held, b if axis.engine_damps else 0.0, box=box, start_m=min(start_m, 0.0)
    )
    x, v = np.full(count, start_m), np.full(count, 0.0 if target_m is not None else _KICK_M_PER_S)
    last, older = x.copy(), x.copy()
    handed: list[Any] = [np.zeros(count)] if axis.exchange == "held-force" else [tools.state()]
    handed *= 1 + axis.steps_late + (axis.exchange == "late")
    forces = [np.zeros(count) for _ in range(kept + 1)]
    mass, total = axis.mass_kg + hands[:, 0], samples // 4
    energy, lost = np.zeros((4, count)), np.zeros(count, dtype=bool)
    kick = 0.5 * mass * _KICK_M_PER_S**2
    traces: list[Array] = []
    number, ratio = 0, axis.step_s / t
    place, velocity = tools.state()
    for sample in range(samples):
        while number * ratio <= sample + 1e-9:
            fresh = abs(number * ratio - sample) < 1e-6
            seen, speed = (x, (x - last) / t) if fresh else (last, (last - older) / t)
            if not dropped(number):
                before = place, velocity
                asked = k * (seen - place) + b * (speed - velocity)
                tools.step(asked + b * velocity if axis.engine_damps else asked)
                place, velocity = tools.state()
                new = {"held-force": asked, "ahead": (place, velocity)}.get(axis.exchange, before)
                handed = [*handed[1:], new]
            number += 1
        speed = (x - last) / t
        pull = handed[0] if axis.exchange == "held-force" else k * (x - handed[0][0]) + b * (speed - handed[0][1])
        forces = [*forces[1:], np.clip(pull + local * speed, -force_limit_n, force_limit_n)]
        if target_m is not None:
            traces.append(np.stack([x, place, forces[-1]]))
        elif sample >= 2 * total:
            spring = 0.5 * k * (x - place) ** 2 + 0.5 * hands[:, 2] * x**2
            now = 0.5 * mass * v**2 + 0.5 * axis.tool_mass_kg * velocity**2 + spring
            energy[min(sample // total, 3)] = np.maximum(energy[min(sample // total, 3)], now)
        gone = ~(np.abs(v) + np.abs(velocity) < _LOST_M_PER_S)
        if gone.any():
            lost |= gone
            tools.stop(gone)
            x, v, last, older = (np.where(gone, start_m, one) for one in (x, v, last, older))
            v = np.where(gone, 0.0, v)
            forces = [np.where(gone, 0.0, one) for one in forces]
            there = place, velocity = tools.state()
            handed = [
                np.where(gone, 0.0, one)
                if isinstance(one, np.ndarray)
                else tuple(np.where(gone, here, w) for here, w in zip(there, one, strict=True))
                for one in handed
            ]
        last, older = x, last
        aim = 0.0 if target_m is None else target_m[sample]
        rate = 0.0 if target_m is None else (target_m[min(sample + 1, samples - 1)] - aim) / t
        for maps, share, back in parts:
            after = maps[0] * x + maps[1] * v + maps[2] * forces[-1 - back]
            if target_m is not None:
                after += maps[3] * aim + maps[4] * rate
            x, v = after
            aim += rate * t * share
    grows = lost | ((energy[3] > energy[2]) & (energy[3] > _ROUNDING * kick))
    columns = np.array(traces).transpose(1, 2, 0) if traces else np.empty((3, count, 0))
    columns[:, lost] = np.nan  # taken out and begun anew: no course of a device
    return Run(grows, columns[0], columns[1], columns[2])


def largest_stable_n_per_m(
    axis: Axis,
    hands: Array,
    near_n_per_m: float,
    damping: Callable[[Array], Array],
    local: Callable[[Array], Array],
    *,
    seconds: float = 4.0,
) -> float:
    """Return the largest K up to which no axis grows after a kick: every hand, tool free and held.

    From half to 1.8 times a K that is near, at last within 0.3 %; 1.8 times that K stands for more.
    """

    def stable(stiffnesses: Array) -> NDArray[np.bool_]:
        k = np.repeat(stiffnesses, 2 * len(hands))
        every = np.tile(np.concatenate([hands, hands]), (len(stiffnesses), 1))
        held = np.tile(np.repeat([False, True], len(hands)), len(stiffnesses))
        count = int(seconds / axis.sample_time_s)
        found = run(axis, every, (k, damping(k), local(k)), count, held=held)
        return ~found.grows.reshape(len(stiffnesses), -1).any(axis=1)

    grid = near_n_per_m * np.geomspace(0.5, 1.8, 9)
    for points in (8, 8, 0):
        good = stable(grid)
        if good.all():
            break
        first = int(np.argmin(good))
        if first == 0:
            return 0.0
        if points == 0:
            return float(grid[first - 1])
        grid = np.geomspace(grid[first - 1], grid[first], points)
    return float(grid[-1])
