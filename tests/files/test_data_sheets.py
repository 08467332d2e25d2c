"""Values in the words of a data sheet become those of the file, or a fault that says what to write."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

import avc_casadi as avc
from avc_casadi.files.problem_file import as_problem

WALL = "[environment]\nstiffness_{k} = 1.0\ndamping_{b} = 0.0\n"
LINEAR = "[device]\nmass_kg = 0.1\ndamping_ns_per_m = 0.0\n{key} = {value}\n" + WALL.format(k="n_per_m", b="ns_per_m")
ROTARY = (
    '[device]\nmotion = "rotary"\nhandle_radius_m = 0.05\ninertia_kgm2 = 1e-4\ndamping_nms_per_rad = 0.0\n'
    "{key} = {value}\n" + WALL.format(k="nm_per_rad", b="nms_per_rad")
)
TURN = 2 * math.pi


@pytest.mark.parametrize(
    ("sheet", "key", "typed", "attribute", "value"),
    [
        (LINEAR, "mass_kg", "45 g", "mass_kg", 0.045),
        (LINEAR, "max_force_n", "3.3 N", "max_force_n", 3.3),
        (LINEAR, "encoder_resolution_m", "450 dpi", "encoder_resolution_m", 0.0254 / 450),
        (LINEAR, "encoder_resolution_m", "4000 counts per 10 mm", "encoder_resolution_m", 2.5e-6),
        (LINEAR, "encoder_resolution_m", "4096 counts, pitch 5 mm", "encoder_resolution_m", 5e-3 / 4096),
        (LINEAR, "max_force_n", "0.2 N.m, pitch 5 mm", "max_force_n", 0.2 * TURN / 5e-3),
        (LINEAR, "mass_kg", "50 g.cm2, pitch 10 mm", "mass_kg", 5e-6 * (TURN / 1e-2) ** 2),
        (ROTARY, "inertia_kgm2", "300 gcm2", "mass_kg", 3e-5),
        (ROTARY, "max_torque_nm", "12 N.cm", "max_force_n", 0.12),
        (ROTARY, "max_torque_nm", "90 mNm, gear 30:1", "max_force_n", 2.7),
        (ROTARY, "inertia_kgm2", "50 g.cm2, gear 10", "mass_kg", 5e-4),
        (ROTARY, "encoder_resolution_rad", "0.088 deg", "encoder_resolution_m", math.radians(0.088)),
        (ROTARY, "encoder_resolution_rad", "14-bit", "encoder_resolution_m", TURN / 2**14),
        (ROTARY, "encoder_resolution_rad", "2000 CPR, gear 4", "encoder_resolution_m", TURN / 8000),
        (ROTARY, "encoder_counts_per_turn", 4096, "encoder_resolution_m", TURN / 4096),
        (ROTARY, "sample_time_s", "1 kHz", "sample_time_s", 1e-3),
        (ROTARY, "handle_radius_m", "150 mm", "handle_radius_m", 0.15),
    ],
)
def test_a_value_of_a_sheet_is_the_value_of_the_file(sheet, key, typed, attribute, value):
    written = f'"{typed}"' if isinstance(typed, str) else typed
    lines = [line for line in sheet.splitlines() if not line.startswith(f"{key} =")]
    found = avc.parse_problem("\n".join(lines).format(key=key, value=written)).device
    assert getattr(found, attribute) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize(
    ("sheet", "key", "value", "write"),
    [
        (LINEAR, "max_force_kn", "0.002", "did you mean max_force_n?"),
        (LINEAR, "encoder_resolution_um", "55", "did you mean encoder_resolution_m?"),
        (LINEAR, "encoder_resolution_dpi", "450", "allowed: "),
        (LINEAR, "sample_rate_hz", "2000", "did you mean sample_time_s?"),
        (LINEAR, "max_torque_nm", "0.2", "did you mean max_force_n?"),
        (LINEAR, "max_force_n", '"12 N.cm"', "allowed: a number"),
        (ROTARY, "max_torque_ncm", "12", "did you mean max_torque_nm?"),
        (ROTARY, "max_torque_mnm", "85", "did you mean max_torque_nm?"),
        (ROTARY, "encoder_resolution_deg", "0.1", "did you mean encoder_resolution_rad?"),
        (ROTARY, "max_force_n", "8", "max_torque_nm"),
        (ROTARY, "coulomb_friction_nm", '"2 N"', "allowed: a number"),
    ],
)
def test_a_value_under_a_wrong_key_or_unit_says_what_to_write(sheet, key, value, write):
    with pytest.raises(avc.InputError) as refused:
        avc.parse_problem(sheet.format(key=key, value=value))
    (fault,) = refused.value.faults
    assert (fault.key, write in fault.message) == (f"device.{key}", True), fault


PLANTED = st.one_of(
    st.none(),
    st.booleans(),
    st.sampled_from([-1, 0, 1, 2, 10**400, 0.5, math.nan, "1 kg", "rotary", "handle", [0.1, 0.2], [2, 1], {}, [{}]]),
    st.floats(),
    st.text(max_size=3),
)


KEYS = [*avc.Problem.model_fields, "motion", "mass_kg", "range", "values_hz", "stop_hz", "step_s", "kind", "effects"]
KEYS += ["handle_radius_m", "encoder_counts_per_turn", "inertia_kgm2", "damping_ns_per_m", "stiffness_n_per_m"]


@given(
    st.dictionaries(
        st.sampled_from(sorted(avc.Problem.model_fields)),
        st.one_of(PLANTED, st.dictionaries(st.sampled_from(KEYS), PLANTED)),
    )
)
def test_any_tables_are_a_problem_or_refused_by_key(tables):
    refusal = None
    try:
        as_problem(tables)
    except avc.InputError as error:
        refusal = error
    assert refusal is None or all(fault.key and fault.message for fault in refusal.faults)
