"""Let any number of simulated hands try a coupling: how many come to rest, with the exact interval.

Hands are drawn uniformly from [hands] of the coupling's problem; each presses, taps and holds, with all that the
problem declares of the device. No trace is kept: a million hands take some minutes on two cores.
"""

from __future__ import annotations

import argparse
from typing import Any

from avc_casadi.cli._arguments import positive_int
from avc_casadi.cli._chunks import add_chunks, done
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._subject import read_subject


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("coupling", metavar="COUPLING", help="coupling file, of `avc recommend P --out`")
    parser.add_argument("--hands", type=positive_int, default=10_000, metavar="N", help="hands (default 10000)")
    parser.add_argument(
        "--seed", type=int, default=0, metavar="S", help="seed of the hands; the same seed, the same hands (default 0)"
    )
    parser.add_argument("--without-friction", action="store_true", help="leave the declared dry friction out")
    add_chunks(parser)


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Try everybody and count."""
    from avc_casadi.simulation.population.settled import hands_at_rest

    coupling = read_subject("trial", args.coupling)
    study = hands_at_rest(coupling, args.hands, args.seed, friction=not args.without_friction)
    found = done(study, args, console)
    if isinstance(found, Answer):
        return found
    document = found.document()
    return Answer(document, trial_text(document))


def trial_text(document: dict[str, Any]) -> str:
    """Return the counts for people."""
    low, high = (f"{100 * end:.6g}" for end in document["at_rest_interval"])
    motions = ", ".join(f"{name} {count}" for name, count in document["by_motion"].items())
    lines = [
        (
            f"{document['at_rest']} of {document['hands']} hands at rest in every motion "
            f"({100 * document['confidence']:g} % interval {low} to {high} %): {motions}"
        ),
        f"{document['coupling']}; seed {document['seed']}; simulated: {', '.join(document['effects'])}",
    ]
    if document["moving"]:
        some = ", ".join(map(str, document["moving"]))
        lines.append(f"not at rest, by their number in the draw: {some}{' and others' if _more(document) else ''}")
    return "\n".join(lines)


def _more(document: dict[str, Any]) -> bool:
    return int(document["hands"] - document["at_rest"]) > len(document["moving"])
