"""Try a coupling with any number of simulated hands: how many settle, with the exact interval.

Hands are drawn uniformly from [hands] of the coupling's problem; each presses, taps and holds, with all that the
problem declares of the device. No trace is kept: a million hands take some minutes on two cores.
"""

from __future__ import annotations

import argparse

from avc_casadi.cli._arguments import add_workers, positive_int
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
    add_workers(parser)


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Try all hands and count."""
    from avc_casadi._util.parallel import cluster, processors
    from avc_casadi.present.pages.trial import trial_page
    from avc_casadi.simulation.population.settled import settled_hands

    coupling = read_subject("trial", args.coupling)
    workers = processors() if args.workers is None else args.workers
    with cluster(args.scheduler) as executor, console.step(f"{args.hands} hands"):
        found = settled_hands(
            coupling,
            args.hands,
            args.seed,
            friction=not args.without_friction,
            workers=workers,
            executor=executor,
            progress=console,
        )
    document = found.document()
    return Answer(document, trial_page(document, console.page, args.coupling))
