"""The coupling that a scene names, solved, and the scene simulated with it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from avc_casadi._util.json_values import plain
from avc_casadi.coupling import Coupling
from avc_casadi.design.methods import solve
from avc_casadi.files.problem_file import AnyProblem, accepts_problem, require_device
from avc_casadi.model.declared import left_out, scene_effects, with_law_alone
from avc_casadi.model.effects import GuardEffect
from avc_casadi.model.ends import ToolGains
from avc_casadi.model.gains import NO_COUPLING, Gains, GainSchedule, GainTable
from avc_casadi.model.hands import Hand
from avc_casadi.model.problem import Problem
from avc_casadi.simulation.scene import AnyGains, Run
from avc_casadi.simulation.scene import simulate as simulate_with
from avc_casadi.simulation.screen import SceneCost, Screening
from avc_casadi.simulation.screen import screen as screen_with

_COMPARED = (
    "coupling",
    "damping_ns_per_m",
    "stiffness_n_per_m",
    "contact_damping_ns_per_m",
    "outcome",
    "stable",
    "buzzing",
    "position_peak_to_peak_m",
    "apparent_stiffness_n_per_m",
    "rate_hardness_n_per_m",
    "energy_generated_j",
)


def scene_coupling(problem: Problem) -> Gains | GainSchedule:
    """Return the coupling that the problem's scene names, solved; "none" joins device and environment rigidly."""
    name = problem.scene.coupling
    designed_for = problem.changed(device={"delay_samples": _designed_delay_samples(problem)})
    return NO_COUPLING if name == "none" else solve(designed_for, name)


def law_scene(problem: Problem) -> Problem:
    """Return the problem with a scene of its own law where it has one, else as it is."""
    return problem if problem.law is None else with_law_alone(problem)


def scene_notes(problem: Problem) -> list[str]:
    """Return a note where the scene's coupling is designed for another delay than that of the device.

    A scene that names no coupling has that of the delay rounded up to whole samples.
    """
    declared = problem.device.delay_samples
    designed = _designed_delay_samples(problem)
    if designed == declared:
        return []
    note = (
        f"the scene names no coupling: it uses {problem.scene.coupling}, designed for {designed:g} samples of delay "
        f"and simulated with {declared:g}; for this device: avc recommend P --out c.json, then --gains c.json"
    )
    return [note]


def _designed_delay_samples(problem: Problem) -> float:
    """Return the delay that a scene's coupling is designed for: of a scene that names none, rounded up."""
    named = "coupling" in problem.scene.model_fields_set
    return problem.device.delay_samples if named else math.ceil(problem.device.delay_samples)


@accepts_problem
def simulate(
    problem: AnyProblem,
    gains: AnyGains | None = None,
    *,
    hand: Hand | None = None,
    seed: int = 0,
) -> Run:
    """Simulate the scene of a problem: hand, device and coupling against the wall over time.

    Args:
        problem: the problem; or a problem file, or a name of the catalogue.
        gains: a coupling with its table and runtime; gains or a gain table; None takes the table [law] of the
            problem, else the coupling that the scene names.
        hand: a hand in place of the scene's.
        seed: added to the seeds of all noises, 0 or more.

    Returns:
        Traces of shape (samples,) every T: position, m, velocity, m/s, and force, N, positive against +x; energies;
        and whether the device settles. Between samples the motion is exact, dry friction and its sticking included.

    Raises:
        InputError: an impossible scene, or gains that are missing or of another sample time.
        UnsupportedError: an effect that scenes do not simulate.

    Example:
        >>> run = avc.simulate("scenes/stiff-wall-pressed")
        >>> run.claim
        'asymptotic'
        >>> f"{run.force_n[-1]:.1f} N at {1e3 * run.position_m[-1]:.2f} mm"
        '4.4 N at 1.15 mm'
    """
    stated = require_device(problem)
    stated = law_scene(stated) if gains is None else stated
    chosen = scene_coupling(stated) if gains is None else gains
    request: dict[str, Any] = {"gains": chosen, "hand": hand, "seed": seed}
    run = simulate_with(stated, **request)
    notes = scene_notes(stated) if gains is None and stated.scene.coupling != "none" else []
    return replace(run, definition=stated, request=request, notes=tuple(notes))


@dataclass(frozen=True, eq=False)
class SimulatedScene:
    """What `avc simulate` finds of a coupling to a wall: a run, what it is compared with, and what is left out.

    Attributes:
        run: the run.
        gains_from_hz: frequency at which a table is read at first; None for constant gains.
        left_out: declared keys that the scene does not have.
        without_guard: the same run without its guard; None where there is none.
        notes: where the coupling is designed for another device than the simulated one, or made for another problem.
        trace: file of the traces, if they are written.
        cost: what each effect adds to a sample, if that was measured.
        against: the same scene with other couplings.
    """

    run: Run
    gains_from_hz: float | None
    left_out: tuple[str, ...]
    without_guard: Run | None
    notes: tuple[str, ...]
    trace: Path | None = None
    cost: SceneCost | None = None
    against: tuple[Run, ...] = ()

    @classmethod
    def of(cls, run: Run) -> SimulatedScene:
        """Return a run of `simulate`, with the keys that its scene leaves out and the same run without its guard."""
        assert run.definition is not None  # noqa: S101 - of `simulate`
        return cls(
            run=run,
            gains_from_hz=_read_at(run, run.definition),
            left_out=tuple(left_out(run.definition)),
            without_guard=_without_guard(run, run.definition),
            notes=run.notes,
        )

    def document(self) -> dict[str, Any]:
        """Return the `simulate` document: JSON values only."""
        document = self.run.document(self.trace) | {
            "effects": [{"kind": kind} for kind in self.run.effects],
            "gains_from_hz": self.gains_from_hz,
            "notes": list(self.notes),
            "left_out": list(self.left_out),
            "without_guard": None if self.without_guard is None else _figures_of(self.without_guard),
        }
        cost: dict[str, Any] = {} if self.cost is None else plain(self.cost)
        against = {"against": [_figures_of(run) for run in self.against]} if self.against else {}
        return document | cost | against


@dataclass(frozen=True, eq=False)
class SimulatedPair:
    """What `avc simulate` finds of a coupling to a simulation.

    Attributes:
        run: the run.
        gains: the coupling.
        given: whether the coupling was given; else it is the recommended one.
        trace: file of the traces, if they are written.
        notes: where the coupling was designed for another problem.
    """

    run: Run
    gains: ToolGains
    given: bool
    trace: Path | None = None
    notes: tuple[str, ...] = ()

    @property
    def coupling(self) -> str:
        """Where the coupling comes from."""
        return "given" if self.given else "recommended"

    def document(self) -> dict[str, Any]:
        """Return run, spring and damper, and where they come from, as the JSON values that `avc simulate` writes."""
        return self.run.document(self.trace) | {
            "coupling": self.coupling,
            "effects": list(self.run.effects),
            "contact_damping_ns_per_m": None,
            **plain(self.gains),
            "notes": list(self.notes),
        }


def _figures_of(run: Run) -> dict[str, Any]:
    """Return the figures by which runs are compared."""
    document = run.document()
    return {name: document[name] for name in _COMPARED}


def _without_guard(run: Run, problem: Problem) -> Run | None:
    """Return the same run without its guard, for comparison; None where there is none."""
    if GuardEffect().kind not in run.effects:
        return None
    gains = run.request["gains"]
    if isinstance(gains, Coupling):
        gains = replace(gains, runtime=gains.runtime.model_copy(update={"guard": None}))
    kept = tuple(effect for effect in scene_effects(problem) if not isinstance(effect, GuardEffect))
    return simulate_with(problem.changed(scene={"effects": kept}), **{**run.request, "gains": gains})


def _read_at(run: Run, problem: Problem) -> float | None:
    """Return the frequency, Hz, at which gains that vary are read at first; None for constant ones."""
    gains = run.request["gains"]
    if isinstance(gains, Gains):
        return None
    table = _table_of(gains)
    if table.constant:
        return None
    named = problem.scene.interaction_hz
    return table.rest_hz if named is None else named


def _table_of(gains: Coupling | GainTable | GainSchedule) -> GainTable:
    if isinstance(gains, Coupling):
        return gains.table
    return gains if isinstance(gains, GainTable) else GainTable.of(gains)


@accepts_problem
def screen(problem: AnyProblem, gains: AnyGains | None = None, *, tolerance: float = 0.01) -> Screening:
    """Leave out each effect of a scene in turn and return which ones it needs.

    Args:
        problem: the problem; or a problem file, or a name of the catalogue.
        gains: as in `simulate`.
        tolerance: largest relative change of position, force and stiffness that does not count, from 0 to below 1.

    Returns:
        A row for each effect with the change that it makes; ``redundant`` are the kinds that the scene does not need.

    Raises:
        InputError: as `simulate`; or the tolerance is outside its range.

    Example:
        >>> avc.screen("scenes/free-motion", tolerance=0.05).redundant
        ()
    """
    stated = require_device(problem)
    chosen = scene_coupling(stated) if gains is None else gains
    return screen_with(stated, chosen, tolerance=tolerance)
