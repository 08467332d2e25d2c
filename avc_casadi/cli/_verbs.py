"""The commands of `avc` in the order of `avc --help`: each is the module ``_<name>`` beside this file.

A command module has a docstring (its first line is the help), ``add_arguments(parser)`` and ``run(args, console)``.
"""

from __future__ import annotations

QUESTIONS: dict[str, tuple[str, ...]] = {
    "design a coupling": ("new", "recommend", "run", "solve", "compare"),
    "judge it": ("certify", "simulate", "trial", "zwidth"),
    "measure a device": ("excite", "identify", "diagnose"),
    "deploy": ("export", "push", "stream", "monitor", "device", "firmware"),
    "look": ("list", "check", "explore", "doctor"),
    "study": ("accuracy", "table1"),
}
"""The commands, by the question that they answer."""

VERBS: tuple[str, ...] = tuple(verb for verbs in QUESTIONS.values() for verb in verbs)
"""All commands."""
