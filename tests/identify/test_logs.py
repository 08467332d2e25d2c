"""Logs in every form and unit give the same record; faults are told all at once, each with its line."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import avc_casadi as avc
from avc_casadi.identification.read import Layout, read_logs

SIZE = 400
TIME = np.arange(SIZE) * 1e-3
POSITION = np.round(2e-3 * np.sin(2 * np.pi * 3 * TIME) / 1e-6) * 1e-6
FORCE = np.sin(2 * np.pi * 5 * TIME)


def csv(path, header="time_s,position_m,force_n", scale=(1.0, 1.0, 1.0), mark=","):
    columns = np.column_stack([TIME * scale[0], POSITION * scale[1], FORCE * scale[2]])
    np.savetxt(path, columns, delimiter=mark, header=header, comments="", fmt="%.9g")
    return path


def same(records):
    (record,) = records
    assert record.sample_time_s == 1e-3
    np.testing.assert_allclose(record.position_m, POSITION, atol=1e-11)
    np.testing.assert_allclose(record.force_n, FORCE, atol=1e-8)


def faults(path, layout=None, **options):
    with pytest.raises(avc.InputError) as refused:
        read_logs([path], layout, **options)
    return refused.value.faults


@pytest.mark.parametrize(
    ("header", "scale", "mark"),
    [
        ("time_s,position_m,force_n", (1, 1, 1), ","),
        ("t_ms;x_um;u_mN", (1e3, 1e6, 1e3), ";"),
        ("time [us]\tpos [mm]\tforce (N)", (1e6, 1e3, 1), "\t"),
        ("t/ms;x/um;F/mN", (1e3, 1e6, 1e3), ";"),
    ],
)
def test_header_says_columns_and_units(tmp_path, header, scale, mark):
    same(read_logs([csv(tmp_path / "a.csv", header, scale, mark)])[0])


def test_a_decimal_comma_is_read_where_nothing_else_has_a_point_and_a_group_of_thousands_is_not(tmp_path):
    path = csv(tmp_path / "a.csv", "time_s;position_m;force_n", mark=";")
    path.write_text(path.read_text().replace(".", ","))
    same(read_logs([path])[0])
    mixed = path.read_text().splitlines()
    mixed[5] = mixed[5].replace(",", ".")
    (tmp_path / "b.csv").write_text("\n".join(mixed))
    assert {fault.key for fault in faults(tmp_path / "b.csv")} == {"time", "position", "force"}
    rows = "\n".join(f"{tick};{tick},000;1" for tick in range(1, 100))
    (tmp_path / "c.csv").write_text(f"time_ms;position_um;force_n\n{rows}\n")
    assert {fault.key for fault in faults(tmp_path / "c.csv")} == {"position"}


def test_the_rows_and_not_the_headers_say_what_stands_between_columns(tmp_path):
    path = csv(tmp_path / "a.csv", "time_s\tposition_m\tforce_n\tnote; of the bench", mark="\t")
    header, *rows = path.read_text().splitlines()
    path.write_text("\n".join([header, *(f"{row}\t0" for row in rows)]))
    same(read_logs([path])[0])


def test_headers_of_a_file_without_rows_are_looked_at_all_the_same(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("time_s,position_furlong,force_n\n")
    assert [(fault.line, fault.key) for fault in faults(path)] == [(1, "position")]


def test_numbers_of_columns_and_units_by_option(tmp_path):
    path = tmp_path / "a.txt"
    np.savetxt(path, np.column_stack([FORCE, TIME * 1e3, POSITION * 1e3]))
    layout = Layout({"time": 2, "position": 3, "force": 1}, {"time": "ms", "position": "mm", "force": "N"})
    same(read_logs([path], layout)[0])


@pytest.mark.parametrize(("sample_time_s", "agrees"), [(1e-3, True), (1.02e-3, True), (2e-3, False), (5e-4, False)])
def test_a_sample_time_replaces_rounded_times_of_the_same_mean_step(tmp_path, sample_time_s, agrees):
    path = tmp_path / "a.csv"
    np.savetxt(path, np.column_stack([np.floor(TIME / 4e-3) * 4e-3, POSITION, FORCE]), delimiter=",", comments="")
    text = path.read_text()
    path.write_text(f"time_s,position_m,force_n\n{text}")
    layout = Layout(sample_time_s=sample_time_s)
    if agrees:
        assert read_logs([path], layout)[0][0].sample_time_s == pytest.approx(sample_time_s)
    else:
        assert {fault.key for fault in faults(path, layout)} == {"time"}


def test_every_fault_of_a_file_with_its_line(tmp_path):
    path = csv(tmp_path / "a.csv")
    lines = path.read_text().splitlines()
    lines[10] = "0.009,what,1.0"
    lines[20] = "0.019,0.001"
    lines[30] = "0.029,0.001,nothing"
    path.write_text("\n".join(lines))
    found = faults(path)
    assert [(fault.line, fault.key) for fault in found] == [(11, "position"), (21, ""), (31, "force")]


def test_time_that_goes_back_and_values_that_are_not_finite(tmp_path):
    path = csv(tmp_path / "a.csv")
    lines = path.read_text().splitlines()
    lines[50] = "0.001,0.001,1.0"
    path.write_text("\n".join(lines))
    assert any(fault.line == 51 and fault.key == "time" for fault in faults(path))
    for row in range(50, 60):
        lines[row] = f"{1e-3 * (row - 1):g},nan,1.0"
    path.write_text("\n".join(lines))
    found = faults(path)
    assert [(fault.line, fault.key) for fault in found] == [(51, "position")]
    assert "9 more such rows, to line 60" in found[0].message


@pytest.mark.parametrize("row", ["0.249,nan,1.0", "0.249,,", None])
def test_a_lost_sample_is_a_gap(tmp_path, row):
    """Of a row that is not there, or holds no number, the rest of the log tells as much as before."""
    path = csv(tmp_path / "a.csv")
    lines = path.read_text().splitlines()
    lines[250:251] = [] if row is None else [row]
    path.write_text("\n".join(lines))
    records, told = read_logs([path])
    assert told
    assert [record.position_m.size for record in records] == [249]


@pytest.mark.parametrize(
    ("header", "said"),
    [
        ("time_s,position,force_n", "has no unit"),
        ("time_s,position_furlong,force_n", "unit that is not known"),
        ("time_s,position_m,position_m", "2 columns"),
        ("a,b,c", "has no column"),
    ],
)
def test_units_are_never_guessed(tmp_path, header, said):
    assert any(said in fault.message and fault.line == 1 for fault in faults(csv(tmp_path / "a.csv", header)))


def test_missing_ticks_cut_a_log_into_records(tmp_path):
    path = tmp_path / "a.npz"
    keep = np.r_[0:210, 215:SIZE]
    np.savez(
        path,
        about=np.array({}, dtype=object),
        time_s=np.r_[TIME[keep], 1.0 + TIME],
        position_m=np.r_[POSITION[keep], POSITION],
        force_n=np.r_[FORCE[keep], FORCE],
    )
    records, told = read_logs([path])
    assert [record.position_m.size for record in records] == [210, SIZE]
    assert "gaps" in told[0]


@given(
    period=st.floats(2e-4, 0.02),
    scale=st.sampled_from([("s", 1.0), ("ms", 1e3), ("us", 1e6)]),
    length=st.sampled_from([("m", 1.0), ("mm", 1e3), ("um", 1e6)]),
    mark=st.sampled_from([",", ";", "\t"]),
    lost=st.integers(0, 3),
)
def test_any_layout_reads_as_the_same_record(tmp_path_factory, period, scale, length, mark, lost):
    """Whatever units, delimiter and rows are missing, what is read is what was written."""
    path = tmp_path_factory.mktemp("log") / "a.csv"
    clock = np.arange(SIZE) * period
    rows = np.column_stack([clock * scale[1], POSITION * length[1], FORCE])
    rows = np.delete(rows, [10 + 3 * row for row in range(lost)], axis=0)
    header = mark.join([f"time_{scale[0]}", f"position_{length[0]}", "force_N"])
    np.savetxt(path, rows, delimiter=mark, header=header, comments="", fmt="%.12g")
    (record, *_), _ = read_logs([path])
    assert record.sample_time_s == pytest.approx(period, rel=1e-4)
    np.testing.assert_allclose(record.position_m[-200:], POSITION[-200:], atol=1e-11)
    np.testing.assert_allclose(record.force_n[-200:], FORCE[-200:], atol=1e-9)
