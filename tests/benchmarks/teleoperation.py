"""Teleoperation: the limit of stability, recommended couplings and known schemes, simulated.

python tests/benchmarks/teleoperation.py [CASES] [OUT]

Three tables: K at which the loops' spectral radius passes 1 against K at which a plain simulation begins to grow, on
CASES random cases; recommended couplings with 200 hands; and position-position, wave variables and time-domain
passivity on the same hands. The simulation
(tests/oracle/teleoperator_lanes.py) shares no code with the project. Overwrites OUT (default
tests/benchmarks/results/teleoperation.json), which the page shows.
"""

from __future__ import annotations

import itertools
import math
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from script_arguments import script_arguments
from studied import about, write_rows

sys.path.insert(0, str(Path(__file__).parents[1] / "oracle"))
from teleoperator_lanes import Lanes, SpringAndDampers

import avc_casadi as avc
from avc_casadi.loops.follower import FollowerLoops
from avc_casadi.model.ends import ToolGains

HERE = Path(__file__).parent
RESULTS = HERE / "results" / "teleoperation.json"
SEED = 7
FACTORS = (0.95, 0.98, 0.99, 1.01, 1.02, 1.05)
DELAYS_S = (0.0, 0.005, 0.02)
LEADER, FOLLOWER, T, COMPUTING = (0.12, 0.8), (0.3, 1.0), 1e-3, 1
SECONDS, JUDGED_S, AT_REST_M_PER_S = 5.0, 0.5, 5e-3
IMPEDANCES, MARGIN = (3.0, 6.0, 12.0, 24.0), 1.5
CONTACTS = {"soft contact": 1000.0, "hard contact": math.inf}
Law = Callable[[float], Callable[[int], Any]]

# The limit of stability


@dataclass(frozen=True)
class Case:
    """Two devices, a hand, a contact and a link."""

    leader: tuple[float, float]
    follower: tuple[float, float]
    period: float
    hand: tuple[float, float, float]
    contact: tuple[float, float]
    delay: tuple[float, float]
    damping: float
    local: float

    def loops(self) -> FollowerLoops:
        m_h, b_h, k_h = self.hand
        k_c, b_c = self.contact
        return FollowerLoops(
            avc.parse_problem(
                f"[device]\nmass_kg = {self.leader[0]}\ndamping_ns_per_m = {self.leader[1]}\n"
                f"sample_time_s = {self.period!r}\ndelay_samples = {COMPUTING}\n"
                f"[follower]\nmass_kg = {self.follower[0]}\ndamping_ns_per_m = {self.follower[1]}\n"
                f"sample_time_s = {self.period!r}\ndelay_samples = {COMPUTING}\ndelay_s = {self.delay[0]}\n"
                f"return_delay_s = {self.delay[1]}\ncontact_stiffness_n_per_m = [{k_c}, {k_c}]\n"
                f"contact_damping_ns_per_m = {b_c}\n[hands]\nmass_kg = [{m_h}, {m_h}]\n"
                f"damping_ns_per_m = [{b_h}, {b_h}]\nstiffness_n_per_m = [{k_h}, {k_h}]\n"
            )
        )


def drawn(rng: np.random.Generator) -> Case:
    def log(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    period = log(0.5e-3, 2e-3)
    masses = log(0.05, 1.0), log(0.05, 1.0)
    dampers = log(0.1, 5.0), log(0.1, 5.0)
    delay = 0.0 if rng.random() < 0.15 else float(rng.uniform(0, 0.02))
    back = delay if rng.random() < 0.5 else float(rng.uniform(0, 0.02))
    return Case(
        (masses[0], dampers[0]),
        (masses[1], dampers[1]),
        period,
        (log(0.02, 1.0), log(0.5, 30.0), log(30.0, 2000.0)),
        (k_c := log(100.0, 0.3 * masses[1] / period**2), 0.2 * math.sqrt(k_c * masses[1])),
        (delay, back),
        masses[0] / max(period, delay + back) * log(0.02, 0.3),
        float(rng.choice([0.0, 0.5])) * dampers[0],
    )


def limit_of(case: Case) -> tuple[float, tuple[float, float, float], float] | None:
    """K at which the radius passes 1, and the hand and contact with which it does; None where no K is stable."""
    loops = case.loops()

    def gains(k: float) -> ToolGains:
        return ToolGains(k, case.damping, case.local)

    low, high = 1.0, 10 * case.leader[0] / case.period**2
    if not loops.stable(gains(low)) or loops.stable(gains(high)):
        return None
    while high > 1.0005 * low:
        middle = math.sqrt(low * high)
        low, high = (middle, high) if loops.stable(gains(middle)) else (low, middle)
    _, worst = loops.radius(gains(1.01 * high))
    return high, tuple(worst.hand.values()), worst.environment_n_per_m  # type: ignore[return-value]


def phases(case: Case) -> list[float]:
    """Four phases of the follower's clock, samples: one within each order of samples and arriving messages, and 0."""
    there, back = (delay / case.period for delay in case.delay)
    turns = sorted({0.0, there % 1, -back % 1, 1.0})
    middles = [(one + other) / 2 for one, other in itertools.pairwise(turns)]
    return [*middles, *[0.0] * (4 - len(middles))]


def boundary(count: int) -> list[dict[str, Any]]:
    """Compare both limits: does the plain simulation of the worst loop grow at each factor of K?"""
    rng = np.random.default_rng(SEED)
    cases = []
    while len(cases) < count:
        case = drawn(rng)
        if (found := limit_of(case)) is not None:
            cases.append((case, *found))
    lanes = [(c, f * k, hand, env, phase) for c, k, hand, env in cases for f in FACTORS for phase in phases(c)]
    period = np.array([one[0].period for one in lanes])
    spring = np.array([one[3] for one in lanes])
    damper = np.array([c.contact[1] if env > 0 else 0.0 for c, _, _, env, _ in lanes])
    run = Lanes(
        tuple(np.array([one[0].leader[i] for one in lanes]) for i in (0, 1)),
        tuple(np.array([one[0].follower[i] for one in lanes]) for i in (0, 1)),
        period,
        COMPUTING,
        tuple(np.array([one[2][i] for one in lanes]) for i in range(3)),
        (spring, damper),
        one_sided=False,
        delay=tuple(np.array([one[0].delay[i] for one in lanes]) / period for i in (0, 1)),
        phase=np.array([one[4] for one in lanes]),
    )
    samples = 12000
    law = SpringAndDampers(
        np.array([one[1] for one in lanes]),
        np.array([one[0].damping for one in lanes]),
        np.array([one[0].local for one in lanes]),
    )
    run.run(law, samples, np.zeros((samples, len(lanes))), kick=1e-12, ceiling=1e250)
    moved = np.abs(np.diff(run.x, axis=1)).max(axis=0)
    parts = np.log(np.maximum(_peaks(moved), 1e-300))
    grows = (parts[-1] > parts[len(parts) // 2]) | (parts[-1] > 500)
    each = grows.reshape(count, len(FACTORS), 4).any(axis=2)
    return [
        {"part": "boundary", "limit_n_per_m": k, "period_s": c.period, "delay_s": c.delay, "rigid": math.isinf(env)}
        | {
            "released": max(hand) == 0,
            "grows": dict(zip(map(str, FACTORS), map(bool, row), strict=True)),
        }
        for (c, k, hand, env), row in zip(cases, each, strict=True)
    ]


def _peaks(moved: np.ndarray) -> np.ndarray:
    """Largest in each of equal windows, shape (windows, lanes)."""
    window = 1000
    return moved[: len(moved) // window * window].reshape(-1, window, moved.shape[1]).max(axis=1)


# (c), (d) motions of many hands


class Waves:
    """Wave variables with an impedance b that is the follower's damper too: matched, so that waves are not reflected.

    Niemeyer and Slotine, IEEE J. Oceanic Engineering 16(1), 1991: u = (b v + F)/sqrt(2 b) there,
    w = (b v - F)/sqrt(2 b) back. The link is even; the follower integrates the wave into the place that it is led to.
    """

    def __init__(self, stiffness, impedance, lanes):
        self.k, self.b = stiffness, impedance
        self.u, self.w = [], []
        self.place, self.lanes = None, lanes

    def force(self, side, run, k):
        x, v = run.seen(side, k)
        root = np.sqrt(2 * self.b)
        # What is sent at this very sample has not been made yet: a wave is under way for a sample at least.
        newest = min(int(run.arrivals[side][k][0]), k - 1)
        wave = (self.w, self.u)[side][newest] if newest >= 0 else np.zeros(self.lanes)
        if side == 0:
            self.u.append(np.clip(root * v - wave, -1e6, 1e6))
            return root * wave - self.b * v
        if self.place is None:
            self.place = x.copy()
        # F = K (place - x) + b (v_d - v) with b v_d = sqrt(2 b) u - F, the place one step on.
        pull = self.k * (self.place - x) + root * wave - self.b * v
        wanted = pull / 2
        led = (root * wave - wanted) / self.b
        # What grows beyond all bounds has not settled, and need not overflow.
        self.place = np.clip(self.place + run.period * led, -1e3, 1e3)
        self.w.append(np.clip((self.b * led - wanted) / root, -1e6, 1e6))
        return wanted


class TimeDomain:
    """Spring and damper between positions, with a passivity observer and controller at each port.

    Ryu, Kwon and Hannaford, IEEE Trans. Robotics and Automation 20(2), 2004: each port adds up the energy that goes in,
    and sends the sum; where both together, the other's as it has arrived, are below 0 and a port gives energy out, a
    damper at that port takes the deficit back. No damper is beyond half the device's mass over T.
    """

    def __init__(self, stiffness, damping, lanes):
        self.k, self.b = stiffness, damping
        self.sums = [np.zeros(lanes), np.zeros(lanes)]
        self.sent = ([], [])

    def force(self, side, run, k):
        x, v = run.seen(side, k)
        far_x, far_v = run.arrived(side, k)
        t, mass = run.period, (LEADER, FOLLOWER)[side][0]
        newest = min(int(run.arrivals[side][k][0]), k - 1)
        known = self.sent[1 - side][newest] if newest >= 0 else 0.0
        pull = self.k * (far_x - x) + self.b * (far_v - v)
        own = self.sums[side] - pull * v * t
        active = (own + known < 0) & (pull * v > 0)
        damper = np.where(active, -(own + known) / np.maximum(t * v * v, 1e-30), 0.0)
        damper = np.minimum(damper, mass / (2 * t))
        self.sums[side] = own + damper * v * v * t
        self.sent[side].append(self.sums[side])
        return pull - damper * v


def hands(count: int) -> np.ndarray:
    """Corners of the default [hands] and draws between them, evenly in the logarithm, shape (count, 3)."""
    box = avc.parse_problem(
        "[device]\nmass_kg = 0.1\ndamping_ns_per_m = 1.0\n[follower]\nmass_kg = 0.1\ndamping_ns_per_m = 1.0"
    ).hands
    ends = [getattr(box, key) for key in ("mass_kg", "damping_ns_per_m", "stiffness_n_per_m")]
    corners = np.stack(np.meshgrid(*ends), axis=-1).reshape(-1, 3)
    low, high = (np.maximum([end[i] for end in ends], 1e-3) for i in (0, 1))
    rng = np.random.default_rng(SEED)
    inside = low * (high / low) ** rng.random((max(0, count - len(corners)), 3))
    return np.concatenate([corners, inside])[:count]


MOTIONS = {
    "free": lambda t: -0.02 + 0.008 * np.sin(4 * np.pi * np.minimum(t, 2.0)),
    "press": lambda t: np.minimum(-0.01 + 0.07 * t, 0.01),
    "tap": lambda t: np.minimum(-0.01 + 0.07 * t, 0.01) - 0.015 * np.abs(np.sin(2 * np.pi * np.minimum(t, 2.0))),
}


def lanes_of(people: np.ndarray, contact: float, delay_s: float, jitter: float = 0.0, lost: float = 0.0) -> Lanes:
    one = np.ones(len(people))
    damper = 0.0 if math.isinf(contact) else 0.2 * math.sqrt(contact * FOLLOWER[0])
    return Lanes(
        tuple(value * one for value in LEADER),
        tuple(value * one for value in FOLLOWER),
        T * one,
        COMPUTING,
        tuple(people.T),
        (contact * one, damper * one),
        one_sided=True,
        delay=(delay_s / T * one, delay_s / T * one),
        jitter=jitter,
        lost=lost,
        seed=SEED,
    )


def tried(law, people: np.ndarray, contact: float, delay_s: float, **uneven: float) -> dict[str, Any]:
    """Let people move in every motion: who settles, and what is felt at the end of a press."""
    every = np.concatenate([people] * len(MOTIONS))
    run, samples = lanes_of(every, contact, delay_s, **uneven), round(SECONDS / T)
    time = T * np.arange(samples)
    target = np.repeat(np.stack([motion(time) for motion in MOTIONS.values()], axis=1), len(people), axis=1)
    run.run(law(len(every)), samples, target)
    last = round(JUDGED_S / T)
    speed = np.abs(np.diff(run.x[:, -last:], axis=1)).max(axis=(0, 1)) / T
    near = np.abs(run.x[:, -last:]).max(axis=(0, 1)) < 1.0
    settled = ((speed < AT_REST_M_PER_S) & near).reshape(len(MOTIONS), -1)
    press = slice(len(people), 2 * len(people))
    depth = run.x[0, -last:, press].mean(axis=0)
    force = -run.f[-last:, press].mean(axis=0)
    sound = settled[1] & (depth > 1e-6)
    felt = force[sound] / depth[sound]
    return {
        "settled": dict(zip(MOTIONS, map(int, settled.sum(axis=1)), strict=True)),
        "all": int(settled.all(axis=0).sum()),
        "people": len(people),
        "rendered_n_per_m": float(np.median(felt)) if len(felt) else None,
    }


def felt_free(law, delay_s: float) -> dict[str, float]:
    """Mass and drag that a hand of 2000 N/m feels at the leader, moved by 10 mm at 1 Hz, the follower free."""
    run = lanes_of(np.array([[1e-6, 20.0, 2000.0]]), 0.0, delay_s)
    run.one_sided, samples = False, 6000
    time = T * np.arange(samples)
    run.run(law(1), samples, 0.01 * np.sin(2 * np.pi * time)[:, None])
    turn = np.exp(-2j * np.pi * time[-3000:])
    position, force = run.x[0, -3000:, 0] @ turn, run.f[-3000:, 0] @ turn
    # The leader's own mass and damping are felt beside the coupling; its force is held, T/2 late, after COMPUTING.
    felt = -force / position * np.exp(-2j * np.pi * T * (COMPUTING + 0.5))
    w = 2 * np.pi
    return {"mass_kg": float(-felt.real / w**2 + LEADER[0]), "drag_ns_per_m": float(felt.imag / w + LEADER[1])}


def recommended(delay_s: float, jitter: float, lost: float):
    text = (
        f"[device]\nmass_kg = {LEADER[0]}\ndamping_ns_per_m = {LEADER[1]}\ndelay_samples = {COMPUTING}\n[follower]\n"
        f"mass_kg = {FOLLOWER[0]}\ndamping_ns_per_m = {FOLLOWER[1]}\ndelay_samples = {COMPUTING}\ndelay_s = {delay_s}\n"
        f"jitter = {jitter}\nlost_share = {lost}\n"
    )
    return avc.recommend(avc.parse_problem(text), 50, SEED)


def springs(gains: ToolGains):
    return lambda lanes: SpringAndDampers(*(np.full(lanes, value) for value in vars(gains).values()))


def many_hands(count: int, answers: dict[float, Any]) -> list[dict[str, Any]]:
    rows = []
    for delay_s, answer in answers.items():
        for name, contact in CONTACTS.items():
            gains = answer.coupling.gains
            found = tried(springs(gains), hands(count), contact, delay_s, jitter=0.1, lost=0.01)
            rows.append({"part": "hands", "delay_s": delay_s, "contact": name, "gains": vars(gains)} | found)
    return rows


def options(gains: ToolGains, delay_s: float) -> dict[str, list[tuple[dict[str, float], Law]]]:
    """Return of each scheme what is tried: its numbers, and what makes the law with gains so many times as large."""
    k = gains.stiffness_n_per_m
    ladder = [k * 0.5**step for step in range(-1, 7)]

    def position(one: ToolGains) -> tuple[dict[str, float], Law]:
        return vars(one), lambda factor: springs(one.at_scale(factor))

    def waves(stiffness: float, impedance: float) -> tuple[dict[str, float], Law]:
        numbers = {"stiffness_n_per_m": stiffness, "impedance_ns_per_m": impedance}
        return numbers, lambda factor: lambda lanes: Waves(factor * stiffness, factor * impedance, lanes)

    def time_domain(stiffness: float, damping: float) -> tuple[dict[str, float], Law]:
        numbers = {"stiffness_n_per_m": stiffness, "damping_ns_per_m": damping}
        return numbers, lambda factor: lambda lanes: TimeDomain(factor * stiffness, factor * damping, lanes)

    return {
        "recommended": [position(gains)],
        "position-position, Lee and Spong, same K": [position(ToolGains(k, 0.0, k * delay_s))],
        "position-position, Lee and Spong, stiffest that settles": [
            position(ToolGains(one, 0.0, one * delay_s)) for one in ladder
        ],
        "wave variables, stiffest that settles": [waves(one, b) for one in ladder for b in IMPEDANCES],
        "time-domain passivity, same K and B": [time_domain(k, gains.damping_ns_per_m)],
        "time-domain passivity, stiffest that settles": [
            time_domain(one, b) for one in ladder[:4] for b in (6.0, 24.0)
        ],
    }


def schemes(count: int, answers: dict[float, Any]) -> list[dict[str, Any]]:
    """Each scheme on the same hands."""
    people, rows = hands(count), []
    for delay_s, answer in answers.items():
        for name, laws in options(answer.coupling.gains, delay_s).items():
            found = [tried(law(1.0), people, math.inf, delay_s) | {"numbers": numbers} for numbers, law in laws]
            place = max(range(len(laws)), key=lambda one: (found[one]["all"], found[one]["rendered_n_per_m"] or 0.0))
            law = laws[place][1]
            soft = tried(law(1.0), people, CONTACTS["soft contact"], delay_s)
            more = tried(law(MARGIN), people, math.inf, delay_s)
            beside = {"soft_all": soft["all"], "margin_all": more["all"]} | felt_free(law(1.0), delay_s)
            rows.append({"part": "schemes", "delay_s": delay_s, "scheme": name} | found[place] | beside)
            print(name, 1e3 * delay_s, flush=True)
    return rows


def main() -> None:
    args = script_arguments(__doc__, people=100, out=RESULTS)
    made = about(f"python tests/benchmarks/teleoperation.py {args.people}", SEED)
    answers = {delay_s: recommended(delay_s, 0.1, 0.01) for delay_s in DELAYS_S}
    rows = [*boundary(args.people), *many_hands(200, answers), *schemes(40, answers)]
    write_rows(args.out, made, rows)


if __name__ == "__main__":
    main()
