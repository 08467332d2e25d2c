"""A gain file that was edited by hand is read as what it says or refused with every fault, never with a traceback."""

import copy
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from avc_casadi import GainSchedule, InputError, load_problem, solve
from avc_casadi.cli import main
from avc_casadi.files.coupling_file import read_file
from avc_casadi.files.gain_file import gain_csv, gain_document

VALID = {
    structure: gain_document(solve(load_problem(name), method))
    for structure, name, method in (("series", "soft", "closed-form"), ("damped", "damped", "exact"))
}


def short(structure="series", rows=6):
    """Some rows of a real document, with gains and without."""
    document = VALID[structure]
    n = len(document["frequency_hz"])
    kept = np.linspace(0, n - 1, rows).round().astype(int)
    return {
        key: [value[row] for row in kept] if isinstance(value, list) and len(value) == n else value
        for key, value in document.items()
    }


def read(document, folder):
    path = folder / "gains.json"
    path.write_text(json.dumps(document))
    return read_file(path)


def faults(document, folder):
    with pytest.raises(InputError) as found:
        read(document, folder)
    return {(fault.key, fault.message) for fault in found.value.faults}


@pytest.mark.parametrize("structure", VALID)
def test_what_was_written_is_read(structure, tmp_path):
    found = read(VALID[structure], tmp_path)
    written = gain_document(found)
    for key in set(written) - {"seconds", "notes"}:
        assert written[key] == VALID[structure][key], key


def test_the_nyquist_frequency_itself_is_too_high(tmp_path):
    """1/(2 T) at T = 1 ms is 500 Hz, and no row may stand there."""
    document = {"frequency_hz": [1.0, 499.99], "damping_ns_per_m": [1.0, 1.0], "stiffness_n_per_m": [1.0, 1.0]}
    document["sample_time_s"] = 1e-3
    assert read(document, tmp_path).rows == 2
    document["frequency_hz"][1] = 500.0
    (fault,) = faults(document, tmp_path)
    assert fault[0] == "frequency_hz"
    assert "below half the sampling rate, 500 Hz" in fault[1]


def test_a_rigid_request_stays_rigid(tmp_path):
    asked = solve(load_problem("hard/rigid"), "closed-form")
    assert asked.requested_rigid.any()
    again = read(gain_document(asked), tmp_path)
    np.testing.assert_array_equal(again.requested_damping_ns_per_m, asked.requested_damping_ns_per_m)
    np.testing.assert_array_equal(again.requested_stiffness_n_per_m, asked.requested_stiffness_n_per_m)


def spoiled(**changes):
    document = short()
    for key, value in changes.items():
        if isinstance(value, dict):
            for row, item in value.items():
                document[key][row] = item
        elif value is ...:
            del document[key]
        else:
            document[key] = value
    return document


FREE = next(row for row, b in enumerate(short()["damping_ns_per_m"]) if b is not None)


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"sample_time_s": "fast"}, "sample_time_s"),
        ({"sample_time_s": 0}, "sample_time_s"),
        ({"sample_time_s": -1e-3}, "sample_time_s"),
        ({"sample_time_s": 10**400}, "sample_time_s"),
        ({"stiffness_n_per_m": {FREE: 10**400}}, "stiffness_n_per_m"),
        ({"requested_stiffness_n_per_m": {0: 10**400}}, "requested_stiffness_n_per_m"),
        ({"target_re": {0: "x"}}, "target_re"),
        ({"sample_time_s": 1.0}, "frequency_hz"),
        ({"damping_ns_per_m": ...}, "damping_ns_per_m"),
        ({"stiffness_n_per_m": ...}, "stiffness_n_per_m"),
        ({"status": {FREE: "infeasible"}}, "status"),
        ({"status": {FREE: "failed"}}, "status"),
        ({"contact_damping_ns_per_m": {FREE: 1.0}}, "contact_damping_ns_per_m"),
        ({"model": "discrete"}, "model"),
        ({"structure": "parallel"}, "structure"),
        ({"structure": ["series"]}, "structure"),
        ({"frequency_hz": {2: 0.1}}, "frequency_hz"),
        ({"frequency_hz": {2: short()["frequency_hz"][1]}}, "frequency_hz"),
        ({"damping_ns_per_m": {FREE: None}}, "damping_ns_per_m"),
        ({"damping_ns_per_m": {FREE: -1.0}}, "damping_ns_per_m"),
        ({"reason": 3}, "reason"),
        ({"problem": 3}, "problem"),
        ({"method": "direct\x1b[2J"}, "method"),
    ],
    ids=str,
)
def test_one_fault_is_told_under_its_key(changes, key, tmp_path):
    found = faults(spoiled(**changes), tmp_path)
    assert {found_key for found_key, _ in found} == {key}
    assert main(["certify", "soft", str(tmp_path / "gains.json")]) == 2


def test_all_faults_at_once(tmp_path):
    found = faults(
        spoiled(model="x", sample_time_s="x", damping_ns_per_m=..., frequency_hz={1: -1.0}, reason=1), tmp_path
    )
    assert {key for key, _ in found} == {"model", "sample_time_s", "damping_ns_per_m", "frequency_hz", "reason"}


def test_csv_of_a_spreadsheet_begins_with_a_byte_order_mark(tmp_path):
    path = tmp_path / "gains.csv"
    gains = solve(load_problem("soft"), "exact")
    path.write_text(gain_csv(gains), encoding="utf-8-sig")
    np.testing.assert_array_equal(read_file(path).damping_ns_per_m, gains.damping_ns_per_m)


def test_faults_of_a_csv_name_their_lines(tmp_path):
    path = tmp_path / "gains.csv"
    path.write_text("frequency_hz,damping_ns_per_m,stiffness_n_per_m\n2,1,1\n\n2,1,1\n3,-1,inf\n4,x,1\n5,1\n")
    with pytest.raises(InputError) as found:
        read_file(path)
    assert sorted(fault.line for fault in found.value.faults) == [5, 5, 6, 7]


PLANTED = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.sampled_from([10**400, -(10**400), 0, 1e308, 5e-324, float("nan"), float("inf"), "", "paper", "failed"]),
    st.floats(),
    st.text(max_size=4),
    st.lists(st.one_of(st.none(), st.floats(), st.text(max_size=2)), max_size=7),
    st.dictionaries(st.text(max_size=2), st.integers(), max_size=2),
)


@st.composite
def edited(draw):
    document = copy.deepcopy(short(draw(st.sampled_from(["series", "damped"]))))
    for key in draw(st.lists(st.sampled_from(sorted(document)), min_size=1, max_size=4)):
        way = draw(st.sampled_from(["item", "item", "value", "drop", "cut", "swap"]))
        value = document.get(key)
        if isinstance(value, list) and value and way in {"item", "cut", "swap"}:
            row = draw(st.integers(0, len(value) - 1))
            if way == "item":
                value[row] = draw(PLANTED)
            elif way == "cut":
                del value[row]
            else:
                value[0], value[row] = value[row], value[0]
        elif way == "drop":
            document.pop(key, None)
        else:
            document[key] = draw(PLANTED)
    return document


def read_or_refused(reader, *arguments):
    """The gains, or None after a refusal that says something short of each fault."""
    refusal = None
    try:
        return reader(*arguments)
    except InputError as error:
        refusal = error
    assert refusal.faults
    assert all(fault.message and len(fault.message) < 400 for fault in refusal.faults)
    return None


@pytest.mark.thorough
@given(edited())
def test_a_document_edited_at_random_is_read_or_refused(tmp_path_factory, document):
    found = read_or_refused(read, document, tmp_path_factory.getbasetemp())
    if found is None:
        return
    assert isinstance(found, GainSchedule)
    usable = found.usable
    for gain in (found.damping_ns_per_m, found.stiffness_n_per_m):
        np.testing.assert_array_equal(np.isfinite(gain), usable)
        assert (gain[usable] >= 0).all()
    assert (np.diff(found.frequency_hz) > 0).all()
    assert not (found.frequency_hz * found.sample_time_s >= 0.5).any()


@given(st.text(alphabet='0123456789.,-einfax"\n\0 ', max_size=60))
def test_a_csv_of_any_text_is_read_or_refused(tmp_path_factory, text):
    path = tmp_path_factory.getbasetemp() / "gains.csv"
    path.write_text("frequency_hz,damping_ns_per_m,stiffness_n_per_m\n" + text)
    found = read_or_refused(read_file, path)
    assert found is None or isinstance(found, GainSchedule)
