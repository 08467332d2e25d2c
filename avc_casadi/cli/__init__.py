"""The command `avc`: its verbs stand in five modules, which declare them; here they are parsed and run."""

from __future__ import annotations

import argparse
import re
import shlex
import shutil
import sys
import traceback
from collections.abc import Mapping, Sequence
from dataclasses import replace
from difflib import get_close_matches
from inspect import cleandoc
from pathlib import Path
from textwrap import wrap
from typing import Any, NoReturn

from avc_casadi import AvcError, InputError, LinkError, NotDeployableError, PortError, UnsupportedError, __version__
from avc_casadi._errors import Fault
from avc_casadi._util.interrupt import exit_code, interrupted, take_interrupt
from avc_casadi.cli import deploy, design, judge, look, measure
from avc_casadi.cli.arguments import VERBS
from avc_casadi.cli.console import Console, silence
from avc_casadi.present.row import row

NO = 1
"""Exit code of a negative verdict: not stable, not deployable, not found."""

BAD_INPUT = 2
"""Exit code of a refused input."""

INTERNAL = 70
"""Exit code of an error of the program: EX_SOFTWARE of sysexits.h."""

BROKEN_PIPE = 141
"""Exit code where the reader has closed standard output: 128 + SIGPIPE, as of a shell."""

_VERB = "VERB"
_QUESTIONS = {
    "design a coupling": design,
    "judge a coupling": judge,
    "measure a device": measure,
    "deploy a coupling and operate a device": deploy,
    "inspect files, this installation and the paper": look,
}
_EPILOG = """\
A problem P is a problem file, or the name of a built-in problem (avc list).
Exit codes: 0 success; 1 negative verdict (such as not deployable); 2 bad input; 70 internal error;
130 interrupted (Ctrl-C); 141 closed pipe; 143 ended (SIGTERM).
Start with: avc run figure5
"""
_WIDTH = 100
"""Columns of the help on a wider terminal, or on none."""


class _Help(argparse.RawDescriptionHelpFormatter):
    """Formatter whose lines have at most 100 columns."""

    def __init__(self, prog: str) -> None:
        columns = shutil.get_terminal_size((_WIDTH, 24)).columns
        super().__init__(prog, max_help_position=24, width=min(columns, _WIDTH))


class _Parser(argparse.ArgumentParser):
    """Parser that raises instead of exiting, so that a wrong argument obeys --json too and a closed pipe is noticed."""

    def error(self, message: str) -> NoReturn:
        of_argument = re.match(r"argument ([^:]+): (.*)", message, re.DOTALL)
        key, fault = (of_argument[1], of_argument[2]) if of_argument else ("", message)
        key = next((name for name in key.split("/") if name.startswith("--")), key)
        wrong_choice = re.match(r"invalid choice: '([^']*)'", fault)
        if key == _VERB and wrong_choice:
            typed = wrong_choice[1]
            near = get_close_matches(typed, VERBS, n=1)
            advice = f"did you mean {near[0]!r}?" if near else f"Commands: {', '.join(VERBS)}"
            fault = f"unknown command {typed!r}; {advice}"
        if key.startswith("-") and fault == "expected one argument":
            fault = f"needs a value; write {key}=VALUE if the value begins with -"
        raise InputError.of(f"{fault.rstrip('?')}; see `{self.prog} --help`", key=key)

    def _print_message(self, message: str, file: Any = None) -> None:
        (file or sys.stderr).write(message)  # argparse's own drops what cannot be written


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of all verbs; imports nothing slow."""
    about = "Design, certify, simulate and deploy virtual couplings for haptic devices."
    usage: dict[str, Any] = {"formatter_class": _Help, "allow_abbrev": False}
    parser = _Parser(prog="avc", usage="avc [-h] [--version] VERB ...", description=about, **usage)
    parser.add_argument("--version", action="version", version=f"avc-casadi {__version__}")
    verbs = parser.add_subparsers(
        metavar=_VERB, prog="avc", required=True, parser_class=_Parser, help=argparse.SUPPRESS
    )
    listed: list[str] = []
    for question, module in _QUESTIONS.items():
        listed.append(f"{question}:")
        for name, (run, arguments) in VERBS.items():
            if run.__module__ != module.__name__:
                continue
            text = cleandoc(run.__doc__ or "")
            command = verbs.add_parser(name, description=text.replace("\n\n", "\n", 1), add_help=False, **usage)
            command.add_argument("-h", "--help", action="help", help=argparse.SUPPRESS)
            for names, options in arguments:
                command.add_argument(*names, **options)
            command.add_argument("--json", action="store_true", help="print the answer as one JSON document")
            command.usage = _usage(command)
            options = _long_options(command)
            texts = {options[action.dest]: action.help or "" for action in command._actions if action.dest in options}  # noqa: SLF001
            command.set_defaults(run=run, options=options, texts=texts, first=_first_positional(command))
            summary = text.partition("\n")[0].rstrip(".")
            listed += wrap(summary, _WIDTH, initial_indent=f"  {name:<12}", subsequent_indent=" " * 14)
    parser.epilog = "\n".join([*listed, "", _EPILOG])
    return parser


def _usage(command: argparse.ArgumentParser) -> str:
    """Return the usage of a verb: its positional arguments and its required options."""
    words = [command.prog]
    for action in command._actions:  # noqa: SLF001
        name = action.metavar or action.dest.upper()
        if action.option_strings:
            words += [f"{action.option_strings[0]} {name}"] if action.required else []
        else:
            words.append({"?": f"[{name}]", "+": f"{name} [{name} ...]"}.get(str(action.nargs), str(name)))
    return " ".join([*words, "[options]"])


def _long_options(command: argparse.ArgumentParser) -> dict[str, str]:
    """Return the option with two dashes of each argument that has one, by the name of its value."""
    return {
        action.dest: next(name for name in action.option_strings if name.startswith("--"))
        for action in command._actions  # noqa: SLF001
        if action.option_strings
    }


def _first_positional(command: argparse.ArgumentParser) -> str:
    """Return the name of the first argument without a dash; empty where there is none."""
    positional = (action.dest for action in command._actions if not action.option_strings)  # noqa: SLF001
    return next(positional, "")


def main(argv: Sequence[str] | None = None) -> int:
    """Run `avc` with arguments without the program's name, or those of the process; return its exit code."""
    arguments = sys.argv[1:] if argv is None else list(argv)
    as_json = "--json" in arguments
    console: Console | None = None
    try:
        try:
            args, unknown = build_parser().parse_known_args(arguments)
            if unknown:
                raise _unrecognized(arguments, unknown, args.texts)
        except SystemExit as leaving:  # --help and --version
            sys.stdout.flush()
            return int(leaving.code or 0)
        except InputError as error:
            console = Console(as_json=as_json)
            return _refused(console, error)
        # An option with two names has that which the user typed.
        typed = {key: option for key, option in getattr(args, "given", {}).items() if option.startswith("--")}
        args.options = {**args.options, **typed}
        console = Console(as_json=as_json, work=f"avc {arguments[0]}")
        return _answered(args, console, arguments)
    except KeyboardInterrupt:
        take_interrupt()
        (console or Console(as_json=as_json)).interrupted()
        return exit_code()
    except OSError as error:  # of standard output: what else happened has been answered
        silence(1)
        if not isinstance(error, BrokenPipeError):
            sys.stderr.write(f"avc: cannot write to standard output ({error.strerror or error})\n")
        return BROKEN_PIPE if isinstance(error, BrokenPipeError) else BAD_INPUT


def _unrecognized(arguments: Sequence[str], unknown: Sequence[str], texts: Mapping[str, str]) -> InputError:
    """Return the fault of arguments that no option takes; `texts` has the help of each option.

    The first may be the value of a flag that is the end of a longer option: ``--force 3`` where ``--max-force 3`` is
    meant. Otherwise options are near whose name or help has its name.
    """
    flag = arguments[max(arguments.index(unknown[0]) - 1, 0)]
    longer = [option for option in texts if option.endswith(flag[1:]) and option != flag]
    meant = f"{flag} takes no value, did you mean {longer[0]}; " if longer and flag[0] == "-" else ""
    name = unknown[0].partition("=")[0]
    if not meant and name.startswith("--"):
        mentions = [option for option, text in texts.items() if name.strip("-") in f"{option} {text}"]
        near = mentions[:3] or get_close_matches(name, texts, n=1)
        meant = f"did you mean {' or '.join(near)}; " if near else ""
    return InputError.of(f"unrecognized arguments: {' '.join(unknown)}; {meant}see `avc {arguments[0]} -h`")


def _answered(args: argparse.Namespace, console: Console, arguments: Sequence[str]) -> int:
    """Run the verb; every outcome is a document or a message, and an exit code."""
    try:
        _keep_inputs(args)
        answer = args.run(args, console)
    except BrokenPipeError:
        raise
    except Exception as error:
        if interrupted():  # CasADi converts Ctrl-C to errors of its own
            raise KeyboardInterrupt from error
        if isinstance(error, InputError):
            return _refused(console, InputError([_located(args, fault) for fault in error.faults]))
        if isinstance(error, AvcError | OSError):
            return _refused(console, error, _file_of(args, error))
        console.complain(traceback.format_exc())
        console.refuse(InputError.of(f"internal error: {error!r}"), "avc: internal error; please report this output")
        return INTERNAL
    verbose = getattr(args, "verbose", True)
    if not verbose and any(shown.rank > 0 for shown in answer.rows):
        answer = replace(answer, commands=(*answer.commands, shlex.join(["avc", *arguments, "-v"])))
    if console.written:
        answer = replace(answer, rows=(*answer.rows, row("Written", ", ".join(console.written), rank=-1)))
    console.answer(answer, verbose=verbose)
    return answer.code or int(bool(answer.complaint))


def _located(args: argparse.Namespace, fault: Fault) -> Fault:
    """Return a fault with the option that is at fault, or the files that the command was given."""
    if fault.file:
        return fault
    key = args.options.get(fault.key, fault.key)
    if not key or key.startswith("-") or key.isupper():
        return replace(fault, key=key)
    first = getattr(args, args.first, "")
    return replace(fault, file=", ".join(first) if isinstance(first, list) else str(first), key=key)


def _keep_inputs(args: argparse.Namespace) -> None:
    """Refuse to write over a file that the command was given."""
    values = [value for given in vars(args).values() for value in (given if isinstance(given, list) else [given])]
    inputs = [Path(value) for value in values if isinstance(value, str) and "\0" not in value]
    for key, path in vars(args).items():
        if not isinstance(path, Path):
            continue
        manifest = [path.with_suffix(".json")] if path.suffix == ".npz" else []  # that of traces
        for output in (path, *manifest):
            if output.exists() and any(file.exists() and output.samefile(file) for file in inputs):
                message = f"{str(output)!r} is an input file of this command; choose another name"
                raise InputError.of(message, key=args.options.get(key, key.upper()))


def _file_of(args: argparse.Namespace, error: AvcError | OSError) -> str:
    """Return what an error is about: the port of a link, the file of the operating system, or the command's file."""
    if isinstance(error, LinkError):
        return str(getattr(args, "port", ""))
    if isinstance(error, OSError):
        return str(error.filename or "")
    given = getattr(args, args.first, "") if isinstance(error, NotDeployableError | UnsupportedError) else ""
    return given if isinstance(given, str) else ""


def _refused(console: Console, error: AvcError | OSError, file: str = "") -> int:
    if isinstance(error, InputError):
        error = InputError([replace(fault, file=fault.file or "command line") for fault in error.faults])
        count = len(error.faults)
        summary = f"\navc: {count} errors" if count > 1 else ""
        console.refuse(error, "\n".join(f"avc: {fault}" for fault in error.told) + summary)
        return BAD_INPUT
    key = error.key if isinstance(error, UnsupportedError) else ""
    message = str(error).removeprefix(f"{file}: ") if file else str(error)
    console.refuse(InputError.of(message, file=file, key=key), f"avc: {error}")
    said_no = isinstance(error, LinkError | NotDeployableError) and not isinstance(error, PortError)
    return NO if said_no else BAD_INPUT
