"""The joint schedule: gains over ln(omega) as one optimal-control problem."""

from avc_casadi.design.schedule._solver import ScheduleSolver as ScheduleSolver
from avc_casadi.design.schedule._solver import solve_schedule as solve_schedule
