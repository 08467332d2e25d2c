"""Robust design: coupling, observer and feedback together, for every hand and a device not quite as declared."""

from avc_casadi.design.robust._between import between as between
from avc_casadi.design.robust._climb import CLOSE as CLOSE
from avc_casadi.design.robust._climb import EndsAt as EndsAt
from avc_casadi.design.robust._climb import Unrest as Unrest
from avc_casadi.design.robust._climb import climb as climb
from avc_casadi.design.robust._goal import Cost as Cost
from avc_casadi.design.robust._goal import cost_of as cost_of
from avc_casadi.design.robust._goal import costs_of as costs_of
from avc_casadi.design.robust._ladder import Rung as Rung
from avc_casadi.design.robust._ladder import robust_at as robust_at
from avc_casadi.design.robust._ladder import why_no_law as why_no_law
from avc_casadi.design.robust._law import Space as Space
from avc_casadi.design.robust._loops import Loops as Loops
from avc_casadi.design.robust._loops import assumed_devices as assumed_devices
from avc_casadi.design.robust._moved import moved as moved
from avc_casadi.design.robust._search import Found as Found
from avc_casadi.design.robust._search import search as search
from avc_casadi.design.robust._solve import solve_robust as solve_robust
