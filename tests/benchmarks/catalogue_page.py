"""The page of results of `catalogue_walls.py`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from studied import made_by, rounded, table

from avc_casadi.files.device_file import SdkExample, load_device

PAGE = Path(__file__).parent / "RESULTS_catalogue.md"
WALL_N_PER_M = 1e5
# Share of the plain limit at which spring and damper are tried, and devices within the ranges that are judged.
PLAIN_SHARE, INSIDE = 0.9, 12
# Hands that `recommend` never saw; corners of the ranges, and devices within, among which they are dealt out.
FRESH, FRESH_CORNERS, FRESH_WITHIN = 400, 24, 16
_MOST = 0.5


def limited_by(found: dict[str, Any]) -> str:
    """Name what holds a wall back."""
    if found.get("at_force_limit", 0) > _MOST * found.get("people", np.inf):
        return "force limit"
    raised = found["stiffest_without_n_per_m"]
    name = max(raised, key=lambda one: raised[one])
    rest = found["plain_at_rest"]
    plain = found["plain_n_per_m"]
    if plain == raised[name] == 0:
        return "no plain wall with any one of these"
    said = f"{name} (x {raised[name] / plain:.2g})" if plain else f"{name} (no plain wall with it)"
    if rest and rest["encoder"] < rest["no encoder"]:
        said += f"; encoder ({rest['encoder']} rest, {rest['no encoder']} without it)"
    return said


def examples(names: str) -> list[SdkExample]:
    """Return what an SDK ships for the devices of a row, in their order."""
    found = (load_device(name).sdk_example for name in names.split(", "))
    return [one for one in found if one is not None]


def sdk_example(names: str) -> str:
    limits = [
        f"{rounded(one.wall_stiffness_n_per_m)} (example program)"
        if one.max_stiffness_n_per_m is None
        else f"{rounded(one.max_stiffness_n_per_m)}; {rounded(one.max_damping_ns_per_m)}"
        for one in examples(names)
    ]
    return ", ".join(limits) or "-"


HEAD = (
    "device",
    "hands",
    "plain limit, N/m",
    "recommended, N/m",
    "felt, N/m",
    "by",
    "leaning on friction, N/m",
    "at rest / without friction / quiet of 100",
    "fresh hands at rest on devices of the ranges / in the second simulator",
    "at the force limit",
    "holds inside the ranges",
    "limited by",
    "SDK example, N/m; N.s/m",
)


def row(name: str, hands: str, found: dict[str, Any]) -> list[str]:
    if "error" in found:
        return [name, hands, found["error"], *[""] * (len(HEAD) - 3)]
    if found["recommended_n_per_m"] is None:
        return [name, hands, rounded(found["plain_n_per_m"]), "none", *["-"] * 7, limited_by(found), sdk_example(name)]
    return [
        name,
        hands,
        rounded(found["plain_n_per_m"]),
        rounded(found["recommended_n_per_m"]),
        rounded(found["felt_n_per_m"]),
        found["method"] + (" + observer" if found["observer"] and found["method"] != "robust" else ""),
        rounded(found["with_friction_n_per_m"]) if found["friction_n"] else "no friction known",
        f"{found['at_rest']} / {found['at_rest_without_friction']} / {found['quiet']}",
        fresh(found["fresh_at_rest"]),
        str(found["at_force_limit"]),
        f"{found['inside']} of {INSIDE}",
        limited_by(found),
        sdk_example(name),
    ]


def fresh(found: dict[str, int | None]) -> str:
    second = found["second_simulator"]
    return f"{found['scene']}" if second is None else f"{found['scene']} / {second}"


TEXT = """# How stiff a wall each device of the catalogue can show

{made_by}

The wall asked for is {wall} N/m, out of reach on purpose, on one axis. **Plain limit**: the stiffest wall that spring
and damper hold with every corner of the hands and let go, at every corner of the device's ranges
(`avc_casadi.loops.walls.stiffest_wall`), linear. **Recommended**: coupling and wall in series of
`avc recommend`; **felt**: median at the end of a press, hands at the force limit left out. **Leaning on friction**:
what `with_friction_n_per_m` tells: of what was tried, so at least that. Trials: 100 hands, corners among them, on the
nominal device. **Fresh hands**: {fresh} that `recommend` never saw, dealt out among {corners} devices at corners of
the ranges (fewer where there are fewer; some of them were tried before) and {within} new ones within, at rest without
dry friction: in the scene, and with the exported C in a simulator that shares no code with the project (linear devices
with amplifier and structure). **Holds inside the ranges**: of {inside} devices drawn inside the ranges (claims are
made at their corners), those on which the coupling is deployable. **Limited by**: the force limit if most presses end
at it; else the single change that raises the plain limit most (no delay, no resonance, ideal amplifier, each with its
range gone; half the sample time) and by how much; and the encoder, if without it more hands rest (without friction)
before the plain wall of {share:.0%} of the limit.
Walls of a device that turns are told at its handle.
Hands: the default set (0.05 to 0.3 kg, 3 to 20 N.s/m, 200 to 800 N/m) and fingertips (0.02 to 0.1 kg, 1 to 5 N.s/m,
100 to 500 N/m).

**SDK example**: what CHAI3D 3.3.0 (Hapkit: its example program) ships as limits of stiffness and of damping. Example
values of an SDK, no datasheets; they were not made for the ranges below.

## Gaps taken as ranges

Nobody publishes most values of most devices. Here each gap is a range, its nominal value simulated: mass, damping and
delay as the device file gives them (damping 0 to 1 N.s/m, delay 0 to 2 samples; where the file gives no range for the
gap: the same); amplifier 500 to 3000 Hz (nominal 1000); a resonance at 80 to 300 Hz (nominal 150; damping ratio 0.05,
mass ratio 0.3); an encoder step of 55 um, the coarsest that is published for a desktop device here. **Not filled**:
noise and backlash (taken as none), dry friction (none, the cautious end, unless the file has a value), force limit
(none known: no limit). Devices with the same values share a row. What these rows say of a device with gaps is as much
about the ranges as about the device: they are what can be promised without measuring it.

{cautious}

{cautious_said}

## Gaps left ideal, for comparison

The same with a rigid structure, an ideal amplifier and an exact encoder wherever the file has such a gap; mass, damping
and delay still over their ranges. **Not to be promised for a device**: it shows what an unmeasured structure costs.

{filed}

{filed_said}
"""


def said(document: dict[str, Any], reading: str) -> str:
    """Say what a table shows, from its numbers."""
    found = {
        name: one
        for name, one in document["cells"].items()
        if name.endswith(f"| {reading}") and "error" not in one and one["recommended_n_per_m"] is not None
    }
    if not found:
        return ""
    gain = [
        one["recommended_n_per_m"] / min(one["plain_n_per_m"], WALL_N_PER_M)
        for one in found.values()
        if one["plain_n_per_m"]
    ]
    beyond = [
        (sdk.max_stiffness_n_per_m, one)
        for name, one in found.items()
        for sdk in examples(name.split(" | ")[0])
        if sdk.max_stiffness_n_per_m is not None
    ]
    whole = sum(one["at_rest_without_friction"] == one["people"] for one in found.values())
    over = sum(limit > one["recommended_n_per_m"] for limit, one in beyond)
    inner = sum(one["inside"] == INSIDE for one in found.values())
    tried = {
        name: [one["fresh_at_rest"][name] for one in found.values() if one["fresh_at_rest"][name] is not None]
        for name in ("scene", "second_simulator")
    }
    rest = {name: f"{rounded(sum(some), 9)} of {rounded(FRESH * len(some), 9)}" for name, some in tried.items()}
    beyond_the_scene = f" ({rest['second_simulator']} in the second simulator)" if tried["second_simulator"] else ""
    return (
        f"In {len(found)} rows the recommended wall is {min(gain):.2g} to {max(gain):.2g} times the plain limit, or "
        f"the wall where that is less (median {np.median(gain):.2g}); in {whole} all hands settle without "
        f"friction; of fresh hands on devices all over the ranges {rest['scene']} do{beyond_the_scene}; in {inner} the "
        "coupling holds on all devices drawn inside the ranges. The SDK's example limit is stiffer than what is "
        f"recommended in {over} of {len(beyond)} devices and hands that have one."
    )


def write_page(document: dict[str, Any]) -> None:
    def rows(reading: str) -> str:
        cells = [name.split(" | ") for name in document["cells"]]
        return table(
            HEAD,
            (
                row(name, hands, document["cells"][f"{name} | {hands} | {which}"])
                for name, hands, which in sorted(cells)
                if which == reading
            ),
        )

    PAGE.write_text(
        TEXT.format(
            made_by=made_by(document["about"]),
            wall=rounded(WALL_N_PER_M),
            inside=INSIDE,
            fresh=FRESH,
            corners=FRESH_CORNERS,
            within=FRESH_WITHIN,
            share=PLAIN_SHARE,
            cautious=rows("cautious"),
            filed=rows("as filed"),
            cautious_said=said(document, "cautious"),
            filed_said=said(document, "as filed"),
        ),
        encoding="utf-8",
    )
