"""The commands of `avc` in the order of `avc --help`: each is the module ``_<name>`` beside this file.

A command module has a docstring (its first line is the help), ``add_arguments(parser)`` and ``run(args, console)``.
"""

from __future__ import annotations

QUESTIONS: dict[str, tuple[str, ...]] = {
    "design a coupling": ("new", "recommend", "run", "solve", "compare"),
    "judge it": ("certify", "simulate", "trial", "zwidth"),
    "measure a device": ("excite", "identify", "diagnose", "commission"),
    "deploy": ("export", "push", "stream", "monitor", "device", "firmware"),
    "look": ("list", "check", "explore", "doctor"),
    "study": ("study",),
}
"""The commands, by the question that they answer."""

VERBS: tuple[str, ...] = tuple(verb for verbs in QUESTIONS.values() for verb in verbs)
"""All commands."""

OLD_VERBS: dict[str, tuple[str, ...]] = {
    "accuracy": ("study", "accuracy"),
    "table1": ("study", "table1"),
    "screen": ("simulate", "--screen"),
    "ports": ("doctor", "--ports"),
    "limits": ("device", "--limits"),
    "store": ("device", "--store"),
    "clear": ("device", "--clear"),
}
"""Commands of release 0.2, each with its name since 0.3; the old names go with 0.4."""
