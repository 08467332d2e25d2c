"""Which of the candidates to deploy: the safest, of these the quiet, of these the stiffest and nearest."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.claims.deployable import deployable
from avc_casadi.model.corners import device_corners, device_set
from avc_casadi.recommendation.asked_first import SURELY
from avc_casadi.recommendation.candidates import Alternatives, felt_at_rest_n_per_m
from avc_casadi.recommendation.error_curve import error_curve
from avc_casadi.recommendation.rest import proved_first
from avc_casadi.simulation.population.coupling_trial import CouplingTrial, try_coupling, try_on_devices
from avc_casadi.simulation.population.settled import exact_interval

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence
    from concurrent.futures import Executor

    from avc_casadi.coupling import Coupling
    from avc_casadi.model.device import Device
    from avc_casadi.model.hands import Hand, StylusHand
    from avc_casadi.recommendation.asked_first import Group

# Stiffnesses closer than this share are equal: the coupling nearer to the wall in motion wins.
AS_STIFF = 0.01
# What a press feels of the stiffness at rest, below which it is what counts.
_SLOW = 0.95
# Share of the hands for whom a quiet coupling is quiet: a stiff wall is not given up for the last of the light ones.
QUIET_SHARE = 0.9
FIRST = 16
"""So many hands, the corners among them, try a coupling before the others do; only what these can use is for all."""
# Of equally stiff ones no more are tried: one after the other, where others refute the one before.
_MOST_TRIED = 5
# Devices of the declared ranges among which those who confirm it are divided.
_DEVICES = 16
ERROR_HZ = (1.0, 10.0, 50.0)


@dataclass(frozen=True)
class Judged:
    """A deployable coupling and how simulated hands fared with it.

    Attributes:
        coupling: what was tried.
        trial: how they fared.
        order: place among the candidates: the simpler ones come first.
        others: how people fared who had no part in the choice; None before they were asked.
        asked: these people.
        devices: among which they were dealt out in turn.
    """

    coupling: Coupling
    trial: CouplingTrial
    order: int
    others: CouplingTrial | None = None
    asked: Hand | None = None
    devices: tuple[Device, ...] = ()

    @cached_property
    def safety(self) -> int:
        """0: everybody rests without dry friction and with it; 1: with the declared friction; 2: not everybody."""
        everybody = all(bool(trial.stable.all()) for trial in self.trials)
        if everybody and all(bool(trial.stable_without_friction.all()) for trial in self.trials):
            return 0
        return 1 if everybody else 2

    @property
    def trials(self) -> tuple[CouplingTrial, ...]:
        """All that was seen of it."""
        return (self.trial,) if self.others is None else (self.trial, self.others)

    @property
    def at_rest(self) -> float:
        """Share of the hands that come to rest."""
        return sum(int(one.stable.sum()) for one in self.trials) / sum(one.hands for one in self.trials)

    @property
    def quiet(self) -> bool:
        """Whether next to nobody feels a vibration at rest, on the declared device and on those of its ranges."""
        return sum(int(one.quiet.sum()) for one in self.trials) >= QUIET_SHARE * sum(one.hands for one in self.trials)

    @property
    def felt_n_per_m(self) -> float:
        """Stiffness at rest, or that at the end of a press where a slow observer is still far from it."""
        at_rest, pressed = felt_at_rest_n_per_m(self.coupling), self.trial.stiffness
        return pressed if pressed < _SLOW * at_rest else at_rest

    def complete(self, *, lean_on_friction: bool) -> bool:
        """Whether it is as safe as is asked for, and quiet."""
        return self.safety <= int(lean_on_friction) and self.quiet


def tried(
    candidates: Iterable[Alternatives],
    before: list[Judged],
    people: Hand | StylusHand,
    seed: int,
    progress: Progress = SILENT,
    *,
    lean_on_friction: bool,
    executor: Executor | None = None,
    search: str = "",
) -> list[Judged]:
    """Try those that are deployable, the stiffest first, until nothing that is left could win.

    Args:
        candidates: the simpler ones first; some may have been judged already.
        before: what was judged already.
        people: who tries them.
        seed: of their draw, to be told.
        progress: told of the candidates.
        lean_on_friction: as in `best_of`.
        executor: as in `try_coupling`.
        search: which one the candidates come from that are new, to be told.

    Returns:
        What was judged before, and now.
    """
    ranked = sorted(enumerate(candidates), key=lambda pair: (-felt_at_rest_n_per_m(pair[1][0]), pair[0]))
    judged = list(before)
    for done, (order, alternatives) in enumerate(ranked, start=1):
        enough = [found for found in judged if found.complete(lean_on_friction=lean_on_friction)]
        if enough and felt_at_rest_n_per_m(alternatives[0]) < (1 - 2 * AS_STIFF) * max(
            found.felt_n_per_m for found in enough
        ):
            break
        for one in alternatives:
            known = next((found for found in judged if found.coupling is one), None)
            if known is not None and known.complete(lean_on_friction=lean_on_friction):
                break
            if known is not None or not deployable(one).passed:
                continue
            found = Judged(one, try_coupling(one, people.pick(slice(FIRST)), seed, executor=executor), order)
            if found.safety <= int(lean_on_friction) and len(people) > FIRST:
                found = replace(found, trial=try_coupling(one, people, seed, executor=executor))
            judged.append(found)
            if found.complete(lean_on_friction=lean_on_friction):
                break
        # Those that were tried before stand among the new ones.
        progress.advance(max(done, min(len(judged), len(ranked))), len(ranked), f"candidates tried, {search}")
    return judged


def likeliest(
    alternatives: Alternatives, groups: Iterable[Group], elsewhere: Sequence[Group] = (), *, lean_on_friction: bool
) -> tuple[Alternatives, bool]:
    """Take those with which everybody comes to rest, or the one with which most do; say whether everybody does.

    A single one without state feedback is taken as it is.

    Args:
        alternatives: equally stiff ones.
        groups: who try them: who follows only tries what all before came to rest with.
        elsewhere: who try them on other devices: with whom fewest of these move come first.
        lean_on_friction: whether the declared dry friction may help.
    """
    left = alternatives
    # Where only friction brings somebody to rest, another hand may be a little faster.
    slow = SURELY if lean_on_friction else 1.0
    asked = len(left) > 1 or left[0].runtime.state_feedback is not None
    for group in groups if asked else ():
        restless = (~(group.unrest(left, friction=lean_on_friction) < slow)).sum(axis=1)
        if restless.min() > 0:
            return [left[int(restless.argmin())]], False
        left = [one for one, moving in zip(left, restless, strict=True) if not moving]
    moving = np.zeros(len(left))
    for group in elsewhere if asked else ():
        moving += (~(group.unrest(left, friction=lean_on_friction) < slow)).sum(axis=1)
    fewest = np.argsort(moving, kind="stable")[:_MOST_TRIED]
    return [left[place] for place in fewest if moving[place] == 0 or moving.min() > 0], not moving.min()


def best_of(judged: list[Judged], *, lean_on_friction: bool = False) -> Judged:
    """Take the safest, of these the quiet, of these the stiffest, then the quietest, the provable and the nearest.

    Args:
        judged: at least one.
        lean_on_friction: whether rest by the declared dry friction is as good as rest without it.
    """

    def safety(one: Judged) -> int:
        return max(one.safety, 1) if lean_on_friction else one.safety

    safest = min(safety(one) for one in judged)
    left = [one for one in judged if safety(one) == safest]
    if safest == 2:
        most = max(one.at_rest for one in left)
        left = [one for one in left if one.at_rest == most]
    left = [one for one in left if one.quiet] or left
    if judged[0].coupling.wall.stiffness_n_per_m == 0:  # nothing is stiff: what is felt is noise
        return min(left, key=lambda one: (round(_error(one.coupling), 3), one.order))
    stiffness = [one.felt_n_per_m for one in left]
    as_stiff = [one for one, felt in zip(left, stiffness, strict=True) if felt >= (1 - AS_STIFF) * max(stiffness)]
    quiet = max(int(one.trial.quiet.sum()) for one in as_stiff)
    quietest = [one for one in as_stiff if int(one.trial.quiet.sum()) == quiet]
    return min(proved_first(quietest), key=lambda one: (round(_error(one.coupling), 3), one.order))


def confirmed(
    judged: list[Judged],
    people: Hand | StylusHand,
    others: Iterator[Hand],
    seed: int,
    *,
    lean_on_friction: bool,
    executor: Executor | None = None,
) -> list[Judged]:
    """Let everybody try what is best, then people who had no part in the choice, until it stays the best.

    Who is best of many before the same hands may owe it to these. Where the device has ranges, the others try it on
    devices all over them.

    Args:
        judged: at least one.
        people: who tries them.
        others: other people, each time they are asked for.
        seed: of their draws, to be told.
        lean_on_friction: as in `best_of`.
        executor: as in `try_coupling`.
    """
    while True:
        best = best_of(judged, lean_on_friction=lean_on_friction)
        if best.trial.hands < len(people):
            asked = replace(best, trial=try_coupling(best.coupling, people, seed, executor=executor))
        elif best.others is None:
            devices = _devices(best.coupling.problem.device, seed)
            strangers = next(others)
            found = try_on_devices(best.coupling, strangers, devices, seed, executor)
            asked = replace(best, others=found, asked=strangers, devices=tuple(devices))
        else:
            return judged
        judged = [asked if one is best else one for one in judged]


def _devices(device: Device, seed: int) -> list[Device]:
    """Take some of the devices that the declared ranges allow, in corners and within; the nominal one comes first."""
    corners = device_corners(device)
    if len(corners) == 1:
        return [device]
    some = np.random.default_rng(seed).permutation(len(corners))[: _DEVICES // 2]
    within = device_set(device, draws=_DEVICES - 1 - len(some), seed=seed)[len(corners) :]
    return [device, *(corners[place] for place in some), *within]


def devices_of(best: Judged | None) -> int:
    """Return among how many devices those were dealt out who confirmed a coupling, if there is one."""
    return 1 if best is None or best.others is None else best.others.devices


def reason_of(best: Judged | None, judged: list[Judged], considered: int) -> str:
    """Say why this one, or why none."""
    if best is None:
        return f"none of {considered} couplings is linearly stable with every hand of [hands] and let go"
    trial, device = best.trial, best.coupling.problem.device
    rough = device.coulomb_friction_n > 0 or device.range.coulomb_friction_n is not None
    who = {
        0: f"all of {trial.hands} simulated hands come to rest{', with and without dry friction' if rough else ''}",
        1: f"all of {trial.hands} simulated hands come to rest, but only thanks to the declared dry friction",
        2: f"{int(trial.stable.sum())} of {trial.hands} simulated hands come to rest, as many as with any candidate",
    }[best.safety]
    if best.others is not None:
        rest, free = best.others.stable, best.others.stable_without_friction
        where = "" if best.others.devices == 1 else f" on {best.others.devices} devices of [device.range]"
        who += f"; of {len(rest)} others{where} {int(rest.sum())}"
        who += f", without dry friction {int(free.sum())}" if rough else ""
        fewest = int((free if best.safety == 0 else rest).sum())
        who += f", so at least {100 * exact_interval(fewest, len(rest))[0]:.3g} % of all such hands, to 95 %"
    if len(judged) == 1:
        return f"the only deployable candidate that was tried, nothing stiffer being asked for: {who}"
    return f"the stiffest of {len(judged)} deployable candidates that are as safe: {who}"


def _error(coupling: Coupling) -> float:
    """Root of the mean squared complex error against the physical wall at the frequencies that are told."""
    curve = error_curve(coupling.problem, coupling)
    return float(np.sqrt(np.mean([curve.at(curve.physical, hz) ** 2 for hz in ERROR_HZ])))
