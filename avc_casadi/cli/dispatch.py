"""Parsing of the command line, dispatch, and exit codes."""

from __future__ import annotations

import argparse
import re
import shlex
import sys
import traceback
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from difflib import get_close_matches
from textwrap import wrap
from typing import Any, NoReturn

from avc_casadi import AvcError, InputError, LinkError, NotDeployableError, PortError, UnsupportedError, __version__
from avc_casadi._util.interrupt import EXIT_CODE, interrupted, take_interrupt
from avc_casadi.cli import deploy, design, judge, look, measure, operate  # noqa: F401 - they declare the verbs
from avc_casadi.cli.arguments import QUESTIONS, VERBS, keep_inputs
from avc_casadi.cli.console import Console, silence

NO, BAD_INPUT, INTERNAL, BROKEN_PIPE = 1, 2, 70, 141

_VERB = "VERB"
_EPILOG = """\
P is a problem file or a name of the catalogue (avc list); GAINS is what `avc solve --out` wrote.
exit codes: 0 done; 1 the answer is no; 2 bad input; 130 interrupted.
start with: avc run figure5
"""


class _Parser(argparse.ArgumentParser):
    """Parser that raises instead of exiting, so that a wrong argument obeys --json too and a closed pipe is noticed."""

    def error(self, message: str) -> NoReturn:
        found = re.match(r"argument ([^:]+): (.*)", message, re.DOTALL)
        key, what = (found[1], found[2]) if found else ("", message)
        if key == _VERB and (typed := re.match(r"invalid choice: '([^']*)'", what)):
            near = get_close_matches(typed[1], VERBS, n=1)
            what = f"{typed[1]!r} is no verb; "
            what += f"did you mean {near[0]}" if near else f"allowed: {', '.join(VERBS)}"
        if key.startswith("-") and what == "expected one argument":
            what += f"; a value that begins with - is written {key}=VALUE"
        raise InputError.of(f"{what}; see `{self.prog} --help`", key=key)

    def _print_message(self, message: str, file: Any = None) -> None:
        (file or sys.stderr).write(message)  # argparse's own drops what cannot be written


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of all verbs; imports nothing slow."""
    parser = _Parser(
        prog="avc",
        usage="avc [-h] [--version] VERB ...",
        description="Design, certify, simulate and deploy adaptive virtual couplings for haptic devices.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"avc-casadi {__version__}")
    verbs = parser.add_subparsers(
        metavar=_VERB, prog="avc", required=True, parser_class=_Parser, help=argparse.SUPPRESS
    )
    listed: list[str] = []
    order = list(QUESTIONS)
    for name, verb in sorted(VERBS.items(), key=lambda one: order.index(one[1].module)):
        command = verbs.add_parser(
            name,
            description=verb.help,
            formatter_class=argparse.RawDescriptionHelpFormatter,
            allow_abbrev=False,
        )
        verb.declare(command)
        command.add_argument("--json", action="store_true", help="print one JSON document and nothing else")
        # A positional argument has no option as its name.
        options = {action.dest: action.option_strings[-1] for action in command._actions if action.option_strings}  # noqa: SLF001
        command.set_defaults(run=verb.run, options=options)
        if (question := f"{QUESTIONS[verb.module]}:") not in listed:
            listed.append(question)
        summary = verb.help.partition("\n")[0].rstrip(".")
        listed += wrap(summary, 110, initial_indent=f"  {name:<12}", subsequent_indent=" " * 14)
    parser.epilog = "\n".join([*listed, "", _EPILOG])
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run `avc` with arguments without the program's name, or those of the process; return its exit code."""
    arguments = sys.argv[1:] if argv is None else list(argv)
    as_json = "--json" in arguments
    console: Console | None = None
    if sys.stdout is None:
        with suppress(OSError, AttributeError):
            sys.stderr.write("avc: standard output is closed\n")
        return BAD_INPUT
    try:
        try:
            args = build_parser().parse_args(arguments)
        except SystemExit as leaving:  # --help and --version
            sys.stdout.flush()
            return int(leaving.code or 0)
        except InputError as error:
            console = Console(as_json=as_json)
            return _refused(console, error)
        console = Console(as_json=as_json)
        return _answered(args, console, arguments)
    except KeyboardInterrupt:
        take_interrupt()
        (console or Console(as_json=as_json)).interrupted()
        return EXIT_CODE
    except OSError as error:  # of standard output: what else happened has been answered
        silence(1)
        if not isinstance(error, BrokenPipeError):
            sys.stderr.write(f"avc: standard output cannot be written ({error.strerror or error})\n")
        return BROKEN_PIPE if isinstance(error, BrokenPipeError) else BAD_INPUT


def _answered(args: argparse.Namespace, console: Console, arguments: Sequence[str]) -> int:
    """Run the verb; every outcome is a document or a message, and an exit code."""
    try:
        keep_inputs(args)
        answer = args.run(args, console)
    except BrokenPipeError:
        raise
    except Exception as error:
        if interrupted():  # CasADi converts Ctrl-C to errors of its own
            raise KeyboardInterrupt from error
        if isinstance(error, InputError):  # the option, where an argument of a call is at fault
            faults = [one if one.file else replace(one, key=args.options.get(one.key, one.key)) for one in error.faults]
            return _refused(console, InputError(faults))
        if isinstance(error, AvcError | OSError):
            return _refused(console, error)
        console.complain(traceback.format_exc())
        console.refuse(InputError.of(f"internal error: {error!r}"), "avc: internal error; please report it")
        return INTERNAL
    commands = dict.fromkeys(_again(one, arguments) for one in answer.commands)
    console.answer(replace(answer, commands=tuple(filter(None, commands))), verbose=getattr(args, "verbose", False))
    return answer.code or int(bool(answer.complaint))


def _again(command: str, arguments: Sequence[str]) -> str:
    """Return a command that shows more of the same answer with what was typed; empty where that was asked for."""
    flag = command.rpartition(" ")[2]
    if flag not in {"-v", "--explain"}:
        return command
    return "" if flag in arguments else shlex.join(["avc", *arguments, flag])


def _refused(console: Console, error: AvcError | OSError) -> int:
    if isinstance(error, InputError):
        error = InputError([replace(fault, file=fault.file or "command line") for fault in error.faults])
        count = len(error.faults)
        summary = f"\navc: {count} faults" if count > 1 else ""
        console.refuse(error, "\n".join(f"avc: {fault}" for fault in error.told) + summary)
        return BAD_INPUT
    key = error.key if isinstance(error, UnsupportedError) else ""
    console.refuse(InputError.of(str(error), key=key), f"avc: {error}")
    said_no = isinstance(error, LinkError | NotDeployableError) and not isinstance(error, PortError)
    return NO if said_no else BAD_INPUT
