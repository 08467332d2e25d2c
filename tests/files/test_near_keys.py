"""A key that its table has not: the hint leads to a key that exists there, to the table that has it, or to none."""

import re

import pytest

import avc_casadi as avc
from avc_casadi.model.problem import Problem

DEVICE = {"mass_kg": 0.1, "damping_ns_per_m": 1.0}
WALL = {"stiffness_n_per_m": 500.0, "damping_ns_per_m": 1.0}
ROTARY = {"motion": "rotary", "handle_radius_m": 0.1, "inertia_kgm2": 1e-3, "damping_nms_per_rad": 1e-3}
ROTARY_WALL = {"stiffness_nm_per_rad": 1.0, "damping_nms_per_rad": 0.0}
LINEAR = {"device": DEVICE, "environment": WALL}
TURNING = {"device": ROTARY, "environment": ROTARY_WALL}


def toml(tables):
    """Return a file; keys without a table come first."""
    lines = [f"{key} = {value!r}" for key, value in tables.items() if not isinstance(value, dict)]
    for name, table in tables.items():
        if isinstance(table, dict):
            lines += [f"[{name}]", *(f"{key} = {value!r}" for key, value in table.items())]
    return "\n".join(lines)


def message_of(key, **tables):
    """Return what is said of a key of a file."""
    with pytest.raises(avc.InputError) as refused:
        avc.parse_problem(toml(tables))
    (message,) = (fault.message for fault in refused.value.faults if fault.key == key)
    return message


def hint_of(key, **tables):
    """Return the hint, empty where there is none."""
    return message_of(key, **tables).partition("did you mean ")[2].removesuffix("?")


@pytest.mark.parametrize(
    ("key", "value", "hint"),
    [
        ("motion", "rotary", "motion in [device] or [follower]"),
        ("motoin", "rotary", "motion in [device] or [follower]"),
        ("sample_time_s", 1e-3, "sample_time_s in [device] or [follower]"),
        ("max_force_n", 8.0, "max_force_n in [device] or [follower]"),
        ("step_s", 1e-3, "step_s in [simulation]"),
        ("velocity", "kalman", "velocity in [law]"),
        ("scope", "hands", "scope in [stability]"),
        ("cutoff_hz", 100.0, "cutoff_hz in [law.velocity]"),
        # Of the tables with a stiffness no few are likelier than the others.
        ("stiffness_n_per_m", 100.0, ""),
        ("devise", "hapkit", "device"),
        ("zzz", 1.0, ""),
    ],
)
def test_a_key_outside_of_its_table_leads_to_the_table_that_has_it(key, value, hint):
    assert hint_of(key, **{key: value}, device=DEVICE, environment=WALL) == hint


@pytest.mark.parametrize(
    ("name", "hint"),
    [("devise", "device"), ("enviroment", "environment"), ("hand", "hands"), ("simulate", "simulation")],
)
def test_a_mistyped_table_leads_to_a_table(name, hint):
    tables = {"device": DEVICE, "environment": WALL}
    tables = {(name if table == hint else table): keys for table, keys in tables.items()}
    assert hint_of(name, **tables | {name: tables.get(name, {})}) == hint


@pytest.mark.parametrize(
    ("table", "key", "value", "hint"),
    [
        ("environment", "delay_samples", 1, "delay_samples in [device] or [follower]"),
        ("environment", "stifness_n_per_m", 1.0, "stiffness_n_per_m"),
        ("law", "sample_time_s", 1e-3, "sample_time_s in [device] or [follower]"),
        ("law", "k", 1.0, "stiffness_n_per_m"),
        ("law", "k_n_per_m", 1.0, "stiffness_n_per_m"),
        ("law", "b_ns_per_m", 1.0, "damping_ns_per_m"),
        ("device", "rate_divider", 2, "rate_divider in [law]"),
        ("device", "max_force", 2.0, "max_force_n"),
        ("device", "stiffness_n_per_m", 1.0, ""),
        ("hands", "motion", "rotary", "motion in [device] or [follower]"),
    ],
)
def test_a_key_in_a_wrong_table_leads_to_the_right_one(table, key, value, hint):
    tables = {"device": DEVICE, "environment": WALL}
    tables[table] = {**tables.get(table, {}), key: value}
    assert hint_of(f"{table}.{key}", **tables) == hint


@pytest.mark.parametrize(
    ("table", "key", "hint"),
    [
        ("", "inertia_kgm2", "inertia_kgm2 in [device] or [follower]"),
        ("", "encoder_counts_per_turn", "encoder_counts_per_turn in [device]"),
        ("environment", "max_torque_nm", "max_torque_nm in [device] or [follower]"),
        ("device", "encoder_count_per_turn", "encoder_counts_per_turn"),
    ],
)
def test_a_hint_has_the_keys_of_a_device_that_turns(table, key, hint):
    tables = {"device": ROTARY, "environment": ROTARY_WALL}
    tables |= {table: {**tables[table], key: 1000.0}} if table else {key: 1000.0}
    assert hint_of(f"{table}.{key}".removeprefix("."), **tables) == hint


def test_a_key_of_another_kind_of_the_same_table_does_not_lead_back_to_that_table():
    text = toml(LINEAR) + '\n[law]\nstiffness_n_per_m = 1\nvelocity = { kind = "window", samples = 3, cutoff_hz = 9 }\n'
    with pytest.raises(avc.InputError) as refused:
        avc.parse_problem(text)
    (fault,) = refused.value.faults
    assert "did you mean" not in fault.message


@pytest.mark.parametrize(
    ("tables", "table", "key", "value", "text"),
    [
        (LINEAR, "device", "mass_g", 120, 'mass_kg = "120 g"'),
        (LINEAR, "device", "mass_lb", 0.5, 'mass_kg = "0.5 lb"'),
        (LINEAR, "device", "encoder_resolution_mm", 0.02, 'encoder_resolution_m = "0.02 mm"'),
        (LINEAR, "device", "encoder_resolution_dpi", 450, 'encoder_resolution_m = "450 dpi"'),
        (LINEAR, "device", "sample_time_ms", 1, 'sample_time_s = "1 ms"'),
        (LINEAR, "device", "sample_rate_hz", 1000.0, 'sample_time_s = "1000 Hz"'),
        (LINEAR, "device", "delay_ms", 2, 'delay_samples = "2 ms"'),
        (LINEAR, "device", "delay_s", 0.002, 'delay_samples = "0.002 s"'),
        (LINEAR, "device", "amplifier_bandwidth_khz", 1.5, 'amplifier_bandwidth_hz = "1.5 kHz"'),
        (LINEAR, "environment", "stiffness_n_per_mm", 3, 'stiffness_n_per_m = "3 N/mm"'),
        (LINEAR, "environment", "stiffness_kn_per_m", 3, 'stiffness_n_per_m = "3 kN/m"'),
        (LINEAR, "environment", "damping_ns_per_mm", 0.02, 'damping_ns_per_m = "0.02 N.s/mm"'),
        (LINEAR, "hands", "mass_g", [50, 300], 'mass_kg = ["50 g", "300 g"]'),
        (LINEAR, "device", "mass_g", 123456.75, 'mass_kg = "123456.75 g"'),
        (LINEAR, "device", "mass_g", "120 g", 'mass_kg = "120 g"'),
        (LINEAR, "device", "mass_g", 10**400, 'mass_kg = "1 g"'),
        (LINEAR, "device", "encoder_resolution_deg", 0.1, ""),
        (TURNING, "device", "inertia_gcm2", 120, 'inertia_kgm2 = "120 g.cm2"'),
        (TURNING, "device", "encoder_resolution_deg", 0.1, 'encoder_resolution_rad = "0.1 deg"'),
        (TURNING, "device", "damping_mnms_per_rad", 3, 'damping_nms_per_rad = "3 mN.m.s/rad"'),
        (TURNING, "device", "max_torque_ncm", 3, 'max_torque_nm = "3 N.cm"'),
        (TURNING, "environment", "stiffness_mnm_per_rad", 3, 'stiffness_nm_per_rad = "3 mN.m/rad"'),
        (TURNING, "device", "mass_g", 120, ""),
    ],
)
def test_a_key_in_another_unit_leads_to_the_text_to_write(tables, table, key, value, text):
    stated = {**tables, table: {**tables.get(table, {}), key: value}}
    assert hint_of(f"{table}.{key}", **stated) == text


@pytest.mark.parametrize(
    ("table", "key", "linear"),
    [
        ("device", "inertia_kgm2", "mass_kg"),
        ("device", "max_torque_nm", "max_force_n"),
        ("environment", "stiffness_nm_per_rad", "stiffness_n_per_m"),
        ("simulation", "tool_inertia_kgm2", "tool_mass_kg"),
        ("follower", "inertia_kgm2", "mass_kg"),
    ],
)
def test_a_key_of_a_device_that_turns_leads_to_the_motion_that_is_missing(table, key, linear):
    tables = {**LINEAR, table: {**LINEAR.get(table, {}), key: 1.0}}
    assert hint_of(f"{table}.{key}", **tables) == f'motion = "rotary" in [device], or {linear}'


@pytest.mark.parametrize("name", list(Problem.model_fields["device"].annotation.model_fields))
def test_no_key_of_a_device_at_the_top_of_a_file_leads_to_another_key(name):
    message = message_of(name, **{name: 1.0}, device=DEVICE, environment=WALL)
    hint = message.partition("did you mean ")[2]
    assert not hint or re.match(rf"{name} in \[", hint)
