"""Putting a step of the runtime into the sample of a scene."""

from __future__ import annotations

from avc_casadi.runtime import Step
from avc_casadi.scene.loop import Expr, Tick


def insert(tick: Tick, prefix: str, step: Step, inputs: list[Expr], parameters: tuple[Expr, ...] = ()) -> list[Expr]:
    """Add a step's states to the sample and return its outputs."""
    names = [f"{prefix}_{name}" for name in step.states]
    state = [tick.state(name, initial) for name, initial in zip(names, step.initial, strict=True)]
    following, outputs = step.apply(state, inputs, list(parameters))
    for name, value in zip(names, following, strict=True):
        tick.follow(name, value)
    return outputs
