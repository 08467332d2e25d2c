"""Any scene of sound numbers ends in JSON, finite or said to have diverged, or is refused by name: no warning."""

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scene_reference import scene_problem

from avc_casadi import UnsupportedError
from avc_casadi.design.scene_coupling import simulate
from avc_casadi.model.gains import Gains


def decades(low, high):
    return st.floats(low, high).map(lambda power: float(f"{10.0**power:.6g}"))


def table(kind, **keys):
    return st.fixed_dictionaries(keys).map(
        lambda values: "\n".join([f'kind = "{kind}"', *(f"{key} = {value!r}" for key, value in values.items())])
    )


HANDS = table("hand", mass_kg=decades(-4, 1), damping_ns_per_m=decades(-2, 3), stiffness_n_per_m=decades(0, 5)) | table(
    "stylus-hand", mass_kg=decades(-3, 0)
)
WALLS = table("wall") | table("environment")
OTHERS = (
    table("coulomb-friction", force_n=decades(-3, 2)),
    table("viscous-friction", damping_ns_per_m=decades(-2, 2)),
    table("resonance", frequency_hz=decades(0, 3), damping_ratio=decades(-3, 0), mass_ratio=st.floats(0.01, 0.99)),
    table("encoder", resolution_m=decades(-7, -2)),
    table("noise", rms_m=decades(-8, -4), seed=st.integers(0, 9)),
    table("velocity-filter", cutoff_hz=decades(0, 4)),
    table("delay", samples=st.integers(1, 9)),
    table("jitter", rms_s=decades(-6, -2), dropped_share=st.floats(0.01, 0.9)),
    table("amplifier", bandwidth_hz=decades(0, 3.5)),
    table("saturation", force_n=decades(-3, 3)),
)
GAINS = st.builds(
    Gains,
    decades(-2, 4) | st.just(0.0),
    decades(0, 7) | st.sampled_from([0.0, math.inf, math.inf]),
    st.just(0.0) | decades(-1, 3),
)


@st.composite
def scenes(draw):
    chosen = [effect for effect in OTHERS if draw(st.booleans())]
    effects = [draw(HANDS), draw(WALLS), *(draw(effect) for effect in chosen)]
    sample_time = draw(decades(-5, -2))
    head = (
        f"[device]\nmass_kg = {draw(decades(-3, 1))}\ndamping_ns_per_m = {draw(st.just(0.0) | decades(-2, 2))}\n"
        f"sample_time_s = {sample_time}\n[frequency]\nstart_hz = 0.01\nstop_hz = 10.0\n"
        f"[environment]\ndamping_ns_per_m = {draw(st.just(0.0) | decades(-1, 3))}\n"
        f"stiffness_n_per_m = {draw(decades(1, 7))}\n"
    )
    kind = draw(st.sampled_from(["press", "press", "tap", "hold", "stroke", "free"]))
    scene = f"duration_s = {sample_time * draw(st.integers(1, 200))!r}\n"
    return scene_problem(effects, head=head, scene=scene, motion=f'kind = "{kind}"\nstart_m = -1e-5\n')


@pytest.mark.thorough
@settings(max_examples=40)
@given(problem=scenes(), gains=GAINS)
def test_any_scene_ends_in_json(problem, gains):
    run, refusal = None, ""
    try:
        run = simulate(problem, gains)
    except UnsupportedError as refused:
        refusal = str(refused)
    if run is None:
        assert "substeps" in refusal
        return
    document = json.loads(json.dumps(run.document(), allow_nan=False))
    assert run.judgement.diverged or np.isfinite(run.position_m).all()
    assert document["stable"] == (run.claim != "unstable")
    if {"wall"} & {effect.kind for effect in problem.scene.effects} and not document["diverged"]:
        assert (run.force_n >= 0).all()  # a wall never pulls
