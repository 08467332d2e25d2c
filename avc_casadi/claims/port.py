"""The port between hand and device as declared, with a sampled rendering behind it.

The hand moves at all frequencies omega_n = omega + n omega_s at once, which the sampler aliases. With

    tau = Z_r/(Z_1 + Z_r)     motor velocity over handle velocity; Z_1 = m_1 s + b_d, Z_r = k_r/s + c_r; rigid: 1
    Y = 1/(Z_1 + Z_r)         motor admittance, the handle held (0 where the encoder sits at the handle, or rigid)
    R = b_d |tau|^2 + c_r |1 - tau|^2     real part of the impedance of the device alone
    A, e                      amplifier, exp(-j omega_n delay)
    kappa_n = (sin(omega T/2)/(omega_n T/2))^2     hold and sampler
    W = (Z_eavc + b_p)/z      the rendering

the impedance at the port is a diagonal matrix over n and one of rank 1, passive if and only if |1 + W X| >= |W| U,

    X = sum kappa A e (Y + tau t/(2R)),    U^2 = sum kappa |A|^2 |tau|^2/(2R) sum kappa |t|^2/(2R),

t being tau, or 1 for an encoder at the handle: stability with any passive hand, given that it is stable with one. Of a
rigid device with an ideal amplifier that is the condition of Colgate and Schenkel (1997): b_d + Re(z^-d W) >= 0.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray, IndexArray
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.claims.impedance import PortMechanics, PortWorst, wave
from avc_casadi.loops.spectrum import lowest
from avc_casadi.loops.wall import RIGID, PartialFractions
from avc_casadi.model.device import Device
from avc_casadi.model.hands import Hand

# Aliases that are summed one by one on either side, at least; a fraction of a sample of delay leaves an oscillating
# tail, which is faded out over more of them. Beyond, an integral takes the place of the sum.
_ALIASES = 40
_ALIASES_FADED = 400
# Multiple of the device's highest corner frequency, in aliases, up to which they are summed one by one.
_BEYOND_CORNER = 4
# Weights of the last two terms of a sum that an integral continues (Gregory).
_LAST_WEIGHTS = (23 / 24, 1 / 24)
_QUADRATURE_NODES = 12
_NUMBERS_AT_ONCE = 1_000_000
# Rounding of a slack: its own, and shares of the size of W X and of the loss.
_SLACK_ROUNDING = 1e-9
_TERM_ROUNDING = 1e-12
_LOSS_ROUNDING = 1e-8
# Damping, N.s/m, by which the rounding of a slack is scaled where the device has none.
_LEAST_LOSS_NS_PER_M = 1e-12
# Below a hundredth of the sampling frequency the device hardly changes, and poles of a coupling are real.
_SLOWEST_TURNS = 1e-8
_SLOW_TURNS = 0.01
_SLOW_POINTS = 360
_POINTS_PER_DECADE = 150
# Evenly spaced frequencies for each sample of delay.
_POINTS_PER_SAMPLE = 24
# First reach of the search for the removable damping, relative to 1 N.s/m and the device's own, its growth and its end.
_FIRST_REACH = 1e-3
_REACH_GROWTH = 4
_FARTHEST_REACH = 1e12
_BISECTIONS = 44
# A passive hand: its least mass, kg, and its times m/b and sqrt(m/k) in samples.
_LEAST_MASS_KG = 1e-6
_HAND_SAMPLES = 10


@dataclass(frozen=True)
class HandlePort:
    """X, U and U^2 - |X|^2 of a device, each of the shape of the frequencies.

    Attributes:
        turns: frequencies, in turns a sample.
        centre: X.
        spread: U.
        excess: U^2 - |X|^2, free of cancellation.
        damped: whether the device has damping left at every alias; without it only no rendering at all is passive.
    """

    turns: FloatArray
    centre: ComplexArray
    spread: FloatArray
    excess: FloatArray
    damped: BoolArray


def handle_port(device: Device, frequency_hz: FloatArray, removal_ns_per_m: FloatArray | float = 0.0) -> HandlePort:
    """Return the port of a device at frequencies above 0, Hz, each with all its aliases f + n/T.

    A hand moves the handle at every alias; sampling sums them. `removal_ns_per_m` is damping that is taken from the
    handle.
    """
    turns, removal = np.broadcast_arrays(np.asarray(frequency_hz) * device.sample_time_s, removal_ns_per_m)
    mechanics = PortMechanics(device)
    if mechanics.rigid and device.amplifier_bandwidth_hz is None:
        return _ideal(device, turns, removal)
    aliases = _Aliases.of(mechanics)
    at_once = max(1, _NUMBERS_AT_ONCE // len(aliases.number))
    slices = [slice(begin, begin + at_once) for begin in range(0, turns.size, at_once)]
    parts = [_alias_sum(mechanics, aliases, turns.ravel()[part], removal.ravel()[part]) for part in slices]
    return HandlePort(
        turns=turns,
        centre=np.concatenate([part.centre for part in parts]).reshape(turns.shape),
        spread=np.concatenate([part.spread for part in parts]).reshape(turns.shape),
        excess=np.concatenate([part.excess for part in parts]).reshape(turns.shape),
        damped=np.concatenate([part.damped for part in parts]).reshape(turns.shape),
    )


def _ideal(device: Device, turns: FloatArray, removal: FloatArray) -> HandlePort:
    """Return the port of a rigid device with an ideal amplifier, less a removed damping: closed sums over aliases.

    With a delay of d + f samples they are linear in the fraction f.
    """
    left = device.damping_ns_per_m - removal
    damped = left > 0
    half = np.where(damped, 0.5 / np.where(damped, left, 1.0), 0.0)
    whole = int(device.delay_samples)
    late = device.delay_samples - whole
    centre = half * (1 - late + late * np.exp(-2j * np.pi * turns)) * np.exp(-2j * np.pi * whole * turns)
    excess = half**2 * 4 * late * (1 - late) * np.sin(np.pi * turns) ** 2
    return HandlePort(turns=turns, centre=centre, spread=half, excess=excess, damped=damped)


@dataclass(frozen=True)
class _Aliases:
    """Aliases over which a port is summed: one by one near 0, then nodes of an integral to infinity.

    Attributes:
        number: indices n, 0 first.
        weight: their weights.
        last: the last index that is summed one by one.
    """

    number: FloatArray
    weight: FloatArray
    last: int

    @classmethod
    def of(cls, mechanics: PortMechanics) -> _Aliases:
        """Return the aliases n of f + n/T that a device needs, with weights: one by one, then nodes of an integral."""
        least = _ALIASES_FADED if mechanics.device.delay_samples % 1 else _ALIASES
        last = max(least, math.ceil(_BEYOND_CORNER * mechanics.fastest_turns))
        plain = np.arange(1.0, last + 2)
        plain_weight = np.ones(last + 1)
        plain_weight[-2:] = _LAST_WEIGHTS
        node, share = np.polynomial.legendre.leggauss(_QUADRATURE_NODES)
        node = (node + 1) / 2
        share = share / 2
        far = (last + 0.5) / node
        far_weight = (last + 0.5) * share / node**2
        number = np.concatenate([[0.0], plain, -plain, far, -far])
        weight = np.concatenate([[1.0], plain_weight, plain_weight, far_weight, far_weight])
        return cls(number, weight, last)


def _delay(delay_samples: float, aliases: _Aliases, turns: FloatArray) -> ComplexArray:
    """Return the factor of a delay of d + f samples at turns a sample, (m, 1), and their aliases n, (m, aliases).

    It is exp(-2 pi j (d turns + f (turns + n))). Where f is not 0, the sum over the aliases converges slowly, and the
    farther half of them fades out.
    """
    late = delay_samples % 1
    factor = np.exp(-2j * np.pi * (int(delay_samples) * turns + late * (turns + aliases.number)))
    if late:
        factor *= np.cos(np.pi / 2 * np.clip(2 * np.abs(aliases.number) / aliases.last - 1, 0.0, 1.0)) ** 2
    return np.asarray(factor)


def _alias_sum(mechanics: PortMechanics, aliases: _Aliases, turns: FloatArray, removal: FloatArray) -> HandlePort:
    """Return the port at turns f T, shape (m,), less some damping of the handle at each, summed over the aliases.

        X = sum kappa A e (Y + tau t/(2R)),    U^2 = sum kappa |A|^2 |tau|^2/(2R) sum kappa |t|^2/(2R)

    kappa is hold and sampler, A amplifier, e delay, tau motor over handle velocity, t tau or 1 for an encoder at the
    handle, Y the motor's admittance, R the damping of the device at the handle.
    """
    device = mechanics.device
    alias_turns = turns[:, None] + aliases.number
    s = np.asarray(2j * np.pi * alias_turns / device.sample_time_s, dtype=np.complex128)
    kappa = aliases.weight * (np.sin(np.pi * turns)[:, None] / (np.pi * alias_turns)) ** 2
    transmission = mechanics.transmission(s)
    tau = transmission.tau
    admittance = transmission.admittance
    left = transmission.loss - removal[:, None]
    damped: BoolArray = np.asarray((left > 0).all(axis=1))
    half = 0.5 / np.where(left > 0, left, 1.0)
    amplifier = mechanics.amplifier(s)
    delay = _delay(device.delay_samples, aliases, turns[:, None])
    force_gain = np.abs(amplifier) ** 2
    drive = np.abs(tau) ** 2 * half
    # U^2 - |X|^2 of the term n = 0 alone, over kappa^2 |A|^2.
    if mechanics.at_handle:
        centre = tau * half
        sense = half
        first_excess = np.zeros_like(half[:, 0])
    else:
        centre = admittance + tau**2 * half
        sense = drive
        cross = (admittance[:, 0].conj() * tau[:, 0] ** 2).real
        first_excess = -(np.abs(admittance[:, 0]) ** 2) - 2 * half[:, 0] * cross
    # X is the sum of x, and U^2 that of u times that of v.
    x = kappa * amplifier * delay * centre
    u = kappa * force_gain * drive
    v = kappa * sense
    first_term = kappa[:, 0] ** 2 * force_gain[:, 0] * first_excess
    return _summed((x, u, v), first_term, turns, damped)


def _summed(
    terms: tuple[ComplexArray, FloatArray, FloatArray], first_excess: FloatArray, turns: FloatArray, damped: BoolArray
) -> HandlePort:
    """Return the port of terms x, u and v, (m, aliases): X = sum x, U^2 = sum u sum v, and U^2 - |X|^2.

    `first_excess` is u v - |x|^2 of the first alias alone, which the difference of the sums would cancel.
    """
    x, u, v = terms
    x_rest, u_rest, v_rest = (np.sum(term[:, 1:], axis=1) for term in terms)
    excess = (
        first_excess
        + u[:, 0] * v_rest
        + v[:, 0] * u_rest
        + u_rest * v_rest
        - 2 * (x[:, 0].conj() * x_rest).real
        - np.abs(x_rest) ** 2
    )
    spread = np.sqrt((u[:, 0] + u_rest) * (v[:, 0] + v_rest))
    return HandlePort(
        turns=turns,
        centre=np.asarray(x[:, 0] + x_rest),
        spread=np.asarray(spread),
        excess=np.asarray(excess),
        damped=damped,
    )


@dataclass(frozen=True)
class RenderingSlack:
    """|1 + W X|^2 - |W|^2 U^2 of n renderings: on a rigid device without delay Re Z_h/b_d."""

    parts: PartialFractions
    contact_damping_ns_per_m: FloatArray

    def __call__(self, port: HandlePort, rows: IndexArray) -> tuple[FloatArray, FloatArray]:
        """Return the slack |1 + W X|^2 - |W|^2 U^2 of some rows and its rounding; W the rendering, X and U the port."""
        column = (rows, None)
        w = wave(self.parts.pick(column), self.contact_damping_ns_per_m[column], port.turns)
        size = np.abs(w)
        loss = size**2 * port.excess
        left = 1 + 2 * (w.real * port.centre.real - w.imag * port.centre.imag) - loss
        rounding = _SLACK_ROUNDING + _TERM_ROUNDING * size * port.spread + _LOSS_ROUNDING * np.abs(loss)
        undamped = np.where(size == 0, 1.0, -np.inf)
        return np.where(port.damped, left, undamped), np.where(port.damped, rounding, 0.0)


@dataclass(frozen=True)
class CouplingSlack:
    """The same for n couplings with every passive wall: the smallest slack over Z_e.

    Coupling and wall in series are (1 + e)/(2 Re(1/Z_c)), |e| <= 1, so that W lies in a disk of radius rho = 1/(2
    Re(1/Z_c)) about w_0 = (rho + b_p)/z; that of the passive renderings is another disk, or the outside of one. The
    first lies within where

        1 + 2 Re(w_0 X) - 2 U rho - (U^2 - |X|^2)(|w_0|^2 - rho^2) >= 0    and    U >= rho (U^2 - |X|^2).
    """

    damping_ns_per_m: FloatArray
    stiffness_n_per_m: FloatArray
    contact_damping_ns_per_m: FloatArray
    sample_time_s: float

    @property
    def valid(self) -> BoolArray:
        """Which couplings are passive themselves and not rigid, shape (n,)."""
        b = self.damping_ns_per_m
        k = self.stiffness_n_per_m
        finite = (np.abs(b) <= RIGID) & (np.abs(k) <= RIGID)
        with np.errstate(over="ignore"):
            return np.asarray(finite & ((b + k * self.sample_time_s / 2 > 0) | ((b == 0) & (k == 0))))

    def __call__(self, port: HandlePort, rows: IndexArray) -> tuple[FloatArray, FloatArray]:
        """Return the least slack of some rows of couplings over every passive wall, and its rounding; no unit."""
        column = (rows, None)
        valid = self.valid
        b, k = (np.where(valid, gain, 0.0)[column] for gain in (self.damping_ns_per_m, self.stiffness_n_per_m))
        contact = self.contact_damping_ns_per_m[column]
        half = k * self.sample_time_s / 2
        lead = b + half
        cotangent = np.sin(np.pi * (0.5 - port.turns)) / np.sin(np.pi * port.turns)
        rho = (lead + half * (half / np.where(lead > 0, lead, 1.0)) * cotangent**2) / 2
        x = port.centre * np.exp(-2j * np.pi * port.turns)
        size = np.abs(x)
        # U - Re x, which vanishes at low frequency while rho grows.
        lag = port.excess / np.where(port.spread > 0, port.spread + size, 1.0) + 2 * size * np.sin(np.angle(x) / 2) ** 2
        loss = 2 * rho * lag + port.excess * contact * (contact + 2 * rho)
        left = 1 + 2 * contact * x.real - loss
        left = np.where(port.damped & (port.spread >= rho * port.excess), left, -np.inf)
        left = np.where((rho == 0) & (contact == 0), 1.0, left)
        rounding = _SLACK_ROUNDING + _TERM_ROUNDING * contact * size + _LOSS_ROUNDING * np.abs(loss)
        return np.where(valid[column], left, -np.inf), np.where(port.damped, rounding, 0.0)


Slack = RenderingSlack | CouplingSlack
"""Slack of some rows at a port of shape (m,) or (rows, m), not negative where passive, and its rounding error."""


def frequencies_hz(device: Device) -> FloatArray:
    """Return frequencies, shape (m,), that resolve every pole of a port, the delay, and the end at Nyquist."""
    decades = np.log10(0.5 / _SLOW_TURNS)
    low = np.geomspace(_SLOWEST_TURNS, _SLOW_TURNS, _SLOW_POINTS)
    high = np.geomspace(_SLOW_TURNS, 0.5, round(_POINTS_PER_DECADE * decades))
    even = np.linspace(0.0, 0.5, 1 + round(_POINTS_PER_SAMPLE * (device.delay_samples + 3)))[1:]
    return np.unique(np.concatenate([low, high, even, 0.5 - low[::4]])) / device.sample_time_s


def port_worst(devices: Sequence[Device], slack: Slack, rows: int, progress: Progress = SILENT) -> PortWorst:
    """Return the least slack of each row over all frequencies and devices, as a margin, N.s/m, and where.

    It is scanned and refined: the port has no lightly damped pole.
    """
    all_rows = np.arange(rows)
    passed = np.ones(rows, dtype=bool)
    least_of_devices, places = [], []
    for index, device in enumerate(devices):
        progress.advance(index, len(devices), "passivity at the handle")
        left, rounding = slack(handle_port(device, frequencies_hz(device)), all_rows)
        passed &= (left >= -rounding).all(axis=1)
        least_of_devices.append(left.min(axis=1))
        places.append(left.argmin(axis=1))
    worst_device = np.argmin(least_of_devices, axis=0)
    margin = np.full(rows, np.nan)
    worst_hz = np.full(rows, np.nan)
    tolerance = np.full(rows, np.nan)
    for index, device in enumerate(devices):
        of_device = np.flatnonzero(worst_device == index)
        if len(of_device) == 0:
            continue
        hz = frequencies_hz(device)
        place = places[index][of_device]
        around = (hz[np.clip(place + side, 0, len(hz) - 1)] for side in (-1, 0, 1))

        def left_at(hz: FloatArray, device: Device = device, of_device: IndexArray = of_device) -> FloatArray:
            return slack(handle_port(device, hz[:, None]), of_device)[0][:, 0]

        worst_hz[of_device] = lowest(left_at, *around)
        left, rounding = slack(handle_port(device, worst_hz[of_device, None]), of_device)
        passed[of_device] &= left[:, 0] >= -rounding[:, 0]
        margin[of_device] = _margin(device, slack, worst_hz[of_device], of_device, left[:, 0])
        tolerance[of_device] = rounding[:, 0] * (_LEAST_LOSS_NS_PER_M + abs(PortMechanics(device).least_loss))
    return PortWorst(passed, margin, worst_hz, tolerance)


def _margin(device: Device, slack: Slack, frequency: FloatArray, rows: IndexArray, values: FloatArray) -> FloatArray:
    """Return the largest damping that can be removed from the handle at one frequency a row, N.s/m, by bisection.

    Where `values`, the slack, is negative it is below 0: damping that must be added.
    """

    def meets(removal: FloatArray) -> BoolArray:
        return np.asarray(slack(handle_port(device, frequency[:, None], removal[:, None]), rows)[0][:, 0] >= 0)

    most = np.full(len(rows), PortMechanics(device).least_loss)
    reach = _FIRST_REACH * (1.0 + most)
    inside = np.where(values >= 0, 0.0, -reach)
    waiting = ~meets(inside)
    while waiting.any() and reach[0] < _FARTHEST_REACH:
        reach = _REACH_GROWTH * reach
        inside = np.where(waiting, -reach, inside)
        waiting = ~meets(inside)
    outside = np.where(values >= 0, most, 0.0)
    for _ in range(_BISECTIONS):
        middle = (inside + outside) / 2
        fits = meets(middle)
        inside = np.where(fits, middle, inside)
        outside = np.where(fits, outside, middle)
    return np.where(waiting, -np.inf, inside)


def passive_hand(device: Device) -> Hand:
    """Return one passive hand: what is passive at the port and stable with it is stable with any."""
    mass = max(device.mass_kg, device.damping_ns_per_m * device.sample_time_s, _LEAST_MASS_KG)
    time_s = _HAND_SAMPLES * device.sample_time_s
    return Hand(
        mass_kg=np.array([mass]),
        damping_ns_per_m=np.array([mass / time_s]),
        stiffness_n_per_m=np.array([mass / time_s**2]),
    )
