"""Summary of a simulated scene, the contribution of each effect, and the effects it needs."""

from __future__ import annotations

import math
from shlex import quote
from typing import TYPE_CHECKING, Any

from avc_casadi._util.text import number, percent, quantity, text_table
from avc_casadi._util.units import FORCE, MASS
from avc_casadi.model.effects import SaturationEffect
from avc_casadi.model.registries import EFFECTS
from avc_casadi.present.pages.subject import RIGID, headline, quantities
from avc_casadi.present.terminal import Mark, Page, Row
from avc_casadi.simulation.judge import IMPACT_S, RISE_SAMPLES

if TYPE_CHECKING:
    from avc_casadi._util.units import Units
    from avc_casadi.model.problem import Problem

# A force this near to its limit counts as limited.
_AT_LIMIT = 0.97
# In m, N and J: below any device's resolution, left by rounding.
_ROUND_OFF = 1e-12
_MARKS = {"asymptotic": Mark.PASS, "held-by-friction": Mark.CAUTION, "unstable": Mark.FAIL}
_WORDS = {"asymptotic": "settles", "held-by-friction": "settles by dry friction alone", "unstable": "does not settle"}


def scene_page(document: dict[str, Any], problem: Problem, page: Page, shown: str, drawn: str | None) -> str:
    """Return the `simulate` document as a headline and rows.

    Args:
        document: of `avc simulate --json`, with ``against`` where other couplings were simulated.
        problem: that was simulated.
        page: where it is printed.
        shown: the problem or coupling as the user names it.
        drawn: file of the picture, if one was drawn.
    """
    told = quantities(problem.units)
    end, swing = _kept(document["mean_force_n"]), _kept(document["position_peak_to_peak_m"])
    rows = [
        Row("Outcome", _outcome(document), _mark(document)),
        Row("Coupling", _coupling(document, problem)),
        _rendered(document, problem),
        Row("Rate-hardness", _rate_hardness(document, problem)),
        Row("At the end", f"{told(end, 'N')}, {told(swing, 'm')} peak to peak"),
        Row(
            f"{problem.units.key('force').capitalize()} ripple",
            f"{told(_kept(document['force_ripple_n']), 'N')} rms between 20 and 500 Hz",
        ),
        Row("Energy", f"{quantity(_kept(document['energy_generated_j']), 'J')} given out beyond that taken in"),
        *_without_guard(document, problem),
        *(_other(run, problem) for run in document.get("against", ())),
        *(Row("Note", note, Mark.CAUTION) for note in document["notes"]),
    ]
    if document["left_out"]:
        left = f"declared, but not listed in the scene: {', '.join(map(problem.units.key, document['left_out']))}"
        rows.append(Row("Left out", left, Mark.CAUTION))
    written = [f"{document['trace']} and its manifest"] if document["trace"] is not None else []
    written += [] if drawn is None else [drawn]
    if written:
        rows.append(Row("Written", ", ".join(written)))
    return page.rendered(
        headline(problem, shown), rows, [f"avc simulate {quote(shown)} --explain", f"avc simulate {quote(shown)} -v"]
    )


def outcome(document: dict[str, Any]) -> str:
    """Describe the outcome for the one simulated hand.

    Args:
        document: of `avc simulate --json`.
    """
    held = any(EFFECTS[effect["kind"]].role == "hand" for effect in document["effects"])
    return f"{_WORDS[document['outcome']]}{' with this hand' if held else ''}"


def _outcome(document: dict[str, Any]) -> str:
    told = outcome(document)
    told += ", without need of dry friction" if document["outcome"] == "asymptotic" else ""
    told += "; buzzes" if document["buzzing"] else ""
    return f"{told} ({document['steps']} samples)"


def _mark(document: dict[str, Any]) -> Mark:
    mark = _MARKS[document["outcome"]]
    return Mark.CAUTION if mark is Mark.PASS and document["buzzing"] else mark


def _coupling(document: dict[str, Any], problem: Problem) -> str:
    keys = ("damping_ns_per_m", "stiffness_n_per_m", "contact_damping_ns_per_m")
    (b, k, b_p), told = (document[key] for key in keys), quantities(problem.units)
    if document["coupling"] == "none":
        return "none: the wall itself"
    parts = [f"contact damper b_p {told(b_p, 'N.s/m')}"] if b_p else []
    if k is None or k >= RIGID * problem.environment.stiffness_n_per_m:
        parts.append("wall rendered directly")
    else:
        parts.append(f"spring k {told(k, 'N/m')}" + (f", damper b {told(b, 'N.s/m')}" if b else ""))
    read = ""
    if document["gains_from_hz"] is not None:
        adapts = any(effect["kind"] == "adaptation" for effect in document["effects"])
        read = f"; {'at first ' if adapts else ''}the table at {quantity(document['gains_from_hz'], 'Hz')}"
    return f"{document['coupling']}: {', '.join(parts)}{read}"


def _rendered(document: dict[str, Any], problem: Problem) -> Row:
    sensed, wall = document["apparent_stiffness_n_per_m"], problem.environment.stiffness_n_per_m
    if sensed is None:
        return Row("Rendered", "no stiffness: the scene does not end in steady contact")
    share = f" ({percent(sensed / wall)} of the wall)" if wall else ""
    detents = any(effect["kind"] == "detent" for effect in document["effects"])
    beside = ", with the slope of the detents" if detents else ""
    told, limit_n = quantities(problem.units), _force_limit_n(document, problem)
    text = f"{told(sensed, 'N/m')} at the sensor{share}{beside}"
    if document["mean_force_n"] < _AT_LIMIT * limit_n:
        return Row("Rendered", text)
    force = problem.units.key("force")
    return Row("Rendered", f"{text}; the {force} stands at its limit of {told(limit_n, 'N')}", Mark.CAUTION)


def _force_limit_n(document: dict[str, Any], problem: Problem) -> float:
    """Return the limit of the force in the scene; infinite where nothing limits it."""
    if all(effect["kind"] != "saturation" for effect in document["effects"]):
        return math.inf
    own = [effect.force_n for effect in problem.scene.effects if isinstance(effect, SaturationEffect)]
    found = own[0] if own and own[0] is not None else problem.device.max_force_n
    return math.inf if found is None else found


def _rate_hardness(document: dict[str, Any], problem: Problem) -> str:
    hardness = document["rate_hardness_n_per_m"]
    if hardness is None:
        return f"none: no contact, or fewer than {RISE_SAMPLES} samples within its {quantity(IMPACT_S, 's')}"
    return f"{quantities(problem.units)(hardness, 'N/m')} at contact"


def _without_guard(document: dict[str, Any], problem: Problem) -> list[Row]:
    free, told = document["without_guard"], quantities(problem.units)
    if free is None:
        return []
    swing = told(_kept(free["position_peak_to_peak_m"]), "m")
    return [Row("No guard", f"{_WORDS[free['outcome']]}, {swing} peak to peak", _MARKS[free["outcome"]])]


def _other(run: dict[str, Any], problem: Problem) -> Row:
    told = quantities(problem.units)
    swing, energy = _kept(run["position_peak_to_peak_m"]), _kept(run["energy_generated_j"])
    what = f"{_WORDS[run['outcome']]}{', buzzes' if run['buzzing'] else ''}"
    sensed = run["apparent_stiffness_n_per_m"]
    numbers = f"{'no stiffness' if sensed is None else told(sensed, 'N/m')}, {told(swing, 'm')} peak to peak"
    return Row(f"With {run['coupling']}", f"{what}: {numbers}, {quantity(energy, 'J')} given out", _mark(run))


def _kept(value: float | None) -> float | None:
    """Return a value; 0 for a rounding residue."""
    return 0.0 if value is not None and abs(value) < _ROUND_OFF else value


def scene_lines(document: dict[str, Any]) -> list[str]:
    """Return the criteria of the verdict, and what each effect adds to a sample.

    Args:
        document: of `avc simulate --json`.
    """
    return [document["criterion"], "", *explanation_lines(document)]


def explanation_lines(document: dict[str, Any]) -> list[str]:
    """Return what each effect adds: states, instructions and time a sample.

    Args:
        document: of `avc simulate --json`.
    """
    rows = [
        [
            effect["kind"],
            effect["station"],
            str(effect["states"]),
            f"the only {MASS}" if effect["instructions"] is None else str(effect["instructions"]),
            nanoseconds(effect["ns_per_step"], document["scatter_ns"]),
        ]
        for effect in document["effects"]
    ]
    whole = ["whole sample", "", str(document["states"]), str(document["instructions"])]
    rows.append([*whole, f"{document['ns_per_step']:.0f}"])
    head = ("effect", "station", "adds\nstates", "adds\ninstructions", "adds\nns a sample")
    return [
        text_table(head, rows, left=(0, 1)),
        f"states: {', '.join(document['state_names'])}",
        f"absent, at no cost: {', '.join(document['absent'])}",
    ]


def nanoseconds(cost_ns: float | None, scatter_ns: float) -> str:
    """Return a cost in ns, or an upper bound within the scatter of the clock.

    Args:
        cost_ns: None where there is none.
        scatter_ns: of the clock.
    """
    if cost_ns is None:
        return "-"
    return f"{cost_ns:.0f}" if cost_ns > scatter_ns else f"< {max(scatter_ns, 1):.0f}"


def screening_page(document: dict[str, Any], problem: Problem, page: Page, shown: str) -> str:
    """Return the `simulate --screen` document as a headline and rows, an effect each that the scene needs.

    Args:
        document: of `avc simulate --screen --json`.
        problem: that was simulated.
        page: where it is printed.
        shown: the problem or coupling as the user names it.
    """
    needed = [effect for effect in document["effects"] if effect["needed"]]
    tolerance = percent(document["tolerance"])
    rows = [
        Row(
            "All effects",
            f"{_WORDS[document['outcome']]}, coupling {document['coupling']}",
            _MARKS[document["outcome"]],
        ),
        *(
            Row(f"No {one['kind']}", f"{_changes(one, problem.units)}, {_WORDS[one['outcome']]}: needed")
            for one in needed
        ),
        *(
            [Row(f"Only {MASS}", f"cannot be left out: {', '.join(document['essential'])}")]
            if document["essential"]
            else []
        ),
    ]
    together = document["together"]
    if together is None:
        rows.append(Row("Not needed", f"none at a tolerance of {tolerance}"))
    else:
        rows.append(Row("Not needed", f"at a tolerance of {tolerance}: {', '.join(document['unneeded'])}"))
        rows.append(Row("Without these", f"{_changes(together, problem.units)}, {_WORDS[together['outcome']]}"))
    rows += [Row("Note", note, Mark.CAUTION) for note in document["notes"]]
    return page.rendered(headline(problem, shown), rows, [f"avc simulate {quote(shown)} --screen -v"])


def _changes(found: dict[str, Any], units: Units) -> str:
    """Describe relative changes, rms over the run for position and force."""
    told = (f"{units.key(name)} {percent(found[f'{name}_change'])}" for name in ("position", "force", "stiffness"))
    return ", ".join(told)


def screening_lines(document: dict[str, Any]) -> list[str]:
    """Return the change and the saving by leaving each effect out.

    Args:
        document: of `avc simulate --screen --json`.
    """
    head = ("without", "position\n%", "force\n%", "stiffness\n%", "outcome", "saves\ninstructions")
    rows = [
        [
            effect["kind"],
            *(
                number(None if effect[key] is None else 100 * effect[key], 3)
                for key in ("position_change", "force_change", "stiffness_change")
            ),
            effect["outcome"],
            str(effect["instructions"]),
            nanoseconds(effect["ns_per_step"], document["scatter_ns"]),
            "yes" if effect["needed"] else "no",
        ]
        for effect in document["effects"]
    ]
    return [
        text_table((*head, "saves\nns a sample", "needed"), rows, left=(0, 4, 7)),
        f"changes are relative: rms over the run for position and {FORCE}",
    ]
