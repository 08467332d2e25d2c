"""Periodic orbits of a loop that makes and breaks contact: found by Newton's method, confirmed by enclosure.

From an initial guess, the pieces visited over a period make one affine map; its fixed point is the next iterate. Where
the fixed point visits the same pieces it lies on an orbit: Newton's method ends after finitely many steps. A loop with
an orbit other than an equilibrium does not settle from every state. None found proves nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi._util.json_values import plain
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.claims.prove.switching import SwitchingLoop
from avc_casadi.model.hands import Hand

if TYPE_CHECKING:
    from collections.abc import Sequence

    from avc_casadi.claims.prove.law import ContactLaw
    from avc_casadi.model.device import Device
    from avc_casadi.model.problem import Contact

PERIODS = tuple(range(3, 33))
_NEWTON_STEPS = 12
# Relative error of the discretised plant and of the loop's own numbers.
_ENTRY_ERROR = 1e-11
# An orbit moves by more than this share of the hand's penetration.
_MOVES = 1e-4


@dataclass(frozen=True)
class Orbit:
    """A periodic motion with a hand and its target.

    Attributes:
        hand: the numbers of the hand, by name.
        target_m: of the hand, m; the wall begins at 0.
        state_names: names of the states.
        states: at each sample of a period, shape (p, n).
        force_n: commanded at each sample, shape (p,).
        multiplier: largest absolute Floquet multiplier; above 1 where the orbit is unstable.
        enclosed: whether an enclosure proves that there is such an orbit.
    """

    hand: dict[str, float]
    target_m: float
    state_names: tuple[str, ...]
    states: FloatArray
    force_n: FloatArray
    multiplier: float
    enclosed: bool

    @property
    def period(self) -> int:
        """Period in samples."""
        return len(self.states)

    def document(self) -> dict[str, Any]:
        """Return JSON values."""
        return {str(key): plain(value) for key, value in vars(self).items()}

    @classmethod
    def from_document(cls, found: dict[str, Any]) -> Orbit:
        """Read the output of `document`."""
        return cls(
            hand=dict(found["hand"]),
            target_m=float(found["target_m"]),
            state_names=tuple(found["state_names"]),
            states=np.array(found["states"], dtype=np.float64),
            force_n=np.array(found["force_n"], dtype=np.float64),
            multiplier=float(found["multiplier"]),
            enclosed=bool(found["enclosed"]),
        )


def find_orbit(
    law: ContactLaw,
    contact: Contact,
    device: Device,
    hands: Hand,
    *,
    periods: Sequence[int] = PERIODS,
    starts: int = 4,
    press_n: tuple[float, ...] = (5.0, -5.0),
    seed: int = 0,
    progress: Progress = SILENT,
) -> Orbit | None:
    """Return the first orbit with some hands that an enclosure confirms, or None.

    Args:
        law: the law.
        contact: the contact law.
        device: the device, known exactly, its force not limited: orbits grow with the press, so that the force limit
            only bounds the press at which one occurs.
        hands: h hands.
        periods: numbers of samples to try.
        starts: random states to start from, for each hand and press.
        press_n: forces with which the hands press; negative in front of the wall.
        seed: of the starts.
        progress: reported over the periods.
    """
    random = np.random.default_rng(seed)
    count = len(hands)
    many = hands.pick(np.tile(np.arange(count), starts * len(press_n)))
    press = np.repeat(press_n, count * starts)
    loop = SwitchingLoop.of(law, contact, device, many, press / np.asarray(many.stiffness_n_per_m))
    for done, period in enumerate(periods):
        found = _newton(loop, period, _guesses(loop, random))
        progress.advance(done + 1, len(periods), "orbits")
        for row in found:
            orbit = _confirmed(_only(loop, row[0]), period, row[1], many.values(row[0]))
            if orbit is not None:
                return orbit
    return None


def _only(loop: SwitchingLoop, row: int) -> SwitchingLoop:
    some = slice(row, row + 1)
    return SwitchingLoop(
        loop.law, loop.contact, loop.matrix[some], loop.push[some], loop.measured, loop.target_m[some], loop.names
    )


def _guesses(loop: SwitchingLoop, random: np.random.Generator) -> FloatArray:
    """Return initial guesses into the wall or out of it: a penetration, a speed, and the past of these."""
    h, n = len(loop.target_m), loop.states
    state = np.zeros((h, n))
    speed = random.uniform(-0.4, 0.4, h) * loop.law.sample_time_s
    position = random.uniform(-2.0, 2.0, h) * np.abs(speed)
    for place, name in enumerate(loop.names):
        if name.endswith("position_m"):
            state[:, place] = position - loop.target_m
        elif name.endswith("m_per_sample"):
            state[:, place] = speed
        elif name == "position_before_m":
            state[:, place] = position - speed
        elif name.startswith("predicted"):
            state[:, place] = position
    return state


def _newton(loop: SwitchingLoop, period: int, state: FloatArray) -> list[tuple[int, FloatArray]]:
    """Return the hands whose guess converged to a fixed point of its own pieces, with the state."""
    h, n = state.shape
    before: BoolArray | None = None
    same = np.zeros(h, dtype=bool)
    for _ in range(_NEWTON_STEPS):
        whole = np.tile(np.eye(n, n + 1), (h, 1, 1))
        at, pattern = state, []
        for _ in range(period):
            rows, _, signs = loop.piece(at)
            pattern.append(signs > 0)
            linear = rows[:, :, :n] @ whole
            linear[:, :, n] += rows[:, :, n]
            whole = linear
            at = np.einsum("hmn,hn->hm", rows[:, :, :n], at) + rows[:, :, n]
        taken = np.stack(pattern, axis=1).reshape(h, -1)
        same = np.zeros(h, dtype=bool) if before is None else (taken == before).all(axis=1)
        before = taken
        if same.all():
            break
        state = np.where(same[:, None], state, _fixed(whole, state))
    moves = np.abs(at - state).max(axis=1) <= 1e-9 * (np.abs(state).max(axis=1) + 1e-300)
    return [(int(row), state[row]) for row in np.flatnonzero(same & moves & _travels(loop, state))]


def _fixed(whole: FloatArray, state: FloatArray) -> FloatArray:
    """Return the fixed points of affine maps; where there is none the state stays."""
    n = state.shape[1]
    left = np.eye(n) - whole[:, :, :n]
    usable = np.isfinite(left).all(axis=(1, 2)) & (np.abs(np.linalg.det(np.where(np.isfinite(left), left, 0))) > 1e-14)
    solved = np.linalg.solve(np.where(usable[:, None, None], left, np.eye(n)), whole[:, :, n:])[..., 0]
    return np.where(usable[:, None] & np.isfinite(solved), solved, state)


def _travels(loop: SwitchingLoop, state: FloatArray) -> BoolArray:
    """Return which states are orbits, not equilibria."""
    rows, _, _ = loop.piece(state)
    n = state.shape[1]
    following = np.einsum("hmn,hn->hm", rows[:, :, :n], state) + rows[:, :, n]
    return np.asarray(np.abs(following - state).max(axis=1) > _MOVES * (np.abs(loop.target_m) + 1e-6))


def _confirmed(loop: SwitchingLoop, period: int, start: FloatArray, hand: dict[str, float]) -> Orbit | None:
    """Enclose the orbit by Krawczyk's test on all samples at once, and check every piece against the enclosure.

    The numbers of each piece have an error of `_ENTRY_ERROR`, so that the loop in exact numbers is enclosed.
    """
    n = loop.states
    states, forces, maps, switches = [], [], [], []
    at = start[None, :]
    for _ in range(period):
        rows, force, signs = loop.piece(at)
        states.append(at[0])
        forces.append(float(force[0, :n] @ at[0] + force[0, n]))
        maps.append(rows[0])
        switches.append(signs[0])
        at = (rows[0, :, :n] @ at[0] + rows[0, :, n])[None, :]
    orbit = np.stack(states)
    size = period * n
    system, off = np.eye(size), np.zeros((size, size))
    constant, constant_off = np.zeros(size), np.zeros(size)
    for sample, rows in enumerate(maps):
        into = slice((sample + 1) % period * n, (sample + 1) % period * n + n)
        out = slice(sample * n, sample * n + n)
        scale = np.abs(rows[:, :n]).max()
        system[into, out] -= rows[:, :n]
        off[into, out] = _ENTRY_ERROR * (np.abs(rows[:, :n]) + 1e-3 * scale)
        constant[into] = rows[:, n]
        constant_off[into] = _ENTRY_ERROR * (np.abs(rows[:, n]) + np.abs(loop.target_m[0]))
    radius = _krawczyk(system, off, constant, constant_off, orbit.ravel())
    if radius is None:
        return None
    room = radius.reshape(period, n).max(axis=1) * _loop_gain(loop)
    enclosed = all((np.abs(signs) > spread).all() for signs, spread in zip(switches, room, strict=True))
    if not enclosed:
        return None
    whole = np.eye(n)
    for rows in maps:
        whole = rows[:, :n] @ whole
    largest = float(np.abs(np.linalg.eigvals(whole)).max())
    return Orbit(hand, float(loop.target_m[0]), loop.names, orbit, np.array(forces), largest, enclosed=True)


def _loop_gain(loop: SwitchingLoop) -> float:
    """Bound the change of the deciding values for a change of each state by one."""
    law, t = loop.law, loop.law.sample_time_s
    stiff = law.wall_stiffness_n_per_m + (law.wall_damping_ns_per_m + law.contact_damping_ns_per_m) / t
    observer = law.state_feedback
    seen = 1.0
    if observer is not None:
        seen += float(np.abs(observer.feedback).sum() * (1 + np.abs(observer.innovation).max()))
    return 4 * (stiff + 1.0) * (1.0 + seen)


def _krawczyk(
    system: FloatArray, off: FloatArray, constant: FloatArray, constant_off: FloatArray, guess: FloatArray
) -> FloatArray | None:
    """Enclose the solution of (system + off) x = constant + constant_off; return its distance from the guess, or None.

    With R near the inverse: |x - guess| <= |R (constant - system guess)| + |R| (errors) + |1 - R system| |x - guess|.
    """
    size = len(guess)
    unit = size * 2.0**-50
    try:
        inverse = np.linalg.inv(system)
    except np.linalg.LinAlgError:
        return None
    absolute = np.abs(inverse)
    left = np.abs(system @ guess - constant)
    left += constant_off + off @ np.abs(guess) + unit * (np.abs(system) @ np.abs(guess) + np.abs(constant))
    first = absolute @ left * (1 + unit)
    contraction = np.abs(np.eye(size) - inverse @ system) + absolute @ (off + unit * np.abs(system))
    # An interval mapped into its own interior contains a unique solution.
    radius = 2 * first + 1e-300
    mapped = first + contraction @ radius * (1 + unit)
    return radius if (mapped < radius).all() else None
