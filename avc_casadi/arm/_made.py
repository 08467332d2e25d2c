"""From an arm file to an arm."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from avc_casadi._errors import InputError
from avc_casadi.arm._arm import Arm, evaluated
from avc_casadi.arm._five_bar import five_bar
from avc_casadi.arm._gantry import gantry
from avc_casadi.arm._phantom import phantom
from avc_casadi.problem import ArmFile, load_arm


def arm(source: str | Path | ArmFile) -> Arm:
    """Make an arm.

    Args:
        source: an arm file, its path, or a name of the catalogue of arms.

    Raises:
        InputError: with every fault of the file.
        MissingExtraError: a model file without the extra ``arms``.
        UnsupportedError: a model without inertias, or with joints that are not taken.
    """
    file = source if isinstance(source, ArmFile) else load_arm(source)
    told = (file.name or "arm") if isinstance(source, ArmFile) else str(source)
    if file.phantom is not None:
        made = phantom(file, file.phantom)
    elif file.five_bar is not None:
        made = five_bar(file, file.five_bar)
    elif file.gantry is not None:
        made = gantry(file, file.gantry)
    else:
        from avc_casadi.arm._model_file import model_arm  # noqa: PLC0415 - adam takes seconds to load

        assert file.model is not None  # noqa: S101 - a rule of the file
        try:
            made = model_arm(file, file.model)
        except InputError as error:
            raise InputError([fault if fault.file else replace(fault, file=told) for fault in error.faults]) from error
    joints, axes = made.joints, len(made.axes)
    if len(file.home) != joints:
        raise InputError.of(f"has {len(file.home)} values; allowed: {joints}, one of each joint", file=told, key="home")
    if len(file.workspace.low_m) != axes:
        message = f"has {len(file.workspace.low_m)} numbers; allowed: {axes}, along {', '.join(made.axes)}"
        raise InputError.of(message, file=told, key="workspace.low_m")
    _check_home(made, told)
    return made


def _check_home(made: Arm, told: str) -> None:
    """Refuse a home where the mechanism cannot stand, or where its tip cannot move along every axis.

    Raises:
        InputError: it is such a one.
    """
    home = made.home[None]
    stands = np.concatenate([evaluated(one, home).ravel() for one in (made.tip, made.allowed)])
    shown = ", ".join(f"{value:g}" for value in made.home)
    if not np.isfinite(stands).all() or evaluated(made.allowed, home).min(initial=0.0) < 0:
        message = f"is [{shown}], where the mechanism cannot stand; allowed: joint values within its reach and limits"
        raise InputError.of(message, file=told, key="home")
    if np.linalg.matrix_rank(evaluated(made.jacobian, home)[0]) < len(made.axes):
        message = f"is [{shown}], a singular pose: the tip cannot move along every axis there; allowed: another pose"
        raise InputError.of(message, file=told, key="home")
