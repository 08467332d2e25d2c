"""Published conditions and figures beside our claims of stability and passivity, and where the two part.

python tests/benchmarks/published.py [OUT]

Each row: their formula or figure, ours, and mostly a second way that shares no code with the package: roots to 30
digits (mpmath), the energy that a hand gets out of a held force, plain simulations. Takes half a minute. Overwrites OUT
(default tests/benchmarks/results/published.json) and RESULTS_published.md beside this file.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter
from script_arguments import script_arguments
from studied import about, made_by, rounded, table, write_rows

import avc_casadi as avc
from avc_casadi.claims.passive_walls import passive_walls
from avc_casadi.claims.passivity.llewellyn import largest_llewellyn_stiffness
from avc_casadi.claims.passivity.teleoperator import Teleoperator, damping_needed_ns_per_m
from avc_casadi.loops.engine import ToolLoops
from avc_casadi.loops.sampled_loop import SampledLoop
from avc_casadi.loops.walls import stable_walls
from avc_casadi.model.device import Device
from avc_casadi.model.gains import NO_COUPLING
from avc_casadi.model.hands import Hand, no_hand
from avc_casadi.model.virtual_tool import ToolGains

HERE = Path(__file__).parent
RESULTS = HERE / "results" / "published.json"
T = 1e-3
Row = dict[str, Any]
Floats = NDArray[np.float64]

# Stability: the linear rule of Gil, Hulin and others

MASS, DAMPING = 0.1, 1.0
HANDS = {"released": (0.0, 0.0, 0.0), "held": (0.2, 5.0, 300.0)}
DELAYS = (0, 1, 2, 5, 10)
WALL_DAMPINGS = (0.0, 1.0, 5.0, 20.0, 50.0)
ROOTS_AT, NEAR = ((0, 5.0), (2, 1.0), (10, 5.0)), 1e-6


def rule() -> list[Row]:
    """Stiffest wall against (b + b_h + B)/(T/2 + t_d), by delay, hand and damping of the wall."""
    rows = []
    for who, hand in HANDS.items():
        held = Hand(*(np.array([value]) for value in hand))
        for delay in DELAYS:
            device = Device(mass_kg=MASS, damping_ns_per_m=DAMPING, sample_time_s=T, delay_samples=delay)
            ours = stable_walls([device], held, np.array(WALL_DAMPINGS)).first_n_per_m
            for damping, limit in zip(WALL_DAMPINGS, ours, strict=True):
                told = (DAMPING + hand[1] + damping) / ((0.5 + delay) * T)
                row = {"part": "rule", "hand": who, "delay_samples": delay, "damping_ns_per_m": damping}
                late = damping * (1 + delay) * T / (MASS + hand[0])
                row |= {"late_damper": late, "published_n_per_m": told, "ours_n_per_m": _number(limit)}
                if (delay, damping) in ROOTS_AT:
                    row["radius_below_and_above"] = [
                        largest_root(hand, damping, share * limit, delay) for share in (1 - NEAR, 1 + NEAR)
                    ]
                rows.append(row)
    return rows


def largest_root(hand: tuple[float, ...], damping: float, stiffness: float, delay: int) -> float:
    """Largest magnitude of the roots of the characteristic polynomial, minus 1, worked out to 30 digits."""
    with mpmath.workdps(30):
        m, b, k = (mpmath.mpf(one) for one in (MASS + hand[0], DAMPING + hand[1], hand[2]))
        t, spring, damper = mpmath.mpf(T), mpmath.mpf(float(stiffness)), mpmath.mpf(damping)
        flow = mpmath.expm(mpmath.matrix([[0, 1, 0], [-k / m, -b / m, 1 / m], [0, 0, 0]]) * t, method="taylor")
        trace, determinant = flow[0, 0] + flow[1, 1], flow[0, 0] * flow[1, 1] - flow[0, 1] * flow[1, 0]
        lead, last = flow[0, 2], flow[0, 1] * flow[1, 2] - flow[1, 1] * flow[0, 2]
        # (z^2 - trace z + determinant) z^(1+d) + (K z + B (z - 1)/T)(lead z + last)
        whole = [mpmath.mpf(1), -trace, determinant, *[mpmath.mpf(0)] * (delay + 1)]
        newest = spring + damper / t
        for place, part in enumerate((newest * lead, newest * last - damper / t * lead, -damper / t * last)):
            whole[len(whole) - 3 + place] += part
        companion = mpmath.zeros(len(whole) - 1)
        for place, part in enumerate(whole[1:]):
            companion[0, place] = -part
            if place:
                companion[place, place - 1] = 1
        roots = mpmath.eig(companion, left=False, right=False)
        return float(max(abs(one) for one in roots) - 1)


def undamped() -> list[Row]:
    """Stiffest wall on a mass without damping or delay, against the boundary of its cubic by Routh and Hurwitz."""
    device = Device(mass_kg=MASS, damping_ns_per_m=0.0, sample_time_s=T)
    shares = np.array([0.02, 0.1, 0.5, 2 * math.sqrt(2) - 2, 1.5])
    ours = stable_walls([device], no_hand(), shares * MASS / T).first_n_per_m * T**2 / MASS
    told = 2 * shares * (2 - shares) / (2 + shares)
    each = zip(shares, told, ours, strict=True)
    return [{"part": "undamped", "beta": float(s), "published": float(p), "ours": float(o)} for s, p, o in each]


# Passivity of a held wall: Colgate and Schenkel, Brown, Diolaiti and others

LOSSY = 2.0
FILTERS_HZ = (None, 500.0, 50.0)


def passive() -> list[Row]:
    """Stiffest passive wall against the closed forms, with filtered velocity and with delay."""
    cases = [(damping, hz, 0) for damping in (0.0, 0.5, 1.5) for hz in FILTERS_HZ]
    cases += [(0.0, None, delay) for delay in DELAYS[1:]]
    rows = []
    for damping, hz, delay in cases:
        tau = 0.0 if hz is None else 1 / (2 * math.pi * hz)
        share = tau / (tau + T)
        device = Device(mass_kg=MASS, damping_ns_per_m=LOSSY, sample_time_s=T, delay_samples=delay)
        wall = passive_walls([device], np.array([damping]), "sampled-data", ideal=True, poles=(-share, 0.0))
        ours = float(wall.first_n_per_m[0])
        row = {"part": "passive", "damping_ns_per_m": damping, "filter_hz": hz, "delay_samples": delay}
        row |= {"published_n_per_m": (LOSSY - damping * T / (T + 2 * tau)) / ((0.5 + delay) * T), "ours_n_per_m": ours}
        rows.append(row | {"damping_by_energy_ns_per_m": energy_asks(ours, damping, share, delay)})
    return rows


def energy_asks(stiffness: float, damping: float, share: float, delay: int) -> float:
    """Damping that keeps a hand from gaining energy, N.s/m: the hand moves straight between samples.

    Of all motions with the same samples a straight one loses least to the device. It goes through cos(theta k) at each
    of many theta; the held forces' work is summed, sample by sample.
    """
    samples, before = 4000, 400
    turns = np.concatenate([np.arange(1, 40), np.arange(40, samples // 2 + 1, 40)]) / samples
    x = np.cos(2 * np.pi * turns * np.arange(-before, samples + 1)[:, None])
    moved = np.diff(x, axis=0)
    # Position and velocity of the sample that ends each move; the force is held over the next.
    velocity = lfilter([1 - share], [1, -share], moved / T, axis=0)
    force = (stiffness * x[1:] + damping * velocity)[before - 1 - delay : -1 - delay]
    path = moved[before:]
    return float(np.max(-T * (force * path).sum(axis=0) / (path**2).sum(axis=0)))


# Encoder and dry friction: Abbott and Okamura, Diolaiti and others

FRICTIONS = ((0.05, 50e-6), (0.2, 50e-6), (0.2, 20e-6), (0.5, 400e-6))


def quantised() -> list[Row]:
    """Stiffest passive wall with encoder and dry friction: min(2 b/T, 2 f_c/Delta), and by a hand that taps."""
    rows = []
    for friction, step in FRICTIONS:
        region = avc.zwidth(problem(friction, step))
        ours = min(region.passive_spring_n_per_m, region.encoder_limit_n_per_m or math.inf)
        row = {"part": "quantised", "friction_n": friction, "step_m": step, "ours_n_per_m": ours}
        row |= {"published_n_per_m": min(2 * LOSSY / T, 2 * friction / step)}
        rows.append(row | {"tapping_n_per_m": tapping_allows(friction, step)})
    return rows


def problem(friction: float, step: float) -> avc.Problem:
    """Problem of a device with encoder and dry friction; the wall plays no part."""
    return avc.parse_problem(
        f"[device]\nmass_kg = {MASS}\ndamping_ns_per_m = {LOSSY}\ncoulomb_friction_n = {friction}\n"
        f"encoder_resolution_m = {step}\n[environment]\ndamping_ns_per_m = 0.0\nstiffness_n_per_m = 1e3\n"
    )


def tapping_allows(friction: float, step: float) -> float:
    """Stiffest spring of which a hand gets no energy that goes to and fro once in two samples, N/m.

    It starts at many places within a step of the encoder and goes any way, straight; force of the rounded position.
    """
    ways = np.geomspace(1e-6 * step, 1e4 * step, 1001)[:, None]
    place = (1 - np.geomspace(1e-7, 1, 100)) * step
    difference = step * (np.floor((place + ways) / step) - np.floor(place / step))
    lost = 2 * friction * ways + 2 * LOSSY * ways**2 / T
    gained = np.where(difference > 0, difference * ways, np.nan)
    return float(np.nanmin(lost / gained))


# Regions in time: a released device on a spring, with encoder, dry friction, viscous friction

REGIONS = ((1e3, 0.05), (3e3, 0.05), (6e3, 0.2), (1e4, 0.2))
STEP, STARTS, SECONDS, PARTS = 50e-6, (3.0, 2000.0), 2.0, 40


def regions() -> list[Row]:
    """What a plain simulation does on either side of both limits, from a small and a large start."""
    cases = [(k, f, s) for k, f in REGIONS for s in STARTS]
    stiffness, friction, start = (np.array(column) for column in zip(*cases, strict=True))
    x, v, h = start * STEP, np.zeros(len(cases)), T / PARTS
    early, late = np.zeros_like(x), np.zeros_like(x)
    low, high = np.full_like(x, np.inf), np.full_like(x, -np.inf)
    samples = round(SECONDS / T)
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(samples):
            force = -stiffness * STEP * np.floor(x / STEP + 0.5)
            for _ in range(PARTS):
                free = v + h / MASS * (force - LOSSY * v)
                give = h / MASS * friction
                v = np.sign(free) * np.maximum(np.abs(free) - give, 0.0)
                x = x + h * v
            early = np.maximum(early, np.abs(x)) if k < samples // 10 else early
            if k > 0.9 * samples:
                late, low, high = np.maximum(late, np.abs(v)), np.minimum(low, x), np.maximum(high, x)
    rows = []
    for place, (spring, dry, begin) in enumerate(cases):
        grew = not abs(x[place]) < 2 * early[place]
        ends = "rests" if late[place] == 0 else "grows" if grew else "swings on"
        below = [spring < 2 * LOSSY / T, spring < 2 * dry / STEP]
        row = {"part": "regions", "stiffness_n_per_m": spring, "friction_n": dry, "start_steps": begin}
        swing = float((high - low)[place] / STEP) if ends == "swings on" else None
        rows.append(row | {"below_viscous_and_coulomb": below, "ends": ends, "swing_steps": swing})
    return rows


# Virtual couplings: Llewellyn, Adams and Hannaford

RATIOS = (0.0, 1.0, 4.0, 7.0)


def llewellyn() -> list[Row]:
    """Largest stiffness of a virtual coupling, by the package and by the general criterion on a grid."""
    rows = []
    for model in ("paper", "sampled-data"):
        for ratio in RATIOS if model == "paper" else (0.0, 0.5):
            loop = SampledLoop(LOSSY, 0.0, 0.0, T, 0, model)
            ours = float(largest_llewellyn_stiffness(loop, ratio * LOSSY)[0]) * T / LOSSY
            grid = unconditional(ratio * LOSSY, model) * T / LOSSY
            rows.append({"part": "llewellyn", "hold": model, "ratio_b": ratio, "published": grid, "ours": ours})
    return rows


def unconditional(damping: float, hold: str) -> float:
    """Largest k for which 2 Re h11 Re h22 >= |h12 h21| + Re(h12 h21) on a grid, N/m, bisected."""
    z = np.exp(1j * np.concatenate([np.geomspace(1e-4, 0.1, 1000), np.linspace(0.1, np.pi, 8001)[:-1]]))
    h12 = (z + 1) / (2 * z) if hold == "paper" else 1 / z
    product = -h12

    def holds(k: float) -> bool:
        h22 = 1 / (damping + k * T * z / (z - 1))
        return bool((2 * LOSSY * h22.real >= (np.abs(product) + product.real) * (1 - 1e-9)).all())

    low, high = 0.0, 20 * LOSSY / T
    for _ in range(50):
        low, high = ((low + high) / 2, high) if holds((low + high) / 2) else (low, (low + high) / 2)
    return low


# An engine's mass, a second device


def explicit_mass() -> list[Row]:
    """Real part of a mass moved explicitly, s/kg, from a run: force f(n), velocity before it; -T/(2 m) by formula."""
    rows = []
    for mass in (0.05, 1.0):
        found = []
        for turns in (7, 100, 499):
            steps = 1000
            force = np.cos(2 * np.pi * turns * np.arange(steps) / steps)
            velocity = np.concatenate([[0.0], np.cumsum(force)[:-1]]) * T / mass
            velocity -= velocity.mean()
            found.append(float((force * velocity).sum() / (force**2).sum()))
        row = {"part": "mass", "mass_kg": mass, "formula": -T / (2 * mass)}
        rows.append(row | {"run_lowest": min(found), "run_highest": max(found)})
    return rows


# Of a device and the coupling to its tool: K in N/m, B and b in N.s/m; T is that of all rows.
COUPLINGS = (
    (500.0, 0.5, 2.0),
    (1000.0, 1.4, 2.0),
    (1000.0, 0.2, 2.0),
    (1000.0, 0.12, 2.0),
    (1000.0, 0.035, 2.0),
    (1000.0, 0.02, 2.0),
    (200.0, 0.01, 0.8),
    (10_000.0, 1.0, 20.0),
    (10_000.0, 0.3, 20.0),
)
HEAVIER = 1e4


def least_passive_mass_kg(stiffness: float, coupling: float, damping: float, t: float = T) -> float:
    """Lightest semi-implicit mass behind a coupling that is passive to a device's hand; infinite where none is.

    Largest of M(q) T/2 over q = cot(omega T/2)^2: M(0), or the largest root of the discriminant of p(q) = 0, where two
    roots q meet; see the page for p.
    """
    b, k = damping, stiffness * t / 2
    c = coupling + k
    if c >= b or k**2 > 4 * b * coupling:
        return math.inf
    s = 2 * c * k + coupling**2
    # Polynomials in M, those of q^3, q^2, q and 1.
    three = np.poly1d([b * k**2])
    two = np.poly1d([k**2 - 2 * b * k, b * (s + k**2)])
    one = np.poly1d([b + coupling - k, s - 2 * b * (c + k), b * (c**2 + s)])
    none = np.poly1d([b - c, c**2 - 2 * b * c, b * c**2])
    discriminant = (
        18 * three * two * one * none
        - 4 * two * two * two * none
        + two * two * one * one
        - 4 * three * one * one * one
        - 27 * three * three * none * none
    )
    masses = [b * c / (b - c)]
    for root in discriminant.roots:
        if abs(root.imag) < 1e-6 * abs(root):
            # The two nearest of the three are those that meet.
            q = np.roots([float(part(root.real)) for part in (three, two, one, none)])
            apart = {(i, j): abs(q[i] - q[j]) for i in range(3) for j in range(i)}
            i, j = min(apart, key=lambda pair: apart[pair])
            if (q[i] + q[j]).real > 0:
                masses.append(float(root.real))
    return t / 2 * max(masses)


def lowest_real_part(stiffness: float, coupling: float, damping: float, mass: float) -> float:
    """Lowest b + Re(Z/z) on the unit circle over b: Z = C/(1 + C Y), put together from C and Y, not from p(q)."""
    theta = np.concatenate([np.geomspace(1e-5, 0.1, 20_000), np.linspace(0.1, math.pi, 20_000)])
    z = np.exp(1j * theta)
    joined, moved = coupling + stiffness * T * z / (z - 1), T / (mass * (z - 1))
    return float((1 + (joined / (1 + joined * moved) / z).real / damping).min())


def least_mass() -> list[Row]:
    """Least mass of a tool for passivity in closed form, against the unit circle and the package's loops."""
    rows = []
    for stiffness, coupling, damping in COUPLINGS:
        mass, c = least_passive_mass_kg(stiffness, coupling, damping), coupling + stiffness * T / 2
        told = (stiffness, coupling, damping)
        row: Row = {"part": "least_mass", "stiffness_n_per_m": stiffness, "damping_ns_per_m": coupling}
        row |= {"device_damping_ns_per_m": damping, "nyquist_kg": T / 2 * damping * c / (damping - c)}
        row |= {"needed_coupling_ns_per_m": (stiffness * T) ** 2 / (16 * damping)}
        if math.isinf(mass):
            masses = row["nyquist_kg"] * np.geomspace(1, HEAVIER, 40)
            row |= {"least_kg": None, "best_of_heavier": max(lowest_real_part(*told, float(one)) for one in masses)}
        else:
            above = [lowest_real_part(*told, mass * float(one)) for one in (1.001, *np.geomspace(1.01, HEAVIER, 20))]
            pole = max(abs(np.roots([1, T * c / mass + stiffness * T**2 / (2 * mass) - 2, 1 - T * coupling / mass])))
            row |= {"least_kg": mass, "below": lowest_real_part(*told, 0.999 * mass), "above": min(above)}
            row |= {"pole": float(pole), "stable": _stable_with_hands(*told, mass)}
        rows.append(row)
    return rows


def _stable_with_hands(stiffness: float, coupling: float, damping: float, mass: float) -> bool:
    """Whether the package finds every loop stable with that tool, with its default hands and released."""
    device = f"[device]\nmass_kg = 0.12\ndamping_ns_per_m = {damping}\n"
    problem = avc.parse_problem(f"{device}[simulation]\ntool_mass_kg = {mass!r}\nstep_s = {T}\n")
    return ToolLoops(problem).stable(ToolGains(stiffness, coupling))


def second_device() -> list[Row]:
    """Damping that both devices of a sampled teleoperator need, against the closed form."""
    rows = []
    for stiffness, delay in ((500.0, 0), (500.0, 5), (2000.0, 20)):
        ours = damping_needed_ns_per_m(Teleoperator(0.0, 0.0, T, delay, delay), ToolGains(stiffness, 0.0))
        told = stiffness * T / 2 + stiffness * (2 * delay * T + T) / 2
        row = {"part": "teleoperation", "stiffness_n_per_m": stiffness, "delay_samples": delay}
        rows.append(row | {"published": told, "ours": ours})
    return rows


# A measured region: a haptic paddle

DEGREE = math.pi / 180
PADDLE_T, PADDLE_RATIO, PADDLE_FILTER_HZ, PADDLE_STEP_DEG = 350e-6, 15.0, 50.0, 0.024
FRICTION_NM = (1.0e-3, 1.2e-3, 1.5e-3, 1.8e-3)
MEASURED = {  # B in N.m.s/deg: K in N.m/deg, as the code that measured it has both
    0.000: (1.8, 5.4, 5.2, 3.0),
    0.002: (2.4, 5.8, 5.8, 4.0),
    0.004: (2.8, 5.8, 6.2, 4.0),
    0.006: (3.0, 5.4, 6.2, 3.8),
    0.008: (2.4, 4.8, 5.8, 3.2),
    0.010: (2.2, 4.4, 5.6, 2.4),
    0.012: (1.8, 2.4, 5.2, 2.0),
    0.014: (1.2, 1.6, 4.8, 1.2),
    0.016: (0.1, 0.8, 4.0, 0.8),
}
INERTIAS_KGM2 = (1e-4, 4e-4, 1e-3)
FINGERS = {"released": (0.0, 0.0, 0.0), "light": (2.5e-4, 1.5e-3, 0.25), "firm": (1.5e-3, 0.025, 2.5)}
PADDLE_DAMPING = 4.5e-5


def paddle() -> list[Row]:
    """Stiffest wall of a paddle by linear stability, over assumed inertias and fingers, beside what was measured."""
    damping = np.array(list(MEASURED)) / DEGREE
    tau = 1 / (2 * math.pi * PADDLE_FILTER_HZ)
    share = tau / (tau + PADDLE_T)
    limits: dict[str, list[list[float | None]]] = {}
    for who, finger in FINGERS.items():
        hand = Hand(*(np.array([value]) for value in finger))
        for inertia in INERTIAS_KGM2:
            device = Device(mass_kg=inertia, damping_ns_per_m=PADDLE_DAMPING, sample_time_s=PADDLE_T)
            found = stable_walls([device], hand, damping, (-share, 0.0)).first_n_per_m * DEGREE
            limits.setdefault(who, []).append([_number(value) for value in found])
    rows = []
    for place, (b, measured) in enumerate(MEASURED.items()):
        spans = {who: [each[place] for each in of] for who, of in limits.items()}
        jump = (measured[0] + (1 - share) * b / PADDLE_T) * PADDLE_STEP_DEG
        row = {"part": "paddle", "damping_nms_per_deg": b, "measured_nm_per_deg": measured, "stable_nm_per_deg": spans}
        rows.append(row | {"torque_of_a_step_nm": jump})
    return rows


PADDLE_TRIED = (0.25, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0)
SLOW_RAD_PER_S = 0.07


def paddle_scenes() -> list[Row]:
    """Stiffest wall at which a finger comes to rest in the package's scenes, with encoder, dry friction and filter."""
    fingers = Hand(*(np.array(column) for column in zip(FINGERS["light"], FINGERS["firm"], strict=True)))
    rows = []
    for b in MEASURED:
        rests: list[float | None] = [None, None]
        going = [True, True]
        for stiffness in PADDLE_TRIED:
            found = avc.simulate_batch(paddle_problem(stiffness, b), fingers, NO_COUPLING)
            for who, speed in enumerate(found.peak_velocity_m_per_s):
                going[who] = going[who] and bool(speed < SLOW_RAD_PER_S)
                rests[who] = stiffness if going[who] else rests[who]
            if not any(going):
                break
        rows.append({"part": "paddle_scenes", "damping_nms_per_deg": b, "light": rests[0], "firm": rests[1]})
    return rows


def paddle_problem(stiffness: float, damping: float) -> avc.Problem:
    """Problem of the paddle, N.m/deg and N.m.s/deg, in the numbers of its turn; the wall begins at 0."""
    effects = ("hand", "wall", "encoder", "coulomb-friction")
    return avc.parse_problem(
        f"[device]\nmass_kg = {INERTIAS_KGM2[1]}\ndamping_ns_per_m = {PADDLE_DAMPING}\nsample_time_s = {PADDLE_T}\n"
        f"coulomb_friction_n = {PADDLE_RATIO * FRICTION_NM[1]}\nencoder_resolution_m = {PADDLE_STEP_DEG * DEGREE}\n"
        f"[environment]\ndamping_ns_per_m = {damping / DEGREE}\nstiffness_n_per_m = {stiffness / DEGREE}\n"
        "[scene]\nduration_s = 1.5\ncoupling = 'none'\n"
        "[scene.motion]\nkind = 'press'\nstart_m = -0.02\nend_m = 0.3\nspeed_m_per_s = 1.0\n"
        + "".join(f"[[scene.effects]]\nkind = '{kind}'\n" for kind in effects)
        + f"[[scene.effects]]\nkind = 'velocity-filter'\ncutoff_hz = {PADDLE_FILTER_HZ}\n"
    )


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


# The page

_HEAD = """
Each claim of stability and passivity beside what others published: their formula or figure, ours, and where the two
part and why. *Second way* is code of this study that shares nothing with the package. What could only be read about,
not read, is told as such.
"""

_RULE = """
## The linear rule for stability, with delay and a hand

J. J. Gil, A. Avello, A. Rubio, J. Florez, Stability analysis of a 1 DOF haptic interface using the Routh-Hurwitz
criterion, IEEE Trans. Control Systems Technology 12(4), 583-588 (2004). T. Hulin, C. Preusche, G. Hirzinger,
Stability boundary for haptic rendering: influence of physical damping, Proc. IEEE/RSJ IROS, 1570-1575 (2006). J. J.
Gil, E. Sanchez, T. Hulin, C. Preusche, G. Hirzinger, Stability boundary for haptic rendering: influence of damping
and delay, J. Computing and Information Science in Engineering 9(1), 011005 (2009). For short delays, fast sampling
and relatively little damping (their words), with the hand's damping beside the device's:

    K < (b + b_h + B)/(T/2 + t_d)

Ours is exact for the linear loop (`avc zwidth`, `stable_walls`). Device 0.1 kg, 1 N.s/m, T 1 ms; hand 0.2 kg, 5
N.s/m, 300 N/m; d samples of delay. Stiffest wall, ours over the rule's; a dash: no wall of this damping is stable.
"""

_RULE_PARTS = """
The wall's damper comes late: T/2 by its difference, T/2 by the hold, and t_d. Let y = B (T + t_d)/(m + m_h). Here the
rule is never too high by more than {share} y of itself; the largest y with a stable wall is {last}, the least with
none {none}. It knows no mass: a hand's makes the same damping go further. At B = 0 it is up to {low} % too low (long
delay): there the device's damping over its mass, and the hand's spring, count too. So `avc zwidth` draws it beside
the region, and judges by none of it.
"""

_UNDAMPED = """
Without damping of the device and without delay, alpha = K T^2/m and beta = B T/m, the loop's polynomial is

    z^3 + (-2 + (alpha + beta)/2) z^2 + (1 + alpha/2) z - beta/2

The criterion of Routh and Hurwitz, by which Gil et al. (2004) work, ends at alpha < 2 beta (2 - beta)/(2 + beta),
worked out here anew: at most 0.686, at beta = 2 sqrt 2 - 2, and nothing from beta = 2 on. The rule says alpha < 2
beta.
"""

_PASSIVE = """
## Passive walls: hold, filtered velocity, delay

J. E. Colgate, G. G. Schenkel, Passivity of a class of sampled-data systems: application to haptic interfaces, Proc.
American Control Conf., 3236-3240 (1994); J. Robotic Systems 14(1), 37-47 (1997): b > K T/2 + |B|. With a velocity
that passes a first-order low pass of time constant tau: J. M. Brown, A theoretical and experimental investigation
into the factors affecting the Z-width of a haptic display, master's thesis, Northwestern University (1995), appendix
A (lims.mech.northwestern.edu/papers/brown95); J. E. Colgate, J. M. Brown, Factors affecting the Z-width of a haptic
display, Proc. IEEE ICRA, 3205-3210 (1994). The appendix was read without its formulas, which are pictures: its steps
(backward difference, worst cos wT at either end, one condition for each sign of B) lead to b > K T/2 + B T/(T + 2
tau) and b > K T/2 - B. With delay, for B = 0: N. Diolaiti, G. Niemeyer, F. Barbagli, J. K. Salisbury, Stability of
haptic rendering: discretization, quantization, time delay, and Coulomb effects, IEEE Trans. Robotics 22(2), 256-268
(2006): K <= 2 b/((1 + 2 d) T).

Device 2 N.s/m, T 1 ms. Stiffest passive wall, N/m. Second way: a hand moves straight between samples, through
cos(theta k) for many theta (of all motions with these samples the one that loses least to the device); told is the
damping that keeps it from gaining energy at our wall, to be compared with the device's 2 N.s/m.
"""

_PASSIVE_PARTS = """
They do not part: relative difference at most {part:.0e}. The package has walls of B >= 0 only, so the second
condition of Brown never binds alone. A filter widens the passive region, and makes the damper later: `avc zwidth`
draws the stable region beside it. The share of the old velocity is exp(-T/tau) in the package's scenes, exact over a
sample, and tau/(T + tau) by Brown's backward difference; the formula holds for any share with T/(T + 2 tau) = (1 -
share)/(1 + share).
"""

_QUANTISED = """
## Encoder and dry friction

J. J. Abbott, A. M. Okamura, Effects of position quantization and sampling rate on virtual-wall passivity, IEEE Trans.
Robotics 21(5), 952-964 (2005): a spring K on a mass with viscous and dry friction is passive if and only if K <=
min(2 b/T, 2 f_c/Delta). `avc zwidth` tells both ends. Second way: a hand taps across the edges of the encoder, from
100 places over 1001 distances; told is the stiffest spring of which it gets no energy.
"""

_QUANTISED_PARTS = """
They do not part; the tapping hand is drawn on a grid, so that its limit may lie a little above. It is no limit for
walls with B > 0 (a damper's force jumps by B Delta/T with a step of the encoder; neither they nor the package's
formula have it) and none of stability:

### The regions of Diolaiti and others

Their abstract: nonlinear effects create distinct regions, and many devices work stably in violation of passivity. A
plain simulation (0.1 kg, 2 N.s/m, T 1 ms, encoder 50 um, 40 parts a sample, 2 s): a device on a spring is released 3
and 2000 steps of the encoder away. Viscous limit 2 b/T = 4000 N/m, Coulomb limit 2 f_c/Delta.
"""

_REGIONS_PARTS = """
So it is: below both limits everything rests; above the Coulomb limit alone a small cycle stays; above the viscous
limit alone friction holds small motions and large ones grow; and from 3 steps everything rests, passive or not. The
package claims passivity below the viscous limit alone (L3), tells the Coulomb limit beside it, and leaves what rests
to trials with the declared friction and encoder.
"""

_LLEWELLYN = """
## Virtual couplings

R. J. Adams, B. Hannaford, Stable haptic interaction with virtual environments, IEEE Trans. Robotics and Automation
15(3), 465-474 (1999), after F. B. Llewellyn, Some fundamental properties of transmission systems, Proc. IRE 40(3),
271-283 (1952): 2 Re h11 Re h22 >= |h12 h21| + Re(h12 h21); for an impedance display h11 = Z_d, h12 is the hold, h21 =
-1, h22 = 1/Z_c. *Theirs* is that criterion on 9000 frequencies, bisected over k_c; ours is the package's closed
search. k_c T/b_d against b_c/b_d, with the printed hold (z + 1)/(2z) and with that of a device, 1/z.
"""

_LLEWELLYN_PARTS = """
They agree within {part:.0e} (b_c = 0 binds at zero frequency, where the grid does not reach). The printed hold allows
four times what a device's hold does: with it the criterion passes loops that
[diverge](../../avc_casadi/claims/README.md#the-papers-criterion-can-pass-while-the-loop-diverges). Devices and
couplings of their tables are not compared: their numbers were not at hand.
"""

_MASS = """
## The least mass of a tool

J. M. Brown, J. E. Colgate, Minimum mass for haptic display simulations, Proc. ASME IMECE, DSC-Vol. 64, 249-256
(1998). The abstract: an operator that is passive in discrete time must be implicit, and an explicit one needs a least
mass, derived for several pairs of integrator and coupling. **The paper's text could not be read: none of its formulas
is quoted, and what stands here is derived here.** That no explicit mass is passive by itself follows from T/(m (z -
1)), whose real part is -T/(2 m) at every frequency. A run of such a mass says the same, force times velocity over
whole periods:
"""

_MASS_PARTS = """
So the device's damping b has to pay. Derived here: a mass m moved semi-implicitly, v_t(n+1) = v_t(n) + T F(n)/m and
x_t(n+1) = x_t(n) + T v_t(n+1), behind F(n) = K (x - x_t) + B (v - v_t) of the newest sample, v its backward
difference; one step a sample, no delay. From v to F this is Z = C/(1 + C Y), with C = B + K T z/(z - 1) and Y = T/(m (z
- 1)). The device holds F for a sample, and Colgate and Schenkel's condition becomes

    b + Re(Z/z) >= 0 on the unit circle, Z without a pole outside

Let k = K T/2, c = B + k, M = 2 m/T, q = cot(omega T/2)^2, L = c + k q and S = L^2 + B^2 q. Multiplied out it is

    p(q) = ((b + B - k) q + b - c) M^2 - (2 b (q + 1) L - S) M + b (q + 1) S >= 0

a quadratic in M at each frequency and a cubic in q for each mass. Three answers follow:

- c >= b, or B < K^2 T^2/(16 b): **no mass** is passive. With too little B the hold of K feeds the swing of the tool on
  K, however heavy it is. (M(q) grows with q; for large q its roots are real where k^2 > 4 b B.)
- At the Nyquist frequency, q = 0: m >= (T/2) b c/(b - c), which is b/(b - c) times the mass (T/2) c below which the
  tool swings up by itself with the device held.
- Where a lower frequency asks for more, the largest M at which two roots q > 0 of p meet: the largest such root of
  the discriminant, a polynomial of degree six.

The lightest passive tool is the largest of the last two. Second way: b + Re(Z/z) on 40,000 points of the circle, put
together from C and Y, lowest value over b.
"""

_LEAST_PARTS = """
0.1 % below the least mass the lowest is negative in each row that has one; from 0.1 % above it to {heavier:g} times of
it nowhere. Where there is none, it is negative with every mass of 40 from that of Nyquist to {heavier:g} times of it.
The package's loops are stable with each least mass, its hands and released, as they must be: {stable} of {all}. More
of the bound at Nyquist, with lighter tools that are stable all the same: [engine
boundaries](RESULTS_engine_boundaries.md#minimum-mass).
"""

_TELE = """
## A second device

A. Jazayeri, M. Tavakoli, A passivity criterion for sampled-data bilateral teleoperation systems, IEEE World Haptics
Conf. (2011); IEEE Trans. Haptics 6(3) (2013). Without B both devices need b >= K T/2 + K (tau + T)/2, tau the delay
of the round trip. More of it, Lee and Spong, Nuno et al., and known schemes on the same hands:
[teleoperation](RESULTS_teleoperation.md).
"""

_MODES = """
## Two modes of vibration

J. J. Gil, M. J. Puerto, I. Diaz, E. Sanchez, On the Z-width limitation due to the vibration modes of haptic
interfaces, Proc. IEEE/RSJ IROS (2010): a linear model of an axis of a PHANToM 1.0 with two modes, its boundary and
measurements. I. Diaz, J. J. Gil, Influence of vibration modes and human operator on the stability of haptic
rendering, IEEE Trans. Robotics 26(1), 160-165 (2010): one mode and a hand, eleven parameters. **Not compared**: of
both only the beginning was at hand, without parameters; and a device of the package has one resonance, so that two
modes cannot be declared. With one, regions agree with spectral radii of loops put together apart ([stable
walls](RESULTS_stable_walls.md), `reference-r1`).
"""

_PADDLE = """
## A measured region: a haptic paddle

Firmware of a students' project on EPFL's course paddle, and its plot script of measured K-B regions (public on
GitHub, Apache 2.0, header "EPFL-REHAssist", 2021; the repository's name is not known to us). By the code: T 350 us,
transmission {ratio:g}, backward difference through a first-order low pass of {filter:g} Hz, a wall at 15 degrees, dry
friction of the motor 1.0 to 1.2 mN.m moving and 1.5 to 1.8 at rest, viscous 7.9e-7 N.m.s/deg. A step of the encoder
is about {step:g} degrees of the paddle. K in N.m/deg and B in N.m.s/deg are the code's; the script's axes say N/mm
and N.s/mm. Compensation of friction is off by default. Inertia, finger and what counted as unstable are not
published.

*Linear* is the stiffest stable wall with that filter, lowest to highest over inertias of {inertias} kg.m2, a dash
where none is stable. *Scenes* have encoder, dry friction ({friction:g} N.m) and filter, {inertia:g} kg.m2; a finger
presses, and rests if it is slower than {slow:g} rad/s at the end (5 mm/s at 70 mm); the stiffest K of {tried} up to
which it rests. Fingers: light 2.5e-4 kg.m2, 0.0015 N.m.s/rad, 0.25 N.m/rad; firm 1.5e-3, 0.025, 2.5. All that is not
published is assumed.
"""

_PADDLE_PARTS = """
- **B = 0.** Without a damper an estimator of velocity should not matter, and the four differ threefold: the code
  gives each estimator's *position* to the spring as well. The backward difference alone takes the encoder's: only its
  column is this model. Its 1.8 N.m/deg lies between the light finger's linear limit, {light}, and the firm one's,
  {firm}; 2 f_c/Delta is {low} to {high} over the four frictions. Scenes hold more, {scene}. Which stops the real one
  cannot be told without its finger.
- **To B = 0.006** the measured wall rises, as the linear one does.
- **From there on linear stability does not tell it.** It falls to nothing at 0.016, where the linear one holds or
  rises with either finger. Scenes fall too: light {light_from} to {light_to}, firm {firm_from} to {firm_to} from
  0.006 to 0.016. What they have and the linear loop has not is the encoder: one step makes the torque jump by
  `(K + (1 - share) B/T) Delta`. Along the measured edge from 0.006 on that jump hardly changes, {jump_low} to
  {jump_high} N.m, which speaks for an edge of quantisation; it is read off the edge, not predicted.
- **At B = 0.016** scenes hold walls where the measured one is 0.1: finger, inertia, what counted as unstable,
  compliance of the cable and play are not known, and the code starts each sample with the last torque of the motor,
  which adds a fifteenth of the torque before.
- `avc zwidth` alone would mislead here. Its encoder limit is one of springs; walls with B on a coarse encoder need a
  trial.
"""


def page(made: dict[str, Any], rows: list[Row]) -> str:
    """Return the page in Markdown."""
    part: dict[str, list[Row]] = {}
    for row in rows:
        part.setdefault(row["part"], []).append(row)
    for name in ("rule", "undamped", "passive", "quantised", "llewellyn", "teleoperation"):
        for row in part[name]:
            ours, told = (row.get(key, row.get(f"{key}_n_per_m")) for key in ("ours", "published"))
            row["ratio"] = None if ours is None else ours / told
    apart = {
        name: max(abs(r["ratio"] - 1) for r in part[name])
        for name in part
        if "ratio" in part[name][0] and name != "rule"
    }
    sections = [
        f"# Beside what others published\n\n{made_by(made)}\n{_HEAD}",
        _summary(part, apart),
        *_stability(part),
        *_passivity(part, apart),
        *_couplings(part, apart),
        *_paddle(part["paddle"], part["paddle_scenes"]),
    ]
    return "\n".join(sections)


def _summary(part: dict[str, list[Row]], apart: dict[str, float]) -> str:
    held = {r["delay_samples"]: r["ratio"] for r in part["rule"] if r["hand"] == "held" and r["damping_ns_per_m"] == 5}
    loose = [r["ratio"] for r in part["rule"] if r["ratio"] is not None]
    energy = max(abs(r["damping_by_energy_ns_per_m"] / LOSSY - 1) for r in part["passive"])
    masses = [r for r in part["least_mass"] if r["least_kg"] is not None and r["below"] < 0 <= r["above"]]
    taps = max(abs(r["tapping_n_per_m"] / r["published_n_per_m"] - 1) for r in part["quantised"])
    rows = [
        (
            "stable walls, delay 0 to 10 samples, with a hand",
            "Gil et al. 2004, 2009; Hulin et al. 2006",
            (
                f"ours / rule {held[0]:.3f} (no delay) to {held[10]:.3f} (10 samples) with a hand and B 5; "
                f"{min(loose):.2f} to {max(loose):.2f} of all"
            ),
            f"30 digits: the radius crosses 1 within {NEAR:g} of ours",
            "the rule is for short delays and little damping, and knows no mass",
        ),
        ("stable walls, no damping", "Routh-Hurwitz", f"the same to {apart['undamped']:.0e}", "-", "-"),
        (
            "passive walls; filtered velocity; delay",
            "Colgate and Schenkel 1997; Brown 1995; Diolaiti et al. 2006",
            f"the same to {apart['passive']:.0e}",
            f"energy of a hand: within {energy:.0e}",
            "-",
        ),
        (
            "encoder and dry friction",
            "Abbott and Okamura 2005; Diolaiti et al. 2006",
            "the same",
            f"a hand that taps: within {taps:.0e}; regions simulated",
            "no limit of stability, none for B > 0",
        ),
        (
            "virtual couplings",
            "Llewellyn 1952; Adams and Hannaford 1999",
            f"the same to {apart['llewellyn']:.0e}",
            "the criterion on a grid",
            "the grid's lowest frequency",
        ),
        (
            "least mass of a tool",
            "Brown and Colgate 1998",
            "derived here: (T/2) b c/(b - c), c = B + K T/2, or more; none for B < K^2 T^2/(16 b)",
            f"positive realness on the unit circle: sign changes within 0.1 % in {len(masses)} of {len(masses)}",
            "the paper's text could not be read",
        ),
        (
            "a second device",
            "Jazayeri and Tavakoli 2013",
            f"the same to {apart['teleoperation']:.0e}",
            "[simulated](RESULTS_teleoperation.md)",
            "-",
        ),
        (
            "two modes of vibration",
            "Gil et al. 2010",
            "not compared",
            "-",
            "values not found; the package has one mode",
        ),
        (
            "a measured region",
            "EPFL students' paddle",
            "linear: rises where theirs falls; scenes fall with theirs",
            "-",
            "the encoder's steps through the damper; inertia and finger not published",
        ),
    ]
    return table(("claim", "published by", "ours", "second way", "where they part"), rows)


def _stability(part: dict[str, list[Row]]) -> list[str]:
    found = {(r["hand"], r["delay_samples"], r["damping_ns_per_m"]): r for r in part["rule"]}
    head = ("", "B, N.s/m", *(f"d = {delay}" for delay in DELAYS))
    rows = [
        (who, f"{b:g}", *(_short(found[who, delay, b]["ratio"]) for delay in DELAYS))
        for who in HANDS
        for b in WALL_DAMPINGS
    ]
    crossed = [r["radius_below_and_above"] for r in part["rule"] if "radius_below_and_above" in r]
    agree = sum(below < 0 < above for below, above in crossed)
    second = (
        f"Second way: roots of the characteristic polynomial to 30 digits (mpmath), with {NEAR:g} less and more of the "
        f"wall: the largest is below 1, then above, at {agree} of {len(crossed)} walls that were tried."
    )
    stable = [r for r in part["rule"] if r["ratio"] is not None]
    told = {
        "low": f"{100 * (max(r['ratio'] for r in stable) - 1):.0f}",
        "share": f"{max((1 - r['ratio']) / r['late_damper'] for r in stable if r['late_damper'] > 0):.2f}",
        "last": f"{max(r['late_damper'] for r in stable):.2g}",
        "none": f"{min(r['late_damper'] for r in part['rule'] if r['ratio'] is None):.2g}",
    }
    undamped_rows = [
        (f"{r['beta']:.4g}", f"{r['published']:.6g}", f"{r['ours']:.6g}", f"{2 * r['beta']:.4g}")
        for r in part["undamped"]
    ]
    return [
        _RULE,
        table(head, rows),
        "",
        second,
        _RULE_PARTS.format(**told),
        _UNDAMPED,
        table(("beta", "alpha, polynomial", "alpha, ours", "alpha, rule"), undamped_rows),
    ]


def _passivity(part: dict[str, list[Row]], apart: dict[str, float]) -> list[str]:
    walls = [
        (
            f"{r['damping_ns_per_m']:g}",
            "-" if r["filter_hz"] is None else f"{r['filter_hz']:g}",
            r["delay_samples"],
            f"{r['published_n_per_m']:.6g}",
            f"{r['ours_n_per_m']:.6g}",
            f"{r['damping_by_energy_ns_per_m']:.5f}",
        )
        for r in part["passive"]
    ]
    steps = [
        (
            f"{r['friction_n']:g}",
            f"{1e6 * r['step_m']:g}",
            *(f"{r[key]:.5g}" for key in ("published_n_per_m", "ours_n_per_m", "tapping_n_per_m")),
        )
        for r in part["quantised"]
    ]
    ends = [
        (
            f"{r['stiffness_n_per_m']:g}",
            f"{2 * r['friction_n'] / STEP:g}",
            *("below" if one else "above" for one in r["below_viscous_and_coulomb"]),
            f"{r['start_steps']:g}",
            r["ends"] + (f", {r['swing_steps']:.1f} steps" if r["swing_steps"] else ""),
        )
        for r in part["regions"]
    ]
    return [
        _PASSIVE,
        table(("B, N.s/m", "filter, Hz", "delay", "published", "ours", "damping by energy, N.s/m"), walls),
        _PASSIVE_PARTS.format(part=apart["passive"]),
        _QUANTISED,
        table(("f_c, N", "Delta, um", "published, N/m", "ours", "tapping hand"), steps),
        _QUANTISED_PARTS,
        table(("K, N/m", "2 f_c/Delta", "viscous limit", "Coulomb limit", "start, steps", "ends"), ends),
        _REGIONS_PARTS,
    ]


def _couplings(part: dict[str, list[Row]], apart: dict[str, float]) -> list[str]:
    pairs = [(r["hold"], f"{r['ratio_b']:g}", f"{r['published']:.5f}", f"{r['ours']:.5f}") for r in part["llewellyn"]]
    masses = [
        (f"{r['mass_kg']:g}", *(f"{r[key]:.6g}" for key in ("formula", "run_lowest", "run_highest")))
        for r in part["mass"]
    ]
    devices = [
        (f"{r['stiffness_n_per_m']:g}", r["delay_samples"], f"{r['published']:.6g}", f"{r['ours']:.6g}")
        for r in part["teleoperation"]
    ]
    return [
        _LLEWELLYN,
        table(("hold", "b_c/b_d", "theirs", "ours"), pairs),
        _LLEWELLYN_PARTS.format(part=apart["llewellyn"]),
        _MASS,
        table(("mass, kg", "-T/(2 m), s/kg", "run, lowest of three frequencies", "highest"), masses),
        _MASS_PARTS,
        *_least(part["least_mass"]),
        _TELE,
        table(("K, N/m", "samples each way", "published, N.s/m", "ours"), devices),
        _MODES,
    ]


def _least(rows: list[Row]) -> list[str]:
    found = [r for r in rows if r["least_kg"] is not None]
    lines = [
        (
            f"{r['stiffness_n_per_m']:g}",
            f"{r['damping_ns_per_m']:g}",
            f"{r['device_damping_ns_per_m']:g}",
            rounded(r["needed_coupling_ns_per_m"]),
            rounded(r["nyquist_kg"]),
            rounded(r["least_kg"], 4) if r in found else "none",
            f"{r['below']:.0e}" if r in found else f"{r['best_of_heavier']:.0e} at best",
            f"{r['above']:.0e}" if r in found else "-",
        )
        for r in rows
    ]
    head = "K, N/m|B, N.s/m|b, N.s/m|least B|at Nyquist, kg|least mass, kg|lowest, 0.1 % lighter|heavier"
    counts = {"stable": sum(r["stable"] for r in found), "all": len(found)}
    return [table(tuple(head.split("|")), lines), _LEAST_PARTS.format(heavier=HEAVIER, **counts)]


def _paddle(rows: list[Row], scenes: list[Row]) -> list[str]:
    def span(values: list[float | None]) -> str:
        known = [value for value in values if value is not None]
        if not known:
            return "-"
        least = "-" if len(known) < len(values) else rounded(min(known), 2)
        return least if least == rounded(max(known), 2) else f"{least} to {rounded(max(known), 2)}"

    def held(value: float | None) -> str:
        return "-" if value is None else f"{value:g}" + (" or more" if value == PADDLE_TRIED[-1] else "")

    lines = [
        (
            f"{r['damping_nms_per_deg']:g}",
            *(f"{value:g}" for value in r["measured_nm_per_deg"]),
            *(span(r["stable_nm_per_deg"][who]) for who in FINGERS),
            held(scene["light"]),
            held(scene["firm"]),
            f"{r['torque_of_a_step_nm']:.3f}",
        )
        for r, scene in zip(rows, scenes, strict=True)
    ]
    springs, late = rows[0]["stable_nm_per_deg"], [r for r in rows if r["damping_nms_per_deg"] >= 0.006]
    falls = [scene for scene in scenes if scene["damping_nms_per_deg"] >= 0.006]
    limits = [2 * PADDLE_RATIO * friction / PADDLE_STEP_DEG for friction in FRICTION_NM]
    told = _PADDLE.format(
        ratio=PADDLE_RATIO,
        filter=PADDLE_FILTER_HZ,
        step=PADDLE_STEP_DEG,
        inertias=", ".join(f"{value:g}" for value in INERTIAS_KGM2),
        inertia=INERTIAS_KGM2[1],
        friction=PADDLE_RATIO * FRICTION_NM[1],
        slow=SLOW_RAD_PER_S,
        tried=", ".join(f"{value:g}" for value in PADDLE_TRIED),
    )
    why = _PADDLE_PARTS.format(
        light=rounded(max(springs["light"]), 2),
        firm=rounded(max(springs["firm"]), 2),
        low=f"{min(limits):.3g}",
        high=f"{max(limits):.3g}",
        scene=held(scenes[0]["light"]),
        light_from=held(falls[0]["light"]),
        light_to=held(falls[-1]["light"]),
        firm_from=held(falls[0]["firm"]),
        firm_to=held(falls[-1]["firm"]),
        jump_low=f"{min(r['torque_of_a_step_nm'] for r in late):.3f}",
        jump_high=f"{max(r['torque_of_a_step_nm'] for r in late):.3f}",
    )
    ways = (*(f"linear, {who}" for who in FINGERS), "scenes, light", "scenes, firm")
    head = ("B", "backward difference", "FOAW", "Levant", "Kalman", *ways, "torque of a step, N.m")
    return [told, table(head, lines), why]


def _short(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def main() -> None:
    """Compute and write."""
    args = script_arguments(__doc__, out=RESULTS)
    made = about("python tests/benchmarks/published.py", 0)
    parts = (
        rule,
        undamped,
        passive,
        quantised,
        regions,
        llewellyn,
        explicit_mass,
        least_mass,
        second_device,
        paddle,
        paddle_scenes,
    )
    rows = [row for part in parts for row in part()]
    write_rows(args.out, made, rows)
    (HERE / "RESULTS_published.md").write_text(page(made, rows), encoding="utf-8")


if __name__ == "__main__":
    main()
