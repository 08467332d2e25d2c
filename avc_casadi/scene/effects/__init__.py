"""The effects of a scene, one file each."""

from avc_casadi.scene.effects._adaptation import Adaptation as Adaptation
from avc_casadi.scene.effects._amplifier import Amplifier as Amplifier
from avc_casadi.scene.effects._backlash import Backlash as Backlash
from avc_casadi.scene.effects._base import SceneEffect as SceneEffect
from avc_casadi.scene.effects._base import Station as Station
from avc_casadi.scene.effects._compensator import Compensator as Compensator
from avc_casadi.scene.effects._coulomb_friction import CoulombFriction as CoulombFriction
from avc_casadi.scene.effects._delay import Delay as Delay
from avc_casadi.scene.effects._encoder import Encoder as Encoder
from avc_casadi.scene.effects._environment import TwoSidedEnvironment as TwoSidedEnvironment
from avc_casadi.scene.effects._estimator import Estimator as Estimator
from avc_casadi.scene.effects._guard import Guard as Guard
from avc_casadi.scene.effects._hand import Grip as Grip
from avc_casadi.scene.effects._hand import StylusGrip as StylusGrip
from avc_casadi.scene.effects._jitter import Jitter as Jitter
from avc_casadi.scene.effects._noise import Noise as Noise
from avc_casadi.scene.effects._notch import Notch as Notch
from avc_casadi.scene.effects._observer import Observer as Observer
from avc_casadi.scene.effects._registry import KINDS as KINDS
from avc_casadi.scene.effects._registry import build_effects as build_effects
from avc_casadi.scene.effects._resonance import Resonance as Resonance
from avc_casadi.scene.effects._saturation import Saturation as Saturation
from avc_casadi.scene.effects._state_feedback import StateFeedback as StateFeedback
from avc_casadi.scene.effects._velocity_filter import VelocityFilter as VelocityFilter
from avc_casadi.scene.effects._viscous_friction import ViscousFriction as ViscousFriction
from avc_casadi.scene.effects._wall import Wall as Wall
