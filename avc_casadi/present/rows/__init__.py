"""Rows of answers, a module for each kind of question; each is loaded at its first use."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from avc_casadi.present.rows import (
        admittance,
        answers,
        deploy,
        design,
        engines,
        force_feedback,
        joint,
        judge,
        law_region,
        look,
        measure,
        recommend,
        subject,
        tried,
    )

__all__ = [
    "admittance",
    "answers",
    "deploy",
    "design",
    "engines",
    "force_feedback",
    "joint",
    "judge",
    "law_region",
    "look",
    "measure",
    "recommend",
    "subject",
    "tried",
]

if not TYPE_CHECKING:

    def __getattr__(name):
        from importlib import import_module  # noqa: PLC0415 - paid at first use only

        if name not in __all__:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return import_module(f"{__name__}.{name}")
