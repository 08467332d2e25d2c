"""Realism: what a hand cannot tell from the desired impedance."""

from avc_casadi.realism._inside import RealismResult as RealismResult
from avc_casadi.realism._inside import bound_magnitudes as bound_magnitudes
from avc_casadi.realism._inside import judge_realism as judge_realism
from avc_casadi.realism._inside import relative_errors as relative_errors
