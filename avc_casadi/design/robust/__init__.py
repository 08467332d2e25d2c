"""Robust design: coupling, observer and feedback together, for every hand and a device not quite as declared."""

from avc_casadi.design.robust._goal import Cost as Cost
from avc_casadi.design.robust._goal import cost_of as cost_of
from avc_casadi.design.robust._goal import costs_of as costs_of
from avc_casadi.design.robust._ladder import MOST_RUNGS as MOST_RUNGS
from avc_casadi.design.robust._ladder import NEXT as NEXT
from avc_casadi.design.robust._ladder import Rung as Rung
from avc_casadi.design.robust._ladder import ladder_n_per_m as ladder_n_per_m
from avc_casadi.design.robust._ladder import robust_at as robust_at
from avc_casadi.design.robust._ladder import softer_ladders as softer_ladders
from avc_casadi.design.robust._law import Space as Space
from avc_casadi.design.robust._loops import Loops as Loops
from avc_casadi.design.robust._loops import other_devices as other_devices
from avc_casadi.design.robust._moved import moved as moved
from avc_casadi.design.robust._refine import Unrest as Unrest
from avc_casadi.design.robust._refine import refined as refined
from avc_casadi.design.robust._search import MOST_LAWS as MOST_LAWS
from avc_casadi.design.robust._search import Found as Found
from avc_casadi.design.robust._search import search as search
from avc_casadi.design.robust._solve import solve_robust as solve_robust
