"""Bounds that were measured take the place of springs and dampers: read, interpolated, with their uncertainty."""

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reference_optimum import NUMBERS

import avc_casadi as avc
from avc_casadi.files.plausibility import plausibility
from avc_casadi.files.problem_document import problem_document, problem_of
from avc_casadi.model.measured_bounds import MeasuredBounds, MeasuredImpedance
from avc_casadi.paper.equations import SampleAngle, environment_impedance
from avc_casadi.paper.loop import loop_at
from avc_casadi.paper.numbers import NUMPY
from avc_casadi.paper.realism import bound_magnitudes, judge_realism

FIGURE5 = avc.load_problem("figure5")
FREQUENCY = FIGURE5.frequencies_hz()
WITHOUT_BOUNDS = avc.dump_problem(FIGURE5).partition("[boundaries.upper]")[0]


def response(frequency_hz, impedance, error=None):
    """What a measurement of an impedance gives."""
    parts = {"real_ns_per_m": impedance.real.tolist(), "imag_ns_per_m": impedance.imag.tolist()}
    return {"frequency_hz": list(frequency_hz), **parts, **({} if error is None else {"error_ns_per_m": list(error)})}


def rendered(bound):
    """A bound of the catalogue as the paper's model has it."""
    angle = SampleAngle.at(NUMPY, FREQUENCY, FIGURE5.device.sample_time_s)
    return environment_impedance(angle, "paper", bound.damping_ns_per_m, bound.stiffness_n_per_m)


def measured(error=None):
    bounds = FIGURE5.boundaries
    found = {side: response(FREQUENCY, rendered(getattr(bounds, side)), error) for side in ("upper", "lower")}
    return FIGURE5.changed(boundaries={"measured": found})


@pytest.mark.thorough
@pytest.mark.parametrize("method", ["closed-form", "direct", "exact", "schedule", "static"])
def test_every_method_takes_them_as_it_takes_springs_and_dampers(method):
    by_file, by_numbers = avc.solve(measured(), method), avc.solve(FIGURE5, method)
    assert by_file.status == by_numbers.status
    np.testing.assert_allclose(by_file.target, by_numbers.target, rtol=1e-12)
    np.testing.assert_allclose(by_file.magnitude_error, by_numbers.magnitude_error, rtol=1e-6, atol=1e-6)


def test_the_goal_is_their_mean_in_every_number_system():
    problem = measured()
    loop = loop_at(problem, FREQUENCY)
    expected = (rendered(FIGURE5.boundaries.upper) + rendered(FIGURE5.boundaries.lower)) / 2
    np.testing.assert_allclose(loop.desired, expected, rtol=1e-14)
    np.testing.assert_allclose(loop.desired_gap, loop.environment - expected, rtol=1e-9)
    with mpmath.workdps(30):
        exact = loop_at(problem, mpmath.mpf(FREQUENCY[7]), NUMBERS).target
    assert complex(exact.real, exact.imag) == pytest.approx(loop.target[7], rel=1e-13)


def test_between_two_points_both_parts_go_straight_over_the_logarithm_of_frequency():
    one = MeasuredImpedance(
        frequency_hz=(1.0, 100.0), real_ns_per_m=(2.0, 4.0), imag_ns_per_m=(-10.0, 0.0), error_ns_per_m=(0.0, 1.0)
    )
    assert one.at(10.0) == pytest.approx(3.0 - 5.0j)
    assert one.error_at(10.0) == pytest.approx(0.5)
    other = MeasuredImpedance(frequency_hz=(2.0, 50.0), real_ns_per_m=(1.0, 1.0), imag_ns_per_m=(-1.0, -1.0))
    assert MeasuredBounds(upper=one, lower=other).range_hz == (2.0, 50.0)


@given(st.floats(0.1, 1e3), st.floats(1.0, 1e6), st.floats(0.1, 10.0), st.floats(11.0, 400.0), st.integers(2, 40))
def test_the_nearest_spring_and_damper_of_one_is_itself(damping, stiffness, low, high, points):
    frequency = np.geomspace(low, high, points)
    found = MeasuredImpedance(**response(frequency, damping + stiffness / (2j * np.pi * frequency)))
    assert found.spring_and_damper()["damping_ns_per_m"] == pytest.approx(damping, rel=1e-6)
    assert found.spring_and_damper()["stiffness_n_per_m"] == pytest.approx(stiffness, rel=1e-6)


@settings(max_examples=30)
@given(st.integers(0, 10_000))
def test_what_counts_as_real_is_so_whatever_the_bounds_are_within_their_errors(seed):
    rng = np.random.default_rng(seed)
    error = np.abs(rendered(FIGURE5.boundaries.lower)) * rng.uniform(0, 0.2)
    problem = measured(error)
    loop = loop_at(problem, FREQUENCY)
    low, high = bound_magnitudes(problem, loop)
    z = rng.uniform(0.7, 1.3, len(FREQUENCY)) * np.abs(loop.target)
    inside = judge_realism(problem, z.astype(complex)).inside_bounds
    assert (inside == ((z >= low) & (z <= high))).mean() > 0.99
    ends = []
    for side in ("upper", "lower"):
        turned = np.exp(2j * np.pi * rng.random(len(FREQUENCY)))
        bound = rendered(getattr(FIGURE5.boundaries, side)) + rng.random() * error * turned
        ends.append(np.abs(loop.device + loop.hold * bound))
    slack = 1e-9 * z
    assert (z[inside] >= np.min(ends, axis=0)[inside] - slack[inside]).all()
    assert (z[inside] <= np.max(ends, axis=0)[inside] + slack[inside]).all()


def test_files_of_any_form_mean_the_same(tmp_path):
    frequency = np.geomspace(1, 450, 30)
    z = {"upper": 11 + 1.1e5 / (2j * np.pi * frequency), "lower": 7 + 0.8e5 / (2j * np.pi * frequency)}
    forms = {
        "a.csv": ("f (Hz),Re,Im\n", ",", lambda v: (v.real, v.imag)),
        "b.csv": ("# of 2026\nfrequency_hz; magnitude; phase_deg\n", "; ", lambda v: (abs(v), np.degrees(np.angle(v)))),
        "c.csv": ("Hz\tMag\tphase_rad\tError\n", "\t", lambda v: (abs(v), np.angle(v), 0.5)),
    }
    found = []
    for name, (header, mark, columns) in forms.items():
        for side, values in z.items():
            rows = [
                mark.join(f"{value:.17g}" for value in (f, *columns(v))) + " # of 3\n"
                for f, v in zip(frequency, values, strict=True)
            ]
            (tmp_path / f"{side}-{name}").write_text(header + "".join(rows[::-1]), encoding="utf-8")
        table = f'[boundaries]\nmeasured = {{ upper = "upper-{name}", lower = "lower-{name}" }}\n'
        problem = avc.parse_problem(WITHOUT_BOUNDS + table, folder=tmp_path)
        found.append(problem.boundaries.measured)
        assert problem.boundaries.upper.stiffness_n_per_m == pytest.approx(1.1e5)
        assert avc.parse_problem(avc.dump_problem(problem)) == problem
        assert problem_of(problem_document(problem)) == problem
    for other in found[1:]:
        np.testing.assert_allclose(other.upper.at(FREQUENCY), found[0].upper.at(FREQUENCY), rtol=1e-12)
        np.testing.assert_allclose(other.lower.at(FREQUENCY), found[0].lower.at(FREQUENCY), rtol=1e-12)
    assert found[2].upper.error_at(30.0) == 0.5


@pytest.mark.parametrize(
    ("upper", "told"),
    [
        ("", ["upper.csv: is empty"]),
        ("f,Re\n1,2\n", ["upper.csv:1: has columns f, re; allowed: a header with f and Re, Im"]),
        ("f,Re,Im\n1,2,x\n2,3\n500,1,1\n", ["upper.csv:2: is '1,2,x'", "upper.csv:3: is '2,3'"]),
        ("f,Re,Im\n1,2,-3\n450,nan,-3\n", ["upper.csv:3: holds a value that is not finite"]),
        ("f,Re,Im\n1,2,-3\n", ["boundaries.measured.upper: has columns of 1, 1, 1, 1 points"]),
        ("f,magnitude,phase_rad\n1,3,-1.4\n450,3,-85\n", ["upper.csv:3: phase_rad: is -85", "or phase_deg"]),
        ("f,Re,Im\n1,2,-3\n1,2,-3\n", ["frequencies that do not rise"]),
        (
            "f,Re,Im\n2,2,-3\n450,2,-3\n",
            ["frequency: asks for 1 to 450 Hz, but [boundaries] are measured from 2 to 450 Hz"],
        ),
        (None, ["upper.csv: does not exist"]),
    ],
)
def test_what_is_wrong_with_a_file_is_told_with_its_line(tmp_path, upper, told):
    if upper is not None:
        (tmp_path / "upper.csv").write_text(upper, encoding="utf-8")
    (tmp_path / "lower.csv").write_text("f,Re,Im\n1,2,-3\n450,2,-3\n", encoding="utf-8")
    table = '[boundaries]\nmeasured = { upper = "upper.csv", lower = "lower.csv" }\n'
    with pytest.raises(avc.InputError) as caught:
        avc.parse_problem(WITHOUT_BOUNDS + table, folder=tmp_path)
    for words in told:
        assert words in str(caught.value)
    assert "boundaries.upper: is missing" not in str(caught.value)


def test_bounds_in_another_unit_than_impedance_are_doubted(tmp_path):
    """Stiffness in place of impedance is 2 pi f times as much."""
    for side, factor in (("upper", 1.1), ("lower", 0.9)):
        rows = "".join(f"{f},1,{-1e5 * factor}\n" for f in (1, 30, 450))
        (tmp_path / f"{side}.csv").write_text(f"f [Hz],Re [N.s/m],Im [N.s/m]\n{rows}", encoding="utf-8")
    table = '[boundaries]\nmeasured = { upper = "upper.csv", lower = "lower.csv" }\n'
    doubt, *_ = plausibility(avc.parse_problem(WITHOUT_BOUNDS + table, folder=tmp_path))
    assert doubt.key == "boundaries.measured"
    assert "times the impedance of the wall at 21.2 Hz; is it in N.s/m?" in doubt.message
    assert not plausibility(measured())


def test_the_printed_closed_form_needs_springs_and_dampers():
    with pytest.raises(avc.UnsupportedError, match="measured"):
        avc.solve(measured(), "closed-form", as_printed=True)


def test_bounds_the_wrong_way_round_and_columns_in_the_wrong_order_are_refused():
    upper, lower = (response(FREQUENCY, rendered(getattr(FIGURE5.boundaries, side))) for side in ("upper", "lower"))
    with pytest.raises(avc.InputError, match=r"\|upper\| below \|lower\| over 100 %"):
        FIGURE5.changed(boundaries={"measured": {"upper": lower, "lower": upper}})
    swapped = upper | {"real_ns_per_m": upper["imag_ns_per_m"], "imag_ns_per_m": upper["real_ns_per_m"]}
    with pytest.raises(avc.InputError, match="real part far below 0 at 200 of 200"):
        FIGURE5.changed(boundaries={"measured": {"upper": swapped, "lower": lower}})


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        (lambda z: z, ""),
        (np.conj, "is the sign of Im, or the unit of the phase, right?"),
        (lambda z: np.abs(z) * np.exp(1j * np.radians(np.angle(z))), "is the sign of Im, or the unit"),
    ],
)
def test_a_phase_that_does_not_belong_to_its_size_is_doubted(changed, said):
    spring = -1e5j / (2 * np.pi * FREQUENCY)
    bounds = {
        side: response(FREQUENCY, changed(1 + share * spring)) for side, share in (("upper", 1.2), ("lower", 0.8))
    }
    told = [one.message for one in plausibility(FIGURE5.changed(boundaries={"measured": bounds}))]
    assert (said in told[0]) if said else not any("phase" in one for one in told)


def test_errors_above_what_was_measured_are_doubted():
    sizes = np.abs(rendered(FIGURE5.boundaries.upper))
    told = [one.message for one in plausibility(measured(5 * sizes))]
    assert any("has errors above |Z| at 100 %" in one for one in told)
