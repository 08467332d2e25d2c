"""Excitation: a safe signal that tells the most of a device, and what it will do to every device of the ranges."""

from avc_casadi.excitation._crest import crest_factor as crest_factor
from avc_casadi.excitation._crest import low_crest_phases as low_crest_phases
from avc_casadi.excitation._crest import schroeder_phases as schroeder_phases
from avc_casadi.excitation._design import KINDS as KINDS
from avc_casadi.excitation._design import SECONDS as SECONDS
from avc_casadi.excitation._design import SPEED_M_PER_S as SPEED_M_PER_S
from avc_casadi.excitation._design import TRAVEL_M as TRAVEL_M
from avc_casadi.excitation._design import Excitation as Excitation
from avc_casadi.excitation._design import check_plan as check_plan
from avc_casadi.excitation._design import plan_excitation as plan_excitation
from avc_casadi.excitation._forecast import Forecast as Forecast
from avc_casadi.excitation._forecast import corners_of as corners_of
from avc_casadi.excitation._forecast import forecast as forecast
from avc_casadi.excitation._information import Centring as Centring
from avc_casadi.excitation._information import Room as Room
from avc_casadi.excitation._information import best_power as best_power
from avc_casadi.excitation._information import information as information
from avc_casadi.excitation._plan import Kind as Kind
from avc_casadi.excitation._plan import Plan as Plan
from avc_casadi.excitation._plan import speed_window as speed_window
from avc_casadi.excitation._signal import FULL as FULL
from avc_casadi.excitation._signal import Signal as Signal
