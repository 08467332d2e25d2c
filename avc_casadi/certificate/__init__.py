"""Certificates: which claim a gain table meets, with what margin and where; the walls that a device can render."""

from avc_casadi.certificate._certificate import TITLES as TITLES
from avc_casadi.certificate._certificate import Certificate as Certificate
from avc_casadi.certificate._certificate import Level as Level
from avc_casadi.certificate._certificate import LevelResult as LevelResult
from avc_casadi.certificate._certify import certify as certify
from avc_casadi.certificate._deployable import Deployable as Deployable
from avc_casadi.certificate._deployable import DeployClaim as DeployClaim
from avc_casadi.certificate._deployable import deployable as deployable
from avc_casadi.certificate._detent_claim import detent_verdict as detent_verdict
from avc_casadi.certificate._device_levels import ideal as ideal
from avc_casadi.certificate._feedback_radius import feedback_radius as feedback_radius
from avc_casadi.certificate._gate import certified as certified
from avc_casadi.certificate._gate import require_deployable as require_deployable
from avc_casadi.certificate._levels_table import levels_table as levels_table
from avc_casadi.certificate._llewellyn_table import LlewellynTable as LlewellynTable
from avc_casadi.certificate._llewellyn_table import llewellyn_table as llewellyn_table
from avc_casadi.certificate._proof_files import proof_files as proof_files
from avc_casadi.certificate._rendered_wall import rendered_wall as rendered_wall
from avc_casadi.certificate._rest_proof import promises_rest as promises_rest
from avc_casadi.certificate._rest_proof import proved_wall_n_per_m as proved_wall_n_per_m
from avc_casadi.certificate._rest_proof import quick_rest_level as quick_rest_level
from avc_casadi.certificate._rest_proof import quickly_proved as quickly_proved
from avc_casadi.certificate._zwidth import Curve as Curve
from avc_casadi.certificate._zwidth import ZWidth as ZWidth
from avc_casadi.certificate._zwidth import zwidth as zwidth
