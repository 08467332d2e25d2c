"""Walls by estimator of the velocity: the measured haptic paddle, figure 5, the reference devices, two others.

python tests/benchmarks/velocity_estimators.py [OUT]

Each wall K, B is rendered directly with F = K x + B v, v by an estimator, in the package's scenes: encoder, friction,
delay, amplifier and resonance as declared; the stiffest K up to which all hands rest at the end of a press. Takes about
twenty minutes on two cores. Overwrites OUT (default tests/benchmarks/results/velocity_estimators.json) and
RESULTS_velocity_estimators.md beside this file.
"""

from __future__ import annotations

import math
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from published import FINGERS, MEASURED, SLOW_RAD_PER_S, paddle_problem
from script_arguments import script_arguments
from studied import about, write_rows
from velocity_estimators_page import page

import avc_casadi as avc
from avc_casadi.claims.stability.boundary_curves import stable_walls
from avc_casadi.model.corners import LINEAR_KEYS, device_corners
from avc_casadi.model.declared import declared_effects
from avc_casadi.model.gains import NO_COUPLING
from avc_casadi.model.hands import Hand, hand_set
from avc_casadi.model.velocity import PLAIN, velocity_estimator
from avc_casadi.model.velocity_keys import VelocityFilterEffect

HERE = Path(__file__).parent
RESULTS = HERE / "results" / "velocity_estimators.json"
Row = dict[str, Any]
Keys = dict[str, Any]

# The devices

PROBLEMS = ("figure5", "reference-r1", "reference-r2", "reference-r3")
FILED = ("novint-falcon", "teaching-one-axis")
# Each estimator with the settings among which the best counts (cut-offs, accelerations); on figure 5 some more.
ESTIMATORS: dict[str, tuple[Keys, ...]] = {
    "difference": ({},),
    "first-order": ({"cutoff_hz": 30.0}, {"cutoff_hz": 300.0}),
    "kalman": ({"acceleration_m_per_s2": 10.0},),
    "foaw": ({"fit": "best"},),
    "levant": ({"acceleration_m_per_s2": 20.0},),
    "levant, explicit": ({"acceleration_m_per_s2": 20.0, "discretisation": "explicit"},),
}
MORE: dict[str, tuple[Keys, ...]] = {
    "first-order": ({"cutoff_hz": 100.0},),
    "kalman": ({"acceleration_m_per_s2": 100.0},),
    "foaw": ({"fit": "end"},),
    "levant": ({"acceleration_m_per_s2": 100.0},),
}
# Dampings in that of the stiffest wall that is linearly stable with the difference and all hands; a resonance makes it
# so small that estimators hardly matter there. The last two have coarse encoders and no friction: they hold far less.
SHARES = {"figure5": (0.5, 1.0, 2.0)} | dict.fromkeys(PROBLEMS[1:], (1.0, 8.0)) | dict.fromkeys(FILED, (0.03125, 0.125))
SOFTEST, DOUBLINGS, HALVINGS = 0.25, 8, 2
SECONDS, WORKERS, PRESS_M = 2.0, 2, 0.01


def device_problem(name: str) -> avc.Problem:
    """Problem of a device whose wall plays no part."""
    if name in PROBLEMS:
        return avc.load_problem(name)
    wall = {"damping_ns_per_m": 0.0, "stiffness_n_per_m": 1e3}
    device = avc.load_device(name).device.model_dump(mode="json", exclude_none=True)
    return avc.Problem.model_validate({"name": name, "device": device, "environment": wall})


def with_estimator(problem: avc.Problem, keys: Keys, motion: str = "press") -> avc.Problem:
    """Let a wall be rendered directly, with everything declared and an estimator; none for the difference."""
    effects = [effect.model_dump(exclude_none=True) for effect in declared_effects(problem)]
    effects += [{"kind": "velocity-filter", **keys}] if keys else []
    scene = {"effects": effects, "coupling": "none", "duration_s": SECONDS, "motion": {"kind": motion}}
    limit, hand = problem.device.max_force_n, max(problem.hands.stiffness_n_per_m)
    if motion == "press" and limit is not None and limit < PRESS_M * hand:
        # Beyond its limit the force is constant, and any wall holds.
        scene["motion"] = {"kind": motion, "end_m": 0.8 * limit / hand}
    if motion == "tap":
        # Hands that swing in free space take longer than a second.
        scene |= {"duration_s": 2 * SECONDS, "motion": {"kind": motion, "rest_s": 2.5}}
    return problem.changed(scene=scene | {"integrator": "projected", "substeps": 4})


def rests(problem: avc.Problem, stiffness: float, damping: float, *, friction: bool = True) -> bool:
    """Whether all hands rest before a wall."""
    wall = {"stiffness_n_per_m": stiffness, "damping_ns_per_m": damping}
    with np.errstate(all="ignore"):
        found = avc.simulate_batch(
            problem.changed(environment=wall), hand_set(problem.hands), NO_COUPLING, friction=friction
        )
    return bool(found.stable.all())


def stiffest(problem: avc.Problem, keys: Keys, damping: float, begin: float) -> Row:
    """Stiffest wall up to which all hands rest: doubled from below, then halved; what else it holds."""
    scene = with_estimator(problem, keys)
    low, high = 0.0, begin
    for _ in range(DOUBLINGS):
        if not rests(scene, high, damping):
            break
        low, high = high, 2 * high
    for _ in range(HALVINGS if low else 0):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if rests(scene, middle, damping) else (low, middle)
    row: Row = {"stiffness_n_per_m": low}
    if low:
        row["without_friction"] = rests(scene, low, damping, friction=False)
        row["tapped"] = rests(with_estimator(problem, keys, "tap"), low, damping)
    return row


def search(case: tuple[str, str, Keys, float, float]) -> Row:
    """A device, an estimator with its settings, a damping."""
    device, estimator, keys, damping, begin = case
    problem = device_problem(device)
    row = {"part": "device", "device": device, "estimator": estimator, "settings": keys, "damping_ns_per_m": damping}
    whole = {"estimator": estimator.partition(",")[0], **keys} if keys else {}
    row |= {"noise_n": damping * noise_m_per_s(problem, whole), "linear_n_per_m": linear(problem, whole, damping)}
    return row | stiffest(problem, whole, damping, begin)


def linear(problem: avc.Problem, keys: Keys, damping: float) -> float | None:
    """Stiffest wall that is linearly stable with every hand, as `avc zwidth` has it; None where there is none."""
    poles = velocity_estimator(*settled(problem, keys)).poles if keys else PLAIN
    if poles is None:
        return None
    corners = device_corners(problem.device, LINEAR_KEYS)
    found = stable_walls(corners, hand_set(problem.hands), np.array([damping]), poles).first_n_per_m[0]
    return float(found) if np.isfinite(found) else None


def settled(problem: avc.Problem, keys: Keys) -> tuple[avc.Problem, VelocityFilterEffect]:
    """The problem with its effects listed, and the table of an estimator."""
    effects = (*declared_effects(problem), VelocityFilterEffect(**keys))
    listed = problem.changed(scene={"effects": [one.model_dump(exclude_none=True) for one in effects]})
    return listed, VelocityFilterEffect(**keys)


def noise_m_per_s(problem: avc.Problem, keys: Keys) -> float:
    """Velocity above 20 Hz, rms, of a hand that moves 5 mm to and fro once a second over the device's encoder."""
    import casadi as ca  # noqa: PLC0415

    period, step = problem.device.sample_time_s, problem.device.encoder_resolution_m
    time = period * np.arange(round(2 / period))
    counted = 5e-3 * np.sin(2 * np.pi * time)
    counted = step * np.round(counted / step) if step else counted
    velocity = np.diff(counted, prepend=counted[0]) / period
    if keys:
        one = velocity_estimator(*settled(problem, keys))
        if one.poles is not None:
            rates = [0.0, 0.0]
            for raw in velocity.tolist():
                rates.append((1 + sum(one.poles)) * raw - one.poles[0] * rates[-1] - one.poles[1] * rates[-2])
            velocity = np.array(rates[2:])
        else:
            state, x = {name: ca.SX.sym(name) for name in one.initial(0.0)}, ca.SX.sym("x")
            following, found, _ = one.step(x, state)
            columns = [ca.vertcat(*state.values()), x], [ca.vertcat(*following.values()), found]
            run = ca.Function("run", *columns).mapaccum(len(time))
            velocity = run(list(one.initial(0.0).values()), counted[None])[1].full().ravel()
    spectrum = np.fft.rfft(velocity[len(time) // 2 :])
    loud = np.fft.rfftfreq(len(time) - len(time) // 2, period) > 20
    return float(math.sqrt(2 * (np.abs(spectrum[loud]) ** 2).sum()) / (len(time) - len(time) // 2))


def cases() -> list[tuple[str, str, Keys, float, float]]:
    """Every search."""
    found = []
    for device in (*PROBLEMS, *FILED):
        region = avc.zwidth(device_problem(device))
        curve = next(one for one in region.curves if one.key == "stable-hands").stiffness_n_per_m
        best = float(region.damping_ns_per_m[np.nanargmax(curve)])
        begin = SOFTEST * float(curve[0])
        found.append((device, "none", {}, 0.0, begin))
        for name, several in ESTIMATORS.items():
            tried = (*several, *MORE.get(name, ())) if device == "figure5" else several
            found += [(device, name, keys, share * best, begin) for keys in tried for share in SHARES[device]]
    return found


# The paddle

FINGER = Hand(*(np.array(column) for column in zip(FINGERS["light"], FINGERS["firm"], strict=True)))
# What the firmware is known to run, and others: their settings are not published. Of accelerations
# from 3 to 3000 rad/s2 those nearest to the measured column.
_BOUND, _POSITION = {"discretisation": "explicit"}, {"position": "estimated"}
PADDLE: dict[str, Keys] = {
    "difference, 50 Hz": {"estimator": "first-order", "cutoff_hz": 50.0},
    "foaw": {"estimator": "foaw"},
    "levant": {"estimator": "levant", "acceleration_m_per_s2": 10.0, **_BOUND},
    "levant, its position": {"estimator": "levant", "acceleration_m_per_s2": 500.0, **_BOUND, **_POSITION},
    "kalman": {"estimator": "kalman", "acceleration_m_per_s2": 100.0},
    "kalman, its position": {"estimator": "kalman", "acceleration_m_per_s2": 100.0, **_POSITION},
}
TRIED = tuple(0.25 * math.sqrt(2) ** step for step in range(14))
# What might hold the real one back, each alone, with these estimators at these dampings.
CHANGES: dict[str, dict[str, Any]] = {
    "as above": {},
    "one sample of delay": {"device": {"delay_samples": 1}},
    "two samples of delay": {"device": {"delay_samples": 2}},
    "a torque loop of 100 Hz": {"device": {"amplifier_bandwidth_hz": 100.0}},
    "inertia of 0.0001 kg.m2": {"device": {"mass_kg": 1e-4}},
    "a cable that rings at 60 Hz": {
        "device": {"resonance": {"frequency_hz": 60.0, "damping_ratio": 0.03, "mass_ratio": 0.5}}
    },
    "no dry friction": {"friction": False},
    "rest is below 0.35 rad/s": {"slow": 5 * SLOW_RAD_PER_S},
}
CHANGED, CHANGED_AT = ("difference, 50 Hz", "foaw"), (0.004, 0.012)


def paddle_search(case: tuple[str, Keys, float, str]) -> Row:
    """Stiffest wall at which each finger rests, N.m/deg; an estimator, a damping, what is changed."""
    name, keys, damping, change = case
    changes = CHANGES[change]
    rows: list[float | None] = [None, None]
    going = [True, True]
    for stiffness in TRIED:
        problem = paddle_problem(stiffness, damping)
        effects = [one for one in problem.scene.effects if one.kind != "velocity-filter"]
        given = changes.get("device", {})
        listed = {"delay_samples": "delay", "amplifier_bandwidth_hz": "amplifier", "resonance": "resonance"}
        tables = [one.model_dump(exclude_none=True) for one in effects] + [{"kind": "velocity-filter", **keys}]
        tables += [{"kind": listed[key]} for key in given if key in listed]
        scene = {"effects": tables, "integrator": "projected", "substeps": 4}
        with np.errstate(all="ignore"):
            found = avc.simulate_batch(
                problem.changed(device=given, scene=scene),
                FINGER,
                NO_COUPLING,
                friction=changes.get("friction", True),
            )
        for who, speed in enumerate(found.peak_velocity_m_per_s):
            going[who] = going[who] and bool(speed < changes.get("slow", SLOW_RAD_PER_S))
            rows[who] = stiffness if going[who] else rows[who]
        if not any(going):
            break
    row = {"part": "paddle", "estimator": name, "damping_nms_per_deg": damping, "change": change}
    return row | {"light": rows[0], "firm": rows[1]}


def paddle_cases() -> list[tuple[str, Keys, float, str]]:
    """Every search of the paddle."""
    found = [(name, keys, b, "as above") for name, keys in PADDLE.items() for b in MEASURED]
    changes = [one for one in CHANGES if one != "as above"]
    return found + [(name, PADDLE[name], b, one) for name in CHANGED for b in CHANGED_AT for one in changes]


def main() -> None:
    """Compute and write."""
    args = script_arguments(__doc__, out=RESULTS)
    made = about("python tests/benchmarks/velocity_estimators.py", 0)
    with ProcessPoolExecutor(WORKERS) as pool:
        rows = [*pool.map(search, cases()), *pool.map(paddle_search, paddle_cases())]
    write_rows(args.out, made, rows)
    (HERE / "RESULTS_velocity_estimators.md").write_text(page(made, rows), encoding="utf-8")


if __name__ == "__main__":
    main()
