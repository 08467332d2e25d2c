"""Figures of the exported C and of the emulated board: fuzzing, bits, compilers, encoders.

python tests/benchmarks/hardware_figures.py [MILLIONS OF FUZZED STEPS [OUT]]

Overwrites results/hardware.json, a cell at a time; what is there already of the same package is kept. gcc, g++, clang,
clang++ and arm-none-eabi-gcc are needed, and the extra emulator.
"""

from __future__ import annotations

import dataclasses
import math
import re
import shlex
import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "oracle"))

from exported import C99, CLANG, CLANG_CPP17, CPP11, WARNINGS, Exported
from exported_cases import drawn, motions, notched
from exported_teleoperator import teleoperator_coupling
from exported_tool import tool_coupling
from hardware_bench import believer, bench_problem, coupling, dense_believer, export_c, with_gains
from reference_coupling import ReferenceCoupling
from script_arguments import script_arguments
from studied import about, computed

import avc_casadi as avc
import avc_hardware
from avc_casadi import UnsupportedError
from avc_casadi.coupling import Coupling
from avc_casadi.model.runtime import Runtime
from avc_hardware import tried_in_the_loop

HERE = Path(__file__).resolve().parent
OUT = HERE / "results" / "hardware.json"
FUZZ = HERE.parent / "oracle" / "exported_fuzz.c"
CLANG_CPP11 = ("clang++", "-std=c++11", "-x", "c++")
ARM = ("arm-none-eabi-gcc", "-std=c99", "-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16")
STEP = 2e-5


def laws() -> dict[str, Coupling]:
    """A wall with what may stand beside its gains, a table, detents."""
    problem = bench_problem((5.0, 5e3), encoder_resolution_m=STEP, max_force_n=8.0)
    plain = with_gains(problem, 5.0, 4e3, 3.0)
    runtimes = {
        "gains": Runtime(),
        "observer": Runtime(observer_mass_kg=0.25),
        "state feedback": Runtime(state_feedback=believer(3)),
        "guard": Runtime(guard="passivity-controller"),
    }
    found = {name: dataclasses.replace(plain, runtime=runtime) for name, runtime in runtimes.items()}
    found["table"] = coupling(60, largest=(10.0, 4e3, 3.0), wall=(5.0, 5e3), encoder_resolution_m=STEP, max_force_n=8.0)
    return found | {"detents": notched(7)}


def fuzzed(made: Coupling, steps: int) -> dict[str, Any]:
    """Run the exported C under sanitizers; an error where it reports, or a force is wrong."""
    device = made.problem.device
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for file, text in export_c(made).items():
            (folder / file).write_text(text, encoding="ascii")
        build = ["clang", "-std=c99", "-O1", "-g", "-fsanitize=address,undefined,float-divide-by-zero"]
        build += ["-fno-sanitize-recover=all", f"-I{folder}", str(folder / "avc_coupling.c"), str(FUZZ)]
        told(*build, "-lm", "-o", str(folder / "fuzz"))
        limit, wall = made.max_force_n or 1e30, int(made.problem.detent is None)
        found = told(str(folder / "fuzz"), str(steps), "1", repr(limit), repr(device.metres_per_unit), str(wall))
    outside, pushed = map(int, found.split())
    return {"steps": steps, "steps_at_rest_outside": outside, "steps_with_force": pushed, "reports": 0}


def told(*command: str) -> str:
    """What a program prints; an error with what it says where it fails."""
    done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603
    if done.returncode:
        raise RuntimeError(f"{command[0]}: {done.stdout}{done.stderr}"[:600])
    return done.stdout + done.stderr


def tests_passed(*files: str) -> dict[str, Any]:
    """Run files of tests, the slow ones too."""
    command = ["-m", "pytest", "-q", "-n", "0", "-m", "", *(f"tests/hardware/{one}" for one in files)]
    done = subprocess.run(  # noqa: S603
        [sys.executable, *command], capture_output=True, text=True, check=False, cwd=HERE.parents[1]
    )
    return {"command": shlex.join(["python", *command]), "result": done.stdout.strip().splitlines()[-1]}


def of_order(states: int, seed: int) -> Coupling:
    """A law behind an observer of so many states, on a device without delay."""
    problem = bench_problem((5.0, 5e3), encoder_resolution_m=STEP, max_force_n=8.0, delay_samples=0)
    problem = problem.changed(scene={"duration_s": 1.0})
    runtime = Runtime(state_feedback=dense_believer(states, seed))
    return dataclasses.replace(with_gains(problem, 5.0 * seed, 4e3, 3.0), runtime=runtime)


def as_the_scene(states: int, seed: int) -> dict[str, Any]:
    """Compare the C with the expressions in single precision, and at the positions of a scene with its forces."""
    made = of_order(states, seed)
    ways = motions(made)
    devices = ReferenceCoupling(made, len(ways))
    expected = np.stack([devices.step(column) for column in ways.T], axis=1)
    differ, scene = {}, avc.simulate(made.problem, made)
    seen = STEP * np.floor(scene.position_m / STEP + 0.5)
    for compiler in (C99, CPP11, CLANG, CLANG_CPP11):
        device, double = (Exported(made, compiler=compiler, precision=one) for one in ("single", "double"))
        got = []
        for way in ways:
            device.start()
            got.append(device.forces(way))
        same = double.forces(seen).astype(np.float32) == np.asarray(scene.force_n, dtype=np.float32)
        differ[" ".join(compiler[:2])] = [int((np.array(got) != expected).sum()), int((~same).sum())]
    return {"samples": [expected.size, seen.size], "with_force": int((expected > 0).sum()), "differ": differ}


def exports() -> dict[str, Coupling]:
    """Couplings to every end."""
    keys = "tool_mass_kg = 0.2\nstep_s = 0.002\n"
    found = {f"wall {seed}": drawn(seed) for seed in (0, 2, 5, 16, 21)} | {"detents": notched(7)}
    for exchange in ("on-time", "late", "ahead", "held-force"):
        found[f"tool {exchange}"] = tool_coupling(f'{keys}exchange = "{exchange}"', 500.0, 5.0, 1.0)
    for integrator in ("implicit", "implicit-damping"):
        found[f"tool {integrator}"] = tool_coupling(f'{keys}integrator = "{integrator}"', 500.0, 5.0, 1.0)
    follower = "mass_kg = 0.3\ndamping_ns_per_m = 1.0\ndelay_samples = 1\ndelay_s = 0.005\n"
    found["follower"] = teleoperator_coupling(follower, 800.0, 6.0, 2.0)
    measured = 'architecture = "position-force"\nforce = "measured"\n'
    return found | {"follower, force": teleoperator_coupling(follower + measured, 400.0, 6.0, 4.0)}


def compiled() -> dict[str, Any]:
    """Compile every export with every compiler, each warning an error, and link three of them into one program."""
    builds = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for made in exports().values():
            for precision in ("single", "double"):
                for file, text in export_c(made, precision=precision).items():
                    (folder / file).write_text(text, encoding="ascii")
                for compiler in (C99, CPP11, CLANG, CLANG_CPP11, CLANG_CPP17, ARM):
                    told(*compiler, "-O2", *WARNINGS, "-c", str(folder / "avc_coupling.c"), "-o", str(folder / "one.o"))
                    builds += 1
        names = {"soft": "wall 0", "pen": "tool on-time", "arm": "follower"}
        for short, which in names.items():
            for file, text in avc_hardware.export_c(exports()[which], name=short, unsafe=True).items():
                (folder / file).write_text(text, encoding="ascii")
        main = "".join(f'#include "{short}.h"\n' for short in names)
        main += (
            "int main(void) { soft_t a; pen_t b; arm_t c; soft_start(&a); pen_init(&b); arm_init(&c, &ARM_LEADER);\n"
        )
        main += "return soft_step(&a, 0) != 0 || pen_step(&b, 0, 0, 0) != 0 || arm_step(&c, 0, 0) != 0; }\n"
        (folder / "main.c").write_text(main, encoding="ascii")
        for compiler in (C99, CPP11, CLANG, CLANG_CPP11):
            sources = [str(folder / f"{one}.c") for one in ("main", *names)]
            told(*compiler, *WARNINGS, *sources, "-o", str(folder / "together"))
            told(str(folder / "together"))
    return {"couplings": len(exports()), "builds": builds, "warnings": 0, "three_in_one_program": sorted(names)}


def wheel(counts: int, time_s: float) -> Coupling:
    """A wheel base with an encoder of so many counts, and a wall that it holds at that rate."""
    stiffness = min(20.0, 0.05 / time_s)
    problem = avc.parse_problem(
        f'[device]\nmotion = "rotary"\nhandle_radius_m = 0.15\ninertia_kgm2 = 0.03\ndamping_nms_per_rad = 0.2\n'
        f"sample_time_s = {time_s}\nmax_torque_nm = 8.0\nencoder_resolution_rad = {2 * math.pi / counts!r}\n"
        f"[environment]\nstiffness_nm_per_rad = {stiffness}\ndamping_nms_per_rad = 0.0\n"
    )
    return with_gains(problem, 0.02, 4 * stiffness)


def on_the_board(counts: int, time_s: float) -> dict[str, Any]:
    """Push a wheel's coupling into the emulated board, and press with the middle hand; or its C where it is refused."""
    made = wheel(counts, time_s)
    try:
        found = tried_in_the_loop(made)
    except UnsupportedError as error:
        lasts = round(4.0 / time_s)
        depth = np.minimum(0.1 * time_s * np.arange(lasts) - 0.05, 0.1)
        step = 2 * math.pi / counts
        forces = Exported(made).forces(step * np.round(depth / step))
        silent = int((forces[depth > step + 0.1 * time_s] == 0).sum())
        return {"board": f"refused: {str(error).partition(';')[0]}", "exported_c": {"samples": lasts, "silent": silent}}
    document = found.document()
    keys = ("at_rest", "peak_force_n", "faults", "mode")
    return {key: document[key] for key in keys}


def run_of_figure5() -> dict[str, Any]:
    """`avc run figure5`, whose last step is the emulated board."""
    with tempfile.TemporaryDirectory() as folder:
        text = told(sys.executable, "-m", "avc_casadi", "run", "figure5", "--out", folder)
    told_of = re.search(r"\n  . Device {4,}(.*?)\n  . \S", text, re.DOTALL)
    return {"command": "avc run figure5", "device": " ".join(told_of[1].split()) if told_of else "not told"}


def main() -> int:
    """Compute what results/hardware.json does not hold yet."""
    arguments = script_arguments(__doc__, people=20, out=OUT)
    millions = arguments.people
    each = math.ceil(millions * 1_000_000 / len(laws()))
    cells: dict[str, Any] = {"compilers": compiled}
    cells |= {f"fuzz: {name}": partial(fuzzed, made, each) for name, made in laws().items()}
    cells |= {f"order {n}, law {seed}": partial(as_the_scene, n, seed) for n in range(2, 7) for seed in (1, 2)}
    grid = [(2**power, time) for time in (2.5e-4, 1e-3, 3.3e-3, 8e-3, 16e-3) for power in (10, 14, 17, 20, 22, 24)]
    cells |= {f"{n} counts, {1e3 * time:g} ms": partial(on_the_board, n, time) for n, time in grid}
    cells["avc run figure5"] = run_of_figure5
    tests = ("test_tick.py", "test_state_feedback.py", "test_export.py")
    cells["C, numpy and the emulated board, bit for bit"] = partial(tests_passed, *tests)
    safe = ("test_takeover.py", "test_telemetry.py", "test_faults.py", "test_session.py")
    cells["takeover, heartbeat, faults of the device"] = partial(tests_passed, *safe)
    computed(cells, arguments.out, about(f"python tests/benchmarks/hardware_figures.py {millions}", 1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
