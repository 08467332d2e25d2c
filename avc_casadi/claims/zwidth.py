"""The K-B region of Colgate and Brown: walls B + K/s rendered without coupling."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar, Literal

import numpy as np

from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi._util.json_values import Document
from avc_casadi._util.page import Worded
from avc_casadi._util.printed import Columns, Tabular, short
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.claims.impedance import wave
from avc_casadi.claims.level_claims import NonIdeality
from avc_casadi.claims.levels import ideal, non_idealities
from avc_casadi.claims.port import frequencies_hz, handle_port, passive_hand
from avc_casadi.claims.worst_frequency import quadratic_stretch, refine_minima
from avc_casadi.files.problem_file import AnyProblem, accepts_problem, require_wall
from avc_casadi.loops.plant_family import PlantFamily
from avc_casadi.loops.stable_walls import Stretches, stable_walls
from avc_casadi.loops.wall import PartialFractions, passive_limit_n_per_m, rigid
from avc_casadi.model.corners import LINEAR_KEYS, device_corners
from avc_casadi.model.declared import declared, effects_of_scene_alone
from avc_casadi.model.device import Device
from avc_casadi.model.hands import Hand, released_hand
from avc_casadi.model.problem import Model, Problem
from avc_casadi.model.runtime import PLAIN, Poles, VelocityFilterEffect, low_pass, velocity_poles

_DAMPINGS = 240
"""Dampings of a curve. With a quarter of them narrow peaks of a resonant device were passed by: 11 % of stiffness."""
_LIGHTEST_SHARE = 1e-4
"""Lightest damping of a curve above 0, as a share of the heaviest."""
_LEAST_SCALE_NS_PER_M = 1e-3
"""Least scale of the dampings, where device and hands have neither mass nor damping."""
_SEEDS_PER_HALF_WAVE = 24
_SLOWEST_TURNS = 1e-8
"""Frequencies of a scan of an ideal device, for each half-wave of its hold, and the lowest, in turns a sample."""


CurveKey = Literal["passive-paper", "passive-sampled-data", "passive-delayed", "stable-released", "stable-hands"]
"""Names of the claims."""


@dataclass(frozen=True)
class WallClaim(Worded):
    """What is claimed of the walls below a curve.

    Attributes:
        key: name of the claim.
        delay_samples: delay of the device.
        filtered: whether the velocity filter of the scene acts on the damper.
        corners: number of corners of the device's ranges.
    """

    key: CurveKey
    delay_samples: float
    filtered: bool
    corners: int


@dataclass(frozen=True)
class NoWallProof(Worded):
    """Passivity with the paper's hold has no proof on this device: that hold gives no loop from sample to sample.

    Attributes:
        properties: what makes the device not ideal; empty where it is the velocity filter of the scene.
    """

    properties: tuple[NonIdeality, ...]


@dataclass(frozen=True, eq=False)
class Curve(Document):
    """Largest stiffness of a wall at each wall damping for one claim.

    Attributes:
        claim: what is claimed.
        delay_samples: delay that the curve is for.
        stiffness_n_per_m: largest stiffness at each damping, shape (n,).
        holds_target: whether the claim holds of the requested wall.
    """

    JSON_KEYS: ClassVar = ("claim", "delay_samples", "stiffness_n_per_m", ("wanted_wall", "holds_target"))

    claim: WallClaim
    delay_samples: float
    stiffness_n_per_m: FloatArray
    holds_target: bool

    @property
    def key(self) -> CurveKey:
        """Name of the curve in the document."""
        return self.claim.key


@dataclass(frozen=True)
class WallValues:
    """Damper and spring of a wall."""

    damping_ns_per_m: float
    stiffness_n_per_m: float


@dataclass(frozen=True, eq=False, repr=False)
class ZWidth(Tabular, Document):
    """The K-B region of a device as declared: at all corners of its ranges.

    On a rigid device with d samples of delay a spring alone is passive up to 2 b/((1 + 2 d) T), the rule b >= K T/2 of
    Colgate and Schenkel (1997).

    Attributes:
        problem: name of the problem.
        damping_ns_per_m: dampings B of the walls, shape (n,).
        curves: the largest stiffness K of each claim.
        target_damping_ns_per_m: damping of the requested wall.
        target_stiffness_n_per_m: stiffness of the requested wall.
        rule_n_per_m: (b + b_h + B)/(T/2 + t_d), the linear rule of Gil et al., shape (n,).
        passive_spring_n_per_m: b/(T/2 + t_d), a passive spring without damping, by Diolaiti et al.
        encoder_limit_n_per_m: 2 f_c/Delta, encoder step against dry friction; None where neither is declared.
        passive_limit_n_per_m: the largest DC stiffness of any passive linear rendering.
        hands: number of hands.
        corners: number of corners of the device's ranges.
        used: declared keys that enter.
        not_used: declared keys that do not.
        refused: why a claim has no proof on this device; empty where all have one.
        definition: the problem, for ``print``.
    """

    JSON_KEYS: ClassVar = (
        "problem",
        "hands",
        "refused",
        "encoder_limit_n_per_m",
        "passive_limit_n_per_m",
        "passive_spring_n_per_m",
        "rule_n_per_m",
        ("device_corners", "corners"),
        ("used", "used_keys"),
        ("not_used", "not_used_keys"),
        ("wall_damping_ns_per_m", "damping_ns_per_m"),
        ("curves", "curve_of"),
        ("wanted", "target"),
    )

    problem: str
    damping_ns_per_m: FloatArray
    curves: tuple[Curve, ...]
    target_damping_ns_per_m: float
    target_stiffness_n_per_m: float
    rule_n_per_m: FloatArray
    passive_spring_n_per_m: float
    encoder_limit_n_per_m: float | None
    passive_limit_n_per_m: float
    hands: int
    corners: int
    used: tuple[str, ...]
    not_used: tuple[str, ...]
    refused: tuple[NoWallProof, ...]
    definition: Problem

    def to_dict(self) -> Columns:
        """Return B and the largest K of each claim as columns, each of shape (n,)."""
        curves = {f"{curve.key}_stiffness_n_per_m": curve.stiffness_n_per_m for curve in self.curves}
        return {"damping_ns_per_m": self.damping_ns_per_m, **curves}

    def _summary(self) -> str:
        spans = ", ".join(f"{curve.key} {short(curve.stiffness_n_per_m)}" for curve in self.curves)
        return f"{self.problem!r}, B {short(self.damping_ns_per_m)}; largest K: {spans}"

    @property
    def used_keys(self) -> list[str]:
        """The declared keys that enter, in the names of the device's motion."""
        return [self.units.key(name) for name in self.used]

    @property
    def not_used_keys(self) -> list[str]:
        """The declared keys that do not enter, in the names of the device's motion."""
        return [self.units.key(name) for name in self.not_used]

    @property
    def curve_of(self) -> dict[CurveKey, Curve]:
        """The curve of each claim that has a proof on this device."""
        return {curve.key: curve for curve in self.curves}

    @property
    def target(self) -> WallValues:
        """The requested wall."""
        return WallValues(self.target_damping_ns_per_m, self.target_stiffness_n_per_m)


def passive_walls(
    corners: Sequence[Device],
    damping_ns_per_m: FloatArray,
    model: Model,
    poles: Poles = PLAIN,
    more_delay: int = 0,
) -> Stretches:
    """Return the softest interval of stiffnesses with which a wall is passive at every corner of a device.

    Args:
        corners: corners of the device's ranges.
        damping_ns_per_m: dampings B of the walls, shape (n,).
        model: model of the hold.
        poles: poles of the velocity filter on the damper.
        more_delay: samples of delay beside those of the device.
    """
    exact = all(ideal(corner) for corner in corners)
    low = np.zeros(len(damping_ns_per_m))
    high = np.full(len(damping_ns_per_m), np.inf)
    for corner in corners:
        if exact:
            softest, stiffest = _ideal_ends(corner, damping_ns_per_m, model, poles, more_delay)
        else:
            softest, stiffest = _port_ends(corner, damping_ns_per_m, model, poles)
            held = stable_walls([corner], passive_hand(corner), damping_ns_per_m, poles)
            low = np.maximum(low, held.lowest_n_per_m[:, 0])
            high = np.minimum(high, held.first_n_per_m)
        low = np.maximum(low, softest.max(axis=1))
        high = np.minimum(high, stiffest.min(axis=1))
    none = ~(high > low)
    return Stretches(np.where(none, np.nan, low)[:, None], np.where(none, np.nan, high)[:, None])


def _ideal_ends(
    corner: Device, damping_ns_per_m: FloatArray, model: Model, poles: Poles, more_delay: int
) -> tuple[FloatArray, FloatArray]:
    """Return the softest and stiffest passive walls of each damping at frequencies, each (n, m), of an ideal device.

    On a rigid device with an ideal amplifier and whole samples of delay, at each frequency b_d + Re(z^-d W) >= 0 with
    W = B W_b + K W_k, linear in K and B.
    """

    def ends(hz: FloatArray) -> tuple[FloatArray, FloatArray]:
        turns = hz * corner.sample_time_s
        late = np.exp(-2j * np.pi * turns * (corner.delay_samples + more_delay))
        damper, spring = (late * part for part in _waves(turns, corner.sample_time_s, model, poles))
        free = corner.damping_ns_per_m + damping_ns_per_m[:, None] * damper.real
        return quadratic_stretch(np.zeros_like(free), spring.real + 0 * free, free)

    half_waves = int(corner.delay_samples) + more_delay + 2
    seeds = np.linspace(_SLOWEST_TURNS, 0.5, _SEEDS_PER_HALF_WAVE * half_waves + 1) / corner.sample_time_s
    scan = np.broadcast_to(seeds, (len(damping_ns_per_m), len(seeds)))
    softest = ends(scan)[0]
    if softest.any():
        softest = ends(refine_minima(lambda hz: -ends(hz)[0], scan, half_waves))[0]
    stiffest = ends(refine_minima(lambda hz: ends(hz)[1], scan, half_waves))[1]
    return softest, stiffest


def _port_ends(
    corner: Device, damping_ns_per_m: FloatArray, model: Model, poles: Poles
) -> tuple[FloatArray, FloatArray]:
    """Return the softest and stiffest passive walls K, N/m, of each damping B at frequencies, each (n, m).

    At the port of device and hand passivity is |1 + W X|^2 >= |W|^2 U^2, X and U of the device and W = B W_b + K W_k
    the rendered wall: a quadratic inequality in K.
    """
    port = handle_port(corner, frequencies_hz(corner))
    damper, spring = _waves(port.turns, corner.sample_time_s, model, poles)
    wall = damping_ns_per_m[:, None] * damper
    bend = -port.excess * np.abs(spring) ** 2 + 0 * wall.real
    slope = 2 * (spring * port.centre).real - 2 * port.excess * (wall * spring.conj()).real
    free = 1 + 2 * (wall * port.centre).real - port.excess * np.abs(wall) ** 2
    return quadratic_stretch(*(np.where(port.damped, part, -1.0) for part in (bend, slope, free)))


def _waves(turns: FloatArray, period: float, model: Model, poles: Poles) -> tuple[ComplexArray, ComplexArray]:
    """Return the held waves W of a damper of 1 N.s/m and of a spring of 1 N/m at turns f T, each of that shape.

    W is the sampled rendering behind its hold and, of the damper, behind the filter of the velocity, N.s/m.
    """
    zeros = np.zeros(1)
    ones = np.ones(1)
    damper = PartialFractions(direct=ones, integral=zeros, decaying=zeros, pole=zeros, pole_gap=ones, stable=ones > 0)
    direct = period / 2 if model == "paper" else period
    spring = replace(damper, direct=ones * direct, integral=ones * period)
    # 1 - 1/z without cancellation.
    difference = 2 * np.sin(np.pi * turns) * np.exp(1j * np.pi * (0.5 - turns))
    damper_wave = wave(damper, zeros, turns, model) * low_pass(difference, poles)
    return damper_wave, wave(spring, zeros, turns, model)


@accepts_problem
def zwidth(problem: AnyProblem, progress: Progress = SILENT) -> ZWidth:
    """Return the walls that a device can render (K-B region), passive or stable with its hands, without a coupling.

    Each claim holds at every corner of [device.range], on the device as declared; a linear velocity filter of [scene]
    acts on the damper. The stable regions are exact, by their boundary curves, and the passive ones of a rigid device
    with an ideal amplifier and whole samples of delay; others come from a scan of frequencies (as L3), and that with
    the paper's hold is refused there. A region ends at the smallest stiffness that does not meet the claim.

    Args:
        problem: the problem; or a problem file, or a name of the catalogue.
        progress: reported over the curves.

    Returns:
        Dampings B, N.s/m, and for each claim the largest stiffness K at each of them, N/m, both of shape (n,).

    Raises:
        InputError: faults of the file.
        UnsupportedError: what is declared has no exact discretisation.

    Example:
        >>> region = avc.zwidth("figure5")
        >>> round(region.passive_limit_n_per_m)
        4000
        >>> {curve.key: round(curve.stiffness_n_per_m[0]) for curve in region.curves if curve.key.startswith("stable")}
        {'stable-released': 4013, 'stable-hands': 10021}
    """
    problem = require_wall(problem)
    device = problem.device
    wall = problem.environment
    family = PlantFamily.of(problem)
    corners = family.devices
    hands = family.drawn().held
    damping = _dampings_ns_per_m(problem, corners)
    claims, refused = _claims(problem, corners, hands)
    # The last row is that of the requested wall.
    rows = np.append(damping, wall.damping_ns_per_m)
    curves = _curves(problem, claims, rows, progress)
    encoder_limit = _encoder_limit_n_per_m(device)
    used, not_used = _keys(problem, encoder_bound=encoder_limit > 0)
    least_damping = min(corner.damping_ns_per_m for corner in corners) if rigid(device) else np.nan
    delay_s = (0.5 + max(corner.delay_samples for corner in corners)) * device.sample_time_s
    return ZWidth(
        problem=problem.name,
        damping_ns_per_m=damping,
        curves=curves,
        target_damping_ns_per_m=wall.damping_ns_per_m,
        target_stiffness_n_per_m=wall.stiffness_n_per_m,
        rule_n_per_m=(least_damping + min(problem.hands.damping_ns_per_m) + damping) / delay_s,
        passive_spring_n_per_m=least_damping / delay_s,
        encoder_limit_n_per_m=encoder_limit or None,
        passive_limit_n_per_m=passive_limit_n_per_m(device),
        hands=len(hands),
        corners=len(corners),
        used=used,
        not_used=not_used,
        refused=refused,
        definition=problem,
    )


def _curves(problem: Problem, claims: Claims, rows: FloatArray, progress: Progress) -> tuple[Curve, ...]:
    """Return the curve of each claim; the last of the rows of dampings is that of the requested wall."""
    curves: list[Curve] = []
    for claim, walls in claims.items():
        progress.advance(len(curves), len(claims), str(claim))
        stretches = walls(rows)
        curves.append(
            Curve(
                claim=claim,
                delay_samples=problem.device.delay_samples + (claim.key == "passive-delayed"),
                stiffness_n_per_m=stretches.first_n_per_m[:-1],
                holds_target=bool(stretches.holds(problem.environment.stiffness_n_per_m)[-1]),
            )
        )
    return tuple(curves)


def _dampings_ns_per_m(problem: Problem, corners: Sequence[Device]) -> FloatArray:
    """Return the dampings of the walls: 0, and up to twice the larger of m/T and 2 b_d, of device with hand."""
    mass = max(corner.mass_kg for corner in corners) + max(problem.hands.mass_kg)
    device_damping = max(corner.damping_ns_per_m for corner in corners)
    heaviest = 2 * max(mass / problem.device.sample_time_s, 2 * device_damping, _LEAST_SCALE_NS_PER_M)
    return np.append(0.0, np.geomspace(_LIGHTEST_SHARE * heaviest, heaviest, _DAMPINGS))


def _encoder_limit_n_per_m(device: Device) -> float:
    """Return 2 f_c/Delta, the least over the device's ranges; 0 without an encoder."""
    limits = [
        2 * corner.coulomb_friction_n / corner.encoder_resolution_m
        for corner in device_corners(device, ("coulomb_friction_n", "encoder_resolution_m"))
        if corner.encoder_resolution_m
    ]
    return min(limits, default=0.0)


Claims = dict[WallClaim, Callable[[FloatArray], Stretches]]
"""The walls of which each claim holds, by their dampings (n,)."""


def _claims(problem: Problem, corners: Sequence[Device], hands: Hand) -> tuple[Claims, tuple[NoWallProof, ...]]:
    """Return all claims of a region, and why another has no proof on this device."""
    filters = [effect for effect in problem.scene.effects if isinstance(effect, VelocityFilterEffect)]
    poles = velocity_poles(problem.device, problem.scene, filters[-1], problem.name) if filters else PLAIN
    of_device = partial(
        WallClaim, delay_samples=problem.device.delay_samples, filtered=bool(filters), corners=len(corners)
    )
    passive, refused = _passivity(problem.device, corners, poles, of_device)
    stable: Claims = {
        of_device("stable-released"): partial(stable_walls, corners, released_hand(), poles=poles),
        of_device("stable-hands"): partial(stable_walls, corners, hands, poles=poles),
    }
    return passive | stable, refused


def _passivity(
    device: Device, corners: Sequence[Device], poles: Poles, of_device: Callable[[CurveKey], WallClaim]
) -> tuple[Claims, tuple[NoWallProof, ...]]:
    """Return the claims of passivity, and why one has no proof on this device."""
    is_ideal = ideal(device)
    walls = partial(passive_walls, corners, poles=poles)
    sampled: Claims = {of_device("passive-sampled-data"): partial(walls, model="sampled-data")}
    if not is_ideal or poles != PLAIN:
        return sampled, (NoWallProof(non_idealities(device)),)
    claims: Claims = {of_device("passive-paper"): partial(walls, model="paper"), **sampled}
    if max(corner.delay_samples for corner in corners) == 0:
        claims[of_device("passive-delayed")] = partial(walls, model="sampled-data", more_delay=1)
    return claims, ()


def _keys(problem: Problem, *, encoder_bound: bool) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the declared keys that enter the region or the encoder's bound, and those that do not."""
    linear = {key.partition(".")[0] for key in LINEAR_KEYS} | {"amplifier_order", "encoder_at"}
    known = linear | ({"coulomb_friction_n", "encoder_resolution_m"} if encoder_bound else set())
    keys = declared(problem)
    used = [key for key in keys if key.removeprefix("device.").removeprefix("range.").partition(".")[0] in known]
    unused = [key for key in keys if key not in used]
    unused += ["law"] if problem.law is not None else []
    filters = [effect for effect in problem.scene.effects if isinstance(effect, VelocityFilterEffect)]
    used += [f"scene.effects: {effect.kind}" for effect in filters]
    unused += [name for name in effects_of_scene_alone(problem) if name not in used]
    return tuple(used), tuple(unused)
