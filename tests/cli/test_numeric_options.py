"""Every option that takes a number has its range in one place, and refuses all else by its name."""

import math

import pytest

from avc_casadi._errors import InputError
from avc_casadi.cli import build_parser, main
from avc_casadi.cli.arguments import RANGES, VERBS, NumericRange
from avc_casadi.model.quantity import RADII_M

OPTIONS = [
    (verb, names[0], options["type"])
    for verb, (_, arguments) in VERBS.items()
    for names, options in arguments
    if isinstance(options.get("type"), NumericRange)
]
HARD = ["0", "-1", "nan", "inf", "-inf", "1e30", "1e-30", "1_0", "", "x", "1" * 5000, "0x10", "1e400"]


def test_no_option_reads_a_number_beside_the_table_of_ranges():
    readers = [
        (verb, names[0])
        for verb, (_, arguments) in VERBS.items()
        for names, options in arguments
        if options.get("type") in (int, float)
    ]
    assert readers == []
    assert {name for _, name, _ in OPTIONS} == set(RANGES)
    assert (RANGES["--handle-radius-m"].lowest, RANGES["--handle-radius-m"].highest) == RADII_M


@pytest.mark.parametrize(("verb", "option", "numbers"), OPTIONS)
def test_a_value_is_in_the_range_or_refused_by_the_name_of_the_option(verb, option, numbers):
    parser = build_parser()
    for typed in (*HARD, repr(numbers.lowest), repr(numbers.highest), "7"):
        args, faults = parsed(parser, [verb, f"{option}={typed}"])
        refused = [fault for fault in faults if fault.key == option]
        if refused:
            assert "must be a" in refused[0].message
            assert len(str(refused[0])) < 300
            continue
        value = numbers(typed)
        assert math.isfinite(value)
        assert numbers.lowest <= value <= numbers.highest
        # Without an argument that the verb requires the parser has no values.
        assert args is None or value in vars(args).values()


def parsed(parser, arguments):
    """The values of arguments, or the faults that the parser finds."""
    try:
        return parser.parse_known_args(arguments)[0], []
    except InputError as error:
        return None, error.faults


def test_a_whole_number_keeps_all_its_digits():
    assert RANGES["--seed"](str(2**63 - 1)) == 2**63 - 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("monitor --port emulator --rate-hz 1e9", "0.001 to 1000 Hz"),
        ("monitor --port emulator --seconds inf", "0.001 to 1000000 s"),
        ("trial c.json --seed -1", "0 to 9.22337203685e+18"),
        ("explore p.toml --port 70000", "whole number: 0 to 65535"),
        ("solve figure5 --tolerance 0", "finite number above 0: 1e-14 to 1"),
    ],
)
def test_the_error_states_the_range(arguments, message, capsys):
    assert main(arguments.split()) == 2
    assert message in capsys.readouterr().err
