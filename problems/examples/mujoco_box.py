"""Press the tool of a MuJoCo simulation on a box through the recommended coupling, and through one beyond the limit.

python problems/examples/mujoco_box.py [--out mujoco_box.png]

Needs MuJoCo: pip install "avc-casadi[engines]".
"""

from __future__ import annotations

import sys
from typing import Any

from pressed_box import START_M, STEP_S, TOOL_KG, main

try:
    import mujoco
except ImportError:
    sys.exit('mujoco_box.py needs MuJoCo: pip install "avc-casadi[engines]"')

# x grows downwards into the box; contact, solver and integrator are MuJoCo's defaults.
SCENE = f"""<mujoco><option timestep="{STEP_S}" gravity="0 0 0" integrator="Euler"/><worldbody>
<geom name="box" type="box" size="0.03 0.03 0.02" pos="0 0 -0.02"/>
<body pos="0 0 0.01"><joint type="slide" axis="0 0 -1"/><geom name="tool" type="sphere" size="0.01" mass="{TOOL_KG}"/>
</body></worldbody></mujoco>"""


class MujocoBox:
    """Tool on a slide joint, pushed by `qfrc_applied`."""

    def __init__(self) -> None:
        self._model: Any = mujoco.MjModel.from_xml_string(SCENE)
        self._data: Any = mujoco.MjData(self._model)
        self._data.qpos[0] = START_M
        mujoco.mj_forward(self._model, self._data)

    def state(self) -> tuple[float, float]:
        """Return position and velocity of the tool."""
        return float(self._data.qpos[0]), float(self._data.qvel[0])

    def step(self, force_n: float) -> None:
        """Move the tool by one step under a force."""
        self._data.qfrc_applied[0] = force_n
        mujoco.mj_step(self._model, self._data)

    def draw(self, axes: Any) -> None:
        """Draw tool and box from the side, where MuJoCo's geoms are: it needs no graphics driver."""
        from matplotlib.patches import Circle, Rectangle  # noqa: PLC0415

        mujoco.mj_forward(self._model, self._data)
        box, tool = self._data.geom("box"), self._data.geom("tool")
        half, middle = 1e3 * self._model.geom("box").size, 1e3 * box.xpos
        corner = (middle[0] - half[0], middle[2] - half[2])
        axes.add_patch(Rectangle(corner, 2 * half[0], 2 * half[2], facecolor="0.8", edgecolor="0.3"))
        radius, centre = 1e3 * self._model.geom("tool").size[0], 1e3 * tool.xpos
        axes.add_patch(Circle((centre[0], centre[2]), radius, facecolor="C1", edgecolor="0.3", alpha=0.8))
        axes.set(xlim=(-60, 60), ylim=(-42, 42), aspect="equal", xlabel="mm", ylabel="height, mm")


if __name__ == "__main__":
    sys.exit(main(MujocoBox, "MuJoCo"))
