"""Runtime: the algorithms of an adaptive coupling, each one step of fixed size for scenes and for firmware."""

from avc_casadi.runtime._adaptation import AdaptationSettings as AdaptationSettings
from avc_casadi.runtime._adaptation import adaptation_step as adaptation_step
from avc_casadi.runtime._estimators import ESTIMATORS as ESTIMATORS
from avc_casadi.runtime._estimators import EstimatorMethod as EstimatorMethod
from avc_casadi.runtime._estimators import estimator_step as estimator_step
from avc_casadi.runtime._guard import GUARDS as GUARDS
from avc_casadi.runtime._guard import GuardSettings as GuardSettings
from avc_casadi.runtime._guard import guard_step as guard_step
from avc_casadi.runtime._hold import HoldSettings as HoldSettings
from avc_casadi.runtime._hold import hold_step as hold_step
from avc_casadi.runtime._observer import ObserverSettings as ObserverSettings
from avc_casadi.runtime._observer import observer_step as observer_step
from avc_casadi.runtime._signal import EstimatorSettings as EstimatorSettings
from avc_casadi.runtime._state_feedback import state_feedback_step as state_feedback_step
from avc_casadi.runtime._step import Expr as Expr
from avc_casadi.runtime._step import Step as Step
