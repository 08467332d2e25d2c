"""The commands of `avc` in the order of `avc --help`, and the module of each.

A module has ``add_<verb>(parser)``, whose docstring is the help, and ``run_<verb>(args, console)``.
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
_FILES = ("design", "judge", "measure", "deploy", "look", "look")
MODULES: dict[str, str] = {
    verb: module for module, verbs in zip(_FILES, QUESTIONS.values(), strict=True) for verb in verbs
}
"""The module of each command."""
VERBS: tuple[str, ...] = tuple(MODULES)
"""All commands."""
