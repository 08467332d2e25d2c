"""One simulated scene as text for people."""

from __future__ import annotations

from typing import Any

from avc_casadi.cli._text import nanoseconds, number, table
from avc_casadi.model.registries import EFFECTS

# In mm, mm/s, N and mJ: a millionth of what any device could show.
_ROUND_OFF = 1e-12


def simulation_text(document: dict[str, Any], *, plot: str | None, explained: bool) -> str:
    """Lay the `simulate` document out for people.

    Args:
        document: with ``against`` where other couplings were simulated.
        plot: where the figure was drawn; None for none.
        explained: whether to show what each effect adds.
    """
    gains = [document[key] for key in ("damping_ns_per_m", "stiffness_n_per_m", "contact_damping_ns_per_m")]
    coupling = document["coupling"]
    if coupling != "none":
        b, k, b_p = (number(gain) if gain is not None else "rigid" for gain in gains)
        coupling += f" (b = {b} N.s/m, k = {k} N/m" + (f", b_p = {b_p} N.s/m)" if gains[2] else ")")
        if document["gains_from_hz"] is not None:
            adapts = any(effect["kind"] == "adaptation" for effect in document["effects"])
            coupling += ", at first" if adapts else ""
            coupling += f", the table at {number(document['gains_from_hz'])} Hz"
    detents = any(effect["kind"] == "detent" for effect in document["effects"])
    beside = ", with the slope of the detents" if detents else ""
    lines = [
        f"{document['problem']}: {document['steps']} samples, coupling {coupling}",
        *(f"  note: {note}" for note in document["notes"]),
        *(
            [f"  declared and left out, as the scene lists other effects: {', '.join(document['left_out'])}"]
            if document["left_out"]
            else []
        ),
        f"  {outcome(document)}{'; buzzes' if document['buzzing'] else ''}",
        f"  largest velocity at the end   {_told(document['peak_velocity_m_per_s'], 1e3)} mm/s",
        f"  position at the end           {_told(document['position_peak_to_peak_m'], 1e3)} mm peak to peak",
        f"  force at the end              {_told(document['mean_force_n'])} N",
        f"  force between 20 and 500 Hz   {_told(document['force_ripple_n'])} N rms",
        f"  stiffness, at the sensor      {number(document['apparent_stiffness_n_per_m'])} N/m{beside}",
        f"  rate-hardness at contact      {number(document['rate_hardness_n_per_m'])} N/m",
        f"  energy given out beyond that taken in   {_told(document['energy_generated_j'], 1e3)} mJ",
        f"  {document['criterion']}",
    ]
    if document["without_guard"] is not None:
        lines.append(f"  without the guard: {_travel(document['without_guard'])}; with it: {_travel(document)}")
    if "against" in document:
        lines += ["", *_against(document)]
    if explained:
        lines += ["", *_explanation(document)]
    lines += [f"written: {path}, its manifest beside it (.json)" for path in (document["trace"],) if path is not None]
    lines += [f"drawn: {plot}"] if plot is not None else []
    return "\n".join(lines)


def outcome(document: dict[str, Any]) -> str:
    """Say what came of it, of the one hand that was simulated."""
    held = any(EFFECTS[effect["kind"]].role == "hand" for effect in document["effects"])
    who = "with this hand the device" if held else "the device"
    outcomes = {
        "asymptotic": f"{who} comes to rest, and does not need dry friction for it",
        "held-by-friction": f"{who} is held by dry friction only: without it, it does not come to rest",
        "unstable": f"{who} does not come to rest",
    }
    return outcomes[document["outcome"]]


def _travel(document: dict[str, Any]) -> str:
    return f"{document['outcome']}, {_told(document['position_peak_to_peak_m'], 1e3)} mm peak to peak"


def _against(document: dict[str, Any]) -> list[str]:
    rows = [
        [
            run["coupling"],
            run["outcome"] + (", buzzes" if run["buzzing"] else ""),
            _told(run["position_peak_to_peak_m"], 1e3),
            number(run["apparent_stiffness_n_per_m"]),
            number(run["rate_hardness_n_per_m"]),
            _told(run["energy_generated_j"], 1e3),
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


def _told(value: float | None, factor: float = 1.0) -> str:
    """Return a measured number in another unit; what only rounding leaves of it is 0."""
    scaled = None if value is None else factor * value
    return number(0.0 if scaled is not None and abs(scaled) < _ROUND_OFF else scaled)


def _explanation(document: dict[str, Any]) -> list[str]:
    rows = [
        [
            effect["kind"],
            effect["station"],
            str(effect["states"]),
            "the only mass" if effect["instructions"] is None else str(effect["instructions"]),
            nanoseconds(effect["ns_per_step"], document["scatter_ns"]),
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
