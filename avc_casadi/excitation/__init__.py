"""Excitation: a safe signal that tells the most of a device, and what it will do to every device of the ranges."""

from avc_casadi.excitation._plan import Plan as Plan
from avc_casadi.excitation._plan import speed_window as speed_window
from avc_casadi.excitation._signal import FULL as FULL
from avc_casadi.excitation._signal import Signal as Signal
