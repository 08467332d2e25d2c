"""The joint schedule: gains over ln(omega) as one optimal-control problem."""

from avc_casadi.design.schedule._infeasible import Missing as Missing
from avc_casadi.design.schedule._infeasible import missing_rows as missing_rows
from avc_casadi.design.schedule._program import solve_program as solve_program
from avc_casadi.design.schedule._realism import realism_slack as realism_slack
from avc_casadi.design.schedule._refine import Outcome as Outcome
from avc_casadi.design.schedule._refine import refined as refined
from avc_casadi.design.schedule._scope import Slots as Slots
from avc_casadi.design.schedule._scope import worst_slack as worst_slack
from avc_casadi.design.schedule._solver import ScheduleSolver as ScheduleSolver
from avc_casadi.design.schedule._solver import solve_schedule as solve_schedule
from avc_casadi.design.schedule._task import Task as Task
