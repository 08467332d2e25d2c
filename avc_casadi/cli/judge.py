"""Verbs that judge a coupling: certify, simulate, trial, zwidth."""

from __future__ import annotations

import argparse
from shlex import quote

import avc_casadi as avc
from avc_casadi.cli import arguments as cli
from avc_casadi.cli.console import Console
from avc_casadi.files.kinds import FileKind
from avc_casadi.present import rows
from avc_casadi.present.row import Answer

_COUPLING_HANDS = 10_000
"""Hands that try a coupling where no other number is given."""
_CUTOFF = "set the cutoff of a first-order velocity filter in Hz (default: no filter)"
_COMPENSATION = 'add a force along the motion: "0.2N", or "0.2N, 0.02m/s" (default: none)'
_OVER = "show the stable spring k of [law] over this number, such as velocity.cutoff_hz"
_PROVE = "try to prove that the device comes to rest without friction (claim L7)"
_VELOCITY = 'estimate v by "window 5", "low-pass 80 Hz", "kalman 40 Hz", "ticks 20 ms"'


@cli.verb(
    cli.argument(
        "problem",
        metavar="P",
        text="problem (file or name), coupling file, or device file for your own gains",
    ),
    cli.argument("gains", metavar="GAINS", nargs="?", text="coupling file (.json) or table of gains (.csv) for P"),
    cli.flag("--prove", _PROVE),
    cli.argument("--proof-out", metavar="DIR", text="do --prove, and write proofs and counterexamples to this folder"),
    cli.argument("--k", "--kp", metavar="K", text="set the spring k in N/m or N.m/rad (default: 0)"),
    cli.argument("--b", "--kd", metavar="B", text="set the damper b in N.s/m or N.m.s/rad (default: 0)"),
    cli.argument("--b-p", metavar="B", text="set the damper b_p, acting outside the wall too (default: 0)"),
    cli.argument("--cutoff-hz", metavar="F", text=_CUTOFF),
    cli.argument("--ki", metavar="KI", text="set the integral gain in N/(m.s) or N.m/(rad.s) (default: 0)"),
    cli.argument("--virtual-mass", metavar="M", text="set the virtual mass in kg or kg.m2 (default: 0)"),
    cli.argument("--velocity", metavar="HOW", text=_VELOCITY),
    cli.argument("--notch", metavar="F", text='set a notch filter of the command, such as "150 Hz" (default: none)'),
    cli.argument("--friction-compensation", metavar="F", text=_COMPENSATION),
    cli.flag("--lean-on-friction", "accept your gains if dry friction brings a fast strike (1 m/s) to rest"),
    cli.VERBOSE,
)
def run_certify(args: argparse.Namespace, console: Console) -> Answer:
    """Certify a coupling or your own gains: is it deployable, and which claims hold?

    Deployable means linearly stable with every hand of [hands] and with the device released, with a
    sufficient disk margin (engines and followers: gain margin; joints: none). Exit code 1 if not.
    Your own gains need no GAINS file: `avc certify P --k "3 kN/m" --b 12` judges the force
    -(k x + (b + b_p) v). Options replace the wall of P, or single values of its table [law].
    With a [simulation] or [follower], --k, --b and --b-p set K, B and the damper in the device's loop.
    For an admittance device, --virtual-mass, --b, --k and --cutoff-hz replace values of its law.
    """
    from avc_casadi.claims.own_law import law_problem
    from avc_casadi.cli import admittance, ends
    from avc_casadi.cli.law import faults_of_file, law_pieces, read_numbers, states_law, with_pieces
    from avc_casadi.files.admittance_file import is_admittance
    from avc_casadi.files.border import in_keys_of

    if is_admittance(args.problem):
        return admittance.certified(args, console)

    of_plain_law = ("k", "b", "b_p", "cutoff_hz")
    of_pieces = ("ki", "virtual_mass", "velocity", "notch", "friction_compensation")
    typed = any(getattr(args, key) is not None for key in (*of_plain_law, *of_pieces))
    if cli.is_coupling(args.problem):
        why = f"does not apply to {args.problem}, which has gains; leave it out, or give a problem for your own gains"
        cli.refuse(args, *of_plain_law, *of_pieces, why=why)
    if typed or states_law(args.problem, args.gains):
        cli.refuse(args, "prove", "proof_out", why="does not apply to your own gains; leave it out")
        cli.refuse_file(args, "gains", why="does not apply to your own gains; leave it out")
        problem = law_problem(args.problem)
        read_numbers(args, problem.units, problem.device.handle_radius_m)
        law = {key: getattr(args, key) for key in of_plain_law if getattr(args, key) is not None}
        pieces = law_pieces(args, problem)
        with in_keys_of(problem.units), faults_of_file(problem.name, args.problem):
            if pieces:
                problem = with_pieces(problem, pieces, law)
            return ends.law_certified(problem.end, problem, law, args, console)
    cli.refuse(args, "lean_on_friction", why="applies to your own gains, or to avc recommend; leave it out")
    problem, coupling, notes = cli.subject(args.problem, args.gains)
    if coupling is None:
        allowed = f"a file of gains (avc recommend {quote(args.problem)} --out c.json), or your gains: --k K --b B"
        raise avc.InputError.of(f"is missing; give {allowed}", key="GAINS")
    return ends.certified(coupling.end, coupling, ends.GivenCoupling(problem, coupling, notes), args, console)


@cli.verb(
    cli.argument("problem", metavar="P", text="problem file or name; or a coupling file"),
    cli.argument("--gains", metavar="GAINS", text="use this coupling or table of gains instead of the scene's"),
    cli.argument("--against", metavar="C1,C2", text="compare with up to 3: none (no coupling), or names of methods"),
    cli.numeric("--seed", "set the seed of random noise (default: 0)", default=0, metavar="S"),
    cli.output(
        "--trace", "write all signals to this .npz file, with a .json description", {".npz": (FileKind.ARRAYS,)}
    ),
    cli.plot("the motion"),
    cli.VERBOSE,
)
def run_simulate(args: argparse.Namespace, console: Console) -> Answer:
    """Simulate the scene of a problem: does the device settle, and how stiff is the wall?

    The scene has the effects that [[scene.effects]] lists.
    Without a list of effects the scene has a hand, the wall and everything that [device] declares.
    Your own controller, a table [law], runs in place of coupling and wall.
    With -v the answer lists the cost of each effect. Exit code 1 if the device does not settle.
    """
    from avc_casadi.cli import ends

    subject = ends.GivenCoupling(*cli.subject(args.problem, args.gains))
    return ends.simulated(subject.problem.end, subject, args, console)


@cli.verb(
    cli.argument("coupling", metavar="COUPLING", text="coupling file (`avc recommend P --out`), or problem with [law]"),
    cli.numeric("--hands", "set the number of hands (default: 10000; law: 200)", metavar="N"),
    cli.numeric("--seed", "set the seed of the random hands (default: 0)", default=0, metavar="S"),
    cli.flag("--without-friction", "ignore the declared dry friction"),
    *cli.WORKERS,
)
def run_trial(args: argparse.Namespace, console: Console) -> Answer:
    """Try a coupling or your own law with many simulated hands, and count how many settle.

    Hands are drawn uniformly from [hands]. Each hand presses, taps and holds the declared device.
    The count of settled hands has an exact confidence interval.
    Your own controller, a table [law], runs with its nonlinear pieces. To try a law, hands press,
    strike and tap, and the device is released. A law with an integral is also tried with a long
    press, a law with friction compensation also with less friction.
    Exit code 1 if the device does not come to rest with a law.
    Hands guide, hold and release an admittance device, and push it against its contacts.
    """
    from avc_casadi._util.parallel import processors
    from avc_casadi.cli import admittance
    from avc_casadi.cli.law import states_law
    from avc_casadi.files.admittance_file import is_admittance
    from avc_casadi.simulation.population.law_trial import LAW_HANDS, try_law

    if is_admittance(args.coupling):
        return admittance.tried(args, console)
    from avc_casadi.simulation.population.trial import count_at_rest

    if states_law(args.coupling, None):
        one_process = "applies to couplings and admittance devices; the trial of a law is one process; leave it out"
        cli.refuse(args, "workers", "scheduler", why=one_process)
        problem, hands = avc.load_problem(args.coupling), args.hands or LAW_HANDS
        with console.step(f"{hands} hands"):
            tried = try_law(problem, hands, args.seed, friction=not args.without_friction, progress=console)
        return rows.tried.law_trial(tried, args.coupling)
    coupling = cli.read_wall(args.coupling)
    hands = args.hands or _COUPLING_HANDS
    with cli.executor_of(args) as executor, console.step(f"{hands} hands"):
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


@cli.verb(cli.PROBLEM, cli.argument("--over", metavar="NUMBER", text=_OVER), cli.plot("the region"))
def run_zwidth(args: argparse.Namespace, console: Console) -> Answer:
    """Show which walls the device can render without a coupling (the Z-width).

    For a [simulation]: with which spring K and damper B of the coupling the loop is stable.
    For an admittance device (drive = "velocity"): which virtual masses are stable at each damping.
    With --over: which spring k of your own [law] is stable at each value of another number.
    """
    from avc_casadi.cli import admittance, ends
    from avc_casadi.files.admittance_file import is_admittance

    if is_admittance(args.problem):
        cli.refuse(
            args, "over", why="applies to devices with a commanded force, but P follows a velocity; leave it out"
        )
        return admittance.region(args, console)
    problem = avc.load_problem(args.problem)
    if args.over is not None:
        return ends.region_of_law(problem, args, console)
    return ends.region(problem.end, problem, args, console)
