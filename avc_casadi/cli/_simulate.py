"""Simulate the scene of a problem and say what the hand would feel."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

import avc_casadi as avc
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._files import output_file
from avc_casadi.cli._foreign import gains_for
from avc_casadi.cli._subject import is_coupling, read_subject
from avc_casadi.cli._text import number, table

if TYPE_CHECKING:
    from avc_casadi.coupling import Gains, GainSchedule

# A figure holds four runs that can be told apart.
_MOST_OTHERS = 3
_COMPARED = (
    "coupling",
    "damping_ns_per_m",
    "stiffness_n_per_m",
    "contact_damping_ns_per_m",
    "outcome",
    "stable",
    "buzzing",
    "position_peak_to_peak_m",
    "apparent_stiffness_n_per_m",
    "rate_hardness_n_per_m",
    "energy_generated_j",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.description = (
        "Simulate the scene of a problem file and say what the hand would feel: with its listed effects only, or with\n"
        "none listed with a hand, a wall and all that the device declares.\n"
        "Exit code 1 if the device does not come to rest."
    )
    parser.add_argument("problem", metavar="P", help="problem file or name of the catalogue; or a coupling file")
    parser.add_argument("--gains", metavar="GAINS", help="coupling or gain file in place of the scene's own coupling")
    parser.add_argument(
        "--against", metavar="C1,C2", help="simulate and draw other couplings too: up to 3 of none and the methods"
    )
    parser.add_argument("--explain", action="store_true", help="show what each effect adds, and which are absent")
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="other draws of all noises (default 0)")
    parser.add_argument("--trace", metavar="FILE", help="write all traces (.npz) and a manifest beside them (.json)")
    parser.add_argument("--plot", metavar="FILE", help="draw the run: .png, .svg or .pdf")


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Simulate, measure the cost of each effect, write and show; 1 if the device does not come to rest."""
    from avc_casadi.coupling import NO_COUPLING, without_start
    from avc_casadi.problem import left_out
    from avc_casadi.scene import explain

    plot = None if args.plot is None else output_file(args.plot, "--plot", (".png", ".svg", ".pdf"))
    trace = None if args.trace is None else output_file(args.trace, "--trace", (".npz",))
    coupling = read_subject(args.problem, None) if is_coupling(args.problem) else None
    if coupling is not None and args.gains is not None:
        raise avc.InputError.of("does not go with a coupling file; give the problem instead", key="--gains")
    problem = avc.load_problem(args.problem) if coupling is None else coupling.problem
    others = _others(args.against)
    gains, notes = (coupling.schedule, []) if coupling is not None else gains_of(args.gains, problem, console)
    why = "" if gains is None else without_start(gains)
    if why:
        file, key = (problem.name, "scene.coupling") if args.gains is None else (args.gains, "--gains")
        no = avc.InputError.of(why, file=file, key=key)
        return Answer(avc.fault_document(no), "", code=1, complaint=f"avc: {no}")
    with console.step(f"{problem.scene.duration_s:g} s of the scene"):
        found = avc.simulate(problem, coupling or gains, seed=args.seed)
        beside = [avc.simulate(problem, _gains_by(name, problem), seed=args.seed) for name in others]
    with console.step("cost of each effect"):
        parts = explain(problem, coupling or (NO_COUPLING if gains is None else gains))
    if trace is not None:
        trace = found.save(trace)
    if plot is not None:
        from avc_casadi.figures import draw_scene, save_figure

        with console.step("figure"):
            save_figure(draw_scene([found, *beside]), plot)
    document = found.document(trace) | parts.document()
    document["gains_from_hz"] = None if gains is None else float(gains.frequency_hz.min())
    document["notes"] = notes
    document["left_out"] = list(left_out(problem))
    if beside:
        document["against"] = [{name: run.document()[name] for name in _COMPARED} for run in beside]
    complaint = "" if found.stable else f"avc: {problem.name}: the device does not come to rest ({found.claim})"
    return Answer(document, _text(document, args), code=1 if complaint else 0, complaint=complaint)


def _others(text: str | None) -> list[str]:
    """Split the couplings of --against and check them."""
    from avc_casadi.design import METHODS

    names = [] if text is None else [name.strip() for name in text.split(",")]
    wrong = [name for name in names if name not in ("none", *METHODS)]
    if wrong or len(names) > _MOST_OTHERS:
        what = f"{', '.join(wrong)}: no coupling" if wrong else f"{len(names)} couplings"
        allowed = f"none, {', '.join(METHODS)}; at most {_MOST_OTHERS}, separated by commas"
        raise avc.InputError.of(f"{what}; allowed: {allowed}", key="--against")
    return names


def _gains_by(name: str, problem: avc.Problem) -> Gains | GainSchedule:
    from avc_casadi.coupling import NO_COUPLING
    from avc_casadi.design import method_named

    return NO_COUPLING if name == "none" else avc.solve(problem, method_named(name))


def gains_of(file: str | None, problem: avc.Problem, console: Console) -> tuple[GainSchedule | None, list[str]]:
    """Return the gain table of a file, or that of the scene's coupling, and notes; None for a scene without any."""
    if file is not None:
        return gains_for(problem, file)
    method = problem.scene.coupling
    if method == "none":
        return None, []
    with console.step(f"coupling: {method}"):
        return avc.solve(problem, method), []


def _text(document: dict[str, Any], args: argparse.Namespace) -> str:
    outcomes = {
        "asymptotic": "comes to rest, and does not need dry friction for it",
        "held-by-friction": "held by dry friction only: without it the device does not come to rest",
        "unstable": "does not come to rest",
    }
    gains = [document[key] for key in ("damping_ns_per_m", "stiffness_n_per_m", "contact_damping_ns_per_m")]
    coupling = document["coupling"]
    if coupling != "none":
        b, k, b_p = (number(gain) if gain is not None else "rigid" for gain in gains)
        coupling += f" (b = {b} N.s/m, k = {k} N/m" + (f", b_p = {b_p} N.s/m)" if gains[2] else ")")
        if document["gains_from_hz"] is not None:
            adapts = any(effect["kind"] == "adaptation" for effect in document["effects"])
            coupling += ", at first" if adapts else ""
            coupling += f", the table's row of {number(document['gains_from_hz'])} Hz, its lowest"
    lines = [
        f"{document['problem']}: {document['steps']} samples, coupling {coupling}",
        *(f"  note: {note}" for note in document["notes"]),
        *(
            [f"  declared and left out, as the scene lists other effects: {', '.join(document['left_out'])}"]
            if document["left_out"]
            else []
        ),
        f"  {outcomes[document['outcome']]}{'; buzzes' if document['buzzing'] else ''}",
        f"  largest velocity at the end   {number(_times(document['peak_velocity_m_per_s'], 1e3))} mm/s",
        f"  position at the end           {number(_times(document['position_peak_to_peak_m'], 1e3))} mm peak to peak",
        f"  force at the end              {number(document['mean_force_n'])} N",
        f"  force between 20 and 500 Hz   {number(document['force_ripple_n'])} N rms",
        f"  apparent stiffness            {number(document['apparent_stiffness_n_per_m'])} N/m",
        f"  rate-hardness at contact      {number(document['rate_hardness_n_per_m'])} N/m",
        f"  energy given out beyond that taken in   {number(_times(document['energy_generated_j'], 1e3))} mJ",
        f"  {document['criterion']}",
    ]
    if "against" in document:
        lines += ["", *_against(document)]
    if args.explain:
        lines += ["", *_explanation(document)]
    lines += [f"written: {path}" for path in (document["trace"],) if path is not None]
    lines += [f"drawn: {args.plot}"] if args.plot is not None else []
    return "\n".join(lines)


def _against(document: dict[str, Any]) -> list[str]:
    rows = [
        [
            run["coupling"],
            run["outcome"] + (", buzzes" if run["buzzing"] else ""),
            number(_times(run["position_peak_to_peak_m"], 1e3)),
            number(run["apparent_stiffness_n_per_m"]),
            number(run["rate_hardness_n_per_m"]),
            number(_times(run["energy_generated_j"], 1e3)),
        ]
        for run in (document, *document["against"])
    ]
    head = (
        "coupling",
        "outcome",
        "position\npeak to peak\nmm",
        "apparent\nstiffness\nN/m",
        "rate-\nhardness\nN/m",
        "energy\ngiven out\nmJ",
    )
    return [table(head, rows, left=(0, 1))]


def _times(value: float | None, factor: float) -> float | None:
    return None if value is None else factor * value


def _explanation(document: dict[str, Any]) -> list[str]:
    rows = [
        [
            effect["kind"],
            effect["station"],
            str(effect["states"]),
            "the only mass" if effect["instructions"] is None else str(effect["instructions"]),
            "-" if effect["ns_per_step"] is None else f"{effect['ns_per_step']:.0f}",
        ]
        for effect in document["effects"]
    ]
    rows.append(
        ["whole sample", "", str(document["states"]), str(document["instructions"]), f"{document['ns_per_step']:.0f}"]
    )
    head = ("effect", "station", "adds\nstates", "adds\ninstructions", "adds\nns a sample")
    return [
        table(head, rows, left=(0, 1)),
        f"states: {', '.join(document['state_names'])}",
        f"absent, at no cost: {', '.join(document['absent'])}",
    ]
