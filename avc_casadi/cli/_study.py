"""Run a study of the source distribution, or list them: the cost of accuracy, the paper's Table 1."""

from __future__ import annotations

import argparse
import ast
import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType

from avc_casadi import InputError, UnsupportedError, __version__
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._text import table

_TESTS = Path(__file__).parents[2] / "tests"
_STUDIES = _TESTS / "benchmarks" / "studies"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments; those of a study are read by its own command."""
    parser.add_argument("study", metavar="NAME", nargs="?", help="of the study; left out: list them")
    parser.add_argument(
        "arguments", metavar="...", nargs=argparse.REMAINDER, help="of the study: avc study NAME --help tells them"
    )


def run(args: argparse.Namespace, console: Console) -> Answer:  # noqa: ARG001
    """List the studies."""
    found = _commands()
    titles = {
        name: (ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "").partition("\n")[0]
        for name, path in found.items()
    }
    document = {"schema": "avc-studies/1", "studies": titles}
    return Answer(document, table(("study", "what it does"), titles.items(), left=(0, 1)))


def command(name: str) -> ModuleType:
    """Return the command of a study: a module like that of a verb.

    Raises:
        InputError: no such study.
        UnsupportedError: this installation has no studies.
    """
    found = _commands()
    if name not in found:
        raise InputError.of(f"{name!r} is no study; allowed: {', '.join(found)}", key="NAME")
    for folder in (_TESTS, _STUDIES.parent):
        if str(folder) not in sys.path:
            sys.path.append(str(folder))
    return import_module(f"studies.{name}.command")


def _commands() -> dict[str, Path]:
    """Return the file of each study's command.

    Raises:
        UnsupportedError: there are none.
    """
    found = {path.parent.name: path for path in sorted(_STUDIES.glob("*/command.py"))}
    if not found:
        raise UnsupportedError(
            f"studies come with the source distribution, and a wheel is installed here; unpack "
            f"avc_casadi-{__version__}.tar.gz (it stands where the wheel came from) or take a checkout, and in its "
            "folder run `python -m avc_casadi study`"
        )
    return found
