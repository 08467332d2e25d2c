"""How stiff walls the reference devices hold, in a simulation that shares no code with the project.

python tests/benchmarks/robust_goals.py [PEOPLE] [OUT]

For each reference device three couplings are recommended: one that leans on the declared dry friction, one that does
not, and one for a wall that is far beyond the device.
Their exported C drives `tests/whole_device.c` with fresh hands, corners of [hands] among them, in a press, taps and a
hard strike, with and without friction; then with devices that are not quite as declared: 10 % of mass and resonance, a
quarter of a sample of delay. Overwrites OUT (default tests/benchmarks/results/robust_goals.json) after every row.
"""

from __future__ import annotations

import itertools
import json
import sys
import time
from pathlib import Path

import numpy as np
from script_arguments import script_arguments
from studied import about

sys.path.insert(0, str(Path(__file__).parent.parent))
from whole_device import REST, WholeDevice, held, people, tapping

import avc_casadi as avc
import avc_hardware

RESULTS = Path(__file__).parent / "results" / "robust_goals.json"
# Wall that leans on friction, and wall that does not, N/m.
GOALS = {"reference-r1": (10e3, 6e3), "reference-r2": (7e3, 4e3), "reference-r3": (5e3, 2e3)}
FAR_N_PER_M = 100e3
MOTIONS = {"press": lambda hand: held(hand, 0.07), "tap": tapping, "strike": lambda hand: held(hand, 0.3)}
SEED = 4242


def other_devices(device):
    for mass, mode, late in itertools.product((0.9, 1.1), (0.9, 1.1), (0.0, 0.25)):
        yield {
            "mass": device.mass_kg * mass,
            "resonance": device.resonance.frequency_hz * mode,
            "delay": device.delay_samples + late,
        }


def rested(bench, hands, **changed):
    """Share at rest in all motions, and what a press felt like at motor and handle (median)."""
    calm, motor, handle = np.ones(len(hands), bool), [], []
    for name, motion in MOTIONS.items():
        found = [bench.meets(motion(hand), **changed) for hand in hands]
        calm &= np.array([max(one.motor_speed, one.handle_speed) < REST for one in found])
        if name == "press":
            free = [one for one in found if one.force < 0.97 * (bench.device.max_force_n or np.inf)]
            motor = [one.force / one.motor for one in free]
            handle = [one.force / one.handle for one in free]
    return float(calm.mean()), float(np.median(motor)), float(np.median(handle))


def measured(name, wall, lean, count):
    problem = avc.load_problem(name).changed(environment={"stiffness_n_per_m": wall, "damping_ns_per_m": 0.0})
    began = time.process_time()
    found = avc.recommend(problem, lean_on_friction=lean)
    seconds = time.process_time() - began
    bench = WholeDevice(problem.device, avc_hardware.export_c(found.coupling))
    hands = people(problem.hands, count - 8, SEED)
    row = {"device": name, "wall_n_per_m": wall, "leans_on_friction": lean, "hands": count, "seconds_cpu": seconds}
    row |= {
        "method": found.coupling.method,
        "claimed_n_per_m": found.felt()["stiffness_n_per_m"],
        "reason": found.reason,
    }
    for key, friction in (("friction", {}), ("no_friction", {"friction": 0.0})):
        share, motor, handle = rested(bench, hands, **friction)
        worst = min(rested(bench, hands, **friction, **other)[0] for other in other_devices(problem.device))
        row[key] = {"at_rest": share, "felt_motor": motor, "felt_handle": handle, "at_rest_worst_of_8_devices": worst}
    return row


def main():
    arguments = script_arguments(__doc__, people=200, out=RESULTS)
    made = about("python tests/benchmarks/robust_goals.py", SEED)
    rows = []
    for name, walls in GOALS.items():
        for wall, lean in zip((*walls, FAR_N_PER_M), (True, False, False), strict=True):
            rows.append(measured(name, wall, lean, arguments.people))
            print(json.dumps(rows[-1]), flush=True)
            arguments.out.write_text(json.dumps({"about": made, "rows": rows}, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
