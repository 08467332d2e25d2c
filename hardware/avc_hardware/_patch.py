"""An image for another device: the same program with other numbers at its named places."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

from avc_casadi import UnsupportedError
from avc_hardware._figures import ESTIMATOR_NUMBERS, RuntimeFigures
from avc_hardware._host import BoardLimits

if TYPE_CHECKING:
    from avc_hardware._elf import Image

_FIGURES = struct.Struct("<4fHH")


def image_for(image: Image, limits: BoardLimits, figures: RuntimeFigures) -> Image:
    """Return the packaged image with limits and figures in place of its own.

    Raises:
        UnsupportedError: it has no program for them.
    """
    if (figures.sample_time_s, figures.metres_per_count) != (limits.sample_time_s, limits.metres_per_count):
        raise UnsupportedError(
            f"the board ticks every {limits.sample_time_s:g} s with steps of {limits.metres_per_count:g} m, its tick "
            f"is made for {figures.sample_time_s:g} s and {figures.metres_per_count:g} m; give both the same"
        )
    if limits != BoardLimits():
        image = image.patched("hal_limits", limits.packed())
    return image if figures == RuntimeFigures() else _with_figures(image, figures)


def _with_figures(image: Image, figures: RuntimeFigures) -> Image:
    from avc_hardware._runtime_constants import constants  # noqa: PLC0415 - it needs CasADi

    built = RuntimeFigures()
    if figures.estimator != built.estimator:
        raise _other("estimator", figures.estimator, built.estimator)
    if not figures.passive:
        raise _other("passive", figures.passive, built.passive)
    if figures.slew_per_s is None:
        raise _other("slew_per_s", "none", "any number")
    for symbol, numbers in constants(figures).items():
        image = image.patched(symbol, numbers.astype("<f4").tobytes())
    packed = _FIGURES.pack(
        figures.hold_s,
        figures.slew_per_s,
        figures.guard_damping_ns_per_m,
        figures.hand_m_per_unit,
        ESTIMATOR_NUMBERS.index(figures.estimator),
        figures.passive,
    )
    return image.patched("avc_figures", packed)


def _other(name: str, value: object, allowed: object) -> UnsupportedError:
    return UnsupportedError(
        f"the packaged firmware has no program for {name} {value}; allowed: {allowed}; export the coupling for "
        "firmware of your own: avc export",
        key=f"runtime.{name}",
    )
