"""The fast estimator where its half periods are regular, the robust one where they are not."""

from __future__ import annotations

from avc_casadi.runtime._signal import EstimatorSettings
from avc_casadi.runtime._spectral_peak import spectral_peak_step
from avc_casadi.runtime._step import Step, StepBuilder
from avc_casadi.runtime._zero_crossing import zero_crossing_step

# Estimates closer than this share agree.
_AGREE = 0.05
# No half period of the true frequency is longer than this many of its own.
_LONGEST_HALVES = 1.5


def fused_step(sample_time_s: float, settings: EstimatorSettings) -> Step:
    """The spectral peak, unless regular zero crossings contradict it: then the resonators have not settled yet.

    A harmonic that adds crossings makes the half periods irregular, so that the spectral peak decides; a step in
    frequency leaves them regular after two or three, long before the resonators have settled.

    Args:
        sample_time_s: T.
        settings: what is taken for motion.

    Returns:
        velocity_m_per_s -> frequency_hz (0 where not valid), valid.
    """
    import casadi as ca  # noqa: PLC0415

    builder = StepBuilder()
    velocity = builder.input("velocity_m_per_s")
    fast = builder.insert("fast", zero_crossing_step(sample_time_s, settings), [velocity])
    robust = builder.insert("robust", spectral_peak_step(sample_time_s, settings), [velocity])
    quick, steady = fast["frequency_hz"], robust["frequency_hz"]
    apart = ca.fabs(quick - steady) > _AGREE * steady
    # Harmonics add crossings and never take any away: two equal half periods that are longer are enough.
    slower = ca.logic_and(fast["even"], quick < steady)
    trusted = ca.logic_and(apart, ca.logic_or(fast["regular"], slower))
    take_fast = ca.logic_or(trusted, ca.logic_not(robust["valid"]))
    bound = _LONGEST_HALVES * 0.5 / ca.fmax(fast["longest_half_s"], sample_time_s)
    builder.output("frequency_hz", ca.if_else(take_fast, quick, ca.fmin(steady, bound)))
    builder.output("valid", ca.logic_or(fast["valid"], robust["valid"]))
    return builder.done("fused")
