"""What each rule of identification and of diagnosis is worth: left out, one at a time, on logs that no test uses.

nice -n 10 python tests/benchmarks/ablation_identify.py --part identify --count 24 --seed 70001 --write
nice -n 10 python tests/benchmarks/ablation_identify.py --part diagnose --count 40 --seed 70002 --write

Logs are drawn afresh: of devices by `tests/measured_device.c` (rigid, resonant, with an amplifier of either order, held
by a spring, with Stribeck friction; multisines and chirps of several bands; encoder, noise, drift, lost rows, rows that
jump, a force that is cut), and of loops that buzz for one known reason by `tests/buzzing_cases.py`. Every log is judged
with all rules; then each rule is replaced by what stands there without it, and the logs on which it did something are
judged again. A function that returned what it returns when it is left out did nothing, and its log is not run again;
what cannot be seen to do nothing is left out on every fourth log. With --write rows go to
results/ablation_identify_PART.json after every log, and the study goes on where it stopped.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import resource
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from studied import about, kept_rows, made_by, write_rows

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent), str(HERE.parent.parent / "hardware")]

from buzzing_cases import CAUSES, case_of, healthy_case  # noqa: E402 - found beside the tests
from measured_device import Truth, measured, multisine  # noqa: E402

import avc_casadi.identification.diagnosis  # noqa: E402, F401 - its modules are looked up by name
from avc_casadi import AvcError  # noqa: E402
from avc_casadi.identification.diagnosis.diagnose import diagnose  # noqa: E402
from avc_casadi.identification.identify import identify  # noqa: E402
from avc_casadi.identification.record import Columns, records_of  # noqa: E402

PERIOD = 1e-3
SECONDS = 3.0
TELLING = {
    "mass_kg": "mass",
    "damping_ns_per_m": "damping",
    "delay_samples": "delay",
    "coulomb_friction_n": "coulomb",
    "amplifier_bandwidth_hz": "bandwidth",
    "amplifier_damping_ratio": "loop_damping",
    "resonance.frequency_hz": "resonance",
    "resonance.damping_ratio": "ratio",
    "resonance.mass_ratio": "share",
    "stiffness_n_per_m": "ground",
    "breakaway_excess_n": "breakaway",
    "offset_drift_n_per_s": "drift",
}
OF_TERM = {
    "resonance": "resonance",
    "amplifier": "bandwidth",
    "stiffness": "ground",
    "stribeck": "breakaway",
    "coulomb": "coulomb",
    "drift": "drift",
    "play": "none",
    "asymmetry": "none",
    "dead-zone": "none",
    "drag": "none",
}


@dataclass(frozen=True)
class Rule:
    """Something that is left out.

    Attributes:
        name: module and what it is called there; several are left out together.
        without: what stands there in its place: of a function a function, of a number a number.
        idle: whether a call did nothing, by its arguments and its result; None: it always may have done something.
        words: what it is.
    """

    name: str
    without: Any
    words: str
    idle: Callable[[tuple[Any, ...], Any], bool] | None = None
    more: tuple[tuple[str, Any], ...] = field(default=())


def _none(_: tuple[Any, ...], result: Any) -> bool:
    return result is None


def _nothing(_: tuple[Any, ...], result: Any) -> bool:
    return not result


def _zero(_: tuple[Any, ...], result: Any) -> bool:
    return not np.any(result)


def _first(at: int) -> Callable[..., Any]:
    return lambda *given, **_: given[at]


IDENTIFY = (
    Rule(
        "identification.lag_vs_resonance.rival_resonance",
        lambda *_: None,
        "resonance beyond the band beside an amplifier",
        _none,
    ),
    Rule("identification.select._no_rival_resonance", lambda *_: None, "the same once more at the end"),
    Rule(
        "identification.fit.ringing_behind_a_lag",
        lambda _, simple, *__: simple,
        "resonance and lag at once",
        lambda *_: False,
    ),
    Rule(
        "identification.assumed_mass_ratio.shared",
        lambda _, found, *__: found,
        "mass ratio held where it is not told",
        lambda *_: False,
        more=(("identification.identify.SHARE", "no key"),),
    ),
    Rule(
        "identification.assumed_mass_ratio.other_shares",
        lambda _, found, *__: (np.zeros((2, found.search.size)), (0.1, 0.7)),
        "intervals over other mass ratios",
        lambda *_: False,
    ),
    Rule(
        "identification.assumed_mass_ratio.moved",
        lambda fit: np.zeros((2, len(fit.structure.free))),
        "spring on either side",
        _zero,
    ),
    Rule(
        "identification.selection.no_false_resonance",
        lambda *_: False,
        "current loop in place of a resonance",
        _nothing,
    ),
    Rule("identification.selection.no_false_loop", lambda *_: False, "resonance in place of a current loop", _nothing),
    Rule(
        "identification.lag_vs_resonance.of_the_other_order",
        lambda _, found, *__: found,
        "amplifier of the other order",
        lambda *_: False,
    ),
    Rule(
        "identification.uncertainty.richardson",
        lambda _, fit, spread, *__: (fit, spread),
        "Richardson extrapolation of parts",
        lambda given, result: result[0] is given[1],
    ),
    Rule("identification.log_consistency.saturation_doubts", lambda *_: [], "note of a force cut seldom", _nothing),
    Rule("identification.initial_guess.saturated_force_n", lambda *_: None, "refusal of a force that is cut", _none),
    Rule("identification.encoder.repeats_of", lambda records, _: (0,) * len(records), "repeats counted once", _zero),
    Rule(
        "identification.repair.left_out",
        lambda columns: (columns, []),
        "outliers and empty rows left out",
        lambda _, result: not result[1],
    ),
    Rule("identification.log_consistency.unlike_logs", lambda *_: [], "logs of several devices told", _nothing),
    Rule("identification.closed_loop.only_feedback", lambda *_: None, "only feedback told", _none),
    Rule("identification.frequency.held_guess", lambda *_: None, "start of a held device", _none),
    Rule("identification.select._NEAR_THE_BEST", 1.0, "several close fits of one term"),
    Rule("identification.select._NEAR_ANOTHER", math.inf, "screening by another term"),
    Rule("identification.select._HOPEFUL", -math.inf, "screening by a Gauss-Newton step"),
    Rule("identification.select._prune", lambda *_: None, "terms tried without at the end"),
    Rule("identification.select._beyond", lambda *_: "", "frequencies beyond the band", _nothing),
    Rule("identification.identifiability.vague_terms", lambda *_: [], "vague terms taken out", _nothing),
    Rule(
        "identification.estimates.widened",
        lambda _, spread, *__: spread.half_width.tolist(),
        "intervals hold rivals",
        lambda given, result: np.allclose(given[1].half_width, result),
    ),
    Rule("identification.identify._beside", lambda *_: [], "intervals hold other observers"),
    Rule(
        "identification.uncertainty._inside_a_sample",
        lambda fit: np.zeros(len(fit.structure.free)),
        "intervals hold what samples hide",
        _zero,
    ),
    Rule(
        "identification.uncertainty._by_the_clock",
        lambda fit: np.zeros(len(fit.structure.free)),
        "intervals hold the clock",
    ),
    Rule("identification.uncertainty._ENOUGH_RECORDS", 10**6, "differences between records"),
    Rule("identification.initial_guess._MOST_STARTS", 1, "a second start of a resonance"),
    Rule("identification.fit._ROUGH_SAMPLES", 10**9, "rough fits of pieces"),
    Rule("identification.record._worth", lambda *_: 0.0, "short pieces left out", _zero),
)
DIAGNOSE = (
    Rule(
        "identification.diagnosis.saturation.outgrows",
        lambda *_: False,
        "a loop that would outgrow few counts",
        _nothing,
    ),
    Rule(
        "identification.diagnosis.saturation.unlimited", lambda *_: False, "an even swing that nothing limits", _nothing
    ),
    Rule("identification.diagnosis.relay.find_jump", lambda *_: None, "a force that jumps", _none),
    Rule("identification.diagnosis.intended.other_unit", lambda *_: "", "another unit", _nothing),
    Rule(
        "identification.diagnosis.law.without_repeats",
        _first(0),
        "rows that repeat a force",
        lambda given, result: result is given[0],
    ),
    Rule(
        "identification.diagnosis.limit_cycle.find_count_limit_cycle", lambda *_: None, "turns over few counts", _none
    ),
    Rule("identification.diagnosis.limit_cycle.passes", lambda *_: False, "a touch that passes", _nothing),
    Rule("identification.diagnosis.oscillation._unsettled", lambda *_: False, "ripple without a line", _nothing),
    Rule("identification.diagnosis.oscillation.level_from", lambda *_: None, "a decay that ends at a level", _none),
    Rule("identification.diagnosis.oscillation._falls", lambda *_: False, "irregular motion that falls", _nothing),
    Rule("identification.diagnosis.oscillation.travel_of_cycles", lambda *_: math.inf, "travel of two cycles"),
    Rule(
        "identification.diagnosis.saturation.limited",
        lambda _, swing, *__: swing,
        "share at the force limit",
        lambda given, result: result is given[1],
    ),
    Rule(
        "identification.diagnosis.counterfactual.settled",
        lambda asked, *_: tuple(asked),
        "played as it was meant",
        lambda given, result: [one.causes for one in given[0]] == [one.causes for one in result],
    ),
    Rule(
        "identification.diagnosis.counterfactual.doubts_of_encoder",
        lambda *_: [],
        "played without the encoder",
        _nothing,
    ),
    Rule("identification.diagnosis.causes._changed", lambda *_: False, "let go long after contact", _nothing),
    Rule("identification.diagnosis.causes._share_of_way", lambda *_: 0.0, "shares of the way to rest", _nothing),
    Rule(
        "identification.diagnosis.causes._share_of_ticks",
        lambda *_: 1.0,
        "share of missing ticks",
        lambda _, result: result == 1,
    ),
    Rule("identification.diagnosis.causes._STEPS", math.inf, "steps beyond which no encoder swings"),
    Rule("identification.diagnosis.causes._HELD", 0.5, "share of hands that must rest"),
    Rule("identification.diagnosis.causes._DELAY", 0.0, "delay that is no finding"),
    Rule("identification.diagnosis.verdict._together", lambda *_: None, "delay together with another", _none),
    Rule(
        "identification.diagnosis.verdict._TREMOR_M",
        0.0,
        "tremor of a hand",
        more=(("identification.diagnosis.verdict._STRONG_TREMOR_M", 0.0),),
    ),
    Rule("identification.diagnosis.verdict._UNEXPLAINED", math.inf, "what the model leaves"),
    Rule("identification.diagnosis.verdict._FREQUENCY", math.inf, "frequency of model and log"),
    Rule("identification.diagnosis.verdict.toggles", lambda *_: False, "toggles that no hand feels", _nothing),
    Rule("identification.diagnosis.verdict._SURE", 0.5, "odds that are sure"),
    Rule(
        "identification.diagnosis.law._also_cut",
        lambda law, *_: law,
        "a law has to reach the limit",
        lambda given, result: result == given[0],
    ),
    Rule("identification.diagnosis.evidence.limit_sentence", lambda *_: "", "the limit hides the law", _nothing),
    Rule("identification.diagnosis.plant._UNEXPLAINED", 0.0, "when a resonance is looked for"),
    Rule("identification.diagnosis.plant._ODDS", 0.0, "odds against a resonance"),
    Rule("identification.diagnosis.plant._REWEIGHED", 0, "windows weighed anew"),
    Rule("identification.diagnosis.noise_floor._alike", lambda _: 1.0, "how alike residuals are"),
    Rule("identification.diagnosis.noise_floor._TAKEN", 1e9, "half an encoder step"),
    Rule("identification.diagnosis.log._held", lambda *_: 1, "forces held for samples", lambda _, result: result == 1),
)


# --- patches


def _modules(part: str) -> list[Any]:
    return [module for name, module in sys.modules.items() if name.startswith(f"avc_casadi.{part}.") and module]


def _place(name: str) -> tuple[Any, str]:
    module, _, attribute = name.rpartition(".")
    return sys.modules[f"avc_casadi.{module}"], attribute


@contextlib.contextmanager
def replaced(changes: Mapping[str, Any]) -> Iterator[None]:
    """Put other things in place of some, wherever their package has imported them."""
    undo = []
    for name, new in changes.items():
        module, attribute = _place(name)
        old = getattr(module, attribute)
        for one in _modules(name.partition(".")[0]) if callable(old) else [module]:
            for key, value in list(vars(one).items()):
                if value is old and (callable(old) or key == attribute):
                    undo.append((one, key, old))
                    setattr(one, key, new)
    try:
        yield
    finally:
        for one, key, old in reversed(undo):
            setattr(one, key, old)


def _spied(rule: Rule, acted: set[str]) -> Callable[..., Any]:
    module, attribute = _place(rule.name)
    old = getattr(module, attribute)

    def spy(*given: Any, **named: Any) -> Any:
        result = old(*given, **named)
        if rule.idle is None or not rule.idle(given, result):
            acted.add(rule.name)
        return result

    return spy


# --- logs of devices


def drawn(seed: int, index: int) -> tuple[Truth, dict[str, Any], Columns]:
    """Draw a device, its excitation and what becomes of the log."""
    random = np.random.default_rng([seed, index])

    def log(low: float, high: float) -> float:
        return float(np.exp(random.uniform(np.log(low), np.log(high))))

    kind = ("rigid", "resonance", "lag", "loop", "spring", "stribeck")[index % 6]
    device: dict[str, float] = {
        "mass": log(0.03, 0.5),
        "damping": log(0.2, 5.0),
        "coulomb": float(random.uniform(0, 2)) if random.random() < 0.8 else 0.0,
        "delay": float(random.uniform(0, 3)),
        "encoder": log(2e-6, 61e-6),
        "offset": float(random.uniform(-0.2, 0.2)),
        "drift": float(random.uniform(-0.02, 0.02)) if random.random() < 0.4 else 0.0,
        "spring": log(20.0, 100.0),
        "period": PERIOD,
    }
    if kind == "resonance" or (kind in {"loop", "spring"} and random.random() < 0.3):
        device |= {
            "resonance": log(50.0, 350.0),
            "ratio": log(0.01, 0.1),
            "share": float(random.uniform(0.15, 0.6)),
            "at_handle": float(random.random() < 0.4),
        }
    if kind in {"lag", "loop"}:
        device |= {"bandwidth": log(60.0, 800.0), "loop_damping": log(0.3, 1.4) if kind == "loop" else 0.0}
    if kind == "spring":
        device["ground"] = log(100.0, 3000.0)
    if kind == "stribeck":
        device |= {
            "coulomb": float(random.uniform(0.2, 1.0)),
            "breakaway": float(random.uniform(0.1, 0.6)),
            "slow": log(3e-3, 3e-2),
        }
    rms = max(1.0, float(random.uniform(1.2, 3.0)) * (device["coulomb"] + device.get("breakaway", 0.0)))
    top = float(random.choice([60.0, 150.0, 300.0, 300.0]))
    cut = random.random() < 0.12
    if cut:
        device |= {"offset": 0.0, "drift": 0.0, "spring": 0.0}
    truth = Truth(**device)
    if random.random() < 0.2:
        time = np.arange(round(SECONDS / PERIOD)) * PERIOD
        wanted = rms * 1.4 * np.sin(2 * np.pi * (0.5 * time + (top - 0.5) * time**2 / (2 * SECONDS)))
    else:
        wanted = multisine(random, SECONDS, PERIOD, 0.5, top, rms)
    limit = float(np.quantile(np.abs(wanted), random.uniform(0.9, 0.995))) if cut else math.inf
    _, position, force = measured(
        truth, np.clip(wanted, -limit, limit), random, noise=log(1e-6, 2e-5) if random.random() < 0.4 else 0.0
    )
    force = wanted if cut else force
    rows = np.arange(position.size)
    spoilt = random.random()
    if spoilt < 0.12:
        rows = rows[random.random(rows.size) > 0.003]
    elif spoilt < 0.24:
        position = position.copy()
        position[random.choice(rows[50:-50], 5, replace=False)] += float(random.choice([-1, 1])) * 0.02
    about_it = {"kind": kind, "top_hz": top, "cut": float(cut), "spoilt": spoilt}
    return truth, about_it, Columns("drawn", rows * PERIOD, position[rows], force[rows])


def identified(truth: Truth, cut: bool, columns: Columns) -> dict[str, Any]:
    """Identify and judge one log."""
    before = _cpu()
    row: dict[str, Any] = {"keys": {}, "false": [], "missed": [], "refused": ""}
    try:
        records, faults, _ = records_of(columns)
        found = None if faults else identify(records)
        row["refused"] = str(faults[0].message) if faults else ""
    except AvcError as error:
        found, row["refused"] = None, str(error)
    row["cpu_s"] = _cpu() - before
    row["cut_told"] = "follow" in row["refused"] or (
        found is not None and any("seems to follow" in note for note in found.notes)
    )
    true = {key: float(getattr(truth, name)) for key, name in TELLING.items()}
    lag = 2 * truth.loop_damping or 1.0
    if truth.bandwidth and (found is None or "amplifier_bandwidth_hz" not in found.estimates):
        true["delay_samples"] += lag / (2 * np.pi * truth.bandwidth * truth.period)
    for key, value in true.items():
        always = key in {"mass_kg", "damping_ns_per_m", "delay_samples", "coulomb_friction_n"}
        if (
            (not value and not always)
            or (key.startswith("resonance") and not truth.resonance)
            or (key == "amplifier_damping_ratio" and not truth.bandwidth)
        ):
            continue
        one = None if found is None else found.estimates.get(key)
        if one is None:
            row["keys"][key] = None
            continue
        row["keys"][key] = {
            "inside": bool(one.low <= value <= one.high),
            "true": value,
            "value": one.value,
            "half": (one.high - one.low) / 2,
        }
    for term, name in OF_TERM.items():
        has = bool(getattr(truth, name, 0.0))
        taken = found is not None and term in found.terms
        if taken and not has:
            row["false"].append(term)
        if has and not taken:
            row["missed"].append(term)
    if cut and not row["cut_told"]:
        row["missed"].append("cut")
    if not cut and row["cut_told"]:
        row["false"].append("cut")
    return row


def _cpu() -> float:
    return sum(resource.getrusage(who).ru_utime for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))


# --- logs of loops


def diagnosed(case: Any) -> dict[str, Any]:
    """Diagnose and judge one log."""
    before = _cpu()
    try:
        found = diagnose(case.columns, device=case.declared)
        answer, candidates, told = found.cause or found.verdict, list(found.candidates), found.conclusion
        cures = len(found.cures)
    except AvcError as error:
        answer, candidates, told, cures = "refused", [], str(error), 0
    return {"answer": answer, "candidates": candidates, "said": told[:200], "cures": cures, "cpu_s": _cpu() - before}


# --- the study


def studied(part: str, seed: int, index: int) -> dict[str, Any]:
    """Judge one log with all rules, and with each that did something left out."""
    rules = IDENTIFY if part == "identify" else DIAGNOSE
    row: dict[str, Any] = {"number": index, "without": {}}
    if part == "identify":
        truth, told, columns = drawn(seed, index)
        row |= {"truth": {key: value for key, value in vars(truth).items() if value}, "drawn": told}

        def run() -> dict[str, Any]:
            return identified(truth, bool(told["cut"]), columns)

    else:
        of, which = divmod(index, len(CAUSES) + 1)
        case = healthy_case(seed, of) if which == len(CAUSES) else case_of(CAUSES[which], seed, of)
        row |= {"truth": case.cause, "source": case.source}

        def run() -> dict[str, Any]:
            return diagnosed(case)

    acted = set[str]()
    with replaced({rule.name: _spied(rule, acted) for rule in rules if rule.idle is not None}):
        row["all"] = run()
    for place, rule in enumerate(rules):
        if rule.idle is not None and rule.name not in acted:
            continue
        # A rule that always may have done something is left out on every fourth log, each rule on others.
        if rule.idle is None and (index + place) % 4:
            continue
        with replaced({rule.name: rule.without, **dict(rule.more)}):
            row["without"][rule.name] = run()
    return row


def _sums(rows: list[dict[str, Any]], name: str | None, part: str) -> dict[str, Any]:
    """Return the score of all logs, with a rule left out where it did something."""
    some = [row["without"].get(name, row["all"]) for row in rows]
    if part == "diagnose":
        pairs = [(row["truth"], one) for row, one in zip(rows, some, strict=True)]
        right = sum(one["answer"] == truth for truth, one in pairs)
        undecided = [(truth, one) for truth, one in pairs if one["answer"] in {"cannot tell", "refused"}]
        return {
            "right": right,
            "wrong": len(rows) - right - len(undecided),
            "cannot tell": len(undecided),
            "with the truth": sum(truth in one["candidates"] for truth, one in undecided),
        }
    told = [one for each in some for one in each["keys"].values() if one is not None]
    asked = sum(len(each["keys"]) for each in some)
    error = [abs(one["value"] / one["true"] - 1) for one in told if one["true"]]
    return {
        "told %": round(100 * len(told) / max(asked, 1), 1),
        "inside %": round(100 * sum(one["inside"] for one in told) / max(len(told), 1), 1),
        "outside": sum(not one["inside"] for one in told),
        "error": float(f"{np.exp(np.mean(np.log(np.maximum(error, 1e-7)))):.3g}"),
        "false": sum(len(each["false"]) for each in some),
        "missed": sum(len(each["missed"]) for each in some),
        "refused": sum(bool(each["refused"]) for each in some),
    }


def table_of(part: str, rows: list[dict[str, Any]], made: Mapping[str, Any]) -> str:
    """Return a part of the study as text."""
    rules = IDENTIFY if part == "identify" else DIAGNOSE
    whole = _sums(rows, None, part)
    lines = [
        f"## {part}",
        "",
        made_by(made),
        "",
        f"{len(rows)} logs. *Did something*: logs that were judged again; *changed*: those whose score became another.",
        "",
        f"| left out | what it is | did something | changed | {' | '.join(whole)} |",
        f"|---|---|--:|--:|{'--:|' * len(whole)}",
        f"| nothing | | | | {' | '.join(map(str, whole.values()))} |",
    ]
    for rule in rules:
        again = [row for row in rows if rule.name in row["without"]]
        changed = sum(_score(row["without"][rule.name], part) != _score(row["all"], part) for row in again)
        sums = _sums(rows, rule.name, part).values()
        lines.append(f"| `{rule.name}` | {rule.words} | {len(again)} | {changed} | {' | '.join(map(str, sums))} |")
    time = [row["all"]["cpu_s"] for row in rows]
    return "\n".join([*lines, "", f"Processor time a log with all rules: median {np.median(time):.1f} s.", ""])


def _score(one: Mapping[str, Any], part: str) -> Any:
    if part == "diagnose":
        return one["answer"]
    keys = {key: value and value["inside"] for key, value in one["keys"].items()}
    return keys, one["false"], one["missed"], bool(one["refused"])


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--part", choices=("identify", "diagnose"), required=True)
    parser.add_argument("--count", type=int, default=24, help="logs")
    parser.add_argument("--seed", type=int, default=70001)
    parser.add_argument("--write", action="store_true", help="keep rows in results/ablation_identify_PART.json")
    args = parser.parse_args()
    made = about(f"python tests/benchmarks/ablation_identify.py --part {args.part} --count {args.count}", args.seed)
    out = HERE / "results" / f"ablation_identify_{args.part}.json"
    rows = kept_rows(out, made) if args.write else []
    for index in range(len(rows), args.count):
        rows.append(studied(args.part, args.seed, index))
        last = rows[-1]
        print(f"{index}: {len(last['without'])} rules did something, {last['all']['cpu_s']:.1f} s", flush=True)
        if args.write:
            write_rows(out, made, rows)
    print(table_of(args.part, rows, made))


if __name__ == "__main__":
    main()
