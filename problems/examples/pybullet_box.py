"""Press the tool of a PyBullet simulation on a box through the recommended coupling, and through one beyond the limit.

python problems/examples/pybullet_box.py [--out pybullet_box.png]

Needs PyBullet: pip install "avc-casadi[engines]".
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from pressed_box import START_M, STEP_S, TOOL_KG, main

try:
    import pybullet
except ImportError:
    sys.exit('pybullet_box.py needs PyBullet: pip install "avc-casadi[engines]"')

_RADIUS_M = 0.01


class BulletBox:
    """Tool on a prismatic joint without a motor, pushed by its torque control."""

    def __init__(self) -> None:
        self._world: Any = pybullet.connect(pybullet.DIRECT)
        world = {"physicsClientId": self._world}
        pybullet.setTimeStep(STEP_S, **world)
        pybullet.setGravity(0, 0, 0, **world)
        box = {"shapeType": pybullet.GEOM_BOX, "halfExtents": [0.03, 0.03, 0.02]}
        ball = {"shapeType": pybullet.GEOM_SPHERE, "radius": _RADIUS_M}
        pybullet.createMultiBody(
            0,
            pybullet.createCollisionShape(**box, **world),
            pybullet.createVisualShape(**box, rgbaColor=[0.75, 0.75, 0.75, 1], **world),
            basePosition=[0, 0, -0.02],
            **world,
        )
        # The base stands above all; its one link slides along z.
        self._tool = pybullet.createMultiBody(
            baseMass=0,
            basePosition=[0, 0, _RADIUS_M],
            linkMasses=[TOOL_KG],
            linkCollisionShapeIndices=[pybullet.createCollisionShape(**ball, **world)],
            linkVisualShapeIndices=[pybullet.createVisualShape(**ball, rgbaColor=[1, 0.5, 0.05, 1], **world)],
            linkPositions=[[0, 0, 0]],
            linkOrientations=[[0, 0, 0, 1]],
            linkInertialFramePositions=[[0, 0, 0]],
            linkInertialFrameOrientations=[[0, 0, 0, 1]],
            linkParentIndices=[0],
            linkJointTypes=[pybullet.JOINT_PRISMATIC],
            linkJointAxis=[[0, 0, -1]],
            **world,
        )
        # Bullet damps every body and holds every joint by a motor, unless it is told not to.
        for link in (-1, 0):
            pybullet.changeDynamics(self._tool, link, linearDamping=0, angularDamping=0, jointDamping=0, **world)
        pybullet.setJointMotorControl2(self._tool, 0, pybullet.VELOCITY_CONTROL, force=0, **world)
        pybullet.resetJointState(self._tool, 0, START_M, 0, **world)

    def state(self) -> tuple[float, float]:
        """Return position and velocity of the tool."""
        x, v, *_ = pybullet.getJointState(self._tool, 0, physicsClientId=self._world)
        return float(x), float(v)

    def step(self, force_n: float) -> None:
        """Move the tool by one step under a force."""
        torque = pybullet.TORQUE_CONTROL
        pybullet.setJointMotorControl2(self._tool, 0, torque, force=force_n, physicsClientId=self._world)
        pybullet.stepSimulation(physicsClientId=self._world)

    def draw(self, axes: Any) -> None:
        """Show what Bullet's own renderer sees."""
        width, height = 480, 220
        view = pybullet.computeViewMatrix([0.0, -0.16, 0.035], [0, 0, -0.005], [0, 0, 1])
        lens = pybullet.computeProjectionMatrixFOV(35, width / height, 0.01, 1)
        renderer = pybullet.ER_TINY_RENDERER
        image = pybullet.getCameraImage(width, height, view, lens, renderer=renderer, physicsClientId=self._world)[2]
        axes.imshow(np.asarray(image, dtype=np.uint8).reshape(height, width, 4)[..., :3])
        axes.set_axis_off()


if __name__ == "__main__":
    sys.exit(main(BulletBox, "PyBullet"))
