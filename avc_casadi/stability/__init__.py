"""Linear stability of the frozen loop with a set of hands: a claim of its own beside passivity."""

from avc_casadi.stability._hands import HandSet as HandSet
from avc_casadi.stability._hands import hand_set as hand_set
from avc_casadi.stability._hands import no_hand as no_hand
from avc_casadi.stability._spectral import MAX_DELAY_SAMPLES as MAX_DELAY_SAMPLES
from avc_casadi.stability._spectral import RADIUS_TOLERANCE as RADIUS_TOLERANCE
from avc_casadi.stability._spectral import LinearStability as LinearStability
from avc_casadi.stability._spectral import frozen_parts as frozen_parts
from avc_casadi.stability._spectral import linear_stability as linear_stability
from avc_casadi.stability._transition import mechanics as mechanics
from avc_casadi.stability._transition import transition as transition
