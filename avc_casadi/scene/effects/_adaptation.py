"""Adaptation: the gains of the coupling follow the estimate through the gain table."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

from avc_casadi._errors import Fault, InputError
from avc_casadi.coupling import GainTable
from avc_casadi.problem import Problem
from avc_casadi.runtime import AdaptationSettings, HoldSettings, adaptation_step, hold_step
from avc_casadi.scene.effects._base import SceneEffect, Station
from avc_casadi.scene.effects._step import insert
from avc_casadi.scene.loop import AdaptedGains, Expr, Tick


@dataclass(frozen=True)
class Adaptation(SceneEffect):
    """Look-up with hold and decay, slew limit and passive change.

    Attributes:
        hold: how the look-up leaves a lost estimate.
        settings: how the gains change.
        table: the gain table; a run sets it.
    """

    kind: ClassVar[str] = "adaptation"
    station: ClassVar[Station] = Station.COMPUTATION

    hold: HoldSettings
    settings: AdaptationSettings
    table: GainTable | None = None

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        """Take the table; without an estimator there is nothing to follow."""
        if not any(effect.kind == "estimator" for effect in problem.scene.effects):
            message = "has no estimate to follow; allowed: beside the effect estimator"
            raise InputError([Fault(problem.name, None, place, message)])
        return cls(HoldSettings(table.hold_s), AdaptationSettings(table.slew_per_s, table.passive))

    @property
    def gain_table(self) -> GainTable | None:
        """The gain table, where one is bound."""
        return self.table

    def sample(self, tick: Tick) -> None:
        """Look the gains up; they come into force when the coupling asks for them."""
        if self.table is None:
            return
        rows = self.table
        step = hold_step(tick.sample_time_s, self.hold)
        # Without an estimator, as when its worth is being weighed, the gains are those of rest.
        estimate = [0.0, 0.0] if tick.frequency_hz is None else [tick.frequency_hz, tick.frequency_valid]
        frequency, _ = insert(tick, "hold", step, estimate, (rows.rest_hz,))
        wanted = rows.expressions(frequency)
        rest = rows.rest_stiffness_n_per_m
        tick.adapt = lambda deflection, one_sided: self._change(tick, wanted, rest, deflection, one_sided=one_sided)

    def _change(self, tick: Tick, wanted: list[Expr], rest: Expr, deflection: Expr, *, one_sided: bool) -> AdaptedGains:
        import casadi as ca  # noqa: PLC0415

        inputs = [*wanted, deflection]
        touching: Expr = 1
        with tick.owned_by(self.kind):
            if self.settings.passive:
                environment = tick.state("environment_energy_j")
                tick.at_end.append(lambda: tick.follow("environment_energy_j", tick.environment_energy_j))
                touching = tick.position > 0 if one_sided else 1
                depth = ca.fmax(tick.position, 0) if one_sided else tick.position
                inputs += [environment, tick.asked_force(), depth, touching, rest]
            step = adaptation_step(tick.sample_time_s, self.settings)
            outputs = insert(tick, "adaptation", step, inputs)
        named = dict(zip(step.outputs, outputs, strict=True))
        for name in ("damping_ns_per_m", "stiffness_n_per_m", "contact_damping_ns_per_m", "anchor_m"):
            tick.trace(name, named[name])
        return AdaptedGains(
            damping_ns_per_m=named["damping_ns_per_m"],
            stiffness_n_per_m=named["stiffness_n_per_m"],
            contact_damping_ns_per_m=named["contact_damping_ns_per_m"],
            anchor_m=named["anchor_m"],
            touching=touching,
        )
