"""[simulation] compared with every engine that pip installs: recommended pairs are stable in each, others are not.

OPENBLAS_NUM_THREADS=1 nice -n 10 python tests/benchmarks/every_engine.py

Needs `pip install mujoco pybullet dartpy Box2D pymunk drake`. Device, hand and coupling are engine_axes.py's; an engine
moves tools without contact. Overwrites results/every_engine.json after every cell and goes on where it stopped.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache, partial
from importlib import import_module
from importlib.metadata import version
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from engine_axes import Axis, MujocoTools, run
from engine_boundaries import BEYOND, SEED, drawn, problem_of
from script_arguments import script_arguments
from studied import about, computed

from avc_casadi.design.virtual_tool import ToolSearch
from avc_casadi.model.ends import ToolGains
from avc_casadi.model.hands import hand_corners, with_stops
from avc_casadi.recommendation.pair import GAIN_MARGIN

OUT = Path(__file__).parent / "results" / "every_engine.json"
PAIRS, SOFTER, SECONDS = 12, 0.7, 4.0


class Bodies(NamedTuple):
    """Tools of one engine that move along x: place and velocity of one, its force, a step of all, one stopped at 0."""

    known: Callable[[int], Any]
    push: Callable[[int, float], Any]
    advance: Callable[[], Any]
    rest: Callable[[int], Any]


class Tools:
    """Tools of one engine; those that are held stay at 0."""

    def __init__(self, engine: Callable[..., Bodies], mass_kg: float, step_s: float, held: Any, substeps: int) -> None:
        self.moves = ~held
        self.rows = range(int(self.moves.sum()))
        self.bodies = engine(mass_kg, step_s, substeps, self.rows)

    def state(self) -> Any:
        """Return positions and velocities, shape (2, n)."""
        found = np.zeros((2, len(self.moves)))
        found[:, self.moves] = np.transpose([self.bodies.known(row) for row in self.rows])
        return found

    def step(self, force_n: Any) -> None:
        """Move all by one step under a force each."""
        for row, force in zip(self.rows, force_n[self.moves].tolist(), strict=True):
            self.bodies.push(row, force)
        self.bodies.advance()

    def stop(self, rows: Any) -> None:
        """Bring some back to where nothing moves."""
        for row in np.flatnonzero(rows[self.moves]).tolist():
            self.bodies.rest(row)


def of_pybullet(mass_kg: float, step_s: float, substeps: int, rows: range) -> Bodies:
    p = import_module("pybullet")
    if not p.isConnected():
        p.connect(p.DIRECT)
    p.resetSimulation()
    p.setTimeStep(step_s)
    p.setPhysicsEngineParameter(numSubSteps=substeps)
    for row in rows:
        p.createMultiBody(mass_kg, p.createCollisionShape(p.GEOM_SPHERE, radius=0.02), basePosition=[0, row, 0])
        p.changeDynamics(row, -1, linearDamping=0)

    def place(row: int) -> Any:
        return p.getBasePositionAndOrientation(row)[0]

    def rest(row: int) -> None:
        p.resetBasePositionAndOrientation(row, [0, row, 0], [0, 0, 0, 1])
        p.resetBaseVelocity(row, [0, 0, 0], [0, 0, 0])

    return Bodies(
        lambda row: (place(row)[0], p.getBaseVelocity(row)[0][0]),
        lambda row, force: p.applyExternalForce(row, -1, [force, 0, 0], place(row), p.WORLD_FRAME),
        p.stepSimulation,
        rest,
    )


def of_dart(mass_kg: float, step_s: float, _: int, rows: range) -> Bodies:
    dart = import_module("dartpy")
    world, every = dart.simulation.World(), [dart.dynamics.Skeleton(str(row)) for row in rows]
    world.setTimeStep(step_s)
    world.setGravity([0, 0, 0])
    for one in every:
        one.createPrismaticJointAndBodyNodePair()[1].setMass(mass_kg)
        world.addSkeleton(one)
    return Bodies(
        lambda row: (every[row].getPositions()[0], every[row].getVelocities()[0]),
        lambda row, force: every[row].setForces([force]),
        world.step,
        lambda row: (every[row].setPositions([0.0]), every[row].setVelocities([0.0])),
    )


def of_box2d(mass_kg: float, step_s: float, _: int, rows: range) -> Bodies:
    box = import_module("Box2D")
    world = box.b2World(gravity=(0, 0), doSleep=False)
    every = [world.CreateDynamicBody() for row in rows]
    for one in every:
        one.massData = box.b2MassData(mass=mass_kg, center=(0, 0), I=1.0)

    def rest(row: int) -> None:
        every[row].position = every[row].linearVelocity = (0, 0)

    return Bodies(
        lambda row: (every[row].position.x, every[row].linearVelocity.x),
        lambda row, force: every[row].ApplyForceToCenter((force, 0), True),
        partial(world.Step, step_s, 8, 3),
        rest,
    )


def of_pymunk(mass_kg: float, step_s: float, _: int, rows: range) -> Bodies:
    munk = import_module("pymunk")
    space, every = munk.Space(), [munk.Body(mass_kg, 1.0) for row in rows]
    space.add(*every)

    def rest(row: int) -> None:
        every[row].position = every[row].velocity = (0, 0)

    return Bodies(
        lambda row: (every[row].position.x, every[row].velocity.x),
        lambda row, force: every[row].apply_force_at_local_point((force, 0)),
        partial(space.step, step_s),
        rest,
    )


def of_drake(mass_kg: float, step_s: float, _: int, rows: range, *, discrete: bool) -> Bodies:
    tree = import_module("pydrake.multibody.tree")
    plant = import_module("pydrake.multibody.plant").MultibodyPlant(step_s if discrete else 0.0)
    for row in rows:
        body = plant.AddRigidBody(str(row), tree.SpatialInertia.SolidSphereWithMass(mass_kg, 0.02))
        plant.AddJoint(tree.PrismaticJoint(str(row), plant.world_frame(), body.body_frame(), [1, 0, 0]))
    plant.mutable_gravity_field().set_gravity_vector([0, 0, 0])
    plant.Finalize()
    simulator, forces, steps = import_module("pydrake.systems.analysis").Simulator(plant), np.zeros(len(rows)), count(1)
    context = simulator.get_mutable_context()

    def advance() -> None:
        plant.get_applied_generalized_force_input_port().FixValue(context, forces)
        simulator.AdvanceTo(next(steps) * step_s)

    def rest(row: int) -> None:
        state = plant.GetPositionsAndVelocities(context)
        state[row :: len(rows)] = 0.0
        plant.SetPositionsAndVelocities(context, state)

    return Bodies(
        lambda row: plant.GetPositionsAndVelocities(context)[row :: len(rows)],
        forces.__setitem__,
        advance,
        rest,
    )


def of_mujoco(mass_kg: float, step_s: float, held: Any, substeps: int, integrator: int = 0) -> MujocoTools:
    """Return tools of MuJoCo, by Euler (0) or RK4 (1)."""
    tools = MujocoTools(mass_kg, step_s / substeps, held)
    tools.substeps, tools.model.opt.integrator = substeps, integrator
    return tools


# By name: package, integrator and substeps of [simulation], what makes the tools.
ENGINES: dict[str, tuple[str, tuple[str, int], Callable[..., Any]]] = {
    "MuJoCo, Euler": ("mujoco", ("semi-implicit", 1), of_mujoco),
    "PyBullet": ("pybullet", ("semi-implicit", 1), partial(Tools, of_pybullet)),
    "DART": ("dartpy", ("semi-implicit", 1), partial(Tools, of_dart)),
    "Box2D": ("Box2D", ("semi-implicit", 1), partial(Tools, of_box2d)),
    "Drake, discrete": ("drake", ("semi-implicit", 1), partial(Tools, partial(of_drake, discrete=True))),
    "pymunk": ("pymunk", ("explicit", 1), partial(Tools, of_pymunk)),
    "MuJoCo, RK4": ("mujoco", ("exact", 1), partial(of_mujoco, integrator=1)),
    "Drake, continuous": ("drake", ("exact", 1), partial(Tools, partial(of_drake, discrete=False))),
    "MuJoCo, Euler, nstep 4": ("mujoco", ("semi-implicit", 4), of_mujoco),
    "PyBullet, numSubSteps 4": ("pybullet", ("semi-implicit", 4), partial(Tools, of_pybullet)),
}


@cache
def asked(index: int, integrator: str, substeps: int) -> tuple[Axis, list[ToolGains]]:
    """Return a drawn device and engine; the pair that hands try first, 0.7 of it, and 1.3 times the stiffest."""
    axis = replace(drawn(20_000 + index, 0.5), engine_damps=False)
    search = ToolSearch(problem_of(axis, integrator=integrator, substeps=substeps))
    limit, local = search.limit
    safe = search.stiffest_with_margin(limit, GAIN_MARGIN, local=local)
    pair = search.damped(0.9 * safe, local=local, gain_margin=GAIN_MARGIN)[0]
    return axis, [pair, pair.times(SOFTER), replace(limit, stiffness_n_per_m=BEYOND * limit.stiffness_n_per_m)]


def cell(name: str, index: int) -> dict[str, Any]:
    """Count the axes that grow with each of the three pairs."""
    _, loop, make = ENGINES[name]
    axis, pairs = asked(index, *loop)
    hands = np.transpose([*vars(with_stops(hand_corners(problem_of(axis).hands), axis.mass_kg)).values()])
    held = np.tile(np.repeat([False, True], len(hands)), len(pairs))
    numbers: Any = tuple(np.repeat([list(vars(one).values()) for one in pairs], 2 * len(hands), axis=0).T)
    tools, samples = make(axis.tool_mass_kg, axis.step_s, held, loop[1]), math.ceil(SECONDS / axis.sample_time_s)
    grows = run(axis, np.tile(hands, (2 * len(pairs), 1)), numbers, samples, held=held, tools=tools).grows
    return {"axis": vars(axis), "pairs": list(map(vars, pairs)), "grow": grows.reshape(3, -1).sum(axis=1).tolist()}


def main() -> None:
    script_arguments(__doc__)
    told = about("python tests/benchmarks/every_engine.py", SEED)
    told["versions"] |= {package: version(package) for package, _, _ in ENGINES.values()}
    cells: Mapping[str, Any] = {
        f"{name} {index}": partial(cell, name, index) for name in ENGINES for index in range(PAIRS)
    }
    computed(cells, OUT, told)


if __name__ == "__main__":
    main()
