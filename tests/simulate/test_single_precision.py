"""The generated C of every step in single precision follows the double-precision step, for a minute of motion."""

import ctypes
import shutil
import subprocess

import casadi as ca
import numpy as np
import pytest

from avc_casadi.simulation.runtime.adaptation import AdaptationSettings, adaptation_step
from avc_casadi.simulation.runtime.estimators import ESTIMATORS, estimator_step
from avc_casadi.simulation.runtime.guard import GUARDS, GuardSettings, guard_step
from avc_casadi.simulation.runtime.observer import ObserverSettings, observer_step

T = 1e-3
COMPILER = shutil.which("gcc") or shutil.which("cc")
pytestmark = pytest.mark.skipif(COMPILER is None, reason="no C compiler: neither gcc nor cc is on the path")

LOOP = """
void run(int ticks, const float* initial, const float* inputs, const float* parameters, float* outputs) {{
  const float* arg[{arguments}]; float* res[{results}]; float now[{states}], next[{states}], w[{work}];
  long long iw[{integers}];
  for (int i = 0; i < {states}; ++i) now[i] = initial[i];
  for (int tick = 0; tick < ticks; ++tick) {{
    arg[0] = now; arg[1] = inputs + tick * {inputs}; arg[2] = parameters;
    res[0] = next; res[1] = outputs + tick * {outputs};
    {name}(arg, res, iw, w, 0);
    for (int i = 0; i < {states}; ++i) now[i] = next[i];
  }}
}}
"""


def _compiled(step, folder):
    function = step.function
    loop = LOOP.format(
        name=step.name,
        arguments=function.sz_arg(),
        results=function.sz_res(),
        work=max(1, function.sz_w()),
        integers=max(1, function.sz_iw()),
        states=len(step.states),
        inputs=len(step.inputs),
        outputs=len(step.outputs),
    )
    source = folder / "step.c"
    generator = ca.CodeGenerator(step.name, {"casadi_real": "float", "with_header": False, "main": False, "mex": False})
    generator.add(function)
    source.write_text(str(generator.dump()).replace("long long int", "long long") + loop)
    flags = ["-O2", "-ffp-contract=off", "-fsingle-precision-constant", "-fPIC", "-shared"]
    subprocess.run([COMPILER, *flags, str(source), "-o", str(folder / "step.so"), "-lm"], check=True)  # noqa: S603 - a found compiler
    return ctypes.CDLL(str(folder / "step.so")).run


def _in_single(step, inputs, parameters, folder):
    run = _compiled(step, folder)
    columns = np.ascontiguousarray(np.asarray(inputs, dtype=np.float32).T)
    outputs = np.empty((len(columns), len(step.outputs)), dtype=np.float32)
    given = [np.array(step.initial, dtype=np.float32), columns, np.array(parameters, dtype=np.float32), outputs]
    pointers = [array.ctypes.data_as(ctypes.c_void_p) for array in given]
    run(len(columns), *pointers)
    assert np.all(np.isfinite(outputs))
    return dict(zip(step.outputs, outputs.T.astype(float), strict=True))


def _motion(seconds=60.0):
    """A minute of strokes with pauses, on an encoder of 2 um."""
    time = np.arange(round(seconds / T)) * T
    hz = np.where(time % 6 < 4, 2 + 10 * (1 + np.sin(0.7 * time)), 0)
    position = 1e-3 * np.sin(2 * np.pi * T * np.cumsum(hz)) + 0.01
    return 2e-6 * np.round(position / 2e-6)


@pytest.mark.thorough
@pytest.mark.parametrize("method", ESTIMATORS)
def test_estimators(method, tmp_path):
    step = estimator_step(method, T)
    velocity = np.diff(_motion(20.0), prepend=0.01)[None] / T
    exact, single = step.run(velocity), _in_single(step, velocity, [], tmp_path)
    both = (exact["valid"] > 0) & (single["valid"] > 0)
    assert both.mean() > 0.4
    assert np.mean(exact["valid"] != single["valid"]) < 1e-3
    error = np.abs(single["frequency_hz"][both] / exact["frequency_hz"][both] - 1)
    assert np.quantile(error, 0.999) < 1e-3


def test_adaptation(tmp_path):
    step = adaptation_step(T, AdaptationSettings(slew_per_s=50.0))
    position = _motion(60.0) - 0.0095
    rng = np.random.default_rng(0)
    wanted = np.repeat(10.0 ** rng.uniform(3, 5, 60), 1000)
    depth = np.maximum(position, 0)
    rows = {
        "wanted_stiffness_n_per_m": wanted,
        "wanted_damping_ns_per_m": wanted * 1e-3,
        "deflection_m": np.roll(depth, 1) * 0.5,
        "held_force_n": np.roll(depth, 1) * 2e4,
        "position_m": position,
        "touching": position > 0,
    }
    inputs = np.array([np.asarray(rows.get(name, np.zeros(60000)), dtype=float) for name in step.inputs])
    exact, single = step.run(inputs), _in_single(step, inputs, [], tmp_path)
    np.testing.assert_allclose(single["stiffness_n_per_m"], exact["stiffness_n_per_m"], rtol=1e-4)
    force = [found["stiffness_n_per_m"] * (inputs[3] - found["anchor_m"]) for found in (exact, single)]
    assert np.abs(force[0]).max() > 10
    assert np.abs(force[1] - force[0]).max() < 0.01 * np.abs(force[0]).max()


@pytest.mark.parametrize("method", GUARDS)
def test_guards(method, tmp_path):
    step = guard_step(method, T, GuardSettings(damping_limit_ns_per_m=2.0))
    position = _motion(60.0) - 0.01
    depth = np.maximum(position, 0)
    force = 1e4 * depth
    inputs = np.array([force, position, 0.5 * force * depth, np.roll(force, 1)])
    exact, single = step.run(inputs), _in_single(step, inputs, [], tmp_path)
    # Reserves are differences of energies of 10 mJ; where one rounds through 0 the force differs by what it is worth.
    assert np.abs(single["reserve_j"] - exact["reserve_j"]).max() < 1e-4
    assert np.quantile(np.abs(single["force_n"] - exact["force_n"]), 0.99) < 0.01


def test_observer(tmp_path):
    step = observer_step(T, ObserverSettings(resolution_m=2e-5, mass_kg=0.2))
    position = 2e-5 * np.round(_motion(60.0) / 2e-5) - 0.01
    inputs = np.array([position, np.roll(2e3 * np.maximum(position, 0), 1)])
    exact, single = step.run(inputs), _in_single(step, inputs, [], tmp_path)
    assert np.abs(single["position_m"] - exact["position_m"]).max() < 2e-6
    # It never contradicts the encoder.
    assert np.all(np.abs(exact["position_m"] - position) <= 1e-5 * (1 + 1e-9))
