"""The K-B region of Colgate and Brown: walls B + K/s rendered without coupling."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi._util.json_values import plain_table
from avc_casadi._util.printed import Columns, Tabular, short
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.claims.impedance import wave
from avc_casadi.claims.levels import ideal, non_idealities
from avc_casadi.claims.port import frequencies_hz, handle_port, passive_hand
from avc_casadi.claims.worst_frequency import quadratic_stretch, refine_minima
from avc_casadi.files.problem_file import AnyProblem, of_problem, with_wall
from avc_casadi.loops.wall import Fractions, passive_limit_n_per_m, rigid
from avc_casadi.loops.walls import Stretches, stable_walls
from avc_casadi.model import EFFECTS
from avc_casadi.model.corners import LINEAR_KEYS, device_corners
from avc_casadi.model.declared import declared, declared_effects
from avc_casadi.model.device import Device
from avc_casadi.model.hands import hand_set, no_hand
from avc_casadi.model.problem import Model, Problem
from avc_casadi.model.runtime import PLAIN, Poles, VelocityFilterEffect, low_pass, velocity_poles


@dataclass(frozen=True, eq=False)
class Curve:
    """Largest stiffness of a wall at each wall damping for one claim."""

    key: str
    claim: str
    delay_samples: float
    stiffness_n_per_m: FloatArray
    holds_target: bool


@dataclass(frozen=True, eq=False, repr=False)
class ZWidth(Tabular):
    """The K-B region of a device as declared: at all corners of its ranges."""

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
    refused: tuple[str, ...]
    definition: Problem

    def to_dict(self) -> Columns:
        """Return B and the largest K of each claim as columns, each of shape (n,)."""
        curves = {f"{curve.key}_stiffness_n_per_m": curve.stiffness_n_per_m for curve in self.curves}
        return {"damping_ns_per_m": self.damping_ns_per_m, **curves}

    def _summary(self) -> str:
        spans = ", ".join(f"{curve.key} {short(curve.stiffness_n_per_m)}" for curve in self.curves)
        return f"{self.problem!r}, B {short(self.damping_ns_per_m)}; largest K: {spans}"

    def document(self) -> dict[str, Any]:
        """Return the `zwidth` document: JSON values only."""
        kept = ("encoder_limit_n_per_m", "passive_limit_n_per_m", "passive_spring_n_per_m", "rule_n_per_m")
        found: dict[str, Any] = {name: getattr(self, name) for name in ("problem", "hands", "refused", *kept)}
        found["device_corners"] = self.corners
        found |= {name: [*map(self.definition.units.key, vars(self)[name])] for name in ("used", "not_used")}
        found["wall_damping_ns_per_m"] = self.damping_ns_per_m
        found["curves"] = {
            curve.key: {name: getattr(curve, name) for name in ("claim", "delay_samples", "stiffness_n_per_m")}
            | {"wanted_wall": curve.holds_target}
            for curve in self.curves
        }
        wanted = {"damping_ns_per_m": self.target_damping_ns_per_m, "stiffness_n_per_m": self.target_stiffness_n_per_m}
        return plain_table(found | {"wanted": wanted})


def passive_walls(
    corners: Sequence[Device],
    damping_ns_per_m: FloatArray,
    model: Model,
    poles: Poles = PLAIN,
    more_delay: int = 0,
) -> Stretches:
    """Return the softest interval of stiffnesses with which a wall is passive at every corner of a device."""
    # At each frequency a quadratic in K: on a rigid device with an ideal amplifier and whole samples of delay
    # b_d + Re(z^-d W) >= 0 is linear in K and B; at the port of any other |1 + W X|^2 >= |W|^2 U^2, W = B W_b + K W_k.
    exact = all(ideal(corner) for corner in corners)
    low, high = np.zeros(len(damping_ns_per_m)), np.full(len(damping_ns_per_m), np.inf)
    for corner in corners:
        if exact:

            def ends(hz: FloatArray, corner: Device = corner) -> tuple[FloatArray, FloatArray]:
                turns = hz * corner.sample_time_s
                late = np.exp(-2j * np.pi * turns * (corner.delay_samples + more_delay))
                damper, spring = (late * one for one in _waves(turns, corner.sample_time_s, model, poles))
                free = corner.damping_ns_per_m + damping_ns_per_m[:, None] * damper.real
                return quadratic_stretch(np.zeros_like(free), spring.real + 0 * free, free)

            order = int(corner.delay_samples) + more_delay + 2
            seeds = np.linspace(1e-8, 0.5, 24 * order + 1) / corner.sample_time_s
            every = np.broadcast_to(seeds, (len(low), len(seeds)))
            softest, stiffest = ends(every)
            if softest.any():
                softest = ends(refine_minima(lambda hz, ends=ends: -ends(hz)[0], every, order))[0]  # type: ignore[misc]
            stiffest = ends(refine_minima(lambda hz, ends=ends: ends(hz)[1], every, order))[1]  # type: ignore[misc]
        else:
            port = handle_port(corner, frequencies_hz(corner))
            damper, spring = _waves(port.turns, corner.sample_time_s, model, poles)
            wall = damping_ns_per_m[:, None] * damper
            bend = -port.excess * np.abs(spring) ** 2 + 0 * wall.real
            slope = 2 * (spring * port.centre).real - 2 * port.excess * (wall * spring.conj()).real
            free = 1 + 2 * (wall * port.centre).real - port.excess * np.abs(wall) ** 2
            softest, stiffest = quadratic_stretch(*(np.where(port.damped, one, -1.0) for one in (bend, slope, free)))
            held = stable_walls([corner], passive_hand(corner), damping_ns_per_m, poles)
            low, high = np.maximum(low, held.lowest_n_per_m[:, 0]), np.minimum(high, held.first_n_per_m)
        low, high = np.maximum(low, softest.max(axis=1)), np.minimum(high, stiffest.min(axis=1))
    none = ~(high > low)
    return Stretches(np.where(none, np.nan, low)[:, None], np.where(none, np.nan, high)[:, None])


def _waves(turns: FloatArray, period: float, model: Model, poles: Poles) -> tuple[ComplexArray, ComplexArray]:
    """Return W of a wall of 1 N.s/m and of one of 1 N/m."""
    nothing, one = np.zeros(1), np.ones(1)
    damper = Fractions(one, nothing, nothing, nothing, one, one > 0)
    direct = period / 2 if model == "paper" else period
    spring = replace(damper, direct=one * direct, integral=one * period)
    back = 2 * np.sin(np.pi * turns) * np.exp(1j * np.pi * (0.5 - turns))
    damper_wave = wave(damper, nothing, turns, model) * low_pass(back, poles)
    return damper_wave, wave(spring, nothing, turns, model)


@of_problem
def zwidth(problem: AnyProblem, progress: Progress = SILENT) -> ZWidth:
    """Return the walls that a device can render (K-B region), passive or stable with its hands, without a coupling.

    Each claim holds at every corner of [device.range], on the device as declared; a linear velocity filter of [scene]
    acts on the damper. The stable regions are exact, by their boundary curves, and the passive ones of a rigid device
    with an ideal amplifier and whole samples of delay; others come from a scan of frequencies (as L3), and that with
    the paper's hold is refused there. A region ends at the smallest stiffness that does not meet the claim.

    Args:
        problem: the problem; or a problem file, or a name of the catalogue.
        progress: reported over the curves.

    Example:
        >>> region = avc.zwidth("figure5")
        >>> round(region.passive_limit_n_per_m)
        4000
    """
    problem = with_wall(problem)
    device, wall = problem.device, problem.environment
    corners = device_corners(device, LINEAR_KEYS)
    mass = max(corner.mass_kg for corner in corners) + max(problem.hands.mass_kg)
    damped = max(corner.damping_ns_per_m for corner in corners)
    top = 2 * max(mass / device.sample_time_s, 2 * damped, 1e-3)
    # With a quarter of them narrow peaks of a resonant device were passed by: 11 % of their stiffness.
    damping = np.append(0.0, np.geomspace(1e-4 * top, top, 240))
    # The last row is that of the requested wall.
    rows = np.append(damping, wall.damping_ns_per_m)
    hands = hand_set(problem.hands)
    filters = [one for one in problem.scene.effects if isinstance(one, VelocityFilterEffect)]
    poles = velocity_poles(problem, filters[-1]) if filters else PLAIN
    beside = ", with the velocity filter of the scene" if filters else ""
    claims, refused = _passivity(device, corners, poles, beside)
    at = _at(device, len(corners), beside)
    claims |= {
        "stable-released": (f"linearly stable without a hand{at}", partial(stable_walls, corners, no_hand())),
        "stable-hands": (f"linearly stable with every hand{at}", partial(stable_walls, corners, hands)),
    }
    curves: list[Curve] = []
    for key, (claim, walls) in claims.items():
        progress.advance(len(curves), len(claims), claim)
        found = walls(rows, poles=poles)
        late = device.delay_samples + (key == "passive-delayed")
        holds_target = bool(found.holds(wall.stiffness_n_per_m)[-1])
        curves.append(Curve(key, claim, late, found.first_n_per_m[:-1], holds_target))
    ends = device_corners(device, ("coulomb_friction_n", "encoder_resolution_m"))
    limit = min(
        (2 * one.coulomb_friction_n / one.encoder_resolution_m for one in ends if one.encoder_resolution_m), default=0.0
    )
    used, not_used = _keys(problem, encoder_bound=limit > 0)
    least = min(corner.damping_ns_per_m for corner in corners) if rigid(device) else np.nan
    delay_s = (0.5 + max(corner.delay_samples for corner in corners)) * device.sample_time_s
    return ZWidth(
        problem=problem.name,
        damping_ns_per_m=damping,
        curves=tuple(curves),
        target_damping_ns_per_m=wall.damping_ns_per_m,
        target_stiffness_n_per_m=wall.stiffness_n_per_m,
        rule_n_per_m=(least + min(problem.hands.damping_ns_per_m) + damping) / delay_s,
        passive_spring_n_per_m=least / delay_s,
        encoder_limit_n_per_m=limit or None,
        passive_limit_n_per_m=passive_limit_n_per_m(device),
        hands=len(hands),
        corners=len(corners),
        used=used,
        not_used=not_used,
        refused=refused,
        definition=problem,
    )


def _passivity(
    device: Device, corners: Sequence[Device], poles: Poles, beside: str
) -> tuple[dict[str, tuple[str, partial[Stretches]]], tuple[str, ...]]:
    """Return the claims of passivity, and those that have no proof on this device."""
    at, known = _at(device, len(corners), beside), ideal(device)
    walls = partial(passive_walls, corners)
    sampled = {"passive-sampled-data": (f"passive, sampled-data{at}", partial(walls, model="sampled-data"))}
    if not known or poles != PLAIN:
        what = "a velocity filter" if known else non_idealities(device)
        why = (
            f"passive with the paper's hold: no proof on a device with {what}, for which that hold gives no loop from "
            "sample to sample"
        )
        return sampled, (why,)
    claims = {"passive-paper": (f"passive, paper's hold{at}", partial(walls, model="paper")), **sampled}
    if max(corner.delay_samples for corner in corners) == 0:
        late = partial(walls, model="sampled-data", more_delay=1)
        claims["passive-delayed"] = (f"passive, sampled-data, 1 sample of delay{at}", late)
    return claims, ()


def _at(device: Device, corners: int, beside: str) -> str:
    """Return the qualification of a claim, in words."""
    late = device.delay_samples
    delay = f", {late:g} sample{'' if late == 1 else 's'} of delay" if late else ""
    return delay + beside + (f", at {corners} corners of the device" if corners > 1 else "")


def _keys(problem: Problem, *, encoder_bound: bool) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the declared keys that enter the region or the encoder's bound, and those that do not."""
    linear = {key.partition(".")[0] for key in LINEAR_KEYS} | {"amplifier_order", "encoder_at"}
    known = linear | ({"coulomb_friction_n", "encoder_resolution_m"} if encoder_bound else set())
    keys = declared(problem)
    used = [key for key in keys if key.removeprefix("device.").removeprefix("range.").partition(".")[0] in known]
    unused = [key for key in keys if key not in used]
    simulated = {effect.kind for effect in declared_effects(problem)}
    for effect in problem.scene.effects:
        if EFFECTS[effect.kind].scene_alone and effect.kind not in simulated:
            name = f"scene.effects: {effect.kind}"
            (used if isinstance(effect, VelocityFilterEffect) else unused).append(name)
    return tuple(used), tuple(unused)
