"""Recommend: which coupling to deploy, how stiff it feels, what holds it back, and what would help."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi.certificate import certified, deployable
from avc_casadi.coupling import Coupling, coupling_document
from avc_casadi.loop import LINEAR_KEYS, hand_corners, with_let_go
from avc_casadi.problem import Problem, declared, declared_effects, load_problem
from avc_casadi.recommendation._candidates import candidates
from avc_casadi.recommendation._error_curve import error_curve
from avc_casadi.recommendation._helps import Help, what_would_help
from avc_casadi.stability import stiffest_wall
from avc_casadi.support import SILENT, Comparable, Progress, plain, short
from avc_casadi.trial import CouplingTrial, people_of, try_coupling

if TYPE_CHECKING:
    from avc_casadi.coupling import GainSchedule
    from avc_casadi.loop import Hand, StylusHand

SCHEMA = "avc-recommend/1"
# Stiffnesses closer than this share are equal: the coupling nearer to the wall in motion wins.
_AS_STIFF = 0.01
_ERROR_HZ = (1.0, 10.0, 50.0)


@dataclass(frozen=True, eq=False, repr=False)
class Recommendation(Comparable):
    """The coupling to deploy and what is known of it.

    Attributes:
        problem: the problem as stated.
        coupling: certified and tried; None where no coupling is deployable.
        trial: how simulated hands fared with it; None without a coupling.
        deployable: whether the coupling may go into the device.
        stiffest_wall_n_per_m: the stiffest wall that is linearly stable with every hand and let go for some contact
            damping, on the loop that the design knows.
        helps: what would allow a stiffer wall.
        considered: how many couplings were judged.
        reason: one sentence: why this one, or why none.
        assumed: what is assumed.
        not_used: what the problem declares and nothing here uses.

    Example:
        >>> found = avc.recommend("figure5", hands=10)
        >>> found.deployable, found.trial.hands
        (True, 10)
    """

    problem: Problem
    coupling: Coupling | None
    trial: CouplingTrial | None
    deployable: bool
    stiffest_wall_n_per_m: float
    helps: tuple[Help, ...]
    considered: int
    reason: str
    assumed: tuple[str, ...]
    not_used: tuple[str, ...]

    def __repr__(self) -> str:
        felt = "none" if self.trial is None else f"{self.coupling!r}, felt {short(self.trial.stiffness_n_per_m, 'N/m')}"
        return f"Recommendation({self.problem.name!r}: {felt}; {self.reason})"

    def felt(self) -> dict[str, Any]:
        """Return what the hand feels: stiffness, complex error against the physical wall, tap, vibration."""
        if self.coupling is None or self.trial is None:
            return {"stiffness_n_per_m": None, "share_of_wall": None}
        tried = self.trial.document()
        curve = error_curve(self.problem, self.coupling.table)
        return {
            "stiffness_n_per_m": tried["stiffness_n_per_m"]["median"],
            "share_of_wall": tried["share_of_wall"],
            "complex_error": {f"{hz:g}": curve.at(curve.physical, hz) for hz in _ERROR_HZ},
            "tap_force_n": tried["tap_force_n"],
            "tap_depth_m": tried["tap_depth_m"],
            "vibration": tried["felt_vibration"],
            "friction_n": self.problem.device.coulomb_friction_n,
        }

    def document(self) -> dict[str, Any]:
        """Return the `recommend` document: JSON values only."""
        found: dict[str, Any] = plain(
            {
                "schema": SCHEMA,
                "problem": self.problem.name,
                "deployable": self.deployable,
                "reason": self.reason,
                "coupling": None if self.coupling is None else coupling_document(self.coupling),
                "felt": self.felt(),
                "stiffest_wall_n_per_m": self.stiffest_wall_n_per_m,
                "trial": None if self.trial is None else self.trial.document(),
                "certificate": None if self.coupling is None else dict(self.coupling.certificate or {}),
                "what_would_help": [vars(one) for one in self.helps],
                "considered": self.considered,
                "assumed": list(self.assumed),
                "not_used": list(self.not_used),
            }
        )
        return found


def judged_as_recommended(
    problem: Problem,
    gains: GainSchedule,
    hands: int = 100,
    seed: int = 0,
    *,
    versions: Mapping[str, str] | None = None,
    progress: Progress = SILENT,
) -> Recommendation:
    """Certify and try the gains of a method as `recommend` does with its own, whatever the verdict.

    Args:
        problem: what the gains were made for.
        gains: by any method.
        hands: number of simulated hands.
        seed: of their draw.
        versions: of what made it, by package.
        progress: told of the rows that are judged and the motions that are tried.
    """
    found = certified(Coupling.of(problem, gains, versions=versions), progress)
    tried = try_coupling(found, people_of(problem.hands, hands, seed), seed, progress)
    verdict = deployable(found, progress)
    extreme = hand_corners(problem.hands)
    return Recommendation(
        problem=problem,
        coupling=found.with_trial(tried.document()),
        trial=tried,
        deployable=verdict.passed,
        stiffest_wall_n_per_m=float(stiffest_wall(problem.device, with_let_go(extreme)).stiffness_n_per_m),
        helps=what_would_help(problem, extreme),
        considered=1,
        reason=f"the gains of {gains.method}, as asked for; {verdict.sentence}",
        assumed=_assumed(problem, found),
        not_used=_not_used(problem),
    )


@dataclass(frozen=True)
class _Judged:
    coupling: Coupling
    trial: CouplingTrial
    order: int

    @property
    def safety(self) -> int:
        """0: everybody rests without dry friction and with it; 1: with the declared friction; 2: not everybody."""
        everybody = bool(self.trial.stable.all())
        if everybody and bool(self.trial.stable_without_friction.all()):
            return 0
        return 1 if everybody else 2


def stiffest(problem: Problem) -> dict[str, Any]:
    """Search only the stiffest wall that the device can give to every hand and let go, and what would help.

    Returns:
        The document of `avc recommend P --stiffest`: JSON values.
    """
    extreme = hand_corners(problem.hands)
    found = stiffest_wall(problem.device, with_let_go(extreme))
    document: dict[str, Any] = plain(
        {
            "schema": SCHEMA,
            "problem": problem.name,
            "stiffest_wall_n_per_m": found.stiffness_n_per_m,
            "damping_ns_per_m": [found.lowest_ns_per_m, found.highest_ns_per_m],
            "what_would_help": [vars(one) for one in what_would_help(problem, extreme)],
            "assumed": list(_assumed(problem)),
            "not_used": list(_not_used(problem)),
        }
    )
    return document


def recommend(
    problem: Problem | str | Path,
    hands: int = 100,
    seed: int = 0,
    *,
    versions: Mapping[str, str] | None = None,
    progress: Progress = SILENT,
) -> Recommendation:
    """Choose the coupling to deploy.

    Only couplings are considered that are linearly stable with every hand of [hands] and let go. Of these the safest
    win: everybody at rest without dry friction, then with the declared one, then as many as possible; among equally
    safe ones those whose rest nobody feels, then the stiffest, then those nearest to the wall in motion.

    Args:
        problem: device with what is known of it, wall and hands; or a problem file, or a name of the catalogue.
        hands: number of simulated hands, corners of [hands] among them.
        seed: of their draw.
        versions: of what makes it, by package; written into the coupling.
        progress: told of the candidates that are tuned, judged and tried.

    Example:
        >>> found = avc.recommend("figure5", hands=10)
        >>> 60e3 < found.felt()["stiffness_n_per_m"] < found.stiffest_wall_n_per_m
        True
    """
    problem = problem if isinstance(problem, Problem) else load_problem(problem)
    people, extreme = people_of(problem.hands, hands, seed), hand_corners(problem.hands)
    limit = stiffest_wall(problem.device, with_let_go(extreme))
    every = list(candidates(problem, extreme, limit, progress))
    judged = _tried(_safe(every, progress), people, seed, progress)
    considered = len(every)
    best = _best(judged) if judged else None
    return Recommendation(
        problem=problem,
        coupling=None
        if best is None
        else replace(certified(best.coupling, progress).with_trial(best.trial.document()), versions=versions or {}),
        trial=None if best is None else best.trial,
        deployable=best is not None,
        stiffest_wall_n_per_m=limit.stiffness_n_per_m,
        helps=what_would_help(problem, extreme),
        considered=considered,
        reason=_reason(best, judged, considered),
        assumed=_assumed(problem, None if best is None else best.coupling),
        not_used=_not_used(problem),
    )


def _safe(every: list[Coupling], progress: Progress) -> list[Coupling]:
    """Keep the couplings that are deployable."""
    safe: list[Coupling] = []
    for done, one in enumerate(every, start=1):
        if deployable(one).passed:
            safe.append(one)
        progress.advance(done, len(every), "candidates judged")
    return safe


def _tried(safe: list[Coupling], people: Hand | StylusHand, seed: int, progress: Progress) -> list[_Judged]:
    """Try deployable couplings, the stiffest first, until nothing that is left could win."""
    ranked = sorted(enumerate(safe), key=lambda pair: (-_expected(pair[1]), pair[0]))
    judged: list[_Judged] = []
    for order, one in ranked:
        enough = [found for found in judged if found.safety == 0 and bool(found.trial.quiet.all())]
        if enough and _expected(one) < (1 - 2 * _AS_STIFF) * max(_expected(found.coupling) for found in enough):
            break
        judged.append(_Judged(one, try_coupling(one, people, seed), order))
        progress.advance(len(judged), len(ranked), "deployable candidates tried")
    return judged


def _expected(coupling: Coupling) -> float:
    """Stiffness of coupling and wall in series at rest, N/m."""
    k, wall = coupling.table.at_rest.stiffness_n_per_m, coupling.wall.stiffness_n_per_m
    return k * wall / (k + wall) if k + wall else 0.0


def _best(judged: list[_Judged]) -> _Judged:
    """Take the safest, of these the quiet, of these the stiffest, of these the simplest."""
    safest = min(one.safety for one in judged)
    left = [one for one in judged if one.safety == safest]
    if safest == 2:
        most = max(int(one.trial.stable.sum()) for one in left)
        left = [one for one in left if int(one.trial.stable.sum()) == most]
    quiet = [one for one in left if bool(one.trial.quiet.all())]
    left = quiet or left
    if judged[0].coupling.wall.stiffness_n_per_m == 0:  # nothing is stiff: what is felt is noise
        return min(left, key=lambda one: (round(_error(one.coupling), 3), one.order))
    stiffness = [np.nan_to_num(one.trial.stiffness) for one in left]
    as_stiff = [one for one, felt in zip(left, stiffness, strict=True) if felt >= (1 - _AS_STIFF) * max(stiffness)]
    return min(as_stiff, key=lambda one: (round(_error(one.coupling), 3), one.order))


def _error(coupling: Coupling) -> float:
    """Root of the mean squared complex error against the physical wall at the frequencies that are told."""
    curve = error_curve(coupling.problem, coupling.table)
    return float(np.sqrt(np.mean([curve.at(curve.physical, hz) ** 2 for hz in _ERROR_HZ])))


def _reason(best: _Judged | None, judged: list[_Judged], considered: int) -> str:
    if best is None:
        return f"none of {considered} couplings is linearly stable with every hand of [hands] and let go"
    trial = best.trial
    who = {
        0: f"all of {trial.hands} simulated hands come to rest, with and without dry friction",
        1: f"all of {trial.hands} simulated hands come to rest, but only thanks to the declared dry friction",
        2: f"{int(trial.stable.sum())} of {trial.hands} simulated hands come to rest, as many as with any candidate",
    }[best.safety]
    return f"the stiffest of {len(judged)} deployable candidates that are as safe: {who}"


def _assumed(problem: Problem, coupling: Coupling | None = None) -> tuple[str, ...]:
    """Say what is taken for granted."""
    device = problem.device
    gaps = [
        "hands are linear, on one axis, and constant while they hold on",
    ]
    if device.amplifier_bandwidth_hz is None and device.resonance is None:
        gaps.append("amplifier and structure are ideal: no bandwidth and no resonance is declared")
    elif device.amplifier_bandwidth_hz is None:
        gaps.append("the amplifier is ideal: no bandwidth is declared")
    elif device.resonance is None:
        gaps.append("the structure is rigid: no resonance is declared")
    if device.coulomb_friction_n == 0:
        gaps.append("no dry friction is declared: none is assumed, the cautious end")
    if device.encoder_resolution_m == 0:
        gaps.append("no encoder resolution is declared: the position is taken as exact, the ideal end")
    if device.max_force_n is None:
        gaps.append("no force limit is declared: any force is taken as given")
    linear, rest = _ranges(problem)
    gaps += [f"{key}: linear stability at its corners, trial at nominal" for key in linear]
    gaps += [f"{key}: trial at nominal; no part of linear stability" for key in rest]
    if coupling is not None:
        gaps += _outside(coupling)
    return tuple(gaps)


def _ranges(problem: Problem) -> tuple[list[str], list[str]]:
    """Return the declared ranges that linear stability is judged over, and those of what is simulated alone."""
    keys = [key for key in declared(problem) if key.startswith(_RANGE) and key not in _not_simulated(problem)]
    return (
        [key for key in keys if key.removeprefix(_RANGE) in LINEAR_KEYS],
        [key for key in keys if key.removeprefix(_RANGE) not in LINEAR_KEYS],
    )


def _outside(coupling: Coupling) -> list[str]:
    """Say where gains leave the gain box of [coupling]."""
    box, gains = coupling.problem.coupling, coupling.table.gains
    left = [
        f"{symbol} of {outside[np.argmax(np.abs(outside - low))]:.4g} {unit} lies outside [{low:g}, {high:g}]"
        for (symbol, unit), (low, high), values in zip(
            (("b", "N.s/m"), ("k", "N/m"), ("b_p", "N.s/m")),
            (box.damping_ns_per_m, box.stiffness_n_per_m, box.contact_damping_ns_per_m),
            gains,
            strict=True,
        )
        if len(outside := values[(values < low) | (values > high)])
    ]
    if not left:
        return []
    return [f"the gain box of [coupling] does not bound what is recommended: {' and '.join(left)}"]


def _not_simulated(problem: Problem) -> set[str]:
    """Return the declared keys that an encoder at the handle does not see: the play lies between it and the motor."""
    device = problem.device
    at_handle = device.encoder_at == "handle" and device.resonance is not None
    return {"device.backlash_m", "device.range.backlash_m"} if at_handle else set()


def _not_used(problem: Problem) -> tuple[str, ...]:
    """Name what the problem declares and no candidate, certificate or trial uses."""
    unused = [f"{key} (not seen by an encoder at the handle)" for key in declared(problem)]
    unused = [line for line in unused if line.partition(" ")[0] in _not_simulated(problem)]
    simulated = {effect.kind for effect in declared_effects(problem)}
    listed = [effect.kind for effect in problem.scene.effects if effect.kind in _SCENE_ALONE - simulated]
    return (*unused, *(f"scene.effects: {kind} (simulated by avc simulate alone)" for kind in listed))


_RANGE = "device.range."
_SCENE_ALONE = {
    "noise",
    "jitter",
    "amplifier",
    "resonance",
    "backlash",
    "viscous-friction",
    "velocity-filter",
    "notch",
    "compensator",
}
