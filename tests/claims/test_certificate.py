"""Whatever the gains, a certificate is a document: no exception, no warning, nothing undefined that passes."""

import dataclasses
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from avc_casadi import parse_problem
from avc_casadi.claims.certify import certify
from avc_casadi.model.schedule import Status
from avc_casadi.paper.rendered import gain_schedule


def decades(low, high):
    return st.floats(low, high).map(lambda x: float(10**x))


gain = st.one_of(
    st.sampled_from([0.0, np.inf, -np.inf, np.nan, 5e-324, 1e308, -1e308]),
    decades(-6, 6),
    decades(-300, 300),
    decades(-3, 6).map(lambda x: -x),
)


@pytest.mark.thorough
@settings(max_examples=60)
@given(
    mass=st.one_of(st.just(0.0), decades(-4, 2)),
    b_d=st.one_of(st.just(0.0), decades(-4, 4)),
    sample_time=decades(-5, -1),
    delay=st.sampled_from([0, 1, 2, 20]),
    wall=st.tuples(st.one_of(st.just(0.0), decades(-6, 6)), st.one_of(st.just(0.0), decades(-6, 9))),
    model=st.sampled_from(["paper", "sampled-data"]),
    rows=st.lists(st.tuples(gain, gain, st.one_of(st.just(0.0), decades(-3, 4))), min_size=1, max_size=5),
)
def test_every_table_gets_a_certificate(mass, b_d, sample_time, delay, wall, model, rows):
    n = len(rows)
    values = ", ".join(repr(0.45 / sample_time * (row + 1) / n) for row in range(n))
    problem = parse_problem(
        f"[device]\nmass_kg={mass}\ndamping_ns_per_m={b_d}\nsample_time_s={sample_time}\ndelay_samples={delay}\n"
        f"[environment]\ndamping_ns_per_m={wall[0]}\nstiffness_n_per_m={wall[1]}\n"
        f"[stability]\nmodel='{model}'\n[frequency]\nvalues_hz=[{values}]\n"
    )
    b, k, contact = np.array(rows).T
    one = np.ones(n)
    table = dataclasses.replace(
        gain_schedule(problem, "file", (one, one, 0 * one), (Status.SOLVED,) * n),
        requested_damping_ns_per_m=b,
        requested_stiffness_n_per_m=k,
        contact_damping_ns_per_m=contact,
    )
    certificate = certify(problem, table, requested=True, draws=2)
    json.dumps(certificate.document(), allow_nan=False)
    absent = np.isnan(b) | np.isnan(k)
    for level in certificate.levels.values():
        assert not level.row_passed[absent].any()
        assert not (level.row_passed & np.isnan(level.row_margin_ns_per_m) & (level.level != "L5")).any()
    whole = certificate.levels["L3"].row_passed
    with np.errstate(invalid="ignore"):
        negative = certificate.dc_stiffness_n_per_m < 0
    assert not (whole & negative).any()
