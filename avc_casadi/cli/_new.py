"""Write a problem file from what you know of a device, its wall and what holds it."""

from __future__ import annotations

import argparse
from dataclasses import asdict, replace
from typing import TYPE_CHECKING

from avc_casadi import Fault, InputError
from avc_casadi.cli._arguments import add_worded, check_worded
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._files import output_file, write_text
from avc_casadi.files.new_options import DAMPING, EVERY, HANDS, HOLDS, MASS, RADIUS, Option

if TYPE_CHECKING:
    from avc_casadi.files.new_problem import NewProblem


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.description = (
        f"{__doc__}\nA value is typed with its unit, in any that fits ('55 um', '1 kHz', '4096 counts'; without one\n"
        "it is in SI units). Of a device that turns: --radius, --inertia, --max-torque, and units such as N.m/rad."
    )
    parser.add_argument("file", metavar="FILE", help="problem file to write, .toml")
    parser.add_argument("--like", metavar="D", help="device to begin from: a name of `avc list`, or a device file")
    parser.add_argument("--held", choices=tuple(HOLDS), default="grip", help="what holds it; default grip")
    for one in EVERY:
        text = f"{one.text}: {', '.join(dict.fromkeys(one.examples))}"
        if one.turning:
            add_worded(parser, one.option, one.turning, "V", text, str)
        else:
            parser.add_argument(one.option, metavar="V", help=text)
    parser.add_argument("--model", metavar="M", help="device of several axes, MJCF or URDF: mass from it (MuJoCo)")
    parser.add_argument("--tip", metavar="NAME", help="site, body or geom of the model that the hand holds")
    parser.add_argument("--force", action="store_true", help="write over a file that is there")


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Take the options; write, read back and show.

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
    typed = {one.key: text for one in EVERY if (text := getattr(args, _dest(one))) is not None}
    turned = RADIUS.key in typed or any(given != names[0] for given, names in getattr(args, "worded", {}).values())
    new = NewProblem(path, args.like or "", "rotary" if turned else "linear", args.held, typed)
    check_worded(args, new.units)
    speak(new.units)
    alien = _alien(new)
    if args.model is not None or args.tip is not None:
        new = _at_tip(new, args.model, args.tip)
    if faults := [*alien, *new.faults()]:
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
        "model": None if new.tip is None else {"file": args.model, "tip": args.tip, **asdict(new.tip)},
    }
    return Answer(document, new_page(document, problem, console.page, args.file))


def _at_tip(new: NewProblem, model: str | None, tip: str | None) -> NewProblem:
    """Return a draft with the mass and the damping at the tip of a model.

    Raises:
        InputError: half of the options, one that the model answers, or a fault of the model.
    """
    from pathlib import Path

    from avc_casadi.files.model_file import tip_mass

    if model is None or tip is None:
        raise InputError.of("goes with --model and --tip, both", key="--model" if model is None else "--tip")
    if not new.units.linear:
        raise InputError.of("moves its tip in lines, and the device turns; leave one out", key="--model")
    if MASS.key in new.typed:
        raise InputError.of("is that of --model; leave it out", key=MASS.option)
    found = tip_mass(Path(model), tip)
    typed = {MASS.key: f"{found.mass_kg:.4g} kg", **new.typed}
    if found.damping_ns_per_m > 0:
        typed.setdefault(DAMPING.key, f"{found.damping_ns_per_m:.4g} N.s/m")
    return replace(new, typed=typed, tip=found)


def _dest(option: Option) -> str:
    return option.option[2:].replace("-", "_")


def _option(key: str, new: NewProblem) -> str:
    """Return the option of a key, or the key itself."""
    found = next((one for one in EVERY if one.key == key), None)
    return key if found is None else found.names[not new.units.linear]


def _alien(new: NewProblem) -> list[Fault]:
    """Return a fault of each option for another kind of device or other hands."""
    known = {one.key for one in new.options()}
    of_hands = "goes with --held foot or --held other; leave it out"
    whys = {RADIUS.key: "is that of the device of --like; leave it out", **{one.key: of_hands for one in HANDS}}
    return [Fault("", None, key, whys[key]) for key in new.typed if key not in known]
