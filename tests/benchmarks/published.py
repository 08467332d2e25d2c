"""Published conditions and figures beside our claims of stability and passivity, and where the two part.

python tests/benchmarks/published.py [OUT]

Each row: their formula or figure, ours, and mostly a second way that shares no code with the package: roots to 30
digits (mpmath), the energy that a hand gets out of a held force, plain simulations. Takes half a minute. Overwrites OUT
(default tests/benchmarks/results/published.json), whose rows the tables of the page show.
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
from studied import about, write_rows

import avc_casadi as avc
from avc_casadi.claims.zwidth import passive_walls
from avc_casadi.loops.engine import ToolLoops
from avc_casadi.loops.walls import stable_walls
from avc_casadi.model.device import Device
from avc_casadi.model.ends import ToolGains
from avc_casadi.model.gains import NO_COUPLING
from avc_casadi.model.hands import Hand, no_hand

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
        wall = passive_walls([device], np.array([damping]), "sampled-data", poles=(-share, 0.0))
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


# The mass of an engine's tool

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


def main() -> None:
    """Compute and write."""
    args = script_arguments(__doc__, out=RESULTS)
    made = about("python tests/benchmarks/published.py", 0)
    parts = (rule, undamped, passive, quantised, regions, least_mass, paddle, paddle_scenes)
    rows = [row for part in parts for row in part()]
    write_rows(args.out, made, rows)


if __name__ == "__main__":
    main()
