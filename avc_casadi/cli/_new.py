"""Write a problem file from what you know of a device, its wall and what holds it, by questions or options."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from typing import TYPE_CHECKING

from avc_casadi import Fault, InputError
from avc_casadi.cli._arguments import add_worded, check_worded
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._files import output_file, write_text
from avc_casadi.files.questions import HAND_RANGES, HOLDS, QUESTIONS, RADIUS, Question

if TYPE_CHECKING:
    from pathlib import Path

    from avc_casadi.files.new_problem import NewProblem

_EVERY = (RADIUS, *QUESTIONS, *HAND_RANGES)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.description = (
        f"{__doc__}\nWithout options it asks. A value is typed with its unit, in any that fits ('55 um', '1 kHz',\n"
        "'4096 counts'; without one it is in SI units); 'unknown' leaves it out. Of a device that turns: --radius,\n"
        "--inertia, --max-torque, and units such as N.m/rad."
    )
    parser.add_argument("file", metavar="FILE", help="problem file to write, .toml")
    parser.add_argument("--like", metavar="D", help="device to begin from: a name of `avc list`, or a device file")
    parser.add_argument("--held", choices=tuple(HOLDS), help="what holds it; default grip")
    for one in _EVERY:
        asks = str(one.asks)
        text = f"{asks[0].lower()}{asks[1:]}: {', '.join(dict.fromkeys(one.examples))}"
        if one.turning:
            add_worded(parser, one.option, one.turning, "V", text, str)
        else:
            parser.add_argument(one.option, metavar="V", help=text)
    parser.add_argument("--force", action="store_true", help="write over a file that is there")


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Ask, or take the options; write, read back and show.

    Raises:
        InputError: with every fault, each under its option.
    """
    from avc_casadi._util.units import speak
    from avc_casadi.files.new_problem import NewProblem
    from avc_casadi.files.problem_document import problem_document
    from avc_casadi.present.pages.catalogue import new_page

    path = output_file(args.file, "FILE", (".toml",))
    if path.exists() and not args.force:
        raise InputError.of(f"{args.file!r} is there already; allowed: another name, or --force", key="FILE")
    typed = {one.key: text for one in _EVERY if (text := getattr(args, _dest(one))) is not None}
    if typed or args.like is not None or args.held is not None:
        turned = RADIUS.key in typed or any(given != names[0] for given, names in getattr(args, "worded", {}).values())
        new = NewProblem(path, args.like or "", "rotary" if turned else "linear", args.held or "grip", typed)
        check_worded(args, new.units)
    else:
        new = _Asking(console).asked(path)
    speak(new.units)
    if faults := [*_alien(new), *new.faults()]:
        raise InputError([replace(one, key=_option(one.key, new)) for one in faults])
    write_text(path, new.text(), "FILE")
    problem = new.problem()
    doubts = [{"key": new.units.key(one.key), "message": one.message} for one in new.doubts()]
    document = {
        "schema": "avc-new/1",
        "file": str(path),
        "problem": problem_document(problem),
        "held": new.held,
        "assumed": new.assumed(),
        "not_known": [{"key": new.units.key(one.key), "message": one.cost} for one in new.unknown()],
        "warnings": doubts,
    }
    return Answer(document, new_page(document, problem, console.page, args.file))


def _dest(question: Question) -> str:
    return question.option[2:].replace("-", "_")


def _option(key: str, new: NewProblem) -> str:
    """Return the option of a question, or the key itself."""
    found = next((one for one in _EVERY if one.key == key), None)
    return key if found is None else found.names[not new.units.linear]


def _alien(new: NewProblem) -> list[Fault]:
    """Return a fault of each option for another kind of device or other hands."""
    asked = {one.key for one in new.questions()}
    of_hands = "goes with --held foot or --held other; leave it out"
    whys = {RADIUS.key: "is that of the device of --like; leave it out", **{one.key: of_hands for one in HAND_RANGES}}
    return [Fault("", None, key, whys[key]) for key in new.answers if key not in asked]


class _Asking:
    """Questions on standard error, answers from standard input, a line each."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._ended = False

    def asked(self, path: Path) -> NewProblem:
        """Ask all questions."""
        from avc_casadi._util.units import speak

        self._console.complain(
            "Enter takes what stands in brackets; values with their unit, in any that fits; 'unknown' leaves one out."
        )
        new = self._begun(path)
        speak(new.units)
        for question in new.questions():
            new = self._answered(new, question)
        held = self._line(f"Held by ({', '.join(HOLDS)})", "grip")
        while held not in HOLDS and not self._ended:
            held = self._line(f"  {held!r} is none of them; held by", "grip")
        new = replace(new, held=held)
        for question in HAND_RANGES if set(HAND_RANGES) <= set(new.questions()) else ():
            new = self._answered(new, question)
        return new

    def _begun(self, path: Path) -> NewProblem:
        from avc_casadi.files.new_problem import NewProblem

        while True:
            word = self._line(
                "Begin from a device (a name of `avc list`, or a device file), or linear, or rotary", "linear"
            )
            if word in {"linear", "rotary"}:
                return NewProblem(path, motion="rotary" if word == "rotary" else "linear")
            new = NewProblem(path, word)
            try:
                _ = new.units
            except InputError as error:
                if self._ended:
                    raise
                self._console.complain(f"  {error}")
                continue
            return new

    def _answered(self, new: NewProblem, question: Question) -> NewProblem:
        """Ask until the answer is valid; a doubtful one is accepted when typed twice."""
        default, doubted = new.default(question), ""
        while True:
            unit = f"{question.asks} (for example {new.example(question)})"
            typed = self._line(unit, default)
            if typed == default and question.key.startswith("device.") and new.like:
                return new
            told = replace(new, answers={**new.answers, question.key: typed})
            wrong, unlikely = told.judged(question)
            if self._ended or (not wrong and (not unlikely or typed == doubted)):
                return told
            for one in wrong:
                self._console.complain(f"  {one.message}")
            for one in unlikely:
                self._console.complain(f"  {one.message} Type it again if it is.")
                doubted = typed

    def _line(self, question: str, default: str) -> str:
        """Ask one question; Enter, or the end of the input, gives the answer in brackets."""
        if self._ended:
            return default
        sys.stderr.write(f"{question}{f' [{default}]' if default else ''}: ")
        sys.stderr.flush()
        line = sys.stdin.readline()
        self._ended = not line
        return line.strip() or default
