"""Tuning in the closed loop: methods that judge gains by simulated scenes."""

from avc_casadi.tuning._static_tuned import Budget as Budget
from avc_casadi.tuning._static_tuned import StaticTuned as StaticTuned
from avc_casadi.tuning._static_tuned import solve_static_tuned as solve_static_tuned
from avc_casadi.tuning._static_tuned import tune_static as tune_static
