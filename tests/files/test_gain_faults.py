"""A table of gains that was edited by hand is read as what it says or refused with every fault, by line and key."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from avc_casadi import InputError
from avc_casadi.cli import main
from avc_casadi.files.coupling_file import read_file

HEADER = "frequency_hz,damping_ns_per_m,stiffness_n_per_m\n"


@pytest.mark.parametrize(
    ("rows", "faults"),
    [
        ("2,1,1\n\n2,1,1\n", [(4, "frequency_hz")]),
        ("3,-1,inf\n4,x,1\n", [(2, "damping_ns_per_m"), (2, "stiffness_n_per_m"), (3, "damping_ns_per_m")]),
        ("5,1\n6,1,1,1\n", [(2, ""), (3, "")]),
        ("", [(None, key) for key in sorted(HEADER.strip().split(","))]),
    ],
)
def test_faults_of_a_csv_name_their_lines(rows, faults, tmp_path):
    path = tmp_path / "gains.csv"
    path.write_text(HEADER + rows)
    with pytest.raises(InputError) as found:
        read_file(path)
    assert sorted((fault.line, fault.key) for fault in found.value.faults) == faults
    assert main(["certify", "soft", str(path)]) == 2


@given(st.text(alphabet='0123456789.,-einfax"\n\0 ', max_size=60))
def test_a_csv_of_any_text_is_read_or_refused(tmp_path_factory, text):
    path = tmp_path_factory.getbasetemp() / "gains.csv"
    path.write_text(HEADER + text)
    refusal = None
    try:
        found = read_file(path)
    except InputError as error:
        refusal = error
    if refusal is not None:
        assert all(fault.message and len(fault.message) < 400 for fault in refusal.faults)
        return
    assert np.isfinite(found.rows).all()
    assert (found.rows >= 0).all()
    assert (np.diff(found.frequency_hz) > 0).all()
