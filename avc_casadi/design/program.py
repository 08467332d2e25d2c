"""Observer laws of least impedance error: local optima of a fixed structure, from several starts.

A law is an observer with state feedback. Its structure comes from a guess of model and feedback, and its gain L is free
(`observer_law`). The observer corrects its state by L times the innovation: measured minus predicted position. The
steps of the encoder and the dead zone of the observer let only a share of the innovation pass. A trust region
(`trust_region`) minimises over L the largest impedance error at the handle from 1 to 30 Hz. The conditions
(`conditions`), at every combination of extreme values of the hands and the ranges (a corner), are

    DiskMargin, EncoderNoise    a disk margin, and a bound of the force of encoder noise
    Decay                       a rate of decay at each share of the innovation that passes
    DistanceFromZero            a distance of the same loops from 0
    ObserverPoles               a decay of the observer alone
    ClipPhase                   stability at each lower gain, as of a force that the device's limit clips

`Program.stable_when_perturbed` makes a law stable on perturbed devices too. The result is judged by exact eigenvalues
at all these corners. The certificate judges what lies inside the ranges (`claims.deployable`).
"""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.coupling import Coupling
from avc_casadi.design.conditions import (
    ClipPhase,
    Condition,
    Decay,
    DiskMargin,
    DistanceFromZero,
    EncoderNoise,
    ObserverPoles,
    PerturbedDecay,
)
from avc_casadi.design.law_family import LawFamily, LawLoops, Performance
from avc_casadi.design.observer_law import GUESSES, Structure
from avc_casadi.design.plants import PlantMatrices
from avc_casadi.design.starts import promising_starts
from avc_casadi.design.static import ConstantDesign, constant_schedule
from avc_casadi.design.trust_region import TrustRegion
from avc_casadi.loops.spectrum import eigenvalues
from avc_casadi.loops.wall import MAX_DELAY_SAMPLES
from avc_casadi.model.gains import Gains, GainSchedule, spring_before
from avc_casadi.model.problem import Problem
from avc_casadi.model.runtime import Runtime

DISK_MARGIN = 0.204
"""Required disk margin where the problem states none, so that 0.2 is met."""
RIPPLE_N = 1.5
"""Required bound of the force for a sine of one encoder step, N; `usual_goals` takes 12 K times the step if more."""
NOISE_OVER_STIFFNESS = 12.0
"""Noise gain over stiffness that is granted where it is more than that bound."""
NEAR = 0.1
"""Impedance error at which no other guess of model and feedback is tried."""
ENOUGH_LAWS = 2
"""Laws of each guess that meet the goals, each from its own start: most starts lead to one law, few to a worse one."""
MOST_STARTS = 6
"""Starts of each guess from which the trust region begins: on 24 drawn devices more of them led to no nearer law."""
FINEST_ENCODER_M = 1e-9
"""Encoder step that is assumed where the problem states a finer one or none, m: the noise gain needs a bound."""
PERTURBED_ROUNDS = 4
"""How often the perturbed plants at which a law is unstable join the optimisation: two rounds are usual."""
PERTURBED_AT_ONCE = 24
"""The most of them that join at once."""


@dataclass(frozen=True)
class Goals:
    """What is required of a law."""

    disk_margin: float
    noise_n_per_m: float
    distance: float = 1.0  # factor on the usual distance of the dead zone's loop from 0

    def times(self, disk_margin: float, noise: float, distance: float) -> Goals:
        """Return the goals multiplied by factors."""
        return Goals(disk_margin * self.disk_margin, noise * self.noise_n_per_m, distance * self.distance)


@dataclass(frozen=True, eq=False)
class Program:
    """The optimisation of the laws of one structure on a problem: the laws, and what is required of them."""

    family: LawFamily
    goals: Goals
    perturbed: PlantMatrices | None = None  # perturbed plants at which laws so far were unstable

    @cached_property
    def conditions(self) -> tuple[Condition, ...]:
        """The conditions on a law."""
        nominal = (
            DiskMargin(self.goals.disk_margin),
            EncoderNoise(self.goals.noise_n_per_m),
            Decay(),
            DistanceFromZero(self.goals.distance),
            ObserverPoles(),
            ClipPhase(),
        )
        return nominal if self.perturbed is None else (*nominal, PerturbedDecay(self.perturbed))

    def optimised_from(self, gain: FloatArray) -> LawLoops:
        """Return the best law found from a gain L."""
        return TrustRegion(self.family, self.conditions).minimised(gain)

    def best(self) -> LawLoops | None:
        """Return the law of least merit from the most promising starts; None where no start is stable.

        The merit is the impedance error and the price of what the conditions miss. The search ends with the
        second law that meets the goals, or with the sixth start.
        """
        search = TrustRegion(self.family, self.conditions)
        starts = promising_starts(self.family, self.conditions, self.goals.disk_margin)
        laws: list[LawLoops] = []
        for start in starts[:MOST_STARTS]:
            laws.append(search.minimised(start))
            if sum(map(self.meets_goals, laws)) == ENOUGH_LAWS:
                break
        return search.renewed(min(laws, key=search.merit)) if laws else None

    def stable_when_perturbed(self, loops: LawLoops) -> tuple[Program, LawLoops]:
        """Return a law from this one on that is stable on perturbed devices too, and its program.

        Cutting planes: the plants at which the law is the least stable join the conditions, and the law is improved,
        until none is unstable or `PERTURBED_ROUNDS` end.
        """
        program, plants = self, self.family.perturbed
        if plants is None:
            return program, loops
        for _ in range(PERTURBED_ROUNDS):
            radius = np.abs(eigenvalues(self.family.structure.loops(plants, loops.gain))).max(axis=-1)
            worst = np.argsort(-radius, kind="stable")[:PERTURBED_AT_ONCE]
            unstable = plants.pick(worst[radius[worst] >= 1])
            if not len(unstable):
                break
            known = program.perturbed
            program = replace(program, perturbed=unstable if known is None else known.joined_with(unstable))
            loops = program.optimised_from(loops.gain)
        return program, loops

    def meets_goals(self, loops: LawLoops) -> bool:
        """Return whether all conditions are met, and every hand is stable at each gain of a force that is clipped."""
        met = all(condition.worst(loops) <= condition.tolerance for condition in self.conditions)
        return met and loops.performance.stable


@dataclass(frozen=True, eq=False)
class ProgramAnswer:
    """The coupling of the optimisation, not yet tried."""

    problem: Problem
    program: Program
    loops: LawLoops

    @property
    def performance(self) -> Performance:
        """What the law reaches."""
        return self.loops.performance

    @cached_property
    def meets_goals(self) -> bool:
        """Whether the law is stable and meets all conditions."""
        return self.program.meets_goals(self.loops)

    @property
    def coupling(self) -> Coupling:
        """The law behind the spring that gives the wall its stiffness."""
        family = self.loops.family
        spring = spring_before(self.problem, family.problem.environment.stiffness_n_per_m)
        runtime = Runtime(state_feedback=family.structure.law(self.loops.gain, family.problem))
        return Coupling.constant(self.problem, Gains(0.0, spring), "robust", runtime)

    def errors(self, hz: FloatArray) -> FloatArray:
        """Return the impedance error at frequencies."""
        return self.loops.family.error_rows(hz).errors(self.loops.gain)

    def with_goals(self, disk_margin: float = 1.0, noise: float = 1.0, distance: float = 1.0) -> ProgramAnswer:
        """Return the coupling for goals multiplied by factors, from this one on."""
        program = replace(self.program, goals=self.program.goals.times(disk_margin, noise, distance))
        return replace(self, program=program, loops=program.optimised_from(self.loops.gain))

    def stable_when_perturbed(self) -> ProgramAnswer:
        """Return the coupling that is stable on devices a tenth off too, from this one on; itself where it is."""
        program, loops = self.program.stable_when_perturbed(self.loops)
        return self if program is self.program else replace(self, program=program, loops=loops)


def why_no_law(problem: Problem) -> str:
    """Return why a device and wall have no law; empty where they may have one."""
    device = problem.device
    faults = []
    if not problem.environment.stiffness_n_per_m > 0:
        faults.append("environment.stiffness_n_per_m is 0; it must be above 0")
    if not device.mass_kg > 0:
        faults.append("the device has no mass (device.mass_kg); it must be above 0")
    if device.delay_samples > MAX_DELAY_SAMPLES / 4:
        faults.append(f"the delay of {device.delay_samples:g} samples is above {MAX_DELAY_SAMPLES // 4}")
    return "; ".join(faults)


def usual_goals(problem: Problem, stiffness_n_per_m: float) -> Goals:
    """Return the disk margin and noise gain that `[robustness]` requires, or the usual ones, of a stiffness K.

    The noise gain, N/m, is the largest force over a sine of encoder noise: ripple_n over an encoder step. Where
    `[robustness]` states no ripple_n, it is 1.5 N over a step (for a device that turns, at the radius of its handle),
    or 12 K where that is more.
    """
    device, required = problem.device, problem.robustness
    ripple_n = RIPPLE_N if required.ripple_n is None else required.ripple_n
    least_n_per_m = NOISE_OVER_STIFFNESS * stiffness_n_per_m if required.ripple_n is None else 0.0
    step = max(device.encoder_resolution_m, FINEST_ENCODER_M)
    noise_n_per_m = max(device.metres_per_unit * ripple_n / step, least_n_per_m)
    return Goals(DISK_MARGIN if required.disk_margin is None else required.disk_margin, noise_n_per_m)


def program_answers(
    problem: Problem,
    disk_margin: float | None = None,
    noise_n_per_m: float | None = None,
    *,
    stiffness_n_per_m: float | None = None,
    filters: int = 4,
) -> list[ProgramAnswer]:
    """Return the couplings that the guesses of model and feedback lead to: those that meet the goals, then by error.

    Args:
        problem: device, wall and hands.
        disk_margin: required, or that of `usual_goals`: more of it costs accuracy.
        noise_n_per_m: required, or that of `usual_goals`: less of it makes the law slower.
        stiffness_n_per_m: of a softer wall that is rendered in place of the problem's.
        filters: number of filters of the innovation; fewer leave a larger error.

    Raises:
        UnsupportedError: device or wall have no law, see `why_no_law`.
    """
    if why := why_no_law(problem):
        raise UnsupportedError(f"{problem.name}: no observer law: {why}")
    rendered = problem
    if stiffness_n_per_m is not None and stiffness_n_per_m < problem.environment.stiffness_n_per_m:
        rendered = problem.changed(environment={"stiffness_n_per_m": stiffness_n_per_m, "damping_ns_per_m": 0.0})
    goals = usual_goals(problem, rendered.environment.stiffness_n_per_m)
    if disk_margin is not None:
        goals = replace(goals, disk_margin=disk_margin)
    if noise_n_per_m is not None:
        goals = replace(goals, noise_n_per_m=noise_n_per_m)
    answers: list[ProgramAnswer] = []
    for guess in GUESSES:
        with suppress(np.linalg.LinAlgError):
            program = Program(LawFamily(rendered, Structure.of(rendered, guess, filters)), goals)
            best = program.best()
            if best is None or not best.performance.stable:
                continue
            answers.append(ProgramAnswer(problem, program, best))
            if answers[-1].meets_goals and best.performance.error <= NEAR:
                break
    return sorted(answers, key=lambda answer: (not answer.meets_goals, answer.performance.error))


def solve_robust(problem: Problem, *, progress: Progress = SILENT) -> GainSchedule:
    """Return the observer law of least impedance error as a gain table: in every row a spring, and the law.

    Raises:
        UnsupportedError: the device or wall has no such law.
    """
    if why := why_no_law(problem):
        raise UnsupportedError(f"{problem.name}: method robust: {why}; use another method, such as static")
    started = time.perf_counter()
    with progress.step("observer law"):
        answer = next(iter(program_answers(problem)), None)
    if answer is None:
        reason = "no stable observer law was found for the whole range of hands; "
        reason += "soften the wall, or narrow [hands] or [device.range]"
        return constant_schedule(problem, ConstantDesign("robust", None, reason), started)
    reached, goals = answer.performance, "as required" if answer.meets_goals else "not all as required"
    note = (
        f"error of the impedance from 1 to 30 Hz {100 * reached.error:.3g} % at most, disk margin "
        f"{reached.disk_margin:.2f}; margin, noise and decay {goals}"
    )
    gains, law = answer.coupling.table.at_rest, answer.coupling.runtime.state_feedback
    return constant_schedule(problem, ConstantDesign("robust", gains, notes=(note,), law=law), started)
