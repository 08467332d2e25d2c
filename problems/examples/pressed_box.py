"""A simulated device that presses the tool of a physics engine on a box; mujoco_box.py and pybullet_box.py run it.

`avc recommend` chooses spring and damper from the problem below. Then the loop runs twice with every corner of the
hands: with what was recommended, and with the limit's damper and 1.3 times the stiffest K, where it must not hold.
A device of your own takes the place of `Device`; the lines of `pressed` are the whole coupling.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

import avc_casadi as avc
from avc_casadi.model.hands import hand_corners

Array = NDArray[np.float64]

PROBLEM = """[device]
mass_kg = 0.12
damping_ns_per_m = 0.8
sample_time_s = 0.001
delay_samples = 1
max_force_n = 8.0

[simulation]
tool_mass_kg = 0.05
step_s = 0.005
integrator = "semi-implicit"
exchange = "on-time"
clock = "device"                # `pressed` starts each step of the engine at a sample
"""
TOOL_KG, STEP_S, SAMPLE_S, DELAY, LIMIT_N = 0.05, 0.005, 0.001, 1, 8.0
START_M, DEEPEST_M, SECONDS = -0.02, 0.01, 5.5
BEYOND = 1.3
# When the hand's target begins to come down, after a swing and a rest in the air; when it taps, for a second.
DOWN_S, TAPS_S = 3.0, 3.4
# What moves less than this over the last quarter of a second, in the air and pressed, has settled, m.
SETTLED_M = 5e-5


class Engine(Protocol):
    """A tool on a slide above a box whose face is at x = 0; x grows into the box."""

    def state(self) -> tuple[float, float]:
        """Return position and velocity of the tool."""
        ...

    def step(self, force_n: float) -> None:
        """Move the tool by one step of `STEP_S` under a force."""
        ...

    def draw(self, axes: Any) -> None:
        """Show tool and box as they are."""
        ...


class Device:
    """Mass and damper with a hand, from sample to sample exactly under a held force.

    Args:
        hand: mass, damping and stiffness.
        start_m: where it begins, the hand relaxed.
    """

    def __init__(self, hand: tuple[float, float, float], start_m: float) -> None:
        mass, damping, stiffness = hand
        rate = np.zeros((4, 4))
        rate[0, 1] = 1.0
        rate[1] = np.array([-stiffness, -damping - 0.8, -1.0, stiffness]) / (0.12 + mass)
        self._step = expm(rate * SAMPLE_S)[:2]
        self._state = np.array([start_m, 0.0])
        self._under_way = [0.0] * DELAY

    @property
    def position_m(self) -> float:
        """Where it is."""
        return float(self._state[0])

    def sample(self, force_n: float, target_m: float) -> None:
        """Go on by T with a force that comes `DELAY` samples late, and the hand's target."""
        self._under_way.append(force_n)
        self._state = self._step @ [*self._state, self._under_way.pop(0), target_m]


@dataclass(frozen=True)
class Course:
    """Device, tool and force at every sample, and the engine at the end."""

    device_m: Array
    tool_m: Array
    force_n: Array
    engine: Engine

    @property
    def moves_m(self) -> float:
        """How far device and tool still move at the end of the rest in the air, or of the press."""
        ends = (int(DOWN_S / SAMPLE_S), len(self.device_m))
        last = [slice(end - int(0.25 / SAMPLE_S), end) for end in ends]
        return max(float(np.ptp(self.device_m[part]) + np.ptp(self.tool_m[part])) for part in last)


def target_m(time_s: float) -> float:
    """Return where the hand aims: it swings in the air, rests there, comes down, taps three times and presses."""
    if time_s < 1.0:
        return START_M + 0.006 * math.sin(2 * math.pi * 2 * time_s)
    depth = START_M + min(max((time_s - DOWN_S) / 0.3, 0.0), 1.0) * (DEEPEST_M - START_M)
    tapping = TAPS_S < time_s < TAPS_S + 1.0
    return depth - (0.008 * (1 - math.cos(2 * math.pi * 3 * (time_s - TAPS_S))) if tapping else 0.0)


def pressed(engine: Engine, hand: tuple[float, float, float], stiffness: float, damping: float) -> Course:
    """Let a hand press the tool on the box through spring and damper."""
    device, every = Device(hand, START_M), round(STEP_S / SAMPLE_S)

    def coupled(stretch_m: float, speed_m_per_s: float) -> float:
        # Both ends end where the device's force does: the engine is never pushed by more than is felt.
        return min(max(stiffness * stretch_m + damping * speed_m_per_s, -LIMIT_N), LIMIT_N)

    last = device.position_m
    known = engine.state()
    found = []
    for sample in range(int(SECONDS / SAMPLE_S)):
        x = device.position_m
        v = (x - last) / SAMPLE_S
        if sample % every == 0:
            known = engine.state()  # on time: the device is given what the step begins with
            engine.step(coupled(x - known[0], v - known[1]))
        force = coupled(x - known[0], v - known[1])
        found.append((x, known[0], force))
        device.sample(force, target_m(sample * SAMPLE_S))
        last = x
    return Course(*np.array(found).T, engine)


def main(engine: Callable[[], Engine], name: str) -> int:
    """Run both couplings with every hand, write the picture, and return 0 where all is as `avc recommend` says.

    Args:
        engine: makes a fresh one.
        name: of the engine, in words and in the picture's name.
    """
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path(f"{name.lower()}_box.png"), help="picture")
    out = parser.parse_args().out
    answer = avc.recommend(avc.parse_problem(PROBLEM), hands=50)
    if answer.coupling is None:
        print(answer.reason)
        return 1
    gains, limit = answer.coupling.gains, answer.pair.stiffest
    pairs = {
        "recommended": (gains.stiffness_n_per_m, gains.damping_ns_per_m),
        f"{BEYOND:g} times the limit": (BEYOND * limit.stiffness_n_per_m, limit.damping_ns_per_m),
    }
    corners = hand_corners(answer.problem.hands)
    hands = [tuple(corners.values(row).values()) for row in range(len(corners))]
    shown: dict[str, Course] = {}
    count = []
    for what, (stiffness, damping) in pairs.items():
        courses = [pressed(engine(), hand, stiffness, damping) for hand in hands]  # type: ignore[arg-type]
        count.append(sum(course.moves_m < SETTLED_M for course in courses))
        shown[what] = max(courses, key=lambda course: course.moves_m)
        print(
            f"{name}, {what}: K {stiffness:.0f} N/m, B {damping:.1f} N.s/m: {count[-1]} of {len(hands)} hands settle; "
            f"at most {1e6 * shown[what].moves_m:.1f} um of motion are left"
        )
    draw(shown, pairs, name, out)
    print(f"picture: {out}")
    return 0 if count[0] == len(hands) and count[1] < len(hands) else 1


def draw(shown: dict[str, Course], pairs: dict[str, tuple[float, float]], name: str, out: Path) -> None:
    """Write the picture: position, force, and tool and box at the end, the worst hand of each coupling."""
    from matplotlib.figure import Figure  # noqa: PLC0415

    figure = Figure(figsize=(11, 9), layout="constrained")
    grid = figure.subplots(3, len(shown), height_ratios=(3, 3, 2), squeeze=False)
    for column, (what, course) in enumerate(shown.items()):
        time = np.arange(len(course.device_m)) * SAMPLE_S
        position, force, view = grid[:, column]
        position.axhspan(0, 16, color="0.88", label="box")
        position.plot(time, 1e3 * course.device_m, label="device", linewidth=1)
        position.plot(time, 1e3 * course.tool_m, label="tool", linewidth=1)
        position.set(ylim=(16, -32), ylabel="position, mm (down is into the box)")
        stiffness, damping = pairs[what]
        position.set_title(f"{name}, {what}: K {stiffness / 1e3:.1f} kN/m, B {damping:.0f} N.s/m")
        position.legend(loc="upper right")
        force.plot(time, course.force_n, color="C3", linewidth=0.8)
        force.set(xlabel="time, s", ylabel="force on the device, N", ylim=(-1.1 * LIMIT_N, 1.1 * LIMIT_N))
        course.engine.draw(view)
        view.set_title("tool and box at the end", fontsize=10)
    figure.savefig(out, dpi=110)
