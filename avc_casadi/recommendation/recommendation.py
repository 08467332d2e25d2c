"""The answer of `recommend`: a coupling to a wall, a simulation or a follower, with its analysis."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any, Literal

from avc_casadi._util.json_values import plain_table
from avc_casadi._util.printed import Printed
from avc_casadi.claims.impedance import stiffness_at_handle
from avc_casadi.coupling import Coupling
from avc_casadi.files.coupling_file import coupling_document
from avc_casadi.loops.engine import ToolCase
from avc_casadi.loops.follower import BilateralCase
from avc_casadi.loops.margins import OpenLoop, transients
from avc_casadi.loops.system import Mode
from avc_casadi.model.ends import ToolGains
from avc_casadi.model.problem import Problem
from avc_casadi.recommendation.evaluator import PerturbedDevices, Withstood
from avc_casadi.recommendation.felt import (
    NOTICED_N,
    WITHDRAWN_S,
    Felt,
    contact_onset_m,
    creep,
    leaving_contact,
    rebound,
    ripple,
    shaken,
)
from avc_casadi.recommendation.sensitivity import Help, ToolHelp, Trade
from avc_casadi.simulation.population.trial import CouplingTrial, Trial

_SIDES = ("released", "worst_hand")


@dataclass(frozen=True)
class LimitCycleFreedom:
    """Settling of a coupling with every hand, making and breaking contact (level L7)."""

    word: Literal["proved", "refuted", "open", "simulated"]  # simulated where no proof was requested
    sentence: str  # the claim that holds, or why it does not


@dataclass(frozen=True)
class Pair:
    """Analysis of a spring and damper to a simulation or a follower."""

    stiffest: ToolGains  # linearly stable with every hand and contact
    worst: ToolCase | BilateralCase  # of the largest spectral radius at that limit
    loops: int
    gain_margin: float | None = None  # common, of K and B; None without a coupling
    motor_margins: Sequence[float] = ()  # of the device's motor alone, and of the follower's
    mode: Mode | None = None  # the least damped oscillation of all loops
    felt: tuple[Felt, ...] = ()  # at the handle
    set_by: str = ""  # which hands do not settle with the next stiffer K that was tried
    mismatch_stable: bool | None = None  # on devices a tenth off and a quarter sample late
    local_dampers_ns_per_m: tuple[float, float] | None = None  # that keep K and B stable
    least_tool_mass_kg: float | None = None  # with which the same K is stable with some B
    slowest_step_s: float | None = None
    exchanges: Mapping[str, bool] = field(default_factory=dict)  # with which it is
    same_k: Mapping[str, ToolGains] = field(default_factory=dict)  # with each of these three
    searched_to: Mapping[str, float] = field(default_factory=dict)  # ends of these searches
    passivity_margin_ns_per_m: float | None = None  # of the two-port; passive at 0 or more
    passive_damping_ns_per_m: float | None = None  # that passivity requires of each device


@dataclass(frozen=True, eq=False, repr=False)
class Recommendation(Printed):
    """The coupling to deploy and its analysis.

    Attributes:
        problem: the problem as stated.
        coupling: certified and tried; None where no coupling is deployable.
        deployable: whether the coupling may be loaded into the device.
        reason: one sentence: why this one, or why none.
        trial: result with simulated hands; None without a coupling.
        helps: sensitivity of the stiffness limit of a spring and damper.
        assumed: assumptions.
        not_used: declared keys that the analysis does not use.
        considered: number of couplings judged.
        pair: analysis of a coupling to a simulation or a follower; None of a wall.
        confirmed: result with hands of [hands] outside the selection; None where nothing was chosen.
        off_file: result of the corner hands on devices perturbed by a tenth; None without a coupling or where every
            value of the device has a range.
        beyond_file: results with one unmodelled effect each: lighter device, missed samples, extra resonance.
        rest: limit-cycle freedom with every hand, making and breaking contact; None without a coupling.
        no_stiffer: why the next stiffer wall is not recommended, where the wall is the stiffest that a hand that moves
            gets within 20 %; else empty.
        plain_wall_n_per_m: the stiffest wall with a plain spring and damper, by linear stability alone.
        trade_off: what a disk margin costs, at four of them; empty where that was not asked for.

    Example:
        >>> found = avc.recommend("spring", hands=10)
        >>> found.deployable, found.trial.hands
        (True, 10)
    """

    problem: Problem
    coupling: Coupling | None
    deployable: bool
    reason: str
    trial: Trial | None = None
    helps: tuple[Help | ToolHelp, ...] = ()
    assumed: tuple[str, ...] = ()
    not_used: tuple[str, ...] = ()
    considered: int = 1
    pair: Pair | None = None
    confirmed: CouplingTrial | None = None
    off_file: PerturbedDevices | None = None
    beyond_file: tuple[Withstood, ...] = ()
    rest: LimitCycleFreedom | None = None
    no_stiffer: str = ""
    plain_wall_n_per_m: float = 0.0
    trade_off: tuple[Trade, ...] = ()

    def __repr__(self) -> str:
        return f"Recommendation({self.problem.name!r}: {self.coupling!r}; {self.reason})"

    @property
    def end(self) -> str:
        """What the coupling leads to: wall, simulation or follower."""
        if self.problem.simulation is not None:
            return "simulation"
        return "follower" if self.problem.follower is not None else "wall"

    def data(self) -> dict[str, Any]:
        """Return JSON values, computed once: of a wall what is felt, settling and margins; of another end the pair."""
        return self._data

    @cached_property
    def _data(self) -> dict[str, Any]:
        return plain_table(
            {
                "problem": self.problem.name,
                **{name: getattr(self, name) for name in ("end", "deployable", "reason", "considered")},
                "trial": None if self.trial is None else self.trial.document(),
                "certificate": None if self.coupling is None else dict(self.coupling.certificate or {}),
                "what_would_help": [vars(one) for one in self.helps],
                "assumed": list(self.assumed),
                "not_used": list(self.not_used),
                **(self._of_wall() if self.pair is None else self._of_pair(self.pair)),
            }
        )

    def _of_wall(self) -> dict[str, Any]:
        coupling, wall = self.coupling, self.problem.environment
        return {
            "rest": None if self.rest is None else vars(self.rest),
            "coupling": None if coupling is None else coupling_document(coupling),
            "felt": self.felt(),
            "transient": {} if coupling is None else dict(zip(_SIDES, transients(coupling), strict=True)),
            "margins": self.margins(),
            "no_stiffer": self.no_stiffer,
            "stiffest_wall_n_per_m": wall.stiffness_n_per_m if self.no_stiffer and coupling else None,
            "plain_wall_n_per_m": self.plain_wall_n_per_m,
            "confirmed": None if self.confirmed is None else self.confirmed.counts(),
            "simulated": self._simulated(),
            "off_file": None if self.off_file is None else self.off_file.document(),
            "beyond_file": [vars(one) for one in self.beyond_file],
            "trade_off": [vars(one) for one in self.trade_off],
        }

    def _simulated(self) -> dict[str, int] | None:
        """Return the counts of all simulated hands, those outside the selection among them."""
        trials = [one.counts() for one in (self.trial, self.confirmed) if isinstance(one, CouplingTrial)]
        keys = ("hands", "at_rest", "at_rest_without_friction", "quiet")
        return {key: sum(one[key] for one in trials) for key in keys} if trials else None

    def _of_pair(self, pair: Pair) -> dict[str, Any]:
        coupling = self.coupling
        return {
            "coupling": None if coupling is None else coupling_document(coupling),
            "felt": {**self._pressed(), "at": [asdict(one) for one in pair.felt]},
            "pair": {
                **{key: value for key, value in vars(pair).items() if key not in {"felt", "mode", "worst", "stiffest"}},
                "gains": None if coupling is None else vars(coupling.gains),
                "in_scene": vars(coupling.in_scene) if coupling and coupling.end == "simulation" else None,
                "at_follower": vars(coupling.at_follower) if coupling and coupling.end == "follower" else None,
                "stiffest": vars(pair.stiffest),
                "least_damped": None if pair.mode is None else asdict(pair.mode),
                "limited_by": asdict(pair.worst),
            },
        }

    def _pressed(self) -> dict[str, float | None]:
        """Return the stiffness at rest at the handle: on a rigid object, and on the stiffest declared contact."""
        end, k = (
            self.problem.simulation or self.problem.follower,
            self.coupling and self.coupling.gains.stiffness_n_per_m,
        )
        contact = 0.0 if not k or end is None or end.rigid else end.scale * end.contact_stiffness_n_per_m[1]
        found = {
            "stiffness_n_per_m": k,
            "on_stiffest_contact_n_per_m": 1 / (1 / k + 1 / contact) if k and contact else 0,
        }
        return {key: stiffness_at_handle(self.problem.device, one) if one else None for key, one in found.items()}

    def felt(self) -> dict[str, Any]:
        """Return what is rendered: stiffness, impedance error against the physical wall, tap, vibration."""
        coupling, trial = self.coupling, self.trial
        if coupling is None or coupling.end != "wall" or trial is None:
            return {"stiffness_n_per_m": None, "share_of_wall": None}
        device, tried = self.problem.device, trial.document()
        springy = self.problem.environment.stiffness_n_per_m > 0
        sensed = tried["stiffness_n_per_m"]["median"] if springy else None
        static, damping = coupling.static_stiffness_n_per_m, coupling.table.at_rest.contact_damping_ns_per_m
        motion = shaken(coupling, static)
        stiffness = motion.by_frequency(motion.stiffness_n_per_m)
        slow = creep(coupling)
        step, damping = device.encoder_resolution_m, damping + self.problem.environment.damping_ns_per_m
        return {
            "stiffness_n_per_m": sensed,
            "stiffness_at_handle_n_per_m": None if sensed is None else stiffness_at_handle(device, sensed),
            "share_of_wall": tried["share_of_wall"] if springy else None,
            "complex_error": motion.by_frequency(motion.error),
            "stiffness_in_motion_n_per_m": stiffness,
            # A wall never pulls, so that of a sine a damper renders the half.
            "damping_in_motion_ns_per_m": {
                hz: one / (math.pi * float(hz)) for hz, one in stiffness.items() if not springy
            },
            "shaken": {"depth_m": motion.depth_m, "amplitude_m": motion.amplitude_m},
            "tap_force_n": tried["tap_force_n"],
            "tap_depth_m": tried["tap_depth_m"],
            "edge_m": contact_onset_m(coupling) if springy else {},
            "edge_force_n": NOTICED_N * device.metres_per_unit,
            "leaving": vars(leaving_contact(coupling)) | {"withdrawn_s": WITHDRAWN_S} if springy else {},
            "creep": None if slow is None else plain_table(vars(slow)),
            "rebound": rebound(coupling) if springy else {},
            "vibration": tried["felt_vibration"],
            "friction_n": device.coulomb_friction_n,
            "rest_error_m": device.coulomb_friction_n / sensed if sensed else None,
            "encoder_step_n": {"spring": static * step, "damping": damping * step / device.sample_time_s},
            "ripple": vars(ripple(coupling, trial.seed)),
        }

    def margins(self) -> dict[str, Any]:
        """Return the stability margins at the actuator: released, and smallest with a corner hand."""
        if self.coupling is None or self.coupling.end != "wall":
            return {}
        return plain_table(dict(zip(_SIDES, OpenLoop.of(self.coupling).margins(), strict=True)))
