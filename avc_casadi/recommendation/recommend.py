"""Recommend a coupling to deploy, with its rendered stiffness, its limits and their sensitivities."""

from __future__ import annotations

import math
from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

from avc_casadi._util.json_values import plain
from avc_casadi._util.parallel import Crew
from avc_casadi._util.printed import Printed, short
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi._util.units import N_PER_M, in_its_units
from avc_casadi.claims.deployable import certified, deployable
from avc_casadi.claims.stability.margins import OpenLoop
from avc_casadi.claims.stability.stiffest_wall import stiffest_wall
from avc_casadi.claims.stability.transient import transients
from avc_casadi.coupling import Coupling
from avc_casadi.files.coupling_file import coupling_document
from avc_casadi.files.problem_file import AnyProblem, of_problem, with_wall
from avc_casadi.model.hands import hand_corners, with_released
from avc_casadi.model.problem import Problem
from avc_casadi.recommendation.beyond_file import Withstood, margins, missed
from avc_casadi.recommendation.contact_onset import NOTICED_N, contact_onset_m
from avc_casadi.recommendation.generate import static_stiffness_n_per_m
from avc_casadi.recommendation.limit_cycle_freedom import LimitCycleFreedom, with_rest
from avc_casadi.recommendation.perturbed_devices import PerturbedDevices, off_file
from avc_casadi.recommendation.preconditions import assumed, not_used, nothing_rendered, why_infeasible
from avc_casadi.recommendation.rank import Judged, best_of, devices_of, reason_of
from avc_casadi.recommendation.rebound import rebound
from avc_casadi.recommendation.ripple import ripple
from avc_casadi.recommendation.search_schedule import judged_candidates
from avc_casadi.recommendation.sensitivity import Help, what_would_help
from avc_casadi.recommendation.shaken import shaken
from avc_casadi.simulation.population.coupling_trial import CouplingTrial, try_coupling
from avc_casadi.simulation.population.operators import GRIPS, draw_population, people_of

if TYPE_CHECKING:
    from avc_casadi.model.device import Device
    from avc_casadi.model.schedule import GainSchedule

SCHEMA = "avc-recommend/1"
OTHER_HANDS = {"stylus": "on a stylus", "fingertip": "one fingertip"}
"""Grips outside [hands], as they are reported."""


@dataclass(frozen=True, eq=False, repr=False)
class Recommendation(Printed):
    """The coupling to deploy and its analysis.

    Attributes:
        problem: the problem as stated.
        coupling: certified and tried; None where no coupling is deployable.
        trial: result with simulated hands; None without a coupling.
        confirmed: result with hands of [hands] outside the selection; None where nothing was chosen.
        beside: results with hands outside the design set, by grip.
        off_file: result of the corner hands on devices perturbed by a tenth; None without a coupling or where every
            value of the device has a range.
        beyond_file: results with one unmodelled effect each: lighter device, missed samples, extra resonance.
        deployable: whether the coupling may be loaded into the device.
        rest: limit-cycle freedom with every hand, making and breaking contact; None without a coupling.
        stiffest_wall_n_per_m: the stiffest wall found that is linearly stable with every hand and released: with a
            plain spring and damper, or with one of the couplings judged, which are no stiffer than the wall.
        plain_wall_n_per_m: that of a plain spring and damper by linear stability alone.
        with_friction_n_per_m: rendered stiffness of the stiffest one tried if settling by the declared dry friction
            sufficed; a search for that may find more. None without any.
        helps: sensitivity of the stiffness limit of a plain spring and damper.
        considered: number of couplings judged.
        reason: one sentence: why this one, or why none.
        assumed: assumptions.
        not_used: declared keys that the analysis does not use.

    Example:
        >>> found = avc.recommend("spring", hands=10)
        >>> found.deployable, found.trial.hands
        (True, 10)
    """

    problem: Problem
    coupling: Coupling | None
    trial: CouplingTrial | None
    confirmed: CouplingTrial | None
    beside: Mapping[str, CouplingTrial]
    off_file: PerturbedDevices | None
    beyond_file: tuple[Withstood, ...]
    deployable: bool
    rest: LimitCycleFreedom | None
    stiffest_wall_n_per_m: float
    plain_wall_n_per_m: float
    with_friction_n_per_m: float | None
    helps: tuple[Help, ...]
    considered: int
    reason: str
    assumed: tuple[str, ...]
    not_used: tuple[str, ...]

    @in_its_units
    def __repr__(self) -> str:
        felt = (
            "none" if self.trial is None else f"{self.coupling!r}, felt {short(self.trial.stiffness_n_per_m, N_PER_M)}"
        )
        return f"Recommendation({self.problem.name!r}: {felt}; {self.reason})"

    def felt(self) -> dict[str, Any]:
        """Return what is rendered: stiffness, impedance error against the physical wall, tap, vibration."""
        if self.coupling is None or self.trial is None:
            return {"stiffness_n_per_m": None, "share_of_wall": None}
        tried = self.trial.document()
        springy = self.problem.environment.stiffness_n_per_m > 0
        sensed = tried["stiffness_n_per_m"]["median"] if springy else None
        motion = shaken(self.coupling, static_stiffness_n_per_m(self.coupling))
        return {
            "stiffness_n_per_m": sensed,
            "stiffness_at_handle_n_per_m": None if sensed is None else _at_handle(self.problem.device, sensed),
            "share_of_wall": tried["share_of_wall"] if springy else None,
            "complex_error": motion.errors(),
            "stiffness_in_motion_n_per_m": motion.stiffnesses(),
            "shaken": {"depth_m": motion.depth_m, "amplitude_m": motion.amplitude_m},
            "tap_force_n": tried["tap_force_n"],
            "tap_depth_m": tried["tap_depth_m"],
            "edge_m": contact_onset_m(self.coupling) if springy else {},
            "edge_force_n": NOTICED_N * self.problem.device.metres_per_unit,
            "rebound": rebound(self.coupling) if springy else {},
            "vibration": tried["felt_vibration"],
            "friction_n": self.problem.device.coulomb_friction_n,
            "rest_error_m": self.problem.device.coulomb_friction_n / sensed if sensed else None,
            "encoder_step_n": self._encoder_step_n(),
            "ripple": vars(ripple(self.coupling, self.trial.seed)),
        }

    def _encoder_step_n(self) -> dict[str, float]:
        """Return the force step at an encoder step: of the spring, and for one sample of the damping."""
        coupling, device = self.coupling, self.problem.device
        if coupling is None:
            return {}
        step, damping = device.encoder_resolution_m, coupling.table.at_rest.contact_damping_ns_per_m
        damping += self.problem.environment.damping_ns_per_m
        return {"spring": static_stiffness_n_per_m(coupling) * step, "damping": damping * step / device.sample_time_s}

    def transient(self) -> dict[str, Any]:
        """Return how the linear loop in contact settles, released and with the worst hand; empty without a coupling.

        A settling time is None where an oscillation does not die away.
        """
        if self.coupling is None:
            return {}
        found = zip(("released", "worst_hand"), transients(self.coupling), strict=True)
        return {
            who: vars(one) | {"settling_s": one.settling_s if math.isfinite(one.settling_s) else None}
            for who, one in found
        }

    def margins(self) -> dict[str, Any]:
        """Return the stability margins at the actuator: released, and the smallest with a hand.

        Gain margins as factors, up and down, phase margin in degrees, delay margin in samples; None without a limit;
        empty without a coupling.
        """
        if self.coupling is None:
            return {}
        found = zip(("released", "worst_hand"), OpenLoop.of(self.coupling).margins(), strict=True)
        margins: dict[str, Any] = plain({who: vars(one) for who, one in found})
        return margins

    def document(self) -> dict[str, Any]:
        """Return the `recommend` document: JSON values only."""
        found: dict[str, Any] = plain(
            {
                "schema": SCHEMA,
                "problem": self.problem.name,
                "deployable": self.deployable,
                "rest": None if self.rest is None else self.rest.document(),
                "reason": self.reason,
                "coupling": None if self.coupling is None else coupling_document(self.coupling),
                "felt": self.felt(),
                "transient": self.transient(),
                "margins": self.margins(),
                "stiffest_wall_n_per_m": self.stiffest_wall_n_per_m,
                "plain_wall_n_per_m": self.plain_wall_n_per_m,
                "with_friction_n_per_m": self.with_friction_n_per_m,
                "trial": None if self.trial is None else self.trial.document(),
                "confirmed": None if self.confirmed is None else self.confirmed.counts(),
                "other_hands": {holding: trial.counts() for holding, trial in self.beside.items()},
                "off_file": None if self.off_file is None else self.off_file.document(),
                "beyond_file": [vars(one) for one in self.beyond_file],
                "certificate": None if self.coupling is None else dict(self.coupling.certificate or {}),
                "what_would_help": [vars(one) for one in self.helps],
                "considered": self.considered,
                "assumed": list(self.assumed),
                "not_used": list(self.not_used),
            }
        )
        return found


def _at_handle(device: Device, stiffness_n_per_m: float) -> float:
    """Return the stiffness at the handle: with an encoder at the motor, the structure's compliance adds."""
    mode = device.resonance
    if mode is None or device.encoder_at == "handle":
        return stiffness_n_per_m
    reduced = device.mass_kg * mode.mass_ratio * (1 - mode.mass_ratio)
    spring = reduced * (2 * math.pi * mode.frequency_hz) ** 2
    return stiffness_n_per_m * spring / (stiffness_n_per_m + spring)


def judged_as_recommended(
    problem: Problem,
    gains: GainSchedule,
    hands: int = 100,
    *,
    versions: Mapping[str, str] | None = None,
    progress: Progress = SILENT,
) -> Recommendation:
    """Certify and try the gains of a method as `recommend` does its own, whatever the verdict.

    Args:
        problem: problem of the gains.
        gains: by any method.
        hands: number of simulated hands.
        versions: of the software that made it, by package.
        progress: reports the rows judged and the motions simulated.
    """
    found = certified(Coupling.of(problem, gains, versions=versions), progress)
    found, rest = with_rest(found, progress)
    tried = try_coupling(found, people_of(problem.hands, hands), 0, progress)
    verdict = deployable(found, progress)
    extreme = hand_corners(problem.hands)
    limit = stiffest_wall(problem.device, with_released(extreme))
    beyond = margins(found, limit)
    lacks = nothing_rendered(problem, static_stiffness_n_per_m(found), tried) or missed(beyond, by_friction=False)
    return Recommendation(
        problem=problem,
        coupling=found.with_trial(tried.document()),
        trial=tried,
        confirmed=None,
        beside=_beside(found, hands, 0),
        off_file=off_file(found, 0),
        beyond_file=beyond,
        deployable=verdict.passed and not lacks,
        rest=rest,
        stiffest_wall_n_per_m=limit.stiffness_n_per_m,
        plain_wall_n_per_m=limit.stiffness_n_per_m,
        with_friction_n_per_m=None,
        helps=what_would_help(problem, extreme),
        considered=1,
        reason=f"the gains of {gains.method}, as asked for; {lacks or verdict.sentence}",
        assumed=assumed(problem, found),
        not_used=not_used(problem),
    )


@of_problem
def recommend(
    problem: AnyProblem,
    hands: int = 100,
    seed: int = 0,
    *,
    lean_on_friction: bool = False,
    prove: bool = False,
    versions: Mapping[str, str] | None = None,
    workers: int = 1,
    progress: Progress = SILENT,
    executor: Executor | None = None,
) -> Recommendation:
    """Return the coupling to deploy.

    Candidates are linearly stable with every hand of [hands] and released. They are ranked by safety: all hands
    settle without dry friction, then with the declared one, then as many as possible; then by whether the residual
    vibration is below the detection threshold of nine hands in ten; then by impedance mismatch from 1 to 30 Hz, with
    a price on a long settling time when released; then by vibration, provability and stiffness. Twice as many hands
    outside the selection confirm the choice, on devices throughout [device.range].

    Args:
        problem: device with its ranges, wall and hands; or a problem file, or a name of the catalogue.
        hands: number of simulated hands, corners of [hands] among them.
        seed: of their draw.
        lean_on_friction: whether settling by the declared dry friction alone suffices.
        prove: request proofs of the chosen coupling, as `certify` does; without it limit-cycle freedom is proved where
            that takes a second or two, and simulated otherwise.
        versions: of the software that made it, by package; written into the coupling.
        workers: processes, this one among them; more than one start this program anew, so that a script needs its
            guard. The result does not depend on it.
        progress: reports the candidates tuned, judged and tried.
        executor: runs the trials, as for `mapped`: for many thousands.

    Raises:
        InputError: workers that are no whole number of 1 or more.
        WorkerLostError: a worker died.

    Example:
        >>> found = avc.recommend("spring", hands=10)
        >>> found.felt()["share_of_wall"] > 0.99 and found.felt()["stiffness_n_per_m"] < found.stiffest_wall_n_per_m
        True
    """
    problem = with_wall(problem)
    people, extreme = people_of(problem.hands, hands, seed), hand_corners(problem.hands)
    why_none, considered = why_infeasible(problem), 0
    judged: list[Judged] = []
    with Crew(workers) as crew:
        helps = crew.begin(partial(what_would_help, problem, extreme))
        limit = stiffest_wall(problem.device, with_released(extreme))
        if not why_none:
            found = judged_candidates(
                problem, people, seed, limit, progress, lean_on_friction=lean_on_friction, executor=executor, crew=crew
            )
            judged, considered = found.judged, found.considered
        best = best_of(judged, lean_on_friction=lean_on_friction) if judged else None
        declared_n = problem.device.coulomb_friction_n
        leaning = best_of(judged, lean_on_friction=True, stiffest=True) if judged and declared_n > 0 else None
        coupling, rest, beside, off, lacks = None, None, {}, None, ""
        beyond: tuple[Withstood, ...] = ()
        if best is not None:
            told_off = crew.begin(partial(off_file, best.coupling, seed))
            told_beyond = crew.begin(partial(margins, best.coupling, limit, seed))
            known = certified(best.coupling, progress, prove=prove)
            known, rest = with_rest(known, progress)
            coupling = replace(known.with_trial(best.trial.document()), versions=versions or {})
            beside, off = _beside(best.coupling, hands, seed, executor), told_off()
            beyond = told_beyond()
            lacks = missed(beyond, by_friction=lean_on_friction or best.safety == 1)
        held = [static_stiffness_n_per_m(one.coupling) for one in judged]
        nothing = "" if best is None else nothing_rendered(problem, static_stiffness_n_per_m(best.coupling), best.trial)
        return Recommendation(
            problem=problem,
            coupling=coupling,
            trial=None if best is None else best.trial,
            confirmed=None if best is None else best.others,
            beside=beside,
            off_file=off,
            beyond_file=beyond,
            deployable=best is not None and not nothing and not lacks,
            rest=rest,
            stiffest_wall_n_per_m=max([limit.stiffness_n_per_m, *held]),
            plain_wall_n_per_m=limit.stiffness_n_per_m,
            with_friction_n_per_m=None if leaning is None else static_stiffness_n_per_m(leaning.coupling),
            helps=() if why_none else helps(),
            considered=considered,
            reason=why_none or nothing or lacks or reason_of(best, judged, considered),
            assumed=assumed(problem, None if best is None else best.coupling, devices=devices_of(best)),
            not_used=not_used(problem),
        )


def _beside(coupling: Coupling, hands: int, seed: int, executor: Executor | None = None) -> dict[str, CouplingTrial]:
    """Return trials with the grips outside [hands]."""
    radius = coupling.problem.device.metres_per_unit
    return {
        told: try_coupling(
            coupling, draw_population(GRIPS[holding], hands, seed).at_handle(radius), seed, executor=executor
        )
        for holding, told in OTHER_HANDS.items()
        if holding != coupling.problem.device.held
    }
