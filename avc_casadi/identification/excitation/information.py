"""Fisher information of a signal on mass, damping, delay and dry friction; D-optimal power of its tones.

Dry friction is linearised as the equivalent damper for a Gaussian velocity (Booton 1954), and the residual of its sign,
whose spectrum follows from the arcsine law (Van Vleck and Middleton 1966), is a force of its own: only that separates
friction from damping. With that spectrum fixed, the information is linear in the power of each tone, and the D-optimal
weights (Wald 1943; Kiefer and Wolfowitz 1960) under limits of force, speed and travel are a convex programme.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.model.device import Device

# Below this the observer of the identification forgets: disturbances there are not the device's own.
_FORGETS_RAD_PER_S = 20.0
# At the hand: noise, damping and speed below which nothing is gained.
_NOISE_AT_LEAST_M, _DAMPED_AT_LEAST_NS_PER_M, _SLOWEST_M_PER_S = 1e-7, 0.1, 1e-4
# Share of the power that is spread evenly over all tones, as a reserve for unmodelled dynamics.
_SPREAD = 0.25
_PASSES = 4
# Largest share of the power in one tone: the velocity stays nearly Gaussian, as the linearisation assumes.
_ONE_TONE = 0.1
_LAGS = 1 << 12


@dataclass(frozen=True)
class Centring:
    """Centring of the device near its start.

    Attributes:
        spring_n_per_m: its spring.
        damper_ns_per_m: its damper.
    """

    spring_n_per_m: float
    damper_ns_per_m: float


@dataclass(frozen=True)
class Room:
    """Root mean square limits of a signal.

    Attributes:
        force_n: of the force.
        speed_m_per_s: of the velocity, of every device.
        travel_m: of the position, of every device.
    """

    force_n: float
    speed_m_per_s: float
    travel_m: float


@dataclass(frozen=True, eq=False)
class _Linearised:
    """A device linearised about a signal.

    Attributes:
        position: position by force, with the centring, shape (tones,).
        tells: information per unit power of each tone, shape (tones, parameters, parameters).
        beside: information on friction that is not linear in the power.
    """

    position: ComplexArray
    tells: FloatArray
    beside: FloatArray


def information(
    device: Device, frequency_hz: FloatArray, power_n2: FloatArray, centring: Centring, ticks: int
) -> FloatArray:
    """Return the Fisher information of a multisine, shape (parameters, parameters).

    Parameters are the logarithm of the mass, damping over the larger of itself and 0.1 N.s/m, delay in samples and,
    where there is dry friction, friction over itself.

    Args:
        device: at its nominal values.
        frequency_hz: of the tones, shape (tones,).
        power_n2: mean square of each, shape (tones,).
        centring: beside the device.
        ticks: of the record.
    """
    found = _linearised(device, frequency_hz, power_n2, centring, ticks)
    return np.asarray(np.tensordot(power_n2, found.tells, 1) + found.beside, dtype=np.float64)


def best_power(
    devices: Sequence[Device],
    frequency_hz: FloatArray,
    centring: Centring,
    room: Room,
    ticks: int,
    progress: Progress = SILENT,
) -> FloatArray:
    """Return the D-optimal power of each tone, N^2: the mean log det over devices is largest.

    Args:
        devices: at their nominal values; the first and the corners of its ranges.
        frequency_hz: of the tones, shape (tones,).
        centring: beside the device.
        room: limits of every device.
        ticks: of the record.
        progress: of the passes.

    Raises:
        UnsupportedError: no power is found.
    """
    tones = frequency_hz.size
    power = _fitting(devices, frequency_hz, centring, np.full(tones, room.force_n**2 / tones), room, ticks)
    for done in range(_PASSES):
        progress.advance(done, _PASSES, f"passes over {tones} tones")
        about = [_linearised(device, frequency_hz, power, centring, ticks) for device in devices]
        power = _programme(about, frequency_hz, power, room)
    return power


def _fitting(
    devices: Sequence[Device],
    frequency_hz: FloatArray,
    centring: Centring,
    power: FloatArray,
    room: Room,
    ticks: int,
) -> FloatArray:
    """Scale a power into the limits."""
    about = [_linearised(device, frequency_hz, power, centring, ticks) for device in devices]
    rows = _limits(about, frequency_hz, room)
    return power / max(1.0, float((rows @ power).max()))


def _limits(about: Sequence[_Linearised], frequency_hz: FloatArray, room: Room) -> FloatArray:
    """Return rows whose product with the power is at most 1, shape (limits, tones)."""
    rate = 2 * np.pi * frequency_hz
    moves = [np.abs(one.position) ** 2 for one in about]
    return np.array(
        [
            np.full(frequency_hz.size, 1 / room.force_n**2),
            *(one / room.travel_m**2 for one in moves),
            *(one * rate**2 / room.speed_m_per_s**2 for one in moves),
        ]
    )


def _programme(about: Sequence[_Linearised], frequency_hz: FloatArray, power: FloatArray, room: Room) -> FloatArray:
    """Solve the convex programme about a power, in shares of the power of each tone alone at the limits."""
    tones = power.size
    rows = _limits(about, frequency_hz, room)
    alone = 1 / rows.max(axis=0)
    numbers = []
    for one in about:
        usual = np.tensordot(power, one.tells, 1) + one.beside
        outer = 1 / np.sqrt(np.outer(np.diag(usual), np.diag(usual)))
        tells = (one.tells * outer).reshape(tones, -1).T * alone
        beside = one.beside * outer + 1e-9 * np.eye(outer.shape[0])
        numbers += [tells.ravel(order="F"), beside.ravel(order="F")]
    kept = rows * alone
    # No tone is below its even share; in tight limits that share is reduced to fit.
    least = _SPREAD * np.ones(tones) / float(kept.sum(axis=1).max())
    solver = _solver(tones, tuple(one.beside.shape[0] for one in about), rows.shape[0])
    given = np.concatenate([*numbers, kept.ravel(order="F"), alone / alone.sum()])
    most = np.concatenate([np.ones(rows.shape[0]), np.zeros(tones)])
    found = solver(x0=np.maximum(power / alone, least), p=given, lbx=least, ubx=1.0, lbg=-np.inf, ubg=most)
    best = np.asarray(found["x"], dtype=np.float64).ravel()
    excess = float((kept @ best).max())
    if not np.all(np.isfinite(best)) or excess > 1 + 1e-4:
        raise UnsupportedError("no weights of the multisine were found; give another --signal, or wider limits")
    return np.asarray(best * alone / max(1.0, excess), dtype=np.float64)


@lru_cache(maxsize=4)
def _solver(tones: int, sizes: tuple[int, ...], limits: int) -> Any:
    """Return the programme for devices with so many parameters each; its numbers are CasADi parameters."""
    share = ca.SX.sym("share", tones)
    goal = ca.SX(0)
    given = []
    for size in sizes:
        tells, beside = ca.SX.sym("tells", size * size, tones), ca.SX.sym("beside", size, size)
        whole = ca.reshape(tells @ share, size, size) + beside
        goal -= 2 * ca.sum1(ca.log(ca.diag(ca.chol(whole)))) / len(sizes)
        given += [ca.vec(tells), ca.vec(beside)]
    kept = ca.SX.sym("kept", limits, tones)
    alone = ca.SX.sym("alone", tones)
    power = share * alone
    most = power - _ONE_TONE * ca.sum1(power)
    problem: dict[str, Any] = {
        "x": share,
        "p": ca.vertcat(*given, ca.vec(kept), alone),
        "f": goal,
        "g": ca.vertcat(kept @ share, most),
    }
    options: dict[str, Any] = {
        "ipopt.print_level": 0,
        "print_time": False,
        "ipopt.sb": "yes",
        "ipopt.tol": 1e-7,
        "error_on_fail": False,
    }
    return ca.nlpsol("design", "ipopt", problem, options)


def _linearised(
    device: Device, frequency_hz: FloatArray, power: FloatArray, centring: Centring, ticks: int
) -> _Linearised:
    period = device.sample_time_s
    rate = 2 * np.pi * frequency_hz
    s = 1j * rate
    mass, damping, friction = device.mass_kg, device.damping_ns_per_m, device.coulomb_friction_n
    hold = np.sinc(frequency_hz * period) * np.exp(-s * period * (0.5 + device.delay_samples))
    back = (centring.spring_n_per_m + centring.damper_ns_per_m * s) * hold

    def alone(equivalent: float) -> ComplexArray:
        return np.asarray(1 / (mass * s**2 + (damping + equivalent) * s), dtype=np.complex128)

    reach = device.metres_per_unit
    equivalent = 0.0
    speed_rms = 10 * _SLOWEST_M_PER_S / reach
    if friction:
        for _ in range(60):
            moves = hold * alone(equivalent) / (1 + back * alone(equivalent))
            speed_rms = max(float(np.sqrt(np.sum(power * np.abs(moves * s) ** 2))), _SLOWEST_M_PER_S / reach)
            equivalent = 0.5 * equivalent + 0.5 * friction * float(np.sqrt(2 / np.pi)) / speed_rms
    bare = alone(equivalent)
    force = hold / (1 + back * bare)  # that acts, by the signal
    position = bare * force
    seen = rate**2 / np.sqrt(rate**4 + _FORGETS_RAD_PER_S**4)
    noise = max(
        (device.encoder_resolution_m**2 / 12 + device.position_noise_rms_m**2) ** 0.5, _NOISE_AT_LEAST_M / reach
    )
    by = [
        -mass * s**2 * bare * position,
        -max(damping, _DAMPED_AT_LEAST_NS_PER_M * reach**2) * s * bare * position,
        -s * period * position,
    ]
    if friction:
        by.append(-equivalent * s * bare * position)
    slopes = np.array(by) * seen
    tells = ticks / noise**2 * np.real(slopes[:, None, :] * slopes[None, :, :].conj()).transpose(2, 0, 1)
    beside = np.zeros((len(by), len(by)))
    if friction:
        beside[-1, -1] = (
            ticks
            / noise**2
            * friction**2
            * _left_of_the_sign(rate, power * np.abs(position * s) ** 2, period, mass, damping + equivalent)
        )
    return _Linearised(position, tells, beside)


@lru_cache(maxsize=4)
def _cosines(rate: tuple[float, ...], period: float) -> FloatArray:
    return np.asarray(np.cos(np.outer(np.arange(_LAGS) * period, rate)), dtype=np.float64)


def _left_of_the_sign(rate: FloatArray, speed_power: FloatArray, period: float, mass: float, damping: float) -> float:
    """Return the mean square of the visible position under 1 N of sign(v) less its part along v."""
    like = _cosines(tuple(rate), period) @ speed_power / max(float(speed_power.sum()), 1e-300)
    like = np.clip(like, -1.0, 1.0) * np.cos(0.5 * np.pi * np.arange(_LAGS) / _LAGS) ** 2
    left = 2 / np.pi * (np.arcsin(like) - like)
    spectrum = np.maximum(2 * np.real(np.fft.rfft(left)) - left[0], 0.0)
    w = 2 * np.pi * np.fft.rfftfreq(_LAGS, period)[1:]
    gain = w**4 / (w**4 + _FORGETS_RAD_PER_S**4) / ((mass * w**2) ** 2 + (damping * w) ** 2)
    return float(2 * np.sum(spectrum[1:] * gain) / _LAGS)
