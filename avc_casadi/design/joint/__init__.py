"""Gains for all frequencies or for a scope wider than one: the joint schedule and the scopes of direct."""

from avc_casadi.design.joint._assembly import schedule_nlp as schedule_nlp
from avc_casadi.design.joint._infeasible import Missing as Missing
from avc_casadi.design.joint._infeasible import missing_rows as missing_rows
from avc_casadi.design.joint._polish import Evaluate as Evaluate
from avc_casadi.design.joint._polish import fitted_quadratic as fitted_quadratic
from avc_casadi.design.joint._polish import polished as polished
from avc_casadi.design.joint._program import solve_program as solve_program
from avc_casadi.design.joint._realism import realism_slack as realism_slack
from avc_casadi.design.joint._refine import Outcome as Outcome
from avc_casadi.design.joint._refine import refined as refined
from avc_casadi.design.joint._scope import Slots as Slots
from avc_casadi.design.joint._scope import worst_slack as worst_slack
from avc_casadi.design.joint._scoped import solve_direct_in_scope as solve_direct_in_scope
from avc_casadi.design.joint._scoped import solve_scoped as solve_scoped
from avc_casadi.design.joint._solver import ScheduleSolver as ScheduleSolver
from avc_casadi.design.joint._solver import solve_schedule as solve_schedule
from avc_casadi.design.joint._states import States as States
from avc_casadi.design.joint._task import Task as Task
