"""Devices of several axes: what the tip weighs in every direction, how stiff a wall it can show where, and gains."""

from avc_casadi.arm._arm import Arm as Arm
from avc_casadi.arm._arm import evaluated as evaluated
from avc_casadi.arm._effective import MassRange as MassRange
from avc_casadi.arm._effective import effective_masses as effective_masses
from avc_casadi.arm._effective import grid as grid
from avc_casadi.arm._effective import mass_range as mass_range
from avc_casadi.arm._effective import mobility as mobility
from avc_casadi.arm._effective import one_normal as one_normal
from avc_casadi.arm._effective import operational_inertia as operational_inertia
from avc_casadi.arm._effective import reached as reached
from avc_casadi.arm._made import arm as arm
from avc_casadi.arm._tip_device import tip_device as tip_device
from avc_casadi.arm._tip_device import tip_device_file as tip_device_file
