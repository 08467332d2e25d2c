"""Linear stability of the frozen loop with a set of hands: a claim of its own beside passivity."""

from avc_casadi.stability._lyapunov import SwitchingProof as SwitchingProof
from avc_casadi.stability._lyapunov import common_lyapunov as common_lyapunov
from avc_casadi.stability._lyapunov import lyapunov as lyapunov
from avc_casadi.stability._lyapunov import switching_proof as switching_proof
from avc_casadi.stability._scope import ScopeSlack as ScopeSlack
from avc_casadi.stability._scope import deciding_frequencies_hz as deciding_frequencies_hz
from avc_casadi.stability._scope import scope_band_hz as scope_band_hz
from avc_casadi.stability._scope import scope_slack as scope_slack
from avc_casadi.stability._spectral import MAX_DELAY_SAMPLES as MAX_DELAY_SAMPLES
from avc_casadi.stability._spectral import RADIUS_TOLERANCE as RADIUS_TOLERANCE
from avc_casadi.stability._spectral import LinearStability as LinearStability
from avc_casadi.stability._spectral import frozen_parts as frozen_parts
from avc_casadi.stability._spectral import linear_stability as linear_stability
from avc_casadi.stability._transition import Rendering as Rendering
from avc_casadi.stability._transition import fraction_rendering as fraction_rendering
from avc_casadi.stability._transition import frozen_transition as frozen_transition
from avc_casadi.stability._transition import joint_rendering as joint_rendering
from avc_casadi.stability._transition import mechanics as mechanics
from avc_casadi.stability._whole_device import closed_loop as closed_loop
from avc_casadi.stability._whole_device import plants_with_forces as plants_with_forces
from avc_casadi.stability._whole_device import rigid as rigid
from avc_casadi.stability._whole_device import sampled_stability as sampled_stability
from avc_casadi.stability._whole_device import whole_stability as whole_stability
