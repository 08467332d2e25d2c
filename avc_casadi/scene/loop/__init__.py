"""One sample of the loop as expressions: what scenes and firmware share."""

from avc_casadi.scene.loop._coupling import Environment as Environment
from avc_casadi.scene.loop._coupling import coupling_parameters as coupling_parameters
from avc_casadi.scene.loop._coupling import wall_force as wall_force
from avc_casadi.scene.loop._tick import AdaptedGains as AdaptedGains
from avc_casadi.scene.loop._tick import Expr as Expr
from avc_casadi.scene.loop._tick import Rate as Rate
from avc_casadi.scene.loop._tick import Tick as Tick
