"""[simulation] against every engine that pip installs: recommended pairs hold in each, and do not beyond the limit.

OPENBLAS_NUM_THREADS=1 nice -n 10 python tests/benchmarks/every_engine.py

Needs `pip install mujoco pybullet dartpy Box2D pymunk drake`. Device, hand and coupling are engine_axes.py's; each engine
moves tools without contact. Overwrites results/every_engine.json after every cell and goes on where it stopped.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache, partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from engine_axes import Array, Axis, MujocoTools, run
from engine_boundaries import BEYOND, SEED, corners, drawn, problem_of
from script_arguments import script_arguments
from studied import about, computed

import avc_casadi as avc
from avc_casadi.design.virtual_tool import ToolSearch

OUT = Path(__file__).parent / "results" / "every_engine.json"
PAIRS, SOFTER = 12, 0.7


class Bodies:
    """Tools of one engine along x, far from each other; those that are held stay at 0."""

    def __init__(self, mass_kg: float, step_s: float, held: Any, substeps: int = 1) -> None:
        self.mass_kg, self.step_s, self.moves, self.substeps = mass_kg, step_s, ~held, substeps
        self.make(int(self.moves.sum()))

    def state(self) -> tuple[Array, Array]:
        """Return positions and velocities, shape (n,)."""
        found = np.zeros((2, len(self.moves)))
        found[:, self.moves] = np.transpose(self.known())
        return found[0], found[1]

    def step(self, force_n: Array) -> None:
        """Move all by one step under a force each."""
        self.push(force_n[self.moves].tolist())

    def stop(self, rows: Any) -> None:
        """Bring some back to where nothing moves."""
        for place in np.flatnonzero(rows[self.moves]).tolist():
            self.rest(place)


class Pybullet(Bodies):
    def make(self, count: int) -> None:
        import pybullet  # noqa: PLC0415

        self.p = p = pybullet
        if not p.isConnected():
            p.connect(p.DIRECT)
        p.resetSimulation()
        p.setTimeStep(self.step_s)
        p.setPhysicsEngineParameter(numSubSteps=self.substeps)
        ball = p.createCollisionShape(p.GEOM_SPHERE, radius=0.02)
        self.all = [p.createMultiBody(self.mass_kg, ball, basePosition=[0, row, 0]) for row in range(count)]
        for one in self.all:
            p.changeDynamics(one, -1, linearDamping=0)

    def known(self) -> list[tuple[float, float]]:
        places = (self.p.getBasePositionAndOrientation(one)[0][0] for one in self.all)
        return [(x, self.p.getBaseVelocity(one)[0][0]) for x, one in zip(places, self.all, strict=True)]

    def push(self, forces: list[float]) -> None:
        for one, force in zip(self.all, forces, strict=True):
            place = self.p.getBasePositionAndOrientation(one)[0]
            self.p.applyExternalForce(one, -1, [force, 0, 0], place, self.p.WORLD_FRAME)
        self.p.stepSimulation()

    def rest(self, place: int) -> None:
        self.p.resetBasePositionAndOrientation(self.all[place], [0, place, 0], [0, 0, 0, 1])
        self.p.resetBaseVelocity(self.all[place], [0, 0, 0], [0, 0, 0])


class Dart(Bodies):
    def make(self, count: int) -> None:
        import dartpy  # noqa: PLC0415

        self.world = dartpy.simulation.World()
        self.world.setTimeStep(self.step_s)
        self.world.setGravity([0, 0, 0])
        self.all = [dartpy.dynamics.Skeleton(str(row)) for row in range(count)]
        for one in self.all:
            one.createPrismaticJointAndBodyNodePair()[1].setMass(self.mass_kg)
            self.world.addSkeleton(one)

    def known(self) -> list[tuple[float, float]]:
        return [(one.getPositions()[0], one.getVelocities()[0]) for one in self.all]

    def push(self, forces: list[float]) -> None:
        for one, force in zip(self.all, forces, strict=True):
            one.setForces([force])
        self.world.step()

    def rest(self, place: int) -> None:
        self.all[place].setPositions([0.0])
        self.all[place].setVelocities([0.0])


class Box2d(Bodies):
    def make(self, count: int) -> None:
        import Box2D  # noqa: PLC0415

        self.world = Box2D.b2World(gravity=(0, 0), doSleep=False)
        self.all = [self.world.CreateDynamicBody(position=(0, row)) for row in range(count)]
        for one in self.all:
            one.massData = Box2D.b2MassData(mass=self.mass_kg, I=1.0)

    def known(self) -> list[tuple[float, float]]:
        return [(one.position.x, one.linearVelocity.x) for one in self.all]

    def push(self, forces: list[float]) -> None:
        for one, force in zip(self.all, forces, strict=True):
            one.ApplyForceToCenter((force, 0), True)
        self.world.Step(self.step_s, 8, 3)

    def rest(self, place: int) -> None:
        self.all[place].position, self.all[place].linearVelocity = (0, place), (0, 0)


class Pymunk(Bodies):
    def make(self, count: int) -> None:
        import pymunk  # noqa: PLC0415

        self.world = pymunk.Space()
        self.all = [pymunk.Body(self.mass_kg, 1.0) for _ in range(count)]
        self.world.add(*self.all)

    def known(self) -> list[tuple[float, float]]:
        return [(one.position.x, one.velocity.x) for one in self.all]

    def push(self, forces: list[float]) -> None:
        for one, force in zip(self.all, forces, strict=True):
            one.force = (force, 0)
        self.world.step(self.step_s)

    def rest(self, place: int) -> None:
        self.all[place].position = self.all[place].velocity = (0, 0)


class Drake(Bodies):
    discrete = True

    def make(self, count: int) -> None:
        from pydrake.multibody import plant, tree  # noqa: PLC0415
        from pydrake.systems.analysis import Simulator  # noqa: PLC0415

        self.plant = plant.MultibodyPlant(self.step_s if self.discrete else 0.0)
        for row in range(count):
            inertia = tree.SpatialInertia.SolidSphereWithMass(self.mass_kg, 0.02)
            frame = self.plant.AddRigidBody(str(row), inertia).body_frame()
            self.plant.AddJoint(tree.PrismaticJoint(str(row), self.plant.world_frame(), frame, [1, 0, 0]))
        self.plant.mutable_gravity_field().set_gravity_vector([0, 0, 0])
        self.plant.Finalize()
        self.simulator, self.steps = Simulator(self.plant), 0
        self.context = self.simulator.get_mutable_context()
        self.simulator.Initialize()

    def known(self) -> Array:
        return np.asarray(self.plant.GetPositionsAndVelocities(self.context)).reshape(2, -1).T

    def push(self, forces: list[float]) -> None:
        self.plant.get_applied_generalized_force_input_port().FixValue(self.context, np.array(forces))
        self.steps += 1
        self.simulator.AdvanceTo(self.steps * self.step_s)

    def rest(self, place: int) -> None:
        state = self.known()
        state[place] = 0.0
        self.plant.SetPositionsAndVelocities(self.context, state.T.ravel())


class Continuous(Drake):
    discrete = False


def of_mujoco(mass_kg: float, step_s: float, held: Any, substeps: int = 1, *, exact: bool = False) -> MujocoTools:
    """Return tools of MuJoCo, by Euler or RK4."""
    tools = MujocoTools(mass_kg, step_s / substeps, held)
    tools.substeps = substeps
    if exact:
        tools.model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    return tools


# By name: integrator and substeps of [simulation], what makes the tools, and the package.
SEMI = {"integrator": "semi-implicit"}
ENGINES: dict[str, tuple[Mapping[str, Any], Callable[..., Any], str]] = {
    "MuJoCo, Euler": (SEMI, of_mujoco, "mujoco"),
    "PyBullet": (SEMI, Pybullet, "pybullet"),
    "DART": (SEMI, Dart, "dartpy"),
    "Box2D": (SEMI, Box2d, "Box2D"),
    "Drake, discrete": (SEMI, Drake, "drake"),
    "pymunk": ({"integrator": "explicit"}, Pymunk, "pymunk"),
    "MuJoCo, RK4": ({"integrator": "exact"}, partial(of_mujoco, exact=True), "mujoco"),
    "Drake, continuous": ({"integrator": "exact"}, Continuous, "drake"),
    "MuJoCo, Euler, nstep 4": (SEMI | {"substeps": 4}, of_mujoco, "mujoco"),
    "PyBullet, numSubSteps 4": (SEMI | {"substeps": 4}, Pybullet, "pybullet"),
}


@cache
def asked(index: int, integrator: str, substeps: int = 1) -> tuple[Axis, Any, Any]:
    """Return a drawn device and engine, what is recommended for it, and the stiffest pair."""
    axis = replace(drawn(20_000 + index, 0.5), engine_damps=False)
    problem = problem_of(axis, integrator=integrator, substeps=substeps).changed(device={"max_force_n": 10.0})
    answer = avc.recommend(problem, hands=20)
    return axis, None if answer.coupling is None else answer.coupling.gains, ToolSearch(problem).limit[0]


def cell(name: str, index: int) -> dict[str, Any]:
    """Count the axes that grow with the recommended pair, with 0.7 of it and beyond the limit."""
    keys, make, _ = ENGINES[name]
    axis, gains, limit = asked(index, **keys)
    hands = corners(problem_of(axis))
    softer = None if gains is None else gains.times(SOFTER)
    tried = {
        "recommended": gains,
        "softer": softer,
        "beyond": replace(limit, stiffness_n_per_m=BEYOND * limit.stiffness_n_per_m),
    }
    grown = {}
    for which, pair in tried.items():
        if pair is None:
            continue
        every, held = np.tile(hands, (2, 1)), np.repeat([False, True], len(hands))
        numbers = tuple(np.full(len(every), one) for one in vars(pair).values())
        tools = make(axis.tool_mass_kg, axis.step_s, held, keys.get("substeps", 1))
        samples = math.ceil(4.0 / axis.sample_time_s)
        grown[which] = int(run(axis, every, numbers, samples, held=held, tools=tools).grows.sum())
    return {
        "axis": vars(axis),
        "gains": gains and vars(gains),
        "limit": vars(limit),
        "grown": grown,
        "of": 2 * len(hands),
    }


def main() -> None:
    script_arguments(__doc__)
    told = about("python tests/benchmarks/every_engine.py", SEED)
    told["versions"] |= {package: version(package) for _, _, package in ENGINES.values()}
    cells = {f"{name} {index}": partial(cell, name, index) for name in ENGINES for index in range(PAIRS)}
    computed(cells, OUT, told)


if __name__ == "__main__":
    main()
