"""Questions that people asked in public about force feedback and servos, answered by `avc` and by a simulation here.

python tests/benchmarks/questions.py --write

Each case states a question as files and options. The simulation shares no code with the project: one sample of a
device, or one step of an engine, is a function of its state, written from the physics; the poles of its linear map give
stability, damping ratio and, by bisection, limits. What a question leaves out (a sample time, an inertia) is assumed.
With --write the rows of RESULTS_questions.md are made anew, and the line that says with what.
"""

from __future__ import annotations

import argparse
import io
import json
import math
import re
import sys
import tempfile
from collections.abc import Callable, Sequence
from contextlib import chdir, redirect_stderr, redirect_stdout
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.linalg import expm

sys.path.insert(0, str(Path(__file__).parents[1] / "oracle"))

from admittance_loop import PlainDevice, largest_pole
from studied import about, made_by

from avc_casadi.cli import main as avc

PAGE = Path(__file__).parent / "RESULTS_questions.md"
COMMAND = "python tests/benchmarks/questions.py --write"
State = Sequence[float]
Answers = Sequence[dict[str, Any]]
Pairs = list[tuple[Any, Any]]


def poles(step: Callable[[State], list[float]], states: int) -> tuple[float, float]:
    """Return the growth a period and the least damping ratio of a step that is linear in its state.

    A real pole below 0 alternates from period to period: it is none of a pair, and has no damping ratio.
    """
    values = np.linalg.eigvals(np.array([step(list(one)) for one in np.eye(states)]).T) + 0j
    rates = np.log(values[np.abs(values) > 1e-9])
    turns = np.abs(rates.imag)
    swings = rates[(turns > 1e-6) & (turns < math.pi - 1e-6)]
    return float(np.abs(values).max()), float(np.min(-swings.real / np.abs(swings), initial=1.0))


def sampled(m: float, d: float, period: float) -> Any:
    """Return the map of position, velocity and a held force over a sample."""
    return expm(period * np.array([[0, 1, 0], [0, -d / m, 1 / m], [0, 0, 0]]))[:2]


def servo(m: float, k: float, b: float, period: float, late: int) -> tuple[float, float]:
    """Return growth and ratio under a held force -(k x + b v), v the backward difference, `late` samples of delay."""
    move = sampled(m, 0.0, period)

    def step(state: State) -> list[float]:
        x, v, before, *waiting = state
        forces = [-k * x - b * (x - before) / period, *waiting]
        return [*(move @ [x, v, forces[-1]]).tolist(), x, *forces[:-1]]

    return poles(step, 3 + late)


def joint(m: float, h: float, k: float, b: float, *, implicit: bool = False) -> float:
    """Return the growth of an engine's joint: v, then x; its damper explicit, or implicit as in implicitfast."""

    def step(state: State) -> list[float]:
        x, v = state
        v = (v - h * k * x / m) / (1 + h * b / m) if implicit else v - h * (k * x + b * v) / m
        return [x + h * v, v]

    return poles(step, 2)[0]


def game(m: float, k: float, own: float) -> float:
    """Return the growth a frame of a released wheel at 1 kHz; a game's spring comes every 2 ms, a frame late."""
    move = sampled(m, 0.02, 1e-3)

    def step(state: State) -> list[float]:
        x, v, before, last = state
        frame = -k * x
        for _ in range(2):
            (x, v), before = move @ [x, v, last - own * (x - before) / 1e-3], x
        return [x, v, before, frame]

    return poles(step, 4)[0]


def tool(m: float) -> float:
    """Return the growth of a released device of 0.1 kg and a tool, Ks 250 000, Kd 1700, scales 2.5 and 1e-6, 1 kHz."""
    move = sampled(0.1, 0.5, 1e-3)

    def step(state: State) -> list[float]:
        x, v, before, place, speed = state
        pull = 2.5e5 * (2.5 * x - place) + 1700 * (2.5 * (x - before) / 1e-3 - speed)
        speed += 1e-3 * pull / m
        return [*(move @ [x, v, -1e-6 * pull]).tolist(), x, place + 1e-3 * speed, speed]

    return poles(step, 5)[0]


def limit(holds: Callable[[float], bool], low: float) -> float:
    """Return up to where something holds that does at `low`."""
    high = 1e9
    for _ in range(50):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def relay() -> str:
    """Return a log of 3 s: a hand presses a handle of 0.35 kg on 5 N that are given at x <= 0, one sample late."""
    x, v, late, rows = 2e-3, 0.0, 0.0, ["time_s,position_m,force_n"]
    for tick in range(3000):
        seen = round(x / 3.8e-5) * 3.8e-5
        force = 5.0 if seen <= 0 else 0.0
        rows.append(f"{tick * 1e-3},{seen},{force}")
        for _ in range(20):
            v += 5e-5 * (late - 2.0 - 150.0 * x - 4.0 * v) / 0.35
            x += 5e-5 * v
        late = force
    return "\n".join(rows)


TURNS = '[device]\nmotion = "rotary"\nhandle_radius_m = 0.15\ninertia_kgm2 = {}\ndamping_nms_per_rad = {}\n'
WALL = "[environment]\nstiffness_nm_per_rad = 0\ndamping_nms_per_rad = 0\n"
NOBODY = "[hands]\ninertia_kgm2 = [0, 0]\ndamping_nms_per_rad = [0, 0]\nstiffness_nm_per_rad = [0, 0]\n"
GAME = TURNS + '[simulation]\nstep_s = 0.002\nexchange = "held-force"\nsteps_late = 1\n'
IMSTK = "[device]\nmass_kg = 0.1\ndamping_ns_per_m = 0.5\n[simulation]\nstep_s = 0.001\nexchange = 'held-force'\n"
IMSTK += "position_scale = 2.5\nforce_scale = 1e-6\ntool_mass_kg = {}\n"
SERVO = "{:.3g} kg.m2 at {:g} Hz, {} late: `--kp {} --kd {}`"


def of_servo(m: float, k: float, b: float, period: float = 1e-3, late: int = 0) -> tuple[str, list[Any], Any]:
    """Return how a servo that nobody holds is stated, what is typed, and what is compared."""

    def compared(answers: Answers) -> Pairs:
        (growth, ratio), one = servo(m, k, b, period, late), answers[0]
        pairs: Pairs = [(one["deployable"]["stable"], growth < 1), (one["released"]["damping_ratio"], ratio)]
        if growth >= 1:  # no damper holds it
            others = [servo(m, k, share * b, period, late)[0] < 1 for share in np.geomspace(1e-3, 1e3, 400)]
            return [*pairs, (one["damping_range_nms_per_rad"] is not None, any(others))]
        pairs.append((one["largest_stiffness_nm_per_rad"], limit(lambda k: servo(m, k, b, period, late)[0] < 1, k)))
        most = limit(lambda b: servo(m, k, b, period, late)[0] < 1, b)
        return [*pairs, (one["damping_range_nms_per_rad"][1], most)]

    file = TURNS.format(m, 0) + f"sample_time_s = {period}\ndelay_samples = {late}\n" + WALL + NOBODY
    return SERVO.format(m, 1 / period, late, k, b), [(file, f"certify --k {k} --b {b}")], compared


def of_engine(*joints: tuple[float, float, float, float, bool]) -> tuple[str, list[Any], Any]:
    """Return the same of joints that an engine drives to a set point; the device is what stands still."""
    asks, words, growths = [], [], [joint(m, h, k, b, implicit=soft) for m, h, k, b, soft in joints]
    for m, h, k, b, soft in joints:
        integrator = "implicit-damping" if soft else "semi-implicit"
        keys = f"tool_inertia_kgm2 = {m}\nstep_s = {h}\nintegrator = '{integrator}'\n"
        file = TURNS.format(1e6, 1e6) + f"sample_time_s = {h}\n[simulation]\n" + keys + NOBODY
        asks.append((file, f"certify --k {k} --b {b}"))
        parts = (integrator, f"{1 / h:g} Hz", f"{m:g} kg.m2", f"`--kp {k:.4g} --kd {b:.4g}`")
        words.append(", ".join(one for one in parts if one not in "; ".join(words)))
    return "; ".join(words), asks, grown(growths)


def grown(growths: Sequence[float]) -> Callable[[Answers], Pairs]:
    """Compare stability, and how fast what is unstable grows."""

    def compared(answers: Answers) -> Pairs:
        grows = [(one["spectral_radius"], own) for one, own in zip(answers, growths, strict=True) if own > 1 + 1e-9]
        return [*zip((one["stable"] for one in answers), (own < 1 + 1e-9 for own in growths), strict=True), *grows]

    return compared


def of_damper(counts: int, b: float) -> tuple[str, list[Any], Any]:
    """Return the same of a damper at 1 kHz behind an encoder: its jump while a wheel turns slowly."""
    seen = 2 * math.pi / counts * np.floor(np.arange(200) / 50)
    file = TURNS.format(0.04, 0.02) + f"encoder_counts_per_turn = {counts}\n" + WALL
    jump, ask = float(np.abs(b * np.diff(seen) / 1e-3).max()), [(file, f"certify --b {b}")]
    return f"{counts} counts a turn, 1 kHz: `--kd {b}`", ask, lambda answers: [(answers[0]["encoder_step_nm"], jump)]


ARM = """[device]
drive = "velocity"
drive_bandwidth_hz = 10.0
sample_time_s = 8e-3
delay_samples = 1
[device.force_sensor]
stiffness_n_per_m = 1e6
damping_ratio = 0.05
handle_mass_kg = 1.0
[hands]
mass_kg = [1.0, 1.0]
damping_ns_per_m = [20.0, 20.0]
stiffness_n_per_m = [500.0, 500.0]
[contact]
stiffness_n_per_m = [0.0, 1e5]
damping_ns_per_m = 5.0
[law]
admittance = {{ mass_kg = {}, damping_ns_per_m = {} }}
"""
HELD = (1.0, 20.0, 500.0)


def arm(mass: float, damping: float, contact: float) -> float:
    """Return the growth of an arm that a drive moves: on springs of up to a contact, with a hand and without."""
    law = {"sample_s": 8e-3, "drive_hz": 10.0, "late_samples": 1, "mass_kg": mass, "damping": damping}
    handle = {"sensor_n_per_m": 1e6, "sensor_ratio": 0.05, "handle_kg": 1.0}

    def growth(kg: float, ns_per_m: float, n_per_m: float) -> float:
        carried = {"hand_kg": kg, "hand_damping": ns_per_m, "hand_n_per_m": n_per_m}
        return float(largest_pole(PlainDevice(**law, **handle, **carried)))

    springs = np.geomspace(1e-3 * contact, contact, 60).tolist()
    touching = [growth(kg, d + 5.0, k + spring) for kg, d, k in ((0.0, 0.0, 0.0), HELD) for spring in springs]
    return max(*touching, growth(0.0, 0.0, 0.0), growth(*HELD))


def of_arm(*laws: tuple[float, float]) -> tuple[str, list[Any], Any]:
    """Return the same of virtual masses and dampings of an arm that touches an object of up to 100 kN/m."""

    def compared(answers: Answers) -> Pairs:
        pairs: Pairs = []
        for answer, (mass, damping) in zip(answers, laws, strict=True):
            growth = arm(mass, damping, 1e5)
            pairs.append((answer["deployable"]["stable"], growth < 1))
            if growth > 1:
                pairs.append((max(case["spectral_radius"] for case in answer["cases"]), growth))
            hardest = limit(partial(_holds_contact, mass, damping), 1e3)
            pairs.append((answer["stiffest_contact_n_per_m"], hardest))
        return pairs

    words = "; ".join(f"{mass:g} kg, {damping:g} N.s/m" for mass, damping in laws)
    return (
        f"a drive of 10 Hz at 125 Hz on up to 100 kN/m: {words}",
        [(ARM.format(*law), "certify") for law in laws],
        compared,
    )


def _holds_contact(mass: float, damping: float, contact: float) -> bool:
    return arm(mass, damping, contact) < 1


HUB = "https://github.com/"
CASES: list[tuple[str, str, tuple[str, list[Any], Any], str]] = [
    ("Explicit actuators jitter at 200 Hz, are my gains too high?", HUB + "mujocolab/mjlab/issues/518",
     of_engine((0.027, 0.005, 17.11, 0.56, True), (0.027, 0.005, 4500, 0.56, True), (0.027, 0.005, 4600, 0.56, True)),
     "no: stable up to 4.5 kN.m/rad with the joint's damper"),
    ("Vibration at decimation 4: does an armature of 0.01 help?", HUB + "Improbable-AI/walk-these-ways/issues/41",
     of_engine((0.01, 0.005, 20, 0.5, False), (0.001, 0.005, 20, 0.5, False)),
     "yes: stable with it; unstable with a link of 0.001 kg.m2 alone"),
    ("Ideal PD with 45 and 1.5 misbehaves, a bug?", HUB + "isaac-sim/IsaacLab/issues/2425",
     of_engine((0.045, 0.005, 45, 1.5, False), (0.045, 0.005, 6500, 1.5, False), (0.045, 0.005, 6700, 1.5, False)),
     "not of the gains: stable up to 6.6 kN.m/rad"),
    ("How large may omega dt be for a PD in DART?", "https://dart.readthedocs.io/en/latest/topics/control-gain-tuning.html",
     of_engine((1.0, 0.001, 672400, 1640, False), (1.0, 0.001, 1e6, 2000, False)),
     "0.82 is stable with a ratio of 1, 1 is not"),
    ("Published gains diverge at 5 ms and hold at 1 ms", HUB + "ecto/vcad/pull/767",
     of_engine((0.0102, 0.005, 200, 5, False), (0.0102, 0.001, 200, 5, False)), "as they found: unstable, then stable"),
    ("Joint 7 of an arm explodes with kp 500, kv 50", HUB + "google-deepmind/mujoco_menagerie/issues/232",
     of_engine((6.4e-4, 0.002, 500, 50, True), (6.4e-4, 0.002, 500, 50, False), (0.10064, 0.002, 100, 2, False)),
     "not with implicitfast; it does with a damper taken explicitly; the armature of 0.1 holds"),
    ("Which stiffness cap has a position actuator in MuJoCo?", HUB + "google-deepmind/mujoco/issues/3443",
     of_engine((0.01, 0.005, 4105, 6.472, True), (0.01, 0.005, 4273, 6.472, True)),
     "theirs: stable 1 % below its frequency, unstable 1 % above"),
    ("Why a damping ratio of 2, not 1, for a humanoid's motors?", HUB + "HybridRobotics/whole_body_tracking/issues/11",
     of_servo(0.003609725, 14.25, 0.907, 0.002, 1), "stable, kd may be 1.6 times; a sample late its ratio is 0.23"),
    ("Are kp 50, kd 1.1 right? The formula gives others", HUB + "HighTorque-Robotics/Mini-Pi-Plus_BeyondMimic/issues/5",
     of_servo(0.008419, 50, 1.1, 0.002, 1), "stable, ratio 0.69"),
    ("Why does a handstand sail past, kd 60 at the wrist?", HUB + "rreusser/rreusser.github.io/pull/45",
     of_servo(79.6, 801, 60), "a ratio of 0.12, as they found"),
    ("D = 2 xi sqrt(K) overshoots on an arm of high inertia", HUB + "lbr-stack/lbr_fri_ros2_stack/issues/247",
     of_servo(4.0, 1000, 63.2), "the ratio is 0.5, not 1: the formula is one of unit mass"),
    ("Chatter with stiffness 1000 and ratio 0.7 over FRI", HUB + "kuka-isir/rtt_lwr/issues/8",
     of_servo(0.3, 1000, 24.2, 0.005, 2), "no damper holds it at 200 Hz, two samples late"),
    ("A damper from hall sensors for a released wheel?", HUB + "EFeru/hoverboard-firmware-hack-FOC/issues/54",
     of_damper(90, 0.3), "stable, but 21 N.m by each step of the sensor"),
    ("Is a high damper smoother with the encoder's true resolution?", HUB + "Ultrawipf/OpenFFBoard/pull/175",
     of_damper(65535, 1.0), "0.096 N.m a step"),
    ("Released wheel swings in the pits: inertia or damping?", HUB + "coasting-nc/LMUFFB/issues/418",
     ("spring of a game, 500 Hz, a frame late: `--k 8`; twice the inertia; `--b-p 0.05`",
      [(GAME.format(0.03, 0.02) + NOBODY, "certify --k 8"), (GAME.format(0.06, 0.02) + NOBODY, "certify --k 8"),
       (GAME.format(0.03, 0.02) + NOBODY, "certify --k 8 --b-p 0.05")],
      grown([game(0.03, 8, 0.0), game(0.06, 8, 0.0), game(0.03, 8, 0.05)])),
     "damping: inertia only slows the growth"),
    ("Which Ks and Kd for a rigid body on a stylus?", "https://discourse.kitware.com/t/how-to-set-haptic-device-parameters/743",
     ("`held-force`, scales 2.5 and 1e-6, tool of 1 and 0.8 kg: `--k 0.625 --b 0.00425`",
      [(IMSTK.format(m), "certify --k 0.625 --b 0.00425") for m in (1.0, 0.8)], grown([tool(1.0), tool(0.8)])),
     "theirs hold for bodies above 0.91 kg, and render 0.6 N/m"),
    ("5 N at x <= 0 make a Falcon vibrate", HUB + "WPI-AIM/ros_falcon/issues/15",
     ("a log of it: `avc diagnose`", [(relay(), "diagnose --device novint-falcon")],
      lambda answers: [(answers[0]["cause"], "relay"), (abs(answers[0]["measured"]["delay_samples"] - 1) < 0.2, True)]),
     "force switched by a sign; give it a width; one sample late"),
    ("Admittance control on hard objects at 125 Hz", HUB + "Yaskawa-Global/motoros2/pull/449",
     of_arm((4.0, 100.0), (4.0, 2000.0), (20.0, 1500.0)),
     "with 4 kg on 100 kN/m only from 1.2 kN.s/m on; at 100 N.s/m up to 6.4 kN/m"),
]  # fmt: skip


def replies(asks: list[Any]) -> list[dict[str, Any]]:
    """Return what `avc` answers."""
    answers = []
    with tempfile.TemporaryDirectory() as folder, chdir(folder):
        for text, typed in asks:
            verb, *options = typed.split()
            file = "q.csv" if verb == "diagnose" else "q.toml"
            Path(file).write_text(text, encoding="utf-8")
            with redirect_stdout(io.StringIO()) as out, redirect_stderr(io.StringIO()):
                avc([verb, file, *options, "--json"])
            answers.append(json.loads(out.getvalue()))
    return answers


def main() -> None:
    """Ask, compare, and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true")
    write, rows = parser.parse_args().write, []
    for question, address, (stated, asks, compared), answer in CASES:
        pairs = compared(replies(asks))
        agree = all(
            one == own if isinstance(own, bool | str) else math.isclose(one, own, rel_tol=1e-3) for one, own in pairs
        )
        rows.append(f"| [{question}]({address}) | {stated} | {answer} | {'right' if agree else 'WRONG'} |")
        print(rows[-1], *(f"{one!s:.9} {own!s:.9}" for one, own in pairs), sep="\n    ", flush=True)
    if write:
        before, _, _ = PAGE.read_text(encoding="utf-8").rpartition("| --- | --- | --- | --- |")
        before = re.sub("^Made by .*$", made_by(about(COMMAND, 0)), before, count=1, flags=re.MULTILINE)
        PAGE.write_text(f"{before}| --- | --- | --- | --- |\n" + "\n".join(rows) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
