"""Recommended admittance laws as exported C, in a plant of other code: do hands and contacts rest, and after faults?

OPENBLAS_NUM_THREADS=1 nice -n 10 python tests/benchmarks/admittance_hands.py --recommended 30

Overwrites results/admittance_hands.json and RESULTS_admittance_hands.md after every device and goes on where it
stopped; about a minute of processor time each. The plant is tests/oracle/admittance_handles.py, which shares no matrix
with the package. gcc compiles the C.
"""

from __future__ import annotations

import argparse
import ctypes
import math
import re
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from admittance import SEED, drawn
from studied import HERE, about, computed, made_by, table

sys.path.insert(0, str(HERE.parent / "oracle"))

from admittance_handles import DRIVE, DRIVE_SPEED, HANDLE, HANDLE_SPEED, PushedHandles

from avc_casadi.model.admittance import AdmittanceProblem
from avc_casadi.recommendation.admittance import recommend_admittance
from avc_casadi.simulation.population.admittance_trial import try_admittance
from avc_hardware import admittance_files

OUT = Path(__file__).parent / "results" / "admittance_hands.json"
PAGE = Path(__file__).parent / "RESULTS_admittance_hands.md"
HANDS = 100
"""Hands, each with a contact, on each device."""
TRIED = 20
"""Hands of `avc trial` on each device."""
REST_M_PER_S = 5e-3
"""Speed of handle and drive below which a hand is at rest, in the last half second."""
MOTION_S, REST_S, FAULT_S = 4.0, 8.0, 8.0
"""Times of the hands' motions, of keeping still, and from the fault of the sensor to the end."""
DEEP_M, BACK_M = 0.02, 0.01
"""How far hands aim beyond the surface, and back from it."""
FAULTS = ("jump", "agreeing", "stuck", "not finite", "saturated", "jumping")
FAULTY_SAMPLES = 60
"""Samples of a fault that lasts."""
NOISE_PEAK = 6.0
"""Noise that a reading may have, in rms, as the exported C allows it."""

DRIVER = """
#include "avc_coupling.h"
static avc_coupling_t all[COUNT];
void start_all(void) { for (int i = 0; i < COUNT; i++) avc_coupling_start(&all[i]); }
void step_all(const double *position_m, const double *force_n, double *velocity)
{
    for (int i = 0; i < COUNT; i++)
        velocity[i] = avc_coupling_step(&all[i], (avc_coupling_real_t)position_m[i], (avc_coupling_real_t)force_n[i]);
}
"""


class ExportedLaw:
    """The exported C of a law, compiled, for all hands at once."""

    def __init__(self, problem: AdmittanceProblem) -> None:
        files = admittance_files(problem, precision="single")
        self.header = " ".join(files["avc_coupling.h"].replace(" * ", " ").split())
        folder = Path(tempfile.mkdtemp())
        for name, text in files.items() | {("driver.c", DRIVER)}:
            (folder / name).write_text(text, encoding="ascii")
        sources = [str(folder / "avc_coupling.c"), str(folder / "driver.c")]
        options = ["-std=c99", "-O2", "-fPIC", "-shared", f"-DCOUNT={HANDS}", "-o", str(folder / "law.so")]
        subprocess.run(["gcc", *options, *sources], check=True)  # noqa: S603, S607
        self._library = ctypes.CDLL(str(folder / "law.so"))
        self._library.start_all()

    def step(self, position_m: Any, force_n: Any) -> Any:
        """Return the velocities that are commanded."""
        velocity = np.zeros(HANDS)
        pointers = (np.ascontiguousarray(values).ctypes.data for values in (position_m, force_n, velocity))
        self._library.step_all(*map(ctypes.c_void_p, pointers))
        return velocity

    def number(self, pattern: str) -> float:
        """Return a number of the header; 0 where it does not say it."""
        found = re.search(pattern, self.header)
        return float(found[1]) if found else 0.0


def with_sensor(problem: AdmittanceProblem, index: int) -> AdmittanceProblem:
    """Return a drawn device with what the export needs: ranges, noise and steps of the sensor, a largest speed."""
    random = np.random.default_rng([SEED, index, 2])
    full = float(np.exp(random.uniform(np.log(150.0), np.log(1000.0))))
    noise = full * float(np.exp(random.uniform(np.log(1e-4), np.log(5e-4))))
    sensor = {"max_force_n": full, "noise_rms_n": noise, "resolution_n": noise * random.uniform(0.1, 1.0)}
    return problem.changed(device={"max_speed_m_per_s": random.uniform(0.3, 1.0), "force_sensor": sensor})


def targets(time_s: float) -> Any:
    """Return where the hands aim: every fourth guides, pushes, pushes and lets go, or taps."""
    kinds = np.arange(HANDS) % 4
    guided = DEEP_M * math.sin(2 * math.pi * time_s) if time_s < 3.0 else 0.0
    pushed = DEEP_M * min(time_s / 0.3, 1.0)
    taps = -BACK_M + (DEEP_M + BACK_M) * (0.5 - 0.5 * math.cos(2 * math.pi * min(time_s, 3.5)))
    return np.choose(kinds, [guided, pushed, pushed, taps])


@dataclass
class Bench:
    """The exported law around hands and contacts, sample by sample."""

    problem: AdmittanceProblem
    law: ExportedLaw
    plant: PushedHandles
    random: np.random.Generator

    def sample(self, target: Any, later: Any, fault: Any = None) -> Any:
        """Advance by a sample; a fault replaces readings that it names. Return the commanded velocities."""
        sensor, period = self.problem.device.force_sensor, self.problem.device.sample_time_s
        noisy = self.plant.force() + sensor.noise_rms_n * self.random.standard_normal(HANDS)
        step_n = sensor.resolution_n
        stepped = step_n * np.round(noisy / step_n) if step_n else noisy
        reading = np.clip(stepped, -sensor.max_force_n, sensor.max_force_n)
        reading = reading if fault is None else np.where(np.isnan(fault[0]), reading, fault[1])
        velocity = self.law.step(self.plant.state[:, DRIVE], reading)
        self.plant.move(velocity, target, (later - target) / period)
        return velocity

    @property
    def speed(self) -> Any:
        """The larger speed of drive and handle."""
        return np.abs(self.plant.state[:, [DRIVE_SPEED, HANDLE_SPEED]]).max(axis=1)


def readings(problem: AdmittanceProblem, random: np.random.Generator) -> tuple[Any, Any, Any]:
    """Return the faulty readings of all hands, (samples, hands), nan where the reading is not faulty, and their kinds.

    What is read stands beside them, since a reading that is no number is a fault too.
    """
    full = problem.device.force_sensor.max_force_n
    kinds = np.arange(HANDS) % len(FAULTS)
    faulty = np.full((FAULTY_SAMPLES, HANDS), np.nan)
    for hand, kind in enumerate(kinds):
        size = full * random.uniform(0.1, 0.999) * random.choice([-1.0, 1.0])
        count = {"jump": 1, "agreeing": int(random.integers(2, 11))}.get(FAULTS[kind], FAULTY_SAMPLES)
        faulty[:count, hand] = {
            "saturated": math.copysign(full, size),
            "jumping": size * (-1.0) ** np.arange(count),
            # Agreeing readings differ by less than what counts as the same, so that they do not look stuck.
            "agreeing": size * (1 + 1e-5 * np.arange(count)),
        }.get(FAULTS[kind], size)
    read = np.where(kinds == FAULTS.index("not finite"), random.choice([np.nan, np.inf, -np.inf], HANDS), faulty)
    return faulty, read, kinds


def allowed_m(law: ExportedLaw, faulty: Any, kinds: Any, problem: AdmittanceProblem) -> Any:
    """Return how far the header says that each fault may move a device at rest, with hands that push back."""
    push = law.number(r"The device moves by ([\d.e+-]+) m for each")
    stop = law.number(r"the device moves by ([\d.e+-]+) m more")
    jump = law.number(r"within ([\d.e+-]+) N of the last")
    per_n = law.number(r"it moves at ([\d.e+-]+) m/s for each N")
    seen = int(law.number(r"detected after (\d+) equal readings"))
    size, count = np.nanmax(np.abs(faulty), axis=0), (~np.isnan(faulty)).sum(axis=0)
    period = problem.device.sample_time_s
    # A stuck reading moves the device until it is seen, and while the velocity falls to 0, within 0.05 s.
    stuck = per_n * size * (min(seen, FAULTY_SAMPLES) * period + 0.05 if seen else FAULTY_SAMPLES * period)
    # Each reading that is believed moves by its share of the largest one.
    believed = push * count * size / problem.device.force_sensor.max_force_n + stop
    # An error that is smaller than a jump is believed at once; noise may bring one near it so close.
    noise_n = NOISE_PEAK * problem.device.force_sensor.noise_rms_n + problem.device.force_sensor.resolution_n
    small = (size < jump + noise_n) & np.isin(kinds, [FAULTS.index(name) for name in ("jump", "jumping")])
    of_kind = [kinds == FAULTS.index("agreeing"), kinds == FAULTS.index("stuck"), small]
    return np.select(of_kind, [believed, np.maximum(stuck, believed), believed], 0.0)


def with_hands(problem: AdmittanceProblem, index: int) -> dict[str, Any]:
    """Simulate hands and contacts of the ranges around the exported law, then faults of the sensor."""
    random = np.random.default_rng([SEED, index, 3])
    hands, contact = problem.hands, problem.contact
    ends = (hands.mass_kg, hands.damping_ns_per_m, hands.stiffness_n_per_m)
    carried = np.column_stack([random.uniform(*interval, HANDS) for interval in ends])
    contacts = (contact.damping_ns_per_m, contact.stiffness_n_per_m)
    touched = np.column_stack([random.uniform(*interval, HANDS) for interval in contacts])
    bench = Bench(problem, ExportedLaw(problem), PushedHandles(problem, carried, touched), random)
    period = problem.device.sample_time_s
    samples, release = round((MOTION_S + REST_S) / period), round(3.0 / period)
    last, wobble, deepest = np.zeros(HANDS), np.zeros(HANDS), np.zeros(HANDS)
    window, before = round(0.5 / period), np.zeros(HANDS)
    for sample in range(samples):
        if sample == release:
            bench.plant.held[np.arange(HANDS) % 4 == 2] = False
        if sample == samples - window:
            before = bench.plant.state[:, DRIVE].copy()
        bench.sample(targets(sample * period), targets((sample + 1) * period))
        deepest = np.maximum(deepest, bench.plant.state[:, HANDLE])
        if sample >= samples - window:
            last = np.maximum(last, bench.speed)
            wobble = np.maximum(wobble, np.abs(bench.plant.state[:, DRIVE] - before))
    settled = last < REST_M_PER_S
    return {"at_rest": int(settled.sum()), "touch": int((deepest > 1e-6).sum())} | faults(bench, settled, wobble)


def faults(bench: Bench, settled: Any, wobble: Any) -> dict[str, Any]:
    """Let the sensor of every hand at rest fail, and return how many move farther than the header says, by kind."""
    problem, period = bench.problem, bench.problem.device.sample_time_s
    faulty, read, kinds = readings(problem, bench.random)
    allowed = allowed_m(bench.law, faulty, kinds, problem)
    start, still = bench.plant.state[:, DRIVE].copy(), targets(MOTION_S + REST_S)
    spring = problem.law is not None and problem.law.admittance.stiffness_n_per_m > 0
    # By its spring a device also returns to its rest position. What noise and creeping move counts as no fault.
    allowed = allowed + (np.abs(start) if spring else 0.0)
    commanded, last, fastest = np.zeros(HANDS), np.zeros(HANDS), 0.0
    farthest = np.zeros(HANDS)
    samples, window = round(FAULT_S / period), round(0.5 / period)
    for sample in range(samples):
        fault = (faulty[sample], np.broadcast_to(read, faulty.shape)[sample]) if sample < FAULTY_SAMPLES else None
        velocity = bench.sample(still, still, fault)
        fastest = max(fastest, float(np.abs(velocity).max()))
        if sample < FAULTY_SAMPLES + round(0.1 / period):
            commanded += period * velocity
            farthest = np.maximum(farthest, np.abs(commanded))
        if sample >= samples - window:
            last = np.maximum(last, bench.speed)
    noise = 3 * wobble + 6 * period * REST_M_PER_S
    beyond = settled & (farthest > allowed * (1 + 1e-3) + noise)
    again = settled & (last < REST_M_PER_S)
    return {
        "faults": {
            name: [int((settled & (kinds == kind)).sum()), int((beyond & (kinds == kind)).sum())]
            for kind, name in enumerate(FAULTS)
        },
        "farthest": [[FAULTS[kinds[row]], float(farthest[row]), float(allowed[row])] for row in np.flatnonzero(beyond)],
        "share": max(
            (float(farthest[row] / allowed[row]) for row in np.flatnonzero(settled & (allowed > noise))), default=0.0
        ),
        "at_rest_again": int(again.sum()),
        "too_fast": fastest > (problem.device.max_speed_m_per_s or math.inf) * (1 + 1e-6),
    }


def cell(index: int) -> dict[str, Any]:
    """Recommend a law for a device, export it, and let hands push it."""
    found = recommend_admittance(with_sensor(drawn(index), index))
    if not found.passed:
        return {"recommended": False}
    assert found.certificate is not None
    tried = try_admittance(found.problem, TRIED)
    return {
        "recommended": True,
        "disk": found.certificate.disk_margin,
        "noise": found.certificate.noise_m_per_s,
        "drift": found.certificate.drift_m_per_s,
        "tried": tried.at_rest,
        **with_hands(found.problem, index),
    }


TEXT = """# Recommended admittance laws with hands, contacts and failing sensors

{made_by}

`avc recommend` gives {devices} devices a law, of {drawn} drawn as in [RESULTS_admittance](RESULTS_admittance.md).
Each law is exported as C and compiled by gcc. It runs around a [plant of other code](../oracle/admittance_handles.py)
with {hands} hands of the ranges on each device. Every hand has a contact of the range, which pushes and never pulls.
Hands guide, push, push and let go, or tap, a fourth each. The sensor has noise and steps. By its certificate noise and
steps move no recommended law at 5 mm/s: 4 rms of noise in closed loop are at most {noise} of it, one step {drift}.

- {at_rest} of {all} hands are at rest at the end: handle and drive below 5 mm/s in the last half second.
- {touch} handles have touched their contact.
- `avc trial` of the same laws, with hands of its own: {tried} of {all_tried} at rest.

Then the sensor of each hand at rest fails, and {again} of {at_rest} hands are at rest again afterwards. The commanded
motion is compared with what the header of the C allows, with hands that push back, and {slack} times what noise moves
in half a second. The largest speed was exceeded on {too_fast} devices. A fault moved a device by up to {share} of the
allowed way.

{rows}

{beyond}
"""


def share_of_rest(cells: dict[str, Any], key: str, factor: float) -> str:
    """Return the largest speed of a key of all laws, times a factor, as a share of the speed that counts as rest."""
    return f"{100 * factor * max((one[key] for one in cells.values()), default=0.0) / REST_M_PER_S:.0f} %"


def write_page(document: dict[str, Any]) -> None:
    """Write the page of results."""
    failed = [f"- {name}: {one['error']}" for name, one in document["cells"].items() if "error" in one]
    whole = {name: one for name, one in document["cells"].items() if "error" not in one}
    cells = {name: one for name, one in whole.items() if one["recommended"]}
    sums = {key: sum(one[key] for one in cells.values()) for key in ("at_rest", "touch", "tried", "at_rest_again")}
    counts = {
        kind: np.sum([one["faults"][kind] for one in cells.values()], axis=0).tolist() if cells else [0, 0]
        for kind in FAULTS
    }
    moving = [
        f"- {name}: {HANDS - one['at_rest']} hands of {HANDS} move on. By its certificate sensor noise moves it at "
        f"{1e3 * one['noise']:.2g} mm/s rms, and one step of the sensor at {1e3 * one['drift']:.2g} mm/s."
        for name, one in cells.items()
        if one["at_rest"] < HANDS
    ]
    tried = [
        f"- {name}: `avc trial` has {one['tried']} of {TRIED} hands at rest."
        for name, one in cells.items()
        if one["tried"] < TRIED
    ]
    again = [
        f"- {name}: after a fault {one['at_rest_again']} of {one['at_rest']} hands are at rest again."
        for name, one in cells.items()
        if one["at_rest_again"] < one["at_rest"]
    ]
    far = [
        f"- {name}, {kind}: {moved:.3g} m, allowed {allowed:.3g} m"
        for name, one in cells.items()
        for kind, moved, allowed in one["farthest"]
    ]
    PAGE.write_text(
        TEXT.format(
            made_by=made_by(document["about"]),
            devices=len(cells),
            drawn=len(whole),
            hands=HANDS,
            at_rest=sums["at_rest"],
            all=HANDS * len(cells),
            touch=sums["touch"],
            tried=sums["tried"],
            all_tried=TRIED * len(cells),
            again=sums["at_rest_again"],
            slack="three",
            share=f"{100 * max((one['share'] for one in cells.values()), default=0.0):.0f} %",
            too_fast=sum(one["too_fast"] for one in cells.values()),
            noise=share_of_rest(cells, "noise", 4.0),
            drift=share_of_rest(cells, "drift", 1.0),
            rows=table(("fault", "hands", "move farther than the header says"), [(k, *v) for k, v in counts.items()]),
            beyond="\n".join([*failed, *moving, *tried, *again, *far])
            or "No hand moves on, and no fault moves a device farther.",
        ),
        encoding="utf-8",
    )


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--recommended", type=int, default=30, help="devices, default 30")
    count = parser.parse_args().recommended
    command = "OPENBLAS_NUM_THREADS=1 python tests/benchmarks/admittance_hands.py --recommended N"
    cells = {f"device-{index}": partial(cell, index) for index in range(count)}
    computed(cells, OUT, about(command, SEED), write_page)


if __name__ == "__main__":
    main()
