"""Two emulated boards that talk over a UDP loopback socket with delay and losses, each with a device of its own.

`avc recommend` chooses the coupling of the problem below, its C is exported, compiled (a C compiler is needed) and
called by two processes: the leader's, with a hand, and the follower's, with a wall at x = 0. Each moves its device
exactly from sample to sample, 1000 times a second by the clock of the computer (--slower N: N times slower, where other
work keeps a process waiting for longer than the link may be silent), and sends a message of 16 bytes (number,
position, velocity, force) after every sample; a message is held back for the delay, or lost, before it is sent. The
hand swings in the air, rests, presses and rests. Then what both have recorded is laid side by side: whether they settle
is printed, and positions and forces over time are drawn.
"""

from __future__ import annotations

import argparse
import ctypes
import json
import math
import multiprocessing as mp
import os
import random
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from multiprocessing.synchronize import Barrier
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.model.ends import ToolGains
from avc_hardware import export_c

Array = NDArray[np.float64]

DELAY_S, JITTER, LOST = 0.005, 0.1, 0.01
PROBLEM = f"""[device]
mass_kg = 0.12
damping_ns_per_m = 0.8
delay_samples = 1
max_force_n = 8.0

[follower]
mass_kg = 0.3
damping_ns_per_m = 1.0
delay_samples = 1
max_force_n = 15.0
delay_s = {DELAY_S}
jitter = {JITTER}
lost_share = {LOST}
"""
SAMPLE_S, SECONDS, HAND = 0.001, 5.0, (0.2, 5.0, 300.0)
START_M, DEEPEST_M, DOWN_S = -0.02, 0.02, 2.5
# What moves less than this over the last half second of the rest in the air, and of the press, has settled.
SETTLED_M = 5e-5


class Message(ctypes.Structure):
    """What goes over the link, as the exported C has it in single precision."""

    _fields_ = (
        ("number", ctypes.c_uint32),
        ("position", ctypes.c_float),
        ("velocity", ctypes.c_float),
        ("force", ctypes.c_float),
    )


class Board:
    """One end: the exported C in memory of its own.

    Args:
        library: compiled.
        end: LEADER or FOLLOWER.
    """

    def __init__(self, library: str, end: str) -> None:
        self._c = c = ctypes.CDLL(library)
        c.avc_coupling_step.argtypes = [ctypes.c_void_p, ctypes.c_float, ctypes.c_void_p]
        c.avc_coupling_step.restype = ctypes.c_float
        c.avc_coupling_message.argtypes, c.avc_coupling_message.restype = [ctypes.c_void_p], Message
        c.avc_coupling_receive.argtypes = [ctypes.c_void_p, ctypes.c_void_p]
        c.avc_coupling_init.argtypes = [ctypes.c_void_p, ctypes.c_void_p]
        self._memory = ctypes.create_string_buffer(512)
        c.avc_coupling_init(self._memory, ctypes.addressof(ctypes.c_char.in_dll(c, f"AVC_COUPLING_{end}")))

    def receive(self, packet: bytes) -> None:
        """Give it what has arrived."""
        self._c.avc_coupling_receive(self._memory, ctypes.byref(Message.from_buffer_copy(packet)))

    def sample(self, position_m: float) -> tuple[float, bytes]:
        """Return the force, and the message to send."""
        force = self._c.avc_coupling_step(self._memory, position_m, None)
        return float(force), bytes(self._c.avc_coupling_message(self._memory))


class Device:
    """Mass and damper, with a spring and damper to a target that moves evenly over a sample, exactly.

    Args:
        mass: with what moves with it.
        damping: its own.
        hand: damping and stiffness.
    """

    def __init__(self, mass: float, damping: float, hand: tuple[float, float] = (0.0, 0.0)) -> None:
        b, k = hand
        rate = np.zeros((5, 5))
        rate[0, 1] = rate[3, 4] = 1.0
        rate[1] = np.array([-k, -damping - b, 1.0, k, b]) / mass
        self._step = expm(rate * SAMPLE_S)[:2]
        self.state = np.array([START_M, 0.0])
        self._under_way = 0.0

    def sample(self, force_n: float, target: tuple[float, float] = (0.0, 0.0), *, wall: bool = False) -> None:
        """Go on by a sample with the force of the one before."""
        self.state = self._step @ [*self.state, self._under_way, *target]
        self._under_way = force_n
        if wall and self.state[0] > 0:
            self.state = np.array([0.0, min(self.state[1], 0.0)])


def target_m(time_s: float) -> float:
    """Return where the hand aims."""
    if time_s < 1.5:
        return START_M + 0.01 * math.sin(2 * math.pi * 2 * time_s) * min(1.0, 4 * time_s)
    return START_M + min(max((time_s - DOWN_S) / 0.4, 0.0), 1.0) * (DEEPEST_M - START_M)


def board(end: str, library: str, ports: tuple[int, int], begin: Barrier, slower: float, out: str) -> None:
    """Be one of the two boards, by the clock.

    Args:
        end: LEADER or FOLLOWER.
        library: the compiled C.
        ports: own, and that of the other end.
        begin: at which both meet before the first sample.
        slower: how many times slower than the clock all is, the link too.
        out: where its record goes: time, position, force on the device, one row a sample.
    """
    leads, rng = end == "LEADER", random.Random(end)  # noqa: S311 - losses, no secrets
    device = Device(0.12 + HAND[0], 0.8, HAND[1:]) if leads else Device(0.3, 1.0)
    own = Board(library, end)
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    link.bind(("127.0.0.1", ports[0]))
    link.setblocking(False)
    held: list[tuple[float, bytes]] = []
    rows, late = [], 0.0
    begin.wait()
    begin_s = time.monotonic()
    for sample in range(int(SECONDS / SAMPLE_S)):
        due = sample * SAMPLE_S
        while (now := (time.monotonic() - begin_s) / slower) < due:
            time.sleep(slower * (due - now))
        late = max(late, now - due)
        while True:
            try:
                own.receive(link.recv(64))
            except (BlockingIOError, ConnectionRefusedError):
                break
        position = float(device.state[0])
        force, packet = own.sample(position)
        rows.append((sample * SAMPLE_S, position, force))
        if rng.random() >= LOST:
            held.append((now + DELAY_S * (1 + JITTER * rng.uniform(-1, 1)), packet))
        for leaves in [one for one in held if one[0] <= now + SAMPLE_S / 2]:
            held.remove(leaves)
            link.sendto(leaves[1], ("127.0.0.1", ports[1]))
        aim = target_m(sample * SAMPLE_S)
        after = target_m((sample + 1) * SAMPLE_S)
        device.sample(force, (aim, (after - aim) / SAMPLE_S), wall=not leads)
    Path(out).write_text(json.dumps({"late_s": late, "rows": rows}), encoding="utf-8")


def compiled(coupling: Coupling, folder: Path) -> str:
    """Return the library that a C compiler makes of the exported coupling."""
    compiler = shutil.which(os.environ.get("CC", "cc"))
    if compiler is None:
        sys.exit("teleoperation_loopback.py needs a C compiler: install one, or name it in CC")
    for name, text in export_c(coupling).items():
        (folder / name).write_text(text, encoding="ascii")
    library = str(folder / "avc_coupling.so")
    command = [compiler, "-O2", "-shared", "-fPIC", str(folder / "avc_coupling.c"), "-o", library]
    subprocess.run(command, check=True)  # noqa: S603 - the compiler of this computer
    return library


def free_ports() -> tuple[int, int]:
    """Return two ports that nobody listens to."""
    sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2)]
    for one in sockets:
        one.bind(("127.0.0.1", 0))
    first, second = (one.getsockname()[1] for one in sockets)
    for one in sockets:
        one.close()
    return first, second


def moves_m(records: list[Array]) -> float:
    """Return how far both still move at the end of the rest in the air, and of the press."""
    ends = (int(DOWN_S / SAMPLE_S), len(records[0]))
    return max(float(np.ptp(one[end - 500 : end, 1])) for one in records for end in ends)


def result_lines(records: list[Array], gains: ToolGains, late_s: float, slower: float) -> list[str]:
    """Return whether both boards settle, and how many times slower a run must be whose samples came late."""
    motion_m = moves_m(records)
    link = f"{1e3 * DELAY_S:g} ms each way, {100 * LOST:g} % lost"
    settles = "settles" if motion_m < SETTLED_M else "does not settle"
    pressed = f"{-records[0][-1, 2]:.2f} N at the leader, {records[1][-1, 2]:.2f} N at the follower"
    coupling = f"K {gains.stiffness_n_per_m:.0f} N/m, B {gains.damping_ns_per_m:.1f} N.s/m"
    rest = f"{settles}, {1e6 * motion_m:.1f} um of motion left"
    lines = [f"{coupling}, {link}: {rest}; pressed with {pressed}; samples up to {1e3 * late_s:.1f} ms late"]
    if late_s > SAMPLE_S:
        lines.append(
            "samples came late: other work held the processor, and the link was silent in place of late; "
            f"judge by a run with --slower {2 * slower * late_s / SAMPLE_S:.0f}"
        )
    return lines


def main() -> int:
    """Run both boards, write the picture, and return 0 where they settle."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("teleoperation_loopback.png"), help="picture")
    told = "times slower than the clock, the link too (default 1): for a computer with other work"
    parser.add_argument("--slower", metavar="N", type=float, default=1.0, help=told)
    args = parser.parse_args()
    out, slower = args.out, args.slower
    answer = avc.recommend(avc.parse_problem(PROBLEM), hands=20)
    if answer.coupling is None:
        print(answer.reason)
        return 1
    gains = answer.coupling.gains
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        library, (first, second) = compiled(answer.coupling, folder), free_ports()
        spawn = mp.get_context("spawn")
        begin = spawn.Barrier(2)
        ends = {"LEADER": (first, second), "FOLLOWER": (second, first)}
        boards = [
            spawn.Process(target=board, args=(end, library, ports, begin, slower, str(folder / end)))
            for end, ports in ends.items()
        ]
        for one in boards:
            one.start()
        for one in boards:
            one.join()
        if any(one.exitcode for one in boards):
            print("a board has ended with a fault")
            return 1
        found = [json.loads((folder / end).read_text(encoding="utf-8")) for end in ends]
    records = [np.array(one["rows"]) for one in found]
    late_s = max(one["late_s"] for one in found)
    print(*result_lines(records, gains, late_s, slower), sep="\n")
    draw(records, f"K {gains.stiffness_n_per_m:.0f} N/m, B {gains.damping_ns_per_m:.1f} N.s/m", out)
    print(f"picture: {out}")
    return 0 if moves_m(records) < SETTLED_M else 1


def draw(records: list[Array], title: str, out: Path) -> None:
    """Write the picture: positions above, forces below."""
    from matplotlib.figure import Figure  # noqa: PLC0415

    figure = Figure(figsize=(10, 7), layout="constrained")
    axes: Any = figure.subplots(2, sharex=True)
    axes[0].axhspan(0, 25, color="0.88", label="wall of the follower")
    for record, who in zip(records, ("leader", "follower"), strict=True):
        axes[0].plot(record[:, 0], 1e3 * record[:, 1], label=who, linewidth=1)
        axes[1].plot(record[:, 0], record[:, 2], label=f"on the {who}", linewidth=0.8)
    axes[0].set(ylabel="position, mm", ylim=(-35, 25))
    axes[0].set_title(f"{title}; {1e3 * DELAY_S:g} ms each way over UDP, {100 * LOST:g} % lost")
    axes[1].set(xlabel="time, s", ylabel="force, N")
    for one in axes:
        one.legend(loc="upper left")
        one.grid(alpha=0.3)
    figure.savefig(out, dpi=110)


if __name__ == "__main__":
    sys.exit(main())
