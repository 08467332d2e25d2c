"""Proofs and refutations: what holds for every hand of a box, with enclosures in place of samples."""

from avc_casadi.proof._held_device import HAND as HAND
from avc_casadi.proof._held_device import STYLUS as STYLUS
from avc_casadi.proof._held_device import HeldDevice as HeldDevice
from avc_casadi.proof._law import ContactLaw as ContactLaw
from avc_casadi.proof._multiplier import Multiplier as Multiplier
from avc_casadi.proof._orbits import Orbit as Orbit
from avc_casadi.proof._orbits import find_orbit as find_orbit
from avc_casadi.proof._rest import Outcome as Outcome
from avc_casadi.proof._rest import Rest as Rest
from avc_casadi.proof._rest import Unstable as Unstable
from avc_casadi.proof._rest import prove_rest as prove_rest
from avc_casadi.proof._ripple import NOISE_BOUND as NOISE_BOUND
from avc_casadi.proof._ripple import Ripple as Ripple
from avc_casadi.proof._ripple import bound_ripple as bound_ripple
from avc_casadi.proof._switching import SwitchingLoop as SwitchingLoop
from avc_casadi.proof._walls import WallGap as WallGap
from avc_casadi.proof._walls import rigid_with_damper as rigid_with_damper
from avc_casadi.proof._walls import same_gains as same_gains
from avc_casadi.proof._walls import wall_gap as wall_gap
