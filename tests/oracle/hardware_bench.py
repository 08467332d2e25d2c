"""What the hardware tests share: tools that may be missing, the host build, couplings and links."""

from __future__ import annotations

import atexit
import functools
import importlib.util
import os
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from host_device import HOST_INSTALL, HostCore, HostLink, build_host

import avc_hardware
from avc_casadi import Problem, load_problem
from avc_casadi.coupling import Coupling
from avc_casadi.model.ends import Wall
from avc_casadi.model.gains import Gains, GainSchedule, GainTable, Status
from avc_casadi.model.runtime import Runtime, StateFeedback
from avc_casadi.simulation.emit import PRECISIONS
from avc_hardware import BoardLimits, Connection, TableImage
from avc_hardware.codegen.c_frame import NAME
from avc_hardware.codegen.pair_export import pair_files
from avc_hardware.link.faults import Refusal
from avc_hardware.link.session import RefusedError

# The bench's gains are drawn at random: no hand could hold them, and none is there.
push = functools.partial(avc_hardware.push, unsafe=True)
stream = functools.partial(avc_hardware.stream, unsafe=True)


@functools.cache
def _exported(coupling: Coupling | Problem, precision: str, name: str) -> dict[str, str]:
    if isinstance(coupling, Problem) or isinstance(coupling.end, Wall):
        return avc_hardware.export_c(coupling, precision=precision, name=name, unsafe=True)
    assert name == NAME
    return pair_files(coupling, PRECISIONS[precision], "not judged: gains of a bench")


def export_c(coupling: Coupling | Problem, *, precision: str = "single", name: str = NAME) -> dict[str, str]:
    """Return the exported C of a coupling or a law, made once; that to another end without a verdict, which is slow."""
    return dict(_exported(coupling, precision, name))


INSTALL = {
    "gcc": HOST_INSTALL,
    "g++": "apt-get install -y --no-install-recommends g++",
    "clang": "apt-get install -y --no-install-recommends clang",
    "clang++": "apt-get install -y --no-install-recommends clang",
    "arm-none-eabi-gcc": "apt-get install -y --no-install-recommends gcc-arm-none-eabi",
    "avr-gcc": "apt-get install -y --no-install-recommends gcc-avr avr-libc",
    "simavr": "apt-get install -y --no-install-recommends simavr",
    "riscv64-unknown-elf-gcc": "apt-get install -y --no-install-recommends gcc-riscv64-unknown-elf",
    "qemu-system-riscv64": "apt-get install -y --no-install-recommends qemu-system-misc",
    "qemu-system-arm": "apt-get install -y --no-install-recommends qemu-system-arm",
    "unicorn": "pip install 'avc-casadi[emulator]'",
}


def require(*tools: str) -> None:
    """Skip where a tool is missing, with the line that installs it; with HIL_REQUIRE=all fail instead."""
    for tool in tools:
        there = importlib.util.find_spec(tool) if tool == "unicorn" else shutil.which(tool)
        if not there:
            reason = f"{tool} is not installed: {INSTALL[tool]}"
            if os.environ.get("HIL_REQUIRE") == "all":
                pytest.fail(reason)
            pytest.skip(reason)


def run(tool: str, *arguments: str, given: bytes = b"", errors: bool = False) -> bytes:
    """Run a program to its end and return what it printed (or wrote as errors); it must succeed."""
    program = shutil.which(tool)
    assert program is not None
    done = subprocess.run([program, *arguments], input=given, capture_output=True, check=False)  # noqa: S603 - ours
    assert done.returncode == 0, done.stderr.decode()
    return done.stderr if errors else done.stdout


@functools.cache
def scratch() -> Path:
    folder = Path(tempfile.mkdtemp(prefix="avc-hardware-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


@functools.cache
def host_library() -> Path:
    require("gcc")
    return build_host(scratch())


def believer(seed: int) -> StateFeedback:
    """A mass on a drag under the force that was asked for, with or without lag, the push of a hand for a state."""
    rng = np.random.default_rng(seed)
    kept, gained, drag = rng.uniform(0.9, 1.0), float(rng.uniform(-8e-6, -2e-6)), float(rng.uniform(0.95, 1.0))
    innovation, feedback = (0.4, 0.08, 0.003), (1.0, float(rng.uniform(0.5, 4.0)), 0.2)
    state = ((1.0, 1.0, 0.5), (0.0, drag, 1.0), (0.0, 0.0, kept))
    asked, places = (gained / 2, gained, 0.0), (0,)
    if seed % 2:  # a handle that follows, in place of the position first
        state = (*((*row, 0.0) for row in state), (0.7, 0.0, 0.0, 0.3))
        asked, innovation, feedback, places = (*asked, 0.0), (*innovation, 0.1), (0.6, *feedback[1:], 0.4), (0, 3)
    rows = {"state": state, "force_m_per_n": asked, "innovation": innovation, "feedback": feedback}
    zones = {"dead_zone_m": 1.5e-5 * (seed % 3), "face_m": 1e-5 * (seed % 3)}
    if seed % 4:  # it opens in motion
        zones |= {
            "opens_m": 1e-5 * (seed % 4),
            "open_m": 7e-5 * (seed % 4),
            "kept": 0.98,
            "smoothing": 0.3 * (seed % 4),
        }
    return StateFeedback.model_validate(rows | zones | {"positions": places})


def dense_believer(states: int, seed: int = 0) -> StateFeedback:
    """Any number of states that all turn into each other and die out; no number of several states is 0 or 1."""
    rng = np.random.default_rng([states, seed])
    turning, _ = np.linalg.qr(rng.normal(size=(states, states)))
    feedback = rng.uniform(-0.5, 0.5, states)
    feedback[-1] = 1.1 if states > 1 else 1.0
    return StateFeedback(
        state=tuple(map(tuple, (0.97 * turning).tolist())),
        force_m_per_n=tuple(rng.uniform(-8e-6, 8e-6, states).tolist()),
        innovation=tuple(rng.uniform(0.1, 0.4, states).tolist()),
        feedback=tuple(feedback.tolist()),
        positions=(*range(0, states - 1, 2), states - 1),
        measures=states - 1,
        dead_zone_m=float(rng.uniform(0, 1e-5)),
        face_m=float(rng.uniform(0, 1e-5)),
        opens_m=float(rng.uniform(0, 1e-5)),
        open_m=float(rng.uniform(2e-5, 1e-4)),
        kept=float(rng.uniform(0.9, 1.0)),
        smoothing=float(rng.uniform(0.0, 0.95)),
    )


def unwatched(*values: float, **options: float) -> BoardLimits:
    """Limits of a board that takes any motion for plausible: tests move as no device can."""
    return BoardLimits(*values, **options).unwatched


def host_core(**options: Any) -> HostCore:
    return HostCore(host_library(), unwatched(), **options)


def schedule(
    rows: int = 40,
    *,
    seed: int = 0,
    unusable: int = 0,
    sample_time_s: float = 1e-3,
    largest: tuple[float, float, float] = (1e4, 1e7, 1e3),
    even: bool = True,
) -> GainSchedule:
    """Random gains over 1 to 450 Hz, evenly in the logarithm or crowded below; the first ``unusable`` have none."""
    rng = np.random.default_rng(seed)
    frequency = np.geomspace(1.0, 450.0, rows) if rows > 1 else np.array([10.0])
    if not even:
        frequency = 450.0 ** np.linspace(0.0, 1.0, rows) ** 3
    b, k, b_p = (most * rng.uniform(0, 1, rows) for most in largest)
    for column in (b, k, b_p):
        column[:unusable] = np.nan
    nothing = np.zeros(rows)
    return GainSchedule(
        problem="bench",
        method="random",
        solver=None,
        structure="damped",
        model="sampled-data",
        sample_time_s=sample_time_s,
        frequency_hz=frequency,
        damping_ns_per_m=b,
        stiffness_n_per_m=k,
        contact_damping_ns_per_m=b_p,
        impedance=nothing * 1j,
        target=nothing * 1j,
        status=(Status.INFEASIBLE,) * unusable + (Status.SOLVED,) * (rows - unusable),
        reason=("",) * rows,
        requested_damping_ns_per_m=b,
        requested_stiffness_n_per_m=k,
        requested_contact_damping_ns_per_m=b_p,
    )


def bench_problem(wall: tuple[float, float] = (10.0, 1e5), **device: float | None) -> Problem:
    """The wall of figure 5, or another, and its device, with other keys where given."""
    return load_problem("damped").changed(
        device=device,
        environment={"damping_ns_per_m": wall[0], "stiffness_n_per_m": wall[1]},
        boundaries={
            "upper": {"damping_ns_per_m": wall[0], "stiffness_n_per_m": wall[1]},
            "lower": {"damping_ns_per_m": wall[0], "stiffness_n_per_m": wall[1]},
        },
        frequency={"stop_hz": 100.0},
    )


def coupling(
    rows: int = 40,
    *,
    seed: int = 0,
    unusable: int = 0,
    largest: tuple[float, float, float] = (1e4, 1e7, 1e3),
    wall: tuple[float, float] = (10.0, 1e5),
    runtime: Runtime | None = None,
    contact: str = "gated",
    even: bool = True,
    **device: float | None,
) -> Coupling:
    """A coupling of random gains, every row of `schedule`, for the bench's wall and device."""
    problem = bench_problem(wall, **device).changed(coupling={"contact": contact})
    sample_time_s = problem.device.sample_time_s
    gains = schedule(rows, seed=seed, unusable=unusable, sample_time_s=sample_time_s, largest=largest, even=even)
    return Coupling(problem, gains, GainTable.of(gains), runtime or Runtime())


def with_gains(problem: Problem, b: float, k: float, b_p: float = 0.0) -> Coupling:
    """A coupling of constant gains."""
    return Coupling.constant(problem, Gains(b, k, b_p), "by hand")


def image(*arguments: Any, **options: Any) -> TableImage:
    return TableImage.of(coupling(*arguments, **options))


def refused(table: TableImage) -> Refusal:
    """Send a table past the host's own checks; return the device's refusal, and that it holds no table."""
    core = host_core()
    connection = Connection(HostLink(core))
    with pytest.raises(RefusedError) as caught:
        connection.run(connection.session.push(table, connection.device))
    assert core.image() is None
    return caught.value.refusal
