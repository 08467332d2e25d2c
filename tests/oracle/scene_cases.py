"""Scenes that every way of integrating must agree on: each effect alone, and together."""

import math

from avc_casadi.model.gains import NO_COUPLING, Gains

HAND, WALL = 'kind = "hand"', 'kind = "wall"'
FRICTION = 'kind = "coulomb-friction"'
SERIES, SOFT, DAMPED = Gains(200.0, 1e5), Gains(10.0, 7e3), Gains(math.inf, math.inf, 80.0)
# A mass of 0.15 kg under the force asked for, with the push of the hand as a state.
FEEDBACK = (
    'kind = "state-feedback"\nstate = [[1.0, 1.0, 0.5], [0.0, 0.98, 1.0], [0.0, 0.0, 1.0]]\n'
    "force_m_per_n = [-3.3e-6, -6.6e-6, 0.0]\ninnovation = [0.4, 0.08, 0.003]\nfeedback = [1.0, 3.0, 0.2]\n"
    "positions = [0]\ndead_zone_m = 1.5e-5\nface_m = 1e-5"
)
OPENING = FEEDBACK + "\nopens_m = 1.5e-5\nopen_m = 6e-5\nkept = 0.99\nsmoothing = 0.9"
QUICK = 'kind = "press"\nspeed_m_per_s = 0.2\nstart_m = -0.002\n'

CASES = {
    "linear-series": ((HAND, WALL), SERIES),
    "linear-soft": ((HAND, WALL), SOFT),
    "linear-damped": ((HAND, WALL), DAMPED),
    "series-and-damped": ((HAND, WALL), Gains(50.0, 2e4, 30.0)),
    "no-coupling-soft-wall": ((HAND, 'kind = "wall"\nstiffness_n_per_m = 2000.0\ndamping_ns_per_m = 1.0'), NO_COUPLING),
    "gains-zero": ((HAND, WALL), Gains(0.0, 0.0)),
    "no-wall": ((HAND,), NO_COUPLING),
    "two-sided": ((HAND, 'kind = "environment"\nstiffness_n_per_m = 3000.0'), Gains(20.0, 1e4)),
    "pure-damper": ((HAND, 'kind = "environment"\nstiffness_n_per_m = 0.0\ndamping_ns_per_m = 8.0'), Gains(20.0, 1e4)),
    "dry-friction": ((HAND, WALL, FRICTION), SERIES),
    "much-friction": ((HAND, WALL, 'kind = "coulomb-friction"\nforce_n = 1.5'), DAMPED),
    "viscous-friction": ((HAND, WALL, 'kind = "viscous-friction"\ndamping_ns_per_m = 3.0'), SERIES),
    "stylus": (('kind = "stylus-hand"', WALL), SOFT),
    "stylus-and-friction": (('kind = "stylus-hand"', WALL, FRICTION), SOFT),
    "resonance": (
        (HAND, WALL, 'kind = "resonance"\nfrequency_hz = 180.0\ndamping_ratio = 0.02\nmass_ratio = 0.3'),
        SOFT,
    ),
    "resonance-and-friction": (
        (HAND, WALL, 'kind = "resonance"\nfrequency_hz = 180.0\ndamping_ratio = 0.02\nmass_ratio = 0.3', FRICTION),
        SOFT,
    ),
    "encoder": ((HAND, WALL, 'kind = "encoder"\nresolution_m = 2e-5'), SOFT),
    "noise": ((HAND, WALL, 'kind = "noise"\nrms_m = 1e-6\nseed = 4'), SERIES),
    "velocity-filter": ((HAND, WALL, 'kind = "velocity-filter"\ncutoff_hz = 150.0'), SOFT),
    "velocity-filter-rigid": ((HAND, WALL, 'kind = "velocity-filter"\ncutoff_hz = 150.0'), Gains(math.inf, 0.0, 20.0)),
    "kalman": (
        (HAND, WALL, 'kind = "velocity-filter"\nestimator = "kalman"\nacceleration_m_per_s2 = 5.0\nnoise_rms_m = 5e-6'),
        SERIES,
    ),
    "delay": ((HAND, WALL, 'kind = "delay"\nsamples = 3'), SOFT),
    "saturation": ((HAND, WALL, 'kind = "saturation"'), SERIES),
    "saturation-both-ways": (
        (HAND, 'kind = "environment"\nstiffness_n_per_m = 3000.0', 'kind = "saturation"\nforce_n = 0.5'),
        Gains(20.0, 1e4),
    ),
    "amplifier": ((HAND, WALL, 'kind = "amplifier"\nbandwidth_hz = 200.0'), SOFT),
    "current-loop": ((HAND, WALL, 'kind = "amplifier"\nbandwidth_hz = 200.0\norder = 2'), SOFT),
    "current-loop-and-friction": ((HAND, WALL, 'kind = "amplifier"\nbandwidth_hz = 150.0\norder = 2', FRICTION), SOFT),
    "current-loop-that-rings": (
        (HAND, WALL, 'kind = "amplifier"\nbandwidth_hz = 150.0\norder = 2\ndamping_ratio = 0.3', FRICTION),
        SOFT,
    ),
    "part-of-a-sample-late": ((HAND, WALL, 'kind = "delay"\nsamples = 0.3'), SOFT),
    "samples-and-a-part-late": ((HAND, WALL, 'kind = "delay"\nsamples = 2.75', 'kind = "saturation"'), SOFT),
    "part-late-with-friction": ((HAND, WALL, 'kind = "delay"\nsamples = 1.4', FRICTION), SOFT),
    "part-late-with-all-mechanics": (
        (
            'kind = "stylus-hand"',
            WALL,
            'kind = "delay"\nsamples = 0.6',
            'kind = "resonance"\nfrequency_hz = 150.0\ndamping_ratio = 0.05\nmass_ratio = 0.5',
            'kind = "amplifier"\nbandwidth_hz = 400.0\norder = 2',
        ),
        SOFT,
    ),
    "backlash": ((HAND, WALL, 'kind = "backlash"\ngap_m = 2e-4'), SOFT),
    "backlash-and-encoder": (
        (HAND, WALL, 'kind = "backlash"\ngap_m = 1e-4', 'kind = "encoder"\nresolution_m = 2e-5'),
        SOFT,
    ),
    "encoder-at-the-handle": (
        (
            HAND,
            WALL,
            'kind = "resonance"\nfrequency_hz = 120.0\ndamping_ratio = 0.05\nmass_ratio = 0.5',
            'kind = "encoder"\nresolution_m = 2e-5\nat = "handle"',
        ),
        SOFT,
    ),
    "notch": ((HAND, WALL, 'kind = "notch"\nfrequency_hz = 120.0\ndepth = 0.1\nwidth = 0.6'), SOFT),
    "state-feedback": ((HAND, WALL, 'kind = "encoder"\nresolution_m = 2e-5', FEEDBACK), SOFT),
    "opening-dead-zone": ((HAND, WALL, 'kind = "encoder"\nresolution_m = 2e-5', OPENING), SOFT),
    "state-feedback-late-and-limited": (
        (HAND, WALL, FRICTION, FEEDBACK, 'kind = "delay"\nsamples = 1', 'kind = "saturation"\nforce_n = 1.5'),
        Gains(0.0, 1e9),
    ),
    "late": ((HAND, WALL, 'kind = "jitter"\nrms_s = 2e-4'), SOFT),
    "dropped": ((HAND, WALL, 'kind = "jitter"\nrms_s = 0.0\ndropped_share = 0.1\nseed = 2'), SOFT),
    "dropped-and-a-part-late": (
        (HAND, WALL, 'kind = "delay"\nsamples = 1.4', 'kind = "jitter"\nrms_s = 0.0\ndropped_share = 0.1\nseed = 2'),
        SOFT,
    ),
    "late-dropped-friction": ((HAND, WALL, 'kind = "jitter"\nrms_s = 2e-4\ndropped_share = 0.1', FRICTION), SOFT),
    "everything": (
        (
            'kind = "stylus-hand"',
            WALL,
            FRICTION,
            'kind = "viscous-friction"\ndamping_ns_per_m = 1.0',
            'kind = "resonance"\nfrequency_hz = 150.0\ndamping_ratio = 0.05\nmass_ratio = 0.2',
            'kind = "encoder"\nresolution_m = 1e-5',
            'kind = "noise"\nrms_m = 2e-6',
            'kind = "velocity-filter"\ncutoff_hz = 300.0',
            'kind = "delay"\nsamples = 1',
            'kind = "jitter"\nrms_s = 1e-4\ndropped_share = 0.05',
            'kind = "amplifier"\nbandwidth_hz = 300.0',
            'kind = "saturation"',
        ),
        Gains(5.0, 3e3, 4.0),
    ),
}
