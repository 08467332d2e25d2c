"""What accuracy costs in time: methods and solvers, gain tables, grids of frequencies."""

from avc_casadi.study.accuracy._grids import GridMiss as GridMiss
from avc_casadi.study.accuracy._grids import grid_misses as grid_misses
from avc_casadi.study.accuracy._interpolations import linear as linear
from avc_casadi.study.accuracy._interpolations import nearest as nearest
from avc_casadi.study.accuracy._interpolations import pchip as pchip
from avc_casadi.study.accuracy._solvers import SolverCost as SolverCost
from avc_casadi.study.accuracy._solvers import reference_errors as reference_errors
from avc_casadi.study.accuracy._study import Accuracy as Accuracy
from avc_casadi.study.accuracy._study import study_accuracy as study_accuracy
from avc_casadi.study.accuracy._tables import TableError as TableError
from avc_casadi.study.accuracy._tables import table_errors as table_errors
