"""The answers of `recommend`: a coupling with its analysis, by the kind of its end, or why there is none."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from enum import Enum, auto
from functools import cached_property, singledispatch
from typing import Any, Literal

from avc_casadi._util.json_values import plain_table
from avc_casadi._util.printed import Printed
from avc_casadi.claims.impedance import stiffness_at_handle
from avc_casadi.coupling import Coupling
from avc_casadi.files.coupling_file import coupling_document
from avc_casadi.loops.loop_family import LeastDampedMode
from avc_casadi.loops.margins import OpenLoop, transients
from avc_casadi.model.ends import End, Follower, Simulation, ToolGains
from avc_casadi.model.problem import Problem
from avc_casadi.recommendation.evaluator import PerturbedDevices, UnmodelledTrial
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
from avc_casadi.recommendation.preconditions import Assumption, Unused
from avc_casadi.recommendation.sensitivity import Help, ToolHelp, Trade
from avc_casadi.simulation.population.trial import CouplingTrial, Trial

_SIDES = ("released", "worst_hand")


@dataclass(frozen=True)
class LimitCycleFreedom:
    """Settling of a coupling with every hand, making and breaking contact (level L7)."""

    word: Literal["proved", "refuted", "open", "simulated"]  # simulated where no proof was requested
    sentence: str  # the claim that holds, or why it does not


@dataclass(frozen=True, kw_only=True)
class PairLimits:
    """What limits a spring and damper to another end than a wall; what is not known of a kind of end is None or empty.

    Attributes:
        stiffest: linearly stable with every hand and contact.
        worst: loop of the largest spectral radius at that limit.
        loops: number of loops.
        wanted_n_per_m: stiffness that the problem asks for.
        least_tool_mass_kg: tool with which the same K is stable with some B.
        slowest_step_s: step of the engine with which it is.
        exchanges: with which it is, by name.
        same_k: with each of these three.
        searched_to: ends of these searches.
        passivity_margin_ns_per_m: of the two-port; passive at 0 or more.
        passive_damping_ns_per_m: that passivity requires of each device.
    """

    stiffest: ToolGains
    worst: Any
    loops: int
    wanted_n_per_m: float | None = None
    least_tool_mass_kg: float | None = None
    slowest_step_s: float | None = None
    exchanges: Mapping[str, bool] = field(default_factory=dict)
    same_k: Mapping[str, ToolGains] = field(default_factory=dict)
    searched_to: Mapping[str, float] = field(default_factory=dict)
    passivity_margin_ns_per_m: float | None = None
    passive_damping_ns_per_m: float | None = None


@dataclass(frozen=True, kw_only=True)
class Pair(PairLimits):
    """Analysis of a spring and damper to another end, beside its limits.

    Attributes:
        gain_margin: common, of K and B.
        motor_margins: of the device's motor alone, and of a follower's.
        mode: the least damped oscillation of all loops.
        felt: at the handle.
        set_by: which hands do not settle with the next stiffer K that was tried; empty where none was.
        mismatch_stable: on devices a tenth off and a quarter sample late; None where not asked.
        local_dampers_ns_per_m: that keep K and B stable; None where no local damper belongs to them.
    """

    gain_margin: float
    motor_margins: Sequence[float]
    mode: LeastDampedMode
    felt: tuple[Felt, ...] = ()
    set_by: str = ""
    mismatch_stable: bool | None = None
    local_dampers_ns_per_m: tuple[float, float] | None = None


_PAIR_KEYS = (
    "loops",
    "gain_margin",
    "motor_margins",
    "set_by",
    "mismatch_stable",
    "local_dampers_ns_per_m",
    "least_tool_mass_kg",
    "slowest_step_s",
    "exchanges",
    "same_k",
    "searched_to",
    "passivity_margin_ns_per_m",
    "passive_damping_ns_per_m",
)
"""Attributes that the document of a pair holds under their names."""
_WITHOUT_COUPLING = {"gain_margin": None, "motor_margins": (), "set_by": ""}
"""What it holds in place of those of a coupling where there is none; None for the others."""


@dataclass(frozen=True)
class WallLimits:
    """What limits a coupling to a wall.

    Attributes:
        plain_wall_n_per_m: the stiffest wall with a plain spring and damper, by linear stability alone.
        no_stiffer: why the next stiffer wall is not recommended, where the wall is the stiffest that a hand that moves
            gets within 20 %; else empty.
    """

    plain_wall_n_per_m: float = 0.0
    no_stiffer: str = ""


class Verdict(Enum):
    """Whether a coupling may be loaded into the device, and if not which of the trials or claims refuses it."""

    DEPLOYABLE = auto()
    CLAIM_FAILS = auto()
    """A claim of `deployable` does not hold."""
    NOTHING_RENDERED = auto()
    """No press of a hand renders anything of the wall."""
    REQUIREMENT_UNMET = auto()
    """Hands do not settle with what [robustness] asks for."""
    STRIKE_UNSETTLED = auto()
    """A corner hand that strikes the wall does not settle."""


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Recommendation(Printed, ABC):
    """The coupling to deploy and its analysis: one of the classes below, by the end and whether there is a coupling.

    Attributes:
        problem: the problem as stated.
        coupling: certified and tried; None where no coupling is deployable.
        trial: result with simulated hands; None without a coupling.
        reason: one sentence: why this one, or why none.
        helps: sensitivity of the stiffness limit of a spring and damper.
        assumed: assumptions.
        not_used: declared keys that the analysis does not use.
        considered: number of couplings judged.

    Example:
        >>> found = avc.recommend("spring", hands=10)
        >>> found.deployable, found.trial.hands
        (True, 10)
    """

    problem: Problem
    coupling: Coupling | None
    trial: Trial | None
    reason: str
    helps: tuple[Help | ToolHelp, ...] = ()
    assumed: tuple[Assumption, ...] = ()
    not_used: tuple[Unused, ...] = ()
    considered: int = 1

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.problem.name!r}: {self.coupling!r}; {self.reason})"

    @property
    def end(self) -> End:
        """What the coupling leads to."""
        return self.problem.end

    @property
    def deployable(self) -> bool:
        """Whether the coupling may be loaded into the device."""
        return self.coupling is not None

    def data(self) -> dict[str, Any]:
        """Return JSON values, computed once: of a wall what is felt, settling and margins; of another end the pair."""
        return self._data

    @cached_property
    def _data(self) -> dict[str, Any]:
        return plain_table(
            {
                "problem": self.problem.name,
                "end": self.end.kind,
                "deployable": self.deployable,
                "reason": self.reason,
                "considered": self.considered,
                "trial": None if self.trial is None else self.trial.document(),
                "certificate": None if self.coupling is None else dict(self.coupling.certificate or {}),
                "what_would_help": [vars(change) for change in self.helps],
                "assumed": [str(assumption) for assumption in self.assumed],
                "not_used": [str(unused) for unused in self.not_used],
                **self._of_end(),
            }
        )

    @abstractmethod
    def _of_end(self) -> dict[str, Any]:
        """Return the JSON values that only a recommendation of its kind has."""


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class NoCoupling(Recommendation):
    """No coupling is deployable, for a reason."""

    coupling: None = field(default=None, init=False)
    trial: None = field(default=None, init=False)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class NoWallCoupling(NoCoupling):
    """No coupling to the wall is deployable.

    Attributes:
        limits: what limits one.
    """

    limits: WallLimits = WallLimits()

    def _of_end(self) -> dict[str, Any]:
        return {
            "rest": None,
            "coupling": None,
            "felt": {"stiffness_n_per_m": None, "share_of_wall": None},
            "transient": {},
            "margins": {},
            "no_stiffer": self.limits.no_stiffer,
            "stiffest_wall_n_per_m": None,
            "plain_wall_n_per_m": self.limits.plain_wall_n_per_m,
            "confirmed": None,
            "simulated": None,
            "off_file": None,
            "beyond_file": [],
            "trade_off": [],
        }


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class WallRecommendation(Recommendation):
    """A coupling to a wall.

    Attributes:
        verdict: whether it may be deployed.
        rest: limit-cycle freedom with every hand, making and breaking contact.
        limits: what limits a coupling to this wall.
        confirmed: result with hands of [hands] outside the selection; None of gains that were not selected.
        off_file: result of the corner hands on devices perturbed by a tenth; None where every value of the device has
            a range.
        beyond_file: results with one unmodelled effect each: lighter device, missed samples, extra resonance.
        trade_off: what a disk margin costs, at four of them; empty where that was not asked for.
    """

    coupling: Coupling
    trial: CouplingTrial
    rest: LimitCycleFreedom
    verdict: Verdict = Verdict.DEPLOYABLE
    limits: WallLimits = WallLimits()
    confirmed: CouplingTrial | None = None
    off_file: PerturbedDevices | None = None
    beyond_file: tuple[UnmodelledTrial, ...] = ()
    trade_off: tuple[Trade, ...] = ()

    @property
    def deployable(self) -> bool:
        """Whether the coupling may be loaded into the device."""
        return self.verdict is Verdict.DEPLOYABLE

    def _of_end(self) -> dict[str, Any]:
        stiffest = self.problem.environment.stiffness_n_per_m if self.limits.no_stiffer else None
        return {
            "rest": vars(self.rest),
            "coupling": coupling_document(self.coupling),
            "felt": self.felt(),
            "transient": dict(zip(_SIDES, transients(self.coupling), strict=True)),
            "margins": self.margins(),
            "no_stiffer": self.limits.no_stiffer,
            "stiffest_wall_n_per_m": stiffest,
            "plain_wall_n_per_m": self.limits.plain_wall_n_per_m,
            "confirmed": None if self.confirmed is None else self.confirmed.counts(),
            "simulated": self._simulated(),
            "off_file": None if self.off_file is None else self.off_file.document(),
            "beyond_file": [vars(trial) for trial in self.beyond_file],
            "trade_off": [vars(trade) for trade in self.trade_off],
        }

    def _simulated(self) -> dict[str, int]:
        """Return the counts of all simulated hands, those outside the selection among them."""
        trials = [trial.counts() for trial in (self.trial, self.confirmed) if trial is not None]
        keys = ("hands", "at_rest", "at_rest_without_friction", "quiet")
        return {key: sum(counts[key] for counts in trials) for key in keys}

    def felt(self) -> dict[str, Any]:
        """Return what is rendered: stiffness, impedance error against the physical wall, tap, vibration."""
        coupling, trial = self.coupling, self.trial
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
        return plain_table(dict(zip(_SIDES, OpenLoop.of(self.coupling).margins(), strict=True)))


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class NoPair(NoCoupling):
    """No spring and damper to another end is deployable.

    Attributes:
        pair: what limits one.
    """

    pair: PairLimits

    def _of_end(self) -> dict[str, Any]:
        return {
            "coupling": None,
            "felt": {"stiffness_n_per_m": None, "on_stiffest_contact_n_per_m": None, "at": []},
            "pair": {
                **{key: getattr(self.pair, key, _WITHOUT_COUPLING.get(key)) for key in _PAIR_KEYS},
                "gains": None,
                "in_scene": None,
                "at_follower": None,
                "stiffest": vars(self.pair.stiffest),
                "least_damped": None,
                "limited_by": asdict(self.pair.worst),
            },
        }


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class PairRecommendation(Recommendation):
    """A spring and damper to another end.

    Attributes:
        pair: its analysis.
    """

    coupling: Coupling
    trial: Trial
    pair: Pair

    def _of_end(self) -> dict[str, Any]:
        return {
            "coupling": coupling_document(self.coupling),
            "felt": {**self._pressed(), "at": [asdict(felt) for felt in self.pair.felt]},
            "pair": {
                **{key: getattr(self.pair, key) for key in _PAIR_KEYS},
                "gains": vars(self.coupling.gains),
                "in_scene": None,
                "at_follower": None,
                **_scaled(self.end, self.coupling),
                "stiffest": vars(self.pair.stiffest),
                "least_damped": asdict(self.pair.mode),
                "limited_by": asdict(self.pair.worst),
            },
        }

    def _pressed(self) -> dict[str, float | None]:
        """Return the stiffness at rest at the handle: on a rigid object, and on the stiffest declared contact."""
        device, k = self.problem.device, self.coupling.gains.stiffness_n_per_m
        contact = self.end.stiffest_contact_n_per_m
        stiffness = stiffness_at_handle(device, k) if k else None
        on_contact = stiffness_at_handle(device, 1 / (1 / k + 1 / contact)) if k and contact else None
        return {"stiffness_n_per_m": stiffness, "on_stiffest_contact_n_per_m": on_contact}


@singledispatch
def _scaled(end: End, coupling: Coupling) -> dict[str, dict[str, Any]]:  # noqa: ARG001
    """Return the gains of a coupling in the units of its end, by the key of the document."""
    return {}


@_scaled.register
def _in_scene(end: Simulation, coupling: Coupling) -> dict[str, dict[str, Any]]:  # noqa: ARG001
    return {"in_scene": vars(coupling.in_scene)}


@_scaled.register
def _at_follower(end: Follower, coupling: Coupling) -> dict[str, dict[str, Any]]:  # noqa: ARG001
    return {"at_follower": vars(coupling.at_follower)}
