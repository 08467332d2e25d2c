"""Verbs that judge a coupling: certify, simulate, trial, zwidth."""

from __future__ import annotations

import argparse
from shlex import quote

import avc_casadi as avc
from avc_casadi.cli import arguments as cli
from avc_casadi.cli.console import Console
from avc_casadi.present import rows
from avc_casadi.present.row import Answer

_COUPLING_HANDS = 10_000
"""Hands that try a coupling where no other number is given."""


@cli.verb(
    cli.argument("problem", metavar="P", text="problem to judge against; or a coupling file, which has its own"),
    cli.argument("gains", metavar="GAINS", nargs="?", text="coupling or gain file, .json or .csv"),
    cli.flag("--prove", "ask for a proof of rest (L7), seconds a row: proved, refuted (with the hand) or open (why)"),
    cli.argument("--proof-out", metavar="DIR", text="--prove, and write proofs and witnesses"),
    cli.argument("--k", "--kp", type=float, metavar="K", text="own law: spring, N/m; N.m/rad of a device that turns"),
    cli.argument("--b", "--kd", type=float, metavar="B", text="own law: damper in the wall, N.s/m or N.m.s/rad"),
    cli.argument("--b-p", type=float, metavar="B", text="own law: damper that acts outside the wall too; may be < 0"),
    cli.argument("--cutoff-hz", type=float, metavar="F", text="own law: first-order filter of the velocity (none)"),
    cli.argument("--ki", type=float, metavar="KI", text="own law: integral, N/(m.s) or N.m/(rad.s)"),
    cli.argument("--virtual-mass", type=float, metavar="M", text="own law: virtual mass, kg or kg.m2; may be < 0"),
    cli.argument(
        "--velocity",
        metavar="HOW",
        text='own law: "difference", "window 5" (samples), "low-pass 80 Hz", "kalman 40 Hz", "ticks 20 ms"',
    ),
    cli.argument("--notch", metavar="F", text='own law: notch of the command, "150 Hz"'),
    cli.VERBOSE,
)
def run_certify(args: argparse.Namespace, console: Console) -> Answer:
    """Say whether a coupling may be deployed, and which stability claims it meets.

    It may where it is stable with every hand of [hands] and released; exit code 1 if not. Or of your own law in place
    of GAINS, force = -(k x + (b + b_p) v): avc certify P --k 230 --b 1.2; what is left out is 0, the wall of P is not
    used, P may be a device file, and to another end they are K, B and the damper of the device's own loop. A table
    [law] of P is judged alike; what is typed replaces its values. --prove proves rest (L7) over the device's ranges,
    without friction.
    """
    from avc_casadi.claims.own_law import law_problem
    from avc_casadi.cli import ends
    from avc_casadi.cli.law import law_pieces, states_law, with_pieces

    law = {key: getattr(args, key) for key in ("k", "b", "b_p", "cutoff_hz") if getattr(args, key) is not None}
    pieces = law_pieces(args)
    if law or pieces or states_law(args.problem, args.gains):
        cli.refuse(args, "prove", "proof_out", "gains", why="goes with a file of gains, not with a law")
        problem = law_problem(args.problem)
        if pieces:
            problem = with_pieces(problem, pieces, law)
        return ends.law_certified(problem.end, problem, law, args, console)
    problem, coupling, notes = cli.subject(args.problem, args.gains)
    if coupling is None:
        allowed = f"a file of gains (avc recommend {quote(args.problem)} --out c.json), or a law: --k K --b B"
        raise avc.InputError.of(f"is missing; allowed: {allowed}", key="GAINS")
    return ends.certified(coupling.end, coupling, ends.Subject(problem, coupling, notes), args, console)


@cli.verb(
    cli.argument("problem", metavar="P", text="problem file or name of the catalogue; or a coupling file"),
    cli.argument("--gains", metavar="GAINS", text="coupling or gain file in place of the scene's own coupling"),
    cli.argument("--against", metavar="C1,C2", text="draw others too: up to 3 of none and the methods"),
    cli.argument("--seed", type=int, default=0, metavar="S", text="other draws of all noises (default 0)"),
    cli.output("--trace", "write all traces (.npz) and a manifest beside them (.json)", ".npz"),
    cli.plot("the run"),
    cli.VERBOSE,
)
def run_simulate(args: argparse.Namespace, console: Console) -> Answer:
    """Simulate the scene of a problem: whether the device settles, and what is rendered.

    With its listed effects, or a hand, a wall and all that the device declares; -v tells what each adds. A table [law]
    runs in place of wall and coupling. Exit code 1 if it does not settle.
    """
    from avc_casadi.cli import ends

    subject = ends.Subject(*cli.subject(args.problem, args.gains))
    return ends.simulated(subject.problem.end, subject, args, console)


@cli.verb(
    cli.argument("coupling", metavar="COUPLING", text="coupling file (`avc recommend P --out`), or problem with [law]"),
    cli.argument("--hands", type=cli.positive_int, metavar="N", text="hands (default 10000; 200 for a law)"),
    cli.argument("--seed", type=int, default=0, metavar="S", text="the same seed, the same hands (default 0)"),
    cli.flag("--without-friction", "leave the declared dry friction out"),
    *cli.WORKERS,
)
def run_trial(args: argparse.Namespace, console: Console) -> Answer:
    """Try a coupling, or your own law, with simulated hands: how many settle, with the exact interval.

    Hands are drawn uniformly from [hands]; each presses, taps and holds, with all that is declared of the device. A
    table [law] of a problem runs as it is, with its nonlinear pieces: hands press, strike and tap, an integral is
    pressed for long, and the device is released. Friction compensation is tried at less friction too. Exit code 1 if a
    law does not come to rest.
    """
    from avc_casadi._util.parallel import cluster, processors
    from avc_casadi.cli.law import states_law
    from avc_casadi.simulation.population.law_trial import LAW_HANDS, try_law
    from avc_casadi.simulation.population.trial import count_at_rest

    if states_law(args.coupling, None):
        problem, hands = avc.load_problem(args.coupling), args.hands or LAW_HANDS
        with console.step(f"{hands} hands"):
            tried = try_law(problem, hands, args.seed, friction=not args.without_friction, progress=console)
        return rows.tried.law_trial(tried, args.coupling)
    coupling = cli.read_wall(args.coupling)
    hands = args.hands or _COUPLING_HANDS
    with cluster(args.scheduler) as executor, console.step(f"{hands} hands"):
        trial = count_at_rest(
            coupling,
            hands,
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
