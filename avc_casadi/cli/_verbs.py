"""The verbs of `avc` in the order of `avc --help`: each is the module ``_<name>`` beside this file.

A verb module has a docstring (its first line is the help), ``add_arguments(parser)`` and ``run(args, console)``.
"""

from __future__ import annotations

VERBS: tuple[str, ...] = (
    "run",
    "recommend",
    "explore",
    "list",
    "check",
    "solve",
    "compare",
    "certify",
    "simulate",
    "screen",
    "zwidth",
    "pareto",
    "accuracy",
    "table1",
    "trial",
    "excite",
    "identify",
    "diagnose",
    "arm",
    "commission",
    "push",
    "stream",
    "export",
    "firmware",
    "ports",
    "monitor",
    "clear",
    "limits",
    "store",
    "doctor",
)
