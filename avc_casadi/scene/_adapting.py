"""Binding a gain table to the adaptation of a scene."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from avc_casadi.coupling import Gains, GainTable, thinned
from avc_casadi.scene.effects import Adaptation, SceneEffect

if TYPE_CHECKING:
    from avc_casadi.coupling import GainSchedule


def bind(effects: tuple[SceneEffect, ...], gains: Gains | GainTable | GainSchedule) -> tuple[SceneEffect, ...]:
    """Give the adaptation its table; gains that are numbers stay as they are, whatever the estimate.

    Args:
        effects: the effects of a scene.
        gains: a gain table, or constant gains.

    Raises:
        InputError: a table without any gains.
    """
    if isinstance(gains, Gains) or not any(isinstance(effect, Adaptation) for effect in effects):
        return effects
    table = gains if isinstance(gains, GainTable) else thinned(GainTable.of(gains))
    return tuple(replace(effect, table=table) if isinstance(effect, Adaptation) else effect for effect in effects)
