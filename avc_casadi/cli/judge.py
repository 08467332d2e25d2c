"""Verbs that judge a coupling: certify, simulate, trial, zwidth."""

from __future__ import annotations

import argparse

import avc_casadi as avc
from avc_casadi.cli import arguments as cli
from avc_casadi.cli.console import Console
from avc_casadi.present import rows
from avc_casadi.present.row import Answer


@cli.verb(
    cli.argument("coupling", metavar="COUPLING", text="coupling file, of `avc recommend P --out`"),
    cli.argument("--hands", type=cli.positive_int, default=10_000, metavar="N", text="hands (default 10000)"),
    cli.argument("--seed", type=int, default=0, metavar="S", text="the same seed, the same hands (default 0)"),
    cli.flag("--without-friction", "leave the declared dry friction out"),
    *cli.WORKERS,
)
def run_trial(args: argparse.Namespace, console: Console) -> Answer:
    """Try a coupling with any number of simulated hands: how many settle, with the exact interval.

    Hands are drawn uniformly from [hands]; each presses, taps and holds, with all that is declared of the device.
    """
    from avc_casadi._util.parallel import cluster, processors
    from avc_casadi.simulation.population.trial import count_at_rest

    coupling = cli.read_wall(args.coupling)
    with cluster(args.scheduler) as executor, console.step(f"{args.hands} hands"):
        trial = count_at_rest(
            coupling,
            args.hands,
            args.seed,
            friction=not args.without_friction,
            workers=args.workers or processors(),
            executor=executor,
            progress=console,
        )
    return rows.judge.trial(trial, coupling.problem.units, args.coupling)


@cli.verb(cli.PROBLEM, cli.plot("the region"))
def run_zwidth(args: argparse.Namespace, console: Console) -> Answer:
    """Show which walls the device can render without coupling; of a [simulation] which K and B are stable."""
    from avc_casadi.cli import ends

    problem = avc.load_problem(args.problem)
    return ends.region(problem.end, problem, args, console)
